"""A named scalar with bounds and a unit."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isnan, pi

from gimbal_pin.errors import NORMAL_95, digits, format_estimate


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
    def is_known(self) -> bool:
        """Whether it differs from zero by two deviations, a phase from the whole circle; True without a deviation.

        Two deviations leave zero outside in 95 % of the cases.
        """
        if isnan(self.std):
            return True
        return 2 * self.std < (pi if self.is_cyclic else abs(self.value))

    @property
    def is_cyclic(self) -> bool:
        """Whether it is an angle of a whole circle, where zero is a value like any other."""
        return (self.lower, self.upper) == (-pi, pi)

    def describe(self) -> str:
        """State the value with its 95 % interval, or a bound where it is not known."""
        if isnan(self.std):
            return f"{self.name} {digits(self.value)}{self.in_units}"
        if self.is_known:
            return f"{self.name} {format_estimate(self.value, self.std)}{self.in_units}"
        if self.is_cyclic:
            return f"{self.name} not known"
        most = digits(abs(self.value) + NORMAL_95 * self.std, 2)
        return f"{self.name} {'below' if self.lower >= 0 else 'not known, within ±'} {most}{self.in_units}"

    @property
    def in_units(self) -> str:
        """`` N m`` behind a figure; nothing behind one that has no unit."""
        return "" if self.unit == "1" else f" {self.unit}"
