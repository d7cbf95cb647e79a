"""The thesis's steps on a base that stands, by the laws that a standing base tells apart (THESIS ch. 6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import degrees, isnan

import numpy as np

from gimbal_pin.control.tracking import Tracking, track
from gimbal_pin.control.tuning import Law, tune
from gimbal_pin.dynamics.model import Model
from gimbal_pin.pointing.targets import Target

BANDWIDTH = 8.0
"""Of every law, Hz (CONTROL, "Steps")."""
JUDGED = "with-friction"
"""The law that is judged: on a base that stands, what all later ones on the roster are."""

STANDING = {
    **dict.fromkeys(("pid-joint", "pid-world"), "pid-joint"),
    **dict.fromkeys(("computed-torque-fixed", "without-hidden", "computed-torque"), "computed-torque-fixed"),
    **dict.fromkeys(("with-friction", "with-prediction", "with-gyros", "switch", "oracle"), JUDGED),
    "lyapunov": "lyapunov",
}
"""What each controller of the roster is on a base that stands; the observer is not run there."""


@dataclass(frozen=True)
class Followed:
    """How one law followed the steps, all of them: the worst joint of the worst step.

    Attributes:
        rms: Tracking error, rad rms.
        overshoot_percent: Overshoot, per cent of the step.
        cross_axis_peak: Largest error of a joint that should have stayed, rad; nan for a rig of one joint.
    """

    rms: float
    overshoot_percent: float
    cross_axis_peak: float

    @staticmethod
    def of(found: Tracking) -> Mapping[str, Followed]:
        """Return them by controller."""
        return {name: Followed.by(found, name) for name in dict.fromkeys(e.controller for e in found.experiments)}

    @staticmethod
    def by(found: Tracking, name: str) -> Followed:
        """Return one controller's."""
        runs = [run for run in found.experiments if run.controller == name]
        rows = [row for run in runs for row in run.joints.values()]
        return Followed(
            max(row.rms_error for row in rows),
            largest([row.overshoot_percent for row in rows]),
            largest([run.cross_axis_peak for run in runs]),
        )


def largest(values: list[float]) -> float:
    """Return the largest of those that are numbers, nan if none is."""
    return max((value for value in values if not isnan(value)), default=float("nan"))


def laws(model: Model, dt: float, delay: int) -> dict[str, Law]:
    """Return a PID, computed torque without the terms and with them, and Lyapunov redesign, of one bandwidth.

    Args:
        model: What they know.
        dt: Sampling interval, s.
        delay: Samples from measurement to torque.
    """
    full = tune(model, bandwidth_hz=BANDWIDTH, delay=delay * dt, dt=dt)
    return {
        "pid-joint": full.with_(kind="pid").controller,
        "computed-torque-fixed": replace(full, model=replace(model, terms=())).controller,
        JUDGED: full.controller,
        "lyapunov": full.with_(robust=True).controller,
    }


def stepped(plant: Model, model: Model, dt: float, delay: int, seed: int = 0) -> Tracking:
    """Step 30, 20 and -25°, all at once and one at a time; on a rig that cannot, as far as its limits let it.

    Args:
        plant: The plant.
        model: What the controllers know.
        dt: Sampling interval, s.
        delay: Samples from measurement to torque.
        seed: Of the sensors' noise.
    """
    return track(plant, laws(model, dt, delay), rng=np.random.default_rng(seed), delay=delay)


def step_targets(found: Tracking) -> tuple[Target, ...]:
    """Return what the steps are judged by (CONTROL, "Steps")."""
    ours = Followed.by(found, JUDGED)
    return (
        Target("steps: tracking, ° rms", degrees(ours.rms), 0.02, 0.007, False),
        Target("steps: overshoot, %", ours.overshoot_percent, 0.2, 0.05, False),
        Target("steps: cross-axis peak, °", degrees(ours.cross_axis_peak), 0.01, 0.002, False),
    )
