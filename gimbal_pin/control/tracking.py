"""Step tracking (thesis ch. 6): minimum-jerk references, all axes together, and one at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from math import isnan, nan
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.control.laws.uncertainty import home
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.simulation import Controller, Sensors, simulate
from gimbal_pin.errors import UsageError
from gimbal_pin.log.limited import compute_limit_shares
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator

PEAK_RATE = 15 / 8
"""Largest rate of a minimum-jerk move, in distance per duration."""
PEAK_ACCELERATION = 10 / 3**0.5
"""Largest acceleration of a minimum-jerk move, in distance per duration squared."""
ROOM = 0.9
"""Share of a torque limit that a step's own torque may take: the rest is the feedback's."""


def minimum_jerk(
    start: Array,
    goal: Array,
    *,
    dt: float,
    move: float = 0.5,
    before: float = 0.1,
    after: float = 0.6,
) -> Motion:
    """Rest, move, rest: ``q = start + (goal - start)(10 s³ - 15 s⁴ + 6 s⁵)``, s from 0 to 1 (Flash and Hogan 1985).

    Args:
        start: Angles at first, rad, (n,).
        goal: Angles at last, rad, (n,).
        dt: Sampling interval, s.
        move: Duration of the move, s.
        before: Rest before it, s.
        after: Rest after it, s.

    Raises:
        UsageError: The interval or the move is not positive, or a rest is negative.
    """
    if not (dt > 0 and move > 0 and before >= 0 and after >= 0):
        what = f"has dt {dt:g} s, move {move:g} s, rests {before:g} and {after:g} s"
        raise UsageError(
            "minimum-jerk step",
            what,
            "give a positive interval and move, and rests of at least zero",
        )
    t = dt * np.arange(round((before + move + after) / dt) + 1, dtype=np.float64)
    s = np.clip((t - before) / move, 0.0, 1.0)[:, None]
    distance: Array = np.asarray(goal, np.float64) - np.asarray(start, np.float64)
    q = start + distance * s**3 * (10 - 15 * s + 6 * s**2)
    v: Array = distance / move * 30 * (s * (1 - s)) ** 2
    a = distance / move**2 * 60 * s * (1 - s) * (1 - 2 * s)
    return Motion(t, q, v, a)


def shrink_steps(plant: Model, steps: Sequence[float], move: float) -> Array:
    """Return steps from home, rad, (n,), made smaller where limits (angle, rate, acceleration, torque) ask for it."""
    start = home(plant.rig)
    limits = plant.rig.limits
    goal: Array = (
        np.clip(start + np.array(steps), [x.lower for x in limits], [x.upper for x in limits])
        - start
    )
    largest = [
        min(x.velocity * move / PEAK_RATE, x.acceleration * move**2 / PEAK_ACCELERATION)
        for x in limits
    ]
    goal = np.clip(goal, -np.array(largest), largest)
    for _ in range(40):
        reference = minimum_jerk(start, start + goal, dt=move / 50, move=move)
        share = (
            np.abs(plant.inverse_dynamics(reference.q, reference.v, reference.a)).max(axis=0)
            / plant.rig.tau_max
        )
        if (share <= ROOM).all():
            break
        goal = np.where(share > ROOM, 0.9 * goal, goal)
    return goal


def tour(plant: Model, dt: float, size: float = 0.5, move: float = 1.2) -> Motion:
    """From home to one side of every axis, to the other, and back, by minimum jerk, within all limits.

    Args:
        plant: Model whose torque limits hold.
        dt: Sampling interval, s.
        size: Angle to each side, rad; smaller where a limit asks for it.
        move: Duration of each move, s.
    """
    start = home(plant.rig)
    signs = (-1.0) ** np.arange(plant.rig.n)
    # The middle leg goes from side to side: what fits it twice over fits the others.
    sides = [shrink_steps(plant, list(2 * side * size * signs), move) / 2 for side in (1, -1)]
    goals = [start, *(start + side for side in sides), start]
    legs = [minimum_jerk(a, b, dt=dt, move=move, before=0.2, after=0.2) for a, b in pairwise(goals)]
    parts = [
        np.concatenate(
            [getattr(leg, name)[: -1 if k < len(legs) - 1 else None] for k, leg in enumerate(legs)]
        )
        for name in "qva"
    ]
    return Motion(dt * np.arange(len(parts[0])), *parts)


STEPS_DEG = (30.0, 20.0, -25.0)
"""The thesis's steps, degrees; a rig with more joints cycles through them."""
BEFORE = 0.1
"""Rest before the step, s."""
SETTLED_BAND = 0.02
"""A joint has settled once it stays within this share of its step."""


