"""Step tracking (THESIS ch. 6): all axes together, and one at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import isnan, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.control.laws.uncertainty import home
from gimbal_pin.control.trajectories import minimum_jerk, within
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.simulation import Controller, Sensors, simulate
from gimbal_pin.errors import UsageError
from gimbal_pin.log.limited import at_limit
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.rig.rig import Rig

STEPS_DEG = (30.0, 20.0, -25.0)
"""The thesis's steps, degrees; a rig with more joints cycles through them."""
BEFORE = 0.1
"""Rest before the step, s."""
BAND = 0.02
"""A joint has settled once it stays within this share of its step."""


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


@dataclass(frozen=True, eq=False)
class Tracking:
    """The result of `track`.

    Attributes:
        rig: Name of the rig.
        payload: Its payload, or None.
        steps: Joint → step, rad.
        experiments: Every step with every controller.
    """

    rig: str
    payload: str | None
    steps: Mapping[str, float]
    experiments: tuple[Experiment, ...]

    def of(self, name: str, controller: str) -> Experiment:
        """Return one experiment; `UsageError` if there is none of that name."""
        for experiment in self.experiments:
            if (experiment.name, experiment.controller) == (name, controller):
                return experiment
        have = ", ".join(f"{e.name}/{e.controller}" for e in self.experiments)
        raise UsageError("experiment", f"'{name}/{controller}' was not run", f"there are {have}")

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds (CONTRACT, `track`), in SI units and radians; null for what a joint has none of."""
        return {
            "schema": 1,
            "rig": self.rig,
            "payload": self.payload,
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


def track(
    plant: Model,
    controllers: Mapping[str, Controller],
    *,
    rng: np.random.Generator,
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
        rng: Source of the sensors' noise.
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
        raise UsageError("seconds", f"is {seconds:g}, shorter than the step", f"give at least {BEFORE + 2 * move:g}")
    steps = within(plant, [float(np.deg2rad(angles_deg[j % len(angles_deg)])) for j in range(rig.n)], move)
    single = [(joint, steps * (np.arange(rig.n) == j)) for j, joint in enumerate(rig.joints)]
    plan = [("all-axes", steps), *(single if one_by_one and rig.n > 1 else [])]
    seeds = rng.integers(2**63, size=len(plan))
    stand = Stand(plant, seconds, move, sensors, delay)
    experiments = tuple(
        stand.run(name, goal, label, controller, np.random.default_rng(seed))
        for (name, goal), seed in zip(plan, seeds)
        for label, controller in controllers.items()
    )
    return Tracking(rig.name, rig.payload, dict(zip(rig.joints, steps.tolist())), experiments)


@dataclass(frozen=True, eq=False)
class Witness(Sensors):
    """Sensors that keep the true angles that they were asked to measure: metrics should not see the encoder's steps."""

    seen: list[Array] = field(default_factory=list)

    @staticmethod
    def of(rig: Rig, dt: float, torque_std: float = 0.0) -> Witness:
        """The rig's own sensors, as a witness."""
        return Witness(**vars(Sensors.of(rig, dt, torque_std)))

    def angle(self, q: Array) -> Array:
        """The angle as the encoder reports it."""
        self.seen.append(q.copy())
        return super().angle(q)


@dataclass(frozen=True, eq=False)
class Stand:
    """What all experiments of one `track` share; the attributes are its arguments."""

    plant: Model
    seconds: float
    move: float
    sensors: Sensors | None
    delay: int

    def run(self, name: str, goal: Array, label: str, controller: Controller, rng: np.random.Generator) -> Experiment:
        """Run one step from home by `goal` rad, (n,), with one controller."""
        rig, dt = self.plant.rig, controller.dt
        start, after = home(rig), self.seconds - BEFORE - self.move
        reference = minimum_jerk(start, start + goal, dt=dt, move=self.move, before=BEFORE, after=after)
        witness = Witness(**vars(self.sensors or Sensors.of(rig, dt)))
        title = f"{name}, {label}"
        log = simulate(self.plant, controller, reference, rng=rng, sensors=witness, delay=self.delay, name=title)
        q = np.array(witness.seen)
        rows = dict(zip(rig.joints, measured(rig, reference, q, log, goal)))
        still = [row.peak_error for row, distance in zip(rows.values(), goal) if distance == 0]
        return Experiment(name, label, rows, max(still, default=nan), q, log)


def measured(rig: Rig, reference: Motion, q: Array, log: Log, goal: Array) -> list[StepMetrics]:
    """Return every joint's metrics."""
    shares = at_limit(rig.joints, np.asarray(log.tau), rig.tau_max).values()
    columns = zip(reference.q.T, q.T, goal.tolist(), shares)
    return [metrics(reference.t, wanted, angle, distance, share) for wanted, angle, distance, share in columns]


def metrics(t: Array, wanted: Array, angle: Array, distance: float, saturated: float) -> StepMetrics:
    """Return one joint's metrics from its reference and angle, rad, (N,), and its step, rad."""
    error = wanted - angle
    rise = overshoot = settling = nan
    if distance:
        share = (angle - wanted[0]) / distance
        rise = first(t, share >= 0.9) - first(t, share >= 0.1)
        overshoot = 100 * max(0.0, float(share.max()) - 1)
        outside = np.flatnonzero(np.abs(share - 1) > BAND)
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


def first(t: Array, reached: NDArray[np.bool_]) -> float:
    """Time of the first True, s; nan if there is none."""
    return float(t[np.argmax(reached)]) if reached.any() else nan
