"""How still the camera stands with the sensors and platforms that people have: every case of CONTROL's last table.

The plant differs from the model that the controllers know: inertias by about 3 %, friction by up to 9 %, another draw
per seed. Printed per rig and case, degrees rms over the seeds: jitter of the PID that crosses at 25 Hz, of
the fastest PID of the same disk margin, of ours, of ours with the motion foreknown, and what the camera's gyro alone
leaves by its noise; the ratios of both PIDs to ours; the events of ours.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import degrees, pi, radians
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from camera.contest import foretell
from gimbal_pin.control.controller_names import BASELINE, OURS
from gimbal_pin.control.experiment import perturbed
from gimbal_pin.control.laws.equal_margin import EqualMarginLoop
from gimbal_pin.dynamics.imu import add_imu_noise
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.plant import State
from gimbal_pin.dynamics.sensors import Sensors
from gimbal_pin.dynamics.simulation import Drive, resample_halfway, run_loop
from gimbal_pin.effects.payload_mass import PayloadMass
from gimbal_pin.effects.rig_effect import get_payload
from gimbal_pin.log.log import Array, Imu, Motion
from gimbal_pin.log.platform import Platform
from gimbal_pin.log.profile import ACCELERATION, ATTITUDE, Band, make_propeller_band, sum_bands
from gimbal_pin.pointing.bench import WANTED, unbalance_payload
from gimbal_pin.pointing.forecast import Spectrum
from gimbal_pin.pointing.measurement import ACCELEROMETER, GYRO, Measurement, Station
from gimbal_pin.pointing.pointer import Holder
from gimbal_pin.pointing.recipe import Recipe
from gimbal_pin.pointing.result import SETTLING, jitter
from gimbal_pin.pointing.result import summed as counted
from gimbal_pin.pointing.run import Sensed, SensedHolder, errors, simulate_holding
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.rig.config import Noise
from gimbal_pin.rig.rig import Rig
from tests.failing_sensors import FailingSensors, Fault

DT = 0.001
FASTEST, FOREKNOWN = "pid-fastest", "foreknown"
TEACHING = 1000
"""Seed of the motion that teaches how a platform moves: no run has it."""
PROPELLERS = (ATTITUDE[2:], ACCELERATION[1:])
OTHERS = (
    (make_propeller_band(100.0, radians(0.0035)), make_propeller_band(180.0, radians(0.0014))),
    (make_propeller_band(100.0, 1.0), make_propeller_band(180.0, 0.5)),
)
NONE: tuple[tuple[Band, ...], tuple[Band, ...]] = ((), ())
STEP = 1.9
"""Steps a second of somebody who walks; the body sways at half of that."""
WALK = (
    (
        Band(0.48 * STEP, 0.52 * STEP, radians(2.0), 4),
        *(make_propeller_band(k * STEP, radians(1.5) / k**2) for k in range(1, 6)),
    ),
    (
        Band(0.48 * STEP, 0.52 * STEP, 0.5, 4),
        *(make_propeller_band(k * STEP, 2.0 / k) for k in range(1, 9)),
    ),
)


@dataclass(frozen=True)
class Ground:
    """A platform's motion: bands of its attitude and of its acceleration, about the point where the axes meet."""

    bands: tuple[tuple[Band, ...], tuple[Band, ...]]
    size: float = 1.0

    def __call__(self, rig: Rig, seed: int, seconds: float) -> Platform:
        """Draw it, sampled at half the control interval."""
        t = DT / 2 * np.arange(2 * round(seconds / DT) + 1)
        rng = np.random.default_rng(seed)
        angles, rates, accelerations = (self.size * x for x in sum_bands(self.bands[0], t, rng, 2))
        (acceleration,) = sum_bands(self.bands[1], t, rng, 0)
        motion = Platform.turning(t, angles, rates, accelerations, self.size * acceleration)
        return motion.about(Sight(rig).centre)


