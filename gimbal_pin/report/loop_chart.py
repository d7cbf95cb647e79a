"""The loops of a tuning as a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.control.laws.chart import LoopCurves, compute_disk
from gimbal_pin.report import plots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_loop_chart(curves: Sequence[LoopCurves], colours: Mapping[str, str]) -> Figure:
    """Return Bode's two diagrams, Nyquist's with the disk that the loops keep clear of, and a step's answer.

    `colours`: joint → its colour.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7), layout="constrained")
    gain, nyquist, phase, step = figure.subplots(2, 2).flat
    for one, dashes in zip(curves, plots.nest_dashes(len(curves))):
        found, response, look = one.margins, one.response, {"color": colours[one.joints[0]], "dashes": dashes}
        label = f"{', '.join(one.joints)}: {found.phase_margin_deg:.0f}°, disk {found.disk_margin:.2f}"
        gain.loglog(one.frequency, np.abs(response), label=label, **look)
        angle = np.degrees(np.unwrap(np.angle(response)))
        phase.semilogx(one.frequency, angle - 360 * np.ceil(angle[0] / 360), **look)
        nyquist.plot(response.real, response.imag, **look)
        for ratio in {*one.ratios} - {1.0}:
            nyquist.plot(ratio * response.real, ratio * response.imag, color=look["color"], lw=0.6)
        step.plot(1e3 * one.t, one.answer, **look)
    nyquist.fill(*compute_disk(min(one.margins.disk_margin for one in curves)).T, color=plots.PLAIN, alpha=0.3)
    dressed(gain, phase, nyquist, step)
    return figure


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
