"""What the simulation gets wrong: verdict, findings and their rivals, what is left, and what knowing it gains."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from math import isfinite

import numpy as np
from markupsafe import Markup

from gimbal_pin.diagnosis import Diagnosis, Finding
from gimbal_pin.diagnosis.band import DIAGNOSIS_BAND
from gimbal_pin.diagnosis.counterfactual import COMPENSATION
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.gain import (
    TorqueTrace,
    compute_filtered_error,
    describe_worse_errors,
    trace_torques,
)
from gimbal_pin.diagnosis.probability import LISTED
from gimbal_pin.effects import CAUSES
from gimbal_pin.errors import DataError, digits
from gimbal_pin.identification.validation import LEAST_JUDGED_SHARE
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering, Flags
from gimbal_pin.report import plots, tables
from gimbal_pin.report.charts import Chart, Charts, Trace, list_abscissae
from gimbal_pin.report.elements import (
    Content,
    Element,
    Section,
    bullets,
    folded,
    heading,
    paragraph,
)
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
from gimbal_pin.report.sections.model import describe_lags, show_payload

WRONG = "What the simulation gets wrong"
VERDICTS = {
    "named": "The model lacks {named}.",
    "ambiguous": "Something is missing from the model; this log leaves more than one cause possible.",
    "unknown": "The model leaves torque unexplained at {unexplained}, and no cause was accepted.",
    "nothing": "No error was found in the refitted model beyond the limits below.",
    "data": "The log itself is at fault: nothing that it seems to say about the rig should be believed.",
}
BY_PLATFORM_ALONE = (
    "This is by the platform's motion alone, as its IMU tells it: below stands what that is worth."
)
SPOILT = "What a fit of the log finds all the same, and what is not to be acted on:"
MOST_POINTS = 700
"""Most dots in a cloud, and points of a curve over time in one stretch."""
MOST_DRAWN_JOINTS = 4
"""Most joints whose residual is drawn, those with findings first."""
SEGMENT = 8.0
"""Length of the stretches that a spectrum is averaged over, s."""
OPEN = 0.5
"""Weight of a sample from which on it is drawn."""


def show_diagnosis(found: Diagnosis) -> Section:
    """Return what a diagnosis says."""
    tone = "good" if found.verdict_without_platform == "nothing" else "fair"
    named = ((f"{one.joint or 'rig'}: {' or '.join(one.alike)}", one) for one in found.findings)
    heads = [f"{name}; {tables.state_probability(one)}" for name, one in named]
    questioned = list(
        dict.fromkeys([*(one.joint for one in found.findings if one.joint), *found.unexplained])
    )
    decided = [
        paragraph(state_verdict(found), f"headline {tone}"),
        Markup(bullets(heads)),
        *state_model_errors(found),
    ]
    parts: list[object] = [RigDrawing(found.after.rig, questioned, found.given.balance, decided)]
    if found.spoiling:
        faults = [f"{fault.sentence}; {fault.next_experiment}" for fault in found.spoiling]
        parts.append(
            bullets(
                [*faults, *(tables.state_size(p) for fault in found.spoiling for p in fault.answer)]
            )
        )
        parts += [paragraph(SPOILT)] if found.findings else []
    joints = () if found.held is None else list_shown_joints(found.held.rig)
    for finding in found.findings:
        parts += show_finding(finding, not found.spoiling)
    if found.planned is not None:
        parts += [heading("The next experiment"), bullets(found.planned.lines)]
    if found.held is not None:
        parts += [heading(f"What is left up to {found.held.band:g} Hz"), tables.residual(found)]
        parts += [paragraph(f"{tables.ALONE}.", "side")] if len(found.findings) > 1 else []
        parts += [paragraph(to_sentence(found.hidden), "side")] if found.hidden else []
        parts += [paragraph(f"{line}.") for line in found.deteriorations]
        parts += [paragraph(f"{line}.") for line in tables.list_curves(found)]
        left = picture_residuals(found, joints, found.held)
        parts.append(folded("What is left over angle, rate, time and frequency", left))
    simulated = (
        "Simulated: error of the position, rms, after 0.2 s of simulation from the held-out torque."
    )
    if found.held is not None and (found.findings or found.is_extended):
        parts += [
            heading("What knowing it gains"),
            tables.gain(found, joints),
            paragraph(simulated, "side"),
        ]
        parts += [
            paragraph(f"{line}.") for line in describe_worse_errors(found.baseline, found.extended)
        ]
    given = replace(found.given, apart=None) if found.finds_payload else found.given
    parts += show_payload(given, *qualify_payload(found))
    late = describe_lags(found.after) if found.held is not None else []
    notes = [*found.notes, *late, *tables.list_unnamed(found), *list_altered(found.altered)]
    parts += [folded("Notes", bullets(notes), is_detail=False)] if notes else []
    band = "" if found.held is None else f", up to {found.held.band:g} Hz"
    lead = f"Held-out errors are of the part of the log that no choice has seen{band}."
    return Section(WRONG, parts, lead)


def state_verdict(found: Diagnosis) -> str:
    """Return the verdict; a cause that is left open is not said to be named."""
    verdict = found.verdict_without_platform
    places = [f"{' or '.join(one.alike)} at {one.joint or 'the rig'}" for one in found.lacking]
    named = [place for place, one in zip(places, found.lacking) if one.status == "named"]
    open_ = [place for place, one in zip(places, found.lacking) if one.status != "named"]
    parts = list(map(to_sentence, found.statements))
    if found.lacking or found.unexplained or not parts:
        parts.append(
            VERDICTS[verdict].format(
                named=listed(named or [""]), unexplained=listed(found.unexplained or [""])
            )
        )
    if verdict == "named" and open_:
        parts.append(f"It may also lack {listed(open_)}: this log leaves open which.")
    if verdict == "unknown" and found.candidate is not None:
        parts.append(to_sentence(found.candidate.sentence))
    if found.findings and found.unexplained and verdict != "data":
        parts.append(f"Torque is left unexplained at {listed(found.unexplained)}.")
    if found.lacking != found.findings:
        parts.append(BY_PLATFORM_ALONE)
    return " ".join(parts)


def state_model_errors(found: Diagnosis) -> list[Element]:
    """Say by how much of its torque each model is off at the joint where the URDF is worst, of those that moved.

    Of spoilt logs nothing.
    """
    judged = (
        []
        if found.held is None or found.spoiling
        else zip(found.residual, found.held.used.tolist())
    )
    moved = [joint for joint, used in judged if used >= LEAST_JUDGED_SHARE]
    if not moved:
        return []
    joint = min(moved, key=lambda name: found.stated["fit_percent"][name])
    each = (f"{name} {tables.share_off(errors, joint)}" for name, errors in found.stages.items())
    assert found.held is not None
    where = f"{joint}, where the URDF is worst, held out, up to {found.held.band:g} Hz"
    return [paragraph(f"Torque error at {where}: {', '.join(each)}.")]


def qualify_payload(found: Diagnosis) -> list[Element]:
    """Say whether the payload's figures are only rough."""
    odd = found.unexplained
    said = f"These figures are rough: torque is left unexplained at {listed(odd)}." if odd else ""
    return [paragraph(said, "side")] if said else []


