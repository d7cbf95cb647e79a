"""What the simulation gets wrong: verdict, findings and their rivals, what is left, and what knowing it gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from gimbal_pin.diagnosis import SETTINGS, Diagnosis, Finding, HeldOut, TorqueTrace, trace_torques
from gimbal_pin.diagnosis.held_out import ResidualTraces
from gimbal_pin.diagnosis.rows import Indices
from gimbal_pin.identification.validation import LEAST_JUDGED_SHARE
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.report import plots, tables
from gimbal_pin.report.charts import Chart, Charts, Trace, list_abscissae
from gimbal_pin.report.diagnosis_text import (
    advise,
    describe_candidate,
    describe_unconfirmed,
    head_finding,
    list_alternatives,
    list_deciding_faults,
    list_remarks,
    list_rest,
    list_unnamed,
    state_gain,
    state_share,
    state_size,
    state_sizes,
    state_verdict,
)
from gimbal_pin.report.elements import Element, Section, bullets, folded, heading, paragraph
from gimbal_pin.report.evaluation import find_worst
from gimbal_pin.report.format import (
    ShownJoint,
    file_name,
    list_altered,
    list_shown_joints,
    listed,
    to_sentence,
    torque_unit,
)
from gimbal_pin.report.rig_drawing import RigDrawing
from gimbal_pin.report.sections.experiment import describe_next_experiment
from gimbal_pin.report.sections.model import describe_lags, show_payload

WRONG = "What the simulation gets wrong"
SPOILT = "What a fit of the log finds all the same, and what is not to be acted on:"
MOST_POINTS = 700
"""Most dots in a cloud, and points of a curve over time."""
MOST_DRAWN_JOINTS = 4
"""Most joints whose residual is drawn, those with findings first."""
SEGMENT = 8.0
"""Length of the stretches that a spectrum is averaged over, s."""
OPEN = 0.5
"""Weight of a row from which on it is drawn."""


# -- text --------------------------------------------------------------------------------------------------------------


def show_diagnosis(found: Diagnosis) -> Section:
    """Return what a diagnosis says."""
    is_good = found.is_silent and not found.unexplained
    headline = paragraph(state_verdict(found), f"headline {'good' if is_good else 'fair'}")
    remarks = [paragraph(one) for one in list_remarks(found)]
    beside = [headline, *remarks, *state_model_errors(found)]
    joints = list_questioned(found)
    parts: list[object] = [RigDrawing(found.after.rig, joints, found.given.balance, beside)]
    parts += show_faults(found)
    for finding in found.stated:
        parts += show_finding(finding, state_gain(found, finding), found.verdict != "data")
    unconfirmed = [describe_unconfirmed(one) for one in found.findings if not one.is_stated]
    if unconfirmed:
        title = "Selected, but not stated as the cause and not in the model"
        parts += [heading(title), bullets(f"{one}." for one in unconfirmed)]
    rest = [*list_rest(found), *filter(None, [describe_candidate(found)])]
    if rest:
        title = "What is not explained" if found.unexplained else "What would have been found"
        parts += [heading(title), bullets(rest)]
    if found.planned is not None:
        lines = describe_next_experiment(found.planned)
        parts += [heading("The next experiment"), bullets(lines)]
    if found.held_out is not None:
        parts += show_held_out(found, found.held_out)
    given = replace(found.given, apart=None) if found.finds_payload else found.given
    parts += show_payload(given, *qualify_payload(found))
    notes = [*found.notes, *list_unnamed(found), *list_altered(found.altered)]
    notes += describe_lags(found.after) if found.held_out is not None else []
    parts += [folded("Notes", bullets(notes), is_detail=False)] if notes else []
    return Section(WRONG, parts)


def list_questioned(found: Diagnosis) -> list[str]:
    """Return the joints with findings that are stated, and those at which torque is left unexplained."""
    places = [*(one.joint for one in found.stated if one.joint), *found.unexplained]
    return list(dict.fromkeys(places))


def state_model_errors(found: Diagnosis) -> list[Element]:
    """Say by how much of its torque each model is off at the joint where the URDF is worst, of those that moved.

    Of spoilt logs nothing.
    """
    held = found.held_out
    if held is None or found.spoiling:
        return []
    fits = {
        joint: fit
        for joint, fit in held.urdf.fit_percent.items()
        if held.used[joint] >= LEAST_JUDGED_SHARE
    }
    if not fits:
        return []
    joint = min(fits, key=lambda name: fits[name])
    shares = [
        f"{name} {state_share(100 - errors.fit_percent[joint])}"
        for name, errors in held.stages.items()
    ]
    where = f"{joint}, where the URDF is worst, held out, up to {held.cutoff_hz:g} Hz"
    return [paragraph(f"Torque error at {where}: {', '.join(shares)}.")]


def show_faults(found: Diagnosis) -> list[object]:
    """Return what is wrong with the logs, what to do about it, and what holds in spite of it."""
    faults = list_deciding_faults(found)
    if not faults:
        return []
    lines = [f"{fault.sentence}; {fault.next_experiment}" for fault in faults]
    lines += [state_size(figure) for fault in faults for figure in fault.answer]
    return [bullets(lines), *([paragraph(SPOILT)] if found.findings else [])]


def show_finding(finding: Finding, gain: str, is_believed: bool) -> list[object]:
    """Return a finding: its size, what it gains, what it could be instead, and what to do.

    Args:
        finding: The finding.
        gain: What it gains, see `state_gain`.
        is_believed: Whether the logs are sound, so that something is to be done about it.
    """
    is_listed = len(finding.parameters) > tables.MOST  # the harmonics of a motor's teeth
    lines = list[str]()
    if finding.parameters:
        interval = " (± 95 %)" if finding.sized else ""
        lines.append(f"{to_sentence(state_sizes(finding.parameters))[:-1]}{interval}.")
    lines += [to_sentence(gain), *list_alternatives(finding)]
    lines += [advise(finding)] if is_believed else []
    parts: list[object] = [heading(head_finding(finding)), bullets(lines)]
    if is_listed:
        title = f"Its {len(finding.parameters)} figures"
        parts.append(folded(title, tables.tabulate_sizes(finding)))
    return [*parts, *([tables.rivals(finding)] if finding.rivals else [])]


def show_held_out(found: Diagnosis, held: HeldOut) -> list[object]:
    """Return the errors of the models on held-out rows, and pictures of what they leave."""
    how = (
        f"Rows: {held.how}, up to {held.cutoff_hz:g} Hz. "
        "Errors: rms, in brackets the share of the torque's deviation from its mean."
    )
    drawn = picture_residuals(found, held)
    return [
        heading("Torque error held out"),
        paragraph(how, "side"),
        tables.held_out_errors(found),
        folded("What is left over angle, rate, time and frequency", drawn),
    ]


def qualify_payload(found: Diagnosis) -> list[Element]:
    """Say whether the payload's figures are only rough."""
    if not found.unexplained:
        return []
    where = listed(found.unexplained)
    return [paragraph(f"These figures are rough: torque is left unexplained at {where}.", "side")]


