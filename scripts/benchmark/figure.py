"""A measured figure and its requirement, and how they are printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Figure:
    """One line of the table.

    Attributes:
        what: What was measured.
        value: The measured value; None: what it needs is not installed.
        unit: Its unit.
        at_most: Requirement, or None.
        at_least: Requirement, or None.
    """

    what: str
    value: float | None
    unit: str = ""
    at_most: float | None = None
    at_least: float | None = None

    @property
    def required(self) -> bool:
        """Whether there is a requirement."""
        return self.at_most is not None or self.at_least is not None

    @property
    def passed(self) -> bool | None:
        """Whether the requirement is met; None if there is none or it was not measured."""
        if self.value is None or not self.required:
            return None
        above = self.at_least is None or self.value >= self.at_least
        return above and (self.at_most is None or self.value <= self.at_most)

    def to_dict(self) -> dict[str, object]:
        """Return it as plain data."""
        return {**asdict(self), "passed": self.passed}


def line(figure: Figure) -> str:
    """Return the figure as a line of the table."""
    value = "not installed" if figure.value is None else f"{figure.value:.4g}"
    limit = ""
    if figure.at_most is not None:
        limit = f"<= {figure.at_most:g}"
    elif figure.at_least is not None:
        limit = f">= {figure.at_least:g}"
    verdict = {True: "PASS", False: "FAIL", None: ""}[figure.passed]
    return f"{figure.what:70} {value:>13} {figure.unit:10}{limit:>9}  {verdict}".rstrip()


def summary(figures: Sequence[Figure]) -> str:
    """Return the last line: how many requirements are met, and which are not."""
    demands = [figure for figure in figures if figure.required]
    met = sum(figure.passed is True for figure in demands)
    missed = "; ".join(figure.what for figure in demands if figure.passed is False)
    unknown = sum(figure.passed is None for figure in demands)
    verdict = "FAIL" if missed else "INCOMPLETE" if unknown else "PASS"
    text = f"{verdict}: {met} of {len(demands)} requirements met"
    text += f", {unknown} not measured" if unknown else ""
    return f"{text}; missed: {missed}" if missed else text