def show_finding(finding: Finding, believed: bool = True) -> list[object]:
    """Return a finding's sentence, its figures, and what it could be instead."""
    chance = tables.state_probability(finding)
    sizes = tables.state_sizes(finding)
    cap = f"at most {100 * LISTED:.0f} %, for the true form may be one that the library lacks"
    lines: list[Content] = [f"{to_sentence(chance)[:-1]} ({cap})."]
    is_listed = len(finding.sized) > tables.MOST  # the harmonics of a motor's teeth
    lines += [f"{sizes}{' (± 95 %)' if finding.sized else ''}."] if sizes and not is_listed else []
    if finding.open:
        lines.append(f"{to_sentence(finding.open)} Try {finding.experiment}.")
    cause = CAUSES.get(finding.cause)
    if believed:
        lines.append(
            f"What to do about it: {COMPENSATION if cause is None else cause.compensation}."
        )
    before, after = (finding.gain[f"rollout_rmse_{when}"] for when in ("before", "after"))
    if before > 0 and isfinite(after):
        share = digits(after / before, 2)
        lines.append(
            f"Simulated from the same torque, the angle is off by {share} times what it was without it."
        )
    said = finding.sentence.removeprefix(f"{finding.joint or 'rig'}: {finding.cause}, ")
    parts: list[object] = [heading(f"{finding.joint or 'Rig'}: {' or '.join(finding.alike)}")]
    parts += [paragraph(to_sentence(said)), bullets(lines)]
    parts += (
        [folded(f"Its {len(finding.sized)} figures", tables.tabulate_sizes(finding))]
        if is_listed
        else []
    )
    parts += [tables.rivals(finding)] if finding.rivals else []
    return parts


