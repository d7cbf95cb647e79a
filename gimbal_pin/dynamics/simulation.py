"""Closed loop of plant, sensors, delay and controller; what it returns is a `Log`, like a measured one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import ceil
from typing import Any, NamedTuple, Protocol

import numpy as np
from tqdm import tqdm

from gimbal_pin.dynamics.apply import plant_with as plant_with
from gimbal_pin.dynamics.drive import Drive
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.dynamics.sensors import Sensors, measure_imus
from gimbal_pin.effects import Signal
from gimbal_pin.errors import UsageError, visible
from gimbal_pin.log.limited import (
    THROUGH_STOPS,
    compute_limit_shares,
    describe_limits,
    describe_passed_stops,
)
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.log.mapping import list_encoder_sources
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.types import Rng, make_generator

LONGEST_STEP = 0.004
"""Longest step of the plant, s: RK4 is stable up to ω h = 2.8, 110 Hz here: as fast as a loop of 250 Hz can see."""


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

    def torque(
        self, t: float, q: Array, v: Array, reference: Reference, memory: Any
    ) -> tuple[Array, Any]:
        """Return the torque for the sample measured at `t`, N m, (n,), within the limits, and the next memory."""


@check_arguments
def simulate(
    plant: Model,
    controller: Controller,
    reference: Motion,
    *,
    rng: Rng = None,
    sensors: Sensors | None = None,
    delay: int = 1,
    drive: Sequence[Signal] = (),
    start: State | None = None,
    platform: Platform | None = None,
    name: str = "simulated",
) -> Log:
    """Run the closed loop along a reference sampled at the controller's interval.

    At sample k the controller sees the sensors at `t[k]`; its torque reaches the motors `delay` samples later, is
    clipped at their limits, and is held for one sample. The plant is integrated by RK4, in equal steps of at most
    `LONGEST_STEP` per sample.

        plant, drive = plant_with(model, [parse_effect("cogging:yaw:amplitude=0.03,harmonic=42", rig)])
        log = simulate(plant, controller, reference, rng=rng, drive=drive)

    Args:
        plant: The plant: a model whose terms need not be the controller's.
        controller: The control law.
        reference: Reference, one sample per control interval.
        rng: Source of the sensors' noise, or its seed; None: a fresh one, whose seed is in the result.
        sensors: The sensors; None: the rig's encoders and gyros.
        delay: Samples between measurement and torque.
        drive: What stands between the command, which the log keeps, and the torque that acts, after the plant's own.
        start: State at the first sample; None: at rest on the reference.
        platform: Motion of the base, best sampled at half the control interval; None: it stands, which is faster.
        name: Name of the log.

    Returns:
        A log of the measured angles and rates, of the torque commanded for each interval, as the drive reports it, and
        of the IMUs; its events say which joints were long at their torque limits, or went past their stops.

    Raises:
        UsageError: The reference is not sampled at the controller's interval, the platform's motion does not last as
            long, or the state left the finite numbers.
    """
    dt = controller.dt
    t = reference.t
    if len(t) < 2 or not np.allclose(np.diff(t), dt, rtol=1e-6):
        raise UsageError(
            "reference",
            f"is not sampled every {dt:g} s",
            "resample it to the controller's interval",
        )
    rig = plant.rig
    sense = Sensors.of(plant.rig, dt) if sensors is None else sensors
    generator, seed = make_generator(rng)
    rate_noise = sense.rate_std * generator.standard_normal(reference.q.shape)
    torque_noise = sense.torque_std * generator.standard_normal(reference.q.shape)
    steps = ceil(dt / LONGEST_STEP - 1e-6)
    carried = None if platform is None else resample_halfway(platform, t, steps)
    stages = t[0] + dt / 2 / steps * np.arange(2 * steps * (len(t) - 1) + 1)
    system = Plant(plant, plant.carried(stages, carried))
    motors = Drive((*plant.drive, *drive), rig, dt, plant)
    state = State(reference.q[0].copy(), reference.v[0].copy()) if start is None else start
    q, v, tau, true_q, true_v = run_loop(
        system,
        motors,
        controller,
        reference,
        state,
        sense,
        rate_noise,
        delay,
        steps,
        rig.tau_max,
        name,
    )
    base = None if carried is None else carried.part(slice(0, None, 2 * steps))
    weak = describe_limits(compute_limit_shares(rig.joints, tau, rig.tau_max))
    lost = describe_passed_stops(rig.joints, true_q, *rig.stops)
    events = (
        [f"at the torque limit, where a joint follows no reference: {weak} of the time"]
        if weak
        else []
    )
    return Log(
        name=name,
        joints=rig.joints,
        t=t,
        q=q,
        v=v,
        tau=tau + torque_noise,
        q_ref=reference.q,
        imus=measure_imus(rig, sense, t, np.array([true_q, true_v]), base, generator),
        payload=rig.payload,
        events=(*events, *((THROUGH_STOPS.format(lost),) if lost else ())),
        seed=seed,
        sources=list_encoder_sources(rig),
    )


class System(Protocol):
    """A plant on its platform, as `run_loop` integrates it."""

    def step(self, t: float, state: State, tau: Array, dt: float) -> State:
        """Return the state `dt` s later."""


def run_loop(
    system: System,
    motors: Drive,
    controller: Controller,
    reference: Motion,
    state: State,
    sense: Sensors,
    rate_noise: Array,
    delay: int,
    steps: int,
    limit: Array,
    name: str,
) -> tuple[Array, Array, Array, Array, Array]:
    """Run the loop of `simulate`; return measured angles and rates, torque, true angles and rates, (N, n) each."""
    dt = controller.dt
    t = reference.t
    q, v, tau, true_q, true_v = (np.empty(reference.q.shape) for _ in range(5))
    memory = controller.start()
    pending: deque[Array] = deque([np.zeros(len(limit))] * delay)
    rows = zip(
        t.tolist(), reference.q, reference.v, reference.a, q, v, tau, true_q, true_v, rate_noise
    )
    bar = tqdm(rows, visible(name), len(t), unit="sample", disable=None, leave=False, delay=2)
    for now, wanted_q, wanted_v, wanted_a, seen_q, seen_v, given, at_q, at_v, noise in bar:
        if state.lost:
            what = f"the closed loop diverged {now - t[0]:.3g} s after its start"
            raise UsageError(name, what, "lower the controller's bandwidth or its delay")
        at_q[:], at_v[:], seen_q[:] = state.q, state.v, sense.angle(state.q)
        np.add(state.v, noise, out=seen_v)
        wanted, memory = controller.torque(
            now, seen_q, seen_v, Reference(wanted_q, wanted_v, wanted_a), memory
        )
        pending.append(wanted)
        np.minimum(np.maximum(pending.popleft(), -limit), limit, out=given)
        acting = motors.acting(given, state)
        for k in range(steps):
            state = system.step(now + k * dt / steps, state, acting, dt / steps)
    return q, v, tau, true_q, true_v


def resample_halfway(platform: Platform, t: Array, steps: int = 1) -> Platform:
    """Return a platform's motion where Runge-Kutta's stages look, in so many steps per sample of `t`.

    Raises:
        UsageError: It does not last from the first to the last of them.
    """
    step = float(t[1] - t[0])
    if platform.t[0] > t[0] + step / 2 or platform.t[-1] < t[-1] - step / 2:
        what = f"lasts from {platform.t[0]:g} to {platform.t[-1]:g} s, the reference from {t[0]:g} to {t[-1]:g} s"
        raise UsageError(
            "platform", what, "give a longer motion of the platform, or a shorter reference"
        )
    return platform.at(t[0] + step / 2 / steps * np.arange(2 * steps * (len(t) - 1) + 1))
