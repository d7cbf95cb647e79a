"""Two engines on the same logs: each figure's counts, the logs on which they differ, and a sign test on these.

A figure is a property of one log's answer. Of two engines only the discordant logs tell anything; under the hypothesis
that neither is better each of them is won with probability 1/2 (McNemar's exact test).
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
    """A property of answers that is counted.

    Attributes:
        name: What it says of a log.
        scope: Whether a log counts.
        holds: Whether an answer has the property.
    """

    name: str
    scope: Scope
    holds: Property


@dataclass(frozen=True)
class Pair:
    """One figure of two engines.

    Attributes:
        name: What the figure says of a log.
        logs: Number of logs.
        first: Logs on which it holds for the first engine.
        second: The same for the second.
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


def _of(stratum: str) -> Scope:
    """Return the logs of a stratum whose effects are all visible."""
    return lambda case: case.stratum == stratum and all(map(visible, case.causes))


def _is_single(is_foreign: bool) -> Scope:
    """Return the logs with one visible effect in a known or in a foreign form."""
    seen = _of("single")
    return lambda case: seen(case) and case.causes[0]["foreign"] is is_foreign


def is_silent(case: Judged) -> bool:
    """Return whether nothing is found and the verdict is no other than *nothing*, or *data* for a true fault."""
    excused = case.verdict == "data" and bool(case.truth["faults"])
    return not case.findings and (case.verdict == "nothing" or excused)


def is_first_strictly_right(case: Judged) -> bool:
    """Return whether the strongest finding's own name is the hidden cause."""
    return first_right(case) and case.findings[0]["cause"] == case.causes[0]["cause"]


def is_class_right(case: Judged) -> bool:
    """Return whether every ambiguous finding has a hidden cause in its class."""
    unsure = [one for one in case.findings if one["status"] == "ambiguous"]
    return all(any(tells(one, cause) for cause in case.causes) for one in unsure)


FIGURES = (
    Figure("clean: silent", lambda case: case.stratum == "clean", is_silent),
    Figure("drive-like, clean: silent", lambda case: case.stratum == "drive-clean", is_silent),
    Figure("known form: right or in the class", _is_single(False), first_right),
    Figure("known form: first name right", _is_single(False), is_first_strictly_right),
    Figure("foreign form: right or in the class", _is_single(True), first_right),
    Figure("two effects: both found", _of("pair"), all_found),
    Figure("outside the library: unknown", _of("outside"), lambda case: case.verdict == "unknown"),
    Figure("drive-like, one cause: right or in the class", _of("drive-single"), first_right),
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
"""What is compared. Of an effect that is less than three noise floors only wrong names count."""


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
    """Return the figures as a Markdown table."""
    frame = pd.DataFrame(
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
    )
    return _to_markdown(frame)


def _to_markdown(frame: pd.DataFrame) -> str:
    """Return a table in Markdown."""
    lines = [frame.columns.tolist(), ["---"] * frame.shape[1], *frame.astype(str).values.tolist()]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
