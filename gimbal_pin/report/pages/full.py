"""Whole reports: of a walk from logs to a controller, and of a camera on a platform that moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from tqdm import tqdm

from gimbal_pin.control.tracking import Tracking
from gimbal_pin.control.tuning import Tuning
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.estimation.identification import Identified
from gimbal_pin.log.log import Log
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.outlook import outlook, shown
from gimbal_pin.pointing.verify import Verified
from gimbal_pin.report.pages import sections
from gimbal_pin.report.pages.base import Section, render
from gimbal_pin.report.pages.evaluation import evaluate
from gimbal_pin.report.pages.html import paragraph
from gimbal_pin.report.pages.sections.diagnosis import WRONG
from gimbal_pin.report.view.names import controller_name
from gimbal_pin.report.view.onboard import onboard
from gimbal_pin.rig.rig import Rig

STEPS = "All axes to and fro under {}; the ghost is the reference."
HELD = "The plant is {}; the controllers know the model and no more, with gains of their own for holding a camera."
NOT_DIAGNOSED = "These logs could not be diagnosed. {}."
NOT_HELD = "It was not held still on a platform that moves: {}."


def full(
    rig: Rig,
    logs: Sequence[Log],
    found: Identified,
    tunings: Mapping[str, Tuning],
    result: Tracking,
    animation: str,
    wrong: Diagnosis | None = None,
    plant: str = "the identified model",
    held: Verified | None = None,
    held_on: str = "the identified model",
    why: str = "",
    undiagnosed: str = "",
) -> str:
    """Return the report of a whole walk, from logs to a tuned controller, as HTML.

    The animation shows the first of the tunings. `plant` and `held_on` say within a sentence what the steps, and the
    camera on a moving platform, were simulated on; `why`: why the camera was not held, and
    `undiagnosed`: why the logs were not diagnosed, if that is to be said.
    """
    evaluated, law = evaluate(found, logs), next(iter(tunings.values())).wish.kind
    steps: list[Callable[[], Section]] = [
        lambda: sections.summary(rig, found, next(iter(tunings.values())), result, logs, plant=plant, wrong=wrong),
        lambda: sections.animation(animation, STEPS.format(controller_name(law))),
        lambda: sections.rig_section(rig),
        lambda: sections.data(rig, logs),
        lambda: sections.parameters(found, evaluated, rig),
        lambda: sections.torque(found, evaluated),
        *([] if wrong is None else [partial(sections.diagnosis, wrong)]),
        *([partial(Section, WRONG, paragraph(NOT_DIAGNOSED.format(undiagnosed)))] if undiagnosed else []),
        lambda: sections.margins(*tunings.values()),
        lambda: sections.tracking(result, rig, plant),
        *([] if held is None else [partial(sections.pointing, held, HELD.format(held_on))]),
        *([partial(Section, "Camera", paragraph(NOT_HELD.format(why)))] if why else []),
    ]
    every = [step() for step in tqdm(steps, desc="report", unit="section", disable=None, leave=False)]
    return render(rig.title, every, rig.config.description)


def diagnosed(rig: Rig, logs: Sequence[Log], found: Diagnosis, command: str = "") -> str:
    """Return the report of a diagnosis alone as HTML; `command`: the call that asked for it."""
    parts = [sections.diagnosis(found, command), sections.data(rig, logs), sections.rig_section(rig)]
    return render(rig.title, parts, rig.config.description)


SCENE = "The platform turns, the camera stands; in blue the same rig with its joints locked."
OTHER = "Camera, recorded motion"


def carried(rig: Rig, held: Verified | None, steps: Tracking | None, plant: str) -> str:
    """Return the report of a tracking as HTML.

    `plant`: what the steps were simulated on, within a sentence.
    """
    parts: list[Section] = []
    if held is not None:
        parts += [sections.pointing(replace(held, recorded=None)), sections.animation(moving(rig, held), SCENE)]
        alone = [replace(held, contest=other, recorded=None, targets=()) for other in held.contests[1:]]
        parts += [sections.pointing(one, title=OTHER) for one in alone]
        parts += [] if held.steps is None else [sections.tracking(held.steps, rig, "that of the camera")]
    if steps is not None:
        parts.append(sections.tracking(steps, rig, plant))
    return render(rig.title, [*parts, sections.rig_section(rig)], rig.config.description)


def moving(rig: Rig, held: Verified) -> str:
    """Return the page that shows the rig, held by the best of the controllers, on the platform."""
    run = shown(held.contest)[-1].runs[0]
    return onboard(rig, run, outlook(held.contest, WANTED), WANTED)
