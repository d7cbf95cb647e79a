"""What a torque effect is: torque per coefficient at one joint, one formula for fit and simulation alike."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan, sqrt
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array
from gimbal_pin.rig.brief import brief

EffectMemory = Any
"""What an effect remembers at one sample: a number or a list of them; at many samples, (N,) or (k, N)."""

AMBIENT = 25.0
"""Motor temperature where none is known, °C."""


class Sample(NamedTuple):
    """The state of one joint: floats in simulation, arrays (N,) of consecutive samples in identification.

    Attributes:
        t: Time, s.
        q: Angle, rad.
        v: Rate, rad/s.
        a: Acceleration, rad/s².
        slide: Direction of sliding in [-1, 1]: sign(v) while it slides, and while it sticks the share of the dry
            friction that the torque balance takes. Effects use it in place of sign(v), never a smooth sign.
        tau: The model's total torque at the joint, N m; never the measured one, whose noise would leak into columns.
        temperature: Motor temperature, °C.
        memory: What the effect remembers of the way so far, see `Effect.evolve`; None where nobody keeps it.
        weight: What of `tau` the rig asks for at rest, N m: gravity, and what a base that moves adds to it.
        losses: What the motor turned into heat since the log began, a `Losses`; None where nobody knows.
    """

    t: float | Array
    q: float | Array
    v: float | Array
    a: float | Array
    slide: float | Array
    tau: float | Array
    temperature: float | Array = AMBIENT
    memory: EffectMemory | None = None
    weight: float | Array = 0.0
    losses: Any = None

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)


@dataclass(frozen=True)
class Effect(Cause):
    """A torque at one joint that is linear in its coefficients: ``tau_joint = rnea + sum_k coefficient_k basis_k``.

    A subclass states its `basis` and what the class variables below ask.

    Attributes:
        joint: The joint it acts on.
    """

    joint: str

    linear: ClassVar[tuple[Parameter, ...]] = ()
    """Names, units and bounds of its coefficients; a subclass whose number of them varies overrides `coefficients`."""
    dry: ClassVar[bool] = False
    """True if its basis holds `slide`: its torque then takes part in sticking."""
    bristly: ClassVar[bool] = False
    """True if its first basis is dry friction that builds up: slid to the end it is `slide`."""
    affine: ClassVar[bool] = False
    """True if its basis is ``c0 + c1 slide + c2 v`` and reads nothing else: the simulation evaluates it but once."""
    loaded: ClassVar[bool] = False
    """True if its basis reads `tau`: the model's total torque then depends on itself, and is iterated."""
    weighed: ClassVar[bool] = False
    """True if its basis may read `weight`, which is worked out where an effect does."""
    rising: ClassVar[bool] = False
    """True if it is friction that grows faster than the rate, beside viscous friction."""
    compensation: ClassVar[str] = (
        "its torque at the reference is added to the controller's feed-forward"
    )

    @property
    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficients, in the order of `basis`."""
        return self.linear

    @property
    def coupling(self) -> Mapping[str, float]:
        """Joint → turns of the motor per turn of it, where it acts at a motor that turns with several; empty: not."""
        return {}

    @abstractmethod
    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Return the torque per unit of each coefficient, N m per its unit; floats for floats, (N,) for arrays."""

    def start(self) -> EffectMemory | None:
        """Return the memory at rest; None for an effect without memory."""
        return None

    def evolve(self, memory: EffectMemory, moved: float | Array) -> EffectMemory:
        """Return the memory after the joint has moved by `moved` rad in one direction."""
        return memory

    def warmed(self, memory: EffectMemory, tau: float, dt: float) -> EffectMemory:
        """Return the memory after the motor has given `tau` N m for `dt` s."""
        return memory

    def remembered(self, at: Sample) -> EffectMemory:
        """Return the memory at a sample, on arrays by a scan of `evolve`.

        A lone sample whose memory nobody keeps counts as slid to the end: that is what a controller compensates.
        """
        if at.memory is not None:
            return at.memory
        if not isinstance(at.q, np.ndarray):
            return at.slide
        return self.scan(at.q)

    def scan(self, q: Array) -> Array:
        """Memory at each of the consecutive angles q, rad, (N,) or (k, N), from rest.

        From turn to turn the joint moves in one direction: all samples between two are the one's memory, evolved.
        """
        up = np.diff(q, prepend=q[:1]) >= 0
        turns = np.flatnonzero(up[1:] != up[:-1])
        since = np.searchsorted(turns, np.arange(len(q)))
        at = q[np.concatenate([[0], turns])]
        memory = self.start() or 0.0
        held = [memory]
        for moved in np.diff(at).tolist():
            memory = self.evolve(memory, moved)
            held.append(memory)
        return np.asarray(self.evolve(np.array(held).T[..., since], q - at[since]))

    def shown(
        self, values: Sequence[float] = (), covariance: Array | None = None
    ) -> tuple[Parameter, ...]:
        """Shape parameters, then coefficients with their standard deviations."""
        deviations = (
            [nan] * len(values) if covariance is None else [sqrt(x) for x in np.diag(covariance)]
        )
        rows = zip(self.coefficients, values, deviations)
        return super().shown() + tuple(replace(c, value=float(x), std=std) for c, x, std in rows)

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """Shape parameters, then coefficients."""
        return cls.shapes + cls.linear

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return the term with these parameters."""
        effect = super().planted(joint, given)
        return Term(effect, tuple(given[coefficient.name] for coefficient in effect.coefficients))


@dataclass(frozen=True)
class Term:
    """An effect with the values of its coefficients.

    Attributes:
        effect: The formula.
        values: One per coefficient, in SI units.
    """

    effect: Effect
    values: tuple[float, ...]

    def torque(self, at: Sample) -> float | Array:
        """``sum_k value_k basis_k``, N m."""
        every = self.effect.basis(at)
        # Most terms have one coefficient, a harmonic two, and the simulation asks for each at every stage.
        if len(every) == 1:
            return self.values[0] * every[0]
        if len(every) == 2:
            return self.values[0] * every[0] + self.values[1] * every[1]
        total: float | Array = 0.0
        for value, basis in zip(self.values, every):
            total = total + value * basis
        return total

    def sentence(self) -> str:
        """Return the effect's sentence with these values."""
        return self.effect.sentence(self.values)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data: the effect's name and fields, and `values`; `plain.read_term` reads it back."""
        return {**self.effect.to_dict(), "values": list(self.values)}
