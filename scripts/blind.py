"""Hidden effects in logs of another simulator: only the log's and the rig's files reach ``gimbal-pin diagnose``.

    scripts/blind draw --folder F --seed N   logs, rigs and truths: a sample (``--counts clean 30 single 60``)
    scripts/blind run --folder F             diagnoses what is not diagnosed yet
    scripts/blind store --folder F --csv C   the answers in one file, a line each, which ``judge --folder C`` reads too
    scripts/blind compare A B                two engines' answers on the same logs: discordant logs and sign test
    scripts/blind judge --folder F           the table: every figure with Wilson bounds, must, PASS or FAIL
    scripts/blind --reliability --folder F   stated probabilities against the truth: table, picture and JSON in F

``draw`` and ``run`` go on where they were stopped; a log whose ``diagnosis.json`` is removed is diagnosed again.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import redirect_stdout
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, Literal

import tyro
from blind_comparison import compare, format_pairs
from tqdm import tqdm

from gimbal_pin.cli import main as gimbal_pin
from tests.blind import answers, cases, files, plant, reliability, table
from tests.blind import draw as sampling
from tests.blind.judge import Judged, confident, judge, tells
from tests.blind.plan import Plan

LOGS = ("log.csv", "rig.urdf", "rig.yaml")
"""What may reach a diagnosis."""
Stratum = Literal["clean", "single", "pair", "outside", "drive-clean", "drive-single", "mismatched"]
FINAL: dict[Stratum, int] = {
    "clean": 300, "single": 160, "pair": 100, "outside": 60, "drive-clean": 300, "drive-single": 80, "mismatched": 40,
}  # fmt: skip
"""Logs of the final draw."""


def hide(plan: Plan, folder: Path) -> None:
    """Hide and write log, rig and, last, the truth; or a file `diverged` where no controller holds the plant."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        hidden = cases.hide(plan)
    except plant.PlantDivergedError:
        (folder / "diverged").touch()
        return
    files.write(hidden, folder)
    files.write_whole(folder / "truth.json", json.dumps(hidden.truth, indent=1) + "\n")


def plans(seed: int, counts: dict[Stratum, int]) -> dict[str, Plan]:
    """Folder name → plan."""
    return {
        f"{s}-{seed}-{i:04d}": p
        for s, n in counts.items()
        for i, p in enumerate(sampling.sample(n, seed, s))
    }


def diagnosed(folder: Path) -> None:
    """Diagnose the log's and the rig's files, and nothing else, from a folder where nothing else is.

    Exit code 3 is a refusal, and so is 2 where the log lacks a joint that moves in its URDF; all else is an error.
    """
    missing = loaded(folder / "truth.json")["plan"].get("idle") == "unlogged"
    started = process_time()
    with TemporaryDirectory() as place:
        rig, log, said = (Path(place) / name for name in ("rig.yaml", "log.csv", "said.json"))
        for name in LOGS:
            (Path(place) / name).symlink_to((folder / name).resolve())
        try:
            with redirect_stdout(StringIO()):
                gimbal_pin(["diagnose", str(rig), str(log), "--json", str(said)])
            answer = said.read_text(encoding="utf-8")
        except (Exception, SystemExit) as stop:  # noqa: BLE001 - an error of ours is counted, and ends no run
            code = stop.code if isinstance(stop, SystemExit) else repr(stop)
            verdict = "refused" if code == 3 or (code == 2 and missing) else "error"
            answer = json.dumps({"verdict": verdict, "findings": [], "exit": code})
    files.write_whole(folder / "seconds", f"{process_time() - started:.2f}\n")
    files.write_whole(folder / "diagnosis.json", answer)


def loaded(path: Path) -> dict[str, Any]:
    """Read a JSON file."""
    return dict(json.loads(path.read_text(encoding="utf-8")))


def in_parallel(jobs: int, work: Callable[..., None], arguments: list[tuple[Any, ...]]) -> None:
    """Call with each of the arguments, in processes, with a progress bar."""
    with ProcessPoolExecutor(jobs) as pool:
        futures = [pool.submit(work, *each) for each in arguments]
        for future in tqdm(
            as_completed(futures), total=len(futures), disable=None, file=sys.stderr
        ):
            future.result()


