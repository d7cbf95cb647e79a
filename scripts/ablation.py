"""Each rule and each constant of the diagnosis that decides a verdict, switched off: what it costs on blind logs.

A rule that moves no figure beyond its Wilson bounds goes. The logs are those of ``scripts/blind draw``
in a folder: development logs, never those of a final draw. Every ablation diagnoses all of them in a process of
its own; what is in the folder of results is not run again.
"""

from __future__ import annotations

import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import tyro
from tqdm import tqdm

from tests.blind.judge import confident, first_right, judge, named_wrong
from tests.blind.table import wilson

ROOM = "gimbal_pin.diagnosis"


class Ablation(NamedTuple):
    """A constant or a rule with another value.

    Attributes:
        what: What is switched off.
        place: Module in the diagnosis, and name there.
        value: What stands there instead.
    """

    what: str
    place: str
    value: Any


def true(*_: Any) -> bool:
    """Stand for a rule that never denies."""
    return True


def false(*_: Any) -> bool:
    """Stand for a rule that never applies."""
    return False


def unchanged(evidence: Any, *_: Any) -> Any:
    """Stand for a step that changes nothing."""
    return evidence


ABLATIONS = {
    "as it is": Ablation("nothing", "", None),
    "rate-10": Ablation("error rate of 10 % instead of 1 %", "engine.selection.ERROR_RATE", 0.1),
    "rate-0.1": Ablation("error rate of 0.1 %", "engine.selection.ERROR_RATE", 0.001),
    "beam-1": Ablation("beam: greedy", "engine.selection.BEAM_WIDTH", 1),
    "tried-3": Ablation("half as many candidates refined", "engine.selection.REFITTED_CANDIDATES", 3),
    "most-12": Ablation("twice as many causes allowed", "engine.selection.MOST_CAUSES", 12),
    "pieces-6": Ablation("six harmonics of one cause", "engine.selection.MOST_PIECES", 6),
    "promise-0": Ablation("every candidate refined that gains anything", "engine.selection.PROMISE", 0.05),
    "matters": Ablation("no error of form", "engine.selection.exceeds_form_error", true),
    "form-2": Ablation("error of form 1 %", "engine.criterion.FORM_ERROR", 0.01),
    "form-of-cause": Ablation("no error of a cause's form", "engine.criterion.OF_CAUSE", 0.0),
    "overfit": Ablation("no prediction of unseen blocks", "engine.selection.predicts", true),
    "event": Ablation("one event is evidence", "engine.selection.lasting", true),
    "bounds": Ablation("no bounds on sizes, no lightest link", "engine.criterion.supported", true),
    "lightest": Ablation("no lightest link", "engine.criterion.LIGHTEST", -1e9),
    "structure": Ablation("no lack of fit denies a name", "engine.explained.material", false),
    "structure-3": Ablation("structures from 3 % of the residual", "engine.explained.STRUCTURED", 0.03),
    "misses": Ablation("what is left where a drive bites denies nothing", "engine.explained.misses", false),
    "one-pass": Ablation("one search", "engine.explained.SEARCHES", 1),
    "prior": Ablation("ten times the prior of the alignment", "engine.alignment.LAG_DEVIATION", 2.5e-2),
    "blocks": Ablation("what a few blocks tell is as sure as what all do", "result.moderate", unchanged),
    "turns": Ablation("gate closed at swift turns", "diagnose.open_turns", unchanged),
    "overdone": Ablation("causes of any torque", "score.OVERDONE", 1e9),
    "alike": Ablation("a drive's coefficient may be anything", "columns.UNIT_RANGE", (-1e9, 1e9)),
}  # fmt: skip


def switched(one: Ablation) -> None:
    """Put the ablation's value wherever its name was imported."""
    if not one.place:
        return
    module, name = one.place.rsplit(".", 1)
    import_module(f"{ROOM}.diagnose")
    old = getattr(import_module(f"{ROOM}.{module}"), name)
    for other in [m for key, m in sys.modules.items() if key.startswith(ROOM)]:
        if getattr(other, name, None) is old:
            setattr(other, name, one.value)


