"""The blind set's table: (truth, diagnosis) pairs → every figure, with Wilson bounds; reads and prints nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from statistics import median

from .conventions import READINGS, SAME_FAULT, Reading
from .judge import (
    Json,
    Judged,
    confident,
    covered,
    false_alarm,
    first_right,
    gain_recovered,
    judge,
    named_wrong,
    names_of,
    near,
    tells,
    visible,
)
from .plan import DRIVE_STRATA

Readings = Mapping[tuple[str, str], Reading]
Z95 = 1.959964


@dataclass(frozen=True)
class Figure:
    """One row: a share of `count` cases with its 95 % bounds, and what it must and should be.

    `must` and `aim` are (lowest, highest); a figure without them is for information."""

    name: str
    value: float | None
    low: float
    high: float
    count: int
    must: tuple[float, float] | None = None
    aim: tuple[float, float] | None = None

    @property
    def grade(self) -> str:
        """ "aim", "must", "short", or "-" where there is nothing to grade."""
        if self.value is None or self.must is None or self.aim is None:
            return "-"
        if self.aim[0] <= self.value <= self.aim[1]:
            return "aim"
        return "must" if self.must[0] <= self.value <= self.must[1] else "short"


def wilson(hits: float, count: int) -> tuple[float, float]:
    """The 95 % score interval of a share, hits / count; (0, 1) where nothing was counted."""
    if count == 0:
        return 0.0, 1.0
    p, z2 = hits / count, Z95 * Z95
    centre = (p + z2 / (2.0 * count)) / (1.0 + z2 / count)
    half = Z95 / (1.0 + z2 / count) * sqrt(p * (1.0 - p) / count + z2 / (4.0 * count * count))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def _share(
    name: str,
    scores: Iterable[float],
    must: tuple[float, float] | None = None,
    aim: tuple[float, float] | None = None,
) -> Figure:
    listed = [float(score) for score in scores]
    value = sum(listed) / len(listed) if listed else None
    return Figure(name, value, *wilson(sum(listed), len(listed)), len(listed), must, aim)


def _of(cases: Sequence[Judged], *strata: str) -> list[Judged]:
    return [case for case in cases if case.stratum in strata]


def _seen(cases: Sequence[Judged]) -> list[Judged]:
    """Cases of which every hidden cause is visible."""
    return [case for case in cases if all(visible(cause) for cause in case.causes)]


def _gain(cases: Sequence[Judged]) -> Figure:
    """Median of the recovered gain over rightly told visible effects, bounds from the order statistics."""
    gains = sorted(g for case in cases if first_right(case) and (g := gain_recovered(case)) is not None)
    name, must, aim = "held-out gain recovered (median)", (0.9, 1.1), (0.99, 1.1)
    if not gains:
        return Figure(name, None, 0.0, 1.0, 0, must, aim)
    spread = 0.5 * Z95 * sqrt(len(gains))
    low, high = max(int(0.5 * len(gains) - spread), 0), min(int(0.5 * len(gains) + spread), len(gains) - 1)
    return Figure(name, median(gains), gains[low], gains[high], len(gains), must, aim)


def _ambiguous(cases: Sequence[Judged]) -> list[bool]:
    """For each ambiguous finding in a log with published causes: is one of them in its class?"""
    return [
        any(tells(found, cause) for cause in case.causes)
        for case in cases
        for found in case.findings
        if found["status"] == "ambiguous"
    ]


def figures(cases: Sequence[Judged], readings: Readings) -> list[Figure]:
    """Every row of the published table."""
    singles = _seen(_of(cases, "single"))
    known = [case for case in singles if not case.causes[0]["foreign"]]
    foreign = [case for case in singles if case.causes[0]["foreign"]]
    pairs, outside = _seen(_of(cases, "pair")), _seen(_of(cases, "outside"))
    hidden = _of(cases, "single", "pair")
    at_least = [(0.95, 1.0), (0.99, 1.0), (0.85, 1.0), (0.97, 1.0), (0.995, 1.0), (0.8, 1.0), (0.98, 1.0)]
    p95, p99, p85, p97, p995, p80, p98 = at_least
    return [
        _share("false findings on clean logs", map(false_alarm, _of(cases, "clean")), (0.0, 0.01), (0.0, 0.001)),
        _share("first name right, known forms", map(first_right, known), p95, p99),
        _share("first name right, foreign forms", map(first_right, foreign), p85, p97),
        _share("named but wrong", map(named_wrong, hidden), (0.0, 0.02), (0.0, 0.002)),
        _share("truth in the class when ambiguous", _ambiguous(hidden), p95, p995),
        _share("outside the library: unknown", (case.verdict == "unknown" for case in outside), p80, p98),
        _share("two effects, both found", map(all_found, pairs), p85, p97),
        _gain(singles),
        _share("interval coverage at 95 %", (hit for case in cases for hit in covered(case, readings)), (0.85, 0.99),
               (0.93, 0.97)),
    ]  # fmt: skip


def all_found(case: Judged) -> bool:
    """Whether every hidden cause is told by some finding."""
    return all(any(tells(found, cause) for found in case.findings) for cause in case.causes)


def further(cases: Sequence[Judged]) -> list[Figure]:
    """What the published table does not ask, and one wants to know."""
    outside, mixed, late = _seen(_of(cases, "outside")), _of(cases, "mixed"), _of(cases, "held-out")
    data = _of(cases, "data", "corrupted")
    seen = [case for case in mixed if visible(case.causes[0])]
    sizes = [len(found.get("class", ())) for case in cases for found in case.findings]
    return [
        _share("clean logs: any finding", (bool(case.findings) for case in _of(cases, "clean"))),
        _share("clean logs: unknown", (case.verdict == "unknown" for case in _of(cases, "clean"))),
        _share("outside: unknown, or only near causes named", map(_modest, outside)),
        _share("outside: named with confidence", map(named_wrong, outside)),
        _share("known and outside together: the known one found", (_found(case, 0) for case in seen)),
        _share("known and outside together: leftover seen", (_structured(case) for case in seen)),
        _share("data faults told", map(_fault_told, data)),
        _share("data faults: physics named wrongly", map(named_wrong, data)),
        _share("effects only in the held-out part: named", (bool(case.findings) for case in late)),
        _share("classes of one", (size <= 1 for size in sizes)),
    ]


def on_drives(cases: Sequence[Judged]) -> list[Figure]:
    """The published rows of logs from a drive's sensors; to refuse a clean one is neither right nor wrong."""
    clean = [case for case in _of(cases, "drive-clean") if case.verdict != "refused"]
    singles = _seen(_of(cases, "drive-single"))
    unknown = (case.verdict == "unknown" for case in clean)
    return [
        _share("drive-like, clean: unknown", unknown, (0.0, 0.1), (0.0, 0.02)),
        _share("drive-like, clean: any name", (bool(case.findings) for case in clean), (0.0, 0.01), (0.0, 0.001)),
        _share("drive-like, one cause: right or in the class", map(first_right, singles), (0.85, 1.0), (0.95, 1.0)),
    ]


