"""How still a camera stood as a figure: the line of sight over time, its cumulative spectrum, torque against limits."""

from __future__ import annotations

import numpy as np

from gimbal_pin.control.controllers import BASELINE, COMPILED, OURS
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.result import Pointing, Verified, split
from gimbal_pin.report import plots
from gimbal_pin.report.format import controller_name

COLOURS = {BASELINE: plots.PLAIN, OURS: "#1a75f2", COMPILED: "#d98200"}
CURVE_POINTS = 400
"""Points of a curve."""


def draw_camera_chart(found: Verified) -> plots.Figure:
    """Return diagrams of the first run of every controller."""
    figure, panels = plots.panels(2, 2, 6.0, gaps=(0.85, 0.75))
    grid = panels[0, 0].get_gridspec()
    for axes in panels[1]:
        axes.remove()
    runs = [row.runs[0] for row in found.rows]
    draw_line_of_sight(panels[0, 0], runs)
    draw_spectra(panels[0, 1], runs)
    draw_torques(figure.add_subplot(grid[1, :]), runs)
    plots.put_legend(panels[0, 0], [(controller_name(run.controller), COLOURS[run.controller]) for run in runs])
    plots.plain_powers(figure)
    return figure


def draw_line_of_sight(axes: plots.Axes, runs: list[Pointing]) -> None:
    """Draw the distance of the line of sight from its slow part, degrees: the largest of each stretch."""
    for run in runs:
        t, largest = find_envelope(run)
        axes.plot(t, largest, lw=1.0, color=COLOURS[run.controller])
    axes.set(xlabel="time, s", ylabel="line of sight off by, °", xlim=(t[0], t[-1]), ylim=(0, None))


def find_envelope(run: Pointing) -> tuple[Array, Array]:
    """Return the middle of each of `CURVE_POINTS` stretches, s, and the largest jitter in it, degrees."""
    fast, _ = split(run.sight, run.dt)
    size, t = np.degrees(np.hypot(*fast.T)), run.t[run.counted]
    edges = np.linspace(0, len(t), min(CURVE_POINTS, len(t)) + 1).astype(int)
    pairs = list(zip(edges[:-1].tolist(), edges[1:].tolist()))
    return np.array([t[a:b].mean() for a, b in pairs]), np.array([size[a:b].max() for a, b in pairs])


def draw_spectra(axes: plots.Axes, runs: list[Pointing]) -> None:
    """Draw jitter up to each frequency, degrees rms, both logarithmic: orders of magnitude apart."""
    for run in runs:
        f, rms = accumulate_jitter(run.sight, run.dt)
        some = np.unique(np.geomspace(1, len(f) - 1, CURVE_POINTS).astype(int))
        axes.loglog(f[some], np.degrees(rms[some]), color=COLOURS[run.controller])
    axes.set(xlabel="frequency, Hz", ylabel="jitter up to there, ° rms", xlim=(max(f[1], 0.1), f[-1]))
    # What is below a thousandth of the largest is the high-pass's own flank, not jitter.
    axes.set_ylim(bottom=max(axes.get_ylim()[0], 1e-3 * axes.get_ylim()[1]))


def accumulate_jitter(error: Array, dt: float) -> tuple[Array, Array]:
    """Return frequencies, Hz, and the rms of the jitter up to each of them, both axes together, rad."""
    fast, _ = split(error, dt)
    power = np.sum(np.abs(np.fft.rfft(fast, axis=0)) ** 2, axis=1)
    power[1:] *= 2
    power[-1] /= 2 if len(fast) % 2 == 0 else 1
    return np.fft.rfftfreq(len(fast), dt), np.sqrt(np.cumsum(power)) / len(fast)


def draw_torques(axes: plots.Axes, runs: list[Pointing]) -> None:
    """Draw each joint's torque as a share of its limit: rms as a bar, the largest as a whisker."""
    high = 0.8 / len(runs)
    for k, run in enumerate(runs):
        at = np.arange(len(run.joints)) + (k - (len(runs) - 1) / 2) * high
        share = 100 / run.tau_max * np.abs(run.tau[run.counted])
        axes.barh(at, np.sqrt(np.mean(share**2, axis=0)), 0.85 * high, color=COLOURS[run.controller])
        axes.hlines(at, 0, share.max(axis=0), color=COLOURS[run.controller], lw=1.4)
    axes.axvline(100, color="#b3261e", lw=1.2, ls=(0, (4, 3)))
    axes.set(xlabel="% of the limit", xlim=(0, 108))
    axes.set_yticks(range(len(runs[0].joints)), runs[0].joints)
    axes.invert_yaxis()
