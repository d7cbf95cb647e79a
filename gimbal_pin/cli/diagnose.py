"""``gimbal-pin diagnose``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import choose_filter, describe_origin, describe_run, load_logs
from gimbal_pin.cli.paths import Writes
from gimbal_pin.cli.present import present, tell


def list_diagnosis_files(given: Mapping[str, Any]) -> list[str]:
    """Return the names of the files that `diagnose` may put into a folder."""
    from gimbal_pin.diagnosis.file import DIAGNOSIS_FILES

    return list(DIAGNOSIS_FILES.values())


def diagnose(
    rig: opt.RigName,
    logs: opt.Logs,
    output: Annotated[opt.Folder, Writes(run=list_diagnosis_files), opt.INTO] = None,
    *,
    urdf: opt.Urdf = None,
    mjcf: opt.Mjcf = None,
    mcap: opt.Mcap = None,
    rrd: opt.Rrd = None,
    payload: opt.Payload = None,
    mass: opt.Mass = None,
    map: opt.Map = (),
    cutoff: Annotated[opt.Maybe[float], opt.CUTOFF_RANGE] = None,
    alignment: opt.Alignment = None,
    holdout: opt.Holdout = None,
    seed: opt.Seed = 0,
    json: opt.Json = None,
) -> None:
    """What the simulation gets wrong, why, the extended model and its gain; -o: a report and the next experiment, too.

    It looks for, of friction: stribeck, asymmetric-friction, load-dependent-friction, presliding,
    position-dependent-friction, friction-drift, quadratic-drag; of motor and drive: cogging, torque-ripple,
    torque-gain, torque-bias, actuator-lag, delay, saturation, dead-zone; of structure: cable-spring,
    joint-flexibility, backlash, armature; of the rig: encoder-offset, base-tilt, platform-motion, and, where its YAML
    says `inertia: trusted`, payload-shift, payload-mass, off-diagonal-inertia; of the data: acceleration-noise,
    clock, commanded-torque, controller-formula, filtered-velocity, stuck-channel, outliers.

    Args:
        urdf: write the rig's URDF with the bodies and friction of the extended model
        mjcf: write the extended model for MuJoCo; what that cannot hold is told
        cutoff: highest frequency that is looked at (default: 12, more for teeth)
    """
    asked = describe_run("diagnose", locals())
    origin = describe_origin(diagnose, locals())
    import numpy as np

    from gimbal_pin.diagnosis import DIAGNOSIS_BAND, choose_band, planned
    from gimbal_pin.diagnosis import diagnose as run
    from gimbal_pin.diagnosis.file import DIAGNOSIS_FILES, list_writers, write_diagnosis
    from gimbal_pin.export.mjcf import convert_to_mjcf
    from gimbal_pin.export.recordings import check_recordings, write_recordings
    from gimbal_pin.identification import identify, refittable_effects
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.report.pages import describe_record

    check_recordings(mcap, rrd)
    loaded, read = load_logs(rig, payload, logs, map, moving=True)
    band = choose_band(loaded, read) if cutoff is None else replace(DIAGNOSIS_BAND, cutoff=cutoff)
    band = replace(band, alignment=alignment)
    rng = np.random.default_rng(seed)
    found = run(loaded, read, rng=rng, holdout=holdout, filtering=band, mass=mass)
    if urdf is not None:
        causes = refittable_effects(found.after)
        filters = choose_filter(None, alignment)
        atomic_write(
            urdf,
            identify(
                loaded, read, causes, holdout=holdout, filtering=filters, examined="never"
            ).to_urdf(),
        )
    if mjcf is not None:
        stands = found.after.rig.with_phi(loaded.phi)
        filters = choose_filter(None, alignment)
        again = identify(
            stands,
            read,
            refittable_effects(found.after),
            holdout=holdout,
            filtering=filters,
            examined="never",
        )
        terms = {term.effect: term for term in (*found.after.terms, *again.model.terms)}
        bodies = stands.with_phi(again.consistent.phi)
        text, unwritten = convert_to_mjcf(
            replace(found.after, rig=bodies, terms=tuple(terms.values()))
        )
        atomic_write(mjcf, text)
        tell(unwritten)
    if found.state is not None:
        write_recordings(found.after, read, band, mcap, rrd)
    else:
        named = [str(file) for file in (mcap, rrd) if file is not None]
        tell(
            [
                f"{file} is not written: nothing of the model holds before the logs are mended"
                for file in named
            ]
        )
    files: Mapping[str, Path] = {}
    if output is not None:
        found = planned(found, rng=np.random.default_rng(seed))
        written = {what: DIAGNOSIS_FILES[what] for what in (*list_writers(found), "diagnosis")}
        page = replace(describe_record(found), origin=replace(origin, files=written)).to_html()
        files, notes = write_diagnosis(found, output, page, asked)
        tell(notes)
    lie = "\n".join(f"{what}: {path}" for what, path in files.items())
    present(f"{describe_record(found).to_text()}\n\n{lie}".rstrip("\n"), found.to_dict(), json)
