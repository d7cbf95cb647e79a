"""A named scalar with bounds and a unit."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class Parameter:
    """``lower <= value <= upper``, in ``unit``.

    Attributes:
        name: Short name, unique within its owner.
        value: Value in SI units.
        unit: SI unit as printed.
        lower: Smallest admissible value.
        upper: Largest admissible value.
        std: Standard deviation; ``nan`` where it was not estimated.
        meaning: What it is, in a clause without its unit, for who states it; nothing where nobody does.
    """

    name: str
    value: float
    unit: str
    lower: float = -inf
    upper: float = inf
    std: float = float("nan")
    meaning: str = ""

    @property
    def in_units(self) -> str:
        """`` N m`` behind a figure; nothing behind one that has no unit."""
        return "" if self.unit == "1" else f" {self.unit}"
