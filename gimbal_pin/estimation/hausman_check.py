"""Whether least squares is biased on a log: asked where the sensors' noise is large enough to do it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from gimbal_pin.errors import DataError
from gimbal_pin.estimation.estimators import Hausman, hausman, physical
from gimbal_pin.estimation.estimators.colour import series
from gimbal_pin.estimation.estimators.idim import instruments
from gimbal_pin.estimation.rows import Block, Filtering, Regression, kept
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log

Asked = Literal["never", "noisy", "always"]
"""When the test is run: it takes twice the time of the fit itself."""

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
class Suspicion:
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


def suspicion(blocks: Regression, asked: Asked, method: str = "") -> Suspicion | None:
    """Test least squares if asked to; None for "never".

    The instruments are simulated with bodies fitted to the same rows.

    `method` was used: an estimator without bias is not advised to those who took it.
    """
    if asked == "never":
        return None
    rows, first = blocks.rows, blocks.rows.logs[0]
    noise = noise_share(first, rows.filtering, blocks)
    if asked == "noisy" and noise < NOISY:
        little = f"the sensors' noise is {100 * noise:.2g} % of the motion's acceleration, too little to bias"
        return Suspicion(noise, None, f"{little} least squares (--bias tests it all the same)", method)
    some = first.part(slice(0, int(np.searchsorted(first.t, first.t[0] + EXAMINED))))
    judged = blocks if len(rows.logs) == 1 and len(some) == len(first) else kept(replace(rows, logs=(some,)))
    try:
        return Suspicion(noise, hausman(judged, instruments(judged, physical(judged))), method=method)
    except DataError as error:
        return Suspicion(noise, None, f"whether least squares is biased cannot be tested: {error}", method)


def noise_share(log: Log, filtering: Filtering, blocks: Sequence[Block]) -> float:
    """Noise of the acceleration below the cutoff over the acceleration's own rms, in the worst joint that moves.

    From the angle's noise differentiated twice or, where there is one, the rate's differentiated once, by whichever
    says less; the motion's from the rows' rates, less what the noise that passes the smoothing adds to them.
    """
    fine = signals.noise_std(log.q)
    noise = noises(log, filtering.cutoff, np.maximum(fine, coarseness(log.q)))
    smoothed = noises(log, filtering.cutoff * filtering.smoothing, fine)
    parts = [np.diff(part.v, axis=0) / np.diff(part.t)[:, None] for part in series(blocks)]
    total = np.mean(np.concatenate(parts) ** 2, axis=0)
    step = 1.0 / (2 * filtering.cutoff)
    size = np.sqrt(np.maximum(total - 2 * (smoothed[0] / step) ** 2, LEAST**2 * total))
    moving = size > 0
    return float(np.max(noise[1][moving] / size[moving], initial=0.0))


def coarseness(q: Array) -> Array:
    """White noise of the density that an encoder's steps have where most samples repeat the one before, rad, (n,).

    Differences of the samples see none of it: from step to step the reading does not change, and the error is a
    sawtooth as slow as the steps. Its power, a twelfth of the step's square, lies below their rate, not Nyquist's.
    """
    jumps = np.abs(np.diff(q, axis=0))
    share = np.mean(jumps > 0, axis=0)
    step = np.array([np.median(one[one > 0]) if one.any() else 0.0 for one in jumps.T])
    denser = np.sqrt(np.clip(0.5 / np.maximum(share, 1e-300), 1.0, DENSEST))
    return np.asarray(np.where(share < 0.5, step / np.sqrt(12.0) * denser, 0.0))


def noises(log: Log, cutoff: float, angle: Array) -> tuple[Array, Array]:
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
