"""Motions and logs to measure on, made without a simulation: inverse dynamics along a Fourier series, and noise."""

from __future__ import annotations

import numpy as np

from gimbal_pin.dynamics.model import Model
from gimbal_pin.excitation.fourier import Series
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.rig.rig import Rig

DT = 0.001
PERIOD = 10.0
"""Length of the motion that is repeated, s."""
ROOM = 0.8
"""Share of the rig's limits of angle, rate and acceleration that the motion takes."""
ANGLE_STD, RATE_STD = 1e-5, 1e-3
"""Noise of a log's angles, rad, and rates, rad/s."""
TORQUE_SHARE = 0.01
"""Noise of a log's torque, in shares of its rms."""


def exciting(rig: Rig, rng: np.random.Generator) -> Motion:
    """One period of a Fourier series with random coefficients, from rest to rest, within the rig's limits."""
    series = Series(PERIOD, 5)
    coefficients = series.rest @ rng.standard_normal((series.rest.shape[1], rig.n))
    coefficients[0] = 0.0
    t = DT * np.arange(round(PERIOD / DT))
    motion = series.motion(coefficients, t)
    limits = [[min(-x.lower, x.upper), x.velocity, x.acceleration] for x in rig.limits]
    peaks = np.abs([motion.q, motion.v, motion.a]).max(axis=1).T
    return series.motion(coefficients * ROOM / (peaks / np.array(limits)).max(axis=1), t)


def repeated(
    period: Array, count: int, noise: Array | float = 0.0, rng: np.random.Generator | None = None
) -> Array:
    """Repeat the rows of `period` up to `count` of them, with fresh noise each time, read-only, (count, n)."""
    out = np.empty((count, period.shape[1]))
    for begin in range(0, count, len(period)):
        part = out[begin : begin + len(period)]
        part[:] = period[: len(part)]
        if rng is not None:
            part += noise * rng.standard_normal(part.shape)
    out.flags.writeable = False
    return out


def noisy_log(model: Model, count: int, rng: np.random.Generator) -> Log:
    """Return a log of `count` samples, made with little memory beyond its own."""
    motion = exciting(model.rig, rng)
    tau = model.inverse_dynamics(motion.q, motion.v, motion.a)
    t = DT * np.arange(count)
    t.flags.writeable = False
    return Log(
        name=f"{count} samples",
        joints=model.rig.joints,
        t=t,
        q=repeated(motion.q, count, ANGLE_STD, rng),
        v=repeated(motion.v, count, RATE_STD, rng),
        tau=repeated(tau, count, TORQUE_SHARE * np.sqrt(np.mean(tau**2, axis=0)), rng),
    )
