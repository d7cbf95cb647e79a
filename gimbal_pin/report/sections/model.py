"""The identified model: its parameters, the torque that it predicts, and what that leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import partial
from itertools import product
from math import degrees, isnan
from typing import Any

import numpy as np
from markupsafe import Markup

from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Cause, Sample
from gimbal_pin.errors import NORMAL_95, digits
from gimbal_pin.identification import IdentificationResult, PayloadStatement, Several
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array
from gimbal_pin.report import plots, tables
from gimbal_pin.report.charts import Chart, Charts, Trace, list_abscissae
from gimbal_pin.report.elements import (
    Element,
    Folded,
    Section,
    Table,
    bullets,
    folded,
    heading,
    list_warnings,
    paragraph,
)
from gimbal_pin.report.evaluation import (
    Evaluated,
    EvaluatedPart,
    KnownParameter,
    find_tables,
    find_worst,
    known,
    list_shown,
)
from gimbal_pin.report.format import (
    DASH,
    ShownJoint,
    figures,
    file_name,
    forces,
    interval,
    list_altered,
    list_shown_joints,
    listed,
    rows_named,
    to_sentence,
    torque_text,
    torque_unit,
)

STILL_JOINT_RATE = 2.0
"""Rate up to which friction is drawn of a joint that does not move, rad/s."""
LONGEST_DRAWN = 15.0
"""Longest stretch drawn in full, s."""
BETWEEN = 4
"""Pieces that a curve is drawn in from row to row."""
RATE_BINS = 12
"""Stretches of the rate, either way and alike in samples, over which the residual's mean is taken."""
JUDGED_SHARE = 0.5
"""Share of a row's samples that must be judged for the row to count."""
MOST_DOTS = 900
"""Most dots in a cloud."""
LOOSE = 0.1
"""Standard deviation, in shares of a parameter, beyond which the log is said to leave it open."""


def show_parameters(
    found: IdentificationResult,
    payload: PayloadStatement | None,
    evaluated: Evaluated | None = None,
) -> Section:
    """Return warnings, base parameters and friction with 95 % intervals, the nearest bodies, and the payload's place.

    `payload`: None where another section has it. `evaluated`: the rows that the model is judged by; None: nothing is
    drawn, and no torque told that a parameter moves.
    """
    parts: list[object] = [
        *list_warnings(found.warnings),
        *list_parameter_parts(found, evaluated),
        *(show_payload(payload) if payload is not None else []),
        *list_notes(found),
    ]
    return Section("Parameters", parts, "What the log says of the rig, with 95 % intervals.")


def show_model(found: Model) -> Section:
    """Return what a model has beside its rig's bodies, and what of it does not hold elsewhere."""
    causes: list[tuple[Cause, tuple[float, ...]]] = [
        (term.effect, term.values) for term in found.terms
    ]
    causes += [(cause, ()) for cause in (*found.drive, *found.changes)]
    rows = [
        [
            cause.place,
            cause.name,
            ", ".join(describe_form(cause)) or DASH,
            ", ".join(map(figures, values)) or DASH,
        ]
        for cause, values in causes
    ]
    known = "as the URDF states it" if found.estimated is None else "as identified"
    parts = [
        *list_warnings([str(doubt) for doubt in found.doubts]),
        paragraph(f"The rig's bodies are {known}."),
    ]
    return Section(
        "Model",
        [*parts, Table(["At", "Cause", "Form", "Coefficients"], rows, texts=4, label="Causes")],
    )


def describe_form(cause: Cause) -> list[str]:
    """Return what else than its place a cause is made with: names and numbers."""
    own = ((one.name, getattr(cause, one.name)) for one in fields(cause))
    return [f"{name} {figures(value, 4)}" for name, value in own if isinstance(value, int | float)]


