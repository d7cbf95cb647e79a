"""What stands between the plant and the log: encoders, gyros, the torque that a drive reports, IMUs."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gimbal_pin.dynamics.imu import add_imu_noise, compute_imu_readings
from gimbal_pin.log.log import Array, Imu
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.config import Noise
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class Sensors:
    """What stands between the plant and the log.

    Attributes:
        encoder_step: Angle of one encoder step, rad, (n,); 0: exact.
        rate_std: Standard deviation of the white noise on each rate, rad/s, (n,).
        torque_std: Standard deviation of the white noise on each reported torque, N m, (n,).
        imus: Links whose IMU is in the log; on a platform that moves the base's always is.
        noise: Densities of the IMUs' noise.
    """

    encoder_step: Array
    rate_std: Array
    torque_std: Array
    imus: tuple[str, ...] = ()
    noise: Noise = field(default_factory=Noise)

    @staticmethod
    def exact(n: int) -> Sensors:
        """No quantisation, no noise."""
        return Sensors(np.zeros(n), np.zeros(n), np.zeros(n))

    @staticmethod
    def of(rig: Rig, dt: float, torque_std: float = 0.0) -> Sensors:
        """The rig's encoders and gyros sampled every `dt` s: a density d gives a standard deviation d/√(2 dt)."""
        rate = rig.config.noise.gyro / np.sqrt(2 * dt)
        steps = np.array([motor.encoder_step for motor in rig.motors])
        return Sensors(
            steps, np.full(rig.n, rate), np.full(rig.n, torque_std), noise=rig.config.noise
        )

    @cached_property
    def steps(self) -> list[float]:
        """`encoder_step` as floats; empty where all are exact."""
        steps: list[float] = self.encoder_step.tolist()
        return steps if any(steps) else []

    def angle(self, q: Array) -> Array:
        """The angle as the encoder reports it, rad, (n,)."""
        if not self.steps:
            return q
        return np.array(
            [round(x / step) * step if step > 0 else x for x, step in zip(q.tolist(), self.steps)]
        )


def measure_imus(
    rig: Rig,
    sense: Sensors,
    t: Array,
    exact: Array,
    platform: Platform | None,
    rng: np.random.Generator,
) -> dict[str, Imu]:
    """Return what the IMUs report along true angles and rates, (2, N, n); accelerations are the rates' differences."""
    links = [
        link
        for link in dict.fromkeys((rig.base, *sense.imus))
        if platform is not None or link in sense.imus
    ]
    if not links:
        return {}
    q, v = exact
    dt = float(t[1] - t[0])
    true = compute_imu_readings(
        rig,
        links,
        q,
        v,
        np.gradient(v, dt, axis=0),
        Platform.still(t) if platform is None else platform,
    )
    return {link: add_imu_noise(imu, sense.noise, dt, rng) for link, imu in true.items()}
