"""Figures of a state beside those of its loops, which `Tuning.loop_curves` has: residual and pointing error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.control.controller_names import BASELINE, OURS
from gimbal_pin.control.tuning import Tuning
from gimbal_pin.diagnosis.traces import compute_torque_error, measure_torque_rmse
from gimbal_pin.dynamics.model import Model
from gimbal_pin.log.log import Array
from gimbal_pin.pointing import Pointing, simulate_holding
from gimbal_pin.rig.brief import brief
from gimbal_pin.studio.state import StudioState
from gimbal_pin.studio.subject import Subject, build_plant


@dataclass(frozen=True, eq=False)
class ResidualFigure:
    """Measured less predicted torque of the judged logs.

    Attributes:
        t: Time, s from the first log's start, (m,); it jumps between stretches.
        error: Residual below the diagnosis's band, away from standstill, N m, (m, n).
        rms: Root mean square over the samples that count, N m, (n,).
    """

    t: Array
    error: Array
    rms: Array

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class PointingFigure:
    """How still the camera stands on a platform that moves.

    Attributes:
        run: The run.
        jitter: Root mean square of the line of sight's error, rad.
    """

    run: Pointing
    jitter: float

    __repr__ = brief


def compute_residual(subject: Subject, model: Model) -> ResidualFigure | None:
    """Return what a controller's model leaves of the logged torque; None where there is no log."""
    rows = subject.rows
    if rows is None:
        return None
    error = compute_torque_error(rows, model)
    return ResidualFigure(rows.sample("t"), error, measure_torque_rmse(rows, model))


def simulate_pointing(
    subject: Subject, state: StudioState, tuning: Tuning
) -> PointingFigure | None:
    """Hold the camera of the state's gimbal with the controller; None where the rig cannot hold it.

    The gimbal has every cause, the controller knows those that are on.

    Raises:
        UsageError: The loop diverges.
    """
    if subject.recipe is None or subject.platform is None:
        return None
    delay = tuning.wish.holding_samples
    recipe = replace(subject.recipe, model=tuning.model, law=tuning.controller, delay=delay)
    rng = np.random.default_rng([subject.seed, 1])
    holder = recipe.pointer(BASELINE if tuning.wish.kind == "pid" else OURS)
    plant = build_plant(subject, state)
    seconds = float(subject.platform.t[-1])
    run = simulate_holding(plant, holder, subject.platform, rng=rng, seconds=seconds, delay=delay)
    return PointingFigure(run, run.jitter[0])
