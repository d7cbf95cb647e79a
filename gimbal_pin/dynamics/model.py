"""A rig with inertial parameters and effects: the one model that fit, simulation and control share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from gimbal_pin.dynamics.reduction import Reduction, spread_states
from gimbal_pin.dynamics.regressor import compute_gravity, compute_rnea
from gimbal_pin.effects import (
    PLAIN,
    Armature,
    Cause,
    Coulomb,
    CoupledFriction,
    CoupledRotor,
    Effect,
    RigEffect,
    Rotor,
    Sample,
    Signal,
    Term,
    TorqueBias,
    Viscous,
)
from gimbal_pin.effects.base import AMBIENT
from gimbal_pin.effects.losses import Losses
from gimbal_pin.effects.plain import read_cause, read_term
from gimbal_pin.errors import ModelError, UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.arguments import check_arguments, check_count, check_type, to_rows
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.records import prefix_place, read_record
from gimbal_pin.rig.rig import Rig

TORQUE_ITERATIONS = 50
"""Most passes for terms that depend on the total torque; three do where they are linear in it."""
SETTLED_TORQUE = 1e-10
"""Change of the torque at which they stop, N m."""


EXAMINED_INERTIAS = 64
"""At which the inertia of a model from a file is looked at, spread evenly."""


@dataclass(frozen=True, eq=False)
class Estimated:
    """What identification knows of the parameters, for those who want the uncertainty.

    Attributes:
        names: Names of the base parameters and effect coefficients (k).
        units: Their SI units (k).
        theta: Their values (k).
        covariance: Their covariance (k, k).
        dt: Sampling interval of the logs, s; None: not known.
        missed: What of each joint's torque the model misses and the motion decides, N m rms, (n,); empty: not known.
        misfit: Standard deviations of that torque's coefficients at each joint, a group of them alike, N m, see
            `regression.GROUPS`, (n, groups); empty: not known.
        noise: Density of the noise on each joint's torque, N m/√Hz, (n,), what the sensors add included; as above.
        pure_error: The same of what does not come back when the motion does, see `regression.measure_pure_error`.
        lags: By how much later than half a sample after its stamp each joint's torque acts, s, (n,); empty: as stated.
        lag_std: Their standard deviations, s, (n,).
        angle_noise: Standard deviation of each angle's noise and rounding in the logs, rad, (n,); empty: not known.
        digests: `Log.digest` of the logs that it was estimated from; empty: not known.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    theta: Array
    covariance: Array
    dt: float | None = None
    missed: tuple[float, ...] = ()
    misfit: tuple[tuple[float, ...], ...] = ()
    noise: tuple[float, ...] = ()
    pure_error: tuple[float, ...] = ()
    lags: tuple[float, ...] = ()
    lag_std: tuple[float, ...] = ()
    angle_noise: tuple[float, ...] = ()
    digests: tuple[str, ...] = ()

    __repr__ = brief

    @property
    def std(self) -> Array:
        """Standard deviations (k)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Doubt:
    """What of a model does not hold for data that it was not fitted to.

    Attributes:
        joint: Where.
        why: Sentence.
        unsafe: Whether no loop should be closed there.
    """

    joint: str
    why: str
    unsafe: bool

    def __str__(self) -> str:
        """Where, and why."""
        return f"{self.joint}: {self.why}"


@dataclass(frozen=True, eq=False)
class Model(Record):
    """``tau = rnea(q, v, a; phi) + sum of terms`` (thesis 3.70).

    Attributes:
        rig: The rig; its Pinocchio model carries the inertial parameters in force.
        terms: Effects with their coefficients; friction is among them.
        estimated: Where the parameters were identified, with what uncertainty; None for a nominal model.
        drive: What stands between the torque that is commanded and the one that acts, in the order it is passed.
        changes: What sets the rig apart from its URDF beside its inertial parameters; `rig` holds it already.
        doubts: What does not hold for data that it was not fitted to, as far as there were any.
    """

    rig: Rig
    terms: tuple[Term, ...]
    estimated: Estimated | None = None
    drive: tuple[Signal, ...] = ()
    changes: tuple[RigEffect, ...] = ()
    doubts: tuple[Doubt, ...] = ()

    ROWS: ClassVar[str] = "terms"
    __repr__ = brief

    def __post_init__(self) -> None:
        """Take those rotors that are terms out of the rig."""
        apart = find_rotors(term.effect for term in self.terms)
        object.__setattr__(self, "rig", self.rig.with_rotors_apart(apart))

    def __str__(self) -> str:
        """One line: whose it is, where its parameters come from, and what it has beside bodies and plain friction."""
        terms = (term.effect for term in self.terms if not is_parameter(self.rig, term.effect))
        beside = [f"{x.name} at {x.place}" for x in (*terms, *self.drive, *self.changes)]
        known = (
            "as stated"
            if self.estimated is None
            else f"{len(self.estimated.names)} parameters identified"
        )
        return ", ".join([f"model of {self.rig.title}: {known}", *beside])

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, as YAML holds it, without its uncertainty; `read_model_data` reads it back."""
        return {
            "phi": self.rig.phi.tolist(),
            "terms": [term.to_dict() for term in self.terms],
            "drive": [signal.to_dict() for signal in self.drive],
            "changes": [change.to_dict() for change in self.changes],
        }

    @property
    def lags(self) -> dict[str, tuple[float, float]]:
        """Joint → time from its torque's stamp to its acting, and the deviation, s; empty where that is stated."""
        known = self.estimated
        if known is None or known.dt is None:
            return {}
        pairs = zip(self.rig.joints, known.lags, known.lag_std)
        return {joint: (known.dt / 2 + lag, std) for joint, lag, std in pairs}

    @cached_property
    def tau_max(self) -> Array:
        """Largest torque of each motor, N m, (n,): the rig's own, or less where a drive gives no more."""
        lowest = self.rig.tau_max.copy()
        for signal in self.drive:
            j = self.rig.joint_index(signal.joint)
            lowest[j] = min(lowest[j], signal.largest)
        return lowest

    @cached_property
    def drives(self) -> tuple[tuple[Signal, ...], ...]:
        """The signals of each joint's drive, (n)."""
        return tuple(
            tuple(signal for signal in self.drive if signal.joint == joint)
            for joint in self.rig.joints
        )

    def late(self, dt: float) -> tuple[float, ...]:
        """Time by which each drive acts late, s, (n): the sum of its signals'; `dt` is the sampling interval, s."""
        return tuple(sum((signal.late(dt) for signal in own), 0.0) for own in self.drives)

    @cached_property
    def by_joint(self) -> tuple[tuple[Term, ...], ...]:
        """The terms that act on each joint, (n)."""
        return tuple(
            tuple(
                term
                for term in self.terms
                if term.effect.joint == joint and not term.effect.coupling
            )
            for joint in self.rig.joints
        )

    @cached_property
    def coupled(self) -> tuple[Term, ...]:
        """The terms at motors that turn with several joints."""
        return tuple(term for term in self.terms if term.effect.coupling)

    @cached_property
    def motor_inertia(self) -> Array:
        """``armature + sum gᵀ Ia g`` of the coupled rotors, kg m², (n, n): what the terms add to the mass matrix."""
        total: Array = np.diag(self.armature)
        for term in self.coupled:
            if isinstance(term.effect, CoupledRotor):
                g = self.rig.build_motor_row(term.effect.joint)
                total = total + term.values[0] * np.outer(g, g)
        return total

    @cached_property
    def armature(self) -> Array:
        """Inertia that the terms add to `Rig.armature`, kg m², (n,): their torque per acceleration."""
        still, moving = (Sample(0.0, 0.0, 0.0, a, 0.0, 0.0) for a in (0.0, 1.0))
        per_joint = [
            sum(t.torque(moving) - t.torque(still) for t in terms) for terms in self.by_joint
        ]
        return np.array(per_joint, dtype=np.float64)

    @cached_property
    def loaded(self) -> bool:
        """Whether a term depends on the total torque."""
        return any(term.effect.loaded for term in self.terms)

    @cached_property
    def weighed(self) -> bool:
        """Whether a term may read what the rig asks for at rest."""
        return any(term.effect.weighed for term in self.terms)

    def weight(self, q: Array, platform: Platform | None = None) -> Array:
        """Torque that the rig asks for at rest, N m, (N, n); zero where no term reads it."""
        return compute_gravity(self.rig, q, platform) if self.weighed else np.zeros_like(q)

    def carried(self, t: Array, platform: Platform | None = None) -> Platform | None:
        """Motion of the base at the times t, s, (N,), where what it stands on moves as `platform`; None: it stands."""
        for change in self.changes:
            platform = change.carried(t, platform)
        return platform

    def inverse_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        slide: ArrayLike | None = None,
        t: ArrayLike | None = None,
        temperature: ArrayLike | None = None,
        platform: Platform | None = None,
        losses: Sequence[Losses] | None = None,
    ) -> Array:
        """Return the torque that moves the rig as given, N m, (N, n), or (n,) of one pose.

        ``tau = rnea(q, v, a; phi) + passive(tau)`` (thesis 3.70), iterated where a term depends on the total torque.

        Args:
            q: Angles, rad, (N, n), of consecutive samples where a term has a memory; or one pose, (n,).
            v: Rates, rad/s, of the same shape.
            a: Accelerations, rad/s², of the same shape.
            slide: Direction of sliding in [-1, 1], of the same shape; sign(v) if None.
            t: Time, s, (N,), or a number of one pose; zero if None.
            temperature: Motor temperatures, °C, of the shape of q; ambient if None.
            platform: Motion of the base at the same samples; None: it stands upright.
            losses: Heat of each motor, (n); None: not known.

        Raises:
            UsageError: An array is of another shape, or holds no numbers; `platform` is none of the same samples.
        """
        given = {"q": q, "v": v, "a": a, "slide": slide, "temperature": temperature}
        rows = to_rows("Model.inverse_dynamics", self.rig.n, given)
        is_one_pose = rows["q"].ndim == 1
        rows = {name: np.atleast_2d(x) for name, x in rows.items()}
        q, v, a = (rows[name] for name in "qva")
        if t is not None:
            t = np.atleast_1d(t)
            check_count("Model.inverse_dynamics: t", t, len(q))
        if platform is not None:
            check_type("Model.inverse_dynamics: platform", platform, Platform)
            check_count("Model.inverse_dynamics: platform", platform.t, len(q))
        direction = rows.get("slide", np.sign(v))
        carrier = platform if t is None else self.carried(t, platform)
        rigid = compute_rnea(self.rig, q, v, a, carrier)
        weight = self.weight(q, carrier)

        def total(tau: Array) -> Array:
            own = (direction, tau, t, rows.get("temperature"), losses, weight)
            return rigid + self.passive(q, v, a, *own)

        tau = _solve_implicit_torque(total, rigid) if self.loaded else total(rigid)
        return tau[0] if is_one_pose else tau

    def passive(
        self,
        q: Array,
        v: Array,
        a: Array,
        slide: Array,
        tau: Array,
        t: Array | None = None,
        temperature: Array | None = None,
        losses: Sequence[Losses] | None = None,
        weight: Array | None = None,
    ) -> Array:
        """Torque of all terms, N m, (N, n); `tau` is the total torque, which load-dependent terms see.

        `weight`: what of it the rig asks for at rest, N m, (N, n); None: on a base that stands.
        """
        out = np.zeros_like(q)
        pull = self.weight(q) if weight is None else weight
        times = np.zeros(len(q)) if t is None else t
        warm = np.full_like(q, AMBIENT) if temperature is None else temperature
        for j, terms in enumerate(self.by_joint):
            own = (x[:, j] for x in (q, v, a, slide, tau, warm))
            heat = None if losses is None else losses[j]
            at = Sample(times, *own)._replace(weight=pull[:, j], losses=heat)
            for term in terms:
                out[:, j] += term.torque(at)
        for term in self.coupled:
            g = self.rig.build_motor_row(term.effect.joint)
            motor = Sample(times, q @ g, v @ g, a @ g, np.sign(v @ g), tau @ g)
            out += np.outer(term.torque(motor), g)
        return out

    def check_uncoupled(self, what: str) -> None:
        """Raise `UsageError` where a motor turns with several joints: `what` takes a motor for each joint."""
        for joint, others in self.rig.coupling.items():
            why = (
                f"couples {joint} with {', '.join(others)}, and {what} takes a motor for each joint"
            )
            mend = "leave out coupling in its YAML; 'identify' and 'base' take it"
            raise UsageError(f"rig {self.rig.name}", why, mend)

    @cached_property
    def _dry(self) -> Model:
        """The model with its dry friction alone."""
        return Model(self.rig, tuple(term for term in self.terms if term.effect.dry))

    def level(
        self,
        q: Array,
        v: Array,
        a: Array,
        tau: Array,
        t: Array | None = None,
        slide: Array | None = None,
    ) -> Array:
        """Dry friction that each joint can bear, N m, (N, n), against a torque in the direction `slide`, ±1.

        It is positive in both directions; without `slide` it is that of the positive one.
        """
        way = np.ones_like(q) if slide is None else slide
        dry = self._dry
        return way * (
            dry.passive(q, v, a, way, tau, t) - dry.passive(q, v, a, np.zeros_like(q), tau, t)
        )


