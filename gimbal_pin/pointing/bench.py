"""The benchmark: a rig on a platform, the model that a log of it gives, and the sensors."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians

import numpy as np

from gimbal_pin.control.experiment import bench_run
from gimbal_pin.dynamics.imu import add_imu_noise
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Signal
from gimbal_pin.effects.payload_shift import PayloadShift
from gimbal_pin.effects.rig_effect import find_camera_axes, find_joint_axis, get_payload
from gimbal_pin.identification import identify
from gimbal_pin.log.log import Array, Imu, Log
from gimbal_pin.log.platform import Platform
from gimbal_pin.log.profile import profile_s
from gimbal_pin.pointing.forecast import Spectrum
from gimbal_pin.pointing.measurement import ACCELEROMETER, GYRO, Station
from gimbal_pin.pointing.navigator import attitude
from gimbal_pin.pointing.recipe import Recipe, find_trusted_joints
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.rig.config import Noise
from gimbal_pin.rig.rig import Rig

WANTED = attitude(radians(20.0), radians(25.0))
"""R_d = Rz(20°) Ry(25°)."""
OFF = 0.005
WAY = (0.6, -0.4, 0.69)
"""The payload's centre of mass, m from the tilt axis, and in which direction: forward, left, up."""
LEARNED = 1000
"""Seed of the log that the model comes from: no motion of the benchmark has it."""
HALF = 0.5
"""Size of profile S with which the base is shaken while that log is recorded."""
REHEARSAL = 20.0
"""Length of a motion that only says how a platform moves, s."""


def unbalance_payload(rig: Rig, off: float = OFF) -> Rig:
    """Return the rig with its payload slid so that its centre of mass is `off` m from the last axis, along `WAY`."""
    body, inertia, frame = get_payload(rig)
    axis = find_joint_axis(rig, body)
    across = np.eye(3) - np.outer(axis, axis)
    way = across @ find_camera_axes(rig) @ np.array(WAY)
    change = off * way / np.linalg.norm(way) - across @ inertia.lever
    return PayloadShift(*(frame.rotation.T @ change).tolist()).apply(rig)


def draw_profile(
    rig: Rig, seconds: float, seed: int, dt: float = 0.001, size: float = 1.0
) -> Platform:
    """Return profile S about the point where a rig's axes meet, sampled at half the control interval.

    A profile says how a platform turns and shakes, not about which point. About a base link 0.4 m from the axes its
    turning would push them with 10 m/s², beyond what the bundled rigs' motors can hold.

    Args:
        rig: The rig.
        seconds: Length, s.
        seed: Each has a motion of its own.
        dt: The control interval, s.
        size: Profile S times this.
    """
    t = dt / 2 * np.arange(2 * round(seconds / dt) + 1)
    return profile_s(t, np.random.default_rng(seed), size).about(Sight(rig).centre)


def simulate_shaken_log(plant: Model, drive: Sequence[Signal] = (), seconds: float = 60.0) -> Log:
    """Simulate a log of the plant on a platform shaken by hand: profile S at half its size, with sensor noise.

    Args:
        plant: The plant.
        drive: What stands between its command and the torque that acts.
        seconds: Length, s.
    """
    rig = plant.rig
    rng = np.random.default_rng(LEARNED)
    ground = draw_profile(rig, seconds, LEARNED, size=HALF)
    return bench_run(
        plant,
        rng=rng,
        seconds=seconds,
        platform=ground,
        imus=rig.config.imus,
        drive=drive,
        name="shaken",
    )


def learn_recipe(
    rig: Rig,
    log: Log | None,
    station: Station,
    model: Model | None = None,
    wanted: Array = WANTED,
    delay: int = 1,
) -> Recipe:
    """Return what controllers are made of: a model, and how the platform moves, by its base's IMU if it has one.

    Args:
        rig: The rig.
        log: Its log; None: of a rig whose model is known there is none.
        station: The sensors that the controllers will have.
        model: The model, where it is known already; None: that which `identify` finds in the log.
        wanted: The camera's attitude in the world, (3, 3).
        delay: Samples of 1 ms from a measurement to its torque.
    """
    if log is None:
        (t, imu) = rehearse_platform(rig)
        name = "profile S"
    else:
        log = log.ordered(rig)
        t, imu = (
            (log.t - log.t[0], log.imus[rig.base])
            if rig.base in log.imus
            else rehearse_platform(rig)
        )
        model = model or identify(rig, [log], holdout="none", examined="never").model
        name = log.name
    assert model is not None, "without a log the model is given"
    spectrum = Spectrum.of(imu, float(np.median(np.diff(t))), name)
    trusted = find_trusted_joints(model, wanted, Platform.measured(t, imu, name))
    return Recipe(
        model, wanted, spectrum, station.noise, float(station.step.max()), trusted, delay=delay
    )


def rehearse_platform(rig: Rig) -> tuple[Array, Imu]:
    """Return time, s, and what the IMU of a rig's base reports on profile S at half its size, as if shaken by hand.

    It tells how a platform moves where the log that the model comes from does not.
    """
    dt = 0.001
    motion = draw_profile(rig, REHEARSAL, LEARNED, dt, HALF)
    own = Imu(motion.w[::2], motion.f[::2], None if motion.quat is None else motion.quat[::2])
    return motion.t[::2], add_imu_noise(
        own, Noise(GYRO, ACCELEROMETER), dt, np.random.default_rng(LEARNED)
    )