def scale_steps(plant: Model, angles_deg: Sequence[float] = STEPS_DEG, move: float = 0.5) -> Array:
    """Return steps of so many degrees, cycled over the joints, rad, (n,), made smaller where limits ask for it."""
    return shrink_steps(
        plant,
        [float(np.deg2rad(angles_deg[j % len(angles_deg)])) for j in range(plant.rig.n)],
        move,
    )


@dataclass(frozen=True)
class StepMetrics:
    """How one joint followed, from its true angle (not the encoder's).

    Attributes:
        rise_time: From 10 % to 90 % of the step, s; nan for a joint that should stay, or never got there.
        overshoot_percent: Largest excess over the goal, per cent of the step; nan for a joint that should stay.
        settling_time: From the start of the step until the joint stays within 2 % of it, s; nan as above.
        steady_state_error: Mean of reference minus angle over the last tenth of the log, rad.
        rms_error: Of reference minus angle over the whole log, rad.
        peak_error: Largest error, rad; of a joint that should stay, the cross-axis peak.
        saturated: Share of the samples at the torque limit.
    """

    rise_time: float
    overshoot_percent: float
    settling_time: float
    steady_state_error: float
    rms_error: float
    peak_error: float
    saturated: float


@dataclass(frozen=True, eq=False)
class Experiment:
    """One step with one controller.

    Attributes:
        name: "all-axes", or the joint that moved.
        controller: The controller's name.
        joints: Joint → metrics.
        cross_axis_peak: Largest error of the joints that should stay, rad; nan where all move.
        q: True angles, rad, (N, n).
        log: What the sensors said.
    """

    name: str
    controller: str
    joints: Mapping[str, StepMetrics]
    cross_axis_peak: float
    q: Array
    log: Log

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Tracking(Record):
    """The result of `track`.

    Attributes:
        rig: The rig.
        steps: Joint → step, rad.
        experiments: Every step with every controller.
        seed: Repeats it as `rng`; None where a generator was given.
        plant: What it was simulated on, within a sentence; "": nobody says.
    """

    rig: Rig
    steps: Mapping[str, float]
    experiments: tuple[Experiment, ...]
    seed: int | None = None
    plant: str = ""

    ROWS: ClassVar[str] = "experiments"
    __repr__ = brief

    def of(self, name: str, controller: str) -> Experiment:
        """Return one experiment; `UsageError` if there is none of that name."""
        for experiment in self.experiments:
            if (experiment.name, experiment.controller) == (name, controller):
                return experiment
        have = ", ".join(f"{e.name}/{e.controller}" for e in self.experiments)
        raise UsageError("experiment", f"'{name}/{controller}' was not run", f"there are {have}")

    def to_dict(self) -> dict[str, Any]:
        """Return what `track --json` writes, in SI units and radians; null for what a joint has none of."""
        return {
            "schema": 1,
            "rig": self.rig.name,
            "payload": self.rig.payload,
            "steps": dict(self.steps),
            "experiments": [
                {
                    "name": experiment.name,
                    "controller": experiment.controller,
                    "cross_axis_peak": or_null(experiment.cross_axis_peak),
                    "joints": {
                        joint: {key: or_null(value) for key, value in asdict(metrics).items()}
                        for joint, metrics in experiment.joints.items()
                    },
                }
                for experiment in self.experiments
            ],
            "pointing": [],
        }


def or_null(value: float) -> float | None:
    """Return the value, None for nan."""
    return None if isnan(value) else value


@dataclass(frozen=True, eq=False)
class Witness(Sensors):
    """Sensors that keep the true angles that they were asked to measure: metrics should not see the encoder's steps."""

    seen: list[Array] = field(default_factory=list)

    def angle(self, q: Array) -> Array:
        """The angle as the encoder reports it."""
        self.seen.append(q.copy())
        return super().angle(q)


