"""What the simulation gets wrong: verdict, findings and their rivals, and what is left, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from markupsafe import Markup

from gimbal_pin.diagnosis import Diagnosis, Finding
from gimbal_pin.diagnosis.finding import TOGETHER
from gimbal_pin.diagnosis.likeness import Likeness
from gimbal_pin.diagnosis.platform_motion import COMPENSATION
from gimbal_pin.effects import CAUSES
from gimbal_pin.errors import digits
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import Content, bar, bullets, folded, heading, join, paragraph, table, toned
from gimbal_pin.report.pages.joints import Joint, joints_of
from gimbal_pin.report.pages.numbers import figures, listed, torque_text
from gimbal_pin.report.pages.sections.gain import gain
from gimbal_pin.report.pages.sections.residuals import residuals

WRONG = "What the simulation gets wrong"
VERDICTS = {
    "named": "Something is missing from the model, and this log says what.",
    "ambiguous": "Something is missing from the model; this log leaves more than one cause possible.",
    "unknown": "Something is missing from the model, and nothing that the library knows explains it.",
    "nothing": "The refitted model is as good as the data: nothing more can be found in this log.",
    "data": "The log itself is at fault: nothing that it seems to say about the rig should be believed.",
}

MOVED = "The platform's motion is in it, as the IMU tells it: below stands what that is worth."


def diagnosis(found: Diagnosis, command: str = "") -> Section:
    """Return what a diagnosis says; `command`: the call that asked for it."""
    parts = [paragraph(toned(said(found), "good" if found.beside == "nothing" else "fair"))]
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
        parts += [paragraph(f"{found.hidden[0].upper()}{found.hidden[1:]}.", "side")] if found.hidden else []
        parts.append(residuals(found, joints, found.held))
        parts += [heading("What knowing it gains"), gain(found, joints)] if found.findings else []
    if found.given is not None:
        parts += [heading("The given model against the refitted one"), bullets(found.given.lines)]
    hidden = [f"{each.cause} at {each.joint or 'the rig'}" for each in found.untestable]
    small = [
        f"{each.cause} at {each.joint or 'the rig'} ({digits(100 * each.share, 2)} %)" for each in found.immaterial
    ]
    notes = [
        *found.notes,
        *([f"Significant, and too small to matter: {listed(small)}."] if small else []),
    ]
    notes += [f"This log cannot show {listed(hidden)}: rigid model and friction would take it up."] if hidden else []
    parts += [folded("Notes", bullets(notes))] if notes else []
    return Section(WRONG, join(parts), "On the part of the log that no choice has seen.")


def said(found: Diagnosis) -> str:
    """Return the verdict; a cause that is left open is not said to be named."""
    open_ = [f"{' or '.join(one.alike)} at {one.joint or 'the rig'}" for one in found.findings if len(one.alike) > 1]
    more = f" It leaves open whether it is {listed(open_)}." if found.verdict == "named" and open_ else ""
    moved = "" if found.lacking == found.findings else f" {MOVED}"
    return f"{VERDICTS[found.beside]}{more}{moved}"


HEAD: list[Content] = ["Joint", "What is left is", "Error before", "Error after", "Would have been found"]


def row(found: Diagnosis, joint: Joint) -> list[Content]:
    """A joint's row, its torques in the unit of the table's largest."""
    most = max(*found.baseline["torque_rmse"].values(), *found.extended["torque_rmse"].values())
    left = found.residual.get(joint.name)
    before, after = (part["torque_rmse"][joint.name] for part in (found.baseline, found.extended))
    limit = found.detection_limit.get(joint.name)
    tone = "" if joint.name in found.noisy else "good" if left and left.state == "noise" else "fair"
    state: Content = toned(left.sentence, tone) if left else "–"
    shown: list[Content] = [
        torque_text(before, most),
        torque_text(after, most),
        torque_text(limit, most) if limit else "–",
    ]
    return [joint.label, state, *shown]


def described(finding: Finding, likest: Sequence[Likeness], colour: str) -> list[Markup]:
    """A finding: its sentence, its figures, and what it could be instead."""
    figure = [f"{p.name} {figures(p.value)} ± {figures(p.std, 2)}{p.in_units}" for p in finding.sized]
    lines: list[Content] = [f"{', '.join(figure)} (± is one standard deviation)."] if figure else []
    loose = [f"{p.name} {figures(p.value)}{p.in_units}" for p in finding.unsized]
    lines += [f"{', '.join(loose)}: {TOGETHER}."] if loose else []
    if finding.open:
        lines.append(f"{finding.open[0].upper()}{finding.open[1:]}. Try {finding.next_experiment}.")
    kind = CAUSES.get(finding.cause)
    lines.append(f"What to do about it: {COMPENSATION if kind is None else kind.compensation}.")
    gain = finding.gain
    if gain["rollout_rmse_before"] > 0:
        rolled = gain["rollout_rmse_after"] / gain["rollout_rmse_before"]
        lines.append(
            f"Simulated from the same torque, the angle is off by {digits(rolled, 2)} times what it was without it."
        )
    title = f"{finding.joint or 'Rig'}: {' or '.join(finding.alike)}"
    told = [heading(title), paragraph(finding.sentence), bullets(lines)]
    return [*told, *rivals(finding), *(part for one in likest for part in alike_map(one, colour))]


SURE = 20.0
"""Vuong's z at which the bar is full."""
MOST = 6
"""Most rivals in a table."""
ALIKE = 0.95
"""Correlation from which on two causes are outlined."""
RIVALS: list[Content] = ["Instead of it", "Log-likelihood lost", "Standard deviations worse", "Ruled out by this log"]


def rivals(finding: Finding) -> list[Markup]:
    """Return the table of the causes that were refitted in a finding's place."""
    rows: list[list[Content | None]] = []
    for rival in finding.rivals[:MOST]:
        apart = rival.cause not in finding.alike
        told = toned("yes", "good") if apart else toned("no", "fair")
        rows.append([rival.cause, figures(rival.delta), bar(rival.z / SURE, f"{rival.z:.1f}"), told])
    label = f"Causes that were fitted in the place of {finding.cause}"
    return [table(RIVALS, rows, label=label)] if rows else []


def alike_map(known: Likeness, colour: str) -> list[Markup]:
    """Return the map of a finding's look-alikes, folded away; nothing where there is no other."""
    if len(known.causes) < 2:
        return []
    where = known.joint or "the rig"
    alt = f"Correlation of what the causes like {known.causes[0]} at {where} can explain on this log"
    caption = (
        f"How alike causes at {where} are on this log, each in the form most like the finding: at 1 it cannot part "
        f"two, from {ALIKE} on they are outlined."
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
