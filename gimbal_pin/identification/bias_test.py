"""Is least squares biased on this log? The test of Durbin, Wu and Hausman against instrumental variables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.special import chdtrc

from gimbal_pin.errors import DataError
from gimbal_pin.identification.output_error import build_instruments
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    Block,
    DesignBlocks,
    Filtering,
    Method,
    compute_blocks,
    compute_moments,
    compute_score_covariance,
    compute_targets,
    compute_wald,
    fit_instrumental,
    fit_physical,
    fit_residual_noise,
    join_blocks,
    join_columns,
    solve_moments,
    weigh_joints,
)

TEST_LEVEL = 0.01
"""Chance that a log on which least squares is not biased is called biased."""
ADMISSIBLE = 0.5
"""Bias that least squares may have, in its own standard deviations: less than this nobody could see."""
JUDGED_RANK = 1e-6
"""Directions of less than this share of the largest variance, in units of each parameter's own, are not judged."""
TESTED_NOISE = 0.03
"""Noise of the acceleration, as a share of it, from which the test is worth its time: bias goes with its square."""
LEAST_MOTION = 0.1
"""Least share of what the rates show that is taken for motion, where nearly all of it is noise."""
BEYOND = 10.0
"""Change of the torque, in squared shares of noise, that noise alone does not make: at most three are usual."""
DENSEST = 25.0
"""Most that an encoder's slow steps count by: a joint that stands has hardly any."""
TESTED_TIME = 60.0
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
        """Whether least squares is biased, at the `TEST_LEVEL`."""
        return self.p_value < TEST_LEVEL


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
    weight = weigh_joints(fit_instrumental(blocks, instruments).residual_std ** 2) ** 2
    plain = [block.A for block in blocks]
    found, plain_found = (
        solve_moments(
            compute_moments(list(zip(z, plain)), weight), compute_targets(blocks, z, weight)
        )
        for z in (instruments, plain)
    )
    noise = fit_residual_noise(blocks, instruments, found.theta, found.gain, weight).processes
    apart = [z @ found.gain.T - A @ plain_found.gain.T for z, A in zip(instruments, plain)]
    score = compute_score_covariance(join_columns(blocks, plain), noise, weight).sum(axis=0)
    spread = compute_score_covariance(join_columns(blocks, apart), noise, weight).sum(axis=0)
    spread = spread + ADMISSIBLE**2 * plain_found.gain @ score @ plain_found.gain.T
    difference = found.theta - plain_found.theta
    statistic, freedom = compute_wald(difference, spread, JUDGED_RANK)
    moved = np.sum([np.sum((A @ difference) ** 2, axis=0) for A in plain], axis=0)
    torque = np.sum([np.sum(block.b**2, axis=0) for block in blocks], axis=0)
    share = np.sqrt(moved / np.where(torque > 1e-6 * torque.max(), torque, np.inf))
    return Hausman(
        statistic,
        freedom,
        float(chdtrc(freedom, statistic)) if freedom else 1.0,
        float(share.max()),
    )


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
    method: Method | None = None

    @property
    def by_noise(self) -> bool:
        """Whether the sensors' noise is enough to make the difference that the test sees."""
        return self.test is not None and self.test.change <= BEYOND * self.noise**2

    @property
    def is_of_noise(self) -> bool:
        """Whether least squares is biased by that noise."""
        return self.test is not None and self.test.biased and self.by_noise

    @property
    def sentence(self) -> str:
        """What is known, and what to use instead."""
        if self.test is None:
            return self.why
        chance = f"p = {self.test.p_value:.2g}" if self.test.p_value > 1e-12 else "p < 1e-12"
        shift = f"{100 * self.test.change:.2g} % of the torque"
        if not self.test.biased:
            return f"least squares shows no bias on this log ({chance})"
        if not self.by_noise:
            return (
                f"least squares and instrumental variables disagree by {shift}, more than the sensors' noise "
                f"({100 * self.noise:.2g} % of the acceleration) explains: the model misses something, see "
                "'gimbal-pin diagnose'"
            )
        found = f"least squares is biased on this log by noise in the motion ({chance}, {shift})"
        if self.method is not None and self.method.is_simulating:
            return f"{found}: {self.method}, which was used, is not"
        return f"{found}: use --estimator output-error or instrumental, or a lower cutoff"

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds; `biased` is null where the test was not run."""
        figures: dict[str, Any] = dict.fromkeys(
            ("statistic", "freedom", "p_value", "change", "level", "biased")
        )
        if self.test is not None:
            figures = {**asdict(self.test), "level": TEST_LEVEL, "biased": self.test.biased}
        return {
            "noise_share": self.noise,
            **figures,
            "by_noise": self.by_noise,
            "sentence": self.sentence,
        }


def check_bias(
    blocks: DesignBlocks, asked: WhenTested, method: Method | None = None
) -> BiasCheck | None:
    """Test least squares if asked to; None for "never".

    The instruments are simulated with bodies fitted to the same rows.

    `method` was used: an estimator without bias is not advised to those who took it.
    """
    if asked == "never":
        return None
    design = blocks.design
    first = blocks.design.logs[0]
    noise = compute_acceleration_noise(first, design.filtering, blocks)
    if asked == "noisy" and noise < TESTED_NOISE:
        little = f"the sensors' noise is {100 * noise:.2g} % of the motion's acceleration, too little to bias"
        return BiasCheck(
            noise, None, f"{little} least squares (--bias tests it all the same)", method
        )
    some = first.part(slice(0, int(np.searchsorted(first.t, first.t[0] + TESTED_TIME))))
    judged = (
        blocks
        if len(design.logs) == 1 and len(some) == len(first)
        else compute_blocks(replace(design, logs=(some,)))
    )
    try:
        test = compare_with_instruments(judged, build_instruments(judged, fit_physical(judged)))
        return BiasCheck(noise, test, method=method)
    except DataError as error:
        return BiasCheck(
            noise, None, f"whether least squares is biased cannot be tested: {error}", method
        )


def compute_acceleration_noise(log: Log, filtering: Filtering, blocks: Sequence[Block]) -> float:
    """Noise of the acceleration below the cutoff over the acceleration's own rms, in the worst joint that moves.

    From the angle's noise differentiated twice or, where there is one, the rate's differentiated once, by whichever
    says less; the motion's from the rows' rates, less what the noise that passes the smoothing adds to them.
    """
    fine = signals.noise_std(log.q)
    noise = _compute_motion_noise(
        log, filtering.cutoff, np.maximum(fine, _compute_step_noise(log.q))
    )
    smoothed = _compute_motion_noise(log, filtering.cutoff * filtering.smoothing, fine)
    parts = [np.diff(part.v, axis=0) / np.diff(part.t)[:, None] for part in join_blocks(blocks)]
    total = np.mean(np.concatenate(parts) ** 2, axis=0)
    step = 1.0 / (2 * filtering.cutoff)
    size = np.sqrt(np.maximum(total - 2 * (smoothed[0] / step) ** 2, LEAST_MOTION**2 * total))
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
    rate = 1.0 / log.dt
    slow = signals.lowpass(cutoff, 1.0 / log.dt)
    gains = [signals.compute_noise_gain(slow, rate, k) for k in range(3)]
    if log.v is None:
        return angle * gains[1], angle * gains[2]
    measured = signals.noise_std(log.v)
    return np.minimum(angle * gains[1], measured * gains[0]), np.minimum(
        angle * gains[2], measured * gains[1]
    )
