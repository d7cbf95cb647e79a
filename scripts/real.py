"""Run the verbs on measured logs and judge them by what is known of the devices.

Every diagnosis is *right*, *honest*, *wrong*, *refused*, an *error* or, of a device of which nothing is known,
*unknown*, one line each with the reason, and the counts last; before them stand a table of all runs and what else is
required. Exit code 1: something is not as it must be.

Every run is a process of its own; what is in the folder of results is not run again, so that a run that was stopped
goes on where it was. ``--only NAME`` runs logs again whose names begin so, and no others. ``--compare A B`` prints the
verdicts of two folders side by side: give every engine a folder of its own. Nothing is copied from the data.

Data with no licence to stand beside the project are taken from ``--public DIR``, a folder with clones of the
repositories that the data's README names (dynamic_calibration, figaroh-examples), or public.py
(dvrk_dynamics_identification, HSM150-data, masterThesisMatlab).
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from csv import writer as csv_writer
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import tyro
from real_data import cases, checks, running
from real_data.cases import Case
from real_data.checks import Line
from real_data.judging import Class, Judgement, describe, judge
from real_data.known import known_of
from real_data.proposed import from_file, singles, summary
from real_data.public import devices
from real_data.running import Outcome
from real_data.samples import explained_share
from tqdm import tqdm

from tests.blind.answers import encode_answer

Outcomes = Mapping[tuple[str, str], Outcome]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
CUTOFF = 4.0
"""Low-pass of the least squares that a refusal is compared with, Hz."""
LIMIT = 120.0
"""Time limit of a run, s: twice what any diagnosis may take, on a machine that is busy with something else."""


def chosen(every: Sequence[Case], only: Sequence[str]) -> list[Case]:
    """Return the cases whose names begin as one of `only`, all where that is empty."""
    for name in only:
        if not any(case.name.startswith(name) for case in every):
            sys.exit(
                f"--only: no log is called '{name}'; there are {', '.join(case.name for case in every)}"
            )
    return [case for case in every if not only or case.name.startswith(tuple(only))]


def mended(case: Case, made: Path) -> Case:
    """Return a case with its URDF mended, where that is needed and there."""
    if not (case.flawed and case.there):
        return case
    urdf = made / f"{case.name}.urdf"
    running.run(["check", str(case.rig), "--mend", str(urdf)], made, LIMIT)
    return replace(case, rig=urdf)


def run_missing(wanted: Sequence[Case], folder: Path, limit: float) -> None:
    """Run what has no outcome in the folder."""
    there = [case for case in wanted if case.there]
    jobs = [
        (case, run)
        for case in there
        for run in case.runs
        if not (folder / case.name / f"{run}.json").exists()
    ]
    for case, run in tqdm(jobs, desc="runs", disable=None, file=sys.stderr):
        out = folder / case.name
        running.keep(running.run(case.arguments(run, out), out, limit), out / f"{run}.json")


def residual(outcome: Outcome) -> str:
    """Return each joint's state of the residual, and the variable that it depends on."""
    told = (outcome.result or {}).get("residual", {})
    return ", ".join(
        f"{j} {one['state']} {one.get('over', '')}".rstrip() for j, one in told.items()
    )


def table(outcomes: Outcomes) -> str:
    """Return one line per run: seconds, exit code, what was found, what is left."""
    rows = [("log", "run", "s", "cpu s", "exit", "verdict: findings | residual")]
    for (case, run), one in outcomes.items():
        code = "limit" if one.exit is None else str(one.exit)
        said = describe(one) if "verdict" in (one.result or {}) or one.exit != 0 else ""
        left = " | ".join(filter(None, (said, residual(one))))
        rows.append(
            (
                case,
                run,
                f"{one.seconds:.1f}",
                "" if one.cpu is None else f"{one.cpu:.1f}",
                code,
                left,
            )
        )
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    return "\n".join(
        "  ".join([*(x.ljust(w) for x, w in zip(row, widths)), *row[5:]]).rstrip() for row in rows
    )


def side_by_side(one: Outcomes, other: Outcomes) -> str:
    """Return what two folders hold of every diagnosis, and of every other run that ended differently."""
    lines = []
    for key in sorted(one.keys() | other.keys()):
        pair = one.get(key), other.get(key)
        if key[1].startswith("diagnose") or len({x and x.exit for x in pair}) > 1:
            lines.append(" ".join(key))
            for name, x in zip("AB", pair):
                told = (
                    ""
                    if x is None
                    else f"{x.seconds:6.1f} s  {describe(x)} | {residual(x)}".rstrip(" |")
                )
                lines.append(f"  {name}  {told or 'not run'}")
    return "\n".join(lines)


