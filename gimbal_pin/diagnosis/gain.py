"""What the extended model gains: prediction and rollout of unseen data, tracking, and the residual over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, isfinite, nan

import numpy as np
from scipy.ndimage import uniform_filter1d

from gimbal_pin.checks import check_log
from gimbal_pin.control.judging import measure_error
from gimbal_pin.control.tracking import tour
from gimbal_pin.control.tuning import tune
from gimbal_pin.diagnosis.band import DIAGNOSIS_BAND
from gimbal_pin.diagnosis.evidence import Evidence, LogStretch, gather
from gimbal_pin.diagnosis.extended import compute_acting_torque, compute_asked_torque
from gimbal_pin.dynamics.model import Model, is_inertia_positive
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.dynamics.sensors import Sensors
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig

Figures = Mapping[str, Mapping[str, float]]
"""Name of a figure → joint → its value."""
CONFIRMED = 1.01
"""Error of the torque without a cause over that with it, from which the held-out part confirms the cause."""
SIMULATED_INTERVAL = 0.004
"""Sampling interval of the simulated controllers, s."""
SIMULATED_BANDWIDTH = 4.0
"""Bandwidth that both are asked for, Hz."""
SIZE = 0.35
"""Angle to each side of the motion, rad, where the limits leave room."""
MOVE = 1.0
"""Duration of each of its moves, s."""
FULL = 0.1
"""Residual, as a share of the joint's torque rms, at which a joint is all red."""


def describe_motion(rig: Rig) -> str:
    """Say which motion it is, and who follows it: a log's own tracking error is of another."""
    sizes = dict.fromkeys(f"{1e3 * SIZE:.0f} mm" if slides else f"{degrees(SIZE):.0f}°" for slides in rig.slides)
    return (
        f"all axes {' or '.join(sizes)} to and fro at once where limits leave room, in moves of {MOVE:g} s, by "
        f"computed torque of {SIMULATED_BANDWIDTH:g} Hz on the extended model; not the log's motion and controller"
    )


def measure_errors(held: Evidence, model: Model) -> Figures:
    """Held-out figures of a model: "torque_rmse", "fit_percent" and "rollout_rmse"."""
    rmse, mean = torque_rmse(held, model), np.mean(np.concatenate(held.torque), axis=0)
    torque = _compute_rms(held, [x - mean for x in held.torque])
    fit = 100 * (1 - rmse / np.maximum(torque, 1e-300))
    rows = {"torque_rmse": rmse, "fit_percent": fit, "rollout_rmse": rollout_rmse(held, model)}
    return {name: dict(zip(held.rig.joints, values.tolist())) for name, values in rows.items()}


def compare_errors(before: Figures, after: Figures, joint: str) -> dict[str, float]:
    """Return errors of two models at a joint: "torque_rmse_before", "torque_rmse_after", and those of the rollout."""
    pairs = ("before", before), ("after", after)
    return {f"{name}_{when}": x[name][joint] for name in ("torque_rmse", "rollout_rmse") for when, x in pairs}


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
    return _filter_torques(evidence, [_compute_torque_error(part, model) for part in evidence.parts])