@check_arguments
def track(
    plant: Model,
    controllers: Mapping[str, Controller],
    *,
    rng: Rng = None,
    seconds: float = 1.2,
    angles_deg: Sequence[float] = STEPS_DEG,
    move: float = 0.5,
    sensors: Sensors | None = None,
    delay: int = 1,
    one_by_one: bool = True,
) -> Tracking:
    """Step every controller's joints by minimum jerk, all together and one at a time, and measure how they follow.

    Every controller meets the same steps and the same sensor noise.

    Args:
        plant: The plant; it need not be the controllers' model.
        controllers: Name → controller.
        rng: Source of the sensors' noise, or its seed; None: a fresh one, whose seed is in the result.
        seconds: Length of each experiment, s.
        angles_deg: Steps, degrees, cycled over the joints and made smaller where the rig's limits ask for it.
        move: Duration of the step, s.
        sensors: The sensors; None: the rig's encoders and gyros.
        delay: Samples between measurement and torque.
        one_by_one: False leaves out the steps of single axes.

    Raises:
        UsageError: No room for the step within `seconds`, or a loop that diverges.
    """
    rig = plant.rig
    if seconds < BEFORE + move:
        raise UsageError(
            "seconds",
            f"is {seconds:g}, shorter than the step",
            f"give at least {BEFORE + 2 * move:g}",
        )
    steps = scale_steps(plant, angles_deg, move)
    single = [(joint, steps * (np.arange(rig.n) == j)) for j, joint in enumerate(rig.joints)]
    plan = [("all-axes", steps), *(single if one_by_one and rig.n > 1 else [])]
    generator, seed = make_generator(rng)
    seeds = generator.integers(2**63, size=len(plan))

    def run(
        name: str, goal: Array, start_of_noise: int, label: str, controller: Controller
    ) -> Experiment:
        start = home(rig)
        after = seconds - BEFORE - move
        reference = minimum_jerk(
            start, start + goal, dt=controller.dt, move=move, before=BEFORE, after=after
        )
        witness = Witness(**vars(sensors or Sensors.of(rig, controller.dt)))
        own = np.random.default_rng(start_of_noise)
        title = f"{name}, {label}"
        log = simulate(
            plant, controller, reference, rng=own, sensors=witness, delay=delay, name=title
        )
        q = np.array(witness.seen)
        shares = compute_limit_shares(rig.joints, np.asarray(log.tau), rig.tau_max).values()
        rows = [
            metrics(reference.t, *own) for own in zip(reference.q.T, q.T, goal.tolist(), shares)
        ]
        still = [row.peak_error for row, distance in zip(rows, goal) if distance == 0]
        return Experiment(name, label, dict(zip(rig.joints, rows)), max(still, default=nan), q, log)

    experiments = [
        run(name, goal, each, *controller)
        for (name, goal), each in zip(plan, seeds.tolist())
        for controller in controllers.items()
    ]
    return Tracking(rig, dict(zip(rig.joints, steps.tolist())), tuple(experiments), seed)


def metrics(
    t: Array, wanted: Array, angle: Array, distance: float, saturated: float
) -> StepMetrics:
    """Return one joint's metrics from its reference and angle, rad, (N,), and its step, rad."""
    error = wanted - angle
    rise = overshoot = settling = nan
    if distance:
        share = (angle - wanted[0]) / distance
        low, high = (
            float(t[np.argmax(share >= x)]) if (share >= x).any() else nan for x in (0.1, 0.9)
        )
        rise = high - low
        overshoot = 100 * max(0.0, float(share.max()) - 1)
        outside = np.flatnonzero(np.abs(share - 1) > SETTLED_BAND)
        settling = float(t[outside[-1] + 1] - BEFORE) if outside[-1] + 1 < len(t) else nan
    return StepMetrics(
        rise_time=rise,
        overshoot_percent=overshoot,
        settling_time=settling,
        steady_state_error=float(error[-max(1, len(t) // 10) :].mean()),
        rms_error=float(np.sqrt(np.mean(error**2))),
        peak_error=float(np.abs(error).max()),
        saturated=saturated,
    )
