"""Errors of the URDF, the refitted and the extended model on the same rows, unseen by the search where possible."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gimbal_pin.diagnosis.problem import Problem
from gimbal_pin.diagnosis.search import Solution
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Flags
from gimbal_pin.rig.brief import brief

CROSS_VALIDATED = "cross-validated"
"""Rows where no block is kept apart: every block, predicted by a fit to the others; the search has seen them."""


@dataclass(frozen=True)
class Errors:
    """Error of a model at each joint.

    Attributes:
        torque_rmse: Joint → root mean square of measured less predicted torque up to the band, N m.
        fit_percent: Joint → ``100 (1 - rmse/σ)``, σ the standard deviation of the measured torque.
    """

    torque_rmse: Mapping[str, float]
    fit_percent: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors of three models on the same rows, and those rows.

    Attributes:
        how: What is held out: "every fifth block", "last third", "log 2 of 3" or "cross-validated".
        cutoff_hz: Highest frequency of the rows, Hz.
        urdf: The rig as its URDF states it.
        refitted: Bodies and friction fitted.
        extended: With the findings.
        used: Joint → share of the shown samples that count.
        traces: What the models leave along the logs.
    """

    how: str
    cutoff_hz: float
    urdf: Errors
    refitted: Errors
    extended: Errors
    used: Mapping[str, float]
    traces: ResidualTraces

    __repr__ = brief

    @property
    def stages(self) -> dict[str, Errors]:
        """Name of each model → its errors, each with more of what was fitted than the one before."""
        return {"URDF": self.urdf, "refitted": self.refitted, "extended": self.extended}

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as JSON holds them."""
        figures = {name.lower(): asdict(errors) for name, errors in self.stages.items()}
        return {"how": self.how, "cutoff_hz": self.cutoff_hz, **figures}


@dataclass(frozen=True, eq=False)
class ResidualTraces:
    """Residual torque of two models along the logs, at twice the band, for pictures.

    Rows of all logs stand one below the other, (N, ...).

    Attributes:
        log: Number of each row's log, (N,).
        t: Time in its log, s, (N,).
        q: Angles, rad, (N, n).
        v: Rates, rad/s, (N, n).
        weight: Weight of each row, 0 near standstill, (N, n).
        is_shown: Whether a row is one of those that the figures are of, (N,).
        refitted: Residual of the refitted model, weighted, N m, (N, n).
        extended: Residual of the extended model, N m, (N, n).
        dt: Interval of the rows, s.
    """

    log: Array
    t: Array
    q: Array
    v: Array
    weight: Array
    is_shown: Flags
    refitted: Array
    extended: Array
    dt: float

    __repr__ = brief


def measure_held_out(problem: Problem, refitted: Solution, extended: Solution) -> HeldOut:
    """Return the errors of the URDF, the refitted and the extended model.

    Where the extended model has a drive, its error is that of the torque that acts behind it.

    Args:
        problem: The rows with the torque as it was measured.
        refitted: The model without causes.
        extended: The model with the findings.
    """
    rows = problem.rows
    is_shown = ~rows.inner if rows.has_outer else rows.inner
    stated = zip(problem.target.T, problem.friction, problem.rig.friction)
    urdf = np.stack([target - columns @ values for target, columns, values in stated], axis=1)
    weight = rows.sample("weight")
    level = np.maximum(np.std(problem.scale[is_shown], axis=0), 1e-300)
    used = np.mean(weight[is_shown] ** 2, axis=0)
    joints = rows.rig.joints

    def measure(residual: Array) -> Errors:
        # Errors are stated per row of full weight.
        size = np.sqrt(np.mean(residual[is_shown] ** 2, axis=0))
        rmse = size / np.sqrt(np.maximum(used, 1e-300))
        fit = 100.0 * (1.0 - size / level)
        return Errors(dict(zip(joints, rmse.tolist())), dict(zip(joints, fit.tolist())))

    return HeldOut(
        how=rows.how if rows.has_outer else CROSS_VALIDATED,
        cutoff_hz=rows.band,
        urdf=measure(urdf),
        refitted=measure(refitted.left),
        extended=measure(extended.left),
        used=dict(zip(joints, used.tolist())),
        traces=ResidualTraces(
            log=np.concatenate([np.full(part.count, part.log) for part in rows.stretches]),
            t=rows.sample("time"),
            q=rows.sample("q"),
            v=rows.sample("v"),
            weight=weight,
            is_shown=is_shown,
            refitted=refitted.left,
            extended=extended.left,
            dt=0.5 / rows.band,
        ),
    )