def _solve_implicit_torque(total: Callable[[Array], Array], start: Array) -> Array:
    """Solve ``tau = total(tau)``, entry by entry, by the secant method: exact at once where it is linear in tau."""
    x = start
    y = total(start)
    rest = y - x
    for _ in range(TORQUE_ITERATIONS):
        rest_y = total(y) - y
        if np.abs(rest_y).max(initial=0.0) < SETTLED_TORQUE:
            break
        change = rest_y - rest
        slope = np.divide(change, y - x, out=-np.ones_like(x), where=np.abs(y - x) > 1e-12)
        x = y
        y = y - rest_y / np.where(slope < -1e-3, slope, -1.0)
        rest = rest_y
    return y


@dataclass(frozen=True)
class _ModelData:
    """What `Model.to_dict` writes of a model: inertial parameters, and its terms, drive and changes as plain data."""

    phi: tuple[float, ...]
    terms: tuple[Any, ...]
    drive: tuple[Any, ...] = ()
    changes: tuple[Any, ...] = ()


def read_model_data(data: Any, rig: Rig, place: str = "model") -> Model:
    """Return the model that `Model.to_dict` wrote, on a rig as its URDF states it; `place` is the file.

    Raises:
        ModelError: Something is missing, is of the wrong kind, or no rig can have it.
    """
    filed = read_record(_ModelData, data, place, ModelError, others=True)
    with prefix_place(place, ModelError):
        causes = [read_cause(entry) for entry in (*filed.drive, *filed.changes)]
        terms = tuple(map(read_term, filed.terms))
        drive = tuple(cause for cause in causes if isinstance(cause, Signal))
        changes = tuple(cause for cause in causes if isinstance(cause, RigEffect))
        if len(drive) + len(changes) < len(causes):
            mend = "write it with 'gimbal-pin diagnose'"
            raise ModelError(
                "drive or changes", "hold a torque effect, which belongs to the terms", mend
            )
        for cause in (*drive, *(term.effect for term in terms)):
            rig.joint_index(cause.place)
        own = Model(rig, terms)
        rig = replace_bodies(own.rig, np.array(filed.phi), own.motor_inertia)
        for change in changes:
            phi = rig.phi
            rig = change.apply(rig)
            rig = rig.with_phi(phi)  # a change of the bodies is in the stated parameters already
        return Model(rig, terms, drive=drive, changes=changes)


