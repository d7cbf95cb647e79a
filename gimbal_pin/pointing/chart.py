"""A contest as a figure: the line of sight over time, its cumulative spectrum, torque against limits, the budget."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.pointing.contest import Contest
from gimbal_pin.pointing.measures import cumulative, split
from gimbal_pin.pointing.roster import BASELINE, ORACLE, OURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def chart(found: Contest) -> Figure:
    """Return four diagrams of the first seed: PID, ours and the oracle; the budget is that of all seeds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7), layout="constrained")
    sight, spectrum, torque, bar = figure.subplots(2, 2).flat
    shown = [row for row in found.rows if row.controller in (BASELINE, OURS, ORACLE)] or list(found.rows[:3])
    for row in shown:
        run = row.runs[0]
        fast, _ = split(run.sight, run.dt)
        sight.plot(run.t[run.counted], np.degrees(np.hypot(*fast.T)), lw=0.6, label=row.controller)
        f, rms = cumulative(run.sight, run.dt)
        spectrum.semilogx(f[1:], np.degrees(rms[1:]), label=row.controller)
        share = np.quantile(np.abs(run.tau[run.counted]) / run.tau_max, 0.99, axis=0)
        torque.plot(run.joints, 100 * share, "o", label=row.controller)
    sight.set(title="Line of sight, above 0.2 Hz", xlabel="s", ylabel="degrees", yscale="log", ylim=(1e-5, None))
    spectrum.set(title="Cumulative spectrum", xlabel="Hz", ylabel="degrees rms up to there")
    torque.set(title="Torque, 99 % of the time below", ylabel="% of the limit", ylim=(0, 105))
    sight.legend(loc="upper right")
    budgeted(bar, found)
    return figure


def budgeted(axes: Axes, found: Contest) -> None:
    """Draw the error budget as one bar."""
    parted, left = found.budget, 0.0
    axes.set(title="Error budget of the world-frame PID", xlabel="% of its mean square", yticks=[])
    if parted is None:
        return
    for what, part in parted.parts.items():
        width = 100 * max(part, 0.0)
        axes.barh(0, width, left=left, label=f"{what} {100 * part:.1f} %")
        left += width
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, -0.02), ncols=2, fontsize="small")
    axes.set_ylim(-2.5, 0.6)
