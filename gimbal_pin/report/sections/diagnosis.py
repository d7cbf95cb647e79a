"""What the simulation gets wrong: verdict, findings, what is left, and the residual before and after."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from gimbal_pin.diagnosis import Diagnosis, Finding
from gimbal_pin.diagnosis.likeness import Likeness
from gimbal_pin.diagnosis.platform_motion import COMPENSATION
from gimbal_pin.effects import CAUSES
from gimbal_pin.report import plots
from gimbal_pin.report.base import Section
from gimbal_pin.report.html import Content, bullets, folded, heading, join, paragraph, table, toned
from gimbal_pin.report.joints import Joint, joints_of
from gimbal_pin.report.numbers import figures, listed, torque_text
from gimbal_pin.report.sections.gain import gain
from gimbal_pin.report.sections.residuals import residuals
from gimbal_pin.report.sections.rivals import alike_map, rivals

VERDICTS = {
    "named": "Something is missing from the model, and this log says what.",
    "ambiguous": "Something is missing from the model; this log leaves more than one cause possible.",
    "unknown": "Something is missing from the model, and nothing that the library knows explains it.",
    "nothing": "The refitted model is as good as the data: nothing more can be found in this log.",
    "data": "The log itself is at fault: nothing that it seems to say about the rig should be believed.",
}


def diagnosis(found: Diagnosis) -> Section:
    """Return what a diagnosis says."""
    parts = [paragraph(toned(said(found), "good" if found.verdict == "nothing" else "fair"))]
    parts += (
        [bullets([f"{fault.sentence}; {fault.next_experiment}" for fault in found.spoiling])] if found.spoiling else []
    )
    joints = () if found.held is None else joints_of(found.held.rig)
    colours = {joint.name: joint.colour for joint in joints}
    for finding in found.findings:
        likest = [one for one in found.likeness if (one.causes[0], one.joint) == (finding.cause, finding.joint)]
        parts += described(finding, likest[:1], colours.get(finding.joint or "", plots.PLAIN))
    if found.planned is not None:
        parts += [heading("The next experiment"), bullets(found.planned.lines)]
    if found.held is not None:
        parts += [heading("What is left")] if found.findings else []
        parts.append(table(HEAD, [row(found, joint) for joint in joints], label="Torque error before and after"))
        parts.append(residuals(found, joints, found.held))
        parts += [heading("What knowing it gains"), gain(found, joints)] if found.findings else []
    if found.given is not None:
        parts += [heading("The given model against the refitted one"), bullets(found.given.lines)]
    hidden = [f"{each.cause} at {each.joint or 'the rig'}" for each in found.untestable]
    small = [f"{each.cause} at {each.joint or 'the rig'} ({100 * each.share:.2g} %)" for each in found.immaterial]
    notes = [*found.notes, *([f"Significant, and too small to matter: {listed(small)}."] if small else [])]
    notes += [f"This log cannot show {listed(hidden)}: rigid model and friction would take it up."] if hidden else []
    parts += [folded("Notes", bullets(notes))] if notes else []
    return Section("What the simulation gets wrong", join(parts), "On the part of the log that no choice has seen.")


def said(found: Diagnosis) -> str:
    """Return the verdict; a cause that is left open is not said to be named."""
    open_ = [f"{' or '.join(one.alike)} at {one.joint or 'the rig'}" for one in found.findings if len(one.alike) > 1]
    more = f" It leaves open whether it is {listed(open_)}." if found.verdict == "named" and open_ else ""
    return f"{VERDICTS[found.verdict]}{more}"


HEAD: list[Content] = ["Joint", "What is left is", "Error before", "Error after", "Would have been found"]


def row(found: Diagnosis, joint: Joint) -> list[Content]:
    """A joint's row."""
    left = found.residual.get(joint.name)
    before, after = (part["torque_rmse"][joint.name] for part in (found.baseline, found.extended))
    limit = found.detection_limit.get(joint.name)
    state = toned(f"{left.state} {left.where}".strip(), "good" if left.state == "noise" else "fair") if left else None
    shown: list[Content] = [torque_text(before), torque_text(after), torque_text(limit) if limit else "–"]
    return [joint.label, state or "–", *shown]


def described(finding: Finding, likest: Sequence[Likeness], colour: str) -> list[Markup]:
    """A finding: its sentence, its figures, and what it could be instead."""
    sure = [p for p in finding.parameters if p.std > 0]
    figure = [f"{p.name} {figures(p.value)} ± {figures(p.std, 2)}{'' if p.unit == '1' else ' ' + p.unit}" for p in sure]
    lines: list[Content] = [f"{', '.join(figure)} (± is one standard deviation)."] if figure else []
    if finding.next_experiment:
        lines.append(f"This log cannot tell it from {listed(finding.alike[1:])}: try {finding.next_experiment}.")
    kind = CAUSES.get(finding.cause)
    lines.append(f"What to do about it: {COMPENSATION if kind is None else kind.compensation}.")
    gain = finding.gain
    if gain["rollout_rmse_before"] > 0:
        rolled = gain["rollout_rmse_after"] / gain["rollout_rmse_before"]
        lines.append(f"Simulated from the same torque, the angle is off by {rolled:.2g} times what it was without it.")
    title = f"{finding.joint or 'Rig'}: {' or '.join(finding.alike)}"
    told = [heading(title), paragraph(finding.sentence), bullets(lines)]
    return [*told, *rivals(finding), *(part for one in likest for part in alike_map(one, colour))]
