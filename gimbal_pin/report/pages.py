"""The pages: of a run from logs to a controller, of a diagnosis, and of a camera on a platform that moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from markupsafe import Markup
from tqdm import tqdm

from gimbal_pin.control.judging import Judgement
from gimbal_pin.control.tracking import Tracking
from gimbal_pin.control.tuning import Tuning
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.identification import Identified, PayloadStatement
from gimbal_pin.log.log import Log
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.verify import Verified
from gimbal_pin.report.evaluation import evaluate
from gimbal_pin.report.format import controller_name
from gimbal_pin.report.html import Section, join, paragraph, render
from gimbal_pin.report.sections.camera import pointing
from gimbal_pin.report.sections.control import margins, tracking
from gimbal_pin.report.sections.data import data, rig_section
from gimbal_pin.report.sections.diagnosis import WRONG, diagnosis
from gimbal_pin.report.sections.model import parameters, torque
from gimbal_pin.report.summary import Summary
from gimbal_pin.report.view.onboard import onboard
from gimbal_pin.report.view.outlook import outlook, shown
from gimbal_pin.rig.rig import Rig

STEPS = "All axes to and fro under {}; the ghost is the reference."
HELD = "The plant is {}; the controllers know the model and no more, with gains of their own for holding a camera."
NOT_DIAGNOSED = "These logs could not be diagnosed. {}."
NOT_HELD = "It was not held still on a platform that moves: {}."
SCENE = "The platform turns, the camera stands; in blue the same rig with its joints locked."
OTHER = "Camera, recorded motion"


def full(
    rig: Rig,
    logs: Sequence[Log],
    found: Identified,
    tuning: Tuning,
    result: Tracking,
    judged: Judgement,
    payload: PayloadStatement,
    recording: str,
    head: Summary,
    wrong: Diagnosis | None = None,
    plant: str = "the identified model",
    held: Verified | None = None,
    held_on: str = "the identified model",
    why: str = "",
    undiagnosed: str = "",
) -> str:
    """Return the report of a whole run, from logs to a tuned controller, as HTML.

    Args:
        rig: The rig.
        logs: Its logs.
        found: The model from them.
        tuning: The controller that the recording shows.
        result: Steps with it and its rival.
        judged: The same on perturbed plants.
        payload: What the log says of the payload.
        recording: The page of the animation.
        head: What was found, what to do and what not to trust.
        wrong: What the model gets wrong, if that could be told; `undiagnosed` says why not.
        plant: What the steps were simulated on, within a sentence.
        held: The camera held on a platform, if that can be; `why` says why not.
        held_on: What the camera was held on, within a sentence.
        why: Why it was not held.
        undiagnosed: Why the logs were not diagnosed.
    """
    evaluated, law = evaluate(found, logs), tuning.wish.kind
    steps: list[Callable[[], Section]] = [
        lambda: head.section,
        *([] if wrong is None else [partial(diagnosis, wrong)]),
        *([partial(Section, WRONG, paragraph(NOT_DIAGNOSED.format(undiagnosed)))] if undiagnosed else []),
        lambda: animation(recording, STEPS.format(controller_name(law))),
        lambda: parameters(found, evaluated, payload),
        lambda: torque(found, evaluated),
        lambda: margins(tuning),
        lambda: tracking(result, rig, plant, judged),
        *([] if held is None else [partial(pointing, held, HELD.format(held_on))]),
        *([partial(Section, "Camera", paragraph(NOT_HELD.format(why)))] if why and rig.aims else []),
        lambda: data(rig, logs),
        lambda: rig_section(rig),
    ]
    every = [step() for step in tqdm(steps, desc="report", unit="section", disable=None, leave=False)]
    return render(rig.title, every, rig.config.description)


def diagnosed(rig: Rig, logs: Sequence[Log], found: Diagnosis) -> str:
    """Return the report of a diagnosis alone as HTML."""
    return render(rig.title, [diagnosis(found), data(rig, logs), rig_section(rig)], rig.config.description)


def carried(
    rig: Rig, held: Verified | None, steps: Tracking | None, plant: str, judged: Judgement | None = None
) -> str:
    """Return the report of a tracking as HTML; `plant`: what the steps were simulated on, within a sentence."""
    parts: list[Section] = []
    if held is not None:
        parts += [pointing(replace(held, recorded=None)), animation(moving(rig, held), SCENE)]
        alone = [replace(held, contest=other, recorded=None, targets=()) for other in held.contests[1:]]
        parts += [pointing(one, title=OTHER) for one in alone]
        parts += [] if held.steps is None else [tracking(held.steps, rig, "that of the camera")]
    if steps is not None:
        parts.append(tracking(steps, rig, plant, judged))
    return render(rig.title, [*parts, rig_section(rig)], rig.config.description)


def moving(rig: Rig, held: Verified) -> str:
    """Return the page that shows the rig, held by the best of the controllers, on the platform."""
    run = shown(held.contest)[-1].runs[0]
    return onboard(rig, run, outlook(held.contest, WANTED), WANTED)


def animation(page: str, lead: str) -> Section:
    """Return a section that plays a recording in a frame of its own; the recording lies in the report's file."""
    frame = Markup('<iframe class="scene" title="Animation" srcdoc="{}" allow="fullscreen"></iframe>').format(page)
    button = Markup('<button type="button" class="wide" onclick="{}">Full screen</button>').format(
        "this.closest('.animation').querySelector('iframe').requestFullscreen()"
    )
    how = paragraph("Drag to turn, scroll to zoom; the bar plays, pauses and seeks.")
    below = Markup('<div class="below">{}{}</div>').format(how, button)
    return Section("Animation", Markup('<div class="animation">{}</div>').format(join([frame, below])), lead)
