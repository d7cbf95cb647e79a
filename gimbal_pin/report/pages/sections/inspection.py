"""What a log's file holds: every channel over time, what it is, and the mapping that is proposed."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from markupsafe import Markup

from gimbal_pin.log.io.inspection import Inspected, summary
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import bullets, heading, join, table
from gimbal_pin.report.pages.joints import PALETTE
from gimbal_pin.report.pages.numbers import figures
from gimbal_pin.report.pages.svg import style

HEIGHT = 1.6
"""Height of a panel, in."""
SHOWN = 8
"""Most curves in a panel: so many colours are told apart."""


def inspection(found: Inspected) -> Section:
    """Return the picture of a file's channels, their table, and the mapping."""
    parts = [bullets([line for stream in found.streams for line in summary(stream)] + list(found.notes))]
    parts.append(plots.picture(partial(channels, found), f"Every channel of {found.name} over time", "As recorded."))
    rows = [
        [c.column, c.kind, c.joint or "", c.unit, "; ".join(c.reasons), figures(c.low), figures(c.high),
         figures(c.step) if c.step else None]
        for stream in found.streams for c in stream.channels
    ]  # fmt: skip
    heads = ["Column", "Is", "Of", "In", "Because", "From", "To", "Step"]
    parts.append(table(heads, rows, texts=5, label="Channels"))
    if found.rig is not None:
        parts += [heading(f"Mapping for {found.rig}"), Markup("<pre>{}</pre>").format(found.yaml)]
    return Section(Path(found.name).name, join(parts))


def channels(found: Inspected) -> plots.Figure:
    """Return a figure with one panel per stream and kind of channel, constants left out."""
    panels = [
        (stream, kind, [c for c in stream.channels if c.kind == kind][:SHOWN])
        for stream in found.streams
        for kind in dict.fromkeys(c.kind for c in stream.channels if c.kind not in ("time", "constant", "copy"))
    ]
    figure, axes = plots.panels(max(len(panels), 1), 1, 0.9 + HEIGHT * max(len(panels), 1), gaps=(0.75, 0.5))
    for row, (stream, kind, several) in zip(axes[:, 0], panels):
        for channel, colour in zip(several, PALETTE):
            plots.curve(row, stream.t - stream.t[0], stream.data[channel.column], color=colour, lw=1.0)
        plots.named(row, [(channel.column, colour) for channel, colour in zip(several, PALETTE)])
        units = dict.fromkeys(channel.unit for channel in several)
        row.set_ylabel(f"{kind}, {'/'.join(units)}" if any(units) else kind)
    axes[-1, 0].set_xlabel("time, s")
    return figure


def draw(found: Inspected, path: Path) -> None:
    """Write the picture alone, in the format of the suffix; PNG where there is none."""
    with style():
        figure = channels(found)
        for axes in figure.axes:
            axes.grid(color="#dde1e6")
        figure.savefig(path, format=path.suffix[1:].lower() or "png", facecolor="white", dpi=150)