def show_cameras(found: Several) -> Section:
    """Return what is wrong; every camera's own parameters, accuracy and balance; then the gimbal's."""
    parts: list[object] = [*list_warnings(found.warnings)]
    for name, camera in found.cameras.items():
        parts += [
            heading(name),
            tables.tabulate_camera(camera),
            tables.torque_errors(found.identified[name]),
        ]
        parts += show_payload(found.payloads[name])
    parts += [
        heading(f"The gimbal, with {found.first.model.rig.payload}"),
        paragraph(found.sentence),
    ]
    return Section(
        "Cameras", [*parts, *list_parameter_parts(found.first), *list_notes(found.first)]
    )


def list_notes(found: IdentificationResult) -> list[Folded]:
    """Return what of the logs was not used or was altered, how IMUs sit, and when torques act."""
    notes = [
        *found.notes,
        *list_altered(found.altered),
        *list_mountings(found),
        *describe_lags(found.model),
    ]
    return [folded("Notes", bullets(notes), is_detail=False)] if notes else []


def list_parameter_parts(
    found: IdentificationResult, evaluated: Evaluated | None = None
) -> list[object]:
    """Return base parameters, friction and bodies as parts of a section; on a page the long tables are folded."""
    rows = known(found, evaluated)
    width = len(found.reduction.independent)
    agreement = found.agreement
    every = [rows[k] for k in list_shown(found)]
    force = forces(list_shown_joints(found.model.rig))
    bound = None if found.bound is None else found.bound[list_shown(found)].tolist()
    base, effects = "Base parameters", "Friction and other effects"
    combined = "The combinations of masses, first moments and inertias that joint torques can show"
    trust = f"± 95 %, the URDF's bodies trusted to {100 * found.trust:.3g} % (--trust). *: the log hardly shows it, it"
    parts = [
        paragraph(describe_estimate(found, every)),
        *(
            []
            if evaluated is None
            else [folded("What each of them moves", picture_moved(every, force))]
        ),
        folded(
            base,
            paragraph(f"{combined}; {tables.AWAY}.", "side"),
            tables.parameters(every[:width], bound and bound[:width], base, force),
            is_detail=False,
        ),
        heading(effects),
        tables.parameters(every[width:], bound and bound[width:], effects, force),
    ]
    for line, place in zip(tables.list_tables(found), find_tables(found).values()):
        values = tables.parameters([rows[k] for k in place], None, line, force)
        parts.append(
            Element(
                Markup(folded(line, values).__html__()),
                f"{line}; all of them in the model's file and --json",
            )
        )
    parts += (
        []
        if evaluated is None
        else [folded("Friction over the rate", picture_effects(found, evaluated))]
    )
    parts += describe_bound(found)
    parts += [] if agreement is None else [paragraph(f"{agreement.sentence}.")]
    parts += (
        []
        if agreement is None or not agreement.drifting
        else [tables.drifting_parameters(agreement)]
    )
    bodies = (
        tables.tabulate_bodies(found.bodies),
        paragraph(f"{trust} stays near the URDF's.", "side"),
    )
    return [*parts, folded("The nearest bodies", *bodies, is_detail=False)]


def show_payload(payload: PayloadStatement, *more: Element) -> list[Folded]:
    """Where the payload sits and what it weighs against the given model, and how to balance it; then `more` of that."""
    lines = (*payload.lines, *payload.advice)
    return (
        [folded("The payload against its URDF (± 95 %)", bullets(lines), *more, is_detail=False)]
        if lines
        else []
    )


