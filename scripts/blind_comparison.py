"""Comparison of two engines on the same logs: counts per figure, discordant logs, and a sign test on these.

A figure is a property that the answer on one log has or lacks. A log is discordant if only one engine's answer has it.
If neither engine is better, each wins a discordant log with probability 1/2 (McNemar's exact test).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import pandas as pd
from scipy.stats import binomtest

from tests.blind.judge import Judged, all_found, first_right, named_wrong, tells, visible

Scope = Callable[[Judged], bool]
Property = Callable[[Judged], bool]


@dataclass(frozen=True)
class Figure:
    """Property of answers that is counted.

    Attributes:
        name: Stratum and property, as the table prints them.
        scope: Returns whether a log counts.
        holds: Returns whether an answer has the property.
    """

    name: str
    scope: Scope
    holds: Property


@dataclass(frozen=True)
class Pair:
    """Counts of one figure for two engines.

    Attributes:
        name: What the figure says of a log.
        logs: Number of logs.
        first: Number of logs on which it holds for the first engine.
        second: Number of logs on which it holds for the second engine.
        won: Names of the logs on which it holds for the second alone.
        lost: Names of those on which it holds for the first alone.
    """

    name: str
    logs: int
    first: int
    second: int
    won: tuple[str, ...]
    lost: tuple[str, ...]

    @property
    def p_value(self) -> float:
        """Two-sided p-value of the sign test; 1 without discordant logs."""
        discordant = len(self.won) + len(self.lost)
        return float(binomtest(len(self.won), discordant).pvalue) if discordant else 1.0


def _select_visible(stratum: str) -> Scope:
    """Return the condition that a log is of a stratum and all its effects are visible."""
    return lambda case: case.stratum == stratum and all(map(visible, case.causes))


def _select_single(is_foreign: bool) -> Scope:
    """Return the condition that a log has one visible effect, in a known or in a foreign form."""
    is_visible_single = _select_visible("single")
    return lambda case: is_visible_single(case) and case.causes[0]["foreign"] is is_foreign


def is_silent(case: Judged) -> bool:
    """Return whether nothing is found and the verdict is no other than *nothing*, or *data* for a true fault."""
    excused = case.verdict == "data" and bool(case.truth["faults"])
    return not case.findings and (case.verdict == "nothing" or excused)


def is_first_strictly_right(case: Judged) -> bool:
    """Return whether the strongest finding's own name is the hidden cause."""
    return first_right(case) and case.findings[0]["cause"] == case.causes[0]["cause"]


def is_class_right(case: Judged) -> bool:
    """Return whether every ambiguous finding has a hidden cause in its class."""
    ambiguous = [finding for finding in case.findings if finding["status"] == "ambiguous"]
    return all(any(tells(finding, cause) for cause in case.causes) for finding in ambiguous)


FIGURES = (
    Figure("clean: silent", lambda case: case.stratum == "clean", is_silent),
    Figure("drive-like, clean: silent", lambda case: case.stratum == "drive-clean", is_silent),
    Figure("known form: right or in the class", _select_single(False), first_right),
    Figure("known form: first name right", _select_single(False), is_first_strictly_right),
    Figure("foreign form: right or in the class", _select_single(True), first_right),
    Figure("two effects: both found", _select_visible("pair"), all_found),
    Figure(
        "outside the library: unknown",
        _select_visible("outside"),
        lambda case: case.verdict == "unknown",
    ),
    Figure(
        "drive-like, one cause: right or in the class", _select_visible("drive-single"), first_right
    ),
    Figure(
        "every log: nothing named wrongly", lambda case: True, lambda case: not named_wrong(case)
    ),
    Figure("every log: truth in the class", lambda case: True, is_class_right),
    Figure(
        "mismatched: data",
        lambda case: case.stratum == "mismatched",
        lambda case: case.verdict == "data",
    ),
    Figure(
        "every log: answered",
        lambda case: True,
        lambda case: case.verdict not in ("refused", "error"),
    ),
)
"""Figures of the comparison. Logs with an effect below three noise floors count for wrong names and refusals alone."""


def compare(first: Mapping[str, Judged], second: Mapping[str, Judged]) -> list[Pair]:
    """Return every figure over the logs that both engines answered.

    Args:
        first: Log → judged answer of the first engine.
        second: The same of the second.
    """
    return [_compare_figure(figure, first, second) for figure in FIGURES]


def _compare_figure(
    figure: Figure, first: Mapping[str, Judged], second: Mapping[str, Judged]
) -> Pair:
    """Return one figure."""
    names = [name for name, case in first.items() if name in second and figure.scope(case)]
    old = {name for name in names if figure.holds(first[name])}
    new = {name for name in names if figure.holds(second[name])}
    return Pair(
        figure.name,
        len(names),
        len(old),
        len(new),
        tuple(sorted(new - old)),
        tuple(sorted(old - new)),
    )


def format_pairs(pairs: Iterable[Pair]) -> str:
    """Return the figures as a table of text, one line each."""
    rows = [
        {
            "figure": pair.name,
            "logs": pair.logs,
            "first": pair.first,
            "second": pair.second,
            "won": len(pair.won),
            "lost": len(pair.lost),
            "p": f"{pair.p_value:.2g}",
        }
        for pair in pairs
    ]
    return pd.DataFrame(rows).to_string(index=False)
