"""Causes as whitened columns: the torque that a cause would add, per unit of each coefficient."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gimbal_pin.diagnosis.evidence import Evidence, LogStretch, select_poses
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.dynamics.regressor import (
    compute_coupling,
    compute_inertia_regressor,
    compute_regressor,
    compute_rnea,
)
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.signal import JointLoad
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Flags, Samples, find_base_columns
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

UNIT_RANGE = (0.3, 3.0)
"""A drive's column fits if its coefficient, which is one, is found within these."""


LEAST_BENT = 1e-5
"""Share of a friction's power under which how it bends shows on no log: three thousandths of its size."""


@dataclass(frozen=True, eq=False)
class Columns:
    """What a cause adds to the torque balance.

    Attributes:
        cause: The cause, with its shape parameters.
        joints: How many joints the rig has.
        joint: The only joint at which they act; None: they act at all.
        own: Whitened, (rows, c) at that joint, or (rows, n, c).
        lower: Bounds of the coefficients, (c,).
        upper: The same.
        bulk: Their power over that of what sets them apart from Coulomb friction.
        shared: Coulomb friction, whitened, (rows,), where the formula alone says what of a torque is its; None: it is
            a torque of its own.
    """

    cause: Cause
    joints: int
    joint: int | None
    own: Array
    lower: Array
    upper: Array
    bulk: float = 1.0
    shared: Array | None = None

    @property
    def width(self) -> int:
        """How many coefficients."""
        return self.own.shape[-1]

    def at(self, joint: int) -> Columns:
        """What of them acts at one joint."""
        return (
            self if self.joint is not None else replace(self, joint=joint, own=self.own[:, joint])
        )

    @property
    def values(self) -> Array:
        """All rows, zero at the other joints, (rows, n, c)."""
        if self.joint is None:
            return self.own
        out = np.zeros((len(self.own), self.joints, self.width))
        out[:, self.joint] = self.own
        return out


@dataclass(frozen=True, eq=False)
class RigidColumns:
    """Base columns of the rigid model along some logs, N m; every problem on these logs shares them.

    Attributes:
        rig: The rig.
        places: The base parameters' places in `Rig.phi`, (b,).
        channels: What the logs' parts hold.
    """

    rig: Rig
    places: Array
    channels: list[Samples]

    @staticmethod
    def of(evidence: Evidence, reduction: Reduction) -> RigidColumns:
        """Return those of some logs."""
        places = find_base_columns(evidence.rig, reduction)
        return RigidColumns(evidence.rig, places, [part.channels for part in evidence.parts])

    @cached_property
    def full(self) -> list[Array]:
        """Columns of all joints' torques, (m, n, b) per part."""
        rows = ((c.q, c.v, c.a, c.platform) for c in self.channels)
        return [compute_regressor(self.rig, *row, places=self.places) for row in rows]

    @cached_property
    def rotors(self) -> list[Array]:
        """Torque of the stated rotors, which is known, N m, (m, n) per part."""
        return [c.a * self.rig.armature for c in self.channels]

    @cached_property
    def masses(self) -> list[list[Array]]:
        """Columns of what a unit acceleration of each joint asks of all joints, (m, n, b) per part."""
        every = range(self.rig.n)
        return [
            [compute_inertia_regressor(self.rig, c.q, j, self.places) for c in self.channels]
            for j in every
        ]

    @cached_property
    def resting(self) -> list[Array]:
        """Columns of each joint's torque while that joint does not accelerate, (m, n, b) per part."""
        own = (
            np.stack([mass[:, j] for j, mass in enumerate(each)], axis=1)
            for each in zip(*self.masses)
        )
        return [
            full - c.a[:, :, None] * mass for full, c, mass in zip(self.full, self.channels, own)
        ]

    @cached_property
    def felt(self) -> Flags:
        """Which base parameters each joint's torque feels, (n, b)."""
        return np.any([np.any(full != 0, axis=0) for full in self.full], axis=0)

    @cached_property
    def apart(self) -> list[tuple[list[Array], list[Array]]]:
        """What `split_columns` returns, of every joint."""
        return [self.split_columns(j, felt) for j, felt in enumerate(self.felt)]

    def split_columns(self, j: int, felt: Flags) -> tuple[list[Array], list[Array]]:
        """Columns of some base parameters in a joint's torque: of what is asked at rest, of its own acceleration."""
        loads = [np.asfortranarray(rest[:, j, felt]) for rest in self.resting]
        whole = [np.asfortranarray(full[:, j, felt]) for full in self.full]
        return loads, [x - y for x, y in zip(whole, loads)]

    def couple_joints(self, j: int, beta: Array) -> list[Array]:
        """What base parameters, (b,), say that 1 N m at one joint's link asks of every joint, (m, n) per part."""
        own = self.rig.armature * (np.arange(self.rig.n) == j)
        return [compute_coupling(columns @ beta + own, j) for columns in self.masses[j]]

    @cached_property
    def inertia(self) -> Array:
        """Base parameters → mean over some poses of each joint's inertia about its axis, (n, b)."""
        some = select_poses(self.channels)
        every = range(self.rig.n)
        rows = [compute_inertia_regressor(self.rig, some, j, self.places)[:, j] for j in every]
        return np.stack([np.mean(row, axis=0) for row in rows])


