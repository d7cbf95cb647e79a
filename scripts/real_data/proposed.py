"""From a log's file to a report: the mapping that `inspect` proposes, corrected where it is wrong, and `diagnose`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import yaml

from gimbal_pin.log.io.inspection import inspect
from gimbal_pin.log.mapping import Source, format_expression, parse_expression, read_mapping
from gimbal_pin.rig.rig import Rig
from real_data.cases import Case
from real_data.running import Outcome, run

_UNKNOWN = ("torque constant", "does not show")
"""Words of a remark on a column whose factor no log holds: the mapping's reader has to fill it in."""


@dataclass(frozen=True)
class Proposed:
    """What became of a log.

    Attributes:
        case: The log, as it is mapped by hand.
        wrong: Targets for which another column or factor is proposed than was written by hand.
        filled: Torque constants that were filled in.
        inspected: How `inspect` ended.
        reported: How `diagnose` ended with the mapping, or the verb that takes a platform's motion.
        report: Whether a report was written.
    """

    case: Case
    wrong: tuple[str, ...]
    filled: int
    inspected: Outcome
    reported: Outcome
    report: bool

    def __str__(self) -> str:
        """One line."""
        one = self.reported
        files = "report.html" if self.report else "no report"
        right = f"wrong: {', '.join(self.wrong)}" if self.wrong else "right"
        constants = f", {self.filled} torque constants filled in" if self.filled else ""
        end = f"exit {one.exit}, {files}, {self.inspected.seconds + one.seconds:.0f} s"
        why = "" if one.exit == 0 else f": {one.said}"
        return f"{self.case.name:28} inspect exit {self.inspected.exit}, {right}{constants}; {end}{why}"


def is_unknown(remark: str) -> bool:
    """Whether a remark says that no log holds the factor of a column."""
    return any(words in remark for words in _UNKNOWN)


def differing(case: Case) -> list[tuple[str, str]]:
    """Return the targets for which another column or factor is proposed than was written by hand, and the remark."""
    inspected = inspect(case.logs[0], Rig.load(case.rig))
    wrong = []
    found = {**inspected.open, **inspected.mapping}
    for target, source in read_mapping(case.maps).items():
        column, factor, remark = found.get(target, ("", "", ""))
        same = column == source.column and target not in inspected.open
        if (
            not same
            or abs(
                parse_expression(format_expression(column, factor), "").factor / source.factor - 1
            )
            > 1e-12
        ):
            wrong.append((target, remark if column == source.column else ""))
    return wrong


def written(source: Source) -> str:
    """Return a mapping's line for a column and a factor."""
    return f'"{source.column}"*{source.factor!r}'


def from_file(case: Case, folder: Path, limit: float) -> Proposed:
    """Map a log as `inspect` proposes, correct what differs from the hand's mapping, and report."""
    out = folder / case.name
    mapping = out / "map.yaml"
    log = str(case.logs[0])
    inspected = run(["inspect", log, "--rig", str(case.rig), "--yaml", str(mapping)], out, limit)
    differs = differing(case)
    by_hand = read_mapping(case.maps)
    table = yaml.safe_load(mapping.read_text(encoding="utf-8"))
    table |= {target: written(by_hand[target]) for target, _ in differs}
    mapping.write_text(yaml.safe_dump(table, sort_keys=False), encoding="utf-8")
    verb = ["diagnose", str(case.rig), log, "--map", str(mapping), "-o", str(out / "findings")]
    if "track" in case.runs:  # a platform's motion
        verb = [
            "track",
            str(case.rig),
            "--platform-log",
            log,
            "--map",
            str(mapping),
            "--seconds",
            "3",
            "--seeds",
            "1",
        ]
    reported = run(verb, out, limit)
    wrong = tuple(target for target, remark in differs if not is_unknown(remark))
    report = any((out / "findings").glob("*.html"))
    return Proposed(case, wrong, len(differs) - len(wrong), inspected, reported, report)


def singles(every: Iterable[Case]) -> list[Case]:
    """Return a case per log: what several logs are given for together is mapped as each of them."""
    logs: dict[Path, Case] = {}
    for case in every:
        for log in case.logs:
            name = case.name if len(case.logs) == 1 else re.sub(r"\W", "_", log.stem)
            logs.setdefault(log, Case(name, case.rig, (log,), case.maps, case.runs))
    return [case for case in logs.values() if case.there]


def summary(found: Iterable[Proposed]) -> str:
    """Return the last line."""
    every = list(found)
    right = sum(not one.wrong for one in every)
    ended = sum(one.inspected.exit == 0 and one.reported.exit in (0, 3) for one in every)
    return f"{len(every)} logs: {right} mappings proposed right, {ended} ended with 0 or 3"
