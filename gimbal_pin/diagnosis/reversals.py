"""Turns swift enough to count: where a joint reverses under torques far beyond its dry friction, drives show limits.

Near standstill the direction of dry friction is unknown, and the gate is closed. How wrong a turn can be is known once
the friction is: it changes by 2 F_c at a moment that is off by Δt, which no row sees if that is under its noise. By how
much the smoother shifts that moment is known, too, and made up for: friction that turns later than that is presliding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.diagnosis.evidence import CLEAR, TAPER, Evidence, LogStretch, compute_fade
from gimbal_pin.diagnosis.state import State
from gimbal_pin.dynamics.regressor import compute_rnea
from gimbal_pin.log.log import Array
from gimbal_pin.regression import (
    Filtering,
    Flags,
    build_mask,
    compute_settling_time,
    count_smoother_memory,
    dilate_flags,
    find_slow_samples,
)

SMEAR = 2.0 / 3.0
"""``2π f_c ∫ h(s) |s| ds`` of the zero-phase Butterworth low-pass of third order, which rounds the rate's corners: to
``SMEAR Δa/(4π f_c)`` a corner at zero, where the acceleration jumps by Δa."""
LATE_DEVIATIONS = 4.0
"""Standard deviations from which a torque is taken to act at another time."""
LARGEST_DISPERSION = 40.0
"""Dispersion from which it is not known when a joint turns round."""
TURN_ERROR = 0.5
"""Error that a turn may add to a row, in deviations of its noise."""


def open_turns(evidence: Evidence, state: State, filtering: Filtering) -> Evidence:
    """Return logs with the gate open at their swift turns; `state`: what was fitted away from them.

    Where more is left of a joint than any sensor's noise, what its turns are timed by, friction and inertia, is not
    known: how late they are is not made up for.
    """
    floors = [evidence.noise_floor(j) for j in range(evidence.rig.n)]
    friction = get_dry_friction(state)
    delays = find_shifts(state)
    turns = [
        find_swift_turns(part, state, friction, delays, floors, filtering)
        for part in evidence.parts
    ]
    parts = [open_gate(part, flags, filtering) for part, flags in zip(evidence.parts, turns)]
    corners = [
        compute_corners(part, flags, state, friction, filtering)
        for part, flags in zip(parts, turns)
    ]
    return replace(
        evidence, parts=tuple(part._replace(corner=x) for part, x in zip(parts, corners))
    )


def get_dry_friction(state: State) -> Array:
    """Fitted Coulomb friction of each joint, N m, (n,)."""
    problem = state.problem
    at = len(state.problem.reduction.independent)
    out = np.zeros(problem.evidence.rig.n)
    for effect, value in zip(problem.friction, state.fit.theta[at:].tolist()):
        if effect.dry:
            out[problem.evidence.rig.joint_index(effect.joint)] = abs(value)
    return out


def find_swift_turns(
    part: LogStretch,
    state: State,
    friction: Array,
    delays: Array,
    floors: list[float],
    filtering: Filtering,
) -> Flags:
    """Whether a joint turns round at a sample so that its friction's direction adds no error that shows, (m, n).

    ``2 F_c Δt · 2 band ≤ TURN_ERROR σ_row`` with ``Δt = SMEAR/(2π f_c) (F_c/T)² + σ_v/|a| + |δ|``: the smoother shifts
    the moment at which the rate is zero by the jump of the acceleration, of which F_c/T tells, T the torque that
    accelerates the joint. `compute_corners` makes up for it but for that share of it, or, where a joint is not
    `is_timed`, for none of it; the rate's noise shifts the moment by the rest, and δ is what `find_shifts` finds.
    """
    c = part.channels
    reach = count_smoother_memory(part.channels, filtering)
    out = np.zeros(c.v.shape, dtype=bool)
    at, joint = np.nonzero(find_slow_samples(c, CLEAR)[reach:-reach])
    at += reach
    before = c.v[at - reach, joint]
    after = c.v[at + reach, joint]
    least = CLEAR * c.rate_std[joint]
    turning = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > least)
    at = at[turning]
    joint = joint[turning]
    speeding = np.abs(c.a[at, joint])
    torque = np.abs(compute_inertial_torque(state, c.q[at], c.a[at, joint], joint))
    with np.errstate(divide="ignore"):
        jump = friction[joint] / torque
        late = (
            compute_smear(filtering) * jump * np.where(is_timed(state)[joint], jump, 1.0)
            + c.rate_std[joint] / speeding
        )
    late += delays[joint]
    error = 2 * friction[joint] * late * 2 * filtering.cutoff
    out[at, joint] = error <= TURN_ERROR * np.array(floors)[joint]
    if c.lost is not None:
        out &= ~dilate_flags(c.lost[:, None], reach)
    return out


def is_timed(state: State) -> Flags:
    """Whether no more is left of a joint than a sensor's noise may be, (n,)."""
    return np.asarray(state.fit.dispersion <= LARGEST_DISPERSION)