# -- pictures of what is left ------------------------------------------------------------------------------------------


def picture_residuals(found: Diagnosis, held: HeldOut) -> plots.Drawing:
    """Return what two models leave over angle, rate, time and frequency.

    Where not all joints find room these are, first, those with findings, then those with something left.
    """
    joints = list_shown_joints(found.after.rig)
    order = dict.fromkeys([*list_questioned(found), *(joint.name for joint in joints)])
    shown = set(list(order)[:MOST_DRAWN_JOINTS])
    names = [joint.name for joint in joints if joint.name in shown]

    @cache
    def make() -> Charts:
        rows = [
            chart_residual(found, held, joint, j)
            for j, joint in enumerate(joints)
            if joint.name in shown
        ]
        return Charts("held out" if len(found.logs) > 1 else found.logs[0], rows)

    alt = f"Residual torque of {', '.join(names)} over angle, rate, time and frequency"
    caption = (
        "Residual torque of the refitted model (grey) and of the extended model (colour), each row predicted by a fit "
        "to others. What is flat and small in colour is noise or too small to matter."
    )
    return plots.Drawing(lambda: draw_residuals(make(), held.cutoff_hz), alt, caption, charts=make)


def chart_residual(found: Diagnosis, held: HeldOut, joint: ShownJoint, j: int) -> list[Chart]:
    """Return a joint's residual over time, and beside it its amplitude over frequency.

    Curves are broken near standstill and between stretches. Of several logs time goes on from one to the next.
    """
    traces = held.traces
    starts = find_stretches(traces)
    t = traces.t + measure_log_starts(found, traces)[traces.log]
    is_drawn = traces.weight[:, j] > OPEN
    is_drawn[starts] = False
    size = float(np.abs(traces.refitted[:, j]).max())
    scale, unit = torque_unit(size, joint.force)
    models = (
        ("refitted", traces.refitted[:, j], plots.PLAIN),
        ("extended", traces.extended[:, j], joint.colour),
    )
    left = list[Trace]()
    heard = list[Trace]()
    for name, residual, colour in models:
        left.append(Trace(name, np.where(is_drawn, scale * residual, np.nan), colour))
        frequency, density = compute_amplitude_density(traces, scale * residual, starts)
        heard.append(Trace(name, density, colour))
    over = list_abscissae(joint, traces.q[:, j], traces.v[:, j])
    label = f"amplitude, {unit}/√Hz"
    return [
        Chart(joint.name, joint.colour, f"residual, {unit}", t, left, over),
        Chart(joint.name, joint.colour, label, frequency, heard, {}, "frequency, Hz", "y"),
    ]


