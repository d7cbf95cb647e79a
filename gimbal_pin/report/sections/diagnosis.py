"""What the simulation gets wrong: verdict, findings, what is left, and the residual before and after."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from gimbal_pin.diagnosis import Diagnosis, Finding
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import Extended
from gimbal_pin.diagnosis.heldout import filtered_error
from gimbal_pin.log import Array
from gimbal_pin.report import plots
from gimbal_pin.report.base import Section
from gimbal_pin.report.html import Content, bullets, folded, heading, join, paragraph, picture, table, toned
from gimbal_pin.report.joints import Joint, joints_of
from gimbal_pin.report.numbers import figures, listed, torque_text, torque_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLOUD = 1200
"""Most dots in a cloud."""
VERDICTS = {
    "named": "Something is missing from the model, and this log says what.",
    "ambiguous": "Something is missing from the model; this log leaves more than one cause possible.",
    "unknown": "Something is missing from the model, and nothing that the library knows explains it.",
    "nothing": "The refitted model is as good as the data: nothing more can be found in this log.",
    "data": "The log itself is at fault: nothing that it seems to say about the rig should be believed.",
}


def diagnosis(found: Diagnosis) -> Section:
    """Return what a diagnosis says."""
    parts = [paragraph(toned(VERDICTS[found.verdict], "good" if found.verdict == "nothing" else "fair"))]
    parts += (
        [bullets([f"{fault.sentence}; {fault.next_experiment}" for fault in found.spoiling])] if found.spoiling else []
    )
    for finding in found.findings:
        parts += described(finding)
    if found.planned is not None:
        parts += [heading("The next experiment"), bullets(found.planned.lines)]
    if found.held is not None:
        joints = joints_of(found.held.rig)
        parts.append(table(HEAD, [row(found, joint) for joint in joints], label="Torque error before and after"))
        parts.append(drawn(found, joints, found.held))
    if found.given is not None:
        parts += [heading("The given model against the refitted one"), bullets(found.given.lines)]
    hidden = [f"{each.cause} at {each.joint or 'the rig'}" for each in found.untestable]
    small = [f"{each.cause} at {each.joint or 'the rig'} ({100 * each.share:.2g} %)" for each in found.immaterial]
    notes = [*found.notes, *([f"Significant, and too small to matter: {listed(small)}."] if small else [])]
    notes += [f"This log cannot show {listed(hidden)}: rigid model and friction would take it up."] if hidden else []
    parts += [folded("Notes", bullets(notes))] if notes else []
    return Section("What the simulation gets wrong", join(parts), "On the part of the log that no choice has seen.")


HEAD: list[Content] = ["Joint", "What is left is", "Error before", "Error after", "Would have been found"]


def row(found: Diagnosis, joint: Joint) -> list[Content]:
    """A joint's row."""
    left = found.residual.get(joint.name)
    before, after = (part["torque_rmse"][joint.name] for part in (found.baseline, found.extended))
    limit = found.detection_limit.get(joint.name)
    state = toned(f"{left.state} {left.where}".strip(), "good" if left.state == "noise" else "fair") if left else None
    shown: list[Content] = [torque_text(before), torque_text(after), torque_text(limit) if limit else "–"]
    return [joint.label, state or "–", *shown]


def described(finding: Finding) -> list[Markup]:
    """A finding: its sentence, its figures, and what it could be instead."""
    sure = [p for p in finding.parameters if p.std > 0]
    figure = [f"{p.name} {figures(p.value)} ± {figures(p.std, 2)}{'' if p.unit == '1' else ' ' + p.unit}" for p in sure]
    lines: list[Content] = [f"{', '.join(figure)} (± is one standard deviation)."] if figure else []
    rivals = ", ".join(f"{rival.cause} (z = {rival.z:.1f})" for rival in finding.rivals[:4])
    if finding.next_experiment:
        lines.append(f"This log cannot tell it from {listed(finding.alike[1:])}: try {finding.next_experiment}.")
    elif rivals:
        lines.append(f"The nearest other causes fit worse: {rivals}.")
    gain = finding.gain
    if gain["rollout_rmse_before"] > 0:
        rolled = gain["rollout_rmse_after"] / gain["rollout_rmse_before"]
        lines.append(f"Simulated from the same torque, the angle is off by {rolled:.2g} times what it was without it.")
    return [heading(f"{finding.joint or 'Rig'}: {finding.cause}"), paragraph(finding.sentence), bullets(lines)]


def drawn(found: Diagnosis, joints: tuple[Joint, ...], held: Evidence) -> Markup:
    """The residual over angle and over rate, before and after."""
    alt = f"Held-out residual torque of {', '.join(held.rig.joints)} over angle and rate, before and after"
    caption = (
        "Held-out residual torque over the joint's angle and rate: refitted model (grey), extended model (colour)."
    )
    return picture(plots.drawn(partial(clouds, found.before, found.after, joints, held), alt), caption)


def clouds(before: Extended, after: Extended, joints: tuple[Joint, ...], held: Evidence) -> Figure:
    """Draw the residuals."""
    figure, panels = plots.panels(2, len(joints), 5.0, gaps=(0.75, 0.6))
    errors = [filtered_error(held, model) for model in (before, after)]
    scale, unit = torque_unit(float(np.abs(errors[0]).max()))
    open_ = np.concatenate([part.gate for part in held.parts]) > 0.5
    for j, joint in enumerate(joints):
        rows = np.flatnonzero(open_[:, j])
        rows = rows[:: max(1, len(rows) // CLOUD)]
        panels[0, j].set_title(joint.name, color=joint.colour)
        for panel, name, per in ((panels[0, j], "angle", ""), (panels[1, j], "rate", "/s")):
            x = joint.scale * channel(held, "q" if name == "angle" else "v", j)[rows]
            for error, colour in zip(errors, (plots.PLAIN, joint.colour)):
                plots.dots(panel, x, scale * error[rows, j], colour)
            plots.zero_line(panel)
            panel.set_xlabel(f"{name}, {joint.unit}{per}")
    for panel in panels[:, 0]:
        panel.set_ylabel(f"residual, {unit}")
    return figure


def channel(held: Evidence, name: str, joint: int) -> Array:
    """One channel of one joint over all parts."""
    return np.concatenate([getattr(part.channels, name)[:, joint] for part in held.parts])
