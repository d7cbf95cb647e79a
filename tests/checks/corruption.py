"""Faults of the data that checks have to find, planted in logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfilt

from gimbal_pin.log import Array, Log


def substitute(log: Log, channel: str, joint: int, column: Array) -> Log:
    """Return the log with another column for one joint."""
    values = getattr(log, channel).copy()
    values[:, joint] = column
    channels: dict[str, Any] = {channel: values}
    return replace(log, **channels)


def plant_clock(
    log: Log,
    rng: np.random.Generator,
    *,
    jitter: float = 0.25,
    holes: int = 0,
    stale: float = 0.0,
) -> Log:
    """Stamp the samples late and early by `jitter` periods rms, cut holes of 0.1 s, repeat a share of the rows."""
    k = np.arange(len(log))
    rows = np.maximum(k - (rng.random(len(k)) < stale), 0)
    late = np.clip(jitter * rng.standard_normal(len(k)), -0.49, 0.49) * log.dt
    length = round(0.1 / log.dt)
    kept = np.all((k - rng.integers(1, len(k), (holes, 1))) // length != 0, axis=0)
    channels: dict[str, Any] = {name: x[rows] for name, x in log.channels.items()}
    return replace(log, t=log.t + late, **channels).part(np.flatnonzero(kept))


def plant_stuck_channel(
    log: Log, rng: np.random.Generator, *, channel: str = "tau", seconds: float = 1.5
) -> Log:
    """Hold one channel of one joint where it is liveliest; of no seconds clip it to 85 % of its samples' sizes."""
    j = int(rng.integers(len(log.joints)))
    column = getattr(log, channel)[:, j].copy()
    length = round(seconds / log.dt)
    if length == 0:
        end = np.quantile(np.abs(column), 0.85)
        return substitute(log, channel, j, np.clip(column, -end, end))
    stretches = range(0, len(log) - length, length)
    begin = max(stretches, key=lambda k: np.std(column[k : k + length]))
    column[begin : begin + length] = column[begin]
    return substitute(log, channel, j, column)


def plant_outliers(
    log: Log,
    rng: np.random.Generator,
    *,
    channel: str = "tau",
    size: float = 8.0,
    share: float = 0.002,
    seconds: float = 0.0,
) -> Log:
    """Add spikes of `size` standard deviations to a share of one channel's samples, or noise over some seconds."""
    j = int(rng.integers(len(log.joints)))
    column = getattr(log, channel)[:, j].copy()
    hit = rng.permutation(len(log))[: round(share * len(log))]
    wild = size * rng.choice([-1.0, 1.0], len(hit)) * rng.uniform(0.5, 1.5, len(hit))
    if seconds:
        hit = len(log) // 3 + np.arange(round(seconds / log.dt))
        wild = 2.0 * rng.standard_normal(len(hit))
    column[hit] += np.std(column) * wild
    return substitute(log, channel, j, column)


def plant_controller_formula(log: Log, rng: np.random.Generator, *, delay: int = 2) -> Log:
    """Replace the torque by a speed loop's answer to the rate, with one per cent of a current sensor's noise."""
    assert log.tau is not None and log.v is not None
    late = np.roll(log.v, delay, axis=0)
    late[:delay] = log.v[0]
    noise = 0.01 * rng.standard_normal(late.shape)
    answer = noise - late / np.maximum(np.std(log.v, axis=0), 1e-300)
    return replace(log, tau=np.mean(log.tau, axis=0) + np.std(log.tau, axis=0) * answer)


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
    return replace(log, tau=pull * np.std(log.tau, axis=0) / np.std(pull, axis=0))


def plant_acceleration_noise(
    log: Log, rng: np.random.Generator, *, angle: float = 0.02, rate: float = 1.0
) -> Log:
    """Add white noise to the angles, rad, and to the rates, rad/s."""
    noise = rng.standard_normal((2, *log.q.shape))
    v = None if log.v is None else log.v + rate * noise[0]
    return replace(log, q=log.q + angle * noise[1], v=v)


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
