"""Spectrum of the noise: what a cross-validated regression on everything leaves, and the assumed error of form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.candidates import list_candidates
from gimbal_pin.diagnosis.library import project_candidates
from gimbal_pin.diagnosis.problem import (
    Problem,
    Whitening,
    build_base_rows,
    build_precision,
)
from gimbal_pin.diagnosis.rows import Indices
from gimbal_pin.diagnosis.structure import compute_smooth_functions
from gimbal_pin.log.log import Array

MOST_FREQUENCIES = 24
"""Most frequencies of the spectrum: half a hertz apart in a band of 12 Hz."""
FEWEST_FREQUENCIES = 8
"""Fewest frequencies: the spectrum of a short log is not known better."""
ROWS_PER_FREQUENCY = 20
"""Periods of a frequency's band within the log per estimated frequency: its power is known to a fourth."""
RIDGES = (10.0, 300.0)
"""Ridges on the further columns of unit rms that are compared: as many rows' worth of evidence for zero."""
NOISE_FOLDS = 8
"""Folds of that comparison."""
LEAST_POWER = 1e-4
"""Least power at a frequency, as a share of the largest: rounding has no spectrum."""
USED_LITTLE = 1e-6
"""Mean squared weight below which a joint stands throughout."""
LEFT_SHARE = 0.05
"""Share of a candidate's rms beside the base from which it may be used: less is rounding of the base's columns."""
ASSUMED_NOISE = 0.03
"""Noise that the prior of base parameters is weighed against, as a share of the torque's rms."""


def estimate_noise(problem: Problem, torque: Sequence[Array]) -> Whitening:
    """Estimate the noise's spectrum at each joint, ``S = R + form_error² P``.

    R is the spectrum of what the regression leaves, P that of the torque which it predicts. Nothing smaller than
    `Settings.form_error` of the torque can then buy a cause.

    Args:
        problem: The rows.
        torque: A model's own torque along each stretch, N m, (m, n).
    """
    rows = problem.rows
    count = int(min(MOST_FREQUENCIES, rows.seconds * rows.band / ROWS_PER_FREQUENCY))
    frequencies = np.linspace(0.0, rows.band, max(FEWEST_FREQUENCIES, count))
    fade = np.clip((rows.band - frequencies) / (0.25 * rows.band), 0.0, 1.0)
    root = np.sqrt(0.5 - 0.5 * np.cos(np.pi * fade))
    base = build_base_rows(problem, torque, ())
    gains = np.zeros((rows.rig.n, len(frequencies)))
    floor = np.zeros(rows.rig.n)
    for j in problem.joints:
        if rows.used[j] < USED_LITTLE:
            continue
        left = _regress_on_everything(problem, base[j], torque, j)
        floor[j] = np.sqrt(np.mean(left[rows.inner] ** 2) / rows.used[j])
        # Rows for the shown figures alone say nothing here either.
        kept = rows.inner / np.mean(rows.inner)
        spectrum = rows.estimate_spectrum(kept * left, j, frequencies)
        predicted = rows.estimate_spectrum(kept * (problem.measured[:, j] - left), j, frequencies)
        power = spectrum + problem.settings.form_error**2 * predicted
        gains[j] = root / np.sqrt(np.maximum(power, LEAST_POWER * power.max()))
    return Whitening(frequencies, gains, floor)


def _regress_on_everything(
    problem: Problem, base: Array, torque: Sequence[Array], joint: int
) -> Array:
    """Return what the best regression leaves of a joint's torque, held out, (N,)."""
    rows = problem.rows
    y = problem.target[:, joint]
    norms = np.linalg.norm(base, axis=0)
    kept = norms > 0
    rms = float(problem.torque_rms[joint])
    precision = build_precision(problem, ())[kept] / norms[kept] ** 2
    own_ridge = precision * (ASSUMED_NOISE * rms) ** 2 + 1e-9
    own = base[:, kept] / norms[kept]
    candidates = [
        one
        for one in list_candidates(problem.rig, joint, problem.ranges[joint])
        if one.name != "joint-flexibility"
    ]
    columns = project_candidates(problem, candidates, joint, torque)
    seen = rows.inner
    best = _choose_columns(columns[seen], own[seen], y[seen], problem.settings.noise_candidates)
    smooth = compute_smooth_functions(problem, joint, torque)
    further = np.hstack([rows.project(smooth, joint), columns[:, best]])
    further = further / (np.sqrt(np.mean(further**2, axis=0)) + 1e-300)
    # Shown blocks are predicted by all folds, so that the spectrum has no gaps.
    fold = np.full(len(rows.inner), -1)
    fold[rows.inner] = rows.fold_of_rows % NOISE_FOLDS
    left = _hold_out(own, y, own_ridge, fold)
    both = np.hstack([own, further])
    for ridge in RIDGES:
        penalty = np.r_[own_ridge, np.full(further.shape[1], ridge)]
        tried = _hold_out(both, y, penalty, fold)
        if tried[rows.inner] @ tried[rows.inner] < left[rows.inner] @ left[rows.inner]:
            left = tried
    return left


def _choose_columns(columns: Array, base: Array, y: Array, count: int) -> Indices:
    """Return the places of the columns that explain most of y beside the base."""
    left, size, _ = np.linalg.svd(base, full_matrices=False)
    basis = left[:, size > 1e-6 * size[0]]
    rest = columns - basis @ (basis.T @ columns)
    residual = y - basis @ (basis.T @ y)
    norms = np.linalg.norm(rest, axis=0)
    usable = norms > LEFT_SHARE * np.linalg.norm(columns, axis=0)
    worth = np.abs(rest.T @ residual) / np.where(usable, norms, np.inf)
    return np.argsort(-worth)[:count]


def _hold_out(columns: Array, y: Array, penalty: Array, fold: Array) -> Array:
    """Return y less its prediction by a ridge regression without each row's own fold."""
    gram = columns[fold >= 0].T @ columns[fold >= 0]
    right = columns[fold >= 0].T @ y[fold >= 0]
    left = np.empty_like(y)
    for k in np.unique(fold):
        own = fold == k
        less = columns[own].T @ columns[own] if k >= 0 else 0.0
        taken = columns[own].T @ y[own] if k >= 0 else 0.0
        values = np.linalg.solve(gram - less + np.diag(penalty), right - taken)
        left[own] = y[own] - columns[own] @ values
    return left
