"""Closed loop of plant, sensors, delay and controller; what it returns is a `Log`, like a measured one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any, NamedTuple, Protocol

import numpy as np
from tqdm import tqdm

from gimbal_pin.config import Noise
from gimbal_pin.effects import RigEffect, Sample, Signal, Term
from gimbal_pin.effects.signal import Borne
from gimbal_pin.errors import UsageError
from gimbal_pin.imu import noisy, readings
from gimbal_pin.log import Array, Imu, Log, Motion
from gimbal_pin.model import Model, brakes, friction_effects
from gimbal_pin.plant import Plant, State
from gimbal_pin.platform import Platform
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
        return Sensors(steps, np.full(rig.n, rate), np.full(rig.n, torque_std), noise=rig.config.noise)

    def angle(self, q: Array) -> Array:
        """The angle as the encoder reports it, rad, (n,)."""
        angles, steps = q.tolist(), self.encoder_step.tolist()
        return np.array([round(x / step) * step if step > 0 else x for x, step in zip(angles, steps)])


Planted = Term | Signal | RigEffect


class Altered(NamedTuple):
    """A plant with causes planted in it: what `simulate` takes as `plant` and `drive`."""

    plant: Model
    drive: tuple[Signal, ...]


def plant_with(model: Model, causes: Sequence[Planted]) -> Altered:
    """Return the plant that a model becomes with some causes on top: more terms, signals in its drive, its rig changed.

    Bristles are a joint's dry friction: they take the place of its Coulomb friction.

    Args:
        model: The model to start from.
        causes: Terms, drive signals (in the order in which the command passes them) and rig effects.

    Raises:
        UsageError: A joint that the rig does not have, or dry friction that would push somewhere.
    """
    rig, changes = model.rig, tuple(cause for cause in causes if isinstance(cause, RigEffect))
    for cause in causes:
        if isinstance(cause, RigEffect):
            rig = cause.apply(rig)
        else:
            rig.joint_index((cause.effect if isinstance(cause, Term) else cause).joint)
    added = tuple(cause for cause in causes if isinstance(cause, Term))
    bristled = {term.effect.joint for term in added if term.effect.bristly and any(term.values)}
    bent = {effect for effect in friction_effects(sorted(bristled)) if effect.dry}
    terms = (*(replace(term, values=(0.0,)) if term.effect in bent else term for term in model.terms), *added)
    plant = replace(model, rig=rig, terms=terms, estimated=None, changes=(*model.changes, *changes))
    check_dry(plant)
    return Altered(plant, tuple(cause for cause in causes if isinstance(cause, Signal)))


def check_dry(plant: Model) -> None:
    """Raise `UsageError` if a joint's dry friction at rest, unloaded, is negative anywhere on a turn."""
    q = np.repeat(np.linspace(-np.pi, np.pi, 2001)[:, None], plant.rig.n, axis=1)
    zero = np.zeros_like(q)
    for t in (0.0, 1e6):
        for way in (1.0, -1.0):
            least = plant.level(q, zero, zero, zero, np.full(len(q), t), way + zero).min(axis=0)
            for joint, level in zip(plant.rig.joints, least.tolist()):
                if level < -1e-9:
                    what = f"has a dry friction of {level:.3g} N m somewhere: it would push"
                    raise UsageError(f"joint {joint}", what, "plant less of it, or more Coulomb friction")


