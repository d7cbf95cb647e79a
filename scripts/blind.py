"""A seeded, stratified sample of hidden effects: only the log's and the rig's files reach ``gimbal-pin diagnose``.

Every case leaves its truth and its diagnosis in the folder; a run that was stopped goes on where it was. To hide takes
longer than to diagnose: with ``--keep`` the logs stay too, and a case whose ``diagnosis.json`` is removed is diagnosed
again. Prints the figures with Wilson bounds, one confusion matrix and the detection limits.

The final draw: ``--clean 300 --single 160 --pair 100 --outside 60 --drive-clean 300 --drive-single 80``, and 0 of
``--mixed``, ``--data``, ``--held-out`` and ``--corrupted``, which are drawn on demand like the other two of a drive's.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import tyro
from tqdm import tqdm

from gimbal_pin.cli import main as gimbal_pin
from tests.blind import breakdown, cases, draw, files, plant, table
from tests.blind.plan import Plan

REFUSED = {"verdict": "refused", "findings": [], "residual": {}, "immaterial": [], "untestable": []}
"""What stands for a log that was refused: with exit code 3, or 2 where a joint is missing."""


LOGS = ("log.csv", "rig.urdf", "rig.yaml")
"""What may reach a diagnosis."""


def hide(plan: Plan, folder: Path) -> bool:
    """Hide and write log, rig and truth; return whether the plant stood it."""
    try:
        hidden = cases.hide(plan)
    except plant.PlantDivergedError:
        (folder / "diverged").touch()
        return False
    files.write(hidden, folder)
    with TemporaryDirectory() as place:
        told = files.write_truth(hidden, Path(place))
        (folder / "truth.json").write_text(told.truth.read_text(encoding="utf-8"), encoding="utf-8")
    return True


def joints_missing(folder: Path) -> bool:
    """Whether the log lacks a joint that moves in its URDF: to refuse it as bad input is an answer, and is counted."""
    return loaded(folder / "truth.json")["plan"].get("idle") == "unlogged"


def diagnosed(folder: Path) -> None:
    """Diagnose the log's and the rig's files, and nothing else, from a folder where nothing else is."""
    with TemporaryDirectory() as place:
        rig, log, said = (Path(place) / name for name in ("rig.yaml", "log.csv", "said.json"))
        for name in LOGS:
            (Path(place) / name).symlink_to((folder / name).resolve())
        try:
            with redirect_stdout(StringIO()):
                gimbal_pin(["diagnose", str(rig), str(log), "--json", str(said)])
        except SystemExit as stop:
            if stop.code != 3 and not (stop.code == 2 and joints_missing(folder)):
                raise RuntimeError(f"diagnose left with {stop.code} on {folder.name}") from stop
            said.write_text(json.dumps(REFUSED), encoding="utf-8")
        shutil.copy(said, folder / ".said.json")
        os.replace(folder / ".said.json", folder / "diagnosis.json")


def case(plan: Plan, folder: Path, keep: bool) -> None:
    """Hide what is not hidden yet, diagnose, and drop the logs unless they are to be kept."""
    hidden = all((folder / name).exists() for name in (*LOGS, "truth.json"))
    if hidden or hide(plan, folder):
        diagnosed(folder)
    if not keep:
        for name in LOGS:
            (folder / name).unlink(missing_ok=True)


def loaded(path: Path) -> dict[str, Any]:
    """Read a JSON file."""
    return dict(json.loads(path.read_text(encoding="utf-8")))


def plans(seed: int, sizes: dict[str, int]) -> dict[str, Plan]:
    """Folder name → plan."""
    return {f"{s}-{seed}-{i:04d}": p for s, n in sizes.items() for i, p in enumerate(draw.sample(n, seed, s))}


def main(
    folder: Path = Path("blind-results"),
    seed: int = 1,
    clean: int = 300,
    single: int = 600,
    pair: int = 120,
    outside: int = 120,
    mixed: int = 40,
    data: int = 60,
    held_out: int = 30,
    corrupted: int = 30,
    mismatched: int = 0,
    drive_clean: int = 0,
    drive_single: int = 0,
    drive_pair: int = 0,
    drive_outside: int = 0,
    keep: bool = False,
    workers: int = os.cpu_count() or 1,
) -> None:
    """Run what is missing and print the table.

    Args:
        folder: Where cases are kept.
        seed: Seed of the sample.
        clean: Logs with nothing in them.
        single: Logs with one effect of the library, half of them in forms that it does not have.
        pair: Logs with two.
        outside: Logs with an effect that the library does not have.
        mixed: One known and one from outside.
        data: Faults of the data.
        held_out: Effects that begin in the held-out part.
        corrupted: Clean logs with a spoilt segment.
        mismatched: Logs with a late torque column, or with two joints exchanged.
        drive_clean: Logs of a drive's sensors with nothing in them.
        drive_single: The same with one effect of the library.
        drive_pair: The same with two.
        drive_outside: The same with an effect that the library does not have.
        keep: Keep the logs, to diagnose them again.
        workers: Processes.
    """
    sizes = {
        "clean": clean, "single": single, "pair": pair, "outside": outside, "mixed": mixed, "data": data,
        "held-out": held_out, "corrupted": corrupted, "mismatched": mismatched,
        "drive-clean": drive_clean, "drive-single": drive_single, "drive-pair": drive_pair,
        "drive-outside": drive_outside,
    }  # fmt: skip
    wanted = plans(seed, sizes)
    done = {name for name in wanted if any((folder / name / f).exists() for f in ("diagnosis.json", "diverged"))}
    with ProcessPoolExecutor(workers) as pool:
        futures = []
        for name in wanted.keys() - done:
            (folder / name).mkdir(parents=True, exist_ok=True)
            futures.append(pool.submit(case, wanted[name], folder / name, keep))
        for future in tqdm(as_completed(futures), total=len(futures), desc="cases", disable=None, file=sys.stderr):
            future.result()
    kept = [folder / name for name in wanted if (folder / name / "diagnosis.json").exists()]
    pairs = [(loaded(place / "truth.json"), loaded(place / "diagnosis.json")) for place in kept]
    print(table.text(table.score(pairs)))
    print(breakdown.confusion(pairs))
    print(breakdown.limits_text(breakdown.detection_limits(pairs)))


if __name__ == "__main__":
    tyro.cli(main)
