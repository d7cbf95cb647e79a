"""Closed loop of plant, sensors, delay and controller; what it returns is a `Log`, like a measured one."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from tqdm import tqdm

from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.model import Model
from gimbal_pin.plant import Plant, State
from gimbal_pin.rig import Rig


class Reference(NamedTuple):
    """Where the joints should be: angle rad, rate rad/s, acceleration rad/s², (n,) each."""

    q: Array
    v: Array
    a: Array


class Controller(Protocol):
    """A control law with explicit memory: pure, so that one controller can run many loops."""

    @property
    def dt(self) -> float:
        """Sampling interval, s."""

    def start(self) -> Any:
        """Return the memory before the first sample."""

    def torque(self, t: float, q: Array, v: Array, reference: Reference, memory: Any) -> tuple[Array, Any]:
        """Return the torque for the sample measured at `t`, N m, (n,), within the limits, and the next memory."""


@dataclass(frozen=True, eq=False)
class Sensors:
    """What stands between the plant and the log.

    Attributes:
        encoder_step: Angle of one encoder step, rad, (n,); 0: exact.
        rate_std: Standard deviation of the white noise on each rate, rad/s, (n,).
        torque_std: Standard deviation of the white noise on each reported torque, N m, (n,).
    """

    encoder_step: Array
    rate_std: Array
    torque_std: Array

    @staticmethod
    def exact(n: int) -> Sensors:
        """No quantisation, no noise."""
        return Sensors(np.zeros(n), np.zeros(n), np.zeros(n))

    @staticmethod
    def of(rig: Rig, dt: float, torque_std: float = 0.0) -> Sensors:
        """The rig's encoders and gyros sampled every `dt` s: a density d gives a standard deviation d/√(2 dt)."""
        rate = rig.config.noise.gyro / np.sqrt(2 * dt)
        steps = np.array([motor.encoder_step for motor in rig.motors])
        return Sensors(steps, np.full(rig.n, rate), np.full(rig.n, torque_std))

    def angle(self, q: Array) -> Array:
        """The angle as the encoder reports it."""
        step = np.where(self.encoder_step > 0, self.encoder_step, 1.0)
        return np.where(self.encoder_step > 0, np.round(q / step) * step, q)


def simulate(
    plant: Model,
    controller: Controller,
    reference: Motion,
    *,
    rng: np.random.Generator,
    sensors: Sensors | None = None,
    delay: int = 1,
    start: State | None = None,
    name: str = "simulated",
) -> Log:
    """Run the closed loop along a reference sampled at the controller's interval.

    At sample k the controller sees the sensors at `t[k]`; its torque reaches the motors `delay` samples later, is
    clipped at their limits, and is held for one sample. The plant is integrated by RK4, one step per sample.

    Args:
        plant: The plant: a model whose terms need not be the controller's.
        controller: The control law.
        reference: Reference, one sample per control interval.
        rng: Source of the sensors' noise.
        sensors: The sensors; None: the rig's encoders and gyros.
        delay: Samples between measurement and torque.
        start: State at the first sample; None: at rest on the reference.
        name: Name of the log.

    Returns:
        A log of the measured angles and rates, and of the torque held from each sample on, as the drive reports it.

    Raises:
        UsageError: The reference is not sampled at the controller's interval, or the state left the finite numbers.
    """
    n, steps = plant.rig.n, len(reference)
    dt = controller.dt
    if steps < 2 or not np.allclose(np.diff(reference.t), dt, rtol=1e-6):
        raise UsageError("reference", f"is not sampled every {dt:g} s", "resample it to the controller's interval")
    sense = sensors if sensors is not None else Sensors.of(plant.rig, dt)
    q, v, tau = np.empty((steps, n)), np.empty((steps, n)), np.empty((steps, n))
    rate_noise = sense.rate_std * rng.standard_normal((steps, n))
    torque_noise = sense.torque_std * rng.standard_normal((steps, n))
    limit, system, memory = plant.rig.tau_max, Plant(plant), controller.start()
    state = State(reference.q[0].copy(), reference.v[0].copy()) if start is None else start
    pending: deque[Array] = deque([np.zeros(n)] * delay)
    for k in tqdm(range(steps), desc=name, unit="sample", disable=None, leave=False, delay=2):
        q[k], v[k] = sense.angle(state.q), state.v + rate_noise[k]
        wanted, memory = controller.torque(
            float(reference.t[k]), q[k], v[k], Reference(reference.q[k], reference.v[k], reference.a[k]), memory
        )
        pending.append(wanted)
        tau[k] = np.clip(pending.popleft(), -limit, limit)
        state = system.step(float(reference.t[k]), state, tau[k], dt)
    if not (np.isfinite(q).all() and np.isfinite(tau).all()):
        raise UsageError(name, "the closed loop diverged", "lower the controller's bandwidth or its delay")
    return Log(
        name=name,
        joints=plant.rig.joints,
        t=reference.t,
        q=q,
        v=v,
        tau=tau + torque_noise,
        q_ref=reference.q,
        payload=plant.rig.payload,
    )