class Drive:
    """The drives of all joints: commands in, acting torques out, with the memory of the signals in between."""

    def __init__(self, signals: Sequence[Signal], rig: Rig, dt: float, plant: Model | None = None) -> None:
        """Start every signal at rest; `plant`: whose friction stands before a gap, None: nobody's."""
        self.dt, self.plant = dt, plant
        self.chain = [(rig.joint_index(signal.joint), signal) for signal in signals]
        self.memory = [signal.start() for signal in signals]

    def acting(self, command: Array, state: State | None = None) -> Array:
        """Return the mean torque that acts over the next interval, N m, (n,), from a state of the plant."""
        if not self.chain:
            return command
        out = command.tolist()
        for i, (j, signal) in enumerate(self.chain):
            beside = 0.0
            if signal.geared and self.plant is not None and state is not None:
                beside = float(signal.beside(borne(self.plant, j, state, out[j])))
            self.memory[i], passed = signal.step(self.memory[i], out[j] + beside, self.dt)
            out[j] = passed - beside
        return np.array(out)


def borne(plant: Model, joint: int, state: State, torque: float) -> Borne:
    """What a joint bears in a state of the plant; at rest its dry friction takes what it can of the torque."""
    q, rate = float(state.q[joint]), float(state.v[joint])
    terms = [term for term in plant.by_joint[joint] if brakes(term.effect)]
    asked = float(plant.inverse(state.q[None], state.v[None], 0.0 * state.v[None])[0, joint])
    slides = [float(sum(t.torque(Sample(0.0, q, rate, 0.0, way, 0.0)) for t in terms)) for way in (-1.0, 1.0)]
    if rate:
        brake = slides[rate > 0]
        return Borne(brake, asked - brake)
    return Borne(min(max(torque - asked, slides[0]), slides[1]), asked)


def simulate(
    plant: Model,
    controller: Controller,
    reference: Motion,
    *,
    rng: np.random.Generator,
    sensors: Sensors | None = None,
    delay: int = 1,
    drive: Sequence[Signal] = (),
    start: State | None = None,
    platform: Platform | None = None,
    name: str = "simulated",
) -> Log:
    """Run the closed loop along a reference sampled at the controller's interval.

    At sample k the controller sees the sensors at `t[k]`; its torque reaches the motors `delay` samples later, is
    clipped at their limits, and is held for one sample. The plant is integrated by RK4, one step per sample.

        plant, drive = plant_with(model, [parse_effect("cogging:yaw:amplitude=0.03,harmonic=42", rig)])
        log = simulate(plant, controller, reference, rng=rng, drive=drive)

    Args:
        plant: The plant: a model whose terms need not be the controller's.
        controller: The control law.
        reference: Reference, one sample per control interval.
        rng: Source of the sensors' noise.
        sensors: The sensors; None: the rig's encoders and gyros.
        delay: Samples between measurement and torque.
        drive: What stands between the command, which the log keeps, and the torque that acts, after the plant's own.
        start: State at the first sample; None: at rest on the reference.
        platform: Motion of the base, best sampled at half the control interval; None: it stands, which is faster.
        name: Name of the log.

    Returns:
        A log of the measured angles and rates, of the torque commanded for each interval, as the drive reports it, and
        of the IMUs.

    Raises:
        UsageError: The reference is not sampled at the controller's interval, the platform's motion does not last as
            long, or the state left the finite numbers.
    """
    dt, t = controller.dt, reference.t
    if len(t) < 2 or not np.allclose(np.diff(t), dt, rtol=1e-6):
        raise UsageError("reference", f"is not sampled every {dt:g} s", "resample it to the controller's interval")
    sense = sensors if sensors is not None else Sensors.of(plant.rig, dt)
    rate_noise = sense.rate_std * rng.standard_normal(reference.q.shape)
    torque_noise = sense.torque_std * rng.standard_normal(reference.q.shape)
    carried = None if platform is None else halved(platform, t)
    motors = Drive((*plant.drive, *drive), plant.rig, dt, plant)
    sinking = plant.carried(t[0] + dt / 2 * np.arange(2 * len(t) - 1), carried)
    loop = Loop(Plant(plant, sinking), motors, controller, sense, rate_noise, delay, name)
    seen = loop.run(reference, State(reference.q[0].copy(), reference.v[0].copy()) if start is None else start)
    base = None if carried is None else carried.part(slice(0, None, 2))
    return Log(
        name=name,
        joints=plant.rig.joints,
        t=t,
        q=seen.q,
        v=seen.v,
        tau=seen.tau + torque_noise,
        q_ref=reference.q,
        imus=imus(plant.rig, sense, t, seen.exact, base, rng),
        payload=plant.rig.payload,
    )


