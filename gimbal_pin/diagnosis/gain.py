"""Gain of the extended model on unseen data: torque errors, errors of simulated angles, and torques over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan

import numpy as np

from gimbal_pin.checks import check_log
from gimbal_pin.diagnosis.band import limit_band
from gimbal_pin.diagnosis.evidence import Evidence, LogStretch, gather
from gimbal_pin.diagnosis.extended import compute_acting_torque, compute_asked_torque
from gimbal_pin.dynamics.model import Model, is_inertia_positive
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering

Figures = Mapping[str, Mapping[str, float]]
"""Name of a figure → joint → its value."""
CONFIRMED = 1.01
"""Error of the torque without a cause over that with it, from which the held-out part confirms the cause."""


def measure_errors(held: Evidence, model: Model) -> Figures:
    """Return held-out figures of a model: "torque_rmse", "fit_percent" and "rollout_rmse"."""
    rmse = torque_rmse(held, model)
    mean = np.mean(np.concatenate(held.torque), axis=0)
    torque = _compute_rms(held, [x - mean for x in held.torque])
    fit = 100 * (1 - rmse / np.maximum(torque, 1e-300))
    rows = {"torque_rmse": rmse, "fit_percent": fit, "rollout_rmse": rollout_rmse(held, model)}
    return {name: dict(zip(held.rig.joints, values.tolist())) for name, values in rows.items()}


def compare_errors(before: Figures, after: Figures, joint: str) -> dict[str, float]:
    """Return errors of two models at a joint: "torque_rmse_before", "torque_rmse_after", and those of the rollout."""
    pairs = ("before", before), ("after", after)
    return {
        f"{name}_{when}": x[name][joint]
        for name in ("torque_rmse", "rollout_rmse")
        for when, x in pairs
    }


def measure_gain(before: Figures, after: Figures, used: Array) -> float:
    """``Σ_j u_j log(rmse_before/rmse_after)``: what a model gains over another in the whole rig, as log likelihood.

    u_j is the share of joint j's samples that count on the reporting part, (n,): one that stands says nothing.
    """
    errors = (np.array([*figures["torque_rmse"].values()]) for figures in (before, after))
    return float(used @ np.subtract(*(np.log(np.maximum(x, 1e-300)) for x in errors)))


def torque_rmse(evidence: Evidence, model: Model) -> Array:
    """Root mean square of measured less predicted torque, low-passed at the band, away from standstill, N m, (n,)."""
    return _compute_rms(evidence, [_compute_torque_error(part, model) for part in evidence.parts])


def compute_filtered_error(evidence: Evidence, model: Model) -> Array:
    """Measured less predicted torque, gated and low-passed at the band, all parts in a row, N m, (m, n)."""
    return _filter_torques(
        evidence, [_compute_torque_error(part, model) for part in evidence.parts]
    )


def _compute_rms(evidence: Evidence, torques: Sequence[Array]) -> Array:
    """Root mean square of torques, (m, n) per part, gated and low-passed: of one it is one, (n,)."""
    filtered, counted = (
        _filter_torques(evidence, x) for x in (torques, [np.ones((1, 1))] * len(torques))
    )
    return np.sqrt(np.sum(filtered**2, axis=0) / np.maximum(np.sum(counted**2, axis=0), 1e-300))


def _filter_torques(evidence: Evidence, torques: Sequence[Array]) -> Array:
    """Gate torques, (m, n) per part, and low-pass them at the band, N m, all parts in a row, (m, n)."""
    rows = zip(evidence.parts, torques)
    return np.concatenate([
        signals.zero_phase(part.gate * torque, signals.lowpass(evidence.band, 1 / part.dt)) for part, torque in rows
    ])  # fmt: skip


def _compute_torque_error(part: LogStretch, model: Model) -> Array:
    """Acting torque less what the model asks for the same motion, N m, (m, n)."""
    return compute_acting_torque(model, part) - compute_asked_torque(model, part)


def rollout_rmse(evidence: Evidence, model: Model) -> Array:
    """Simulated less measured angle after 0.2 s of the logged torque, from 24 measured states, rad rms, (n,).

    A mean square of so many is known to a third; at least one is of each part. nan where no stretch is long enough,
    where a drag is too stiff for the step, or where the fitted inertias are none that a body can have, as on slow
    motion that does not show them: such a model cannot be simulated, and that it cannot says nothing about its torques.
    """
    parts = evidence.parts
    most = -(-24 // len(evidence.parts))
    possible = all(
        is_inertia_positive(model.rig, part.channels.q[:: max(1, len(part.gate) // 16)])
        for part in parts
    )
    errors = [one for part in parts for one in _roll_out(model, part, most)] if possible else []
    return np.sqrt(np.mean(np.square(errors), axis=0)) if errors else np.full(evidence.rig.n, nan)


def _roll_out(model: Model, part: LogStretch, most: int) -> Iterator[Array]:
    """Yield the errors of so many rollouts, rad, (n,), from states evenly spread, clear of the ends and of holes.

    What friction remembers at a start comes from the measured way to it, and it is as warm as the motor was. A step
    takes 2 ms at most.
    """
    plant = Plant(model, model.carried(part.time, part.platform))
    tau = compute_acting_torque(model, part)
    memory = plant.friction.remembered(part.sample)
    horizon = max(1, round(0.2 / part.dt))
    steps = max(1, round(part.dt / 2e-3))
    edge = len(part.gate) // 20
    count = len(part.gate)
    dt = part.dt / steps
    starts = np.arange(edge, count - edge - horizon + 1)
    if part.channels.lost is not None:
        before = np.concatenate([[0], np.cumsum(part.channels.lost)])
        starts = starts[before[starts + horizon + 1] == before[starts]]
    for start in (
        starts[np.linspace(0, len(starts) - 1, most).astype(int)].tolist() if len(starts) else ()
    ):
        state = State(
            part.channels.q[start],
            part.channels.v[start],
            tuple(one[..., start].tolist() for one in memory),
        )
        plant.friction.warm = part.temperature[start].tolist()
        for k in range(start, start + horizon):
            torque = (tau[k] + tau[k + 1]) / 2
            for i in range(0 if state.lost else steps):
                state = plant.step(part.channels.t[k] - part.origin + i * dt, state, torque, dt)
        yield (
            np.full(len(state.q), nan) if state.lost else state.q - part.channels.q[start + horizon]
        )


def describe_worse_errors(before: Figures, after: Figures) -> list[str]:
    """Name the joints whose position the extended model simulates worse than the refitted one, by over a tenth."""
    old = before["rollout_rmse"]
    new = after["rollout_rmse"]
    worse = ", ".join(
        joint for joint, error in old.items() if isfinite(error) and not new[joint] <= 1.1 * error
    )
    said = "the extended model simulates the position worse than the refitted one; findings are judged by the torque"
    return [f"{worse}: {said}"] if worse else []


@dataclass(frozen=True, eq=False)
class TorqueTrace:
    """A model's torque along a log.

    Attributes:
        log: Name of the log.
        joints: Joint names (n).
        t: Time, s, (m,); it jumps at gaps of the log.
        q: Angles, rad, (m, n).
        v: Rates, rad/s, (m, n).
        measured: Logged torque when it acts, N m, (m, n).
        model: Torque that the model asks of the drives for that motion, N m, (m, n); near standstill, where dry
            friction may have any direction, a guess.
    """

    log: str
    joints: tuple[str, ...]
    t: Array
    q: Array
    v: Array
    measured: Array
    model: Array

    @property
    def residual(self) -> Array:
        """Measured less the model's torque, N m, (m, n)."""
        return self.measured - self.model

    @property
    def torques(self) -> dict[str, Array]:
        """Name → the three torques, N m, (m, n) each."""
        return {"measured": self.measured, "model": self.model, "residual": self.residual}


def trace_torques(model: Model, log: Log, filtering: Filtering | None = None) -> TorqueTrace:
    """``model = tau - (drive(tau) - inverse(q, v, a))`` along a log, checked and smoothed as for `diagnose`.

    Args:
        model: The model, with drives and terms, of a rig with the log's joints.
        log: The log, with torques.
        filtering: As for `diagnose`: all channels are low-passed there; None: `limit_band`.

    Raises:
        DataError: The log is too short to be judged.
        UsageError: It holds no torque.
    """
    filtering = filtering or limit_band([log])
    if model.estimated is not None:
        filtering = replace(filtering, lags=model.estimated.lags)
    checked = check_log(model.rig, log.ordered(model.rig), filtering=filtering).log
    rows = list[tuple[Array, ...]]()
    for part in gather(model.rig, [checked], filtering).parts:
        c = part.channels
        kept = np.ones(len(c.t), bool) if c.lost is None else ~c.lost
        rows.append(
            tuple(
                x[kept] for x in (c.t, c.q, c.v, c.tau, c.tau - _compute_torque_error(part, model))
            )
        )
    return TorqueTrace(
        log.name, model.rig.joints, *(np.concatenate(column) for column in zip(*rows))
    )
