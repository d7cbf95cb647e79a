"""What `gimbal_pin.Controller` does in one's own loop: the rows of CONTROL's last table.

Printed: how it starts from rest, how level it is, what one wrong reading does to it, how long a step takes, and how
still the camera stands. The plant differs from the model that the controller knows, as in `cases`.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from copy import copy
from functools import partial
from math import degrees, radians
from pathlib import Path
from time import thread_time

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from camera.cases import CASES, DT, taught
from gimbal_pin.cli.inputs import read_platform
from gimbal_pin.control.experiment import perturbed
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.dynamics.simulation import resample_halfway
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing import Controller, Measurement, Recipe, Sensed, Sight, Station
from gimbal_pin.pointing.bench import WANTED, draw_profile, unbalance_payload
from gimbal_pin.pointing.result import SETTLING, jitter
from gimbal_pin.rig.rig import Rig

WRONG = (0.003, 0.01, 0.03, 0.06, 0.1, 0.3, 1.0, 10.0, 100.0, 1e3, 1e6, 1e155)
"""Errors of one reading, in the sensor's unit."""
MOMENTS = (1500, 1833, 2166)
"""Samples at which one reading is wrong."""
AFTERWARDS = 250
"""Samples for which its effect is looked at."""
TILTED = (0, 1, 5, 10, 20, 40, 60)
"""Times at which the camera's tilt is told, s."""


class Loop:
    """A rig on a platform with a controller in its loop, which may be copied at any sample."""

    def __init__(
        self, rig: Rig, platform: Platform, seconds: float, seed: int, level: bool = True
    ) -> None:
        """Begin where the camera looks as wanted; `level`: whether the platform's first attitude is told."""
        station = Station.of(rig)
        model = nominal(unbalance_payload(rig))
        spectrum = taught(CASES["as-known"], rig)
        recipe = Recipe(model, WANTED, spectrum, station.noise, float(station.step.max()))
        self.controller, self.sight = Controller(recipe), recipe.sight
        plant = perturbed(model.rig, 0.03, np.random.default_rng([seed, 2]))
        self.t = DT * np.arange(round(seconds / DT) + 1)
        base = resample_halfway(platform, self.t)
        assert base.quat is not None
        self.base = Rotation.from_quat(np.asarray(base.quat[::2]), scalar_first=True).as_matrix()
        self.sensed = Sensed(plant, base, station, self.t, np.random.default_rng([seed, 1]))
        self.system = Plant(plant, base)
        self.k = 0
        q = self.sight.reached(self.base[0], WANTED, self.sight.home)
        view = self.sight.view(q)
        self.state = State(q, view.against @ view.R.T @ np.asarray(base.w[0]))
        self.command = 0 * q
        self.level = level
        self.stream = list[Measurement]()

    def run(
        self, samples: int, spoil: Callable[[Measurement], Measurement] = lambda seen: seen
    ) -> tuple[Array, ...]:
        """Go on; the first measurement is spoiled. Return angles, rates, torques and errors of the line of sight."""
        rows = []
        for k in range(self.k, min(self.k + samples, len(self.t))):
            seen = self.sensed.see(k, self.state.q, self.state.v)
            seen = spoil(seen) if k == self.k else seen
            self.stream.append(seen)
            if k == 0:
                self.controller.start(seen, self.base[0] if self.level else None)
            acting, self.command = self.command, self.controller.step(seen)
            camera = self.base[k] @ self.sight.attitude(self.state.q)
            rows.append(
                (self.state.q, self.state.v, acting, pin.log3(WANTED.T @ camera)[1:], camera)
            )
            self.state = self.system.step(self.t[k], self.state, acting, DT)
        self.k += len(rows)
        return tuple(np.array(column) for column in zip(*rows))

    def branch(self) -> Loop:
        """Return a copy that goes its own way."""
        other = copy(self)
        other.controller = copy(self.controller)
        return other


def standing(seconds: float) -> Platform:
    """Return a platform at rest."""
    return Platform.still(DT / 2 * np.arange(2 * round(seconds / DT) + 1))


def start(rig: Rig, seeds: int) -> None:
    """From rest at random poses within the limits, the camera turns to where it shall look."""
    lower, upper, fastest = (
        np.array([getattr(x, key) for x in rig.limits]) for key in ("lower", "upper", "velocity")
    )
    loop = Loop(rig, standing(4.0), 4.0, 0)
    rng = np.random.default_rng(7)
    rows = []
    for _ in range(100):
        own = loop.branch()
        q = lower + (upper - lower) * rng.random(rig.n)
        own.state = State(q, 0 * q)
        way = loop.controller.recipe.looking - q
        angles, rates, torques, error, _ = own.run(4000)
        past = ((angles - q) / way - 1) * np.abs(way) / np.maximum(np.abs(way), radians(1.0))
        off = np.flatnonzero(np.degrees(np.linalg.norm(error, axis=1)) > 0.02)
        settled = DT * (off[-1] + 1) if len(off) else 0.0
        rows.append(
            (100 * past.max(), (np.abs(rates) / fastest).max(), (np.abs(torques) / rig.tau_max).max(), settled,
             settled - (np.abs(way) / fastest).max())
        )  # fmt: skip
    past, rate, torque, settled, late = np.array(rows).T
    print(f"  start, 100 draws: overshoot {past.max():.2f} %, rate {rate.max():.3f} and torque {torque.max():.2f} of "
          f"their limits; settled to .02 deg after {np.median(settled):.2f} s (median), {settled.max():.2f} s (last), "
          f"{late.max():.2f} s after the slowest joint at its limit; within 1 s {(settled <= 1).mean():.0%}, "
          f"within 2 s {(settled <= 2).mean():.0%}")  # fmt: skip


