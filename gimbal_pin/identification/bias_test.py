"""Is least squares biased on this log? The test of Durbin, Wu and Hausman against instrumental variables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from gimbal_pin.errors import DataError
from gimbal_pin.identification.output_error import build_instruments
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    Block,
    DesignBlocks,
    Filtering,
    compute_blocks,
    compute_moments,
    compute_score_covariance,
    fit_instrumental,
    fit_physical,
    fit_residual_noise,
    join_blocks,
    join_columns,
    solve_moments,
    weigh_joints,
)

LEVEL = 0.01
"""Chance that a log on which least squares is not biased is called biased."""
ADMISSIBLE = 0.5
"""Bias that least squares may have, in its own standard deviations: less than this nobody could see."""
RANK = 1e-6
"""Directions of less than this share of the largest variance, in units of each parameter's own, are not judged."""
NOISY = 0.03
"""Noise of the acceleration, as a share of it, from which the test is worth its time: bias goes with its square."""
UNBIASED = ("instrumental", "output-error")
"""Estimators that noise in the motion does not bias."""
LEAST = 0.1
"""Least share of what the rates show that is taken for motion, where nearly all of it is noise."""
BEYOND = 10.0
"""Change of the torque, in squared shares of noise, that noise alone does not make: at most three are usual."""
DENSEST = 25.0
"""Most that an encoder's slow steps count by: a joint that stands has hardly any."""
EXAMINED = 60.0
"""Time of the first log on which least squares is tested, s: a longer one costs more than it says."""


@dataclass(frozen=True)
class Hausman:
    """What the test says.

    Attributes:
        statistic: ``dᵀ P⁻¹ d``, d the difference of the two estimates and P its covariance.
        freedom: Number of its directions; without bias the statistic is χ² of so many degrees of freedom.
        p_value: Chance of a larger statistic without bias.
        change: Torque that the difference changes, as a share of its rms, in the worst joint.
    """

    statistic: float
    freedom: int
    p_value: float
    change: float

    @property
    def biased(self) -> bool:
        """Whether least squares is biased, at the `LEVEL`."""
        return self.p_value < LEVEL

    @property
    def finding(self) -> str:
        """What it says."""
        chance = f"p = {self.p_value:.2g}" if self.p_value > 1e-12 else "p < 1e-12"
        if not self.biased:
            return f"least squares shows no bias on this log ({chance})"
        shift = f"{100 * self.change:.2g} % of the torque"
        return f"least squares is biased on this log by noise in the motion ({chance}, {shift})"

    @property
    def sentence(self) -> str:
        """What it says, and what to use instead."""
        mend = ": use --estimator output-error or instrumental, or a lower cutoff" if self.biased else ""
        return self.finding + mend

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return {**asdict(self), "level": LEVEL, "biased": self.biased, "sentence": self.sentence}


def compare_with_instruments(blocks: Sequence[Block], instruments: Sequence[Array]) -> Hausman:
    """Test ``E Aᵀe = 0`` by what instruments say instead (Durbin 1954; Wu 1973; Hausman 1978).

    Both estimates take the same weights, so that their difference is linear in the residual,
    ``d = Σ ((ZᵀWA)⁻¹Zᵀ - (AᵀWA)⁻¹Aᵀ) W e``, and its covariance follows from the residual's colour: least squares need
    not be efficient. A model that is wrong in the same way along both motions changes both estimates alike, and that is
    no bias. Every encoder biases least squares by something, and without any noise the smallest something is
    significant: so the question is for a bias of more than `ADMISSIBLE` of least squares' own deviations, and their
    covariance times its square is added.

    `instruments`: per block its Z, (m, n, k).
    """
    found = fit_instrumental(blocks, instruments)
    weight = weigh_joints(found.residual_std**2) ** 2
    gains, thetas = [], []
    for columns in (instruments, [block.A for block in blocks]):
        target = sum((np.einsum("tjk,j,tj->k", z, weight, block.b) for z, block in zip(columns, blocks)), 0.0)
        theta, gain, _ = solve_moments(
            compute_moments([(z, b.A) for z, b in zip(columns, blocks)], weight), np.asarray(target)
        )
        gains.append(gain)
        thetas.append(theta)
    noise = fit_residual_noise(blocks, instruments, thetas[0], gains[0], weight).processes
    apart = [z @ gains[0].T - block.A @ gains[1].T for z, block in zip(instruments, blocks)]
    score = compute_score_covariance([block.A for block in join_blocks(blocks)], noise, weight).sum(axis=0)
    spread = compute_score_covariance(join_columns(blocks, apart), noise, weight).sum(axis=0)
    spread = spread + ADMISSIBLE**2 * gains[1] @ score @ gains[1].T
    return _test_difference(thetas[0] - thetas[1], spread, blocks)


def _test_difference(difference: Array, spread: Array, blocks: Sequence[Block]) -> Hausman:
    """Return the test of a difference, (k,), with its covariance, (k, k)."""
    from scipy.stats import chi2

    std = np.sqrt(np.diag(spread))
    unit = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(spread / np.outer(unit, unit))
    kept = values > RANK * values[-1]
    statistic = float(np.sum((vectors[:, kept].T @ (difference / unit)) ** 2 / values[kept])) if std.any() else 0.0
    freedom = int(np.sum(kept)) if std.any() else 0
    moved = np.sum([np.sum((block.A @ difference) ** 2, axis=0) for block in blocks], axis=0)
    torque = np.sum([np.sum(block.b**2, axis=0) for block in blocks], axis=0)
    share = np.sqrt(moved / np.where(torque > 1e-6 * torque.max(), torque, np.inf))
    return Hausman(statistic, freedom, float(chi2.sf(statistic, freedom)) if freedom else 1.0, float(share.max()))


