"""What a gimbal must reach on a platform that moves and on the thesis's steps (CONTROL)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import degrees, isnan, nan

import numpy as np

from gimbal_pin.control.controllers import OURS
from gimbal_pin.control.tracking import Tracking, track
from gimbal_pin.control.tuning import Law, tune
from gimbal_pin.dynamics.model import Model
from gimbal_pin.pointing.result import Contest
from gimbal_pin.pointing.sight import Sight

APART = 0.01
"""Axes that miss each other by more than this make uneven arms, m."""
LATE = 0.004
"""Delay beyond one sample from which the targets are those of a late drive, s."""
MUST, LATE_MUST = 5.0, 4.0
"""How many times stiller than a PID, and of a late drive."""


@dataclass(frozen=True)
class Target:
    """One figure beside what it must be and what it should be.

    Attributes:
        name: What it is.
        value: The figure, None where a controller that it takes did not run.
        must: The bound.
        aim: The better bound.
        least: True where larger is better.
        note: What is to be known beside it, as sentences, or nothing.
    """

    name: str
    value: float | None
    must: float
    aim: float
    least: bool
    note: str = ""

    @property
    def verdict(self) -> str:
        """Whether it is "aim", "must" or "missed"; "–" without a figure."""
        if self.value is None:
            return "–"
        sign = 1 if self.least else -1
        met = [sign * self.value >= sign * bound for bound in (self.aim, self.must)]
        return "aim" if met[0] else "must" if met[1] else "missed"


def targets(found: Contest, sight: Sight, late: float = 0.0) -> tuple[Target, ...]:
    """Return the targets that a contest is judged by.

    Args:
        found: The contest.
        sight: The rig's kinematics: they say whether its arms are uneven.
        late: Delay of the drives beyond one sample, s.
    """
    ours = found.jitter.get(OURS)
    jitter = None if ours is None else degrees(ours)
    platform = found.rows[0].runs[0].platform
    uneven = sight.apart > APART
    gain = (LATE_MUST, 10.0) if late >= LATE else (MUST, 20.0 if uneven else 10.0)
    still = (0.006, 0.0035) if platform == "log" else (0.012, 0.005) if uneven else (0.005, 0.003)
    where = "recorded motion: " if platform == "log" else ""
    ratios = (
        Target(f"{where}world-frame PID over {OURS}", found.gain, *gain, True, about_delay(late)),
        Target(f"{where}{OURS} over the oracle", found.distance, 2.5, 1.3, False),
    )
    # How still a late drive must stand nobody has stated: only how much stiller than with a PID.
    return ratios if late >= LATE else (*ratios, Target(f"{where}jitter, ° rms", jitter, *still, False))


def about_delay(late: float) -> str:
    """Say what a delay that is known, s beyond one sample, does to the ratio of a PID over ours, and to its bound."""
    if late <= 0:
        return ""
    told = (
        f"the PID, too, is given its margins with the {1e3 * late:.3g} ms of delay that are known: slower for it, it "
        "shakes more than one that is not told, so that part of this ratio is not the model's"
    )
    less = f"must is {LATE_MUST:g}, not {MUST:g}: the motion must be foreseen that much further, which is less sure"
    return f"{less}; {told}" if late >= LATE else told


BANDWIDTH = 8.0
"""Of every law, Hz (CONTROL, "Steps")."""
JUDGED = "with-friction"
"""The law that is judged: on a base that stands, what all later ones on the roster are."""


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
        out = {}
        for name in dict.fromkeys(run.controller for run in found.experiments):
            runs = [run for run in found.experiments if run.controller == name]
            rows = [row for run in runs for row in run.joints.values()]
            overshoots = [row.overshoot_percent for row in rows if not isnan(row.overshoot_percent)]
            crossings = [run.cross_axis_peak for run in runs if not isnan(run.cross_axis_peak)]
            rms = max(row.rms_error for row in rows)
            out[name] = Followed(rms, max(overshoots, default=nan), max(crossings, default=nan))
        return out


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
    ours = Followed.of(found)[JUDGED]
    return (
        Target("steps: tracking, ° rms", degrees(ours.rms), 0.02, 0.007, False),
        Target("steps: overshoot, %", ours.overshoot_percent, 0.2, 0.05, False),
        Target("steps: cross-axis peak, °", degrees(ours.cross_axis_peak), 0.01, 0.002, False),
    )