def profile(propellers: tuple[tuple[Band, ...], tuple[Band, ...]], size: float = 1.0) -> Ground:
    """Profile S with other propellers, or none."""
    return Ground(((*ATTITUDE[:2], *propellers[0]), (*ACCELERATION[:1], *propellers[1])), size)


@dataclass(frozen=True)
class Wrong:
    """``gyro' = (1 + scale) exp(turn) gyro + bias`` of some gyros: each turned and biased about an axis of its own."""

    scale: float = 0.0
    turn: float = 0.0
    bias: float = 0.0
    which: tuple[str, ...] = ("gyro", "w", "links")

    def apply(self, seen: Measurement, before: Measurement | None) -> Measurement | None:
        """Distort a sample."""
        changed: dict[str, Any] = {
            name: self.distorted(k, getattr(seen, name)) for k, name in enumerate(self.which)
        }
        return seen._replace(**changed)

    def distorted(self, k: int, rates: Array) -> Array:
        """Distort the rates of one or more gyros."""
        M, way = self.matrix(k)
        return np.asarray(((1 + self.scale) * rates.reshape(-1, 3) @ M.T + self.bias * way).ravel())

    @lru_cache(maxsize=8)  # noqa: B019 -- three small matrices
    def matrix(self, k: int) -> tuple[Array, Array]:
        """Rotation and direction of the k-th gyro's errors."""
        way = np.roll([0.6, -0.5, 0.62], k) * (-1) ** k
        way /= np.linalg.norm(way)
        return np.asarray(pin.exp3(self.turn * np.roll(way, 1))), way


@dataclass(frozen=True)
class Case:
    """One row: what the platform does, what it did while it was learned, and what else is not as it was thought."""

    ground: Ground = field(default_factory=lambda: profile(PROPELLERS))
    teaching: Ground = field(default_factory=lambda: profile(PROPELLERS, 0.5))
    faults: tuple[Fault, ...] = ()
    late: int = 0
    heavier: float = 0.0
    base: float = 0.0


CASES = {
    "as-known": Case(),
    "hand-taught": Case(teaching=profile(NONE, 0.5)),
    "other-propellers": Case(ground=profile(OTHERS)),
    "no-propellers": Case(ground=profile(NONE)),
    "scale-1%": Case(faults=(Wrong(scale=0.01),)),
    "scale-10%-platform": Case(faults=(Wrong(scale=0.1, which=("w",)),)),
    "scale-10%-camera": Case(faults=(Wrong(scale=0.1, which=("gyro",)),)),
    "misaligned-1mrad": Case(faults=(Wrong(turn=1e-3),)),
    "bias-0.1deg/s": Case(faults=(Wrong(bias=radians(0.1)),)),
    "consumer-gyros": Case(faults=(Wrong(0.01, 1e-3, radians(0.2)),)),
    "late-2ms": Case(late=2),
    "payload+20%": Case(heavier=0.2),
    "walking": Case(ground=Ground(WALK)),
    "base-reacts-1": Case(base=1.0),
    "base-reacts-0.2": Case(base=0.2),
}


