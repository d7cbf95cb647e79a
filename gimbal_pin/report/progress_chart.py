"""Estimates with their bands over time, as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.errors import NORMAL_95, DataError
from gimbal_pin.identification import Progress
from gimbal_pin.report import plots
from gimbal_pin.report.format import joint_colours

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN_PARAMETERS = 5
"""Parameters that are drawn, those first that move the most torque."""


def draw_progress_chart(history: Sequence[Progress]) -> Figure:
    """Return the most telling parameters with their 95 % intervals, the torque error, and every event.

    Raises:
        DataError: Nothing was known at any time.
    """
    complete = [one for one in history if not one.hidden]
    if not complete:
        raise DataError(
            "plot", "would show nothing: the log has not shown every parameter", "go on recording"
        )
    return plots.Drawing(
        partial(_draw_progress, history, complete[-1]), "Estimates over time", ""
    ).draw()


def _draw_progress(history: Sequence[Progress], last: Progress) -> Figure:
    """Draw a panel for each of the last estimate's most telling parameters, and one for the torque error."""
    shown = last.telling[:DRAWN_PARAMETERS]
    joints = list(last.torque_error)
    count = len(shown) + 1
    figure, panels = plots.panels(
        count, 1, 0.9 + 1.4 * count, right=0.85, gaps=(0, 0.4), share=(True, False)
    )
    *above, below = panels[:, 0]
    t = np.array([one.t for one in history])
    value, std = (np.array([getattr(one, name) for one in history]) for name in ("value", "std"))
    for axes, k in zip(above, shown):
        x = value[:, k]
        half = NORMAL_95 * std[:, k]
        axes.fill_between(t, x - half, x + half, alpha=0.25)
        axes.plot(t, x)
        # The axis shows the values, however wide the first bands are.
        known = np.isfinite(x)
        settled = known & (half <= 4 * np.median(half[known]))
        low = (x - half)[settled].min()
        high = (x + half)[settled].max()
        room = 0.15 * (high - low) + 1e-12
        axes.set_ylim(low - room, high + room)
        # A payload moves a parameter by so much more than its band that this would not be seen.
        narrow = axes.twinx()
        narrow.semilogy(t, half, color=plots.PLAIN, lw=0.9)
        narrow.set_ylabel("± 95 %")
        narrow.grid(False)
        axes.set_title(f"{last.names[k]}, {last.units[k]}")
    for joint, colour in zip(joints, joint_colours(joints)):
        below.semilogy(t, [one.torque_error.get(joint, np.nan) for one in history], color=colour)
    below.set(xlabel="time, s", ylabel="N m rms", xlim=(t[0], t[-1]))
    plots.put_legend(
        below,
        [
            (f"{x}: torque mispredicted over two seconds", c)
            for x, c in zip(joints, joint_colours(joints))
        ],
    )
    for event in history[-1].events:
        for axes in (*above, below):
            axes.axvline(event.t, color=plots.MUTED, lw=0.9, ls="--")
        above[0].annotate(f" {event.what}", (event.t, 0.85), xycoords=("data", "axes fraction"))
    return figure
