"""The pages: of a run from logs to a controller, of a diagnosis, and of a camera on a platform that moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markupsafe import Markup

from gimbal_pin.control.controller_names import OURS
from gimbal_pin.control.judging import Judgement
from gimbal_pin.control.tracking import Tracking
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.log.log import Log
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.result import Verified
from gimbal_pin.report.elements import Document, Section, embed, join_text, paragraph
from gimbal_pin.report.evaluation import Evaluated, evaluate
from gimbal_pin.report.format import controller_name, listed
from gimbal_pin.report.sections.camera import show_camera
from gimbal_pin.report.sections.control import show_controller, show_tracking
from gimbal_pin.report.sections.data import show_logs, show_rig
from gimbal_pin.report.sections.diagnosis import WRONG, show_diagnosis
from gimbal_pin.report.sections.model import show_parameters, show_torque
from gimbal_pin.report.view.gaze import outlook
from gimbal_pin.report.view.scene import onboard
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from gimbal_pin.report.pipeline import Auto


def list_sections(found: Auto, evaluated: Evaluated | None = None, recording: str = "") -> list[Section]:
    """Return what every step of a run found.

    Args:
        found: The run.
        evaluated: The rows that the model is judged by; None: a terminal shows no pictures of them.
        recording: The page of the animation, which shows the controller that was asked for.
    """
    wrong, held, law = found.diagnosis, found.held, controller_name(found.tuning.wish.kind)
    sections = [found.summary.section]
    if wrong is not None:
        sections.append(show_diagnosis(wrong))
    if found.undiagnosed:
        sections.append(Section(WRONG, [paragraph(f"These logs could not be diagnosed. {found.undiagnosed}.")]))
    if recording:
        sections.append(animation(recording, f"All axes to and fro under {law}; the ghost is the reference."))
    sections += [
        show_parameters(found.identified, found.payload if wrong is None else None, evaluated),
        show_torque(found.identified, evaluated),
        show_controller(found.tuning),
        show_tracking(found.judged, found.model.rig, found.tracking, found.plant),
    ]
    if held is not None:
        known = f"The plant is {found.held_on}; the controllers know the model and no more."
        sections.append(show_camera(held, known))
    return sections


def describe_auto(rig: Rig, logs: Sequence[Log], found: Auto, recording: str) -> Document:
    """Return the report of a whole run, from logs to a tuned controller; `recording`: see `list_sections`."""
    sections = list_sections(found, evaluate(found.identified, logs), recording)
    sections += [show_logs(rig, logs), show_rig(rig, found.payload.weighed)]
    return Document(rig.title, rig.config.description, sections)


def describe_outcome(found: Auto, verbose: bool = False) -> str:
    """Return what `auto` prints: the head in 14 lines, or with `verbose` all that needs no picture; where files lie."""
    names = listed(path.name for what, path in found.files.items() if what != "report")
    path = found.files["report"]
    lie = f"open {path}; beside it in {path.parent}: {names}"
    return f"{join_text(list_sections(found), verbose)}\n\n{lie}" if verbose else f"{found.summary.describe()}\n{lie}"


def describe_diagnosis(rig: Rig, logs: Sequence[Log], found: Diagnosis) -> Document:
    """Return the report of a diagnosis alone."""
    sections = [show_diagnosis(found), show_logs(rig, logs), show_rig(rig, found.given.weighed)]
    return Document(rig.title, rig.config.description, sections)


def describe_tracking(
    rig: Rig, held: Verified | None, steps: Tracking | None, plant: str, judged: Judgement | None = None
) -> Document:
    """Return the report of a tracking; `plant`: what the steps were simulated on, within a sentence."""
    parts = [] if judged is None else [show_tracking(judged, rig, steps, plant)]
    if held is not None:
        lead = "The platform turns, the camera stands; in blue the same rig with its joints locked."
        parts += [show_camera(held), animation(moving(rig, held), lead)]
    return Document(rig.title, rig.config.description, [*parts, show_rig(rig)])


def moving(rig: Rig, held: Verified) -> str:
    """Return the page that shows the rig, held by computed torque, on the platform."""
    (run,) = [row.runs[0] for row in held.rows if row.controller == OURS]
    return onboard(rig, run, outlook(held, WANTED), WANTED)


def animation(page: str, lead: str) -> Section:
    """Return a section that plays a recording in a frame of its own; the recording lies in the report's file."""
    frame = embed(page, "Animation", "scene")
    button = Markup('<button type="button" class="wide" onclick="{}">Full screen</button>').format(
        "this.closest('.animation').querySelector('iframe').requestFullscreen()"
    )
    how = paragraph("Drag to turn, scroll to zoom; the bar plays, pauses and seeks.")
    whole = Markup('<div class="animation">{}<div class="below">{}{}</div></div>').format(frame, how, button)
    return Section("Animation", [whole], lead)