class Mounted:
    """A plant on a platform that it turns: ``J w' + w x J w = -k d - c d' - what the gimbal asks``.

    J is the platform's inertia, k and c those of a mount of 3 Hz with a tenth of critical damping, d the turn from the
    prescribed attitude. Its origin moves as prescribed. Integrated in quarters of a sample, the rates first; dry
    friction as ``tanh(v / 0.002)``.
    """

    HZ, SHARE, PARTS = 3.0, 0.1, 4

    def __init__(self, model: Model, base: Platform, inertia: float) -> None:
        """Start with the platform as prescribed."""
        self.model, self.pin, self.n = model, model.rig.floating, model.rig.n
        self.data = self.pin.createData()
        self.base = base
        self.inertia = inertia
        self.nominal = Rotation.from_quat(np.asarray(base.quat), scalar_first=True).as_matrix()
        self.R, self.w = self.nominal[0].copy(), np.array(base.w[0])
        self.friction = np.array(model.rig.friction)
        self.force = np.array(base.f[0])

    def step(self, t: float, state: State, tau: Array, dt: float) -> State:
        """Return the joints' state after a sample."""
        q = state.q.copy()
        v = state.v.copy()
        h = dt / self.PARTS
        omega = 2 * pi * self.HZ
        for part in range(self.PARTS):
            k = min(2 * round(t / dt) + part // 2, len(self.nominal) - 1)
            near = self.nominal[k]
            self.force = self.R.T @ near @ self.base.f[k]
            turn = pin.log3(near.T @ self.R)
            rate = self.w - self.R.T @ near @ self.base.w[k]
            spring = (
                self.R.T @ near @ self.base.dw[k] - omega**2 * turn - 2 * self.SHARE * omega * rate
            )
            place = np.concatenate([np.zeros(6), [1.0], q])
            speed = np.concatenate([np.zeros(3), self.w, v])
            push = np.zeros(6 + self.n)
            push[:3] = self.force
            bias = pin.rnea(self.pin, self.data, place, speed, push)[3:]
            D = pin.crba(self.pin, self.data, place)
            D = (np.triu(D) + np.triu(D, 1).T)[3:, 3:] + np.diag(
                [self.inertia] * 3 + [0.0] * self.n
            )
            rub = self.friction[:, 0] * np.tanh(v / 0.002) + self.friction[:, 1] * v
            a = np.linalg.solve(D, np.concatenate([self.inertia * spring, tau - rub]) - bias)
            self.w = self.w + h * a[:3]
            v = v + h * a[3:]
            self.R = self.R @ pin.exp3(h * self.w)
            q = q + h * v
        return State(q, v)


class Felt(Sensed):
    """Sensors on a platform that reacts."""

    system: Mounted
    attitudes: list[Array]

    def see(self, k: int, q: Array, v: Array) -> Measurement:
        """Return the measurement; the platform's IMU measures the actual motion, not the prescribed one."""
        self.attitudes.append(self.system.R.copy())
        base = self.system.base
        self.platform_imu[k] += np.stack(
            [self.system.w - base.w[2 * k], self.system.force - base.f[2 * k]]
        )
        self.w[k] = self.system.w
        return super().see(k, q, v)


@dataclass(frozen=True)
class Held:
    """One run: line-of-sight error of the samples that count, rad, (M, 2), and events."""

    sight: Array
    events: tuple[str, ...]


def on_mount(
    plant: Model,
    pointer: Holder,
    ground: Platform,
    station: Station,
    case: Case,
    seed: int,
    seconds: float,
) -> Held:
    """Run the loop on a platform that reacts."""
    t = DT * np.arange(round(seconds / DT) + 1)
    base = resample_halfway(ground, t)
    sensed = Felt(plant, base, station, t, np.random.default_rng([seed, 1]))
    sensed.w = sensed.w.copy()
    sensed.system = Mounted(plant, base, case.base)
    sensed.attitudes = []
    attitudes = Rotation.from_quat(base.quat[::2], scalar_first=True).as_matrix()
    motors = Drive(plant.drive, plant.rig, DT, plant)
    behind = SensedHolder(pointer, sensed, attitudes)
    n = plant.rig.n
    zero = np.zeros((len(t), n))
    *_, q, _ = run_loop(
        sensed.system, motors, behind, Motion(t, zero, zero, zero), behind.at_rest, Sensors.exact(n), zero, 1, 1,
        plant.rig.tau_max, "mount",
    )  # fmt: skip
    error = errors(sensed.sight, q, np.array(sensed.attitudes), WANTED)
    return Held(error[round(SETTLING / DT) :, 1:], behind.events)


def run(case: Case, rig: Rig, seed: int, seconds: float, names: Sequence[str]) -> dict[str, Held]:
    """Hold the camera with every controller on one seed."""
    known = nominal(rig)
    plant = perturbed(rig, 0.03, np.random.default_rng([seed, 2]))
    if case.heavier:
        plant = replace(
            plant, rig=PayloadMass(case.heavier * get_payload(rig)[1].mass).apply(plant.rig)
        )
    ground = case.ground(rig, seed, seconds)
    station = Station.of(rig)
    recipe = Recipe(known, WANTED, taught(case, rig), station.noise, float(station.step.max()))
    out = {}
    for name in names:
        pointer = FailingSensors(make_holder(recipe, name, ground), case.faults)
        if case.base:
            out[name] = on_mount(plant, pointer, ground, station, case, seed, seconds)
            continue
        held = simulate_holding(
            plant, pointer, ground, rng=np.random.default_rng([seed, 1]), seconds=seconds, station=station,
            delay=1 + case.late, name=name,
        )  # fmt: skip
        out[name] = Held(held.sight, held.events)
    return out


def taught(case: Case, rig: Rig) -> Spectrum:
    """Learn how a platform moves from 20 s of its IMU."""
    motion = case.teaching(rig, TEACHING, 20.0)
    rng = np.random.default_rng(TEACHING)
    noise = Noise(GYRO, ACCELEROMETER)
    return Spectrum.of(add_imu_noise(Imu(motion.w[::2], motion.f[::2], None), noise, DT, rng), DT)


def make_holder(recipe: Recipe, name: str, ground: Platform) -> Holder:
    """Return a controller: of `FASTEST` the PID of the same disk margin that crosses as high as it can."""
    if name == FOREKNOWN:
        return foretell(recipe, ground)
    if name != FASTEST:
        return recipe.pointer(name)
    gains = tuple(
        EqualMarginLoop(DT, DT, drive, crossover=100.0).pid for drive in recipe.model.drives
    )
    return replace(recipe.pointer(BASELINE), law=recipe.pid(gains))


def floor(seed: int, seconds: float) -> float:
    """Jitter of a line of sight that is turned by the integral of a gyro's noise, rad rms."""
    rates = (
        GYRO
        / np.sqrt(2 * DT)
        * np.random.default_rng([seed, 3]).standard_normal((round(seconds / DT), 2))
    )
    return jitter(DT * np.cumsum(rates, axis=0)[round(SETTLING / DT) :], DT)[0]


def rms(values: Sequence[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def main(
    cases: tuple[str, ...] = tuple(CASES),
    rigs: tuple[str, ...] = ("thesis:mirrorless", "handheld:mirrorless"),
    seeds: int = 1,
    first: int = 0,
    seconds: float = 12.0,
    foreknown: bool = False,
) -> None:
    """Print the table.

    Args:
        cases: Rows.
        rigs: Rigs with their payloads, RIG:PAYLOAD.
        seeds: Runs of each controller.
        first: First seed.
        seconds: Length of a run.
        foreknown: True runs the controller to which the motion is foreknown, too.
    """
    names = [BASELINE, FASTEST, OURS, *[FOREKNOWN] * foreknown]
    many = range(first, first + seeds)
    print(f"seeds {first}-{first + seeds - 1}, {seconds:g} s; gyro's noise alone "
          f"{degrees(rms([floor(seed, seconds) for seed in many])):.5f} deg")  # fmt: skip
    head = " ".join(f"{name:>15}" for name in names)
    print(f"{'rig':20}{'case':20}{head}   ratio  to fastest  events of ours")
    for rig_name in rigs:
        bare, _, payload_name = rig_name.partition(":")
        rig = unbalance_payload(Rig.load(bare, payload_name or None))
        for name in cases:
            ran = [run(CASES[name], rig, seed, seconds, names) for seed in many]
            size = {
                who: degrees(rms([jitter(one[who].sight, DT)[0] for one in ran])) for who in names
            }
            row = " ".join(f"{size[who]:15.5f}" for who in names)
            ratios = f"{size[BASELINE] / size[OURS]:8.2f}{size[FASTEST] / size[OURS]:12.2f}"
            events = "; ".join(counted(event for one in ran for event in one[OURS].events))
            print(f"{rig_name:20}{name:20}{row}{ratios}  {events[:200]}")
            sys.stdout.flush()
