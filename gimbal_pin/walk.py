"""All of it: logs → model → what it gets wrong → tuned controller → verified in simulation → report and animation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin import report, view
from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.effects import RigEffect, Signal, Term
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import DataError
from gimbal_pin.estimators import Estimator, weighted
from gimbal_pin.experiment import bench_run, perturbed
from gimbal_pin.identification import Identified, identify
from gimbal_pin.io import write_log
from gimbal_pin.io.files import atomic_write, output_folder, write_json, write_yaml
from gimbal_pin.io.model import write_model
from gimbal_pin.log import Log
from gimbal_pin.model import Model, nominal
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Filtering
from gimbal_pin.simulation import plant_with, simulate
from gimbal_pin.tracking import Tracking, track
from gimbal_pin.trajectories import tour
from gimbal_pin.tuning import Tuning, tune

MODEL_BASED, PID = "computed-torque", "pid"
COGGING, TEETH = 0.01, 12
"""Share of the largest torque, and teeth where the motor's slots are not stated, that the demo's motor cogs with."""
MODEL_PLANT, TRUE_PLANT = "the identified model", "the true rig, which the model has not seen"


@dataclass(frozen=True, eq=False)
class Auto:
    """The result of `auto`: every step's result, and the files it left.

    Attributes:
        identified: Model from the logs.
        diagnosis: What that model gets wrong; None where the logs are too short to say.
        tunings: "computed-torque" and "pid", at the same bandwidth.
        tracking: Steps with both on the identified model.
        animated: The log that the animation shows: all axes to and fro, model-based.
        files: What → path.
        plant: What the steps were simulated on, in words.
    """

    identified: Identified
    diagnosis: Diagnosis | None
    tunings: Mapping[str, Tuning]
    tracking: Tracking
    animated: Log
    files: Mapping[str, Path]
    plant: str

    def to_dict(self) -> dict[str, Any]:
        """Return the verbs' JSON side by side."""
        return {
            "schema": 1,
            "identify": self.identified.to_dict(),
            "diagnose": None if self.diagnosis is None else self.diagnosis.to_dict(),
            "tune": self.tunings[MODEL_BASED].to_dict(),
            "track": self.tracking.to_dict(),
            "files": {what: str(path) for what, path in self.files.items()},
        }


def auto(
    rig: Rig,
    logs: Sequence[Log],
    folder: str | Path,
    *,
    rng: np.random.Generator,
    estimator: Estimator = weighted,
    holdout: str | None = None,
    filtering: Filtering | None = None,
    bandwidth_hz: float = 8.0,
    delay: float = 0.001,
    plant: Model | None = None,
) -> Auto:
    """Identify, tune, verify, and write model, URDF, controller, report and animation into `folder`.

    Args:
        rig: The rig.
        logs: Its logs.
        folder: Where the files go; made if it is not there.
        rng: Source of the sensors' noise in the verification.
        estimator: Blocks → `Estimate`.
        holdout: As for `identify`.
        filtering: As for `identify`.
        bandwidth_hz: As for `tune`.
        delay: As for `tune`.
        plant: The plant that the steps are verified on; None: the identified model.

    Raises:
        GimbalPinError: Whatever keeps one of the steps from answering; nothing is written then.
    """
    identified = identify(rig, logs, estimator=estimator, holdout=holdout, filtering=filtering, examined=True)
    model, wrong = identified.model, examined(rig, logs, rng, holdout)
    tunings = {kind: tune(model, bandwidth_hz=bandwidth_hz, delay=delay, kind=kind) for kind in (MODEL_BASED, PID)}
    tracking = track(plant or model, {kind: tuning.controller for kind, tuning in tunings.items()}, rng=rng)
    law = tunings[MODEL_BASED].controller
    animated = simulate(model, law, tour(model, law.dt), rng=rng, name="all axes to and fro, model-based")
    stood = MODEL_PLANT if plant is None else TRUE_PLANT
    found = Auto(identified, wrong, tunings, tracking, animated, paths(rig, output_folder(folder)), stood)
    write(rig, logs, found)
    return found


def examined(rig: Rig, logs: Sequence[Log], rng: np.random.Generator, holdout: str | None) -> Diagnosis | None:
    """Diagnose logs, if they are long enough for it."""
    try:
        return diagnose(rig, logs, rng=rng, holdout=holdout)
    except DataError:
        return None


def paths(rig: Rig, folder: Path) -> Mapping[str, Path]:
    """Return what `write` leaves in a folder, and where."""
    names = {"model": "model.yaml", "urdf": f"{rig.name}.urdf", "controller": "controller.yaml", "motion": "motion.csv"}
    names |= {"animation": "animation.html", "report": "report.html", "results": "results.json"}
    return {what: folder / name for what, name in names.items()}


def write(rig: Rig, logs: Sequence[Log], found: Auto) -> None:
    """Write every file."""
    files, identified = found.files, found.identified
    animation = view.record(rig, found.animated)
    wrong = () if found.diagnosis is None else (report.sections.diagnosis(found.diagnosis),)
    page = report.full(rig, logs, identified, found.tunings, found.tracking, animation, wrong, plant=found.plant)
    write_model(identified, files["model"])
    atomic_write(files["urdf"], identified.to_urdf())
    write_yaml(found.tunings[MODEL_BASED].to_dict(), files["controller"])
    write_log(found.animated, files["motion"])
    atomic_write(files["animation"], animation)
    atomic_write(files["report"], page)
    write_json(found.to_dict(), files["results"])


def hidden(rig: Rig) -> Term | Signal | RigEffect:
    """Return what the demo hides: teeth of the first joint's motor, at one per cent of its largest torque."""
    limit = rig.tau_max[0] if np.isfinite(rig.tau_max[0]) else 1.0
    teeth = rig.motors[0].slots or TEETH
    return parse_effect(f"cogging:{rig.joints[0]}:amplitude={COGGING * limit:.3g},harmonic={teeth}", rig)


def demo(rig: Rig, folder: str | Path, *, rng: np.random.Generator, seconds: float = 22.0) -> Auto:
    """Simulate a log of a rig that differs from its URDF, and run `auto` on it.

    The plant's bodies differ by some ten per cent and its friction by up to a third, and the first joint's motor cogs:
    what `auto` is given is the URDF and the log alone. The steps are verified on the true plant.
    """
    plant = plant_with(perturbed(rig, 0.1, rng), [hidden(rig)]).plant
    mover = tune(nominal(rig), bandwidth_hz=4.0).controller
    log = bench_run(plant, mover, rng=rng, seconds=seconds, name=f"simulated {rig.name}, {seconds:g} s")
    return auto(rig, [log], folder, rng=rng, plant=plant)
