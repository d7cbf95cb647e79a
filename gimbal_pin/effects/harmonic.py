"""What the causes share that repeat with the angle: harmonics as cosine and sine, read as amplitude and phase."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, hypot, inf, nan, pi
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import cos, propagate_deviation, sin
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array

PHASE = Parameter(
    "phase", 0.0, "rad", -2 * pi, 2 * pi, meaning="phase of the cosine at the joint's zero"
)


@dataclass(frozen=True)
class Harmonic(Effect):
    """``tau = carrier sum_k (a_k cos kq + b_k sin kq) = carrier sum_k A_k cos(kq + phase_k)``.

    Attributes:
        joint: The joint it acts on.
        harmonic: Every k, per turn of the joint.
    """

    harmonic: tuple[float, ...]

    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "harmonic",
            nan,
            "per turn",
            1.0,
            1000.0,
            meaning="how often per turn of the joint it repeats",
        ),
    )
    amplitude: ClassVar[Parameter]
    """Name and unit of A_k."""

    highest: ClassVar[int] = 100
    """Highest harmonic that is looked for, per turn."""
    dense: ClassVar[int] = 200
    """Harmonic above which only multiples of `every` are tried."""
    every: ClassVar[int] = 2
    """A number of poles is even."""
    bends: ClassVar[tuple[str, ...]] = ()
    """Causes that bend with the angle as a part of a turn of a harmonic does."""
    leans: ClassVar[tuple[str, ...]] = ()
    """Causes that a vertical axis feels once per turn, or as a bend over a part of it."""

    @abstractmethod
    def carrier(self, at: Sample) -> float | Array:
        """Return what the harmonics multiply."""

    @property
    def coefficients(self) -> tuple[Parameter, ...]:
        """``cos_k, sin_k`` for every harmonic."""
        unit = self.amplitude.unit
        return tuple(
            Parameter(f"{part}_{k:g}", 0.0, unit, -inf, inf)
            for k in self.harmonic
            for part in ("cos", "sin")
        )

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """``carrier cos kq, carrier sin kq`` for every harmonic."""
        carrier = self.carrier(at)
        return tuple(carrier * part(k * at.q) for k in self.harmonic for part in (cos, sin))

    @property
    def pieces(self) -> tuple[float, ...]:
        """Its harmonics."""
        return self.harmonic

    def joined(self, other: Cause) -> Harmonic:
        """Return the harmonics of both."""
        return type(self)(self.joint, tuple(sorted({*self.harmonic, *other.pieces})))

    def polar(self, values: Sequence[float]) -> tuple[tuple[float, float], ...]:
        """Amplitude and phase, rad, of every harmonic."""
        return tuple((hypot(a, b), atan2(-b, a)) for a, b in zip(values[::2], values[1::2]))

    def shown(
        self, values: Sequence[float] = (), covariance: Array | None = None
    ) -> tuple[Parameter, ...]:
        """Amplitude, harmonic and phase, the strongest first; those of the second are ``amplitude_2`` and so on."""
        polar = self.polar(values)
        out: list[Parameter] = []
        for rank, i in enumerate(sorted(range(len(polar)), key=lambda i: -polar[i][0])):
            size, phase = polar[i]
            pair = slice(2 * i, 2 * i + 2)
            std = np.array([nan, nan])
            if covariance is not None and size > 0:
                std = propagate_deviation(
                    lambda x: self.polar(x)[0], values[pair], covariance[pair, pair]
                )
            end = f"_{rank + 1}" if rank else ""
            out += [
                replace(
                    self.amplitude,
                    name=f"{self.amplitude.name}{end}",
                    value=size,
                    std=float(std[0]),
                ),
                Parameter(f"harmonic{end}", self.harmonic[i], "per turn", *self.limits()),
                Parameter(f"phase{end}", phase, "rad", -pi, pi, float(std[1])),
            ]
        return tuple(out)

    def blurred(self, seen: OperatingRange) -> tuple[str, ...]:
        """Less than one turn of the lowest harmonic is a bend; so are two of several that the travel does not part."""
        lowest = min(self.harmonic)
        least = min(np.diff(sorted(self.harmonic)), default=inf)
        crowded = len(self.harmonic) > 2 and least * seen.travel < 0.7 * 2 * pi
        bent = lowest * seen.travel < 2 * pi * (1 + crowded)
        leaning = seen.upright and (max(self.harmonic) == 1.0 or (bent and lowest == 1.0))
        return (*(self.bends if bent else ()), *(self.leans if leaning else ()))

    @classmethod
    def limits(cls) -> tuple[float, float]:
        """Bounds of a harmonic, per turn."""
        return cls.shapes[0].lower, cls.shapes[0].upper

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """Amplitude, harmonic, phase."""
        return (cls.amplitude, *cls.shapes, PHASE)

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return the term with one harmonic."""
        size = given[cls.amplitude.name]
        phase = given["phase"]
        a = size * float(cos(phase))
        b = -size * float(sin(phase))
        return Term(cls(str(joint), (given["harmonic"],)), (a, b))

    def listed(self, values: Sequence[float]) -> str:
        """``0.055 N m at 42 per turn``, the strongest three."""
        unit = self.amplitude.unit
        rows = sorted(
            ((size, k) for (size, _), k in zip(self.polar(values), self.harmonic)), reverse=True
        )
        text = " and ".join(
            f"{size:.3g}{' ' + unit if unit != '1' else ''} at {k:g}" for size, k in rows[:3]
        )
        rest = f" and {len(rows) - 3} more" if len(rows) > 3 else ""
        return f"{text}{rest} per turn"

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Every harmonic that the travel resolves and that the band holds at a slow rate, one at a time."""
        if seen.travel <= 0:
            return ()
        last = min(cls.highest, 2 * pi * seen.band / max(0.12 * seen.rate, 1e-6))
        step = max(1, int(pi / (2 * seen.travel)))
        tried = range(1, int(last) + 1, step)
        return tuple(
            cls.inside(joint, (float(k),))
            for k in tried
            if k <= cls.dense or step > 1 or k % cls.every == 0
        )
