"""Charts that a page's script draws, ``charts.js``: read, zoomed and switched by hand, with one cursor for all of them.

What is written is a table of columns per chart, 32-bit floats, deflated, in base 64.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from gimbal_pin.log.log import Array
from gimbal_pin.report.plots import thinned


@dataclass(frozen=True, eq=False)
class Trace:
    """One curve of a chart.

    Attributes:
        name: In the legend.
        values: One per instant, nan where the curve is broken, (N,).
        colour: A colour, or a variable of the page's style sheet: ``--ink``.
        width: Of its line, pixels.
        is_dashed: Whether it is dashed.
    """

    name: str
    values: Array
    colour: str
    width: float = 1.4
    is_dashed: bool = False


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
    """

    title: str
    colour: str
    label: str
    t: Array
    curves: Sequence[Trace]
    abscissae: Mapping[str, Array]

    def tabulate(self, most: int = 3000) -> Array:
        """Return time since its start, abscissae and curves, (columns, rows), as 32-bit floats.

        Of more than `most` instants those stay where a curve is lowest or highest in a stretch, see `thinned`.
        """
        rows = np.arange(len(self.t))
        if len(rows) > most:
            order, each = rows.astype(float), most // len(self.curves)
            kept = [thinned(order, curve.values, each)[0] for curve in self.curves]
            rows = np.unique(np.concatenate(kept)).astype(int)
        columns = [self.t - self.t[0], *self.abscissae.values(), *(curve.values for curve in self.curves)]
        return np.stack(columns)[:, rows].astype("<f4")


@dataclass(frozen=True, eq=False)
class Charts:
    """Charts in rows of equal length, which are drawn over the same abscissa.

    Attributes:
        clock: Name of the run whose time they show: the cursors of all charts of a run, and its scene, move together.
        rows: The charts.
    """

    clock: str
    rows: Sequence[Sequence[Chart]]

    def __html__(self) -> str:
        """Return it as an element of a page."""
        every = [chart for row in self.rows for chart in row]
        tables = [chart.tabulate() for chart in every]
        drawn = [
            {
                "title": chart.title,
                "colour": chart.colour,
                "label": chart.label,
                "start": float(chart.t[0]),
                "rows": table.shape[1],
                "abscissae": list(chart.abscissae),
                "curves": [{name: x for name, x in vars(curve).items() if name != "values"} for curve in chart.curves],
            }
            for chart, table in zip(every, tables)
        ]
        packed = base64.b64encode(zlib.compress(b"".join(table.tobytes() for table in tables), 9)).decode()
        said = self.clock, json.dumps(drawn, ensure_ascii=False), packed
        html = Markup(
            '<div class="charts" style="--across:{}" data-clock="{}" data-charts="{}" data-deflated="{}"></div>'
        )
        return html.format(len(self.rows[0]), *said)
