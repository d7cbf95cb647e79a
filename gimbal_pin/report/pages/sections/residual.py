"""What a model leaves of the torque: over the rate, and as a histogram."""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.log.log import Array
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.evaluation import Evaluated
from gimbal_pin.report.pages.joints import Joint
from gimbal_pin.report.pages.numbers import torque_unit

BINS = 12
"""Stretches of the rate, either way and alike in samples, over which the residual's mean is taken."""
JUDGED = 0.5
"""Share of a row's samples that must be judged for the row to count."""
CLOUD = 900
"""Most dots in a cloud."""


def leftovers(joints: tuple[Joint, ...], evaluated: Evaluated) -> Markup:
    """Return the residual over rate and as a histogram."""
    alt = f"Residual torque of {', '.join(evaluated.joints)} over rate, and its histogram"
    caption = (
        "Residual over the joint's rate, where it is judged, and its mean with the error of the mean: flat is noise, a "
        "bend is what the model does not know. Below, its distribution against a normal one of the same size."
    )
    return plots.picture(partial(clouds, joints, evaluated), alt, caption)


def clouds(joints: tuple[Joint, ...], evaluated: Evaluated) -> plots.Figure:
    """Draw residuals over rates, and their histograms below."""
    figure, panels = plots.panels(2, len(joints), 4.8, ratios=[1.5, 1], gaps=(0.75, 0.6))
    v, error, share = (evaluated.stacked(name) for name in ("v", "error", "share"))
    scale, unit = torque_unit(float(np.abs(error).max()))
    for j, joint in enumerate(joints):
        rows = np.flatnonzero(share[:, j] > JUDGED)
        whole = scale * error[rows, j] / share[rows, j]
        panels[0, j].set_title(joint.name, color=joint.colour)
        if len(rows):
            over_rate(panels[0, j], joint, v[rows, j], whole)
            histogram(panels[1, j], joint, whole)
        panels[0, j].set_xlabel(f"rate, {joint.unit}/s")
        panels[1, j].set_xlabel(f"residual, {unit}")
    panels[0, 0].set_ylabel(f"residual, {unit}")
    panels[1, 0].set_ylabel("density")
    return figure


def over_rate(axes: plots.Axes, joint: Joint, v: Array, error: Array) -> None:
    """Draw a joint's residual over its rate, and its mean in stretches of the rate, with twice its error."""
    every = max(1, len(v) // CLOUD)
    plots.dots(axes, joint.scale * v[::every], error[::every], joint.colour)
    order = np.argsort(v)
    for way in (order[v[order] < 0], order[v[order] > 0]):
        groups = np.array_split(way, min(BINS, max(1, len(way) // 6)))
        groups = [group for group in groups if len(group) > 1]
        middle = joint.scale * np.array([v[group].mean() for group in groups])
        mean = np.array([error[group].mean() for group in groups])
        sure = np.array([error[group].std() / np.sqrt(len(group)) for group in groups])
        axes.fill_between(middle, mean - 2 * sure, mean + 2 * sure, color=plots.INK, alpha=0.18)
        axes.plot(middle, mean, color=plots.INK, lw=1.3)
    plots.zero_line(axes)


def histogram(axes: plots.Axes, joint: Joint, error: Array) -> None:
    """Draw a joint's residuals as a histogram, and the normal distribution of the same mean and size."""
    axes.hist(error, bins=int(np.clip(1.5 * len(error) ** 0.5, 8, 40)), density=True, color=joint.colour, alpha=0.45)
    mean, std = float(error.mean()), float(error.std())
    if std > 0:
        x = np.linspace(mean - 4 * std, mean + 4 * std, 120)
        axes.plot(x, np.exp(-(((x - mean) / std) ** 2) / 2) / (std * np.sqrt(2 * np.pi)), color=plots.INK, lw=1.0)
    axes.set_yticks([])