def further_on_drives(drive: Sequence[Judged], cases: Sequence[Judged], readings: Readings) -> list[Figure]:
    """What else is counted of a drive's logs, and of all cases how many findings are unconfirmed."""
    marks = [found["status"] == "unconfirmed" for case in cases for found in case.findings]
    hidden = _of(drive, "drive-single", "drive-pair")
    pairs, outside = _seen(_of(drive, "drive-pair")), _seen(_of(drive, "drive-outside"))
    singles = _seen(_of(drive, "drive-single"))
    clean = _of(drive, "drive-clean")
    return [
        _share(f"findings that are unconfirmed, named all the same ({sum(marks)})", marks),
        _share("drive-like, clean: data", (case.verdict == "data" for case in clean)),
        _share("drive-like: refused", (case.verdict == "refused" for case in drive)),
        _share("drive-like, one cause: named but wrong", map(named_wrong, _of(drive, "drive-single"))),
        *[
            _share(f"drive-like, one cause, {kind} forms: right", map(first_right, some))
            for kind, some in (
                ("known", [case for case in singles if not case.causes[0]["foreign"]]),
                ("foreign", [case for case in singles if case.causes[0]["foreign"]]),
            )
        ],
        _share("drive-like: truth in the class when ambiguous", _ambiguous(hidden)),
        _share("drive-like: interval coverage at 95 %", (hit for case in drive for hit in covered(case, readings))),
        _share("drive-like, two effects, both found", map(all_found, pairs)),
        _share("drive-like, outside: unknown", (case.verdict == "unknown" for case in outside)),
        _share("drive-like, outside: named with confidence", map(named_wrong, outside)),
    ]


def _modest(case: Judged) -> bool:
    named = filter(confident, case.findings)
    return all(any(near(found, cause) for cause in case.causes) for found in named) and bool(
        case.verdict == "unknown" or case.findings
    )


def _found(case: Judged, row: int) -> bool:
    return any(tells(found, case.causes[row]) for found in case.findings)


def _structured(case: Judged) -> bool:
    return any(state["state"] == "structured" for state in case.diagnosis["residual"].values())


def _fault_told(case: Judged) -> bool:
    planted = case.truth["data"]["cause"]
    told = {name for found in case.diagnosis["findings"] for name in names_of(found)}
    return planted in told | {SAME_FAULT.get(name, name) for name in told}


def score(pairs: Iterable[tuple[Json, Json]], readings: Readings = READINGS) -> list[Figure]:
    """(truth, diagnosis) pairs → the published figures, then the further ones."""
    cases = [judge(truth, diagnosis) for truth, diagnosis in pairs]
    old, drive = ([case for case in cases if (case.stratum in DRIVE_STRATA) is yes] for yes in (False, True))
    return figures(old, readings) + on_drives(drive) + further(old) + further_on_drives(drive, cases, readings)


def _percent(value: float) -> str:
    return f"{100.0 * value:.1f} %"


def _range(bounds: tuple[float, float] | None) -> str:
    if bounds is None:
        return ""
    low, high = (100.0 * bound for bound in bounds)
    if low == 0.0:
        return f"≤ {high:g} %"
    return f"≥ {low:g} %" if high >= 100.0 else f"{low:g}–{high:g} %"


def text(rows: Sequence[Figure]) -> str:
    """The figures as a Markdown table."""
    lines = ["| figure | value | 95 % bounds | cases | must | aim | reached |", "|---|---|---|---|---|---|---|"]
    for row in rows:
        value = "–" if row.value is None else _percent(row.value)
        bounds = "–" if row.value is None else f"{_percent(row.low)} … {_percent(row.high)}"
        lines.append(
            f"| {row.name} | {value} | {bounds} | {row.count} | {_range(row.must)} | {_range(row.aim)} | {row.grade} |"
        )
    return "\n".join(lines) + "\n"
