"""What controllers that hold a camera are made of: a platform's spectrum, sensors with noise, a model."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gimbal_pin.dynamics import Model
from gimbal_pin.log import Array, Imu, profile_s
from gimbal_pin.pointing import WANTED, Recipe, Spectrum
from gimbal_pin.rig import Noise

DT = 1e-3
NOISE = Noise(float(np.deg2rad(0.005)), 1e-4 * 9.81)


@cache
def spectrum() -> Spectrum:
    """Return that of profile S at half size, as an IMU with noise shows it."""
    t = DT * np.arange(8000)
    moved = profile_s(t, np.random.default_rng(9), 0.5)
    noise = np.random.default_rng(10).standard_normal((2, len(t), 3)) / np.sqrt(2 * DT)
    gyro = moved.w + NOISE.gyro * noise[0]
    return Spectrum.of(Imu(gyro, moved.f + NOISE.accelerometer * noise[1]), DT)


def recipe(model: Model, wanted: Array = WANTED, **more: Any) -> Recipe:
    """Return the recipe of a model that is known."""
    return Recipe(model, wanted, spectrum(), NOISE, 2 * np.pi / 2**16, **more)