def draw(
    folder: Path,
    seed: int,
    counts: dict[Stratum, int] | None = None,
    jobs: int = os.cpu_count() or 1,
) -> None:
    """Draw logs with effects hidden in them.

    Args:
        folder: Where each log gets a folder of its own.
        seed: Seed of the sample; a longer sample begins with the logs of a shorter one.
        counts: How many logs of each stratum (FINAL's where none is given).
        jobs: Processes.
    """
    wanted = [(plan, folder / name) for name, plan in plans(seed, counts or FINAL).items()]
    in_parallel(jobs, hide, [
        one for one in wanted if not any((one[1] / name).exists() for name in ("truth.json", "diverged"))
    ])  # fmt: skip


def run(folder: Path, jobs: int = os.cpu_count() or 1) -> None:
    """Diagnose every drawn log that is not diagnosed yet.

    Args:
        folder: Folder of the draw.
        jobs: Processes.
    """
    drawn = sorted(truth.parent for truth in folder.glob("*/truth.json"))
    in_parallel(
        jobs, diagnosed, [(place,) for place in drawn if not (place / "diagnosis.json").exists()]
    )


def store(folder: Path, csv: Path) -> None:
    """Store the answers of a folder in a CSV file of one line per log.

    Args:
        folder: Folder of the draw, diagnosed.
        csv: The file to write.
    """
    print(f"{answers.write(csv, folder)} logs → {csv}")


def judged_in(folder: Path) -> dict[str, Judged]:
    """Folder name → the case, of every log that is diagnosed."""
    if folder.suffix == ".csv":
        return answers.read(folder)
    places = sorted(said.parent for said in folder.glob("*/diagnosis.json"))
    return {
        each.name: judge(loaded(each / "truth.json"), loaded(each / "diagnosis.json"))
        for each in places
    }


def compare_answers(
    first: tyro.conf.Positional[Path], second: tyro.conf.Positional[Path], each: bool = False
) -> None:
    """Print the paired table of two engines on the logs that both answered.

    Args:
        first: Folder of the draw, diagnosed, or a CSV file of stored answers.
        second: The same of the other engine.
        each: Name the discordant logs of every figure, too.
    """
    pairs = compare(judged_in(first), judged_in(second))
    print(format_pairs(pairs))
    for pair in pairs if each else ():
        print(f"{pair.name}\n  won: {', '.join(pair.won)}\n  lost: {', '.join(pair.lost)}")


def described(name: str, case: Judged) -> str:
    """One line: what was hidden and what was said; ! before what is wrong."""
    hidden = [f"{cause['cause']}:{cause['form']} at {cause['joint']}" for cause in case.causes]
    fault = case.truth["data"]["cause"] if case.truth["data"] else "nothing"
    said = [
        "! "[any(tells(found, cause) for cause in case.causes) or not confident(found)]
        + f"{found['cause']} at {found['joint']} ({found['status']})"
        for found in case.findings
    ]
    return f"{name}: {', '.join(hidden) or fault} → {case.verdict}: {', '.join(said)}"


def judge_folder(folder: Path, each: bool = False) -> None:
    """Print the table.

    Args:
        folder: Folder of the draw, diagnosed, or a CSV file of stored answers.
        each: Print each log's truth and diagnosis too, for development; never of a final draw before its table.
    """
    cases_of = judged_in(folder)
    rows = table.score(list(cases_of.values()))
    if any(reliability.list_probabilities(case.diagnosis) for case in cases_of.values()):
        rows += reliability.as_figures(reliability.measure(cases_of.values()))
    print(table.text(rows))
    if each:
        print("\n".join(described(name, case) for name, case in cases_of.items()))


def judge_probabilities(folder: Path) -> None:
    """Print the reliability of the stated probabilities, and write reliability.json and reliability.svg.

    Args:
        folder: Folder of the draw, diagnosed.
    """
    try:
        found = reliability.measure(judged_in(folder).values())
    except ValueError as error:
        raise SystemExit(f"{folder}: {error}") from error
    print(table.text(reliability.as_figures(found)))
    (folder / "reliability.json").write_text(
        json.dumps(asdict(found), indent=1) + "\n", encoding="utf-8"
    )
    reliability.chart(found).savefig(folder / "reliability.svg")


def main() -> None:
    """Run one of the commands; ``--reliability`` is one too."""
    commands = {
        "draw": draw,
        "run": run,
        "store": store,
        "compare": compare_answers,
        "judge": judge_folder,
        "reliability": judge_probabilities,
    }
    asked = ["reliability" if word == "--reliability" else word for word in sys.argv[1:]]
    tyro.extras.subcommand_cli_from_dict(
        commands, prog="scripts/blind", description=__doc__, args=asked
    )


if __name__ == "__main__":
    main()
