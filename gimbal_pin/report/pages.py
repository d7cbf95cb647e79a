"""How each record looks: its sections, one list for terminal, notebook and page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial, singledispatch
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from gimbal_pin.control.controller_names import OURS
from gimbal_pin.control.judging import Judgement
from gimbal_pin.control.tracking import Tracking
from gimbal_pin.control.tuning import Tuning
from gimbal_pin.diagnosis import Diagnosis, Rehearsal
from gimbal_pin.dynamics.base_parameters import Base
from gimbal_pin.dynamics.checking import Checked
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.excitation import Excitation, ExpectedEstimate
from gimbal_pin.fleet import Fleet, MonteCarlo
from gimbal_pin.identification import IdentificationResult, Several, compare_payload
from gimbal_pin.log.io.inspection import Inspected
from gimbal_pin.log.log import Log
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.result import Pointing, Verified
from gimbal_pin.report import plots
from gimbal_pin.report.elements import Document, Section, embed, join, paragraph, unfold
from gimbal_pin.report.evaluation import evaluate
from gimbal_pin.report.format import figures, file_name, list_shown_joints
from gimbal_pin.report.sections.camera import name_clock, show_camera
from gimbal_pin.report.sections.control import show_controller, show_judgement, show_tracking
from gimbal_pin.report.sections.data import (
    picture_log,
    show_base,
    show_check,
    show_file,
    show_logs,
    show_rig,
)
from gimbal_pin.report.sections.diagnosis import find_worst_stretch, picture_torques, show_diagnosis
from gimbal_pin.report.sections.excitation import show_excitation, show_expectation, show_rehearsal
from gimbal_pin.report.sections.fleet import describe_fleet, describe_monte_carlo
from gimbal_pin.report.sections.model import show_cameras, show_model, show_parameters, show_torque
from gimbal_pin.report.view import Animation, animate
from gimbal_pin.report.view.gaze import outlook
from gimbal_pin.report.view.motion import motion
from gimbal_pin.report.view.scene import onboard, render_scene, scene
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
    rig: Rig,
    sections: Sequence[Section],
    logs: Sequence[Log] = (),
    weighed: float | None = None,
    scene: Callable[[str | Path | None], object] | None = None,
) -> Document:
    """Return sections under a rig's name, and behind them as details the logs and the rig that they are of.

    What moves is the `scene`, or the first of the logs.
    """
    moved = partial(animate, logs[0], rig.stated) if logs and scene is None else scene
    inputs = [show_logs(rig, logs)] if logs else []
    return Document(
        rig.title,
        rig.config.description,
        [*sections, *inputs, show_rig(rig.stated, weighed)],
        scene=moved,
    )


@describe_record.register
def describe_identified(found: IdentificationResult) -> Document:
    """Return the parameters, and the torque that they predict; pictures where the logs are at hand."""
    evaluated = evaluate(found, found.data) if found.data else None
    sections = [
        show_parameters(found, compare_payload(found, found.mass), evaluated),
        show_torque(found, evaluated),
    ]
    return build_document(found.model.rig, sections, found.data, found.mass)


@describe_record.register
def describe_diagnosis(found: Diagnosis) -> Document:
    """Return what the simulation gets wrong."""
    lead = "A link is the redder, the more torque the refitted model leaves at the joint that moves it."
    is_played = found.held_out is not None and bool(found.data)
    played = (
        [Section("Animation", [PlayedResidual(found)], lead, is_detail=True)] if is_played else []
    )
    return build_document(
        found.after.rig, [show_diagnosis(found), *played], found.data, found.given.weighed
    )


@describe_record.register
def describe_tuning(found: Tuning) -> Document:
    """Return gains, margins and loops."""
    return build_document(found.model.rig, [show_controller(found)])


describe_record.register(Fleet, describe_fleet)
describe_record.register(MonteCarlo, describe_monte_carlo)


@describe_record.register
def describe_several(found: Several) -> Document:
    """Return several cameras on one gimbal."""
    return build_document(found.first.model.rig, [show_cameras(found)])


@describe_record.register
def describe_model(found: Model) -> Document:
    """Return a model's causes."""
    return build_document(found.rig, [show_model(found)])


@describe_record.register
def describe_judgement(found: Judgement) -> Document:
    """Return how controllers follow on perturbed plants."""
    return build_document(found.rig, [show_judgement(found)])


@describe_record.register
def describe_tracking(found: Tracking) -> Document:
    """Return the steps of controllers."""
    return build_document(
        found.rig,
        [show_tracking(found)],
        scene=partial(animate, found.experiments[0].log, found.rig),
    )


@describe_record.register
def describe_verified(found: Verified) -> Document:
    """Return how still a camera is held, and the rig on its platform."""
    lead = "The platform turns, the camera stands; in blue the same rig with its joints locked."
    run = get_shown_run(found)
    log = Log(name_clock(found), run.joints, run.t, run.q, tau=run.tau)
    drawn = picture_log(list_shown_joints(found.rig), log, "The whole run over time, simulated.")
    played = show_animation(partial(render_held, found), lead, log.name, drawn)
    return build_document(
        found.rig, [show_camera(found), played], scene=partial(animate_held, found)
    )