def picture_residuals(
    found: Diagnosis, joints: tuple[ShownJoint, ...], held: Evidence
) -> plots.Drawing:
    """Return the residual's four faces, one column per joint, in the rig's order.

    Where not all joints find room these are, first, those with findings, the strongest first, then those with
    something left.
    """
    place = {joint.name: j for j, joint in enumerate(joints)}
    named = [place[each.joint] for each in found.findings if each.joint in place]
    open_ = [place[name] for name in found.unexplained]
    order = sorted(list(dict.fromkeys([*named, *open_, *place.values()]))[:MOST_DRAWN_JOINTS])
    shown = [joints[j] for j in order]
    alt = f"Held-out residual torque of {', '.join(joint.name for joint in shown)} over angle, rate, time and frequency"
    caption = (
        "Held-out residual torque: refitted model (grey), extended model (colour), over the joint's angle, rate and "
        "time, and its amplitude over frequency. What is flat and small in colour has been explained."
    )
    if any(found.residual[joint.name].curve is not None for joint in shown):
        caption += (
            " Black: what no cause explains and the extended model carries, on paper within "
            "two standard deviations."
        )
    draw = partial(draw_residuals, found, joints, order, held)
    charts = partial(chart_residuals, found, shown, order, held)
    return plots.Drawing(draw, alt, caption, charts=charts)


def chart_residuals(
    found: Diagnosis, shown: Sequence[ShownJoint], order: list[int], held: Evidence
) -> Charts:
    """Return a row per joint: the residual, over time where it is judged, and beside it its amplitude over frequency.

    Of several logs time goes on from one to the next.
    """
    steps = [part.channels.t - part.channels.t[0] + part.dt for part in held.parts]
    jumps = len(found.logs) > 1
    ends = np.cumsum([0.0, *(step[-1] for step in steps)])
    t = np.concatenate(
        [
            step + end if jumps else part.channels.t
            for step, end, part in zip(steps, ends, held.parts)
        ]
    )
    q, v = (np.concatenate([getattr(part.channels, name) for part in held.parts]) for name in "qv")
    judged = np.where(np.concatenate([part.gate for part in held.parts]) > OPEN, 1.0, np.nan)
    errors = [compute_filtered_error(held, model) for model in (found.before, found.after)]
    rows = list[list[Chart]]()
    for joint, j in zip(shown, order):
        scale, unit = torque_unit(float(np.abs(errors[0][:, j]).max()), joint.force)
        looks = (("model", plots.PLAIN), ("extended model", joint.colour))
        left = [
            Trace(name, judged[:, j] * scale * error[:, j], colour)
            for (name, colour), error in zip(looks, errors)
        ]
        spectra = [compute_amplitude_density(held, scale * error[:, j]) for error in errors]
        curve = found.residual[joint.name].curve
        over = list_abscissae(joint, q[:, j], v[:, j])
        if curve is not None:
            x = v[:, j] if curve.over == "rate" else q[:, j]
            left.append(
                Trace("unexplained", scale * np.interp(x, curve.knots, curve.torque), plots.INK)
            )
        heard = [
            Trace(name, density, colour) for (name, colour), (_, density) in zip(looks, spectra)
        ]
        looked = f"amplitude, {unit}/√Hz"
        rows.append(
            [
                Chart(joint.name, joint.colour, f"residual, {unit}", t, left, over),
                Chart(
                    joint.name, joint.colour, looked, spectra[0][0], heard, {}, "frequency, Hz", "y"
                ),
            ]
        )
    return Charts("held out" if jumps else found.logs[0], rows)


def find_worst_stretch(found: Diagnosis, longest: float = 60.0) -> tuple[Log, Log]:
    """Return the log of which the refitted model leaves most torque, and those `longest` s of it where it does.

    Torques are shares of those that were measured, rms over all logs; logs too short to be judged are not chosen.
    """
    traces = list[tuple[Log, TorqueTrace]]()
    for log in found.data:
        with suppress(DataError):
            traces.append(
                (
                    log.ordered(found.before.rig),
                    trace_torques(found.before, log, choose_filtering(found)),
                )
            )
    size = np.sqrt(np.mean(np.concatenate([one.measured for _, one in traces]) ** 2, axis=0))
    shares = [np.sum((one.residual / np.maximum(size, 1e-300)) ** 2, axis=1) for _, one in traces]
    worst = [find_worst(one.t, share, longest) for (_, one), share in zip(traces, shares)]
    (log, trace) = traces[k := int(np.argmax([score for score, _ in worst]))]
    (_, rows) = worst[k]
    start = trace.t[rows][0] if log.t[-1] - log.t[0] > longest else log.t[0]
    return log, log.part((log.t >= start) & (log.t <= start + longest))


def choose_filtering(found: Diagnosis) -> Filtering:
    """Return the filter that a diagnosis judged held-out torque by."""
    band = DIAGNOSIS_BAND.cutoff if found.held is None else found.held.band
    return replace(DIAGNOSIS_BAND, cutoff=band, alignment=found.alignment)


