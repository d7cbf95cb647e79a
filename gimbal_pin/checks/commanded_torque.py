"""A torque that nobody measured: the controller's formula, or a plan, in the place of the motor's current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig

LEAST_SENSOR_NOISE = 3e-4
"""No current sensor has less noise than this share of the torque's rms (twelve bits over the peak have as much)."""
LAGS = 3
"""Samples that a command may look back."""
GAIN_WINDOW, GAIN_WINDOWS = 0.4, 16
"""Time over which a controller's gains change linearly at most, s, and how many such windows are looked at."""
SOME = 0.3
"""Share of the windows that must agree: elsewhere samples may be lost, or the plan may jump."""
OVER = 1.02
"""A torque beyond this multiple of the motor's limit was never delivered."""


def check_commanded_torque(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``τ_k = Σ a_l q_{k-l} + b_l v_{k-l} + c_l q_ref_{k-l} + smooth``, exactly: a measurement has noise of its own.

    Third differences leave of every channel only what is not smooth. If those of the torque are the same linear
    combination of the other channels' on samples that the fit has not seen, or if there is nothing left at all, the
    column holds what was asked for and not what the motor did.

    That is allowed: a command is the motor's torque as long as the drive follows. What the drive does to
    it (lag, delay, dead zone, gain) are physical causes, tested with the others. It makes the physics unreliable only
    where the column itself shows that the motor cannot have followed: beyond its limit.
    """
    if log.tau is None or len(log) < 20 * LAGS:
        return None
    size = np.sqrt(np.mean(log.tau**2, axis=0))
    everything = build_lagged_columns(log, range(rig.n))
    left = np.array([compute_unexplained_noise(log, j, everything) for j in range(rig.n)])
    formula = (left < LEAST_SENSOR_NOISE * size) & (size > 0)
    if not formula.any():
        return None
    over = np.mean(np.abs(log.tau) > OVER * rig.tau_max, axis=0) * formula
    share = np.where(formula, left / np.maximum(size, 1e-300), np.inf)
    worst = int(np.argmax(over)) if over.any() else int(np.argmin(share))
    figures = (
        Parameter("unexplained", float(left[worst]), "N m"),
        Parameter("rough", float(signals.noise_std(log.tau)[worst]), "N m"),
        Parameter("beyond_limit", float(over[worst]), "1"),
    )
    joint, beyond = rig.joints[worst], float(over[worst])
    never = f"{digits(100 * beyond, 2)} % of it is beyond the motor's limit and never acted"
    others = f" (and {formula.sum() - 1} more)" if formula.sum() > 1 else ""
    sentence = (
        f"{joint}{others}: the torque was commanded, not measured: a formula of the other channels leaves "
        f"{digits(float(left[worst]), 1)} N m of it; {never if beyond else 'what the drive makes of it does not show'}"
    )
    mend = "log the motor's current as well, times its torque constant"
    strength = LEAST_SENSOR_NOISE / max(float(share[worst]), 1e-12)
    fault = Fault("commanded-torque", joint, sentence, figures, strength, bool(beyond), mend)
    return Examined(fault, (replace(log, tau=np.clip(log.tau, -rig.tau_max, rig.tau_max)),) if beyond else ())


def exceeds_limit(rig: Rig, log: Log) -> bool:
    """Whether any torque is beyond its motor's limit: else there is nothing to mend in a command."""
    return log.tau is not None and bool(np.any(np.abs(log.tau) > OVER * rig.tau_max))


def compute_unexplained_noise(log: Log, j: int, everything: Array) -> float:
    """What the other channels' third differences leave of one torque's in the best windows, as white noise, N m.

    By those of its own joint, and by `everything`: `build_lagged_columns` of all joints.
    """
    assert log.tau is not None
    own = float(signals.noise_std(log.tau[:, j : j + 1])[0])
    if own < 1e-9 * float(np.sqrt(np.mean(log.tau[:, j] ** 2))) or not has_noise(log.q if log.v is None else log.v):
        return own
    rough = np.diff(log.tau[:, j], 3)[LAGS - 1 :]
    out = own
    for columns in (build_lagged_columns(log, [j]), everything):
        length = max(round(GAIN_WINDOW / log.dt), 6 * columns.shape[1])
        starts = range(0, len(rough) - length + 1, max(length, len(rough) // GAIN_WINDOWS))
        left = [compute_held_out_error(columns[k : k + length], rough[k : k + length]) for k in starts]
        if left:
            out = min(out, float(np.quantile(left, SOME)))
    return out


def build_lagged_columns(log: Log, joints: Sequence[int]) -> Array:
    """Third differences of these joints' angles, rates and references, now and up to `LAGS` - 1 samples ago."""
    parts = [np.diff(x[:, joints], 3, axis=0) for x in (log.q, log.v, log.q_ref) if x is not None]
    now = np.concatenate(parts, axis=1)
    n = len(now) - LAGS + 1
    columns = np.concatenate([now[LAGS - 1 - lag : LAGS - 1 - lag + n] for lag in range(LAGS)], axis=1)
    return np.asarray(columns[:, np.std(columns, axis=0) > 0.0])


def has_noise(sensed: Array) -> bool:
    """Whether a channel has noise above a computer's rounding: without, every smooth torque follows from it."""
    return bool(np.any(signals.noise_std(sensed) > 1e-9 * np.maximum(np.std(sensed, axis=0), 1e-300)))


def compute_held_out_error(columns: Array, rough: Array) -> float:
    """Fit every second sample of a window, gains changing linearly over it, and return what is left of the others.

    As the standard deviation of white noise, N m.
    """
    columns = columns / np.maximum(np.std(columns, axis=0), 1e-300)
    columns = np.concatenate([columns, columns * np.linspace(-1.0, 1.0, len(columns))[:, None]], axis=1)
    coefficients = np.linalg.lstsq(columns[::2], rough[::2], rcond=1e-10)[0]
    error = rough[1::2] - columns[1::2] @ coefficients
    return float(np.sqrt(np.mean(error**2) / 20.0))
