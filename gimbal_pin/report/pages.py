"""The pages: of a run from logs to a controller, of a diagnosis, and of a camera on a platform that moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markupsafe import Markup

from gimbal_pin.control.controllers import OURS
from gimbal_pin.control.judging import Judgement
from gimbal_pin.control.tracking import Tracking
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.log.log import Log
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.result import Verified
from gimbal_pin.report.evaluation import evaluate
from gimbal_pin.report.format import controller_name
from gimbal_pin.report.html import Document, Section, join, paragraph
from gimbal_pin.report.sections.camera import pointing
from gimbal_pin.report.sections.control import show_controller, show_tracking
from gimbal_pin.report.sections.data import data, rig_section
from gimbal_pin.report.sections.diagnosis import WRONG, diagnosis
from gimbal_pin.report.sections.model import show_parameters, show_torque
from gimbal_pin.report.view.onboard import onboard
from gimbal_pin.report.view.outlook import outlook
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from gimbal_pin.report.pipeline import Auto

STEPS_CAPTION = "All axes to and fro under {}; the ghost is the reference."
HELD_CAPTION = "The plant is {}; the controllers know the model and no more."
NOT_DIAGNOSED = "These logs could not be diagnosed. {}."
NOT_HELD = "It was not held still on a platform that moves: {}."
SCENE = "The platform turns, the camera stands; in blue the same rig with its joints locked."


def full(rig: Rig, logs: Sequence[Log], found: Auto, recording: str) -> str:
    """Return the report of a whole run, from logs to a tuned controller, as HTML.

    `recording`: the page of the animation, which shows the controller that was asked for.
    """
    own, law = found.identified, controller_name(found.tuning.wish.kind)
    evaluated, wrong, held = evaluate(own, logs), found.diagnosis, found.held
    sections = [
        found.summary.section,
        *([] if wrong is None else [diagnosis(wrong)]),
        *([Section(WRONG, [paragraph(NOT_DIAGNOSED.format(found.undiagnosed))])] if found.undiagnosed else []),
        animation(recording, STEPS_CAPTION.format(law)),
        show_parameters(own, found.payload, evaluated),
        show_torque(own, evaluated),
        show_controller(found.tuning),
        show_tracking(found.judged, rig, found.tracking, found.plant),
        *([] if held is None else [pointing(held, HELD_CAPTION.format(found.held_on))]),
        *([Section("Camera", [paragraph(NOT_HELD.format(found.why))])] if found.why and rig.aims else []),
        data(rig, logs),
        rig_section(rig, found.payload.weighed),
    ]
    return Document(rig.title, rig.config.description, sections).to_html()


def diagnosed(rig: Rig, logs: Sequence[Log], found: Diagnosis) -> str:
    """Return the report of a diagnosis alone as HTML."""
    parts = [diagnosis(found), data(rig, logs), rig_section(rig, found.given.weighed)]
    return Document(rig.title, rig.config.description, parts).to_html()


def carried(
    rig: Rig, held: Verified | None, steps: Tracking | None, plant: str, judged: Judgement | None = None
) -> str:
    """Return the report of a tracking as HTML; `plant`: what the steps were simulated on, within a sentence."""
    parts: list[Section] = []
    if held is not None:
        parts += [pointing(held), animation(moving(rig, held), SCENE)]
    if judged is not None:
        parts.append(show_tracking(judged, rig, steps, plant))
    return Document(rig.title, rig.config.description, [*parts, rig_section(rig)]).to_html()


def moving(rig: Rig, held: Verified) -> str:
    """Return the page that shows the rig, held by computed torque, on the platform."""
    (run,) = [row.runs[0] for row in held.rows if row.controller == OURS]
    return onboard(rig, run, outlook(held, WANTED), WANTED)


def animation(page: str, lead: str) -> Section:
    """Return a section that plays a recording in a frame of its own; the recording lies in the report's file."""
    frame = Markup('<iframe class="scene" title="Animation" srcdoc="{}" allow="fullscreen"></iframe>').format(page)
    button = Markup('<button type="button" class="wide" onclick="{}">Full screen</button>').format(
        "this.closest('.animation').querySelector('iframe').requestFullscreen()"
    )
    how = paragraph("Drag to turn, scroll to zoom; the bar plays, pauses and seeks.")
    below = Markup('<div class="below">{}{}</div>').format(how, button)
    return Section("Animation", [Markup('<div class="animation">{}</div>').format(join([frame, below]))], lead)