WhenTested = Literal["never", "noisy", "always"]
"""When the test is run: it takes twice the time of the fit itself."""


@dataclass(frozen=True)
class BiasCheck:
    """What is known of least squares' bias.

    Attributes:
        noise: Noise of the filtered acceleration over its rms, in the worst joint of the first log.
        test: Durbin, Wu and Hausman's; None where it was not run.
        why: Why it was not run, or could not be.
        method: The estimator that was used.
    """

    noise: float
    test: Hausman | None
    why: str = ""
    method: str = ""

    @property
    def by_noise(self) -> bool:
        """Whether the sensors' noise is enough to make the difference that the test sees."""
        return self.test is not None and self.test.change <= BEYOND * self.noise**2

    @property
    def sentence(self) -> str:
        """What is known, and what to use instead."""
        if self.test is None:
            return self.why
        if self.test.biased and self.by_noise and self.method in UNBIASED:
            return f"{self.test.finding}: {self.method}, which was used, is not"
        if not self.test.biased or self.by_noise:
            return self.test.sentence
        shift, little = f"{100 * self.test.change:.2g} % of the torque", f"{100 * self.noise:.2g} % of the acceleration"
        return (
            f"least squares and instrumental variables disagree by {shift}, more than the sensors' noise ({little}) "
            "explains: the model misses something, see 'gimbal-pin diagnose'"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds; `biased` is null where the test was not run."""
        empty = dict.fromkeys(("statistic", "freedom", "p_value", "change", "level", "biased"))
        said = empty if self.test is None else self.test.to_dict()
        return {"noise_share": self.noise, **said, "by_noise": self.by_noise, "sentence": self.sentence}


def check_bias(blocks: DesignBlocks, asked: WhenTested, method: str = "") -> BiasCheck | None:
    """Test least squares if asked to; None for "never".

    The instruments are simulated with bodies fitted to the same rows.

    `method` was used: an estimator without bias is not advised to those who took it.
    """
    if asked == "never":
        return None
    rows, first = blocks.design, blocks.design.logs[0]
    noise = compute_noise_share(first, rows.filtering, blocks)
    if asked == "noisy" and noise < NOISY:
        little = f"the sensors' noise is {100 * noise:.2g} % of the motion's acceleration, too little to bias"
        return BiasCheck(noise, None, f"{little} least squares (--bias tests it all the same)", method)
    some = first.part(slice(0, int(np.searchsorted(first.t, first.t[0] + EXAMINED))))
    judged = blocks if len(rows.logs) == 1 and len(some) == len(first) else compute_blocks(replace(rows, logs=(some,)))
    try:
        test = compare_with_instruments(judged, build_instruments(judged, fit_physical(judged)))
        return BiasCheck(noise, test, method=method)
    except DataError as error:
        return BiasCheck(noise, None, f"whether least squares is biased cannot be tested: {error}", method)


def compute_noise_share(log: Log, filtering: Filtering, blocks: Sequence[Block]) -> float:
    """Noise of the acceleration below the cutoff over the acceleration's own rms, in the worst joint that moves.

    From the angle's noise differentiated twice or, where there is one, the rate's differentiated once, by whichever
    says less; the motion's from the rows' rates, less what the noise that passes the smoothing adds to them.
    """
    fine = signals.noise_std(log.q)
    noise = _compute_motion_noise(log, filtering.cutoff, np.maximum(fine, _compute_step_noise(log.q)))
    smoothed = _compute_motion_noise(log, filtering.cutoff * filtering.smoothing, fine)
    parts = [np.diff(part.v, axis=0) / np.diff(part.t)[:, None] for part in join_blocks(blocks)]
    total = np.mean(np.concatenate(parts) ** 2, axis=0)
    step = 1.0 / (2 * filtering.cutoff)
    size = np.sqrt(np.maximum(total - 2 * (smoothed[0] / step) ** 2, LEAST**2 * total))
    moving = size > 0
    return float(np.max(noise[1][moving] / size[moving], initial=0.0))


def _compute_step_noise(q: Array) -> Array:
    """White noise of the density that an encoder's steps have where most samples repeat the one before, rad, (n,).

    Differences of the samples see none of it: from step to step the reading does not change, and the error is a
    sawtooth as slow as the steps. Its power, a twelfth of the step's square, lies below their rate, not Nyquist's.
    """
    jumps = np.abs(np.diff(q, axis=0))
    share = np.mean(jumps > 0, axis=0)
    step = np.array([np.median(one[one > 0]) if one.any() else 0.0 for one in jumps.T])
    denser = np.sqrt(np.clip(0.5 / np.maximum(share, 1e-300), 1.0, DENSEST))
    return np.asarray(np.where(share < 0.5, step / np.sqrt(12.0) * denser, 0.0))


def _compute_motion_noise(log: Log, cutoff: float, angle: Array) -> tuple[Array, Array]:
    """Standard deviations of the rate's and of the acceleration's noise below a cutoff, rad/s and rad/s², (n,) each.

    Args:
        log: The log.
        cutoff: As above, Hz.
        angle: Standard deviation of the angles' white noise, rad, (n,).
    """
    rate, slow = 1.0 / log.dt, signals.lowpass(cutoff, 1.0 / log.dt)
    gains = [signals.noise_gain(slow, rate, k) for k in range(3)]
    if log.v is None:
        return angle * gains[1], angle * gains[2]
    measured = signals.noise_std(log.v)
    return np.minimum(angle * gains[1], measured * gains[0]), np.minimum(angle * gains[2], measured * gains[1])
