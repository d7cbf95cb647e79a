"""All of it: logs → model → what it gets wrong → tuned controller → verified in simulation → report and animation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.control.experiment import bench_run, perturbed
from gimbal_pin.control.judging import Judgement, judge_controllers
from gimbal_pin.control.laws.design import Wish
from gimbal_pin.control.tracking import Tracking, tour, track
from gimbal_pin.control.tuning import TunedLaw, Tuning, pair_rivals, tune, write_controller
from gimbal_pin.diagnosis import Diagnosis, diagnose, plan_next_experiment
from gimbal_pin.diagnosis.file import DIAGNOSIS_FILES as DIAGNOSED
from gimbal_pin.diagnosis.file import list_writers
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.simulation import plant_with, simulate
from gimbal_pin.effects import RigEffect, Signal, Term
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import DataError, UsageError
from gimbal_pin.identification import (
    IdentificationResult,
    PayloadStatement,
    Several,
    compare_payload,
    identify,
    identify_new,
    refittable_effects,
    report_with_payload,
)
from gimbal_pin.identification.model_file import write_model
from gimbal_pin.log.io import write_log
from gimbal_pin.log.io.files import atomic_write, write_json, write_run
from gimbal_pin.log.log import Log
from gimbal_pin.pointing import Verified, verify
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.sight import unable
from gimbal_pin.regression import Estimator, Filtering
from gimbal_pin.report import view
from gimbal_pin.report.diagnosis_text import report_diagnosis
from gimbal_pin.report.elements import Document, Section, paragraph
from gimbal_pin.report.evaluation import evaluate
from gimbal_pin.report.format import controller_name, list_shown_joints, listed, to_sentence
from gimbal_pin.report.origin import Origin
from gimbal_pin.report.pages import build_document, describe_record, render_held, show_animation
from gimbal_pin.report.sections.camera import show_camera
from gimbal_pin.report.sections.control import show_controller, show_judgement, show_tracking
from gimbal_pin.report.sections.data import picture_log
from gimbal_pin.report.sections.diagnosis import WRONG, show_diagnosis
from gimbal_pin.report.sections.model import show_parameters, show_torque
from gimbal_pin.report.summary import Summary, summary
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator

COGGING, TEETH = 0.01, 12
"""Share of the largest torque, and teeth where the motor's slots are not stated, that the demo's motor cogs with."""
MODEL_PLANT, TRUE_PLANT = "the identified model", "the true rig, which the model has not seen"
EXTENDED_PLANT = "the extended model"
BARRED = "its controller is not to be run"
"""Why no camera is held by a controller whose model is open."""
DRAWN_PLANT = "a rig that the model's covariance leaves possible"
HELD_FOR = 4.5
"""For how long the camera is held on a platform, s: enough for a picture, no benchmark."""

FILES = {
    "model": "model.yaml",
    "controller": "controller.yaml",
    "motion": "motion.csv",
    "animation": "animation.html",
    "camera": "camera.html",
    "results": "results.json",
    **{what: DIAGNOSED[what] for what in ("extended model", "next experiment", "report")},
}
"""What `auto` writes → the file's name; beside these the URDF, named after the rig."""


