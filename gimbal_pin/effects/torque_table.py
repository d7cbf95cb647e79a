"""A torque that no cause explains, as a table: what is known of it where the log went, and nothing elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite
from typing import ClassVar, Literal, get_args

import numpy as np

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.functions import larger, size
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array

Over = Literal["angle", "rate", "load"]


@dataclass(frozen=True)
class TorqueTable(Effect):
    """``tau = Σ_k value_k max(1 - |x - knot_k|/step, 0)``: straight lines between knots, zero a step beyond the outer.

    `diagnose` fills it with what is left at a joint; no search looks for it.

    Attributes:
        joint: The joint it acts on.
        over: x: the joint's angle, rad, its rate, rad/s, or the torque that the rest of the model asks for, N m.
        knots: Values of x, evenly spaced, two at least.
        cyclic: Whether the angle counts within a turn, over which the knots are spread.
    """

    over: str
    knots: tuple[float, ...]
    cyclic: bool = False

    name: ClassVar[str] = "torque-table"
    experiment: ClassVar[str] = "slow sweeps both ways over where it acts"

    def __post_init__(self) -> None:
        """Raise `UsageError` for knots that are no grid, or over nothing that it knows."""
        steps = np.diff(self.knots)
        place = f"{self.name} at {self.joint}"
        if self.over not in get_args(Over):
            raise UsageError(
                f"{place}: over", f"is '{self.over}'", f"give {', '.join(get_args(Over))}"
            )
        if len(steps) == 0 or not np.allclose(steps, steps[0], rtol=1e-6) or steps[0] <= 0:
            raise UsageError(f"{place}: knots", "are no rising even grid", "give two or more")

    @property
    def loaded(self) -> bool:  # type: ignore[override]
        """Whether it reads the torque."""
        return self.over == "load"

    @property
    def coefficients(self) -> tuple[Parameter, ...]:
        """The torque at each knot."""
        return tuple(
            Parameter(f"{self.over}_{knot:.4g}", 0.0, "N m", -inf, inf) for knot in self.knots
        )

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """One at a knot, nothing from the next on."""
        x = {"angle": at.q, "rate": at.v, "load": at.tau}[self.over]
        step = self.knots[1] - self.knots[0]
        if isinstance(x, float) and isfinite(
            x
        ):  # the simulation asks for one at every stage: all but two are zero
            place = (x - self.knots[0]) / step
            count = len(self.knots)
            low = floor(place)
            share = place % 1.0
            ends = {
                low % count if self.cyclic else low: 1 - share,
                (low + 1) % count if self.cyclic else low + 1: share,
            }
            return tuple(ends.get(k, 0.0) for k in range(count))
        if self.cyclic:
            return tuple(
                larger(1.0 - np.arccos(np.cos(x - knot)) / step, 0.0) for knot in self.knots
            )
        return tuple(larger(1.0 - size(x - knot) / step, 0.0) for knot in self.knots)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its largest torque."""
        return f"up to {max(map(abs, values), default=0.0):.3g} N m that no cause explains, by its {self.over}"
