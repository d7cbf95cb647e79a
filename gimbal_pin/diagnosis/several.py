"""Do several logs speak of one rig? Each log's own parameters against those that all share.

Logs of different cameras, or of a rig that somebody has touched in between, fit one model badly and some cause's name
well: this comes before any name.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.prepare import PreparedLogs
from gimbal_pin.diagnosis.problem import Problem, build_precision, build_target
from gimbal_pin.diagnosis.search import Solution
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array
from gimbal_pin.regression import project_rows


class Disagreement(NamedTuple):
    """Torque between each log's own coefficients and the common ones.

    Attributes:
        logs: Numbers of the logs, (L,).
        moved: That torque, N m rms, (L, n).
        excess: The same over what the log's own fit leaves, (L, n).
        share: The same over all of the log's torque, (L, n).
    """

    logs: list[int]
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
    floor = np.maximum(search.whitening.floor, 1e-12)
    plain = compare_logs(explanation.original, explanation.refitted, floor)
    found = compare_logs(search.problem, explanation.found.final, floor)
    if plain is None or found is None:
        return None
    settings = search.problem.settings
    most = settings.max_log_excess
    least = settings.material_share
    differed = np.any((plain.excess > most) & (plain.share > least), axis=0)
    # Causes must explain what set the logs apart, not only make it smaller.
    limit = np.where(differed | (found.share > settings.log_apart_share), 1 / most, most)
    excess = np.where((found.excess > limit) & (found.share > least), found.excess, 0.0)
    worst, j = np.unravel_index(np.argmax(excess), excess.shape)
    if excess[worst, j] == 0.0:
        return None
    rig = search.problem.rig
    joint = rig.joints[j]
    names = [f"log {number + 1}: {prepared.logs[number].name}" for number in found.logs]
    moved = found.moved[:, j].tolist()
    sentence = (
        f"the logs are not of one rig: at {joint} the fits differ by {digits(moved[worst], 2)} N m "
        f"rms in {names[worst]}, {digits(excess[worst, j], 2)} times their error"
    )
    return Fault(
        cause="logs-disagree",
        joint=joint,
        sentence=sentence,
        parameters=tuple(Parameter(name, x, "N m") for name, x in zip(names, moved)),
        strength=float(excess[worst, j]),
        makes_physics_unreliable=True,
        next_experiment=(
            "diagnose them one at a time; 'identify' takes several payloads together: LOG@PAYLOAD"
        ),
    ).in_units(rig)


def compare_logs(problem: Problem, solution: Solution, floor: Array) -> Disagreement | None:
    """Fit a solution's columns to each log, and compare with ``argmin_β Σ_i |X_i β_i - X_i β|²``.

    Friction and time shifts, which change with temperature and logger, are projected off. None: fewer than two logs
    are long enough.

    Args:
        problem: The rows.
        solution: The model.
        floor: Noise of each joint, N m rms, (n,), which weighs the joints of one log; the log's own error then weighs
            it among the others.
    """
    target = build_target(problem, solution.columns)
    precision = build_precision(problem, solution.columns)
    free = slice(problem.base_count, problem.own_count)
    prior = np.diag(np.sqrt(np.delete(precision, free)))
    stretches = problem.rows.stretches
    number = np.repeat([x.log for x in stretches], [x.count for x in stretches])
    least = problem.settings.min_log_rows
    logs = list[int]()
    errors = list[Array]()
    columns = list[Array]()
    fitted = list[Array]()
    for log in range(max(number) + 1):
        own = number == log
        if np.count_nonzero(own) * problem.rows.used.sum() < least * len(precision):
            continue
        weighted = np.vstack([B[own] / size for B, size in zip(solution.base, floor)])
        torque = (target[own] / floor).T.ravel()
        rows = np.column_stack([np.delete(weighted, free, axis=1), torque])
        rows = project_rows(rows, weighted[:, free])
        X = rows[:, :-1]
        y = rows[:, -1]
        explained = X @ _solve(np.vstack([X, prior]), np.append(y, np.zeros(len(prior))))
        freedom = 1.0 - len(precision) / len(y)
        error = np.maximum(_compute_rms(y - explained, floor) / np.sqrt(freedom), 1e-12)
        scale = np.repeat(floor / error, np.count_nonzero(own))
        logs.append(log)
        errors.append(error)
        columns.append(X * scale[:, None])
        fitted.append(explained * scale)
    if len(logs) < 2:
        return None
    common = _solve(np.vstack(columns), np.concatenate(fitted))
    excess = np.array(
        [_compute_rms(y - X @ common, np.ones_like(floor)) for X, y in zip(columns, fitted)]
    )
    moved = excess * np.array(errors)
    levels = [np.sqrt(np.mean(problem.scale[number == log] ** 2, axis=0)) for log in logs]
    return Disagreement(logs, moved, excess, moved / np.maximum(levels, 1e-12))


def _solve(columns: Array, target: Array) -> Array:
    """Return the least-squares coefficients of columns of any scale; 0 along what they do not show."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(np.linalg.lstsq(columns / size, target, rcond=1e-10)[0] / size)


def _compute_rms(rows: Array, scale: Array) -> Array:
    """Return the rms of rows (n m,) at each joint times its scale, (n,)."""
    return np.asarray(scale * np.sqrt(np.mean(rows.reshape(len(scale), -1) ** 2, axis=1)))
