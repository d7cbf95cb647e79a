"""The least error that a torque limit leaves of a joint that its motion asks too much of, whoever controls it."""

from __future__ import annotations

import numpy as np

from gimbal_pin.log.log import Array

LONGEST = 600
"""Samples of the longest stretch that is worked out, in about a second."""


def least(dt: float, asked: Array, limit: float, answer: Array, first: int) -> Array:
    """``min Σ e²`` over all torques within the limit, ``ë = b (τ - τ_d)``: a bounded least-squares problem.

    No law of any kind gets below it, unless other joints turn the camera in this one's stead, which tilts the horizon:
    each of them is granted all the torque that it takes to stay.

    Args:
        dt: Sampling interval, s.
        asked: τ_d, torque that follows the motion exactly, N m, (N,).
        limit: Largest torque, N m.
        answer: b, acceleration of what is to be kept still, per torque, 1/(kg m²), (N,).
        first: Sample before which nothing is foreseen, so that e is zero until then; 0: the whole motion is known.

    Returns:
        The error at the end of every interval, rad, (N,).
    """
    from scipy.optimize import lsq_linear

    n = len(asked)
    lowest, highest = -limit - asked, limit - asked
    # Bounds must leave room: this much torque is nothing.
    none = 1e-9 * limit
    lowest[:first], highest[:first] = -none, none
    summed = np.tril(np.ones((n, n)))
    moved = dt**2 * (summed @ summed - summed / 2) * answer
    found = lsq_linear(moved, np.zeros(n), (lowest, np.maximum(highest, lowest + none)), tol=1e-10)
    return np.asarray(moved @ found.x)
