"""Torques of any model along logs, on the rows of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.checks import check_log
from gimbal_pin.diagnosis.rows import WIDEST_DOUBLED_BAND, Rows, Stretch, build_rows
from gimbal_pin.diagnosis.settings import SETTINGS
from gimbal_pin.dynamics.model import Model, is_motor_friction
from gimbal_pin.dynamics.regressor import compute_coupling, compute_inertia_column
from gimbal_pin.effects import Signal
from gimbal_pin.effects.signal import JointLoad
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering, limit_cutoff


def limit_band(logs: Sequence[Log]) -> Filtering:
    """Return the band of a diagnosis, or as much of it as the sampling rates of some logs carry."""
    band = Filtering(cutoff=SETTINGS.band_hz, smoothing=SETTINGS.smoothing)
    return limit_cutoff(band, logs, WIDEST_DOUBLED_BAND)


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
        filtering: Band, smoothing and time of the torque; None: `limit_band`.

    Raises:
        DataError: The log is too short to be judged.
        UsageError: It holds no torque.
    """
    filtering = filtering or limit_band([log])
    checked = check_log(model.rig, log.ordered(model.rig), filtering=filtering).log
    pieces = list[tuple[Array, ...]]()
    for part in build_model_rows(model, [checked], filtering).stretches:
        x = part.samples
        kept = np.ones(len(x.t), bool) if x.lost is None else ~x.lost
        predicted = x.tau - _compute_error(model, part)
        pieces.append(tuple(channel[kept] for channel in (x.t, x.q, x.v, x.tau, predicted)))
    channels = [np.concatenate(pieces_of_one) for pieces_of_one in zip(*pieces)]
    return TorqueTrace(log.name, model.rig.joints, *channels)


def build_model_rows(model: Model, logs: Sequence[Log], filtering: Filtering | None = None) -> Rows:
    """Return the rows that a model is judged on: each torque stands when it acts, by the model's own lags.

    Args:
        model: The model.
        logs: Logs of its rig, with torques.
        filtering: As for `trace_torques`.

    Raises:
        DataError: No part of the logs is long enough.
    """
    filtering = filtering or limit_band(logs)
    if model.estimated is not None:
        filtering = replace(filtering, lags=model.estimated.lags)
    return build_rows(model.rig, logs, filtering.cutoff, SETTINGS, "none", filtering)


def compute_torque_error(rows: Rows, model: Model) -> Array:
    """Return the rows of measured less predicted torque, weighted to zero near standstill, N m, (N, n)."""
    errors = [_compute_error(model, part) for part in rows.stretches]
    joints = range(rows.rig.n)
    return np.hstack([rows.project([error[:, j] for error in errors], j) for j in joints])


def measure_torque_rmse(rows: Rows, model: Model) -> Array:
    """Return the root mean square of measured less predicted torque, away from standstill, N m, (n,)."""
    power = np.mean(compute_torque_error(rows, model) ** 2, axis=0)
    return np.asarray(np.sqrt(power / np.maximum(rows.used, 1e-300)))


def _compute_error(model: Model, part: Stretch) -> Array:
    """Return acting torque less what the model asks for the same motion, N m, (m, n)."""
    x = part.samples
    platform = None if x.platform is None else replace(x.platform, t=part.time)
    asked = model.inverse_dynamics(
        x.q, x.v, x.a, part.direction, part.time, part.temperature, platform, part.losses
    )
    acting: Array = x.tau.copy()
    for signal in model.drive:
        j = model.rig.joint_index(signal.joint)
        borne = _compute_load(model, part, j, asked[:, j]) if signal.geared else None
        is_logged = np.array_equal(acting[:, j], x.tau[:, j])
        if not is_logged or (signal.geared and not signal.abrupt):
            loss: Array = acting[:, j] - signal.along(acting[:, j], part.dt, borne)
        else:
            loss = _compute_logged_loss(model, part, signal, j)
        acting -= signal.spread(loss, j, acting.shape[1], borne)
    return acting - asked


def _compute_logged_loss(model: Model, part: Stretch, signal: Signal, joint: int) -> Array:
    """Return what a drive takes from its joint's torque along a stretch, N m, (m,).

    A limit or a gap acts on each sample of the log, and not on their smoothed course.
    """
    logged = part.logged.tau[:, joint]
    loss = logged - signal.acting(logged, part.dt / part.logged.step)
    lags = () if model.estimated is None else model.estimated.lags
    return part.logged.smoothed(loss[:, None], lags[joint] if lags else 0.0)[:, 0]


def _compute_load(model: Model, part: Stretch, joint: int, asked: Array) -> JointLoad:
    """Return what a joint bears along a stretch of the torque that the model asks for, N m, (m,)."""
    x = part.samples
    friction = tuple(term for term in model.by_joint[joint] if is_motor_friction(term.effect))
    brake = Model(model.rig, friction).passive(
        x.q, x.v, x.a, part.direction, x.tau, part.time, part.temperature, part.losses
    )[:, joint]
    column = compute_inertia_column(model.rig, x.q, joint)
    rotor = float(model.armature[joint])
    inertial = (column[:, joint] + rotor) * x.a[:, joint]
    is_still = np.abs(x.v[:, joint]) < SETTINGS.sign_deviations * x.rate_std[joint]
    across = compute_coupling(column, joint, rotor)
    load = asked - inertial - brake
    return JointLoad.along(brake, load, x.tau[:, joint], is_still, inertial, across)
