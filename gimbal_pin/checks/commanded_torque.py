"""A torque that was commanded and not measured: the law of a servo that pulls towards its reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig

LEAST_SENSOR_NOISE = 3e-4
"""Noise of a current sensor, at least, as a share of the torque's rms: twelve bits over the peak have as much.

Twice as much would still be less than any of ten measured devices whose drives report a current.
"""
MIN_SAMPLES = 40
"""Fewest samples of which the four coefficients are fitted to every second."""
OVER = 1.02
"""A torque beyond this multiple of the motor's limit was never delivered: a drive regulates its current to 1 %."""


def check_commanded_torque(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``τ = a + k q_ref + b q + c v`` exactly, for one joint: a measurement would have noise of its own.

    That is allowed: a command is the motor's torque as long as the drive follows. What the drive does to it (lag,
    delay, dead zone, gain) are physical causes, tested with the others. It makes the physics unreliable only where the
    column itself shows that the motor cannot have followed: beyond its limit. A log without a reference, or with
    another law, tells nothing of where its torque comes from, however smooth that is.
    """
    if log.tau is None or log.q_ref is None or len(log) < MIN_SAMPLES:
        return None
    size = np.sqrt(np.mean(log.tau**2, axis=0))
    left = np.array(
        [compute_law_error(log, j, log.tau[:, j], log.q_ref[:, j]) for j in range(rig.n)]
    )
    commanded = left < LEAST_SENSOR_NOISE * size
    if not commanded.any():
        return None
    over = np.mean(np.abs(log.tau) > OVER * rig.tau_max, axis=0) * commanded
    worst = int(np.argmax(over)) if over.any() else int(np.argmax(commanded))
    beyond = float(over[worst])
    joint = rig.joints[worst]
    figures = (
        Parameter("unexplained", float(left[worst]), "N m"),
        Parameter("beyond_limit", beyond, "1"),
    )
    end = f"{digits(100 * beyond, 2)} % of the samples are beyond the motor's limit and were never delivered"
    sentence = (
        f"{joint}{f' (and {commanded.sum() - 1} more)' if commanded.sum() > 1 else ''}: the torque is a command, the "
        f"servo's law of reference and angle; {end if beyond else 'whether the drive followed does not show'}"
    )
    mend = "log the motor's current as well, times its torque constant"
    strength = LEAST_SENSOR_NOISE / max(float(left[worst] / size[worst]), 1e-12)
    fault = Fault("commanded-torque", joint, sentence, figures, strength, bool(beyond), mend)
    return Examined(
        fault, (replace(log, tau=np.clip(log.tau, -rig.tau_max, rig.tau_max)),) if beyond else ()
    )


def compute_law_error(log: Log, j: int, tau: Array, reference: Array) -> float:
    """Return what the law of joint j, fitted to every second sample, leaves of the others' torque, N m rms."""
    rate = () if log.v is None else (log.v[:, j],)
    columns = np.column_stack([np.ones(len(tau)), reference, log.q[:, j], *rate])
    coefficients = np.linalg.lstsq(columns[::2], tau[::2], rcond=None)[0]
    return float(np.sqrt(np.mean((tau - columns @ coefficients)[1::2] ** 2)))
