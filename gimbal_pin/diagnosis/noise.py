"""Spectrum of the noise: what a cross-validated regression on everything leaves, and the assumed error of form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.candidates import list_candidates
from gimbal_pin.diagnosis.library import project_candidates
from gimbal_pin.diagnosis.problem import (
    FIRST_NOISE,
    Problem,
    Whitening,
    build_base_rows,
    build_precision,
)
from gimbal_pin.diagnosis.rows import FADE_SHARE
from gimbal_pin.diagnosis.structure import GROUPS, hold_out, list_surroundings, project_functions
from gimbal_pin.log.log import Array

FREQUENCIES = 8, 24
"""Fewest and most frequencies of the spectrum: half a hertz apart in a band of 12 Hz."""
ROWS_PER_FREQUENCY = 20
"""Periods of a frequency's band within the log per estimated frequency: its power is known to a fourth."""
RIDGES = (10.0, 300.0)
"""Ridges on the further columns of unit rms that are compared: as many rows' worth of evidence for zero."""
FOLDS = 8
"""Folds of that comparison: it needs no standard error, and fewer take less time."""
LEAST_POWER = 1e-4
"""Least power at a frequency, as a share of the largest: rounding has no spectrum."""
SMOOTH = (
    "angle",
    "angle by direction",
    "rate",
    "load",
    "slow time",
    "torques over angle",
    "other joints",
    "other torques",
)
"""Groups of the flexible model in the regression: with all of them a joint's held-out error rose from 9 to 15 %."""


def estimate_noise(problem: Problem, torque: Sequence[Array]) -> Whitening:
    """Estimate the noise's spectrum at each joint, ``S = R + share² P``.

    R is the spectrum of what the regression leaves, P that of the torque which it predicts. Nothing smaller than
    `Settings.material_share` of the torque can then buy a cause.

    Args:
        problem: The rows.
        torque: A model's own torque along each stretch, N m, (m, n).
    """
    rows = problem.rows
    count = int(np.clip(rows.seconds * rows.band / ROWS_PER_FREQUENCY, *FREQUENCIES))
    frequencies = np.linspace(0.0, rows.band, count)
    fade = np.clip((rows.band - frequencies) / (FADE_SHARE * rows.band), 0.0, 1.0)
    root = np.sqrt(0.5 - 0.5 * np.cos(np.pi * fade))
    base = build_base_rows(problem, torque, ())
    gains = np.zeros((rows.rig.n, count))
    floor = np.zeros(rows.rig.n)
    # Rows for the shown figures alone say nothing here either.
    kept = rows.inner / np.mean(rows.inner)
    for j in np.flatnonzero(rows.used).tolist():
        residual = _regress_on_everything(problem, base[j], torque, j)
        floor[j] = np.sqrt(np.mean(residual[rows.inner] ** 2) / rows.used[j])
        predicted = problem.scale[:, j] - residual
        noise, form = (
            rows.estimate_spectrum(kept * x, j, frequencies) for x in (residual, predicted)
        )
        power = noise + problem.settings.material_share**2 * form
        gains[j] = root / np.sqrt(np.maximum(power, LEAST_POWER * power.max()))
    return Whitening(frequencies, gains, floor)


def _regress_on_everything(
    problem: Problem, base: Array, torque: Sequence[Array], joint: int
) -> Array:
    """Return what the best regression leaves of a joint's torque, held out, (N,)."""
    rows = problem.rows
    y = problem.target[:, joint]
    kept = base.any(axis=0)
    norms = np.linalg.norm(base[:, kept], axis=0)
    base = base[:, kept] / norms
    noise = (FIRST_NOISE * float(problem.torque_rms[joint])) ** 2
    prior = build_precision(problem, ())[kept] / norms**2 * noise + 1e-9
    candidates = [
        x
        for x in list_candidates(problem.rig, joint, problem.ranges[joint])
        if x.name != "joint-flexibility"
    ]
    columns = project_candidates(problem, candidates, joint, torque)
    least = problem.settings.min_left_share
    worth = _measure_worth(columns[rows.inner], base[rows.inner], y[rows.inner], least)
    best = np.argsort(-worth)[: problem.settings.noise_candidates]
    states = list_surroundings(problem, joint, torque)
    smooth = project_functions(problem, joint, states, {name: GROUPS[name] for name in SMOOTH})
    further = np.hstack([columns[:, best], *smooth.values()])
    further /= np.sqrt(np.mean(further**2, axis=0)) + 1e-300
    # Shown blocks are predicted by all folds, so that the spectrum has no gaps.
    fold = np.full(len(rows.inner), -1)
    fold[rows.inner] = rows.fold_of_rows % FOLDS
    tried = [hold_out(base, y, prior, fold)]
    for ridge in RIDGES:
        penalty = np.r_[prior, np.full(further.shape[1], ridge)]
        tried.append(hold_out(np.hstack([base, further]), y, penalty, fold))
    return min(tried, key=lambda residual: float(np.sum(residual[rows.inner] ** 2)))


def _measure_worth(columns: Array, base: Array, y: Array, least: float) -> Array:
    """Return how much of y each column explains beside the base; 0 where too small a share of its power is left."""
    stacked = np.column_stack([y, columns])
    rest = stacked - base @ np.linalg.lstsq(base, stacked, rcond=1e-6)[0]
    norms = np.linalg.norm(rest[:, 1:], axis=0)
    usable = norms**2 > least * np.sum(columns**2, axis=0)
    return np.asarray(np.abs(rest[:, 0] @ rest[:, 1:]) / np.where(usable, norms, np.inf))
