"""How each record looks: its sections, one list for terminal, notebook and page."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from typing import TYPE_CHECKING

from markupsafe import Markup

from gimbal_pin.control.controller_names import OURS
from gimbal_pin.control.judging import Judgement
from gimbal_pin.control.tracking import Tracking
from gimbal_pin.control.tuning import Tuning
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.fleet import Fleet, MonteCarlo
from gimbal_pin.identification import Identified, compare_payload
from gimbal_pin.log.log import Log
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.result import Verified
from gimbal_pin.report.elements import Document, Section, embed, paragraph
from gimbal_pin.report.evaluation import evaluate
from gimbal_pin.report.sections.camera import show_camera
from gimbal_pin.report.sections.control import show_controller, show_tracking
from gimbal_pin.report.sections.data import show_logs, show_rig
from gimbal_pin.report.sections.diagnosis import show_diagnosis
from gimbal_pin.report.sections.fleet import describe_fleet, describe_monte_carlo
from gimbal_pin.report.sections.model import show_parameters, show_torque
from gimbal_pin.report.view.gaze import outlook
from gimbal_pin.report.view.scene import onboard
from gimbal_pin.rig.brief import Record
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from functools import _SingleDispatchCallable


def refuse_record(record: Record) -> Document:
    """Raise `NotImplementedError`: of each kind of record that has a page, a function below makes it."""
    raise NotImplementedError(f"{type(record).__name__} has no page")


describe_record: _SingleDispatchCallable[Document] = singledispatch(refuse_record)
"""Record → all that there is to say of it."""


def build_document(
    rig: Rig, sections: Sequence[Section], logs: Sequence[Log] = (), weighed: float | None = None
) -> Document:
    """Return sections under a rig's name, and behind them as details the logs and the rig that they are of."""
    inputs = [show_logs(rig, logs)] if logs else []
    return Document(rig.title, rig.config.description, [*sections, *inputs, show_rig(rig.stated, weighed)])


@describe_record.register
def describe_identified(found: Identified) -> Document:
    """Return the parameters, and the torque that they predict; pictures where the logs are at hand."""
    evaluated = evaluate(found, found.data) if found.data else None
    sections = [show_parameters(found, compare_payload(found, found.mass), evaluated), show_torque(found, evaluated)]
    return build_document(found.model.rig, sections, found.data, found.mass)


@describe_record.register
def describe_diagnosis(found: Diagnosis) -> Document:
    """Return what the simulation gets wrong."""
    return build_document(found.after.rig, [show_diagnosis(found)], found.data, found.given.weighed)


@describe_record.register
def describe_tuning(found: Tuning) -> Document:
    """Return gains, margins and loops."""
    return build_document(found.model.rig, [show_controller(found)])


describe_record.register(Fleet, describe_fleet)
describe_record.register(MonteCarlo, describe_monte_carlo)


def describe_tracking(
    rig: Rig, held: Verified | None, steps: Tracking | None, plant: str, judged: Judgement | None = None
) -> Document:
    """Return the report of a tracking; `plant`: what the steps were simulated on, within a sentence."""
    parts = [] if judged is None else [show_tracking(judged, rig, steps, plant)]
    if held is not None:
        lead = "The platform turns, the camera stands; in blue the same rig with its joints locked."
        parts += [show_camera(held), show_animation(moving(rig, held), lead)]
    return Document(rig.title, rig.config.description, [*parts, show_rig(rig)])


def moving(rig: Rig, held: Verified) -> str:
    """Return the page that shows the rig, held by computed torque, on the platform."""
    (run,) = [row.runs[0] for row in held.rows if row.controller == OURS]
    return onboard(rig, run, outlook(held, WANTED), WANTED)


def show_animation(page: str, lead: str) -> Section:
    """Return a section that plays a recording in a frame of its own; the recording lies in the report's file."""
    frame = embed(page, "Animation", "scene")
    button = Markup('<button type="button" class="wide" onclick="{}">Full screen</button>').format(
        "this.closest('.animation').querySelector('iframe').requestFullscreen()"
    )
    how = paragraph("Drag to turn, scroll to zoom; the bar plays, pauses and seeks.")
    whole = Markup('<div class="animation">{}<div class="below">{}{}</div></div>').format(frame, how, button)
    return Section("Animation", [whole], lead)