def _compute_rms(evidence: Evidence, torques: Sequence[Array]) -> Array:
    """Root mean square of torques, (m, n) per part, gated and low-passed: of one it is one, (n,)."""
    filtered, counted = (_filter_torques(evidence, x) for x in (torques, [np.ones((1, 1))] * len(torques)))
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
    parts, most = evidence.parts, -(-24 // len(evidence.parts))
    possible = all(is_inertia_positive(model.rig, part.channels.q[:: max(1, len(part.gate) // 16)]) for part in parts)
    errors = [one for part in parts for one in _roll_out(model, part, most)] if possible else []
    return np.sqrt(np.mean(np.square(errors), axis=0)) if errors else np.full(evidence.rig.n, nan)


def _roll_out(model: Model, part: LogStretch, most: int) -> Iterator[Array]:
    """Yield the errors of so many rollouts, rad, (n,), from states evenly spread, clear of the ends and of holes.

    What friction remembers at a start comes from the measured way to it, and it is as warm as the motor was. A step
    takes 2 ms at most.
    """
    plant, tau = Plant(model, model.carried(part.time, part.platform)), compute_acting_torque(model, part)
    memory = plant.friction.remembered(part.sample)
    horizon, steps = max(1, round(0.2 / part.dt)), max(1, round(part.dt / 2e-3))
    edge, count, dt = len(part.gate) // 20, len(part.gate), part.dt / steps
    starts = np.arange(edge, count - edge - horizon + 1)
    if part.channels.lost is not None:
        before = np.concatenate([[0], np.cumsum(part.channels.lost)])
        starts = starts[before[starts + horizon + 1] == before[starts]]
    for start in starts[np.linspace(0, len(starts) - 1, most).astype(int)].tolist() if len(starts) else ():
        state = State(part.channels.q[start], part.channels.v[start], tuple(one[..., start].tolist() for one in memory))
        plant.friction.warm = part.temperature[start].tolist()
        for k in range(start, start + horizon):
            torque = (tau[k] + tau[k + 1]) / 2
            for i in range(0 if state.lost else steps):
                state = plant.step(part.channels.t[k] - part.origin + i * dt, state, torque, dt)
        yield np.full(len(state.q), nan) if state.lost else state.q - part.channels.q[start + horizon]


def simulate_tracking(before: Model, after: Model, rng: np.random.Generator) -> Figures:
    """Root mean square of reference less true angle, rad, with the causes compensated and without: joint → figures.

    The plant is the extended model. The motion, to and fro on all axes at once, is the same whatever the log, so that
    no choice has touched it; sensors and their noise are the same for both controllers. A loop that is not stable
    without the compensation has no figure, nor have models whose fitted inertias no body can have.
    """
    seed, reference = int(rng.integers(2**63)), tour(after, SIMULATED_INTERVAL, SIZE, MOVE)
    if not all(is_inertia_positive(model.rig, reference.q[::50]) for model in (before, after)):
        return {}
    laws = [
        tune(model, bandwidth_hz=SIMULATED_BANDWIDTH, dt=SIMULATED_INTERVAL).controller for model in (before, after)
    ]
    sense = Sensors.of(after.rig, SIMULATED_INTERVAL)
    figures = [measure_error(after, law, reference, 0.0, sense, seed, delay=1).tolist() for law in laws]
    return {joint: dict(zip(("rms_before", "rms_after"), row)) for joint, *row in zip(after.rig.joints, *figures)}


def describe_worse_errors(before: Figures, after: Figures, tracking: Figures) -> list[str]:
    """Say at which joints the extended model simulates or follows clearly worse; nothing where it does not.

    By a tenth it is the model and not the sensors' noise: 1000 samples tell an rms to 2 %.
    """
    old, new = ({joint: row[f"rms_{when}"] for joint, row in tracking.items()} for when in ("before", "after"))
    compared = (
        ("the extended model simulates the position worse than the refitted one; findings are judged by the torque",
         before["rollout_rmse"], after["rollout_rmse"]),
        ("followed no closer by the controller that knows what was found: what a drive cannot give none makes up for, "
         "and figures that are rough mislead it", old, new),
    )  # fmt: skip
    lines = [
        (", ".join(j for j, x in a.items() if isfinite(x) and not b[j] <= 1.1 * x), said) for said, a, b in compared
    ]
    return [f"{worse}: {said}" for worse, said in lines if worse]


def heat(model: Model, log: Log, filtering: Filtering = DIAGNOSIS_BAND) -> Array:
    """``min(1, rms(tau - model) / (FULL rms(tau)))``, one value per sample and joint of the log, (N, n).

    The residual is low-passed at the filtering's cutoff; its size is that over 0.3 s around each sample, where the
    joint moves, a tenth of that at least: as it stands, dry friction bears any torque. Samples in gaps count as the
    nearest.

    Args:
        model: The model, with drives and terms, of a rig with the log's joints.
        log: The log, with torques.
        filtering: As for `diagnose`.

    Raises:
        DataError: The log is too short to be judged.
        UsageError: It holds no torque.
    """
    evidence = gather(model.rig, [log], filtering)
    torque = np.sqrt(np.mean(np.concatenate(evidence.torque) ** 2, axis=0))
    ends = np.cumsum([len(part.gate) for part in evidence.parts])[:-1]
    sizes = []
    for part, error in zip(evidence.parts, np.split(compute_filtered_error(evidence, model), ends)):
        window = max(1, round(0.3 / part.dt))
        power, moving = (uniform_filter1d(x**2, window, axis=0, mode="constant") for x in (error, part.gate))
        sizes.append(np.sqrt(np.maximum(power / np.maximum(moving, 0.1), 0.0)) / np.maximum(FULL * torque, 1e-300))
    t, size = np.concatenate([part.channels.t for part in evidence.parts]), np.concatenate(sizes)
    return np.clip(np.stack([np.interp(log.t, t, column) for column in size.T], axis=1), 0.0, 1.0)


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


def trace_torques(model: Model, log: Log, filtering: Filtering = DIAGNOSIS_BAND) -> TorqueTrace:
    """``model = tau - (drive(tau) - inverse(q, v, a))`` along a log, checked and smoothed as for `diagnose`.

    Args:
        model: The model, with drives and terms, of a rig with the log's joints.
        log: The log, with torques.
        filtering: As for `diagnose`: all channels are low-passed there.

    Raises:
        DataError: The log is too short to be judged.
        UsageError: It holds no torque.
    """
    if model.estimated is not None:
        filtering = replace(filtering, lags=model.estimated.lags)
    checked = check_log(model.rig, log.ordered(model.rig), filtering=filtering).log
    rows = list[tuple[Array, ...]]()
    for part in gather(model.rig, [checked], filtering).parts:
        c = part.channels
        kept = np.ones(len(c.t), bool) if c.lost is None else ~c.lost
        rows.append(tuple(x[kept] for x in (c.t, c.q, c.v, c.tau, c.tau - _compute_torque_error(part, model))))
    return TorqueTrace(log.name, model.rig.joints, *(np.concatenate(column) for column in zip(*rows)))