def find_shifts(state: State) -> Array:
    """``|δ_j|`` of ``r_j = δ_j dτ_j/dt``: time by which a joint's torque acts sooner or later than it is taken to, s.

    As of a measured torque, which is held by nobody, or of a late drive; zero where it is not sure. (n,)
    """
    now = state.fit
    evidence = state.problem.evidence
    n = evidence.rig.n
    out = np.zeros(evidence.rig.n)
    for j in range(n):
        rising = [np.gradient(x[:, j], part.dt) for x, part in zip(state.torque, evidence.parts)]
        column = evidence.whiten(rising, j) * now.scale[j]
        left = now.residual[j::n]
        basis = now.basis[j::n]
        alone = column - basis @ (basis.T @ column)
        delay = float(column @ left) / max(float(column @ alone), 1e-300)
        scores = np.add.reduceat(alone * (left - delay * alone), now.starts // n)
        sure = abs(float(column @ left)) > LATE_DEVIATIONS * float(np.linalg.norm(scores))
        out[j] = abs(delay) if sure else 0.0
    return out


def compute_smear(filtering: Filtering) -> float:
    """``SMEAR/(2π f_c)`` of the channels' smoother, s."""
    return SMEAR / (2 * np.pi * filtering.cutoff * filtering.smoothing)


def compute_corners(
    part: LogStretch, turns: Flags, state: State, friction: Array, filtering: Filtering
) -> Array:
    """What the smoother takes off the rates about some turns, rad/s, (m, n): ``(SMEAR F_c/(2π f_c) sign a + p)/I``.

    Friction that changes by 2 F_c lets the acceleration jump, unless the torque jumps as much the other way: p is what
    the smoother takes off the torque's impulse. Without p the smoothed rate is zero late by F_c/T of its time.
    """
    c = part.channels
    out = np.zeros(part.channels.v.shape)
    at, joint = np.nonzero(
        dilate_flags(turns, count_smoother_memory(c, filtering)) & is_timed(state)
    )
    inertia = np.abs(compute_inertial_torque(state, c.q[at], np.ones(len(at)), joint))
    lost = (
        compute_smear(filtering) * friction[joint] * np.sign(c.a[at, joint])
        + part.impulse[at, joint]
    )
    out[at, joint] = lost / inertia
    return out


def compute_inertial_torque(state: State, q: Array, a: Array, joint: NDArray[np.intp]) -> Array:
    """Torque of one joint's own inertia at samples (k,), N m, (k,): q (k, n), that joint's acceleration (k,)."""
    rows = np.arange(len(q))
    alone = np.zeros_like(q)
    alone[rows, joint] = a
    still = np.zeros_like(q)
    return np.asarray(
        (compute_rnea(state.rig, q, still, alone) - compute_rnea(state.rig, q, still, still))[
            rows, joint
        ]
    )


def open_gate(part: LogStretch, turns: Flags, filtering: Filtering) -> LogStretch:
    """Open the gate at some turns; elsewhere, and where it was shut for what lies between these samples, it stays."""
    c = part.channels
    still = find_slow_samples(part.channels, CLEAR)
    reach = count_smoother_memory(c, filtering)
    taper = round(TAPER / filtering.cutoff / part.dt)
    shut, open_ = (
        build_mask(dilate_flags(where, reach), taper) for where in (still, still & ~turns)
    )
    edges = compute_fade(len(still), int(np.ceil(compute_settling_time(filtering) / part.dt)))[
        :, None
    ]
    return part._replace(
        gate=np.asfortranarray(np.minimum(part.gate + (open_ - shut) * edges, 1.0))
    )