@dataclass(frozen=True, eq=False)
class Auto(Record):
    """The result of `auto`: every step's result, and the files it left.

    Attributes:
        identified: Model from the logs.
        diagnosis: What that model gets wrong; None where the logs are too short to say.
        model: What the controllers were made for: the identified model, or the extended one where causes were found.
        tuning: The controller.
        tracking: Steps with it and a PID of the same disk margin, see `pair_rivals`.
        judged: The same on perturbed plants.
        animated: The log that the animation shows: all axes to and fro, with the controller that was asked for.
        files: What → path.
        plant: What the steps were simulated on, in words.
        summary: What was found, what to do and what not to trust.
        payload: What the log says of the payload: the diagnosis's answer where there is one, for it knows more.
        held: The camera held on a moving platform; None where that cannot be.
        why: Why it cannot, or nothing.
        undiagnosed: Why there is no diagnosis, or nothing.
        notes: What `write_run` says of files of an earlier run.
        beside: The identification with the causes that were found in the equations; None where there are none.
        camera: The new camera on a known gimbal, whose model `identified` is; None where no gimbal was known.
        seed: Repeats it as `rng`; None where a generator was given.
    """

    identified: IdentificationResult
    diagnosis: Diagnosis | None
    model: Model
    tuning: Tuning
    tracking: Tracking
    judged: Judgement
    animated: Log
    files: Mapping[str, Path]
    plant: str
    summary: Summary
    payload: PayloadStatement
    held: Verified | None = None
    why: str = ""
    undiagnosed: str = ""
    notes: tuple[str, ...] = ()
    beside: IdentificationResult | None = None
    camera: Several | None = None
    seed: int | None = None

    ROWS: ClassVar[str] = "identify.base_parameters"
    __repr__ = brief

    @cached_property
    def recording(self) -> str:
        """The page of the animation."""
        return view.record(self.model.rig, self.animated)

    @property
    def held_on(self) -> str:
        """What the camera was held on, in words."""
        return TRUE_PLANT if self.plant == TRUE_PLANT else DRAWN_PLANT

    def _report_identified(self) -> dict[str, Any]:
        """Return what `identify --json` writes."""
        return (
            report_with_payload(self.identified, self.payload)
            if self.camera is None
            else self.camera.to_dict()
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the verbs' JSON side by side."""
        return {
            "schema": 1,
            "identify": self._report_identified(),
            "diagnose": None if self.diagnosis is None else report_diagnosis(self.diagnosis),
            "tune": {**self.tuning.to_dict(), "judged": self.judged.to_dict()},
            "track": {
                **self.tracking.to_dict(),
                **({} if self.held is None else self.held.to_dict()),
            },
            "not_held": self.why or None,
            "not_diagnosed": self.undiagnosed or None,
            "files": {what: str(path) for what, path in self.files.items()},
        }


@describe_record.register
def describe_auto(found: Auto) -> Document:
    """Return what every step of a run found, from logs to a tuned controller."""
    wrong = found.diagnosis
    held = found.held
    identified = found.identified
    evaluated = evaluate(identified, identified.data) if identified.data else None
    if wrong is not None and not wrong.spoiling:  # the diagnosis states what is left at each joint
        identified = replace(identified, missed={})
    sections = [found.summary.section]
    if wrong is not None:
        sections.append(show_diagnosis(wrong))
    if found.undiagnosed:
        sections.append(
            Section(WRONG, [paragraph(f"These logs could not be diagnosed. {found.undiagnosed}.")])
        )
    lead = f"All axes to and fro under {controller_name(found.tuning.wish.kind)}; the ghost is the reference."
    drawn = picture_log(
        list_shown_joints(found.model.rig), found.animated, "The same over time, simulated."
    )
    sections += [
        show_animation(lambda: found.recording, lead, found.animated.name, drawn),
        show_parameters(identified, found.payload if wrong is None else None, evaluated),
        show_torque(identified, evaluated),
        show_controller(found.tuning),
        show_judgement(found.judged),
        show_tracking(replace(found.tracking, plant=found.plant)),
    ]
    if held is not None:
        note = f"The plant is {found.held_on}; the controllers know the model and no more."
        sections.append(show_camera(replace(held, note=note)))
    moved = partial(view.animate, found.animated, found.model.rig)
    sections[1:] = [replace(one, is_folded=True) for one in sections[1:]]
    return build_document(found.model.rig, sections, identified.data, found.payload.weighed, moved)


def describe_outcome(found: Auto, verbose: bool = False) -> str:
    """Return what `auto` prints: the head in 14 lines, or with `verbose` all that needs no picture; where files lie."""
    names = listed(path.name for what, path in found.files.items() if what != "report")
    path = found.files["report"]
    lie = f"open {path}; beside it in {path.parent}: {names}"
    text = (
        f"{describe_auto(found).to_text(detailed=True)}\n" if verbose else found.summary.describe()
    )
    return f"{text}\n{lie}"


@check_arguments
def auto(
    rig: Rig,
    logs: Log | Sequence[Log],
    folder: str | Path,
    *,
    rng: Rng = None,
    estimator: Estimator | str = "weighted",
    holdout: str | None = None,
    filtering: Filtering | None = None,
    wish: Callable[[Model], Wish] = Wish.of,
    plant: Model | None = None,
    run: Mapping[str, object] | None = None,
    mass: float | None = None,
    plants: int = 50,
    known: Model | None = None,
    origin: Origin | None = None,
) -> Auto:
    """Identify, diagnose, tune, verify, and write models, URDF, controller, report and animation into `folder`.

    Controllers are made for what was found: where the diagnosis finds causes that the identified model lacks, for the
    extended model.

    Args:
        rig: The rig.
        logs: One log of it, or several.
        folder: Where the files go; made if it is not there.
        rng: Source of the sensors' noise in the verification, or its seed; None: a fresh one,
            whose seed is in the result.
        estimator: As for `identify`.
        holdout: As for `identify`.
        filtering: As for `identify`.
        wish: Model → what is asked of `tune`.
        plant: The plant that the steps are verified on; None: the model that the controllers were made for.
        run: What the folder's ``run.json`` says of the run, see `write_run`.
        mass: Of the payload, kg, where it was weighed.
        plants: On how many perturbed plants the controller is judged.
        known: A model of this gimbal with another camera: only the new camera is estimated, see `identify_new`.
        origin: What the report's head says of the call.

    Raises:
        GimbalPinError: Whatever keeps one of the steps from answering; nothing is written then.
    """
    logs = [log.ordered(rig) for log in ([logs] if isinstance(logs, Log) else logs)]
    fit = partial(identify, rig, logs, estimator=estimator, holdout=holdout, filtering=filtering)
    camera = None
    if known is not None:
        camera = identify_new(
            rig, logs, known, estimator=estimator, holdout=holdout, filtering=filtering
        )
        camera = replace(camera, mass=mass)
    identified = (
        fit(examined="noisy") if camera is None else replace(camera.first, data=tuple(logs))
    )
    generator, seed = make_generator(rng)
    wrong, undiagnosed = None, ""
    try:
        wrong = diagnose(rig, logs, holdout=holdout, mass=mass)
        wrong = plan_next_experiment(wrong, generator)
    except DataError as error:
        undiagnosed = str(error)
    extended = wrong is not None and finds_more(wrong, known)
    model = wrong.after if wrong is not None and extended else identified.model
    asked = wish(model)
    first = tune(model, **vars(asked))
    late = asked.samples
    laws = pair_rivals(first.stored)
    law = first.controller
    tracking = track(plant or model, laws, rng=generator, delay=late)
    judged = judge_controllers(model, laws, rng=generator, plants=plants, delay=asked.delay)
    animated = simulate(
        model, law, tour(model, law.dt), rng=generator, name="all axes to and fro", delay=late
    )
    held, why = (
        (None, BARRED)
        if first.doubts
        else hold_camera(rig, logs[0], model, law, plant, asked.holding_samples)
    )
    stood = TRUE_PLANT if plant is not None else EXTENDED_PLANT if extended else MODEL_PLANT
    causes = refittable_effects(model) if extended else ()
    beside = fit(causes) if causes else None
    payload = compare_payload(identified, mass) if wrong is None else wrong.given
    if camera is not None and (wrong is None or not wrong.spoiling):
        (payload,) = camera.payloads.values()
    head = summary(
        rig,
        identified,
        first,
        tracking,
        logs,
        stood,
        wrong,
        undiagnosed,
        judged,
        payload,
        held,
        why,
    )
    if camera is not None:
        head = replace(
            head, doubts=(*(to_sentence(said) for said in identified.faults), *head.doubts)
        )
    steps = identified, wrong, model, first, tracking, judged, animated
    found = Auto(
        *steps,
        {},
        stood,
        head,
        payload,
        held,
        why,
        undiagnosed,
        beside=beside,
        camera=camera,
        seed=seed,
    )
    return write_results(rig, found, Path(folder), run or {}, origin)


def finds_more(wrong: Diagnosis, known: Model | None) -> bool:
    """Return whether a diagnosis finds a cause that a known model has not already."""
    if known is None:
        return bool(wrong.lacking)
    causes = (*(term.effect for term in known.terms), *known.changes)
    found = {(finding.cause, finding.joint or "rig") for finding in wrong.lacking}
    return not found <= {(cause.name, cause.place) for cause in causes}


def hold_camera(
    rig: Rig, log: Log, model: Model, law: TunedLaw, plant: Model | None, late: int
) -> tuple[Verified | None, str]:
    """Hold the camera on profile S, briefly; return what came of it, or why it cannot be.

    By the tuned controller, and by a PID. Without a plant it is one that the model's covariance leaves possible.
    """
    if reason := unable(rig, WANTED):
        return None, reason
    if not rig.config.imus:
        return None, "the rig names no IMUs, which holding takes: imus in its YAML"
    try:
        return verify(
            rig, plant=plant, known=model, law=law, log=log, seeds=1, seconds=HELD_FOR, delay=late
        ), ""
    except UsageError as error:
        return None, str(error)


def write_results(
    rig: Rig, found: Auto, folder: Path, run: Mapping[str, object], origin: Origin | None
) -> Auto:
    """Write every file into a folder; return the results with where they lie, and the notes of `write_run`.

    `origin`: what the report's head says of the call.
    """
    identified = found.identified
    wrong = found.diagnosis
    names = {"urdf": f"{rig.name}.urdf", **FILES}
    diagnosed = {} if wrong is None or wrong.held_out is None else list_writers(wrong)
    absent = {"extended model", "next experiment", "camera"} - diagnosed.keys()
    absent -= {"camera"} if found.held is not None else set()
    found = replace(
        found, files={what: folder / name for what, name in names.items() if what not in absent}
    )
    if origin is not None:
        origin = replace(
            origin,
            files={what: path.name for what, path in found.files.items() if what != "report"},
        )
    writers: dict[str, Callable[[Path], object]] = {
        "model": partial(write_model, identified),
        "urdf": partial(atomic_write, content=(found.beside or identified).to_urdf()),
        "controller": partial(write_controller, found.tuning, folder=folder),
        "motion": partial(write_log, found.animated),
        "animation": partial(atomic_write, content=found.recording),
        "report": partial(
            atomic_write, content=replace(describe_auto(found), origin=origin).to_html()
        ),
        "results": partial(write_json, found.to_dict()),
    }
    if found.held is not None:
        writers["camera"] = partial(atomic_write, content=render_held(found.held))
    notes = write_run(
        folder, {names[what]: write for what, write in (writers | diagnosed).items()}, run
    )
    return replace(found, notes=notes)


def hidden(rig: Rig) -> Term | Signal | RigEffect:
    """Return what the demo hides: teeth of the first joint's motor, at one per cent of its largest torque."""
    limit = rig.tau_max[0] if np.isfinite(rig.tau_max[0]) else 1.0
    teeth = rig.motors[0].slots or TEETH
    return parse_effect(
        f"cogging:{rig.joints[0]}:amplitude={COGGING * limit:.3g},harmonic={teeth}", rig
    )


def demo(
    rig: Rig,
    folder: str | Path,
    *,
    rng: np.random.Generator,
    seconds: float = 22.0,
    run: Mapping[str, object] | None = None,
    plants: int = 50,
    origin: Origin | None = None,
) -> Auto:
    """Simulate a log of a rig that differs from its URDF, and run `auto` on it.

    The plant's bodies differ by some ten per cent and its friction by up to a third, and the first joint's motor cogs:
    what `auto` is given is the URDF and the log alone. The steps are verified on the true plant.
    `run`, `origin`: as for `auto`.
    """
    plant = plant_with(perturbed(rig, 0.1, rng), [hidden(rig)]).plant
    mover = tune(nominal(rig), bandwidth_hz=4.0).controller
    log = bench_run(plant, mover, rng=rng, seconds=seconds, name=f"simulated {rig.name}")
    return auto(rig, [log], folder, rng=rng, plant=plant, run=run, plants=plants, origin=origin)