def picture_moved(every: Sequence[KnownParameter], force: str) -> plots.Drawing:
    """Return the parameters in the torque that each moves, as dots with whiskers."""

    def draw() -> plots.Figure:
        names = [short(one.name) for one in every]
        left = 0.35 + 0.07 * max(len(name) for name in names)
        figure, panels = plots.panels(1, 1, 1.0 + 0.17 * len(every), left=left)
        axes = panels[0, 0]
        moved = np.array([one.moved for one in every])
        half = np.array([one.half * (one.reach or 0.0) for one in every])
        least = 0.5 * max(
            float(np.min(np.where(moved > half, moved - half, moved))), 1e-6 * float(moved.max())
        )
        for row, (one, value, width) in enumerate(zip(every, moved.tolist(), half.tolist())):
            ends = [max(value - width, least), value + width]
            axes.plot(ends, [row, row], color=one.colour, lw=2.2, alpha=0.55)
            inside = plots.PAPER if one.value < 0 else one.colour
            axes.plot(max(value, least), row, "o", ms=5.5, mec=one.colour, mfc=inside, mew=1.5)
        axes.set_yticks(range(len(every)), names, fontsize=8.5)
        axes.set(
            xscale="log",
            xlim=(least, None),
            ylim=(len(every) - 0.4, -0.6),
            xlabel=f"torque moved, {force} rms",
        )
        axes.tick_params(length=0)
        return figure

    caption = (
        "How much torque each parameter moves (dot; hollow where it is negative), and how much of that is "
        "uncertain (95 % whiskers): far right matters, short whiskers are known, at the left edge is zero."
    )
    alt = f"Dot-and-whisker plot of {len(every)} parameters, scaled by the torque they move"
    return plots.Drawing(draw, alt, caption)


def picture_effects(found: IdentificationResult, evaluated: Evaluated) -> plots.Drawing:
    """Return every joint's effects over its rate, ``A theta``, with its 95 % band."""
    joints = list_shown_joints(found.model.rig)
    every = [term for term in found.model.terms for _ in term.values]
    first = len(found.reduction.independent)

    def make() -> Charts:
        row = list[Chart]()
        for j, joint in enumerate(joints):
            reach = 1.05 * float(np.abs(evaluated.stacked("v")[:, j]).max()) or STILL_JOINT_RATE
            v = np.concatenate([np.linspace(-reach, 0, 100), np.linspace(0, reach, 100)])
            zero = np.zeros_like(v)
            slide = np.repeat([-1.0, 1.0], 100)
            at = Sample(zero, zero, v, zero, slide, zero)
            own = dict.fromkeys(term.effect for term in every if term.effect.joint == joint.name)
            A = np.column_stack([column + zero for effect in own for column in effect.basis(at)])
            places = [first + k for k, term in enumerate(every) if term.effect.joint == joint.name]
            torque = A @ found.estimate.theta[places]
            covariance = found.estimate.covariance[np.ix_(places, places)]
            variance = np.einsum("mk,kl,ml->m", A, covariance, A)
            half = NORMAL_95 * np.sqrt(np.maximum(variance, 0.0))
            curves = [Trace("torque", torque, joint.colour, half=half)]
            over = f"rate, {joint.unit}/s"
            row.append(
                Chart(
                    joint.name,
                    joint.colour,
                    f"torque, {joint.force}",
                    joint.scale * v,
                    curves,
                    {},
                    over,
                )
            )
        return Charts("friction", [row])

    alt = f"Friction torque over rate of {', '.join(found.model.rig.joints)}"
    caption = (
        "Torque of all effects over the joint's rate: where the 95 % band is wide, it is guessed."
    )
    return plots.Drawing(lambda: make().draw(), alt, caption, charts=make)