def level(rig: Rig, seeds: int) -> None:
    """Started on one sample of the accelerometer, at rest and in motion: tilt of the camera over a minute."""
    for name in ("rest", "S"):
        for seed in range(seeds):
            ground = standing(60.0) if name == "rest" else draw_profile(rig, 60.0, seed)
            up = Loop(rig, ground, 60.0, seed, level=False).run(60_001)[-1][:, 2]
            tilt = np.degrees(np.linalg.norm(up - WANTED[2], axis=1))
            row = ", ".join(f"{tilt[1000 * at]:.3f}" for at in TILTED)
            print(f"  tilt, {name}, seed {seed}: {row} deg after {', '.join(map(str, TILTED))} s")


def spike(rig: Rig, seeds: int) -> None:
    """One reading that is wrong, on each axis of each channel: the largest error over that without it."""
    worst = {(name, size): 0.0 for name in ("q", "gyro", "w", "f", "links") for size in WRONG}
    for seed in range(seeds):
        loop = Loop(rig, draw_profile(rig, 2.7, seed), 2.7, seed)
        loop.run(1000)
        calm = np.linalg.norm(loop.branch().run(1600)[3], axis=1).max()
        for moment in MOMENTS:
            loop.run(moment - loop.k)
            for name, size in worst:
                for axis in range(len(getattr(loop.stream[-1], name))):
                    error = loop.branch().run(
                        AFTERWARDS, partial(add, name=name, axis=axis, size=size)
                    )[3]
                    ratio = float(np.linalg.norm(error, axis=1).max() / calm)
                    worst[name, size] = max(worst[name, size], ratio)
    print(
        f"  spikes of {', '.join(f'{size:g}' for size in WRONG)}: largest error over the undisturbed one"
    )
    for name in dict.fromkeys(name for name, _ in worst):
        print(f"    {name:6}" + " ".join(f"{worst[name, size]:6.2f}" for size in WRONG))


def add(seen: Measurement, name: str, axis: int, size: float) -> Measurement:
    """Return a measurement with one reading off by so much."""
    return seen._replace(
        **{name: getattr(seen, name) + size * (np.arange(len(getattr(seen, name))) == axis)}
    )


def time(rig: Rig, seeds: int) -> None:
    """Processor time of `Controller.step`, each sample's the least of three flights alike."""
    loop = Loop(rig, draw_profile(rig, 8.0, 0), 8.0, 0)
    loop.run(8001)
    gc.collect()
    gc.freeze()
    flights = []
    for _ in range(3):
        loop.controller.start(loop.stream[0], loop.base[0])
        took = []
        for seen in loop.stream:
            begun = thread_time()
            loop.controller.step(seen)
            took.append(thread_time() - begun)
        flights.append(took)
    ms = 1e3 * np.min(flights, axis=0)
    print(f"  step: p50 {np.median(ms):.3f}, p99 {np.quantile(ms, 0.99):.3f}, max {ms.max():.3f} ms; "
          f"first {ms[0]:.3f}; over .5 ms {(ms > 0.5).sum()} of {len(ms)}")  # fmt: skip


def still(rig: Rig, seeds: int, recorded: Platform | None) -> None:
    """Jitter on profile S, and on a recorded motion."""
    for name, ground in (("S", None), ("recorded", recorded)):
        for seed in range(seeds) if name == "S" or ground is not None else ():
            own = draw_profile(rig, 12.0, seed) if ground is None else ground
            error = Loop(rig, own, 12.0, seed).run(12_001)[3][round(SETTLING / DT) :]
            rms, most, drift = map(degrees, jitter(error, DT))
            print(
                f"  jitter on {name}, seed {seed}: rms {rms:.5f}, largest {most:.5f}, drift {drift:.5f} deg"
            )


ROWS = {"start": start, "level": level, "spike": spike, "time": time}


def main(
    rows: tuple[str, ...] = (*ROWS, "jitter"),
    rigs: tuple[str, ...] = ("thesis",),
    seeds: int = 2,
    log: Path | None = None,
    maps: tuple[str, ...] = (),
) -> None:
    """Print the table.

    Args:
        rows: Which of start, level, spike, time, jitter.
        rigs: Rigs.
        seeds: Motions of each row.
        log: A recorded motion for jitter: gyro and accelerometer of the base link.
        maps: Columns of the log, as for `gimbal-pin track --map`.
    """
    for name in rigs:
        rig = Rig.load(name)
        print(name)
        for row in rows:
            if row == "jitter":
                recorded = read_platform(rig, "none", log, maps)
                still(rig, seeds, recorded.about(Sight(rig).centre) if recorded else None)
            else:
                ROWS[row](rig, seeds)
