"""``gimbal-pin diagnose``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from gimbal_pin.cli.inputs import filtering, load_logs, run_of
from gimbal_pin.cli.options import (
    BAND,
    Alignment,
    Holdout,
    Json,
    Logs,
    Map,
    Mass,
    MaybeFolder,
    Payload,
    RigName,
    Seed,
    optional,
)
from gimbal_pin.cli.paths import Writes
from gimbal_pin.cli.present import noted, present
from gimbal_pin.report import text


def diagnose(
    rig: RigName,
    logs: Logs,
    output: MaybeFolder = None,
    *,
    urdf: Annotated[
        Path | None,
        Writes(suffixes=(".urdf", ".xml")),
        optional("FILE", "write the rig's URDF with the bodies and friction of the extended model"),
    ] = None,
    payload: Payload = None,
    mass: Mass = None,
    map: Map = (),
    cutoff: Annotated[
        float | None, BAND, optional(None, "highest frequency that is looked at", "12, more for teeth")
    ] = None,
    alignment: Alignment = None,
    holdout: Holdout = None,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """What the simulation gets wrong, why, the extended model and its gain; -o: a report and the next experiment, too.

    It looks for, of friction: stribeck, asymmetric-friction, load-dependent-friction, presliding,
    position-dependent-friction, friction-drift, quadratic-drag; of motor and drive: cogging, torque-ripple,
    torque-gain, torque-bias, actuator-lag, delay, saturation, dead-zone; of structure: cable-spring,
    joint-flexibility, backlash, armature; of the rig: encoder-offset, base-tilt, platform-motion, and, where its YAML
    says `inertia: trusted`, payload-shift, payload-mass, off-diagonal-inertia; of the data: acceleration-noise,
    clock, commanded-torque, controller-formula, filtered-velocity, stuck-channel, outliers.
    """
    asked_for = run_of("diagnose", locals())
    import numpy as np

    from gimbal_pin.diagnosis import BAND, planned, usual
    from gimbal_pin.diagnosis import diagnose as run
    from gimbal_pin.diagnosis.file import write_diagnosis
    from gimbal_pin.identification import identify, refittable_effects
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.report import pages

    loaded, read = load_logs(rig, payload, logs, map, moving=True)
    band = usual(loaded, read) if cutoff is None else replace(BAND, cutoff=cutoff)
    band, rng = replace(band, alignment=alignment), np.random.default_rng(seed)
    found = run(loaded, read, rng=rng, holdout=holdout, filtering=band, mass=mass)
    if output is not None:
        found = planned(found, rng=np.random.default_rng(seed))
    if urdf is not None:
        causes, filters = refittable_effects(found.after), filtering(None, alignment)
        bodied = identify(loaded, read, causes, holdout=holdout, filtering=filters)
        atomic_write(urdf, bodied.to_urdf())
    files: Mapping[str, Path] = {}
    if output is not None:
        files, notes = write_diagnosis(found, output, pages.diagnosed(loaded, read, found), asked_for)
        noted(notes)
    present(text.diagnosis(found, files), found.to_dict(), json)
