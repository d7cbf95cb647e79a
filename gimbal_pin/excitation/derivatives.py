"""Derivatives over whole trajectories: of RNEA by Pinocchio, of anything that works sample by sample by differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array, Motion

STEP = 1e-5
"""Half width of the difference: exact to rounding for what is linear (friction), to 1e-10 for what is smooth."""


def rnea_slopes(model: pin.Model, motion: Motion) -> Array:
    """``d tau_j / d(q, v, a)_i`` of RNEA along a motion, (3, N, n, n); any inertial parameters, physical or not.

    Carpentier and Mansard 2018 (`pin.computeRNEADerivatives`).
    """
    data = model.createData()
    n = motion.q.shape[1]
    out = np.empty((3, len(motion), n, n))
    compute = pin.computeRNEADerivatives
    for dq, dv, da, q, v, a in zip(*out, motion.q, motion.v, motion.a):
        dq[...], dv[...], da[...] = compute(model, data, q, v, a)
    upper = np.triu(out[2])
    out[2] = upper + np.swapaxes(np.triu(upper, 1), -1, -2)
    return out


def slopes(function: Callable[..., Array], arguments: Sequence[Array]) -> list[Array]:
    """Central differences of a function that works sample by sample, one array per argument, each of its shape."""
    out: list[Array] = []
    for k in range(len(arguments)):
        ahead, behind = list(arguments), list(arguments)
        ahead[k], behind[k] = arguments[k] + STEP, arguments[k] - STEP
        out.append((function(*ahead) - function(*behind)) / (2 * STEP))
    return out
