"""Do several logs speak of one rig? Each log's own parameters against those that all share.

Logs of different cameras, or of a rig that somebody has touched in between, fit one model badly and some cause's name
well: this comes before any name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.prepare import PreparedLogs
from gimbal_pin.diagnosis.problem import FIRST_NOISE, Problem, build_precision, build_target
from gimbal_pin.diagnosis.search import Solution
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array
from gimbal_pin.regression import project_rows

EXCESS = 2.0
"""Torque that a log's own parameters move, over what its own fit leaves, from which it is of another rig: less could be
a misfit that the logs' motions bring out differently."""
EXPLAINED_EXCESS = 0.5
"""Limit where logs differed before any cause was found: causes must explain that, not only make it smaller."""
APART_SHARE = 0.25
"""Share of a log's torque that its own parameters move, from which `EXPLAINED_EXCESS` is the limit: by a quarter of the
torque one rig does not differ, however badly each log is fitted."""
REWEIGHTINGS = 2
"""Fits of one log: the second weighs joints by what the first leaves."""
LEAST_ROWS = 2.0
"""Rows per coefficient from which a log has a fit of its own."""


@dataclass(frozen=True, eq=False)
class OwnFit:
    """Fit of one log alone; friction and time shifts, which change with temperature and logger, are projected off.

    Attributes:
        log: Number of the log.
        columns: Rows over `scale`, one joint's below another's, (n m, k).
        fitted: Torque by its own coefficients, over `scale`, (n m,).
        scale: What they leave at each joint, N m rms over all its rows, (n,).
        torque: Rms of the torque, N m, (n,).
    """

    log: int
    columns: Array
    fitted: Array
    scale: Array
    torque: Array


@dataclass(frozen=True, eq=False)
class Disagreement:
    """Torque between each log's own coefficients and the common ones.

    Attributes:
        logs: Numbers of the logs, (L,).
        moved: That torque, N m rms, (L, n).
        excess: The same over what the log's own fit leaves, (L, n).
        share: The same over all of the log's torque, (L, n).
    """

    logs: tuple[int, ...]
    moved: Array
    excess: Array
    share: Array


def find_disagreement(explanation: Explanation, prepared: PreparedLogs) -> Fault | None:
    """Return the fault of logs that are not of one rig; None: they agree, or cannot tell.

    Rows for the shown figures count as well.
    """
    if len(prepared.logs) < 2:
        return None
    search = explanation.search
    least = search.problem.settings.material_share
    plain = compare_logs(explanation.original, explanation.refitted)
    found = compare_logs(search.problem, explanation.found.final)
    differed = np.any((plain.excess > EXCESS) & (plain.share > least), axis=0)
    limit = np.where(differed | (found.share > APART_SHARE), EXPLAINED_EXCESS, EXCESS)
    excess = np.where((found.excess > limit) & (found.share > least), found.excess, 0.0)
    if not np.any(excess > 0):
        return None
    worst, j = (int(x) for x in np.unravel_index(np.argmax(excess), excess.shape))
    rig = search.problem.rig
    names = [f"log {number + 1}: {prepared.logs[number].name}" for number in found.logs]
    return Fault(
        cause="logs-disagree",
        joint=rig.joints[j],
        sentence=(
            f"the logs are not of one rig: at {rig.joints[j]} the fits differ by "
            f"{digits(found.moved[worst, j], 2)} N m rms in {names[worst]}, "
            f"{digits(excess[worst, j], 2)} times their error"
        ),
        parameters=tuple(
            Parameter(name, moved, "N m") for name, moved in zip(names, found.moved[:, j].tolist())
        ),
        strength=float(excess[worst, j]),
        makes_physics_unreliable=True,
        next_experiment=(
            "diagnose them one at a time; 'identify' takes several payloads together: LOG@PAYLOAD"
        ),
    ).in_units(rig)


def compare_logs(problem: Problem, solution: Solution) -> Disagreement:
    """Fit a solution's columns to each log, and compare with ``argmin_β Σ_i |X_i β_i - X_i β|²``."""
    rows = problem.rows
    n = problem.rig.n
    target = build_target(problem, solution.columns)
    precision = build_precision(problem, solution.columns)
    number = np.repeat([x.log for x in rows.stretches], [x.count for x in rows.stretches])
    free = slice(problem.base_count, problem.own_count)
    fits = list[OwnFit]()
    for log in sorted({*number.tolist()}):
        own = number == log
        if np.count_nonzero(own) * float(rows.used.sum()) < LEAST_ROWS * len(precision):
            continue
        columns = [B[own] for B in solution.base]
        fits.append(_fit_log(log, columns, target[own], problem.measured[own], free, precision))
    if len(fits) < 2:
        none = np.zeros((0, n))
        return Disagreement((), none, none, none)
    common = _solve(np.vstack([x.columns for x in fits]), np.concatenate([x.fitted for x in fits]))
    excess = np.array([_compute_rms(x.fitted - x.columns @ common, n) for x in fits])
    moved = excess * np.array([x.scale for x in fits])
    share = moved / np.array([x.torque for x in fits])
    return Disagreement(tuple(x.log for x in fits), moved, excess, share)


def _fit_log(
    log: int,
    columns: Sequence[Array],
    target: Array,
    measured: Array,
    free: slice,
    precision: Array,
) -> OwnFit:
    """Fit one log's rows.

    Args:
        log: Its number.
        columns: Rows of the columns at each joint, n of (m, p).
        target: The torque less what is known, N m, (m, n).
        measured: The torque, N m, (m, n).
        free: Columns that are the log's own whatever the rig.
        precision: Prior precision of all coefficients, (p,).
    """
    n = target.shape[1]
    prior = np.diag(np.sqrt(np.delete(precision, free)))
    torque = np.maximum(_compute_rms(measured.T.ravel(), n), 1e-12)
    left = FIRST_NOISE * torque
    freedom = max(1.0 - len(precision) / target.size, 1.0 / target.size)
    for _ in range(REWEIGHTINGS):
        scale = left
        weighted = np.vstack([B / size for B, size in zip(columns, scale)])
        rows = np.column_stack([np.delete(weighted, free, axis=1), (target / scale).T.ravel()])
        rows = project_rows(rows, weighted[:, free])
        X = rows[:, :-1]
        y = rows[:, -1]
        fitted = X @ _solve(np.vstack([X, prior]), np.append(y, np.zeros(len(prior))))
        left = np.maximum(scale * _compute_rms(y - fitted, n) / np.sqrt(freedom), 1e-12)
    again = np.repeat(scale / left, len(target))
    return OwnFit(log, X * again[:, None], fitted * again, left, torque)


def _solve(columns: Array, target: Array) -> Array:
    """Return the least-squares coefficients of columns of any scale; 0 along what they do not show."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(np.linalg.lstsq(columns / size, target, rcond=1e-10)[0] / size)


def _compute_rms(rows: Array, joints: int) -> Array:
    """Return the rms of rows (n m,) at each joint, (n,)."""
    return np.asarray(np.sqrt(np.mean(rows.reshape(joints, -1) ** 2, axis=1)))
