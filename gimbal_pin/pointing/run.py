"""Closed loop of plant, moving platform, sensors, delay and a controller that holds the camera still."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from gimbal_pin.control.laws.base import Carried
from gimbal_pin.dynamics.model import Model, build_friction_effects
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.dynamics.simulation import Drive, _resample_halfway
from gimbal_pin.effects import Signal
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.measurement import Measurement, Station
from gimbal_pin.pointing.pointer import Holder
from gimbal_pin.pointing.result import Contest, Pointing, Row
from gimbal_pin.pointing.roster import Roster
from gimbal_pin.pointing.sight import Sight


class Sensed:
    """The sensors along a run: they see the plant's state and the platform."""

    def __init__(self, plant: Model, platform: Platform, station: Station, t: Array, rng: np.random.Generator) -> None:
        """Draw the noise of a whole run; `platform` is sampled at t and halfway between."""
        self.sight, self.station, self.t = Sight(plant.rig), station, t.tolist()
        noise = station.draws(len(t), len(self.sight.moved), float(t[1] - t[0]), rng)
        self.w = np.asarray(platform.w[::2])
        self.platform_imu = np.stack([platform.w[::2], platform.f[::2]], axis=1) + noise[:, 1:3]
        self.noise = np.delete(noise, (1, 2), axis=1).reshape(len(t), -1)
        self.rows = np.hstack([platform.w, platform.f, platform.dw])
        self.before: Measurement | None = None

    def see(self, k: int, state: State, leads: tuple[float, ...] = ()) -> Measurement | None:
        """Return what arrives of what the sensors say at sample k; the oracle sees `leads` half-samples ahead."""
        gyros = self.sight.rates(state.q, state.v, self.w[k]) + self.noise[k]
        w, f = self.platform_imu[k]
        rows = [self.held(2 * k + lead) for lead in leads]
        true = tuple([Carried(row[3:6], row[:3], row[6:9]) for row in rows]) or None
        arrived: Measurement | None = Measurement(
            self.t[k], self.station.angles(state.q), gyros[:3], w, f, gyros[3:], true
        )
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
) -> Pointing:
    """Run the loop; the camera starts where it should look, turning with nothing.

    At sample k the controller gets the measurement at `t[k]`; its torque acts `delay` samples later, clipped, for one
    sample. The plant is integrated by RK4, one step per sample, the platform looked at in half steps.

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

    Raises:
        UsageError: The platform's motion is too short or has no attitude, or the state left the finite numbers.
    """
    dt, rig = pointer.dt, plant.rig
    t = dt * np.arange(round(seconds / dt) + 1)
    base = _resample_halfway(platform, t)
    if base.quat is None:
        raise UsageError("platform", "has no attitude", "give one with the motion: the camera's error needs it")
    quat = np.asarray(base.quat[::2])
    sensed = Sensed(plant, base, station or Station.of(rig), t, rng)
    attitudes = Rotation.from_quat(quat, scalar_first=True).as_matrix()
    motors = Drive((*plant.drive, *drive), rig, dt, plant)
    q, tau, events = run_loop(pointer, Plant(plant, base), motors, sensed, attitudes, delay, name)
    error = errors(sensed.sight, q, attitudes, pointer.navigator.wanted)
    return Pointing(name, "S", 0, rig.joints, t, error, q, tau, quat, rig.tau_max, events)


class System(Protocol):
    """A plant on its platform, as `run_loop` integrates it."""

    def step(self, t: float, state: State, tau: Array, dt: float) -> State:
        """Return the state a sample later."""