def find_stretches(traces: ResidualTraces) -> Indices:
    """Return the first row of each stretch between gaps, (s,)."""
    is_apart = np.diff(traces.t, prepend=-np.inf) > 1.5 * traces.dt
    is_other = np.diff(traces.log, prepend=-1) != 0
    return np.flatnonzero(is_apart | is_other)


def measure_log_starts(found: Diagnosis, traces: ResidualTraces) -> Array:
    """Return the time at which each log begins in a picture, s: its own clock of one, one after another of several."""
    if len(found.data) == 1:
        return np.array([found.data[0].t[0]])
    count = int(traces.log.max()) + 1
    lengths = [traces.t[traces.log == k].max(initial=0.0) + traces.dt for k in range(count)]
    return np.cumsum([0.0, *lengths[:-1]])


def compute_amplitude_density(
    traces: ResidualTraces, residual: Array, starts: Indices
) -> tuple[Array, Array]:
    """Return frequencies, Hz, and the amplitude density there of a residual, (N,), over its longest stretch."""
    from scipy.signal import welch

    longest = max(np.split(residual, starts[1:]), key=len)
    length = min(len(longest), max(8, round(SEGMENT / traces.dt)))
    frequency, power = welch(longest, 1 / traces.dt, nperseg=length)
    return frequency[1:], np.sqrt(np.maximum(power[1:], 1e-300))


