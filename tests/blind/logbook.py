"""From a true run to the columns of a log, as the sensors of either kind show it, and the noise that is in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter, welch

from .rigs import Array
from .rnea import GRAVITY
from .sensors import ACCELEROMETER_DENSITY, GYRO_DENSITY, kept_rows, stamps, torque_noise
from .visibility import CUTOFF_HZ, Channels, Spectrum, grid_rate, residual, rms

AMBIENT = 25.0
LONGEST_SEGMENT = 512
TICK = 1e-6
"""Least time between two stamps, s."""
HICCUPS = 5e-4
"""Share of stamps that a busy host writes late."""
LONGEST_HICCUP = 4e-3
"""The most that they are late by, s."""


def by_joint(prefix, rig, values):
    """Columns (N, n) by name."""
    return {f"{prefix}_{joint}": column for joint, column in zip(rig.joints, values.T)}


def columns_of(rig, t, shown):
    """The channels of a log by name."""
    rates = {} if shown.v is None else by_joint("dq", rig, shown.v)
    return {"t": t, **by_joint("q", rig, shown.q), **rates, **by_joint("tau", rig, shown.tau)}


def select(columns, rows):
    """Some rows of every column."""
    return {name: values[rows] for name, values in columns.items()}


def _reference(scene, rng):
    """The reference's columns, which every other log has."""
    return by_joint("q_ref", scene.rig, scene.reference.q) if rng.random() < 0.5 else {}


def temperatures(rig, trace, period):
    """Windings warmed by the square of their torque, a first-order rise of 20 °C at the run's mean power."""
    power = trace.command**2
    power /= np.maximum(power.mean(axis=0), 1e-12)
    columns = {}
    for joint, motor, heating in zip(rig.joints, rig.motors, power.T):
        share = period / motor.warm_up
        heat = lfilter([share], [1.0, share - 1.0], heating)
        columns[f"temp_{joint}"] = AMBIENT + 20.0 * heat
    return columns


def imu(rig, t, motion):
    """Rate and specific force of the base link, in its own frame; at rest where there is no motion."""
    still = np.zeros((len(t), 3))
    channels = motion.imu(t) if motion else (still, still - GRAVITY)
    return {
        f"{kind}_{rig.base}_{axis}": column
        for kind, channel in zip(("gyro", "accel"), channels)
        for axis, column in zip("xyz", channel.T)
    }


def shaken(columns, rng, rate):
    """The IMU's and the thermometers' columns with white noise, the thermometers in steps of 0.1 °C."""
    white = np.sqrt(rate / 2.0)
    size = {"gyro": GYRO_DENSITY * white, "accel": ACCELEROMETER_DENSITY * white, "temp": 0.1}
    noisy = {}
    for name, values in columns.items():
        kind = name.split("_")[0]
        shown = values + size[kind] * rng.normal(size=len(values))
        noisy[name] = np.round(shown, 1) if kind == "temp" else shown
    return noisy


def noisy_channels(scene, trace, rng):
    """What these sensors showed."""
    noise = torque_noise(rng, scene.sensors, trace.command, scene.rate)
    rate = trace.measured_v if scene.sensors.has_rate else None
    return Channels(trace.measured_q, rate, trace.command + noise)


def write_columns(scene, shown, extra, rng):
    """The log as it is written: stamped, with rows lost, in every other log with the reference."""
    t = scene.reference.t
    columns = columns_of(scene.rig, stamps(rng, scene.sensors, t), shown) | extra
    columns |= _reference(scene, rng)
    return select(columns, kept_rows(rng, scene.sensors.lost, len(t)))


# a drive's


@dataclass(frozen=True)
class Shown:
    """`rows` of the run that the log has, stamps `t` (s), and the channels at them."""

    rows: NDArray[np.intp]
    t: Array
    channels: Channels


def _stamped(rng, jitter, t):
    """Stamps of a host's clock: never early, sometimes much too late, always increasing."""
    if jitter == 0.0:
        return t
    late = jitter * np.abs(rng.normal(size=len(t)))
    late += (rng.random(len(t)) < HICCUPS) * rng.uniform(0.0, LONGEST_HICCUP, len(t))
    least = TICK * np.arange(len(t))
    return np.maximum.accumulate(t + late - least) + least


