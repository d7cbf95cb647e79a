"""From a true run to the columns of a log, with and without its sensors' errors."""

from __future__ import annotations

import numpy as np

from .rnea import GRAVITY
from .sensors import ACCELEROMETER_DENSITY, GYRO_DENSITY, kept_rows, stamps, torque_noise
from .visibility import Channels

AMBIENT = 25.0


def columns_of(rig, t, shown):
    columns = {"t": t}
    for prefix, values in (("q", shown.q), ("dq", shown.v), ("tau", shown.tau)):
        if values is not None:
            columns |= {f"{prefix}_{joint}": values[:, i] for i, joint in enumerate(rig.joints)}
    return columns


def noisy_channels(scene, trace, rng):
    """What these sensors showed."""
    noise = torque_noise(rng, scene.sensors, trace.command, scene.rate)
    rate = trace.measured_v if scene.sensors.has_rate else None
    return Channels(trace.measured_q, rate, trace.command + noise)


def temperatures(rig, trace, period):
    """Windings warmed by the square of their torque, a first-order rise of 20 °C at the run's mean power."""
    columns = {}
    for i, (joint, motor) in enumerate(zip(rig.joints, rig.motors, strict=True)):
        power = trace.command[:, i] ** 2
        heat = 0.0
        path = np.empty(len(power))
        for k, x in enumerate((power / max(power.mean(), 1e-12)).tolist()):
            heat += period / motor.warm_up * (x - heat)
            path[k] = heat
        columns[f"temp_{joint}"] = AMBIENT + 20.0 * path
    return columns


def imu(rig, t, motion):
    """Rate and specific force of the base link, in its own frame; at rest where there is no motion."""
    still = np.zeros((len(t), 3))
    gyro, force = motion.imu(t) if motion else (still, still - GRAVITY)
    names = [
        (f"{kind}_{rig.base}_{axis}", i)
        for kind in ("gyro", "accel")
        for i, axis in enumerate("xyz")
    ]
    return {name: (gyro if name.startswith("gyro") else force)[:, i] for name, i in names}


def shaken(columns, rng, rate):
    """The IMU's and the thermometers' columns with white noise, the thermometers in steps of 0.1 °C."""
    density = {"gyro": float(GYRO_DENSITY), "accel": ACCELEROMETER_DENSITY}
    noisy = {}
    for name, values in columns.items():
        kind = name.split("_")[0]
        if kind == "temp":
            noisy[name] = np.round(values + 0.1 * rng.normal(size=len(values)), 1)
        else:
            noisy[name] = values + density[kind] * np.sqrt(rate / 2.0) * rng.normal(
                size=len(values)
            )
    return noisy


def write_columns(scene, shown, extra, rng):
    """The log as it is written: stamped, with rows lost, in every other log with the reference."""
    rig = scene.rig
    t = scene.reference.t
    columns = columns_of(rig, stamps(rng, scene.sensors, t), shown) | extra
    if rng.random() < 0.5:
        columns |= {f"q_ref_{joint}": scene.reference.q[:, i] for i, joint in enumerate(rig.joints)}
    rows = kept_rows(rng, scene.sensors.lost, len(t))
    return {name: values[rows] for name, values in columns.items()}
