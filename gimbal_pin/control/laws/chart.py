"""The loops of a tuning as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.control.laws.base import Pid
from gimbal_pin.control.laws.loop import Margins, frequencies, sampled_loop
from gimbal_pin.effects import Signal
from gimbal_pin.log.log import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_loop_chart(
    joints: Sequence[str],
    loops: Sequence[Pid],
    margins: Sequence[Margins],
    dt: float,
    delay: float,
    drives: Sequence[tuple[Signal, ...]],
    ratios: Sequence[Sequence[float]],
) -> Figure:
    """Return Bode's two diagrams, Nyquist's with the disk that the loops keep clear of, and a step's answer.

    Args:
        joints: Names for the legend.
        loops: Gains that small errors see, one per joint.
        margins: Their margins, the worst over `ratios`.
        dt: Sampling interval, s.
        delay: Time from measurement to torque, s.
        drives: What stands between command and torque, one tuple per joint.
        ratios: Gains of the plant over what the law believes, one tuple per joint: drawn thinner in Nyquist's diagram.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7), layout="constrained")
    gain, nyquist, phase, step = figure.subplots(2, 2).flat
    for joint, pid, found, drive, several in alike(joints, loops, margins, drives, ratios):
        omega = frequencies(pid, dt)
        response = sampled_loop(pid, dt, delay, drive=drive)(np.exp(1j * omega * dt))
        label = f"{joint}: {found.phase_margin_deg:.0f}°, disk {found.disk_margin:.2f}"
        gain.loglog(omega / 2 / pi, np.abs(response), label=label)
        angle = np.degrees(np.unwrap(np.angle(response)))
        phase.semilogx(omega / 2 / pi, angle - 360 * np.ceil(angle[0] / 360))
        (line,) = nyquist.plot(response.real, response.imag)
        for ratio in {*several} - {1.0}:
            nyquist.plot(ratio * response.real, ratio * response.imag, color=line.get_color(), lw=0.6)
        t, answer = disturbance(pid, dt, delay, drive)
        step.plot(1e3 * t, answer)
    disk(nyquist, min(found.disk_margin for found in margins))
    dressed(gain, phase, nyquist, step)
    return figure


def alike(
    joints: Sequence[str],
    loops: Sequence[Pid],
    margins: Sequence[Margins],
    drives: Sequence[tuple[Signal, ...]],
    ratios: Sequence[Sequence[float]],
) -> list[tuple[str, Pid, Margins, tuple[Signal, ...], Sequence[float]]]:
    """Return the arguments of `draw_loop_chart`, joints with the same loop as one, as their curves coincide."""
    same: dict[tuple[Pid, Margins, tuple[Signal, ...], tuple[float, ...]], list[str]] = {}
    for joint, pid, found, drive, several in zip(joints, loops, margins, drives, ratios):
        same.setdefault((pid, found, drive, tuple(several)), []).append(joint)
    return [(", ".join(names), *loop) for loop, names in same.items()]


def disturbance(pid: Pid, dt: float, delay: float, drive: tuple[Signal, ...]) -> tuple[Array, Array]:
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
    return t, 1e3 * answer.outputs


def disk(axes: Axes, margin: float) -> None:
    """Draw the disk around -1 that the loop gain may not enter, for a balanced disk margin."""
    if not 0 < margin < 2:
        return
    near, far = (1 - margin / 2) / (1 + margin / 2), (1 + margin / 2) / (1 - margin / 2)
    angle = np.linspace(0, 2 * pi, 200)
    axes.fill(-(near + far) / 2 + (far - near) / 2 * np.cos(angle), (far - near) / 2 * np.sin(angle), alpha=0.2)


def dressed(gain: Axes, phase: Axes, nyquist: Axes, step: Axes) -> None:
    """Label the four diagrams."""
    gain.axhline(1.0, color="0.6", lw=0.8)
    gain.set(title="Loop gain at the motor, home pose", ylabel="gain")
    gain.legend()
    phase.axhline(-180.0, color="0.6", lw=0.8)
    phase.set(title="Phase", xlabel="frequency, Hz", ylabel="phase, °", ylim=(-360, -90))
    nyquist.plot(-1, 0, "k+")
    nyquist.set(
        title="Nyquist (thin: worst), disk kept clear",
        xlabel="real",
        ylabel="imaginary",
        xlim=(-3, 1),
        ylim=(-2, 2),
        aspect="equal",
    )
    step.set(title="Response to a disturbance of 1 rad/s²", xlabel="time, ms", ylabel="error, mrad")
