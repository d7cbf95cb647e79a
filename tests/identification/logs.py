"""Logs of prescribed motions: with noise, and of a rig whose base moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.dynamics import Model, nominal
from gimbal_pin.log import Array, Imu, Log, Platform
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier, prescribed


def record(rig: Rig, seed: int, seconds: float = 14.0) -> Log:
    """Return a log with torque noise of 2 %."""
    return prescribed(nominal(rig), seed, seconds, torque_noise=0.02, dt=4e-3)


def hold(rig: Rig, log: Log, *joints: int, noisy: bool = True) -> Log:
    """Return the log of the same motion with some joints at rest and noise of the sensors."""
    moves = ~np.isin(np.arange(rig.n), joints)
    v = np.asarray(log.v) * moves
    tau = nominal(rig).inverse_dynamics(log.q * moves, v, np.gradient(v, log.t, axis=0))
    noise = noisy * np.random.default_rng(7).standard_normal((3, *v.shape))
    q = log.q * moves + 1e-5 * noise[0]
    return replace(log, q=q, v=v + 1e-4 * noise[1], tau=tau + 1e-3 * noise[2])


def list_times(seconds: float) -> Array:
    """Return times of 1 kHz with both ends, s."""
    return 1e-3 * np.arange(round(seconds * 1000) + 1)


def sway(t: Array, size: float = 0.2) -> Platform:
    """Return a few degrees and some m/s² on every axis, below what the filters take away."""
    w = 2 * np.pi * np.array([0.7, 0.9, 1.3])
    angle = size * np.sin(t[:, None] * w)
    rate = size * w * np.cos(t[:, None] * w)
    push = 5 * size * np.cos(t[:, None] * w[::-1])
    return Platform.turning(t, angle, rate, -(w**2) * angle, push)


def carry(model: Model, platform: Platform | None, seconds: float = 12.0) -> Log:
    """Return the log of a prescribed motion on a moving base, without noise."""
    motion = fourier(model.rig, 0, seconds)
    tau = model.inverse_dynamics(motion.q, motion.v, motion.a, platform=platform)
    imus = {} if platform is None else {model.rig.base: Imu(platform.w, platform.f)}
    return Log("carried", model.rig.joints, motion.t, motion.q, motion.v, tau, imus=imus)
