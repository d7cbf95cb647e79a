"""A camera that is held on a moving platform: the sensors before `simulate`'s loop, and runs over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.plant import State
from gimbal_pin.dynamics.sensors import Sensors
from gimbal_pin.dynamics.simulation import Reference, resample_halfway, simulate
from gimbal_pin.effects import Signal
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.bench import draw_profile
from gimbal_pin.pointing.measurement import Measurement, Station
from gimbal_pin.pointing.pointer import Holder
from gimbal_pin.pointing.recipe import Recipe
from gimbal_pin.pointing.result import Pointing, Row
from gimbal_pin.pointing.sight import Sight


class Sensed:
    """The sensors along a run: they see the plant's state and the platform."""

    def __init__(
        self, plant: Model, platform: Platform, station: Station, t: Array, rng: np.random.Generator
    ) -> None:
        """Draw the noise of a whole run; `platform` is sampled at t and halfway between."""
        self.sight = Sight(plant.rig)
        self.station = station
        self.t = t.tolist()
        noise = station.draws(len(t), len(self.sight.moved), float(t[1] - t[0]), rng)
        self.w = np.asarray(platform.w[::2])
        self.platform_imu = np.stack([platform.w[::2], platform.f[::2]], axis=1) + noise[:, 1:3]
        self.noise = np.delete(noise, (1, 2), axis=1).reshape(len(t), -1)

    def see(self, k: int, q: Array, v: Array) -> Measurement:
        """Return the measurement of angles and rates at sample k."""
        gyros = self.sight.rates(q, v, self.w[k]) + self.noise[k]
        w, f = self.platform_imu[k]
        return Measurement(self.t[k], self.station.angles(q), gyros[:3], w, f, gyros[3:])


class SensedHolder:
    """A holder behind its sensors: a `simulation.Controller` that is shown true angles and rates.

    Attributes:
        events: What has happened so far.
    """

    def __init__(self, holder: Holder, sensed: Sensed, attitudes: Array) -> None:
        """Hold the camera with the platform's attitude in the world at every sample, (N, 3, 3)."""
        self.holder, self.sensed, self.attitudes = holder, sensed, attitudes
        self.dt = holder.dt
        self.events = ()

    def start(self) -> None:
        """Remember nothing: the holder starts with the first measurement."""

    def torque(
        self, t: float, q: Array, v: Array, reference: Reference, memory: Any
    ) -> tuple[Array, Any]:
        """Return the holder's torque and its next memory."""
        k = round(t / self.dt)
        seen = self.sensed.see(k, q, v)
        if memory is None:
            base = self.attitudes[k]
            memory = self.holder.start(seen, base @ self.sensed.sight.attitude(q), base)
        command, memory = self.holder.torque(seen, memory)
        self.events = memory.events
        return command, memory

    @property
    def at_rest(self) -> State:
        """The state in which the camera looks as wanted at the first sample and does not turn."""
        sight = self.sensed.sight
        q = sight.reached(self.attitudes[0], self.holder.navigator.wanted, sight.home)
        view = sight.view(q)
        return State(q, view.against @ view.R.T @ self.sensed.w[0])


def simulate_holding(
    plant: Model,
    holder: Holder,
    platform: Platform,
    *,
    rng: np.random.Generator,
    seconds: float = 30.0,
    station: Station | None = None,
    delay: int = 1,
    drive: Sequence[Signal] = (),
    name: str = "pointing",
) -> Pointing:
    """Hold a camera along a platform's motion; it starts where it should look, turning with nothing.

    Args:
        plant: The plant.
        holder: The controller.
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
    rig = plant.rig
    t = holder.dt * np.arange(round(seconds / holder.dt) + 1)
    base = resample_halfway(platform, t)
    if base.quat is None:
        raise UsageError(
            "platform", "has no attitude", "give one with the motion: the camera's error needs it"
        )
    quat = np.asarray(base.quat[::2])
    attitudes = Rotation.from_quat(quat, scalar_first=True).as_matrix()
    behind = SensedHolder(
        holder, Sensed(plant, base, station or Station.of(rig), t, rng), attitudes
    )
    log = simulate(
        plant, behind, Motion(t, *np.zeros((3, len(t), rig.n))), rng=rng, sensors=Sensors.exact(rig.n), delay=delay,
        drive=drive, start=behind.at_rest, platform=base, name=name,
    )  # fmt: skip
    error = errors(behind.sensed.sight, log.q, attitudes, holder.navigator.wanted)
    return Pointing(
        name,
        "S",
        0,
        rig.joints,
        t,
        error,
        log.q,
        np.asarray(log.tau),
        quat,
        rig.tau_max,
        behind.events,
    )


def errors(sight: Sight, q: Array, base: Array, wanted: Array) -> Array:
    """``log(R_dᵀ R)`` along a run, rad, (N, 3)."""
    return np.array([pin.log3(wanted.T @ R @ sight.attitude(angles)) for R, angles in zip(base, q)])


@dataclass(frozen=True, eq=False)
class Course:
    """What all controllers of an evaluation meet.

    Attributes:
        plant: The plant.
        seconds: Length of a run, s.
        station: The sensors.
        drive: What stands between command and torque, after the plant's own.
        delay: Samples from measurement to torque.
        recorded: The platform's motion in every run; None: profile S, one per seed.
        size: Profile S times this.
    """

    plant: Model
    seconds: float
    station: Station
    drive: tuple[Signal, ...] = ()
    delay: int = 1
    recorded: Platform | None = None
    size: float = 1.0

    def run(self, recipe: Recipe, name: str, seed: int) -> Pointing:
        """Run one controller, by name, with one seed."""
        platform = self.recorded
        if platform is None:
            platform = draw_profile(self.plant.rig, self.seconds, seed, recipe.dt, self.size)
        run = simulate_holding(
            self.plant, recipe.pointer(name), platform, rng=np.random.default_rng([seed, 1]), seconds=self.seconds,
            station=self.station, delay=self.delay, drive=self.drive, name=name,
        )  # fmt: skip
        return replace(run, platform="S" if self.recorded is None else "log", seed=seed)


def run_controllers(course: Course, recipe: Recipe, seeds: int, jobs: int = 1) -> tuple[Row, ...]:
    """Run every controller of a recipe with every seed, in so many processes, under a progress bar."""
    plan = [(name, seed) for seed in range(seeds) for name in recipe.names]
    with ExitStack() as stack:
        pool = None if jobs == 1 else stack.enter_context(ProcessPoolExecutor(min(jobs, len(plan))))
        ran = (map if pool is None else pool.map)(partial(course.run, recipe), *zip(*plan))
        runs = list(
            tqdm(ran, "pointing", len(plan), unit="run", disable=None, leave=False, delay=2)
        )
    return tuple(
        Row(name, tuple(run for run in runs if run.controller == name)) for name in recipe.names
    )
