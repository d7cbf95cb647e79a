"""The noise's spectrum from the data, and rows whitened by it.

Third differences of a torque tell its noise only where that is white. Drives filter and quantise their currents, and
their noise lies within the motion's band: its spectrum is taken from the residual of a cross-validated ridge over the
rigid model (free), all candidate columns and δ, so that what any of them could explain is not whitened away.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.engine.discrepancy import features, unseen
from gimbal_pin.diagnosis.evidence import Evidence, LogStretch, compute_band_edge
from gimbal_pin.diagnosis.state import Problem, State, solve_causes
from gimbal_pin.log.log import Array

WHITENING_ROUNDS = 2
"""Rounds: the second ridge is fitted to rows that the first's spectrum has whitened."""
SMOOTHED_FREQUENCIES, SMOOTHED_SHARE = 8, 0.15
"""Frequencies to either side over which a spectrum is smoothed: so many, or that share of those below, if more."""


def remove_whitening(evidence: Evidence) -> Evidence:
    """Return the evidence with the band's edge as its only filter: rows in N m."""
    edges = [edge_of(evidence, part) for part in evidence.parts]
    parts = [
        p._replace(whitener=np.tile(edge, (evidence.rig.n, 1)))
        for p, edge in zip(evidence.parts, edges)
    ]
    return replace(evidence, parts=tuple(parts))


def edge_of(evidence: Evidence, part: LogStretch) -> Array:
    """Return the gain by which a part's band fades at its upper end, (f,)."""
    return compute_band_edge(
        fft.rfftfreq(len(part.gate), part.dt)[: part.whitener.shape[1]], evidence.band
    )


def whitened(evidence: Evidence, noise: Sequence[Array]) -> Evidence:
    """Return flat evidence whitened by the noise's power at each frequency, (N m)², (n, f) for each part."""
    parts = [
        part._replace(whitener=part.whitener / np.sqrt(power))
        for part, power in zip(evidence.parts, noise)
    ]
    return replace(evidence, parts=tuple(parts))


def rewhitened_problem(problem: Problem, new: Evidence) -> Problem:
    """Return a problem with the same rigid columns, whitened by other evidence."""
    return replace(problem, evidence=new, rigid=new.rewhiten(problem.rigid, problem.evidence, None))


def coloured(problem: Problem, state: State, candidates: Sequence[Columns]) -> Problem:
    """Return a flat problem whitened by the noise's spectrum.

    Args:
        problem: The logs, whitened by nothing but the band's edge: see `remove_whitening`.
        state: A model of it; its causes are refitted.
        candidates: Columns of all candidates in the flat problem, built from the model's torque: none of the measured
            one's noise is in them.
    """
    evidence = problem.evidence
    now = problem
    n = evidence.rig.n
    every = [[c.at(j).own for c in candidates if c.joint in (None, j)] for j in range(n)]
    flexible = [
        np.concatenate([*own, features(evidence, state.torque, j)], axis=1)
        for j, own in enumerate(every)
    ]
    for _ in range(WHITENING_ROUNDS):
        fitted = solve_causes(now, state.causes, state)
        power: list[list[Array]] = []
        for j in range(n):
            rows = fitted.fit.rows(j)
            used = float(now.evidence.used[j])
            stack, target = (
                x[rows] / fitted.fit.scale[j] for x in (fitted.fit.stack, fitted.fit.target)
            )
            error = unseen(
                stack, now.evidence.rewhiten(flexible[j], evidence, j), target, now.evidence.block
            )
            noise = spectra(error, now.evidence, j, exponential)
            shares = fitted.pass_all_noise(
                j
            )  # the noise is the measured torque's, before the drives' signals
            power.append([x / p / max(used, 1e-3) for x, p in zip(noise, shares)])
        now = rewhitened_problem(
            problem, whitened(evidence, [np.stack(each) for each in zip(*power)])
        )
    return now


def spectra(
    signal: Array, evidence: Evidence, joint: int, average: Callable[[Array], Any]
) -> list[Array]:
    """Return the smooth spectrum of one joint's rows before they were whitened, (N m)², (f,) for each part.

    Where the band's edge takes off more than half the noise is as where it begins to: of the rest little is left.
    """
    out = []
    first = 0
    for part in evidence.parts:
        rows = signal[first : first + part.rows]
        first += part.rows
        gain = part.whitener[joint]
        inside = int(np.sum(edge_of(evidence, part) >= 0.5))
        power = np.abs(fft.rfft(rows)[:inside]) ** 2 / part.rows / gain[:inside] ** 2
        out.append(np.pad(smooth(power, average), (0, len(gain) - inside), mode="edge"))
    return out


def exponential(power: Array) -> float:
    """Return the mean of a noise's power at some frequencies, exponentially distributed: its median over ``ln 2``.

    A line, which no noise has, does not move a median, and stays to be seen.
    """
    return float(np.median(power) / np.log(2))


def smooth(power: Array, average: Callable[[Array], Any]) -> Array:
    """Return a smooth spectrum: averages over a width that grows with frequency, smoothed once more."""
    count = len(power)
    wide = np.maximum(SMOOTHED_FREQUENCIES, (SMOOTHED_SHARE * np.arange(count)).astype(int))
    ends = [(max(k - w, 0), min(k + w + 1, count)) for k, w in enumerate(wide.tolist())]
    rough = np.array([average(power[low:high]) for low, high in ends])
    means = [
        np.mean(rough[max(k - w // 2, 0) : k + w // 2 + 1]) for k, w in enumerate(wide.tolist())
    ]
    return np.maximum(means, 1e-30)
