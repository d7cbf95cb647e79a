"""A link that moves apart from its rotor: on a spring, or in a gap, unseen by the encoder.

On a spring the joint's model is fitted with the spring in it: a resonance takes the rigid model's parameters far from
what they are. In a gap the link flies on by what the rigid model asks of it, and lands on a flank, a spring with
damping (Nordin and Gutman, Automatica 38, 2002: the dead zone model); what drives the rotor across was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.evidence import Evidence, Part
from gimbal_pin.dynamics.regressor import compute_inertia_column, compute_rnea
from gimbal_pin.effects.loose import Loose
from gimbal_pin.effects.signal import Signal
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import PHI, Rig

STEP = 1e-3
"""Longest step of a flight, s: the landing is found within it."""
ASIDE = 1e-3
"""Angle by which a link is moved to see how what it asks for changes, rad."""
FARTHEST = 1.0
"""Angle beyond its gap by which no link leaves its motor, rad: a motion farther than that is no solution."""
WEIGHTLESS = 1e-12
"""Mass of a body that has but an inertia, kg: one of no mass has no centre."""


def swinging(
    evidence: Evidence, spring: Signal, loads: Sequence[Array], own: Sequence[Array], beside: Array, torque: Array
) -> tuple[Array, Array]:
    """``argmin ‖torque - felt(load, inertial) β - beside φ - ringing c‖``: β, (b,), and φ, (f,).

    Args:
        evidence: The logs.
        spring: The spring.
        loads: Base columns of the joint's torque while it does not accelerate, (m, b) per part.
        own: Those of its own acceleration, (m, b) per part.
        beside: Whitened columns of what stands before the spring, (rows, f).
        torque: Whitened torque of the joint, (rows,).
    """
    j, b, f = evidence.rig.joint_index(spring.joint), loads[0].shape[1], beside.shape[1]
    felt = [spring.felt(load, inertial, part.dt) for part, load, inertial in zip(evidence.parts, loads, own)]
    swings = [spring.swings(part.dt, len(load)) for part, load in zip(evidence.parts, loads)]
    # Every part begins with a swing of its own.
    begun = [np.hstack([x if k == i else 0 * x for i in range(len(swings))]) for k, x in enumerate(swings)]
    columns = np.hstack([evidence.whiten(felt, j), beside, evidence.whiten(begun, j)])
    found = np.linalg.lstsq(columns, torque, rcond=1e-10)[0]
    return found[:b], found[b : b + f]


class Swing(NamedTuple):
    """How far a link is from its encoder's angle, rad, its rate and acceleration, (m,) each."""

    q: Array
    v: Array
    a: Array


def loose(rig: Rig, part: Part, gap: Loose) -> Array:
    """What a loose link asks of every joint beyond the rigid rig at the encoder's angle, N m, (m, n).

    Args:
        rig: The rig with its inertias, the rotor's within the link's.
        part: The log.
        gap: The gap, its flanks giving.
    """
    c, j = part.channels, rig.joint_index(gap.joint)
    stays = gap.inertia * axes(rig, c.q, j)
    link = compute_inertia_column(rig, c.q, j)[:, j] - gap.inertia
    if not np.min(link) > 0:
        return np.zeros_like(c.q)
    still, none = moved(rig, part, j), np.zeros(len(c.t))
    aside = moved(rig, part, j, Swing(none + ASIDE, none, none))
    asked, steeper = (still[:, j] - gap.inertia * c.a[:, j]) / link, (aside - still)[:, j] / ASIDE / link
    x = flight(part, asked, steeper, gap)
    return moved(rig, part, j, x) - still - stays * x.a[:, None]


def flight(part: Part, asked: Array, steeper: Array, gap: Loose) -> Swing:
    """The link's angle less the rotor's, smoothed as the log's channels are.

    Args:
        part: The log.
        asked: Torque that the link asks for where the rotor is, per unit of its inertia, rad/s², (m,).
        steeper: How that changes with the link's angle, 1/s², (m,).
        gap: The gap.
    """
    count = max(1, int(np.ceil(part.dt / STEP)))
    fine = np.arange(count * (len(asked) - 1) + 1) / count
    every = np.arange(len(asked))
    x = flown(np.interp(fine, every, asked), np.interp(fine, every, steeper), part.dt / count, gap)
    if part.logged is not None:
        x = signals.zero_phase(x, signals.lowpass(part.logged.cutoff, count / part.dt))
    v = signals.differentiate(x, part.dt / count)
    a = signals.differentiate(v, part.dt / count)
    return Swing(x[::count], v[::count], a[::count])


def flown(asked: Array, steeper: Array, dt: float, gap: Loose) -> Array:
    """``x'' = -asked - steeper x - flanks``: the link's angle less the rotor's, (N,); at rest on its flank before."""
    flanks, rest = gap.flanks(dt), float(asked[0])
    x, v, out = -float(np.sign(rest)) * flanks.half - rest / flanks.k, 0.0, list[float]()
    for u, s in zip(asked.tolist(), steeper.tolist()):
        out.append(x)
        x, v = flanks.moved(x, v, -u - s * x)
        if not -FARTHEST < x < FARTHEST:
            return np.zeros(len(asked))
    return np.array(out)


def moved(rig: Rig, part: Part, joint: int, x: Swing | None = None) -> Array:
    """Torque that the rigid rig asks for with one joint's link moved on, N m, (m, n); None: it is not."""
    c = part.channels
    return compute_rnea(rig, *(carried(part, joint, x) if x else (c.q, c.v, c.a)), part.platform)


def carried(part: Part, joint: int, x: Swing) -> tuple[Array, Array, Array]:
    """Angles, rates and accelerations with one joint's link moved on, (m, n) each."""
    c = part.channels
    out = c.q.copy(), c.v.copy(), c.a.copy()
    for values, more in zip(out, x):
        values[:, joint] += more
    return out


def axes(rig: Rig, q: Array, joint: int) -> Array:
    """``z_i · z_j``, (m, n), of a joint and those that carry it: what a round rotor there, not geared, asks of all."""
    phi = np.zeros_like(rig.phi)
    phi[:: len(PHI)] = WEIGHTLESS
    phi[[10 * joint + PHI.index(symbol) for symbol in ("Ixx", "Iyy", "Izz")]] = 1.0
    return compute_inertia_column(rig.with_phi(phi), q, joint)