def count(lines: Sequence[Line]) -> str:
    """Return the last line."""
    passed, failed, skipped = (
        sum(line.passed is state for line in lines) for state in (True, False, None)
    )
    return f"{passed} passed, {failed} failed, {skipped} skipped"


def judged(every: Sequence[Case], outcomes: Outcomes) -> list[Judgement]:
    """Return the class of every diagnosis that there is."""
    found = []
    for case in every:
        outcome = outcomes.get((case.name, "diagnose"))
        if outcome is not None:
            found.append(
                judge(
                    case.name, known_of(case.name), outcome, partial(explained_share, case, CUTOFF)
                )
            )
    return found


def write_answers(path: Path, classes: Sequence[Judgement], outcomes: Outcomes, data: Path) -> None:
    """Write a CSV file with a line per diagnosis: its class, why, processor time, exit code, and what it said.

    Files are named from the folder of measured data on.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv_writer(file, lineterminator="\n")
        writer.writerow(["log", "device", "class", "why", "seconds", "exit", "answer"])
        for judgement in classes:
            outcome = outcomes[judgement.log, "diagnose"]
            answer = {"verdict": "refused"} | (outcome.result or {})
            seconds = outcome.seconds if outcome.cpu is None else outcome.cpu
            row = [
                judgement.log,
                judgement.device,
                judgement.judged,
                judgement.why,
                f"{seconds:.2f}",
                outcome.exit,
            ]
            writer.writerow([*row, encode_answer(answer).replace(f"{data}/", "")])


def main(
    data: Path = DATA,
    folder: Path = Path("real-results"),
    only: tuple[str, ...] = (),
    public: Path | None = None,
    compare: tuple[Path, Path] | None = None,
    proposed: bool = False,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
    csv: Path | None = None,
    limit: float = LIMIT,
) -> None:
    """Run what is missing and print lines and table.

    Args:
        data: The folder of measured data.
        folder: Where outcomes are kept.
        only: Run these logs again, by how their names begin, and no others; lines without outcomes are skipped.
        public: A folder with clones of the public repositories that the data's README and public.py name.
        compare: Print the verdicts of two folders of outcomes side by side, and run nothing.
        proposed: Go from each file to a report by the mapping that `inspect` proposes, and print a line per log.
        json_file: Write lines and outcomes as JSON.
        csv: Write the class and the answer of every diagnosis, a line each.
        limit: Time limit of a run, s.
    """
    if compare is not None:
        print(side_by_side(*map(running.kept, compare)))
        return
    if not data.is_dir():
        print(f"{data} is not there: give the folder of measured data with --data")
    with TemporaryDirectory() as place:
        made = Path(place)
        every = [*cases.measured(data, made), *cases.benchmarks(data)]
        if public is not None:
            every += [*cases.public(public), *devices(public, made)]
        every = [mended(case, made) for case in every]
        wanted = chosen(every, only)
        if proposed:
            found = [
                from_file(case, folder, limit)
                for case in tqdm(singles(wanted), disable=None, file=sys.stderr)
            ]
            print(*found, summary(found), sep="\n")
            return
        if only:
            for case in wanted:
                shutil.rmtree(folder / case.name, ignore_errors=True)
        run_missing(wanted, folder, limit)
        names = {case.name for case in every}
        outcomes = {key: one for key, one in running.kept(folder).items() if key[0] in names}
        lines = checks.judged(checks.required(every, folder), outcomes)
        classes = judged(every, outcomes)
    print(table(outcomes), "", *lines, "", *classes, sep="\n")
    if json_file is not None:
        told = {" ".join(key): asdict(one) for key, one in outcomes.items()}
        json_file.write_text(
            json.dumps(
                {
                    "classes": [asdict(x) for x in classes],
                    "lines": [asdict(x) for x in lines],
                    "runs": told,
                },
                indent=1,
            ),
            "utf-8",
        )
    if csv is not None:
        write_answers(csv, classes, outcomes, data)
    print(count(lines))
    print(", ".join(f"{sum(x.judged is one for x in classes)} {one}" for one in Class))
    bad = Class.WRONG, Class.REFUSED, Class.ERROR, Class.UNKNOWN
    sys.exit(any(line.passed is False for line in lines) or any(x.judged in bad for x in classes))


if __name__ == "__main__":
    tyro.cli(main)
