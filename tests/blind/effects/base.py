"""What a hidden effect is: a frozen description that turns itself into laws of the plant: functions of its state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from math import inf
from typing import ClassVar

from ..mjcf import Base
from ..rigs import Rig


@dataclass(frozen=True)
class Context:
    """What is known of rig and motion before anything is hidden, and how large the effect shall be.

    `torque`: the joint's torque rms, N m; `share`: wanted effect rms over it; `inertia`: seen by the joint, kg m²;
    `speed`: reference speed rms, rad/s; `lean`: the side (±1) to which the torque leans; `span`: the reference's lowest
    and highest angle, rad."""

    rig: Rig
    joint: int
    share: float
    torque: float
    inertia: float
    speed: float
    lean: float
    span: tuple[float, float]
    seconds: float

    @property
    def target(self):
        """Wanted rms of the effect, N m."""
        return self.share * self.torque

    @property
    def width(self):
        """Half of the travelled span, rad."""
        return max(0.5 * (self.span[1] - self.span[0]), 1e-3)


@dataclass(frozen=True)
class Effect(ABC):
    """One cause in one functional form, on one joint (None: the whole rig).

    `known` forms have the formula that the published table of causes gives, `foreign` ones another; `kin` are published
    causes that come near one from outside. `stage` orders what sits between command and motor. `widest`: how many times
    stronger than its first guess it may become. `stiff` ones need fine steps even in a trial run, and those that ring
    are sized `in_band`, below visibility.CUTOFF_HZ. Where the base moves, `measured` says whether its IMU is logged.
    Its first own field is how strong it is, `within` these bounds; `told` are its true parameters, else that field."""

    joint: int | None
    form: str

    cause: ClassVar[str]
    known = ()
    foreign = ()
    kin = ()
    stage = 0
    needs_axes = 1
    widest = 1e6
    base = Base.FIXED
    stiff = False
    in_band = False
    measured = True
    within = (-inf, inf)
    told = ()

    @classmethod
    @abstractmethod
    def draw(cls, rng, context, form):
        """A first guess of about the wanted size."""

    def scaled(self, k):
        """The same effect, k times as strong."""
        least, most = self.within
        return replace(self, **{self.grows: min(max(k * getattr(self, self.grows), least), most)})

    def parameters(self):
        """Its true parameters by name, SI."""
        return {name: float(getattr(self, name)) for name in self.told or (self.grows,)}

    @property
    def grows(self):
        """Name of its first own field: how strong it is."""
        return fields(self)[2].name

    @property
    def own(self):
        """Its joint, where it must have one."""
        if self.joint is None:
            raise ValueError(f"{self.cause}: this effect sits on one joint, and none is given")
        return self.joint

    def plant(self, rig):
        """The rig as it truly is with this effect."""
        return rig

    def frozen(self, rig):
        """The rigid rig with Coulomb and viscous friction that comes closest: what a perfect refit would find."""
        return rig

    def appendages(self, rig):
        """Further bodies."""
        return ()

    def prepare(self, world):  # noqa: B027 (most effects have nothing to prepare)
        """Change the compiled plant: gravity, encoder offsets, who carries the encoder, how the base moves."""

    def drive(self, world):
        """What happens between the command and the motor: changes `state.u`."""
        return None

    def force(self, world):
        """A generalised force: adds to `state.force`."""
        return None

    def grip(self, world):
        """Dry friction: changes the limits `state.plus` and `state.minus`."""
        return None


def change_torque(joint, change):
    """Return the law of a drive: the torque of a joint as a function of what it would be."""

    def law(state):
        state.u[joint] = change(state, state.u[joint])

    return law


def oppose(dof, torque):
    """Return the law of a torque that is taken from a degree of freedom."""

    def law(state):
        state.force[dof] -= torque(state)

    return law


def rub(joint, extra):
    """Return the law of more dry friction in both directions, never less than none."""

    def law(state):
        more = extra(state)
        state.plus[joint] = max(state.plus[joint] + more, 0.0)
        state.minus[joint] = max(state.minus[joint] + more, 0.0)

    return law