def run_loop(
    pointer: Holder, system: System, motors: Drive, sensed: Sensed, attitudes: Array, delay: int, name: str
) -> tuple[Array, Array, tuple[str, ...]]:
    """Run the loop; return true angles and commanded torques, (N, n) each, and what happened.

    Args:
        pointer: The controller.
        system: The plant, on its platform.
        motors: The drives.
        sensed: The sensors.
        attitudes: Attitude of the platform in the world at every sample, (N, 3, 3).
        delay: Samples between measurement and torque.
        name: For the progress bar and for errors.
    """
    t, dt, navigator, sight = sensed.t, pointer.dt, pointer.navigator, sensed.sight
    limit = sight.rig.tau_max
    leads = tuple([2 * lead / dt for lead in navigator.forecast.leads]) if navigator.oracle else ()
    view = sight.view(q0 := sight.reached(attitudes[0], navigator.wanted, sight.home))
    state = State(q0, view.against @ view.R.T @ sensed.w[0])  # the camera looks as wanted and does not turn
    command: Array = np.zeros(len(limit))
    pending: deque[Array] = deque([command] * delay)
    memory, q, tau = None, np.empty((len(t), len(limit))), np.empty((len(t), len(limit)))
    for k in tqdm(range(len(t)), name, unit="sample", disable=None, leave=False, delay=2):
        if state.lost:
            raise UsageError(name, f"diverged {t[k]:.3g} s after its start", "lower bandwidth or delay")
        seen = sensed.see(k, state, leads)
        if seen is not None:
            if memory is None:
                memory = pointer.start(seen, attitudes[k] @ sight.attitude(state.q), attitudes[k])
            command, memory = pointer.torque(seen, memory)
        pending.append(command)
        acting = np.minimum(np.maximum(pending.popleft(), -limit), limit)
        q[k], tau[k] = state.q, acting
        state = system.step(t[k], state, motors.acting(acting, state), dt)
    return q, tau, () if memory is None else memory.events


def errors(sight: Sight, q: Array, base: Array, wanted: Array) -> Array:
    """``log(R_dᵀ R)`` along a run, rad, (N, 3)."""
    return np.array([pin.log3(wanted.T @ R @ sight.attitude(angles)) for R, angles in zip(base, q)])


Ground = Callable[[int], Platform]
"""The platform's motion of a seed, sampled at half the control interval."""


@dataclass(frozen=True, eq=False)
class Course:
    """What all controllers of a contest meet.

    Attributes:
        plant: The plant.
        ground: The platform's motion of a seed.
        motion: What it is called: "S" or "log".
        seconds: Length of a run, s.
        station: The sensors.
        drive: What stands between command and torque, after the plant's own.
        delay: Samples from measurement to torque.
    """

    plant: Model
    ground: Ground
    motion: str
    seconds: float
    station: Station
    drive: tuple[Signal, ...] = ()
    delay: int = 1

    def run(self, roster: Roster, name: str, seed: int) -> Pointing:
        """Run one controller, by name, with one seed."""
        return self.held(roster.holder(name), seed, name)

    def held(self, pointer: Holder, seed: int, name: str = "pointing") -> Pointing:
        """Run a controller with one seed."""
        ground, rng = self.ground(seed), np.random.default_rng([seed, 1])
        run = point(
            self.plant, pointer, ground, rng=rng, seconds=self.seconds, station=self.station, delay=self.delay,
            drive=self.drive, name=name,
        )  # fmt: skip
        return replace(run, platform=self.motion, seed=seed)


def compete(course: Course, roster: Roster, names: Sequence[str], seeds: int, jobs: int = 1) -> Contest:
    """Run every controller with every seed, in so many processes, under a progress bar."""
    plan = [(name, seed) for seed in range(seeds) for name in names]
    with ExitStack() as stack:
        pool = None if jobs == 1 else stack.enter_context(ProcessPoolExecutor(min(jobs, len(plan))))
        ran = (map if pool is None else pool.map)(partial(course.run, roster), *zip(*plan))
        runs = list(tqdm(ran, "pointing", len(plan), unit="run", disable=None, leave=False, delay=2))
    rows = [Row(name, tuple(run for run in runs if run.controller == name)) for name in names]
    plain = build_friction_effects(course.plant.rig.joints)
    beside = dict.fromkeys(term.effect.name for term in roster.model.terms if term.effect not in plain)
    return Contest(course.plant.rig.name, course.plant.rig.payload, tuple(rows), tuple(beside))
