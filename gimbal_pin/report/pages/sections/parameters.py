"""The identified parameters: value, uncertainty, and how much torque each of them moves."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.diagnosis.difference import Difference
from gimbal_pin.diagnosis.given import given as stated
from gimbal_pin.estimation.balance import balance
from gimbal_pin.estimation.identification import Identified
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.evaluation import Evaluated
from gimbal_pin.report.pages.html import Content, bar, bullets, folded, heading, join, paragraph, table
from gimbal_pin.report.pages.numbers import DASH, figures, interval, listed, torque_text, unit
from gimbal_pin.report.pages.sections.friction import friction
from gimbal_pin.report.pages.sections.known import Known, known
from gimbal_pin.rig.rig import Rig

LONGEST = 4
"""Terms of a regrouping that are shown before the rest folds away."""


def parameters(found: Identified, evaluated: Evaluated | None = None, given: Rig | None = None) -> Section:
    """Return base parameters and friction with 95 % intervals.

    With the torque that each moves on the rows in `evaluated`, and beside them what the rig as given states.
    """
    every = known(found, evaluated, given)
    rigid = every[: len(found.reduction.independent)]
    apart, told = None if given is None else stated(Difference.of_identified(given, found)), balance(found)
    parts = [paragraph(overall(found, every))]
    if evaluated is not None:
        parts.append(chart(every))
    parts += [
        heading("Base parameters"),
        paragraph("The combinations of masses, first moments and inertias that joint torques can show.", "side"),
        base_table(rigid, given is not None, evaluated is not None),
        *([] if apart is None else [paragraph(f"Against the URDF: {line}.") for line in apart.lines]),
        *([] if told is None else [heading("Balance"), bullets(told.sentences)]),
        heading("Friction and other effects"),
        *friction(found, every, evaluated),
    ]
    return Section("Parameters", join(parts), "What the log says of the rig, with 95 % intervals.")


def overall(found: Identified, every: Sequence[Known]) -> str:
    """Say how many there are, which are in doubt, and whether bodies exist that have them."""
    doubtful = [short(one.name) for one in every if one.tone == "poor"]
    doubt = f"the log leaves {listed(doubtful)} in doubt" if doubtful else "none of them in doubt by more than matters"
    condition = figures(found.estimate.condition_number, 2)
    method = f"{len(every)} parameters by the {found.estimate.method} estimator"
    text = f"{method}, {doubt}; condition number {condition} (columns of unit size)."
    if found.bias is not None:
        text = f"{text} {found.bias.sentence[0].upper()}{found.bias.sentence[1:]}."
    if found.physical:
        return f"{text} Bodies exist that have these parameters."
    change = torque_text(max(found.torque_change.values()))
    return (
        f"{text} No bodies exist that have exactly these. The nearest that do, {figures(found.consistent.distance, 2)} "
        f"standard deviations away, change the torque by at most {change} rms; they go back into the URDF."
    )


def base_table(rigid: Sequence[Known], given: bool, reach: bool) -> Markup:
    """Return the base parameters' table."""
    head = ["Base parameter", "Unit", "Value", "95 % interval", "Relative deviation"]
    head += ["URDF"] * given + ["Moves, N m rms"] * reach
    most = max((one.moved for one in rigid), default=0.0)
    return table(head, [base_row(one, given, reach, most) for one in rigid], texts=2, label="Base parameters")


def base_row(one: Known, given: bool, reach: bool, most: float) -> list[Content]:
    """Return a base parameter's row."""
    value, half = interval(one.value, one.half)
    row: list[Content] = [expression(one.name), unit(one.unit), value, half, one.deviation]
    if given:
        row.append(DASH if one.given is None else figures(one.given, 4))
    if reach:
        row.append(bar(one.moved / most if most else 0.0, figures(one.moved, 2)))
    return row


def terms(name: str) -> list[str]:
    """Return a regrouping's terms, each with its sign but for a first plus: ``a``, ``− b``, ``+ 0.12·c``."""
    pieces = re.split(r" (?=[+-] )", name.replace("*", "·"))
    return [piece.replace("-", "−", 1) if piece.startswith("-") else piece for piece in pieces]


def expression(name: str) -> Markup:
    """Return a regrouping; the terms after the first few fold away."""
    spans = [Markup("<span>{}</span>").format(piece) for piece in terms(name)]
    if len(spans) <= LONGEST + 1:
        return Markup("<code>{}</code>").format(Markup(" ").join(spans))
    first = Markup("<code>{}</code> … {} more").format(Markup(" ").join(spans[:LONGEST]), len(spans) - LONGEST)
    return folded(first, Markup("<code>{}</code>").format(Markup(" ").join(spans[LONGEST:])))


def short(name: str) -> str:
    """Return a regrouping's first term, with an ellipsis if there are more."""
    first, *others = terms(name)
    return f"{first} + …" if others else first


def chart(every: Sequence[Known]) -> Markup:
    """Return the parameters' importance and uncertainty on one scale."""
    caption = (
        "How much torque each parameter moves (dot; hollow where it is negative), and how much of that is "
        "uncertain (95 % whiskers): far right matters, short whiskers are known, at the left edge is zero."
    )
    alt = f"Dot-and-whisker plot of {len(every)} parameters, scaled by the torque they move"
    return plots.picture(partial(whiskers, every), alt, caption)


def whiskers(every: Sequence[Known]) -> plots.Figure:
    """Draw dots with whiskers, in the torque that each parameter moves."""
    names = [short(one.name) for one in every]
    figure, panels = plots.panels(1, 1, 1.0 + 0.2 * len(every), left=0.35 + 0.07 * max(len(name) for name in names))
    axes = panels[0, 0]
    moved = np.array([one.moved for one in every])
    half = np.array([one.half * (one.reach or 0.0) for one in every])
    left = 0.5 * max(float(np.min(np.where(moved > half, moved - half, moved))), 1e-6 * float(moved.max()))
    for row, (one, value, width) in enumerate(zip(every, moved.tolist(), half.tolist())):
        axes.plot([max(value - width, left), value + width], [row, row], color=one.colour, lw=2.2, alpha=0.55)
        inside = plots.PAPER if one.value < 0 else one.colour
        axes.plot(max(value, left), row, "o", ms=5.5, mec=one.colour, mfc=inside, mew=1.5)
    axes.set_yticks(range(len(every)), names, fontsize=8.5)
    axes.set(xscale="log", xlim=(left, None), ylim=(len(every) - 0.4, -0.6), xlabel="torque moved, N m rms")
    axes.tick_params(length=0)
    return figure
