"""What no cause explains, as a table over the joint's angle, rate or load: its posterior, given where the log went."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import get_args

import numpy as np
from scipy.linalg import block_diag

from gimbal_pin.diagnosis.engine.discrepancy import unseen
from gimbal_pin.diagnosis.engine.explained import Explained
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import build_extended_model
from gimbal_pin.diagnosis.gain import Figures, measure_errors, measure_gain
from gimbal_pin.diagnosis.result import Curve
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects.torque_table import Over, TorqueTable
from gimbal_pin.log.log import Array
from gimbal_pin.regression import STRUCTURED

TABLE_KNOTS = 96
"""Of a table: a step of less than two degrees over half a turn, which a prior smooths."""
LENGTHS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Steps between knots over which a curve bends: the log decides."""


def read_curve(state: State, table: TorqueTable) -> Curve:
    """Return a table as a state knows it.

    ``√(2 log k)`` deviations are more than the largest of k knots has by chance (Donoho and Johnstone, Biometrika 81,
    1994).
    """
    torque = state.coefficients(table)
    std = np.sqrt(np.diag(state.fit.covariance)[state.places(table)])
    clear = np.flatnonzero(np.abs(torque) > np.sqrt(2 * np.log(len(std))) * std)
    runs = [run for run in np.split(clear, np.flatnonzero(np.diff(clear) > 1) + 1) if len(run)]
    step = table.knots[1] - table.knots[0]
    acts = tuple((table.knots[run[0]] - step, table.knots[run[-1]] + step) for run in runs)
    return Curve(table.over, table.knots, tuple(torque.tolist()), tuple(std.tolist()), acts)


def add_tables(
    found: Explained, held: Evidence, baseline: Figures, figures: Figures
) -> tuple[State, Figures, dict[str, Curve]]:
    """Return a model with a table at each joint at which something is left, its figures, and the tables.

    The reporting part has to confirm each: less error at its joint, and over the whole rig, than without it and than
    without any cause. A table of the load, which is part of the load, must not grow as fast as that.

    Args:
        found: The model of the training part.
        held: The reporting part.
        baseline: Figures there of the model without any cause.
        figures: The model's figures there.
    """
    state = found.final
    curves = dict[str, Curve]()
    for joint in np.flatnonzero(found.structured).tolist():
        table = find_table(state, joint)
        if table is None:
            continue
        more = add_table(state, table)
        slopes = np.diff(more.coefficients(table)) / np.diff(table.knots)
        if table.loaded and np.max(np.abs(slopes)) >= 1:
            continue
        after = measure_errors(held, build_extended_model(more))
        if all(
            after["torque_rmse"][table.joint] < before["torque_rmse"][table.joint]
            and measure_gain(before, after, held.used) > 0
            for before in (baseline, figures)
        ):
            state, figures, curves[table.joint] = more, after, read_curve(more, table)
    return state, figures, curves


def find_table(state: State, joint: int) -> TorqueTable | None:
    """Return the table over angle, rate or load that predicts most of what is left on unseen blocks; None: none does.

    Its knots are spread over what the samples that count have visited.
    """
    fit = state.fit
    block = state.problem.evidence.block
    error = dict[TorqueTable, float]()
    rows = fit.rows(joint)
    residual = fit.residual[rows]
    stack = fit.stack[rows]
    for over in get_args(Over):
        table = spread_knots(state, joint, over)
        columns = fit.weighted(state.columns(table).own, joint)
        smooth = (np.hstack([stack, columns @ correlate_knots(table, steps)]) for steps in LENGTHS)
        error[table] = min(
            float(x @ x) for x in (unseen(stack[:, :0], one, residual, block) for one in smooth)
        )
    best = min(error, key=error.__getitem__)
    return best if error[best] < (1 - STRUCTURED) * float(residual @ residual) else None


