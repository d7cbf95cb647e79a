"""Charts that a page's script draws, ``charts.js``: read, zoomed and switched by hand, with one cursor for all of them.

What is written is a table of columns per chart, 32-bit floats, deflated, in base 64.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from gimbal_pin.log.log import Array
from gimbal_pin.report import plots
from gimbal_pin.report.elements import hash_clock
from gimbal_pin.report.format import ShownJoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Trace:
    """One curve of a chart.

    Attributes:
        name: In the legend.
        values: One per instant, nan where the curve is broken, (N,).
        colour: As in a figure: `plots.INK` and `plots.MUTED` are the page's own.
        width: Of its line, pixels.
        dashes: Length and gap of its dashes, pixels; none: it is not dashed.
        half: Half the width of the band about it, (N,); None: it has none.
    """

    name: str
    values: Array
    colour: str
    width: float = 1.4
    dashes: tuple[float, ...] = ()
    half: Array | None = None


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves in one frame.

    Attributes:
        title: Of what: a joint.
        colour: The title's.
        label: Quantity and unit: ``torque, N m``.
        t: Time, s, increasing, (N,).
        curves: The curves, at least one.
        abscissae: Quantity and unit → values, (N,): what the curves may be drawn over beside time.
        over: Quantity and unit of `t`, where that is not time.
        log: Which axes are logarithmic: "x", "y", "xy" or none.
    """

    title: str
    colour: str
    label: str
    t: Array
    curves: Sequence[Trace]
    abscissae: Mapping[str, Array]
    over: str = "time, s"
    log: str = ""

    def draw(self, axes: Axes) -> None:
        """Draw the curves, a legend above them."""
        for x in self.curves:
            plots.curve(axes, self.t, x.values, color=x.colour, lw=0.8 * x.width, dashes=x.dashes)
            if x.half is not None:
                axes.fill_between(
                    self.t, x.values - x.half, x.values + x.half, color=x.colour, alpha=0.25
                )
        plots.put_legend(
            axes,
            [(x.name, x.colour) for x in self.curves],
            [x.name for x in self.curves if x.dashes],
        )
        axes.set(
            xlabel=self.over,
            ylabel="\n".join(filter(None, (self.title, self.label))),
            xlim=self.t[[0, -1]],
        )
        axes.set(**{f"{axis}scale": "log" for axis in self.log})

    def tabulate(self, most: int = 3000) -> Array:
        """Return time since its start, abscissae, curves and bands' edges, (columns, rows), as 32-bit floats.

        Of more than `most` instants those stay where a curve is lowest or highest in a stretch, see `plots.thinned`.
        """
        rows = np.arange(len(self.t))
        if len(rows) > most:
            order = rows.astype(float)
            each = most // len(self.curves)
            kept = [plots.thinned(order, curve.values, each)[0] for curve in self.curves]
            rows = np.unique(np.concatenate(kept)).astype(int)
        bands = ((x.values - x.half, x.values + x.half) for x in self.curves if x.half is not None)
        columns = [
            self.t - self.t[0],
            *self.abscissae.values(),
            *(x.values for x in self.curves),
            *chain(*bands),
        ]
        return np.stack(columns)[:, rows].astype("<f4")


def list_abscissae(joint: ShownJoint, q: Array, v: Array) -> dict[str, Array]:
    """Return a joint's angle (rad, or m) and rate as `Chart` has them, in the units of a report."""
    name = "position" if joint.unit == "mm" else "angle"
    return {f"{name}, {joint.unit}": joint.scale * q, f"rate, {joint.unit}/s": joint.scale * v}


@dataclass(frozen=True, eq=False)
class Charts:
    """Charts in rows, of equal length but for the last, which are drawn over the same abscissa.

    Attributes:
        clock: Name of the run whose time they show: the cursors of all charts of a run, and its scene, move together.
        rows: The charts.
    """

    clock: str
    rows: Sequence[Sequence[Chart]]

    def draw(self) -> Figure:
        """Draw them, as paper shows them: a legend above each."""
        rows = len(self.rows)
        figure, panels = plots.panels(
            rows, len(self.rows[0]), 0.6 + 1.9 * rows, left=1.05, gaps=(1.1, 0.75)
        )
        for axes, chart in zip(panels.ravel(), chain(*self.rows)):
            chart.draw(axes)
        figure.align_ylabels()
        return figure

    def __html__(self) -> str:
        """Return it as an element of a page."""
        every = [*chain(*self.rows)]
        tables = [chart.tabulate() for chart in every]
        own = {plots.INK: "--ink", plots.MUTED: "--muted"}
        drawn = [
            {
                "title": chart.title,
                "colour": chart.colour,
                "label": chart.label,
                "start": float(chart.t[0]),
                "rows": table.shape[1],
                "abscissae": [chart.over, *chart.abscissae],
                "log": chart.log,
                "curves": [
                    {
                        "name": x.name,
                        "colour": own.get(x.colour, x.colour),
                        "width": x.width,
                        "dashes": x.dashes,
                    }
                    | {"is_banded": x.half is not None}
                    for x in chart.curves
                ],
            }
            for chart, table in zip(every, tables)
        ]
        packed = base64.b64encode(
            zlib.compress(b"".join(table.tobytes() for table in tables), 9)
        ).decode()
        said = hash_clock(self.clock), json.dumps(drawn, ensure_ascii=False), packed
        html = Markup(
            '<div class="charts" style="--across:{}" data-clock="{}" data-charts="{}" data-deflated="{}"></div>'
        )
        return html.format(len(self.rows[0]), *said)
