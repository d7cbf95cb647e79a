"""What else a finding could have been: competing causes with their scores, and the map of look-alikes."""

from __future__ import annotations

from functools import partial

from markupsafe import Markup

from gimbal_pin.diagnosis import Finding
from gimbal_pin.diagnosis.likeness import Likeness
from gimbal_pin.report import plots
from gimbal_pin.report.html import Content, bar, folded, table, toned
from gimbal_pin.report.numbers import figures

APART, SURE = 2.0, 20.0
"""Vuong's z from which two causes are told apart, and at which the bar is full."""
MOST = 6
"""Most rivals in a table."""
ALIKE = 0.95
"""Correlation from which on two causes are one to this log."""
HEAD: list[Content] = ["Instead of it", "Log-likelihood lost", "z", "This log tells them apart"]


def rivals(finding: Finding) -> list[Markup]:
    """Return the table of the causes that were refitted in a finding's place."""
    rows: list[list[Content | None]] = []
    for rival in finding.rivals[:MOST]:
        apart = rival.cause not in finding.alike
        told = toned("yes", "good") if apart else toned("no", "fair")
        rows.append([rival.cause, figures(rival.delta), bar(rival.z / SURE, f"{rival.z:.1f}"), told])
    label = f"Causes that were fitted in the place of {finding.cause}"
    return [table(HEAD, rows, label=label)] if rows else []


def alike_map(known: Likeness, colour: str) -> list[Markup]:
    """Return the map of a finding's look-alikes, folded away; nothing where there is no other."""
    if len(known.causes) < 2:
        return []
    where = known.joint or "the rig"
    alt = f"Correlation of what the causes like {known.causes[0]} at {where} can explain on this log"
    caption = (
        f"How alike causes at {where} are on this log, each in the form most like the finding: at 1 it cannot part "
        f"two, from {ALIKE} on they are outlined and share one name."
    )
    drawn = plots.picture(partial(cells, known, colour), alt, caption)
    return [folded(f"What looks like {known.causes[0]} here", drawn)]


def cells(known: Likeness, colour: str) -> plots.Figure:
    """Draw the map: the finding in the first row, the darker the more alike."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    count = len(known.causes)
    height = 0.34 * count + 0.15
    figure = Figure(figsize=(plots.WIDTH, height))
    axes = figure.add_axes((2.3 / plots.WIDTH, 0.1 / height, 0.72 * count / plots.WIDTH, 1 - 0.15 / height))
    for i, row in enumerate(known.correlation.tolist()):
        for k, value in enumerate(row[: i + 1]):
            place = (k - 0.48, i - 0.46)
            axes.add_patch(Rectangle(place, 0.96, 0.92, facecolor=colour, alpha=0.08 + 0.72 * value**2))
            if value >= ALIKE and i != k:
                axes.add_patch(Rectangle(place, 0.96, 0.92, fill=False, edgecolor=plots.INK, linewidth=1.4))
            axes.text(k, i, "1" if i == k else f"{value:.2f}", ha="center", va="center", fontsize=8.5)
    axes.set(
        xlim=(-0.5, count - 0.5), ylim=(count - 0.5, -0.5), yticks=range(count), yticklabels=known.causes, xticks=[]
    )
    for k, name in enumerate(known.causes[:-1]):
        axes.text(k + 0.62, k, name, va="center", fontsize=8.5, color=plots.MUTED)
    axes.grid(False)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    return figure
