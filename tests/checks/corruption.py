"""Faults of the data that checks have to find, planted in logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfilt

from gimbal_pin.log import Log


def plant_clock(
    log: Log,
    rng: np.random.Generator,
    *,
    jitter: float = 0.25,
    holes: int = 0,
    stale: float = 0.0,
) -> Log:
    """Stamp the samples late and early by `jitter` periods rms, cut holes of 0.1 s, repeat a share of the rows."""
    n = len(log)
    rows = np.maximum(np.arange(n) - (rng.random(n) < stale), 0)
    late = np.clip(jitter * rng.standard_normal(n), -0.49, 0.49) * log.dt
    lost = np.zeros(n, bool)
    for start in rng.integers(1, n, holes):
        lost[start : start + round(0.1 / log.dt)] = True
    channels: dict[str, Any] = {name: x[rows] for name, x in log.channels.items()}
    return replace(log, t=log.t + late, **channels).part(np.flatnonzero(~lost))


def plant_stuck_channel(
    log: Log,
    rng: np.random.Generator,
    *,
    channel: str = "tau",
    seconds: float = 1.5,
    rail: float | None = None,
) -> Log:
    """Hold one channel of one joint for some seconds while it is lively, or clip it at a quantile of its size."""
    values = np.array(getattr(log, channel))
    j = int(rng.integers(len(log.joints)))
    if rail is not None:
        end = np.quantile(np.abs(values[:, j]), rail)
        values[:, j] = np.clip(values[:, j], -end, end)
    else:
        length = min(round(seconds / log.dt), len(log) // 2)
        starts = np.arange(0, len(log) - length, max(length // 4, 1))
        spread = np.array([np.std(values[k : k + length, j]) for k in starts])
        begin = int(rng.choice(starts[spread >= np.median(spread)]))
        values[begin : begin + length, j] = values[begin, j]
    changes: dict[str, Any] = {channel: values}
    return replace(log, **changes)


def plant_outliers(
    log: Log,
    rng: np.random.Generator,
    *,
    channel: str = "tau",
    size: float = 8.0,
    share: float = 0.002,
    seconds: float | None = None,
) -> Log:
    """Add spikes of `size` standard deviations to a share of one channel's samples, or noise over some seconds."""
    values = np.array(getattr(log, channel))
    j = int(rng.integers(len(log.joints)))
    n = len(log)
    spread = size * float(np.std(values[:, j]))
    if seconds is not None:
        length = min(round(seconds / log.dt), n // 8)
        begin = int(rng.integers(n // 8, 7 * n // 8 - length))
        values[begin : begin + length, j] += 0.25 * spread * rng.standard_normal(length)
    else:
        hit = rng.choice(n, max(1, round(share * n)), replace=False)
        values[hit, j] += (
            spread * rng.choice([-1.0, 1.0], len(hit)) * rng.uniform(0.5, 1.5, len(hit))
        )
    changes: dict[str, Any] = {channel: values}
    return replace(log, **changes)


def plant_controller_formula(
    log: Log, rng: np.random.Generator, *, delay: int = 2, noise: float = 0.01
) -> Log:
    """Replace the torque by a speed loop's answer to the rate, with so large a share of a current sensor's noise."""
    assert log.tau is not None
    v = np.gradient(log.q, log.t, axis=0) if log.v is None else log.v
    size = np.std(log.tau, axis=0)
    late = np.concatenate([v[:1].repeat(delay, axis=0), v[: len(v) - delay]])
    answer = np.mean(log.tau, axis=0) - size / np.maximum(np.std(v, axis=0), 1e-300) * late
    return replace(log, tau=answer + noise * size * rng.standard_normal(v.shape))


def plant_filtered_velocity(
    log: Log, rng: np.random.Generator, *, corner: float = 8.0, order: int = 1
) -> Log:
    """Replace the rate by the angle's differences behind a causal Butterworth low-pass."""
    raw = np.diff(log.q, axis=0, prepend=log.q[:1]) / log.dt
    sections = butter(order, min(corner * log.dt, 0.45), fs=1.0, output="sos")
    return replace(log, v=sosfilt(sections, raw - raw[0], axis=0) + raw[0])


def plant_commanded_torque(log: Log, rng: np.random.Generator) -> Log:
    """Replace the torque by a servo's law of the reference and the angle."""
    assert log.tau is not None and log.q_ref is not None
    pull = log.q_ref - log.q
    power = np.mean(log.tau**2, axis=0) / np.maximum(np.mean(pull**2, axis=0), 1e-300)
    return replace(log, tau=pull * np.sqrt(power))


def plant_acceleration_noise(
    log: Log, rng: np.random.Generator, *, angle: float = 0.02, rate: float = 1.0
) -> Log:
    """Add white noise to the angles, rad, and to the rates, rad/s."""
    q = log.q + angle * rng.standard_normal(log.q.shape)
    v = None if log.v is None else log.v + rate * rng.standard_normal(log.q.shape)
    return replace(log, q=q, v=v)


CORRUPTIONS: Mapping[str, Callable[..., Log]] = {
    "clock": plant_clock,
    "stuck-channel": plant_stuck_channel,
    "outliers": plant_outliers,
    "controller-formula": plant_controller_formula,
    "filtered-velocity": plant_filtered_velocity,
    "commanded-torque": plant_commanded_torque,
    "acceleration-noise": plant_acceleration_noise,
}
"""Cause → ``plant(log, rng, **size)``, in the order of the checks."""