def torque_shown(sensors, scene, trace, rows, noise):
    """Reported torque (M, n), N m: low-passed, late, noisy (`noise` of unit rms), in steps, some rows old."""
    current = sensors.reported(trace.command, scene.rate)
    wanted = trace.t[rows] - sensors.torque_late
    clean = np.stack([np.interp(wanted, trace.t, column) for column in current.T], axis=1)
    step = sensors.torque_step * scene.rig.tau_max
    stepped = step * np.round((clean + sensors.noise_share * rms(trace.command) * noise) / step)
    return stepped[np.arange(len(rows)) // sensors.torque_every * sensors.torque_every]


def show(sensors, scene, trace, every, rng):
    """Every so manieth sample of the run, as these sensors show it."""
    rows = np.arange(0, len(trace.t), every)
    past = np.maximum(rows - round(sensors.angle_late * scene.rate), 0)
    noise = sensors.noise.series(rng, (len(rows), len(scene.rig.links)), scene.rate / every)
    tau = torque_shown(sensors, scene, trace, rows, noise)
    rate = trace.measured_v[past] if sensors.has_rate else None
    if sensors.has_rate and sensors.rate_step:
        rate = sensors.rate_step * np.round(rate / sensors.rate_step)
    stamped = _stamped(rng, sensors.jitter, trace.t[rows])
    return Shown(rows, stamped, Channels(trace.measured_q[past], rate, tau))


def written(sensors, scene, shown, extra, rng):
    """The log's columns: some rows repeat the one before under their own stamp, some are lost, half the logs have the
    reference."""
    rows = shown.rows
    period = float(np.median(np.diff(shown.t)))
    columns = columns_of(scene.rig, shown.t, shown.channels)
    columns |= shaken(select(extra, rows), rng, 1.0 / period)
    columns |= select(_reference(scene, rng), rows)
    source = np.arange(len(rows)) - (rng.random(len(rows)) < sensors.repeated)
    source[0] = 0
    columns = select(columns, source) | {"t": shown.t}
    return select(columns, kept_rows(rng, sensors.lost, len(rows)))


def spectrum(sensors, scene, world, trace, shown):
    """Noise of the torque balance, as it stood before the current's low-pass, and its share of the
    acceleration (n,), none where a joint is held.

    The torque's part in closed form, with its steps; what encoders and clock add, measured against the true run."""
    rows = shown.rows
    rate = scene.rate / (rows[1] - rows[0])
    clean = Channels(world.encoder(trace.q[rows]), None, trace.command[rows])
    error = (shown.t - trace.t[rows])[:, None] * trace.v[rows]
    noisy = Channels(trace.measured_q[rows] + error, None, trace.command[rows])
    (left, a), (true_left, true_a) = (residual(world.reference, x, rate) for x in (noisy, clean))
    segment = min(LONGEST_SEGMENT, len(left))
    hertz, read = welch(left - true_left, grid_rate(rate), nperseg=segment, axis=0)
    below = hertz <= CUTOFF_HZ
    grid = np.arange(0.0, CUTOFF_HZ + 0.02, 0.02)[:, None]
    step = sensors.torque_step * scene.rig.tau_max
    torque = (sensors.noise_share * rms(trace.command)) ** 2 * sensors.noise.density(grid, rate)
    density = (torque + step**2 / (6.0 * rate)) / sensors.passed(grid)
    whole = Spectrum(grid[:, 0], density + Spectrum(hertz[below], read[below]).at(grid[:, 0]))
    share = rms(a - true_a) / np.maximum(rms(true_a), 1e-12)
    share[list(scene.still)] = 0.0
    return whole, share


# channels that do not belong together: to be told as *data*


def late_torque(columns, rng):
    """Every torque column 50–200 ms behind the others; the rows before the first torque are not in the log."""
    late = rng.uniform(0.05, 0.2)
    t = columns["t"]
    torques = {name: x for name, x in columns.items() if name.startswith("tau_")}
    delayed = {name: np.interp(t - late, t, x) for name, x in torques.items()}
    return select(columns | delayed, t >= t[0] + late), {"late": late}


def exchanged_joints(columns, rng):
    """Two joints' columns stand under each other's name, in every channel."""
    joints = [name.removeprefix("tau_") for name in columns if name.startswith("tau_")]
    first, second = rng.choice(joints, 2, replace=False)
    exchanged = dict(columns)
    for kind in ("q", "dq", "tau", "q_ref", "temp"):
        pair = (f"{kind}_{first}", f"{kind}_{second}")
        if pair[0] in columns:
            exchanged |= zip(pair, (columns[pair[1]], columns[pair[0]]))
    return exchanged, {}


MISMATCHES = {
    ("late-torque", "resampled"): late_torque,
    ("exchanged-joints", "all-channels"): exchanged_joints,
}
"""(cause, form) → what it does to a log: its columns, and the sizes of what was done."""