class Run(NamedTuple):
    """What a loop left.

    Attributes:
        q: Measured angles, rad, (N, n).
        v: Measured rates, rad/s, (N, n).
        tau: Commanded torques, N m, (N, n).
        exact: True angles and rates, (2, N, n).
    """

    q: Array
    v: Array
    tau: Array
    exact: Array


@dataclass(frozen=True, eq=False)
class Loop:
    """Plant, drives, controller and sensors, ready to run.

    Attributes:
        system: The plant, on its platform.
        motors: The drives.
        controller: The control law.
        sense: The sensors.
        rate_noise: What is added to every rate, rad/s, (N, n).
        delay: Samples between measurement and torque.
        name: What a bar and an error speak of.
    """

    system: Plant
    motors: Drive
    controller: Controller
    sense: Sensors
    rate_noise: Array
    delay: int
    name: str

    def run(self, reference: Motion, state: State) -> Run:
        """Follow a reference from a state."""
        q, v, tau, states = *(np.empty(reference.q.shape) for _ in range(3)), list[State]()
        dt, limit, memory = self.controller.dt, self.system.model.rig.tau_max, self.controller.start()
        pending: deque[Array] = deque([np.zeros(len(limit))] * self.delay)
        t, rows = reference.t.tolist(), zip(reference.q, reference.v, reference.a)
        for k, wished in enumerate(tqdm(rows, self.name, len(t), unit="sample", disable=None, leave=False, delay=2)):
            if not isfinite(sum(state.q.tolist())):
                what = f"the closed loop diverged {t[k] - t[0]:.3g} s after its start"
                raise UsageError(self.name, what, "lower the controller's bandwidth or its delay")
            states.append(state)
            q[k], v[k] = self.sense.angle(state.q), state.v + self.rate_noise[k]
            wanted, memory = self.controller.torque(t[k], q[k], v[k], Reference(*wished), memory)
            pending.append(wanted)
            tau[k] = np.minimum(np.maximum(pending.popleft(), -limit), limit)
            state = self.system.step(t[k], state, self.motors.acting(tau[k], state), dt)
        return Run(q, v, tau, np.array([[state.q for state in states], [state.v for state in states]]))


def halved(platform: Platform, t: Array) -> Platform:
    """Return a platform's motion at the times `t` and halfway between: where Runge-Kutta's stages look.

    Raises:
        UsageError: It does not last from the first to the last of them.
    """
    step = float(t[1] - t[0])
    if platform.t[0] > t[0] + step / 2 or platform.t[-1] < t[-1] - step / 2:
        what = f"lasts from {platform.t[0]:g} to {platform.t[-1]:g} s, the reference from {t[0]:g} to {t[-1]:g} s"
        raise UsageError("platform", what, "give a longer motion of the platform, or a shorter reference")
    return platform.at(t[0] + step / 2 * np.arange(2 * len(t) - 1))


def imus(
    rig: Rig, sense: Sensors, t: Array, exact: Array, platform: Platform | None, rng: np.random.Generator
) -> dict[str, Imu]:
    """Return what the IMUs report along true angles and rates, (2, N, n); accelerations are the rates' differences."""
    links = [link for link in dict.fromkeys((rig.base, *sense.imus)) if platform is not None or link in sense.imus]
    if not links:
        return {}
    q, v = exact
    dt = float(t[1] - t[0])
    true = readings(rig, links, q, v, np.gradient(v, dt, axis=0), Platform.still(t) if platform is None else platform)
    return {link: noisy(imu, sense.noise, dt, rng) for link, imu in true.items()}