def replace_bodies(rig: Rig, phi: Array, rotors: float | Array = 0.0) -> Rig:
    """Return the rig with inertial parameters from a file, (10 n,).

    Bodies need not be physical one by one, as only sums of them show; but no rig moves without inertia.
    `rotors` as in `is_inertia_positive`.

    Raises:
        ModelError: They are of another number of joints, or the inertia is not positive definite at some pose.
    """
    if len(phi) != 10 * rig.n:
        raise ModelError("phi", f"has {len(phi)} values", f"give ten for each of {rig.n} joints")
    out = rig.with_phi(phi)
    if not is_inertia_positive(out, rotors=rotors):
        raise ModelError(
            "phi",
            "gives the joints an inertia that is not positive at some pose",
            "identify it again",
        )
    return out


def is_inertia_positive(rig: Rig, q: Array | None = None, rotors: float | Array = 0.0) -> bool:
    """Return whether the mass matrix is positive definite at all angles q, (m, n), or all over.

    `rotors`: inertia that the terms add, kg m², (n,) or (n, n).
    """
    data = rig.model.createData()
    everywhere = spread_states(rig, EXAMINED_INERTIAS)[0] if q is None else q
    added = np.diag(np.broadcast_to(rotors, rig.n)) if np.ndim(rotors) < 2 else rotors
    upper = [pin.crba(rig.model, data, angles) + added for angles in everywhere]
    return bool(np.linalg.eigvalsh(np.array(upper), UPLO="U").min() > 0)


