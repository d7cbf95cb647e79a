"""From a true run to the columns of a log, as the sensors of either kind show it, and the noise that is in it."""

import numpy as np
from scipy.signal import lfilter, welch

from .rnea import GRAVITY
from .sensors import ACCELEROMETER_DENSITY, GYRO_DENSITY, kept_rows, stamps, torque_noise
from .visibility import CUTOFF_HZ, Blur, Channels, Spectrum, grid_rate, noise_of, rms

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


def write_plainly(scene, world, trace, extra, noise_rng, rng):
    """The log as plain sensors show it: stamped, with rows lost, in every other log with the reference; and how much
    noise is in it."""
    sensors = scene.sensors
    tau = trace.command + torque_noise(noise_rng, sensors, trace.command, scene.rate)
    noisy = Channels(trace.measured_q, trace.measured_v if sensors.has_rate else None, tau)
    true_rate = trace.v if sensors.has_rate else None
    clean = Channels(world.encoder(trace.q), true_rate, trace.command)
    left, acceleration = noise_of(world.reference, noisy, clean, scene.rate)
    extra = shaken(extra, rng, scene.rate)
    columns = columns_of(scene.rig, stamps(rng, sensors, scene.reference.t), noisy) | extra
    columns |= _reference(scene, rng)
    kept = kept_rows(rng, sensors.lost, len(trace.t))
    return select(columns, kept), Blur(rms(left), acceleration)


# a drive's


def _stamped(rng, jitter, t):
    """Stamps of a host's clock: never early, sometimes much too late, always increasing."""
    if jitter == 0.0:
        return t
    late = jitter * np.abs(rng.normal(size=len(t)))
    late += (rng.random(len(t)) < HICCUPS) * rng.uniform(0.0, LONGEST_HICCUP, len(t))
    least = TICK * np.arange(len(t))
    return np.maximum.accumulate(t + late - least) + least


def torque_shown(scene, trace, rows, rng):
    """Reported torque (M, n), N m: low-passed, late, noisy, in steps, some rows old."""
    sensors = scene.sensors
    rate = scene.rate / (rows[1] - rows[0])
    noise = sensors.noise.series(rng, (len(rows), len(scene.rig.links)), rate)
    current = sensors.reported(trace.command, scene.rate)
    wanted = trace.t[rows] - sensors.torque_late
    clean = np.stack([np.interp(wanted, trace.t, column) for column in current.T], axis=1)
    step = sensors.torque_step * scene.rig.tau_max
    stepped = step * np.round((clean + sensors.noise_share * rms(trace.command) * noise) / step)
    return stepped[np.arange(len(rows)) // sensors.torque_every * sensors.torque_every]


def write_as_a_drive(scene, world, trace, extra, noise_rng, rng):
    """The log as a drive's sensors show it, and how much noise is in it: some rows repeat the one before under their
    own stamp, some are lost, half the logs have the reference."""
    sensors = scene.sensors
    rows = np.arange(0, len(trace.t), scene.every)
    past = np.maximum(rows - round(sensors.angle_late * scene.rate), 0)
    tau = torque_shown(scene, trace, rows, noise_rng)
    rate = trace.measured_v[past] if sensors.has_rate else None
    if sensors.has_rate and sensors.rate_step:
        rate = sensors.rate_step * np.round(rate / sensors.rate_step)
    t = _stamped(noise_rng, sensors.jitter, trace.t[rows])
    columns = columns_of(scene.rig, t, Channels(trace.measured_q[past], rate, tau))
    columns |= shaken(select(extra, rows), rng, 1.0 / float(np.median(np.diff(t))))
    columns |= select(_reference(scene, rng), rows)
    source = np.arange(len(rows)) - (rng.random(len(rows)) < sensors.repeated)
    source[0] = 0
    columns = select(columns, source) | {"t": t}
    kept = kept_rows(rng, sensors.lost, len(rows))
    return select(columns, kept), drive_noise(scene, world, trace, rows, t)


def drive_noise(scene, world, trace, rows, t):
    """Noise of the torque balance, as it stood before the current's low-pass, and its share of the
    acceleration, none where a joint is held.

    The torque's part in closed form, with its steps; what encoders and clock add, measured against the true run."""
    sensors = scene.sensors
    rate = scene.rate / (rows[1] - rows[0])
    clean = Channels(world.encoder(trace.q[rows]), None, trace.command[rows])
    error = (t - trace.t[rows])[:, None] * trace.v[rows]
    noisy = Channels(trace.measured_q[rows] + error, None, trace.command[rows])
    left, share = noise_of(world.reference, noisy, clean, rate)
    hertz, read = welch(left, grid_rate(rate), nperseg=min(LONGEST_SEGMENT, len(left)), axis=0)
    below = hertz <= CUTOFF_HZ
    grid = np.arange(0.0, CUTOFF_HZ + 0.02, 0.02)
    step = sensors.torque_step * scene.rig.tau_max
    colour = sensors.noise.density(grid, rate)[:, None]
    torque = (sensors.noise_share * rms(trace.command)) ** 2 * colour
    density = (torque + step**2 / (6.0 * rate)) / sensors.passed(grid)[:, None]
    whole = Spectrum(grid, density + Spectrum(hertz[below], read[below]).at(grid))
    share[list(scene.still)] = 0.0
    return Blur(whole.floor(), share, whole)


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
