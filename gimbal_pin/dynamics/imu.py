"""What an IMU on any link of a rig reports: rate and specific force in the link's frame, whatever carries the rig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from gimbal_pin.dynamics.regressor import convert_states
from gimbal_pin.log.log import Array, Imu
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.config import Noise
from gimbal_pin.rig.rig import Rig


def compute_imu_readings(
    rig: Rig, links: Sequence[str], q: Array, v: Array, a: Array, platform: Platform
) -> dict[str, Imu]:
    """``w_i = R_iᵀ(w_{i-1} + q̇_i z)`` (thesis 4.5.1) and ``f_i``, specific force of the link's origin, without error.

    Behind a free-flyer without gravity a link's classical acceleration is its specific force. The base's IMU is the
    platform's motion itself, attitude included.

    Args:
        rig: The rig.
        links: Links that carry an IMU.
        q: Angles, rad, (N, n).
        v: Rates, rad/s, (N, n).
        a: Accelerations, rad/s², (N, n).
        platform: Motion of the base at the same samples.
    """
    moved = [link for link in links if link != rig.base]
    out = {rig.base: Imu(platform.w, platform.f, platform.quat)} if rig.base in links else {}
    if not moved:
        return out
    model, states = convert_states(rig, q, v, a, platform)
    data = model.createData()
    frames = [model.getFrameId(link, pin.FrameType.BODY) for link in moved]
    gyro = np.empty((len(frames), len(q), 3))
    accel = np.empty((len(frames), len(q), 3))
    for k, state in enumerate(zip(*states)):
        pin.forwardKinematics(model, data, *state)
        for i, frame in enumerate(frames):
            gyro[i, k] = pin.getFrameVelocity(model, data, frame, pin.LOCAL).angular
            accel[i, k] = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL).linear
    return out | {link: Imu(gyro[i], accel[i]) for i, link in enumerate(moved)}


def add_imu_noise(imu: Imu, noise: Noise, dt: float, rng: np.random.Generator) -> Imu:
    """Return readings sampled every `dt` s with white noise: a density d gives a standard deviation d/√(2 dt)."""
    if imu.gyro is None or imu.accel is None:
        return imu
    share = 1 / np.sqrt(2 * dt)
    gyro = imu.gyro + noise.gyro * share * rng.standard_normal(imu.gyro.shape)
    accel = imu.accel + noise.accelerometer * share * rng.standard_normal(imu.accel.shape)
    return Imu(gyro, accel, imu.quat)