def diagnosed(key: str, log: Path, out: Path) -> None:
    """Diagnose one log with an ablation, and keep the result with the processor's time that it took."""
    from gimbal_pin.cli import main as gimbal_pin

    switched(ABLATIONS[key])
    began = time.process_time()
    with TemporaryDirectory() as place, redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        said = Path(place) / "said.json"
        try:
            gimbal_pin(["diagnose", str(log / "rig.yaml"), str(log / "log.csv"), "--json", str(said)])
            told = json.loads(said.read_text(encoding="utf-8"))
        except SystemExit as stop:
            told = {"verdict": f"exit {stop.code}", "findings": [], "residual": {}}
    told["cpu"] = time.process_time() - began
    out.with_suffix(".part").write_text(json.dumps(told), encoding="utf-8")
    os.replace(out.with_suffix(".part"), out)


def counted(logs: list[Path], folder: Path) -> dict[str, tuple[int, int]]:
    """Return name of a figure → how many logs of how many."""
    cases = [
        judge(*(json.loads(p.read_text(encoding="utf-8")) for p in (log / "truth.json", folder / f"{log.name}.json")))
        for log in logs
    ]
    empty = [one for one in cases if not one.causes and "outside" not in one.stratum]
    outside = [one for one in cases if "outside" in one.stratum]
    hidden = [one for one in cases if one.causes and "outside" not in one.stratum]
    return {
        "clean: named": (sum(bool(one.findings) for one in empty), len(empty)),
        "clean: unknown": (sum(one.verdict == "unknown" for one in empty), len(empty)),
        "hidden: right": (sum(bool(first_right(one)) for one in hidden), len(hidden)),
        "hidden: wrong": (sum(bool(named_wrong(one)) for one in hidden), len(hidden)),
        "outside: named": (sum(any(map(confident, one.findings)) for one in outside), len(outside)),
    }


def main(logs: Path, folder: Path = Path("ablation-results"), only: tuple[str, ...] = (), workers: int = 2) -> None:
    """Run what is missing and print the table.

    Args:
        logs: Folder of blind logs, each with log, rig and truth.
        folder: Where results are kept.
        only: Ablations by their keys; all without.
        workers: Processes.
    """
    every = sorted(place.parent for place in logs.glob("*/truth.json"))
    keys = ["as it is", *(only or [key for key in ABLATIONS if key != "as it is"])]
    jobs = [(key, log) for key in keys for log in every if not (folder / key / f"{log.name}.json").exists()]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        for key in keys:
            (folder / key).mkdir(parents=True, exist_ok=True)
        futures = [pool.submit(diagnosed, key, log, folder / key / f"{log.name}.json") for key, log in jobs]
        for future in tqdm(as_completed(futures), total=len(futures), desc="runs", disable=None, file=sys.stderr):
            future.result()
    base = counted(every, folder / "as it is")
    print("ablation".ljust(48), *(name.rjust(15) for name in base), "cpu".rjust(6))
    for key in keys:
        now = counted(every, folder / key)
        cells = [
            f"{hits}/{count}{'' if inside(hits, *base[name]) else ' !'}".rjust(15)
            for name, (hits, count) in now.items()
        ]
        cpu = sum(json.loads((folder / key / f"{log.name}.json").read_text())["cpu"] for log in every)
        print(ABLATIONS[key].what.ljust(48), *cells, f"{cpu:6.0f}")
    print("! beyond the Wilson bounds of what stands")


def inside(hits: int, reference: int, count: int) -> bool:
    """Whether a count lies within the 95 % bounds of another."""
    low, high = wilson(reference, count)
    return count == 0 or low <= hits / count <= high


if __name__ == "__main__":
    tyro.cli(main)