def draw_residuals(charts: Charts, band: float) -> plots.Figure:
    """Draw a column per joint: the residual over angle, rate and time, and its amplitude over frequency."""
    figure, panels = plots.panels(4, len(charts.rows), 7.6, gaps=(0.95, 0.6))
    for column, (left, heard) in zip(panels.T, charts.rows):
        column[0].set_title(left.title, color=left.colour)
        for axes, (label, x) in zip(column, left.abscissae.items()):
            for trace in left.curves:
                rows = np.flatnonzero(np.isfinite(trace.values))
                rows = rows[:: max(1, len(rows) // MOST_POINTS)]
                plots.dots(axes, x[rows], trace.values[rows], trace.colour)
            axes.set(xlabel=label, ylabel=left.label)
        for trace in left.curves:
            shown = plots.thinned(left.t, trace.values, MOST_POINTS)
            column[2].plot(*shown, color=trace.colour, lw=0.9)
        for trace in heard.curves:
            column[3].plot(heard.t, trace.values, color=trace.colour, lw=1.3)
        for axes in column[:3]:
            plots.zero_line(axes)
        column[2].set(xlabel="time, s", ylabel=left.label)
        column[3].set(xlabel=heard.over, ylabel=heard.label, yscale="log", xlim=(0, band))
    return figure


# -- pictures of torques -----------------------------------------------------------------------------------------------


def find_worst_stretch(found: Diagnosis, longest: float = 60.0) -> tuple[Log, Log]:
    """Return the log of which the refitted model leaves most torque, and those `longest` s of it where it does.

    What is left is a share of the joint's torque.
    """
    assert found.held_out is not None
    traces = found.held_out.traces
    fits = found.held_out.refitted.fit_percent
    levels = [
        rmse / max(1 - fits[joint] / 100, 1e-300)
        for joint, rmse in found.held_out.refitted.torque_rmse.items()
    ]
    power = np.sum((traces.refitted / np.maximum(levels, 1e-300)) ** 2, axis=1)
    worst = {
        k: find_worst(traces.t[traces.log == k], power[traces.log == k], longest)
        for k in np.unique(traces.log).tolist()
    }
    k = max(worst, key=lambda number: worst[number][0])
    log = found.data[k].ordered(found.before.rig)
    since = float(traces.t[traces.log == k][worst[k][1]][0])
    start = log.t[0] + (since if log.t[-1] - log.t[0] > longest else 0.0)
    return log, log.part((log.t >= start) & (log.t <= start + longest))


def choose_filtering(found: Diagnosis) -> Filtering | None:
    """Return the band that a diagnosis looked at; None: the logs are spoilt."""
    if found.held_out is None:
        return None
    return Filtering(cutoff=found.held_out.cutoff_hz, smoothing=SETTINGS.smoothing)


def picture_torques(found: Diagnosis, log: Log) -> plots.Drawing:
    """Return a log's torque, measured and by both models, and what they leave."""
    filtering = choose_filtering(found)
    joints = list_shown_joints(found.after.rig)

    @cache
    def make() -> Charts:
        traces = [trace_torques(model, log, filtering) for model in (found.before, found.after)]
        return chart_torques_of_models(joints, *traces)

    name = file_name(log.name)
    alt = f"Torque and residual of {', '.join(found.after.rig.joints)} over time in {name}"
    caption = (
        f"Torque of {name}: measured, by the refitted and by the extended model, and what each leaves. "
        "Near standstill dry friction may have any direction: there the models guess."
    )
    return plots.Drawing(lambda: make().draw(), alt, caption, charts=make)


def chart_torques_of_models(
    joints: Sequence[ShownJoint], before: TorqueTrace, after: TorqueTrace
) -> Charts:
    """Return a row per joint: torque, and beside it the residual; curves are broken at gaps of the log."""
    rows = list[list[Chart]]()
    steps = np.diff(after.t, prepend=after.t[0])
    whole = np.where(steps > 3 * np.median(steps), np.nan, 1.0)
    for j, joint in enumerate(joints):
        scale, unit = torque_unit(float(np.abs(before.residual[:, j]).max()), joint.force)
        looks = (("refitted", before, plots.PLAIN), ("extended", after, joint.colour))
        torques = [Trace("measured", whole * after.measured[:, j], plots.INK)]
        torques += [Trace(name, whole * one.model[:, j], colour) for name, one, colour in looks]
        left = [
            Trace(name, whole * scale * one.residual[:, j], colour) for name, one, colour in looks
        ]
        over = list_abscissae(joint, after.q[:, j], after.v[:, j])
        each = ((f"torque, {joint.force}", torques), (f"residual, {unit}", left))
        rows.append(
            [
                Chart(joint.name, joint.colour, label, after.t, curves, over)
                for label, curves in each
            ]
        )
    return Charts(after.log, rows)