def compute_plain_columns(evidence: Evidence, effect: Effect, load: Load) -> list[Array]:
    """Columns of a torque effect at its joint as they are, (m, c) per part."""
    j = evidence.rig.joint_index(effect.joint)
    samples = [
        sample._replace(tau=tau[:, j]) for sample, tau in zip(evidence.samples[j], load.torque)
    ]
    if effect.weighed:
        rows = zip(samples, load.borne, load.weight)
        samples = [
            sample._replace(tau=tau[:, j], weight=weight[:, j]) for sample, tau, weight in rows
        ]
    # Side by side in memory: quicker to whiten.
    return [
        np.stack([np.broadcast_to(x, np.shape(at.t)) for x in effect.basis(at)]).T for at in samples
    ]


Bearing = Sequence[JointLoad]
"""What a joint bears along each part."""


def compute_lost_torque(
    evidence: Evidence, signal: Signal, torque: list[Array], bearing: Bearing | None
) -> Array:
    """``x - acting(x)``: what a drive takes from the torques, whitened, (rows,), or (rows, n) where it pushes others.

    It stands beside the model's columns.
    """
    j = evidence.rig.joint_index(signal.joint)
    borne = [None] * len(torque) if bearing is None else bearing
    spread = [part.lost(signal, x, j, y) for part, x, y in zip(evidence.parts, torque, borne)]
    everywhere = any(y is not None and y.across is not None for y in borne)
    if everywhere and evidence.rig.n > 1:
        return evidence.whiten_all(spread)
    return evidence.whiten([x[:, j] for x in spread], j)


@dataclass(frozen=True, eq=False)
class Stand:
    """A rig with the large changes that were found in it.

    Attributes:
        rig: The rig.
        changes: What its bodies and its base's motion are changed by, in order.
        torques: Logs → what `torque` returns.
    """

    rig: Rig
    changes: tuple[RigEffect, ...] = ()
    torques: dict[Evidence, list[Array]] = field(default_factory=dict, init=False, repr=False)

    def torque(self, evidence: Evidence) -> list[Array]:
        """Torque that it asks for along some logs, N m, (m, n) per part; worked out once."""
        if evidence not in self.torques:
            self.torques[evidence] = [
                self.asked(part, part.channels.v, part.channels.a) for part in evidence.parts
            ]
        return self.torques[evidence]

    def weight(self, part: LogStretch) -> Array:
        """What of that it asks for at rest, N m, (m, n)."""
        rest = np.zeros_like(part.channels.q)
        return self.asked(part, rest, rest)

    def asked(self, part: LogStretch, v: Array, a: Array) -> Array:
        """Torque at a part's angles and these rates and accelerations, N m, (m, n)."""
        rig = self.rig
        platform = part.platform
        for change in self.changes:
            rig = change.apply(rig)
            platform = change.carried(part.time, platform)
        return compute_rnea(rig, part.channels.q, v, a, platform)


@dataclass(frozen=True, eq=False)
class Load:
    """What effects read of the model.

    Attributes:
        evidence: The logs.
        torque: Best estimate of the torque that acts, N m, (m, n) per part.
        borne: The same with every cause in that was found: what reads the weight is a load's share beside it.
        stand: The rig as fitted with every cause in.
    """

    evidence: Evidence
    torque: list[Array]
    borne: list[Array]
    stand: Stand

    __repr__ = brief

    @cached_property
    def weight(self) -> list[Array]:
        """What of the torque the rig asks for at rest, N m, (m, n) per part; worked out where it is asked for."""
        return [self.stand.weight(part) for part in self.evidence.parts]


