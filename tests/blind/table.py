"""The blind set's table: judged cases → every figure with Wilson bounds, and what it must be."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from statistics import median

from .judge import (
    all_found,
    covered,
    false_alarm,
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
    """One row: a share of `count` cases with its 95 % bounds, and what it must be.

    `must` is (lowest, highest); a figure without it is for information."""

    name: str
    value: float | None
    bounds: Range
    count: int
    must: Range | None = None

    @property
    def grade(self):
        """ "PASS", "FAIL", or "-" where there is nothing to grade."""
        if self.value is None or self.must is None:
            return "-"
        return "PASS" if self.must[0] <= self.value <= self.must[1] else "FAIL"

    @property
    def cells(self):
        """The row as it is printed."""
        shown = ["–", "–"]
        if self.value is not None:
            value, low, high = (f"{100.0 * share:.1f} %" for share in (self.value, *self.bounds))
            shown = [value, f"{low} … {high}"]
        return [self.name, *shown, self.count, _range(self.must), self.grade]


def _range(bounds):
    """Return the range that a figure must lie in, as text."""
    if bounds is None:
        return ""
    low, high = (100.0 * bound for bound in bounds)
    if low == 0.0:
        return f"≤ {high:g} %"
    return f"≥ {low:g} %" if high >= 100.0 else f"{low:g}–{high:g} %"


def text(rows):
    """The figures as a Markdown table."""
    heads = ["figure", "value", "95 % bounds", "cases", "must", ""]
    lines = [heads, ["---"] * 6, *(row.cells for row in rows)]
    return "".join(f"| {' | '.join(map(str, cells))} |\n" for cells in lines)


def wilson(hits, count):
    """The 95 % score interval of a share, hits / count; (0, 1) where nothing was counted."""
    if count == 0:
        return 0.0, 1.0
    p = hits / count
    z2 = Z95 * Z95
    centre = (p + z2 / (2.0 * count)) / (1.0 + z2 / count)
    half = Z95 / (1.0 + z2 / count) * sqrt(p * (1.0 - p) / count + z2 / (4.0 * count * count))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def count_share(name, hits, count, must=None):
    """The figure of a share with its bounds."""
    return Figure(name, hits / count if count else None, wilson(hits, count), count, must)


def _share(name, scores, must=None):
    """The figure of some scores of 0 to 1."""
    listed = [float(score) for score in scores]
    return count_share(name, sum(listed), len(listed), must)


def _says(word, cases):
    """Yield whether the verdict on each case is a word."""
    return (case.verdict == word for case in cases)


def _median_gain(cases):
    """The gain recovered over rightly told visible effects, bounds from the order statistics."""
    found = filter(first_right, cases)
    gains = sorted(gain for case in found if (gain := gain_recovered(case)) is not None)
    middle = None
    bounds = (0.0, 1.0)
    if gains:
        middle = median(gains)
        half = 0.5 * len(gains)
        spread = 0.5 * Z95 * sqrt(len(gains))
        last = min(int(half + spread), len(gains) - 1)
        bounds = (gains[max(int(half - spread), 0)], gains[last])
    name = "held-out gain recovered (median)"
    return Figure(name, middle, bounds, len(gains), (0.9, 1.1))


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

    def of(stratum):
        return [case for case in cases if case.stratum == stratum]

    def seen(stratum):
        return [case for case in of(stratum) if all(map(visible, case.causes))]

    clean = of("clean")
    singles = seen("single")
    known = [case for case in singles if not case.causes[0]["foreign"]]
    foreign = [case for case in singles if case.causes[0]["foreign"]]
    hidden = of("single") + of("pair")
    outside = seen("outside")
    drive_clean = [case for case in of("drive-clean") if case.verdict != "refused"]
    drive_single = seen("drive-single")
    intervals = [hit for c in cases if c.stratum != "drive-single" for hit in covered(c)]
    return [
        _share("false findings on clean logs", map(false_alarm, clean), (0.0, 0.01)),
        _share("first name right, known forms", map(first_right, known), (0.95, 1.0)),
        _share("first name right, foreign forms", map(first_right, foreign), (0.85, 1.0)),
        _share("named but wrong", map(named_wrong, hidden), (0.0, 0.02)),
        _share("truth in the class when ambiguous", _ambiguous(hidden), (0.95, 1.0)),
        _share("outside the library: unknown", _says("unknown", outside), (0.8, 1.0)),
        _share("two effects, both found", map(all_found, seen("pair")), (0.85, 1.0)),
        _median_gain(singles),
        _share("interval coverage at 95 %", intervals, (0.85, 0.99)),
        _share("drive-like, clean: unknown", _says("unknown", drive_clean), (0.0, 0.1)),
        _share("drive-like, clean: any name", (bool(c.findings) for c in drive_clean), (0.0, 0.01)),
        _share("drive-like, one cause: right or in the class", map(first_right, drive_single), (0.85, 1.0)),
        _share("torque late, joints exchanged: data", _says("data", of("mismatched")), (1.0, 1.0)),
        _share("errors of ours", _says("error", cases), (0.0, 0.0)),
        _share("outside the library: something named", map(named_wrong, outside)),
        _share("drive-like, one cause: named but wrong", map(named_wrong, of("drive-single"))),
        _share("refused", _says("refused", cases)),
    ]  # fmt: skip
