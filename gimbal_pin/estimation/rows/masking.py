"""Where the direction of dry friction is unknown, and the mask that leaves it out without a sharp edge."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from gimbal_pin.estimation.rows.channels import Channels, Flags
from gimbal_pin.estimation.rows.filtering import Filtering
from gimbal_pin.log.log import Array

STANDSTILL = 2.0
"""A rate under this many of its own standard deviations does not tell its sign: at it one in 44 is wrong."""
TAPER = 0.1
"""Width over which the mask around a standstill opens, in periods of the cutoff. At half a period the mask takes what
shows inertia best, the turns: on real logs of slow swings 85 % of the samples, for a model three times worse."""
MEMORY = 0.5
"""Reach of the smoother, in periods of its cutoff."""


def standstill(channels: Channels, filtering: Filtering) -> Flags:
    """Samples at which the smoothed rate does not tell its sign, or that nobody measured, (m, n).

    It is under some of its own standard deviations, or changes its sign; what fills a hole is carried by the smoother
    to its neighbours.
    """
    still = slow(channels)
    return still if channels.lost is None else still | dilated(channels.lost[:, None], memory(channels, filtering))


def slow(channels: Channels, sure: float = STANDSTILL) -> Flags:
    """Whether the rate is under so many deviations, or changes its sign, or nobody measured it, (m, n)."""
    still = np.abs(channels.v) < sure * channels.rate_std
    still[1:] |= channels.v[1:] * channels.v[:-1] < 0
    if channels.lost is not None:
        still |= channels.lost[:, None]
    return np.asarray(still)


def memory(channels: Channels, filtering: Filtering) -> int:
    """Samples that the smoother reaches to either side."""
    return int(np.ceil(MEMORY / (filtering.cutoff * filtering.smoothing * (channels.t[1] - channels.t[0]))))


def sliding(v: Array, a: Array, dt: float) -> Array:
    """``∫ sign(v + a s) ds / dt`` over a sample, s in ±dt/2: the mean direction while it lasts, (m, n), in [-1, 1].

    The sign itself would put every turn on a sample: up to half an interval of twice the dry friction too much.
    """
    return np.clip(2 * v / np.maximum(np.abs(a) * dt, 1e-300), -1.0, 1.0)


def mask(still: Flags, taper: int) -> Array:
    """Weight 0 at standstill, rising smoothly to 1 over `taper` samples, (m, n).

    A mask with sharp edges would fold the noise above the cutoff into the band that the filter keeps.
    """
    half = max(taper // 2, 1)
    opened = 1.0 - dilated(still, 2 * half)
    for _ in range(2):
        opened = uniform_filter1d(opened, 2 * (half // 2) + 1, axis=0, mode="nearest")
    return np.where(still, 0.0, np.clip(opened, 0.0, 1.0))


def dilated(still: Flags, reach: int) -> Flags:
    """Whether a sample is within `reach` samples of one of `still`, (m, n)."""
    return uniform_filter1d(still.astype(float), 2 * reach + 1, axis=0, mode="constant") > 1e-9
