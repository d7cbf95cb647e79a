"""Faults of the data itself, planted in a finished log: each is columns, generator → columns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import butter, sosfilt

from .rigs import Array

Columns = dict[str, Array]


@dataclass(frozen=True)
class Damage:
    """A damaged log, and what was done to it: parameters by name, and the channels concerned (empty: all)."""

    columns: Columns
    parameters: dict[str, float] = field(default_factory=dict)
    channels: tuple[str, ...] = ()


Window = tuple[float, float]
"""Which part of the log is touched, in shares of its length."""
Corruption = Callable[[Columns, np.random.Generator, Window], Damage]


def _rows(columns: Columns, window: Window) -> slice:
    n = len(columns["t"])
    return slice(int(window[0] * n), max(int(window[1] * n), int(window[0] * n) + 2))


def _named(columns: Columns, *prefixes: str) -> list[str]:
    return [
        name for name in columns if name.split("_")[0] in prefixes and not name.startswith("q_ref_")
    ]


def _pick(columns: Columns, rng: np.random.Generator, *prefixes: str) -> str:
    return str(rng.choice(_named(columns, *prefixes)))


def _period(columns: Columns) -> float:
    return float(np.median(np.diff(columns["t"])))


def _replaced(columns: Columns, rows: slice, **changed: Array) -> Columns:
    copies = dict(columns)
    for name, values in changed.items():
        copies[name] = columns[name].copy()
        copies[name][rows] = values[rows]
    return copies


def coarse_encoder(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """Encoders of 8–10 bits, and a rate that is their raw difference."""
    bits = int(rng.integers(8, 11))
    rows = _rows(columns, window)
    period = _period(columns)
    step = 2.0 * np.pi / 2**bits
    angles = {name: step * np.round(columns[name] / step) for name in _named(columns, "q")}
    rates = {
        f"d{name}": np.gradient(x, period) for name, x in angles.items() if f"d{name}" in columns
    }
    return Damage(_replaced(columns, rows, **angles, **rates), {"bits": float(bits)})


def noisy_rate(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """White noise on angle and rate so large that accelerations drown in it."""
    rows = _rows(columns, window)
    size = float(np.exp(rng.uniform(np.log(0.1), np.log(0.6))))
    noisy = {}
    for name in _named(columns, "q", "dq"):
        scale = size * float(np.std(columns[name])) * (0.05 if name.startswith("q") else 1.0)
        noisy[name] = columns[name] + scale * rng.normal(size=len(columns["t"]))
    return Damage(_replaced(columns, rows, **noisy), {"share": size})


def jittered_clock(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """Rows stamped by a busy host: 10–40 % of a period rms."""
    size = float(rng.uniform(0.1, 0.4))
    t = columns["t"]
    error = size * _period(columns) * rng.normal(size=len(t))
    stamped = np.maximum.accumulate(
        t + np.clip(error, -0.9 * _period(columns), 0.9 * _period(columns))
    )
    stamped += 1e-9 * np.arange(len(t))
    jittered = _replaced(columns, _rows(columns, window), t=stamped)
    return Damage(jittered | {"t": np.sort(jittered["t"])}, {"jitter": size})


def gaps(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """Five to fifteen holes of 20–200 ms."""
    rows = _rows(columns, window)
    n = len(columns["t"])
    keep = np.ones(n, dtype=bool)
    count = int(rng.integers(5, 16))
    for start in rng.integers(rows.start, rows.stop, count):
        keep[start : start + max(2, int(rng.uniform(0.02, 0.2) / _period(columns)))] = False
    return Damage({name: x[keep] for name, x in columns.items()}, {"gaps": float(count)})


def stale_rows(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """A logger with a clock of its own: every row shows the last reading of a bus that is up to a period older."""
    rows = _rows(columns, window)
    share = float(rng.uniform(0.1, 0.4))
    late = rng.random(len(columns["t"])) < share
    row = np.arange(len(late)) - late
    row[0] = 0
    changed = {name: columns[name][row] for name in columns if name != "t"}
    return Damage(_replaced(columns, rows, **changed), {"share": share})


def filtered_rate(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """dq is the encoder's difference through a causal low-pass of 5–25 Hz, first or second order."""
    hertz = float(rng.uniform(5.0, 25.0))
    order = int(rng.integers(1, 3))
    period = _period(columns)
    sections = butter(order, hertz, fs=1.0 / period, output="sos")
    copies = dict(columns)
    for name in _named(columns, "q"):
        raw = np.diff(columns[name], prepend=columns[name][0]) / period
        smooth = np.asarray(sosfilt(sections, raw))
        old = columns.get(f"d{name}", smooth)
        rows = _rows(columns, window)
        copies[f"d{name}"] = old.copy()
        copies[f"d{name}"][rows] = smooth[rows]
    return Damage(copies, {"hertz": hertz, "order": float(order)})


