"""What `track` found as one report: the camera on a moving platform, and steps."""

from __future__ import annotations

from dataclasses import replace

from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.outlook import outlook, shown
from gimbal_pin.pointing.verify import Verified
from gimbal_pin.report import sections
from gimbal_pin.report.base import Section, render
from gimbal_pin.rig import Rig
from gimbal_pin.tracking import Tracking
from gimbal_pin.view.onboard import onboard

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
