"""From a run to what a drive's log holds of it, and the spectrum of all noise in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from .coloured import Spectrum
from .logbook import columns_of, shaken
from .rigs import Array
from .sensors import kept_rows
from .visibility import CUTOFF_HZ, Channels, grid_rate, residual, rms

LONGEST_SEGMENT = 512
TICK = 1e-6
"""Least time between two stamps, s."""
HICCUPS, LONGEST_HICCUP = 5e-4, 4e-3
"""Share of stamps that a busy host writes late, and by how much at most, s."""


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
    t = trace.t
    wanted = t[rows] - sensors.torque_late
    clean = np.stack([np.interp(wanted, t, column) for column in current.T], axis=1)
    step = sensors.torque_step * np.array([motor.tau_max for motor in scene.rig.motors])
    stepped = step * np.round((clean + sensors.noise_share * rms(trace.command) * noise) / step)
    held = np.arange(len(rows)) // sensors.torque_every * sensors.torque_every
    return stepped[held]


def show(sensors, scene, trace, every, rng):
    """Every so manieth sample of the run, as these sensors show it."""
    rows = np.arange(0, len(trace.t), every)
    past = np.maximum(rows - round(sensors.angle_late * scene.rate), 0)
    noise = sensors.noise.series(rng, (len(rows), len(scene.rig.links)), scene.rate / every)
    tau = torque_shown(sensors, scene, trace, rows, noise)
    rate = trace.measured_v[past]
    if sensors.rate_step:
        rate = sensors.rate_step * np.round(rate / sensors.rate_step)
    stamps = _stamped(rng, sensors.jitter, trace.t[rows])
    return Shown(
        rows, stamps, Channels(trace.measured_q[past], rate if sensors.has_rate else None, tau)
    )


def written(sensors, scene, shown, extra, rng):
    """The log's columns: some rows repeat the one before under their own stamp, some are lost, half the logs have the
    reference."""
    rig = scene.rig
    rows = shown.rows
    period = float(np.median(np.diff(shown.t)))
    columns = columns_of(rig, shown.t, shown.channels)
    columns |= shaken({name: values[rows] for name, values in extra.items()}, rng, 1.0 / period)
    if rng.random() < 0.5:
        columns |= {
            f"q_ref_{joint}": scene.reference.q[rows, i] for i, joint in enumerate(rig.joints)
        }
    source = np.arange(len(rows)) - (rng.random(len(rows)) < sensors.repeated)
    source[0] = 0
    columns = {name: values if name == "t" else values[source] for name, values in columns.items()}
    kept = kept_rows(rng, sensors.lost, len(rows))
    return {name: values[kept] for name, values in columns.items()}


def spectrum(sensors, scene, world, trace, shown):
    """Noise of the torque balance, as it stood before the current's low-pass, and its share of the
    acceleration (n,), none where a joint is held.

    The torque's part in closed form, with its steps; what encoders and clock add, measured against the true run."""
    rows = shown.rows
    rate = scene.rate / (shown.rows[1] - shown.rows[0])
    clean = Channels(world.encoder(trace.q[rows]), None, trace.command[rows])
    error = (shown.t - trace.t[rows])[:, None] * trace.v[rows]
    noisy = Channels(trace.measured_q[rows] + error, None, trace.command[rows])
    (left, a), (true_left, true_a) = (residual(world.reference, x, rate) for x in (noisy, clean))
    segment = min(LONGEST_SEGMENT, len(left))
    hertz, read = welch(left - true_left, grid_rate(rate), nperseg=segment, axis=0)
    read = read[hertz <= CUTOFF_HZ]
    grid = np.arange(0.0, CUTOFF_HZ + 0.02, 0.02)
    step = sensors.torque_step * np.array([motor.tau_max for motor in scene.rig.motors])
    torque = (sensors.noise_share * rms(trace.command)) ** 2 * sensors.noise.density(grid, rate)[
        :, None
    ]
    density = (torque + step**2 / (6.0 * rate)) / sensors.passed(grid)[:, None]
    whole = Spectrum(grid, density + Spectrum(hertz[: len(read)], read).at(grid))
    share = rms(a - true_a) / np.maximum(rms(true_a), 1e-12)
    share[list(scene.still)] = 0.0
    return whole, share