def build_friction_effects(joints: Sequence[str]) -> tuple[Effect, ...]:
    """Coulomb and viscous friction of every joint: always part of the model (thesis 3.61)."""
    return tuple(kind(joint) for joint in joints for kind in (Coulomb, Viscous))


def build_stated_effects(rig: Rig, reduction: Reduction) -> tuple[Effect, ...]:
    """Return the effects that every model of a rig has: friction, rotors, coupled motors and constant torques.

    Rotors where it states a gear or a rotor that its bodies cannot stand for, see `Reduction.rotors`; constant torques
    where it says ``torque_offset: fit``.
    """
    rows = zip(rig.joints, rig.motors)
    offsets = [TorqueBias(joint) for joint, motor in rows if motor.torque_offset == "fit"]
    motors = [CoupledFriction(joint, *_split(others)) for joint, others in rig.coupling.items()]
    return (*build_friction_effects(rig.joints), *build_rotors(rig, reduction), *motors, *offsets)


def is_parameter(rig: Rig, effect: Effect | Term | Cause | None) -> bool:
    """Return whether an effect is a parameter of the rig's model, see `build_stated_effects`, and never a finding."""
    if isinstance(effect, Term):
        effect = effect.effect
    if isinstance(effect, PLAIN):
        return True
    if not isinstance(effect, (Armature, TorqueBias)):
        return False
    motor = rig.motors[rig.joint_index(effect.joint)]
    is_offset = isinstance(effect, TorqueBias)
    return motor.torque_offset == "fit" if is_offset else motor.states_rotor