def describe_estimate(found: IdentificationResult, every: Sequence[KnownParameter]) -> str:
    """Say how many parameters there are, which are in doubt, and whether bodies exist that have them."""
    doubtful = [short(one.name) for one in every if one.tone == "poor" and one.reach]
    doubt = (
        f"; of those that move much torque, the log leaves {listed(doubtful)} in doubt"
        if doubtful
        else ""
    )
    condition = figures(found.estimate.condition_number, 2)
    method = f"{len(found.names)} parameters by {found.estimate.method}, deviations by {found.estimate.uncertainty}"
    text = f"{method}{doubt}; condition number {condition} (columns of unit size)."
    text += (
        ""
        if found.estimate.std.all()
        else f" {DASH}: not estimated here, but taken as it was known."
    )
    if found.bias is not None and not found.is_of_two_rigs:
        text = f"{text} {to_sentence(found.bias.sentence)}"
    if found.physical:
        return f"{text} Bodies exist that have these parameters."
    change = torque_text(
        max(found.torque_change.values()), force=forces(list_shown_joints(found.model.rig))
    )
    return (
        f"{text} No bodies exist that have exactly these. The nearest that do, {figures(found.consistent.distance, 2)} "
        f"standard deviations away, change the torque by at most {change} rms; they go back into the URDF."
    )


def describe_bound(found: IdentificationResult) -> list[Element]:
    """Say what the log itself leaves open, whoever estimates: Cramér and Rao's bound beside each interval."""
    if found.bound is None:
        return []
    text = "± at best: of any unbiased estimate from these rows (Cramér and Rao, by the residual's colour up to 16 Hz)."
    rows = zip(found.names, found.estimate.theta.tolist(), found.bound.tolist())
    if loose := [short(name) for name, value, std in rows if std > LOOSE * abs(value)]:
        text += f" No closer than to ± {digits(100 * NORMAL_95 * LOOSE, 2)} %, for they are small: {', '.join(loose)}."
    return [paragraph(text, "side")]


def describe_lags(found: Model) -> list[str]:
    """Say when each joint's torque acts, in one line; nothing where that was stated."""
    each = [
        f"{joint} {' '.join(interval(1e3 * lag, 1e3 * NORMAL_95 * std))} ms"
        for joint, (lag, std) in found.lags.items()
    ]
    said = f"delay between a torque's time stamp and its effect, hold included (± 95 %): {', '.join(each)}"
    return (
        [f"{said}; tune takes the latest of them, less half a sample for the hold"] if each else []
    )


def list_mountings(found: IdentificationResult) -> list[str]:
    """Say how IMUs sit on their links, in degrees."""
    lines = []
    for log, links in found.mountings.items():
        for link, how in links.items():
            turn, bias = (
                f"{digits(np.degrees(np.linalg.norm(x)))}°" for x in (how.misalignment, how.bias)
            )
            after = f", its gyro then differs from the encoders by {digits(degrees(how.after), 2)}°/s rms"
            gap = "" if isnan(how.after) else after
            lines.append(
                f"{log}: IMU of {link} is turned by {turn}, its gyro's bias is {bias}/s{gap}"
            )
    return lines


def short(name: str) -> str:
    """Return a regrouping's first term, with an ellipsis if there are more."""
    first, *others = name.replace("*", "·").replace(" - ", " + ").split(" + ")
    return f"{first.replace('-', '−')} + …" if others else first.replace("-", "−")


def show_torque(found: IdentificationResult, evaluated: Evaluated | None = None) -> Section:
    """Return the fit's figures, and where rows are given the torques and the residual, over time and rate."""
    where = (
        f"on {rows_named(found.held_out.how)}, which the fit did not see"
        if found.held_out
        else "on its own rows"
    )
    filtered = (
        f"Everything below is filtered at {found.filtering.cutoff:g} Hz, measured and predicted alike. A joint is "
        "judged where it moves: near standstill dry friction bears any torque, and motion does not tell which."
    )
    parts: list[object] = [paragraph(filtered, "side"), tables.torque_errors(found, evaluated)]
    if evaluated is not None:
        joints = list_shown_joints(found.model.rig)
        names = ", ".join(evaluated.joints)
        window, whole = worst(evaluated)
        caption = (
            f"Filtered torque {where}: measured (grey), predicted (colour), and the residual, which ends (on paper: is "
            "shaded) where the joint is so slow that dry friction may have any direction: there it is not judged. "
            f"{file_name(window.log)}, {window.t[0]:.4g} to {window.t[-1]:.4g} s: "
            f"{'the stretch with the largest error' if whole else 'all of it'}."
        )
        left = (
            "Residual over the joint's rate, where it is judged, and its mean with the error of the mean: flat is "
            "noise, a bend is what the model lacks. Below, its distribution against a normal one of the same "
            "size."
        )
        alt = f"Measured and predicted torque and residual of {names} over time"
        over_rates = f"Residual torque of {names} over rate, and its histogram"
        charts = partial(chart_torques, joints, window)
        parts.append(plots.Drawing(partial(overlays, joints, window), alt, caption, charts=charts))
        parts.append(
            folded(
                "Residual over the rate, and its distribution",
                plots.Drawing(partial(clouds, joints, evaluated), over_rates, left),
            )
        )
    return Section("Torque", parts, f"Measured against predicted, {where}.")