def compute_turned_torque(evidence: Evidence, cause: RigEffect, stand: Stand, size: float) -> Array:
    """``(rnea(changed rig) - rnea(rig)) / size``: torque per unit of a small change of the rig, whitened, (rows, n)."""
    other = Stand(stand.rig, (*stand.changes, cause))
    return evidence.whiten_all(
        [(x - y) / size for x, y in zip(other.torque(evidence), stand.torque(evidence))]
    )


def build_columns(
    evidence: Evidence,
    cause: Cause,
    stand: Stand,
    load: Load,
    acting: list[Array],
    bearing: Bearing | None = None,
) -> Columns:
    """Return a cause's columns.

    Args:
        evidence: The logs.
        cause: The cause.
        stand: The rig with the inertias fitted so far, and what it was found to be changed by.
        load: What torque effects read of the model.
        acting: The measured torque after the drives' signals found so far, N m, (m, n) per part: what a further
            signal changes. Its noise is in the column, too, and by itself lets no signal gain: what a filter takes off
            the noise it takes off the torque many times over.
        bearing: What the joints bear, for signals that act behind the motor's friction.
    """
    joint = evidence.rig.joint_index(cause.place) if cause.of_joint else None
    own: Array
    if cause.coupled and evidence.rig.n == 1:
        own = np.zeros((evidence.rows, 1))
        bounds = [(-np.inf, np.inf)]
    elif isinstance(cause, Effect):
        own = evidence.whiten(
            compute_plain_columns(evidence, cause, load), evidence.rig.joint_index(cause.joint)
        )
        bounds = [(c.lower, c.upper) for c in cause.coefficients]
    elif isinstance(cause, Signal):
        own = compute_lost_torque(evidence, cause, acting, bearing)[..., None]
        bounds = [UNIT_RANGE]
        joint = joint if own.ndim == 2 else None
    elif isinstance(cause, RigEffect):
        joint = None  # an encoder that is off by an angle changes the torque of every joint
        own = compute_turned_torque(evidence, cause, stand, get_magnitude(cause))[:, :, None]
        bounds = [get_size_bounds(cause)]
    else:
        raise TypeError(f"{cause.name} is no torque effect, signal or rig effect")
    lower, upper = np.array(bounds).T
    found = Columns(cause, evidence.rig.n, joint, own, lower, upper)
    return part_from_friction(evidence, found)


def part_from_friction(evidence: Evidence, found: Columns) -> Columns:
    """Return columns with what sets them apart from Coulomb friction, as the evidence whitens it."""
    cause = found.cause
    joint = found.joint
    bulk = found.bulk
    shared = None
    if isinstance(cause, Effect) and cause.bristly:
        bulk = compute_bulk(evidence, cause, found.own)
    if joint is not None and isinstance(cause, Harmonic) and cause.dry:
        shared = evidence.sliding[joint]
    return replace(found, bulk=bulk, shared=shared)


def compute_bulk(evidence: Evidence, effect: Effect, own: Array) -> float:
    """Power of whitened columns of bending friction, (rows, c), over that of what of the first is no Coulomb friction.

    Bristles slide most of the time, and then all of them is Coulomb friction: how they bend is judged by itself.
    """
    apart = own.copy()
    apart[:, 0] -= evidence.sliding[evidence.rig.joint_index(effect.joint)]
    power = float(np.sum(apart**2))
    whole = float(np.sum(own**2))
    return whole / power if power > LEAST_BENT * whole else 1.0


def get_size_bounds(cause: RigEffect) -> tuple[float, float]:
    """Bounds of how far a rig may be changed: of its one shape parameter that is not zero."""
    return next((shape.lower, shape.upper) for shape in cause.shapes if getattr(cause, shape.name))


def get_magnitude(cause: Cause) -> float:
    """The one shape parameter of a rig effect that is not zero."""
    values: Mapping[str, float] = {shape.name: getattr(cause, shape.name) for shape in cause.shapes}
    return next(x for x in values.values() if x)