def picture_torques(found: Diagnosis, log: Log) -> plots.Drawing:
    """Return a log's torque, measured and by both models, and what they leave, low-passed as the held-out part is."""
    filtering = choose_filtering(found)

    @cache
    def make() -> Charts:
        traces = [trace_torques(model, log, filtering) for model in (found.before, found.after)]
        return chart_torques_of_models(list_shown_joints(found.after.rig), *traces)

    alt = f"Torque and residual of {', '.join(found.after.rig.joints)} over time in {file_name(log.name)}"
    caption = (
        f"Torque of {file_name(log.name)} up to {filtering.cutoff:g} Hz: measured, by the refitted and by the extended "
        "model, and what each leaves. Near standstill dry friction may have any direction: there the models guess."
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
        looks = (("model", before, plots.PLAIN), ("extended model", after, joint.colour))
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


def draw_residuals(
    found: Diagnosis, joints: tuple[ShownJoint, ...], order: list[int], held: Evidence
) -> plots.Figure:
    """Draw the residuals."""
    figure, panels = plots.panels(4, len(order), 7.6, gaps=(0.95, 0.6))
    errors = [compute_filtered_error(held, model) for model in (found.before, found.after)]
    open_ = np.concatenate([part.gate for part in held.parts]) > OPEN
    for column, j in zip(panels.T, order):
        joint = joints[j]
        scale, unit = torque_unit(float(np.abs(errors[0][:, j]).max()), joint.force)
        drawn = [
            (scale * error[:, j], colour)
            for error, colour in zip(errors, (plots.PLAIN, joint.colour))
        ]
        column[0].set_title(joint.name, color=joint.colour)
        rows = np.flatnonzero(open_[:, j])
        rows = rows[:: max(1, len(rows) // MOST_POINTS)]
        for axes, name, per in ((column[0], "q", ""), (column[1], "v", "/s")):
            x = (
                joint.scale
                * np.concatenate([getattr(part.channels, name)[:, j] for part in held.parts])[rows]
            )
            for error, colour in drawn:
                plots.dots(axes, x, error[rows], colour)
            axes.set_xlabel(f"{'rate' if per else 'angle'}, {joint.unit}{per}")
            curve = found.residual[joint.name].curve
            if curve is not None and curve.over == ("rate" if per else "angle"):
                knots, torque, band = (np.array(x) for x in (curve.knots, curve.torque, curve.std))
                axes.plot(joint.scale * knots, scale * torque, color=plots.INK, lw=1.0)
                edges = (scale * (torque + side * band) for side in (-2.0, 2.0))
                axes.fill_between(joint.scale * knots, *edges, color=plots.INK, alpha=0.15)
        for error, colour in drawn:
            draw_over_time_and_frequency(column[2:], held, error, open_[:, j], colour)
        for axes in column[:3]:
            plots.zero_line(axes)
        column[2].set_xlabel("time, s")
        column[3].set(xlabel="frequency, Hz", yscale="log", xlim=(0, held.band))
        for axes, name in zip(column, ("residual", "residual", "residual", "amplitude")):
            axes.set_ylabel(f"{name}, {unit}{'/√Hz' if name == 'amplitude' else ''}")
    return figure


def draw_over_time_and_frequency(
    panels: Sequence[plots.Axes], held: Evidence, error: Array, is_judged: Flags, colour: str
) -> None:
    """Draw an error over time, broken where it is not judged, and its amplitude density."""
    ends = np.cumsum([len(part.gate) for part in held.parts])
    for part, own, judged in zip(
        held.parts, np.split(error, ends[:-1]), np.split(is_judged, ends[:-1])
    ):
        shown = plots.thinned(part.channels.t, np.where(judged, own, np.nan), MOST_POINTS)
        panels[0].plot(*shown, color=colour, lw=0.9)
    panels[1].plot(*compute_amplitude_density(held, error), color=colour, lw=1.3)


def compute_amplitude_density(held: Evidence, error: Array) -> tuple[Array, Array]:
    """Return frequencies, Hz, and the amplitude density there of an error, over its longest stretch."""
    from scipy.signal import welch

    ends = np.cumsum([len(part.gate) for part in held.parts])
    part, own = max(zip(held.parts, np.split(error, ends[:-1])), key=lambda each: len(each[1]))
    frequency, power = welch(
        own, 1 / part.dt, nperseg=min(len(own), max(8, round(SEGMENT / part.dt)))
    )
    kept = (frequency > 0) & (frequency <= held.band)
    return frequency[kept], np.sqrt(np.maximum(power[kept], 1e-300))
