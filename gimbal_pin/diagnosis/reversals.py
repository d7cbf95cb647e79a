"""Turns swift enough to count: where a joint reverses under torques far beyond its dry friction, drives show limits.

Near standstill the direction of dry friction is unknown, and the gate is closed. How wrong a turn can be is known once
the friction is: it changes by 2 F_c at a moment that is off by Δt, which no row sees if that is under its noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.evidence import CLEAR, TAPER, Evidence, Part, compute_fade
from gimbal_pin.diagnosis.state import State
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
QUIET = 0.5
"""Error that a turn may add to a row, in deviations of its noise."""


def open_turns(evidence: Evidence, state: State, filtering: Filtering) -> Evidence:
    """Return logs with the gate open where joints turn round so that friction's direction adds no error that shows.

    ``2 F_c Δt · 2 band ≤ QUIET σ_row`` with ``|a| Δt = SMEAR/(2π f_c) F_c/I + σ_v``: friction makes the acceleration
    jump by 2 F_c/I, which shifts the moment at which the smoothed rate is zero, and the rate's noise shifts it by the
    rest.

    Args:
        evidence: The logs.
        state: What was fitted away from their turns.
        filtering: The band.
    """
    problem, first = state.problem, len(state.problem.reduction.independent)
    friction = np.zeros(evidence.rig.n)
    for effect, value in zip(problem.friction, state.fit.theta[first:].tolist()):
        if effect.dry:
            friction[evidence.rig.joint_index(effect.joint)] = abs(value)
    inertia = np.maximum(np.abs(problem.motion.inertia @ state.fit.theta[:first]), 1e-300)
    smear = SMEAR / (2 * np.pi * filtering.cutoff * filtering.smoothing) * friction / inertia
    least = 4 * filtering.cutoff * friction / [QUIET * evidence.noise_floor(j) for j in range(evidence.rig.n)]
    parts = []
    for part in evidence.parts:
        swift = np.abs(part.channels.a) >= least * (smear + part.channels.rate_std)
        parts.append(_open_gate(part, _find_turns(part, filtering) & swift, filtering))
    return replace(evidence, parts=tuple(parts))


def _find_turns(part: Part, filtering: Filtering) -> Flags:
    """Whether a joint turns round at a sample: its rate has another sign after it than before, beyond doubt, (m, n)."""
    c, reach = part.channels, count_smoother_memory(part.channels, filtering)
    turning = np.zeros(c.v.shape, dtype=bool)
    before, after = c.v[: -2 * reach], c.v[2 * reach :]
    sure = np.minimum(np.abs(before), np.abs(after)) > CLEAR * c.rate_std
    turning[reach:-reach] = (before * after < 0) & sure
    if c.lost is not None:
        turning &= ~dilate_flags(c.lost[:, None], reach)
    return np.asarray(turning & find_slow_samples(c, CLEAR))


def _open_gate(part: Part, turns: Flags, filtering: Filtering) -> Part:
    """Open the gate at some turns; elsewhere, and where it was shut for what lies between these samples, it stays."""
    c, still = part.channels, find_slow_samples(part.channels, CLEAR)
    reach, taper = count_smoother_memory(c, filtering), round(TAPER / filtering.cutoff / part.dt)
    shut, open_ = (build_mask(dilate_flags(where, reach), taper) for where in (still, still & ~turns))
    edges = compute_fade(len(still), int(np.ceil(compute_settling_time(filtering) / part.dt)))[:, None]
    return part._replace(gate=np.asfortranarray(np.minimum(part.gate + (open_ - shut) * edges, 1.0)))