def worst(evaluated: Evaluated) -> tuple[EvaluatedPart, bool]:
    """Return the stretch of `LONGEST_DRAWN` s whose error, as a share of torque, is largest, and if there is more."""
    best: tuple[float, EvaluatedPart] | None = None
    for part in evaluated.parts:
        score, rows = find_worst(
            part.t, np.sum((part.error / evaluated.scale) ** 2, axis=1), LONGEST_DRAWN
        )
        if best is None or score > best[0]:
            best = score, part.cut(rows)
    assert best is not None  # an evaluation has at least one part
    return best[1], len(evaluated.parts) > 1 or len(best[1].t) < len(evaluated.parts[0].t)


def smooth_curve(t: Array, values: Array) -> tuple[Array, Array]:
    """Return a curve through the rows, which are as far apart as the filter allows, without corners.

    After each gap it is nan, so that no line is drawn across.
    """
    if len(t) < 3:
        return t, values
    steps = np.diff(t)
    fine = np.interp(np.arange((len(t) - 1) * BETWEEN + 1) / BETWEEN, np.arange(len(t)), t)
    smooth = signals.resample(t, values[:, None], fine)[:, 0]
    smooth[1:][np.repeat((steps > 2.5 * np.median(steps)) | np.isnan(values[1:]), BETWEEN)] = np.nan
    return fine, smooth


def overlays(joints: tuple[ShownJoint, ...], part: EvaluatedPart) -> plots.Figure:
    """Draw each joint's torques, and its residual below."""
    count = len(joints)
    ratios = [0.35, 3, 1.7] * len(joints)
    looks: Any = dict(ratios=ratios, gaps=(0, 0.1), share=(True, False), left=1.05)
    figure, grid = plots.panels(3 * count, 1, 0.6 + 1.75 * count, **looks)
    panels = grid[:, 0]
    for j, joint in enumerate(joints):
        room, above, below = panels[3 * j : 3 * j + 3]
        room.remove()  # the legend's place
        scale, unit = torque_unit(float(np.abs(part.error[:, j]).max()), joint.force)
        drawn = (
            (above, part.measured, plots.PLAIN, 4.0),
            (above, part.predicted, joint.colour, 1.3),
        )
        left = np.where(part.share < JUDGED_SHARE, np.nan, scale * part.error)
        for axes, values, colour, width in (*drawn, (below, left, joint.colour, 1.0)):
            plots.curve(
                axes,
                *smooth_curve(part.t, values[:, j]),
                color=colour,
                lw=width,
                alpha=0.6 if width > 2 else 1.0,
            )
        edges = np.flatnonzero(np.diff(np.pad(part.share[:, j] < JUDGED_SHARE, 1).astype(int)))
        for axes, (start, end) in product((above, below), edges.reshape(-1, 2).tolist()):
            stretch = part.t[max(start - 1, 0)], part.t[min(end, len(part.t) - 1)]
            axes.axvspan(*stretch, color=plots.MUTED, alpha=0.13, zorder=0)  # near standstill
        plots.zero_line(below)
        plots.put_legend(
            above, [(f"{joint.name}: measured", plots.PLAIN), ("predicted", joint.colour)]
        )
        above.set(ylabel=f"torque, {joint.force}")
        below.set(ylabel=f"residual,\n{unit}")
    panels[-1].set(xlabel="time, s", xlim=(part.t[0], part.t[-1]))
    figure.align_ylabels()
    return figure


