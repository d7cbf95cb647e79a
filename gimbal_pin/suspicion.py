"""Whether least squares is biased on a log: asked where the sensors' noise is large enough to do it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from gimbal_pin import signals
from gimbal_pin.errors import DataError
from gimbal_pin.estimators import Hausman, hausman, physical
from gimbal_pin.estimators.colour import series
from gimbal_pin.estimators.idim import instruments
from gimbal_pin.log import Array, Log
from gimbal_pin.rows import Block, Filtering, Regression, kept

Asked = Literal["never", "noisy", "always"]
"""When the test is run: it takes twice the time of the fit itself."""

NOISY = 0.03
"""Noise of the acceleration, as a share of it, from which the test is worth its time: bias goes with its square."""
EXAMINED = 60.0
"""Time of the first log on which least squares is tested, s: a longer one costs more than it says."""


@dataclass(frozen=True)
class Suspicion:
    """What is known of least squares' bias.

    Attributes:
        noise: Noise of the filtered acceleration over its rms, in the worst joint of the first log.
        test: Durbin, Wu and Hausman's; None where it was not run.
        why: Why it was not run, or could not be.
    """

    noise: float
    test: Hausman | None
    why: str = ""

    @property
    def sentence(self) -> str:
        """What is known, and what to use instead."""
        return self.why if self.test is None else self.test.sentence

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds; `biased` is null where the test was not run."""
        empty = dict.fromkeys(("statistic", "freedom", "p_value", "change", "level", "biased"))
        said = empty if self.test is None else self.test.to_dict()
        return {"noise_share": self.noise, **said, "sentence": self.sentence}


def suspicion(blocks: Regression, asked: Asked) -> Suspicion | None:
    """Test least squares if asked to; None for "never".

    The instruments are simulated with bodies fitted to the same rows.
    """
    if asked == "never":
        return None
    rows, first = blocks.rows, blocks.rows.logs[0]
    noise = noise_share(first, rows.filtering, blocks)
    if asked == "noisy" and noise < NOISY:
        little = f"the sensors' noise is {100 * noise:.2g} % of the motion's acceleration, too little to bias"
        return Suspicion(noise, None, f"{little} least squares (--bias tests it all the same)")
    some = first.part(slice(0, int(np.searchsorted(first.t, first.t[0] + EXAMINED))))
    judged = blocks if len(rows.logs) == 1 and len(some) == len(first) else kept(replace(rows, logs=(some,)))
    try:
        return Suspicion(noise, hausman(judged, instruments(judged, physical(judged))))
    except DataError as error:
        return Suspicion(noise, None, f"whether least squares is biased cannot be tested: {error}")


def noise_share(log: Log, filtering: Filtering, blocks: Sequence[Block]) -> float:
    """Noise of the acceleration below the cutoff over the acceleration's own rms, in the worst joint that moves.

    From the angle's noise differentiated twice or, where there is one, the rate's differentiated once, by whichever
    says less; the motion's from the rows' rates.
    """
    rate, slow = 1.0 / log.dt, signals.lowpass(filtering.cutoff, 1.0 / log.dt)
    noise = signals.noise_std(log.q) * signals.noise_gain(slow, rate, 2)
    if log.v is not None:
        noise = np.minimum(noise, signals.noise_std(log.v) * signals.noise_gain(slow, rate, 1))
    size = spread([np.diff(part.v, axis=0) / np.diff(part.t)[:, None] for part in series(blocks)])
    moving = size > 0
    return float(np.max(noise[moving] / size[moving], initial=0.0))


def spread(parts: Sequence[Array]) -> Array:
    """Root mean square over the rows of all parts, per joint, (n,)."""
    return np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))
