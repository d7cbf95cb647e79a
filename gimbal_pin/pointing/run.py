"""Closed loop of plant, moving platform, sensors, delay and a controller that holds the camera still."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from tqdm import tqdm

from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.dynamics.simulation import Drive, halved
from gimbal_pin.effects import Signal
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.navigator import carried
from gimbal_pin.pointing.pointer import Holder
from gimbal_pin.pointing.result import Pointing
from gimbal_pin.pointing.seen import Seen, Station, rotations
from gimbal_pin.pointing.sight import Sight


class Sensed:
    """The sensors along a run: they see the plant's state and the platform."""

    def __init__(self, plant: Model, platform: Platform, station: Station, t: Array, rng: np.random.Generator) -> None:
        """Draw the noise of a whole run; `platform` is sampled at t and halfway between."""
        self.sight, self.station, self.t = Sight(plant.rig), station, t.tolist()
        noise = station.draws(len(t), len(self.sight.moved), float(t[1] - t[0]), rng)
        self.w = np.asarray(platform.w[::2])
        self.told = np.stack([platform.w[::2], platform.f[::2]], axis=1) + noise[:, 1:3]
        self.noise = np.delete(noise, (1, 2), axis=1).reshape(len(t), -1)
        self.rows = np.hstack([platform.w, platform.f, platform.dw])
        self.before: Seen | None = None

    def see(self, k: int, state: State, leads: tuple[float, ...] = ()) -> Seen | None:
        """Return what arrives of what the sensors say at sample k; the oracle sees `leads` half-samples ahead."""
        gyros = self.sight.rates(state.q, state.v, self.w[k]) + self.noise[k]
        w, f = self.told[k]
        true = tuple([carried(self.held(2 * k + lead)) for lead in leads]) or None
        arrived: Seen | None = Seen(self.t[k], self.station.angles(state.q), gyros[:3], w, f, gyros[3:], true)
        for fault in self.station.faults:
            arrived = None if arrived is None else fault.apply(arrived, self.before)
        self.before = self.before if arrived is None else arrived
        return arrived

    def held(self, place: float) -> Array:
        """Mean of the platform's true motion over the hold about a place, by Simpson's rule: what a torque answers."""
        return (self.at(place - 1) + 4 * self.at(place) + self.at(place + 1)) / 6

    def at(self, place: float) -> Array:
        """The platform's true motion at a place among its samples, (9,), the last one beyond them."""
        first = min(int(place), len(self.rows) - 2)
        part = min(place - first, 1.0)
        return np.asarray((1 - part) * self.rows[first] + part * self.rows[first + 1])


def point(
    plant: Model,
    pointer: Holder,
    platform: Platform,
    *,
    rng: np.random.Generator,
    seconds: float = 30.0,
    station: Station | None = None,
    delay: int = 1,
    drive: Sequence[Signal] = (),
    name: str = "pointing",
    motion: str = "S",
    seed: int = 0,
) -> Pointing:
    """Run the loop; the camera starts where it should look, turning with nothing.

    At sample k the controller sees the sensors at `t[k]`; its torque acts `delay` samples later, clipped, for one
    sample. The plant is integrated by RK4, one step per sample, the platform seen at half steps.

    Args:
        plant: The plant.
        pointer: The controller.
        platform: Motion of the base with its attitude, best sampled at half the control interval.
        rng: Source of the sensors' noise.
        seconds: Length, s.
        station: The sensors; None: the benchmark's.
        delay: Samples between measurement and torque.
        drive: What stands between the command and the torque that acts, after the plant's own.
        name: The controller's name.
        motion: What the platform's motion is called.
        seed: What the seed is called.

    Raises:
        UsageError: The platform's motion is too short or has no attitude, or the state left the finite numbers.
    """
    dt, rig = pointer.dt, plant.rig
    t = dt * np.arange(round(seconds / dt) + 1)
    base = halved(platform, t)
    if base.quat is None:
        raise UsageError("platform", "has no attitude", "give one with the motion: the camera's error needs it")
    quat = np.asarray(base.quat[::2])
    sensed = Sensed(plant, base, station or Station.of(rig), t, rng)
    loop = Loop(Plant(plant, base), Drive((*plant.drive, *drive), rig, dt, plant), sensed, rotations(quat), delay, name)
    q, tau, events = loop.run(pointer)
    error = errors(sensed.sight, q, loop.attitudes, pointer.navigator.wanted)
    return Pointing(name, motion, seed, rig.joints, t, error, q, tau, quat, rig.tau_max, events)


@dataclass(frozen=True, eq=False)
class Loop:
    """Plant, drives and sensors, ready to run.

    Attributes:
        system: The plant, on the platform.
        motors: The drives.
        sensed: The sensors.
        attitudes: Attitude of the platform in the world at every sample, (N, 3, 3).
        delay: Samples between measurement and torque.
        name: What a bar and an error speak of.
    """

    system: Plant
    motors: Drive
    sensed: Sensed
    attitudes: Array
    delay: int
    name: str

    def run(self, pointer: Holder) -> tuple[Array, Array, tuple[str, ...]]:
        """Return true angles and commanded torques, (N, n) each, and what happened."""
        t, dt, navigator, limit = self.sensed.t, pointer.dt, pointer.navigator, self.system.model.rig.tau_max
        leads = tuple([2 * lead / dt for lead in navigator.forecast.leads]) if navigator.oracle else ()
        lowest = -limit
        state = ready(self.sensed, self.attitudes[0], navigator.wanted)
        command: Array = np.zeros(len(limit))
        pending: deque[Array] = deque([command] * self.delay)
        memory, q, tau = None, np.empty((len(t), len(limit))), np.empty((len(t), len(limit)))
        for k in tqdm(range(len(t)), self.name, unit="sample", disable=None, leave=False, delay=2):
            if state.lost:
                raise UsageError(self.name, f"diverged {t[k]:.3g} s after its start", "lower bandwidth or delay")
            seen = self.sensed.see(k, state, leads)
            if memory is None and seen is not None:
                camera = self.attitudes[k] @ self.sensed.sight.attitude(state.q)
                memory = pointer.start(seen, camera, self.attitudes[k])
            if memory is not None and seen is not None:
                command, memory = pointer.torque(seen, memory)
            pending.append(command)
            acting = np.minimum(np.maximum(pending.popleft(), lowest), limit)
            q[k], tau[k] = state.q, acting
            state = self.system.step(t[k], state, self.motors.acting(acting, state), dt)
        return q, tau, () if memory is None else memory.told


def ready(sensed: Sensed, base: Array, wanted: Array) -> State:
    """Return the state in which the camera looks as wanted and does not turn."""
    sight = sensed.sight
    q = sight.reached(base, wanted, sight.home)
    view = sight.view(q)
    return State(q, view.against @ view.R.T @ sensed.w[0])


def errors(sight: Sight, q: Array, base: Array, wanted: Array) -> Array:
    """``log(R_dᵀ R)`` along a run, rad, (N, 3)."""
    left = wanted.T @ base @ sight.attitudes(q)
    return np.array([pin.log3(turn) for turn in left])