def frozen_channel(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """A channel repeats its last value for 0.4–4 s, once or twice."""
    name = _pick(columns, rng, "q", "dq", "tau")
    rows = _rows(columns, window)
    stuck = columns[name].copy()
    seconds = float(rng.uniform(0.4, 4.0))
    length = min(int(seconds / _period(columns)), rows.stop - rows.start - 1)
    for start in rng.integers(rows.start, rows.stop - length, int(rng.integers(1, 3))):
        stuck[start : start + length] = stuck[start]
    return Damage({**columns, name: stuck}, {"seconds": length * _period(columns)}, (name,))


def railed_channel(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """A channel's converter ends at a value that the signal often passes."""
    name = _pick(columns, rng, "dq", "tau")
    rows = _rows(columns, window)
    rail = float(np.quantile(np.abs(columns[name]), rng.uniform(0.8, 0.95)))
    railed = np.clip(columns[name], -rail, rail)
    return Damage(_replaced(columns, rows, **{name: railed}), {"rail": rail}, (name,))


def spikes(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """Lone rows, 0.05–1 % of them, that are off by 3–20 standard deviations."""
    name = _pick(columns, rng, "q", "dq", "tau")
    rows = _rows(columns, window)
    share = float(rng.uniform(5e-4, 0.01))
    hit = rng.random(len(columns["t"])) < share
    size = (
        rng.uniform(3.0, 20.0, len(hit)) * rng.choice([-1.0, 1.0], len(hit)) * np.std(columns[name])
    )
    spiky = columns[name] + hit * size
    return Damage(_replaced(columns, rows, **{name: spiky}), {"share": share}, (name,))


def burst(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """Half a second to three of garbage on one channel."""
    name = _pick(columns, rng, "q", "dq", "tau")
    rows = _rows(columns, window)
    length = min(int(rng.uniform(0.5, 3.0) / _period(columns)), rows.stop - rows.start - 1)
    start = int(rng.integers(rows.start, rows.stop - length))
    noisy = columns[name].copy()
    noisy[start : start + length] += 2.0 * np.std(columns[name]) * rng.normal(size=length)
    return Damage({**columns, name: noisy}, {"seconds": length * _period(columns)}, (name,))


CORRUPTIONS: dict[str, dict[str, Corruption]] = {
    "acceleration-noise": {"coarse-encoder": coarse_encoder, "noisy-rate": noisy_rate},
    "clock": {"jitter": jittered_clock, "gaps": gaps, "stale-rows": stale_rows},
    "filtered-velocity": {"low-passed": filtered_rate},
    "stuck-channel": {"frozen": frozen_channel, "railed": railed_channel},
    "outliers": {"spikes": spikes, "burst": burst},
}


def late_torque(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """Every torque column 50–200 ms behind the others; the rows before the first torque are not in the log."""
    late = float(rng.uniform(0.05, 0.2))
    t = columns["t"]
    kept = t >= t[0] + late
    delayed = {name: np.interp(t - late, t, columns[name]) for name in _named(columns, "tau")}
    return Damage(
        {name: x[kept] for name, x in (columns | delayed).items()}, {"late": late}, tuple(delayed)
    )


def exchanged_joints(columns: Columns, rng: np.random.Generator, window: Window) -> Damage:
    """Two joints' columns stand under each other's name, in every channel."""
    joints = [name.removeprefix("tau_") for name in _named(columns, "tau")]
    first, second = (str(joint) for joint in rng.choice(joints, 2, replace=False))
    other = {first: second, second: first}
    exchanged = {
        f"{kind}_{joint}": columns[f"{kind}_{other[joint]}"]
        for kind in ("q", "dq", "tau", "q_ref", "temp")
        for joint in other
        if f"{kind}_{joint}" in columns
    }
    return Damage(columns | exchanged, channels=tuple(exchanged))


MISMATCHES: dict[str, dict[str, Corruption]] = {
    "late-torque": {"resampled": late_torque},
    "exchanged-joints": {"all-channels": exchanged_joints},
}
"""Whole channels that do not belong together: to be told as *data*, whatever else is said."""
COMMANDED = ("pure", "lagging-drive")
"""Forms of `commanded-torque`, no damage done to a log: its torque is the controller's formula from the start."""
