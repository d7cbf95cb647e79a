"""What acts only in the held-out part: a model that fits where it was fitted, and fails where nothing was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.heldout import torque_error
from gimbal_pin.diagnosis.leftover import Residual
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.log import Array

TENFOLD = 100.0
"""Power of the held-out error over what was to be expected from which something else acts there."""
ONLY = "in the held-out part only"
"""Where such structure is said to be."""


def surprising(left: Sequence[Residual], state: State, held: Evidence) -> tuple[Residual, ...]:
    """What is left at each joint, structured where noise on the training part does not account for the held-out error.

    Nothing was looked for there, so it has no name; that nothing is wrong could not be said either.
    """
    ratios = surprise(state, held).tolist()
    return tuple(
        replace(one, state="structured", where=ONLY) if one.state == "noise" and ratio > TENFOLD else one
        for one, ratio in zip(left, ratios)
    )


def surprise(state: State, held: Evidence) -> Array:
    """``mean r_j² / (φ_j + mean a_j (AᵀWA)⁻¹ a_jᵀ)`` of each joint's whitened held-out error r, (n,).

    The second term is how far the fitted coefficients' own errors reach on this motion: one that shows what the
    training part hardly did is predicted badly by a true model, too.
    """
    n, model = held.rig.n, extended(state)
    errors = [torque_error(part, model) for part in held.parts]
    white = held.whiten_all(errors)
    there = solved(Problem.of(held, state.problem.reduction), state.causes).fit
    rows = there.stack.reshape(held.rows, n, -1) / there.scale[:, None]
    used = np.maximum(held.used() * held.rows, 1.0)
    reach = np.einsum("rjk,kl,rjl->j", rows, state.fit.information, rows, optimize=True) / used
    return np.asarray(np.sum(white**2, axis=0) / used / (state.fit.dispersion + reach))
