"""Estimates with their bands over time, as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.errors import NORMAL_95, DataError
from gimbal_pin.identification import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN_PARAMETERS = 5
"""Parameters that are drawn, those first that move the most torque."""


def draw_progress_chart(history: Sequence[Progress]) -> Figure:
    """Return the most telling parameters with their 95 % intervals, the torque error, and every event.

    Raises:
        DataError: Nothing was known at any time.
    """
    from matplotlib.figure import Figure

    complete = [one for one in history if not one.hidden]
    if not complete:
        raise DataError("plot", "would show nothing: the log has not shown every parameter", "go on recording")
    shown = complete[-1].telling[:DRAWN_PARAMETERS]
    figure = Figure(figsize=(10, 1.7 * (len(shown) + 1)), layout="constrained")
    *panels, last = figure.subplots(len(shown) + 1, 1, sharex=True)
    t = np.array([one.t for one in history])
    value, std = (np.array([getattr(one, name) for one in history]) for name in ("value", "std"))
    for axes, k in zip(panels, shown):
        x, half = value[:, k], NORMAL_95 * std[:, k]
        axes.fill_between(t, x - half, x + half, alpha=0.25, lw=0)
        axes.plot(t, x, lw=1.2)
        # The axis shows the values, however wide the first bands are.
        known = np.isfinite(x)
        settled = known & (half <= 4 * np.median(half[known]))
        low, high = (x - half)[settled].min(), (x + half)[settled].max()
        room = 0.15 * (high - low) + 1e-12
        axes.set_ylim(low - room, high + room)
        axes.grid(alpha=0.3)
        # A payload moves a parameter by so much more than its band that this would not be seen.
        narrow = axes.twinx()
        narrow.semilogy(t, half, color="tab:gray", lw=0.9)
        narrow.set_ylabel("± 95 %", color="tab:gray", fontsize="small")
        narrow.tick_params(which="both", colors="tab:gray", labelsize="small")
        axes.set_title(f"{complete[-1].names[k]}, {complete[-1].units[k]}", loc="left", fontsize="medium")
    for joint in complete[-1].torque_error:
        last.semilogy(t, [one.torque_error.get(joint, np.nan) for one in history], label=joint)
    last.set(xlabel="time, s")
    last.set_title("torque mispredicted over two seconds, N m rms", loc="left", fontsize="medium")
    if complete[-1].torque_error:
        last.legend(loc="upper left", fontsize="small")
    for event in history[-1].events:
        for axes in (*panels, last):
            axes.axvline(event.t, color="tab:red" if event.what == "changed" else "tab:green", lw=0.9, ls="--")
        panels[0].annotate(f" {event.what}", (event.t, 0.85), xycoords=("data", "axes fraction"), fontsize="small")
    return figure
