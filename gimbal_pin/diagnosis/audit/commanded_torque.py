"""A torque that nobody measured: the controller's formula, or a plan, in the place of the motor's current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from gimbal_pin import signals
from gimbal_pin.diagnosis.audit.base import Fault, stated
from gimbal_pin.diagnosis.audit.mend import noted
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig

QUIET = 3e-4
"""No current sensor has less noise than this share of the torque's rms (twelve bits over the peak have as much)."""
LAGS = 3
"""Samples that a command may look back."""
WINDOW, WINDOWS = 0.4, 16
"""Time over which a controller's gains change linearly at most, s, and how many such windows are looked at."""
SOME = 0.3
"""Share of the windows that must agree: elsewhere samples may be lost, or the plan may jump."""
EXACT = 0.01
"""Share of the roughness that a law of the own angle alone may leave to be told."""
OVER = 1.02
"""A torque beyond this multiple of the motor's limit was never delivered."""


@dataclass(frozen=True)
class CommandedTorque:
    """``τ_k = Σ a_l q_{k-l} + b_l v_{k-l} + c_l q_ref_{k-l} + smooth``, exactly: a measurement has noise of its own.

    Third differences leave of every channel only what is not smooth. If those of the torque are the same linear
    combination of the other channels' on samples that the fit has not seen, or if there is nothing left at all, the
    column holds what was asked for and not what the motor did.

    That is allowed (CONTRACT.md), and so is a note: a command is the motor's torque as long as the drive follows. What
    the drive does to it (lag, delay, dead zone, gain) are physical causes, tested with the others. It is a fault only
    where the column itself shows that the motor cannot have followed: beyond its limit.
    """

    name: ClassVar[str] = "commanded-torque"
    shapes: ClassVar[tuple[Parameter, ...]] = (Parameter("noise", 0.01, "share of the torque's rms", 1e-4, 1.0),)

    def examine(self, rig: Rig, log: Log) -> Fault | None:
        """Return a note, the fault where the command exceeds the motor's limit, or None."""
        if log.tau is None or len(log) < 20 * LAGS:
            return None
        size = np.sqrt(np.mean(log.tau**2, axis=0))
        left = np.array([unexplained(log, j) for j in range(rig.n)])
        formula = (left < QUIET * size) & (size > 0)
        if not formula.any():
            return None
        over = np.mean(np.abs(log.tau) > OVER * rig.tau_max, axis=0) * formula
        share = left / np.maximum(size, 1e-300)
        worst = int(np.argmax(over)) if over.any() else int(np.argmin(np.where(formula, share, np.inf)))
        mended = None
        if over.any():
            clipped = np.clip(log.tau, -rig.tau_max, rig.tau_max)
            mended = noted(replace(log, tau=clipped), "the commanded torque was clipped at the motors' limits")
        severity = (
            Parameter("unexplained", float(left[worst]), "N m"),
            Parameter("rough", float(signals.noise_std(log.tau)[worst]), "N m"),
            Parameter("beyond_limit", float(over[worst]), "1"),
            *gains(log, worst),
        )
        return told(rig.joints[worst], int(formula.sum()), severity, mended)

    def corrupt(self, log: Log, rng: np.random.Generator, **shape: float) -> Log:
        """Replace the torque's own noise by a controller's answer to the noise of angle and rate."""
        size = stated(self, shape)["noise"]
        assert log.tau is not None
        sections = signals.lowpass(min(20.0, 0.05 / log.dt), 1.0 / log.dt)
        sensed = [x for x in (log.q, log.v) if x is not None]
        rough = [x - signals.zero_phase(x, sections) for x in sensed]
        wanted = size * np.sqrt(np.mean(log.tau**2, axis=0)) / len(rough)
        answer = sum(wanted / np.maximum(np.std(x, axis=0), 1e-300) * x for x in rough)
        return replace(log, tau=signals.zero_phase(log.tau, sections) - answer)


