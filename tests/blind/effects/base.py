"""Hidden effects: frozen descriptions that turn themselves into laws of the plant, functions of its state."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import inf
from types import MappingProxyType

from ..mjcf import Base
from ..rigs import Rig

Forms = MappingProxyType
"""Names of forms with the shape that sets each apart."""


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

    @property
    def motor(self):
        """The joint's motor."""
        return self.rig.motors[self.joint]


@dataclass(frozen=True)
class Effect:
    """One cause (`cause`) in one functional form, on one joint (None: the whole rig, as of those not `on_joint`).

    `known` forms have the formula that the published table of causes gives, `foreign` ones another; `kin` are published
    causes that come near one from outside. `stage` orders what sits between command and motor. `widest`: how many times
    stronger than its first guess it may become. `stiff` ones need fine steps even in a trial run, and those that ring
    are sized `in_band`, below visibility.CUTOFF_HZ. Where the base moves, `measured` says whether its IMU is logged.
    Its first own field is how strong it is, `within` these bounds; `told` are its true parameters, else that field.
    Every subclass is a frozen dataclass."""

    joint: int | None
    form: str

    known = Forms({})
    foreign = Forms({})
    kin = ()
    on_joint = True
    stage = 0
    needs_axes = 1
    widest = 1e6
    base = Base.FIXED
    stiff = False
    in_band = False
    measured = True
    within = (-inf, inf)
    told = ()

    def __init_subclass__(cls):
        dataclass(frozen=True)(cls)

    @classmethod
    def draw(cls, rng, context, form):
        """Draw an effect of about the wanted size."""
        return cls(
            context.joint if cls.on_joint else None, form, *cls.first_guess(rng, context, form)
        )

    @staticmethod
    def first_guess(rng, context, form):
        """Draw the values of its own fields."""
        raise NotImplementedError

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

    @cached_property
    def shape(self):
        """Constants or functions of its form."""
        return (self.known | self.foreign)[self.form]

    def plant(self, rig):
        """The rig as it truly is with this effect."""
        return rig

    def frozen(self, rig):
        """The rigid rig with Coulomb and viscous friction that comes closest: what a perfect refit would find."""
        return rig

    def appendages(self, rig):
        """Further bodies."""
        return ()

    def prepare(self, world):
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


class JointEffect(Effect):
    """One formula on one joint; where it needs to remember, `start` returns it anew for each run."""

    def start(self, world):
        """Return the formula."""
        return self.formula


class MotorEffect(JointEffect):
    """Another torque of the motor: a formula of what it would be, the angle and the state."""

    def drive(self, world):
        joint = self.joint
        dof = world.dof[joint]
        formula = self.start(world)

        def law(state):
            state.u[joint] = formula(state.u[joint], state.q[dof], state)

        return law


class OpposingEffect(JointEffect):
    """A torque that is taken from motor or link: a formula of its angle, its speed and the state."""

    on_link = True

    def force(self, world):
        dof = (world.link_dof if self.on_link else world.dof)[self.joint]
        formula = self.start(world)

        def law(state):
            state.force[dof] -= formula(state.q[dof], state.v[dof], state)

        return law


class RubbingEffect(JointEffect):
    """More dry friction, never less than none: a formula of the motor's angle, its speed and the state; `backward` of
    it against negative speeds."""

    backward = 1.0

    def grip(self, world):
        joint = self.joint
        dof = world.dof[joint]
        formula = self.start(world)

        def law(state):
            more = formula(state.q[dof], state.v[dof], state)
            state.plus[joint] = max(state.plus[joint] + more, 0.0)
            state.minus[joint] = max(state.minus[joint] + self.backward * more, 0.0)

        return law
