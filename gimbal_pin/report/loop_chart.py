"""The loops of a tuning: charts over frequency and time, Nyquist's diagram, and a figure of all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from gimbal_pin.control.laws.chart import LoopCurves, compute_disk
from gimbal_pin.log.log import Array
from gimbal_pin.report import plots
from gimbal_pin.report.charts import Chart, Charts, Trace
from gimbal_pin.report.elements import join

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class LoopPicture:
    """Bode's two diagrams and a step's answer as charts, and Nyquist's with the disk that the loops keep clear of.

    Attributes:
        curves: The loops.
        colours: Joint → its colour.
        of: Whose loops they are.
    """

    curves: Sequence[LoopCurves]
    colours: Mapping[str, str]
    of: str

    def __html__(self) -> Markup:
        """Return it as an element of a page."""
        joints = ", ".join(self.colours)
        caption = (
            f"The loops of {self.of}, sampled and delayed as they will run: gain and phase at the motor, home pose, "
            "and the answer to a disturbance."
        )
        alt = f"Bode diagrams and disturbance answers of {joints}"
        charts = self.make_charts()
        drawn = plots.Drawing(charts.draw, alt, caption, charts=self.make_charts)
        near = (
            "The further the curves stay from −1, the safer: all keep clear of the disk, the "
            "worst draws (thin), too."
        )
        return join(
            [drawn, plots.Drawing(self.draw_nyquist, f"Nyquist diagrams of {joints}", near)]
        )

    def __str__(self) -> str:
        """Return no lines."""
        return ""

    def draw(self) -> Figure:
        """Return all of it as one figure."""

        def make() -> Figure:
            figure, panels = plots.panels(2, 2, 7.0, right=0.55, gaps=(0.95, 0.85))
            gain, nyquist, phase, step = panels.flat
            for axes, chart in zip((gain, phase, step), *self.make_charts().rows):
                chart.draw(axes)
            for axes, level in ((gain, 0.0), (phase, -180.0)):
                axes.axhline(level, color=plots.MUTED, lw=0.8)
            self.add_nyquist(nyquist)
            return figure

        return plots.Drawing(make, "Loops", "").draw()

    def make_charts(self) -> Charts:
        """Return a row: gain and phase over all frequencies, and the angle after a step of 1 rad/s² over time."""
        dashes = plots.nest_dashes(len(self.curves))
        row = list[Chart]()
        for label, over, log, drawn in (
            (
                "loop gain, dB",
                "frequency, Hz",
                "x",
                [(x.frequency, 20 * np.log10(abs(x.response))) for x in self.curves],
            ),
            (
                "phase, °",
                "frequency, Hz",
                "x",
                [(x.frequency, compute_phase(x.response)) for x in self.curves],
            ),
            (
                "error after 1 rad/s², mrad",
                "time, ms",
                "",
                [(1e3 * x.t, x.answer) for x in self.curves],
            ),
        ):
            every = np.unique(np.concatenate([x for x, _ in drawn]))
            traces = [
                Trace(
                    ", ".join(one.joints),
                    np.interp(every, x, y, np.nan, np.nan),
                    self.colours[one.joints[0]],
                    width=2.0,
                    dashes=how,
                )
                for one, how, (x, y) in zip(self.curves, dashes, drawn)
            ]
            row.append(Chart("", "", label, every, traces, {}, over, log))
        return Charts("loops", [row])

    def draw_nyquist(self) -> Figure:
        """Draw Nyquist's diagram alone."""
        figure, panels = plots.panels(1, 1, 4.2)
        self.add_nyquist(panels[0, 0])
        return figure

    def add_nyquist(self, axes: Axes) -> None:
        """Draw Nyquist's diagram into axes."""
        for one, dashes in zip(self.curves, plots.nest_dashes(len(self.curves))):
            real = one.response.real
            imaginary = one.response.imag
            colour = self.colours[one.joints[0]]
            found = one.margins
            names = ", ".join(one.joints)
            label = f"{names}: {found.phase_margin_deg:.0f}°, disk {found.disk_margin:.2f}"
            axes.plot(real, imaginary, color=colour, dashes=dashes, label=label)
            for ratio in {*one.ratios} - {1.0}:
                axes.plot(ratio * real, ratio * imaginary, color=colour, lw=0.6, zorder=1.5)
        least = min(one.margins.disk_margin for one in self.curves)
        axes.fill(*compute_disk(least).T, color=plots.PLAIN, alpha=0.3)
        axes.plot(-1, 0, "+", color=plots.INK)
        axes.set(
            xlabel="real",
            ylabel="imaginary",
            xlim=(-3, 1),
            ylim=(-2, 2),
            aspect="equal",
            anchor="W",
        )
        axes.set_title("Nyquist; thin: the worst")
        axes.legend(loc="upper left", bbox_to_anchor=(1, 1))


def compute_phase(response: Array) -> Array:
    """Return the phase, °, which begins within a turn below zero; nan where it has gone beyond."""
    angle = np.degrees(np.unwrap(np.angle(response)))
    angle -= 360 * np.ceil(angle[0] / 360)
    return np.where(angle > -360, angle, np.nan)