def chart_torques(joints: tuple[ShownJoint, ...], part: EvaluatedPart) -> Charts:
    """Return each joint's torques, and beside them its residual."""
    rows = list[list[Chart]]()
    for j, joint in enumerate(joints):
        scale, unit = torque_unit(float(np.abs(part.error[:, j]).max()), joint.force)
        residual = np.where(part.share[:, j] < JUDGED_SHARE, np.nan, scale * part.error[:, j])
        over = list_abscissae(joint, part.q[:, j], part.v[:, j])
        measured = Trace("measured", part.measured[:, j], plots.PLAIN, width=4.0)
        torques = [measured, Trace("model", part.predicted[:, j], joint.colour)]
        each = (
            (f"torque, {joint.force}", torques),
            (f"residual, {unit}", [Trace("residual", residual, joint.colour)]),
        )
        rows.append(
            [Chart(joint.name, joint.colour, label, part.t, curves, over) for label, curves in each]
        )
    return Charts(part.log, rows)


def clouds(joints: tuple[ShownJoint, ...], evaluated: Evaluated) -> plots.Figure:
    """Draw residuals over rates, and their histograms below, beside the normal distribution of the same mean and size.

    Over a cloud lies its mean in stretches of the rate, with twice its error.
    """
    from scipy.stats import norm

    figure, panels = plots.panels(2, len(joints), 4.2, ratios=[1.5, 1], gaps=(0.75, 0.6))
    rates, errors, shares = (evaluated.stacked(name) for name in ("v", "error", "share"))
    scale, unit = torque_unit(float(np.abs(errors).max()), forces(joints))
    for j, (joint, (above, below)) in enumerate(zip(joints, panels.T)):
        above.set_title(joint.name, color=joint.colour)
        above.set(xlabel=f"rate, {joint.unit}/s")
        below.set(xlabel=f"residual, {unit}")
        rows = np.flatnonzero(shares[:, j] > JUDGED_SHARE)
        if not len(rows):
            continue
        v = joint.scale * rates[rows, j]
        error = scale * errors[rows, j] / shares[rows, j]
        every = len(rows) // MOST_DOTS
        plots.dots(above, v[:: max(1, every)], error[:: max(1, every)], joint.colour)
        order = np.argsort(v)
        for way in (order[v[order] < 0], order[v[order] > 0]):
            groups = np.array_split(way, min(RATE_BINS, max(1, len(way) // 6)))
            pairs = [(v[group], error[group]) for group in groups if len(group) > 1]
            middle, mean = (np.array([pair[k].mean() for pair in pairs]) for k in (0, 1))
            sure = np.array([own.std() / np.sqrt(len(own)) for _, own in pairs])
            above.fill_between(
                middle, mean - 2 * sure, mean + 2 * sure, color=plots.INK, alpha=0.18
            )
            above.plot(middle, mean, color=plots.INK, lw=1.3)
        plots.zero_line(above)
        bins = int(np.clip(1.5 * len(error) ** 0.5, 8, 40))
        normal = norm(error.mean(), error.std())
        below.hist(error, bins=bins, density=True, color=joint.colour, alpha=0.45)
        if normal.std() > 0:
            x = normal.mean() + normal.std() * np.linspace(-4, 4, 120)
            below.plot(x, normal.pdf(x), color=plots.INK, lw=1.0)
        below.set_yticks([])
    panels[0, 0].set_ylabel(f"residual, {unit}")
    panels[1, 0].set_ylabel("density")
    return figure