@describe_record.register
def describe_excitation(found: Excitation) -> Document:
    """Return a motion and what it uses of the limits."""
    motion = found.motion
    tau = nominal(found.rig).inverse_dynamics(motion.q, motion.v, motion.a)
    moved = Log("motion", found.joints, motion.t, motion.q, motion.v, tau)
    drawn = picture_log(
        list_shown_joints(found.rig), moved, "The motion, and the torque that it takes by the URDF."
    )
    shown = show_excitation(found)
    sections = [replace(shown, parts=[*shown.parts, drawn])]
    return build_document(found.rig, sections, scene=partial(animate, moved, found.rig))


@describe_record.register
def describe_expected(found: ExpectedEstimate) -> Document:
    """Return what a log of a motion will tell."""
    return Document("A log that is planned", "", [show_expectation(found)])


@describe_record.register
def describe_rehearsal(found: Rehearsal) -> Document:
    """Return which causes a log of a motion would show."""
    return Document(found.rig, "", [show_rehearsal(found)])


@describe_record.register
def describe_base(found: Base) -> Document:
    """Return base parameters."""
    return Document(found.rig, "", [show_base(found)])


@describe_record.register
def describe_check(found: Checked) -> Document:
    """Return a rig that was checked."""
    return Document(found.rig.title, found.rig.config.description, [show_check(found)])


@describe_record.register
def describe_given_rig(rig: Rig) -> Document:
    """Return a rig as its URDF and YAML state it."""
    return Document(rig.title, rig.config.description, [replace(show_rig(rig), is_detail=False)])


@describe_record.register
def describe_log(log: Log) -> Document:
    """Return what a log covers."""
    shown = show_logs(None, [log])
    return Document(log.name, "", [Section("Log", [*unfold(shown.parts)])])


@describe_record.register
def describe_inspected(found: Inspected) -> Document:
    """Return what a file holds."""
    return Document(found.name, "", [show_file(found)])


def get_shown_run(held: Verified) -> Pointing:
    """Return the first run under computed torque."""
    (run,) = [row.runs[0] for row in held.rows if row.controller == OURS]
    return run


def render_held(held: Verified) -> str:
    """Return the page that shows the rig, held by computed torque, on the platform."""
    return onboard(held.rig, get_shown_run(held), outlook(held, WANTED), WANTED)


def animate_held(held: Verified, path: str | Path | None) -> Animation:
    """Return the same as an animation, and write it where a path is given: as a page, it has no other format."""
    shot = Animation(held.rig.title, render_held(held))
    if path is not None:
        shot.write(path)
    return shot


@dataclass(frozen=True)
class PlayedPage:
    """A page in a page, which plays; it is rendered when a page shows it, and lies in its file.

    Attributes:
        render: Makes it.
        clock: Name of the run that it plays, see `charts.Charts`.
    """

    render: Callable[[], str]
    clock: str

    def __html__(self) -> str:
        """Return it as an element of a page."""
        button = Markup(
            '<button type="button" class="wide" onclick="{}">Full screen</button>'
        ).format("this.closest('.animation').querySelector('iframe').requestFullscreen()")
        how = paragraph("Drag to turn, scroll to zoom; the bar plays, pauses and seeks.")
        whole = Markup('<div class="animation">{}<div class="below">{}{}</div></div>')
        return whole.format(embed(self.render(), "Animation", "scene", self.clock), how, button)

    def __str__(self) -> str:
        """Return no lines."""
        return ""


@dataclass(frozen=True, eq=False)
class PlayedResidual:
    """The log, or the stretch of it, of which the refitted model leaves most torque; torque and residual of all of it.

    Attributes:
        found: The diagnosis, with its logs.
    """

    found: Diagnosis

    @cached_property
    def parts(self) -> tuple[PlayedPage, plots.Drawing, str]:
        """What plays, what is drawn, and which log that is."""
        rig = self.found.before.rig
        (log, part) = find_worst_stretch(self.found)
        name = file_name(log.name)

        def render() -> str:
            shown = motion(rig, part, 30.0, 1.0, True)
            return render_scene(rig, name, shown, scene(rig, shown))

        count = len(self.found.data)
        ends = f"{figures(float(part.t[0]))} to {figures(float(part.t[-1]))} s"
        of = (
            f"of {count} logs that of which the model leaves most"
            if count > 1
            else "all of the log"
        )
        said = of if len(part) == len(log) else f"{ends}, where the model leaves most"
        return (
            PlayedPage(render, log.name),
            picture_torques(self.found, log),
            f"Shown is {name}: {said}.",
        )

    def __html__(self) -> str:
        """Return it as an element of a page."""
        played, drawn, said = self.parts
        return join([paragraph(said, "side"), played, drawn])

    def __str__(self) -> str:
        """Return no lines."""
        return ""

    def draw(self) -> plots.Figure:
        """Return torque and residual as a figure."""
        return self.parts[1].draw()


def show_animation(
    render: Callable[[], str], lead: str, clock: str, drawn: plots.Drawing
) -> Section:
    """Return a section that plays a recording in a frame of its own.

    `render` makes its page; `clock`: name of the run, whose curves `drawn` has.
    """
    return Section("Animation", [PlayedPage(render, clock), drawn], lead)