def unexplained(log: Log, j: int) -> float:
    """What the other channels' third differences leave of one torque's in the best windows, as white noise, N m."""
    assert log.tau is not None
    own = float(signals.noise_std(log.tau[:, j : j + 1])[0])
    if own < 1e-9 * float(np.sqrt(np.mean(log.tau[:, j] ** 2))) or not noisy(log.q if log.v is None else log.v):
        return own
    rough = np.diff(log.tau[:, j], 3)[LAGS - 1 :]
    out = own
    for joints in ([j], list(range(len(log.joints)))):
        columns = lagged(log, joints)
        length = max(round(WINDOW / log.dt), 6 * columns.shape[1])
        starts = range(0, len(rough) - length + 1, max(length, len(rough) // WINDOWS))
        left = [held_out(columns[k : k + length], rough[k : k + length]) for k in starts]
        if left:
            out = min(out, float(np.quantile(left, SOME)))
    return out


def lagged(log: Log, joints: Sequence[int]) -> Array:
    """Third differences of these joints' angles, rates and references, now and up to `LAGS` - 1 samples ago."""
    parts = [np.diff(x[:, joints], 3, axis=0) for x in (log.q, log.v, log.q_ref) if x is not None]
    now = np.concatenate(parts, axis=1)
    n = len(now) - LAGS + 1
    columns = np.concatenate([now[LAGS - 1 - lag : LAGS - 1 - lag + n] for lag in range(LAGS)], axis=1)
    return np.asarray(columns[:, np.std(columns, axis=0) > 0.0])


def gains(log: Log, j: int) -> tuple[Parameter, ...]:
    """What ``τ_k = c₀ q_k + c₁ q_{k-1} + ...`` of the own angle says in the window that it fits best, if it fits.

    Written as a stiffness, ``-Σ c``, and a damping, ``Σ l c_l dt``.
    """
    assert log.tau is not None
    angle = np.diff(log.q[:, j], 3)
    n = len(angle) - LAGS + 1
    columns = np.stack([angle[LAGS - 1 - lag : LAGS - 1 - lag + n] for lag in range(LAGS)], axis=1)
    rough = np.diff(log.tau[:, j], 3)[LAGS - 1 :]
    length, best, found = max(round(WINDOW / log.dt), 30), EXACT, None
    for k in range(0, n - length + 1, max(length, n // WINDOWS)):
        part = slice(k, k + length)
        coefficients = np.linalg.lstsq(columns[part], rough[part], rcond=1e-10)[0]
        left = np.linalg.norm(rough[part] - columns[part] @ coefficients)
        share = float(left / max(float(np.linalg.norm(rough[part])), 1e-300))
        if np.all(np.std(columns[part], axis=0) > 0.0) and np.any(rough[part]) and share < best:
            best, found = share, coefficients
    if found is None:
        return ()
    damping = float(found @ np.arange(LAGS)) * log.dt
    return Parameter("stiffness", -float(found.sum()), "N m/rad"), Parameter("damping", damping, "N m s/rad")


def noisy(sensed: Array) -> bool:
    """Whether a channel has noise above a computer's rounding: without, every smooth torque follows from it."""
    return bool(np.any(signals.noise_std(sensed) > 1e-9 * np.maximum(np.std(sensed, axis=0), 1e-300)))


def held_out(columns: Array, rough: Array) -> float:
    """Fit every second sample of a window, gains changing linearly over it, and return what is left of the others.

    As the standard deviation of white noise, N m.
    """
    columns = columns / np.maximum(np.std(columns, axis=0), 1e-300)
    columns = np.concatenate([columns, columns * np.linspace(-1.0, 1.0, len(columns))[:, None]], axis=1)
    coefficients = np.linalg.lstsq(columns[::2], rough[::2], rcond=1e-10)[0]
    error = rough[1::2] - columns[1::2] @ coefficients
    return float(np.sqrt(np.mean(error**2) / 20.0))


def told(joint: str, count: int, severity: tuple[Parameter, ...], mended: Log | None) -> Fault:
    """Return the note or the fault with its figures and what to do."""
    joints = f" (and {count - 1} more)" if count > 1 else ""
    over = severity[2].value
    end = (
        f"{100 * over:.2g} % of it is beyond the motor's limit and never acted"
        if over
        else "what the drive makes of it does not show"
    )
    law = f", {severity[3].value:.3g} N m/rad and {severity[4].value:.3g} N m s/rad" if len(severity) > 3 else ""
    sentence = (
        f"{joint}{joints}: the torque was commanded, not measured: a formula of the other channels{law} leaves "
        f"{severity[0].value:.1g} N m of it; {end}"
    )
    mend = "log the motor's current as well, times its torque constant"
    return Fault(CommandedTorque.name, joint, severity, bool(over), sentence, mend, mended)
