"""The loops of a tuning as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from gimbal_pin.control.laws.base import Pid
from gimbal_pin.control.laws.loop import Margins, frequencies, responses, sampled_loop
from gimbal_pin.effects import Signal
from gimbal_pin.log.log import Array
from gimbal_pin.rig.brief import brief


@dataclass(frozen=True, eq=False)
class LoopCurves:
    """What is drawn of a loop that some joints share.

    Attributes:
        joints: Their names.
        margins: The worst over `ratios`.
        frequency: Hz, (m,).
        response: Loop gain there, broken at the motor, complex, (m,).
        ratios: Gains of the plant over what the law believes: the others than one are drawn thinner.
        t: Time, s, (k,).
        answer: Angle after a step of 1 rad/s² of disturbing acceleration, mrad, (k,).
    """

    joints: tuple[str, ...]
    margins: Margins
    frequency: Array
    response: Array
    ratios: tuple[float, ...]
    t: Array
    answer: Array

    __repr__ = brief


def compute_loop_curves(
    joints: Sequence[str],
    loops: Sequence[Pid],
    margins: Sequence[Margins],
    dt: float,
    delay: float,
    drives: Sequence[tuple[Signal, ...]],
    ratios: Sequence[Sequence[float]],
) -> tuple[LoopCurves, ...]:
    """Return what is drawn of each loop; joints with the same loop are one, as their curves coincide.

    Args:
        joints: Their names.
        loops: Gains that small errors see, one per joint.
        margins: Their margins, the worst over `ratios`.
        dt: Sampling interval, s.
        delay: Time from measurement to torque, s.
        drives: What stands between command and torque, one tuple per joint.
        ratios: Gains of the plant over what the law believes, one tuple per joint.
    """
    same: dict[tuple[Pid, Margins, tuple[Signal, ...], tuple[float, ...]], list[str]] = {}
    for joint, pid, found, drive, several in zip(joints, loops, margins, drives, ratios):
        same.setdefault((pid, found, drive, tuple(several)), []).append(joint)
    curves = []
    for (pid, found, drive, own), names in same.items():
        omega = frequencies(pid, dt)
        response = responses(sampled_loop(pid, dt, delay, drive=drive), omega)
        answer = disturbance(pid, dt, delay, drive)
        curves.append(LoopCurves(tuple(names), found, omega / 2 / pi, response, own, *answer))
    return tuple(curves)


def disturbance(
    pid: Pid, dt: float, delay: float, drive: tuple[Signal, ...]
) -> tuple[Array, Array]:
    """Time, s, and the angle after a step of 1 rad/s² of disturbing acceleration, mrad."""
    import control

    loop = sampled_loop(pid, dt, delay, drive=drive)
    seen = np.zeros((1, loop.nstates))
    seen[0, 0] = 1.0
    # The disturbance enters at once, the torque only after its delay.
    push = np.zeros((loop.nstates, 1))
    push[:2, 0] = dt**2 / 2, dt
    closed = control.ss(loop.A - loop.B @ loop.C, push, seen, 0.0, dt)
    t = dt * np.arange(round(6 / pid.kp**0.5 / dt * 2))
    answer = control.forced_response(closed, t, np.ones_like(t))
    return t, 1e3 * np.asarray(answer.outputs)


def compute_disk(margin: float) -> Array:
    """Points on the edge of the disk around -1 that the loop gain may not enter, for a balanced disk margin, (m, 2)."""
    if not 0 < margin < 2:
        return np.zeros((0, 2))
    near = (1 - margin / 2) / (1 + margin / 2)
    far = (1 + margin / 2) / (1 - margin / 2)
    angle = np.linspace(0, 2 * pi, 200)
    return np.column_stack([np.cos(angle), np.sin(angle)]) * (far - near) / 2 - [
        (near + far) / 2,
        0.0,
    ]