def spread_knots(state: State, joint: int, over: Over) -> TorqueTable:
    """Return a table over what a joint has visited, or over a turn, where it makes more than one."""
    parts = state.problem.evidence.parts
    place = state.problem.evidence.rig.joints[joint]
    every = (
        state.torque
        if over == "load"
        else [getattr(part.channels, "qv"[over == "rate"]) for part in parts]
    )
    x = np.concatenate(
        [values[part.gate[:, joint] > 0.5, joint] for values, part in zip(every, parts)]
    )
    if over == "angle" and np.ptp(x) > 2 * pi:
        return TorqueTable(
            place, over, tuple(np.linspace(0.0, 2 * pi, TABLE_KNOTS, endpoint=False).tolist()), True
        )
    return TorqueTable(
        place, over, tuple(np.linspace(x.min(), x.max(), TABLE_KNOTS + 2)[1:-1].tolist())
    )


def correlate_knots(table: TorqueTable, steps: float) -> Array:
    """L of ``L Lᵀ = (1 + √3 d) exp(-√3 d)``, (k, k), d the distance of knots in so many steps: smooth curves.

    Of angles within a turn the distance is the chord, for which it is a covariance, too.
    """
    gap = np.abs(np.subtract.outer(table.knots, table.knots))
    d = np.sqrt(3.0) * (2.0 * np.sin(gap / 2.0) if table.cyclic else gap) / (steps * gap[0, 1])
    power, axes = np.linalg.eigh((1.0 + d) * np.exp(-d))
    return np.asarray(axes * np.sqrt(np.maximum(power, 1e-9)))


def add_table(state: State, table: TorqueTable) -> State:
    """Return a state with the posterior of a table's values b beside a model whose θ moves as it may.

    ``b = L u``, ``u ~ N(0, v I)``, H the precision of θ, ``S = LᵀWᵀ(W - A H⁻¹ AᵀW)L``: ``cov u = (S + I/v)⁻¹``,
    ``u = cov LᵀWᵀr``, ``θ ← θ - H⁻¹AᵀW b``. The curve's length and v maximise the marginal likelihood
    ``-½ (N log(rᵀr - rᵀW b) + log det(I + v S))`` (Rasmussen and Williams, Gaussian Processes, 2006, 2.7 and 5.4).
    Where the log says little, the values stay near zero.
    """
    fit = state.fit
    columns = state.columns(table)
    at = fit.rows(columns.joint)
    size = len(fit.theta)
    used = state.problem.evidence.used
    W = np.zeros((len(fit.residual), columns.own.shape[1]))
    W[at] = fit.weighted(columns.own, columns.joint)
    moved = fit.information @ (fit.stack.T @ W)
    E = W - fit.stack @ moved
    left = fit.residual[at]
    own = W.T @ E
    along = W.T @ fit.residual
    count = len(left) * float(used[columns.joint])
    found = []
    for steps in LENGTHS:
        L = correlate_knots(table, steps)
        power, axes = np.linalg.eigh(L.T @ own @ L)
        power = np.maximum(power, 0.0)
        turned = axes.T @ (L.T @ along)
        for spread in np.geomspace(1e-4, 1e4, 33) / max(float(power.mean()), 1e-300):
            rest = max(
                float(left @ left - np.sum(turned**2 * spread / (1 + spread * power))), 1e-300
            )
            found.append(
                (
                    count * np.log(rest) + np.sum(np.log1p(spread * power)),
                    rest,
                    spread,
                    L,
                    power,
                    axes,
                )
            )
    _, rest, spread, L, power, axes = min(found, key=lambda one: float(one[0]))
    known = L @ (axes / (1 / spread + power)) @ axes.T @ L.T
    values = known @ along
    turn = np.block([[np.eye(size), -moved], [np.zeros(moved.T.shape), np.eye(len(values))]])
    prior = np.linalg.inv(L @ L.T) * (rest / max(count, 1.0) / spread)
    more = replace(
        fit,
        theta=np.concatenate([fit.theta - moved @ values, values]),
        stack=np.hstack([fit.stack, W]),
        axes=np.pad(fit.axes, ((0, W.shape[1]), (0, 0))),
        residual=fit.residual - E @ values,
        information=turn @ block_diag(fit.information, known) @ turn.T,
        prior=block_diag(fit.prior + np.zeros((size, size)), prior),
    )
    return replace(state, causes=(*state.causes, table), fit=more)
