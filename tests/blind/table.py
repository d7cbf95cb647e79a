"""The blind set's table: judged cases → every figure with Wilson bounds, and what it must and should be."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from statistics import median

from .judge import (
    all_found,
    covered,
    false_alarm,
    fault_told,
    first_right,
    gain_recovered,
    named_wrong,
    tells,
    visible,
)

Z95 = 1.959964
Range = tuple[float, float]


@dataclass(frozen=True)
class Figure:
    """One row: a share of `count` cases with its 95 % bounds, and what it must and should be.

    `must` and `aim` are (lowest, highest); a figure without them is for information."""

    name: str
    value: float | None
    low: float
    high: float
    count: int
    must: Range | None = None
    aim: Range | None = None

    @property
    def grade(self):
        """ "PASS", with "aim" where that is reached too, "FAIL", or "-" where there is nothing to grade."""
        if self.value is None or self.must is None:
            return "-"
        if self.aim is not None and self.aim[0] <= self.value <= self.aim[1]:
            return "PASS, aim"
        return "PASS" if self.must[0] <= self.value <= self.must[1] else "FAIL"


def wilson(hits, count):
    """The 95 % score interval of a share, hits / count; (0, 1) where nothing was counted."""
    if count == 0:
        return 0.0, 1.0
    p = hits / count
    z2 = Z95 * Z95
    centre = (p + z2 / (2.0 * count)) / (1.0 + z2 / count)
    half = Z95 / (1.0 + z2 / count) * sqrt(p * (1.0 - p) / count + z2 / (4.0 * count * count))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def count_share(name, hits, count, must=None, aim=None):
    """The figure of a share with its bounds."""
    return Figure(name, hits / count if count else None, *wilson(hits, count), count, must, aim)


def _share(name, scores, *ranges):
    listed = [float(score) for score in scores]
    return count_share(name, sum(listed), len(listed), *ranges)


def _gain(cases):
    """Median of the recovered gain over rightly told visible effects, bounds from the order statistics."""
    gains = sorted(
        g for case in cases if first_right(case) and (g := gain_recovered(case)) is not None
    )
    name = "held-out gain recovered (median)"
    must = (0.9, 1.1)
    aim = (0.99, 1.1)
    if not gains:
        return Figure(name, None, 0.0, 1.0, 0, must, aim)
    spread = 0.5 * Z95 * sqrt(len(gains))
    low = max(int(0.5 * len(gains) - spread), 0)
    high = min(int(0.5 * len(gains) + spread), len(gains) - 1)
    return Figure(name, median(gains), gains[low], gains[high], len(gains), must, aim)


def _ambiguous(cases):
    """For each ambiguous finding in a log with published causes: is one of them in its class?"""
    return [
        any(tells(found, cause) for cause in case.causes)
        for case in cases
        for found in case.findings
        if found["status"] == "ambiguous"
    ]


def score(cases):
    """Every row of the published table, then what else one wants to know; effects count where they are visible."""

    def of(stratum, *, seen=False):
        chosen = [case for case in cases if case.stratum == stratum]
        return [case for case in chosen if all(map(visible, case.causes))] if seen else chosen

    clean = of("clean")
    singles = of("single", seen=True)
    hidden = of("single") + of("pair")
    known, foreign = (
        [c for c in singles if c.causes[0]["foreign"] is kind] for kind in (False, True)
    )
    drive_clean = [case for case in of("drive-clean") if case.verdict != "refused"]
    drive_single = of("drive-single", seen=True)
    old = [case for case in cases if case.stratum != "drive-single"]
    return [
        _share("false findings on clean logs", map(false_alarm, clean), (0.0, 0.01), (0.0, 0.001)),
        _share("first name right, known forms", map(first_right, known), (0.95, 1.0), (0.99, 1.0)),
        _share("first name right, foreign forms", map(first_right, foreign), (0.85, 1.0), (0.97, 1.0)),
        _share("named but wrong", map(named_wrong, hidden), (0.0, 0.02), (0.0, 0.002)),
        _share("truth in the class when ambiguous", _ambiguous(hidden), (0.95, 1.0), (0.995, 1.0)),
        _share("outside the library: unknown", (c.verdict == "unknown" for c in of("outside", seen=True)), (0.8, 1.0),
               (0.98, 1.0)),
        _share("two effects, both found", map(all_found, of("pair", seen=True)), (0.85, 1.0), (0.97, 1.0)),
        _gain(singles),
        _share("interval coverage at 95 %", (hit for c in old for hit in covered(c)), (0.85, 0.99), (0.93, 0.97)),
        _share("drive-like, clean: unknown", (c.verdict == "unknown" for c in drive_clean), (0.0, 0.1), (0.0, 0.02)),
        _share("drive-like, clean: any name", (bool(c.findings) for c in drive_clean), (0.0, 0.01), (0.0, 0.001)),
        _share("drive-like, one cause: right or in the class", map(first_right, drive_single), (0.85, 1.0),
               (0.95, 1.0)),
        _share("torque late, joints exchanged: data", (c.verdict == "data" for c in of("mismatched")), (1.0, 1.0),
               (1.0, 1.0)),
        _share("errors of ours", (c.verdict == "error" for c in cases), (0.0, 0.0), (0.0, 0.0)),
        _share("clean logs: any name", (bool(case.findings) for case in clean)),
        _share("outside the library: something named", map(named_wrong, of("outside", seen=True))),
        _share("drive-like, one cause: named but wrong", map(named_wrong, of("drive-single"))),
        _share("data faults told", map(fault_told, of("mismatched"))),
        _share("data faults: physics named", map(named_wrong, of("mismatched"))),
        _share("refused", (case.verdict == "refused" for case in cases)),
    ]  # fmt: skip


def _percent(value):
    return f"{100.0 * value:.1f} %"


def _range(bounds):
    if bounds is None:
        return ""
    low, high = (100.0 * bound for bound in bounds)
    if low == 0.0:
        return f"≤ {high:g} %"
    return f"≥ {low:g} %" if high >= 100.0 else f"{low:g}–{high:g} %"


def text(rows):
    """The figures as a Markdown table."""
    lines = ["| figure | value | 95 % bounds | cases | must | aim | |", "|---" * 7 + "|"]
    for row in rows:
        value = "–" if row.value is None else _percent(row.value)
        bounds = "–" if row.value is None else f"{_percent(row.low)} … {_percent(row.high)}"
        lines.append(
            f"| {row.name} | {value} | {bounds} | {row.count} | {_range(row.must)} | {_range(row.aim)} | {row.grade} |"
        )
    return "\n".join(lines) + "\n"