def build_rotors(rig: Rig, reduction: Reduction) -> tuple[Effect, ...]:
    """Rotors that are parameters of their own, see `Reduction.rotors`."""
    return tuple(_build_rotor(rig, joint) for joint in reduction.rotors)


def _build_rotor(rig: Rig, joint: str) -> Effect:
    """Rotor of a joint's motor, which may turn with other joints, too."""
    others = rig.coupling.get(joint)
    return CoupledRotor(joint, *_split(others)) if others else Rotor(joint)


def _split(others: Mapping[str, float]) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Joints and ratios of a coupling."""
    return tuple(others), tuple(others.values())


def find_rotors(effects: Iterable[Effect]) -> tuple[str, ...]:
    """Joints whose rotor is among some effects."""
    return tuple(effect.joint for effect in effects if isinstance(effect, (Rotor, CoupledRotor)))


def is_motor_friction(effect: Effect) -> bool:
    """Whether a torque is friction that brakes the motor whatever it drives: viscous, or dry and not of a load."""
    return isinstance(effect, Viscous) or (effect.dry and not effect.loaded)


@check_arguments
def nominal(rig: Rig) -> Model:
    """Return the model as the rig's URDF states it, friction from ``<dynamics>``."""
    rig = rig.with_rotors_apart(())
    terms = []
    for joint, (dry, viscous) in zip(rig.joints, rig.friction):
        terms += [Term(Coulomb(joint), (float(dry),)), Term(Viscous(joint), (float(viscous),))]
    for joint, others in rig.coupling.items():
        inertia = rig.motors[rig.joint_index(joint)].armature
        terms += [
            Term(_build_rotor(rig, joint), (inertia,)),
            Term(CoupledFriction(joint, *_split(others)), (0.0, 0.0)),
        ]
    return Model(rig, tuple(terms))
