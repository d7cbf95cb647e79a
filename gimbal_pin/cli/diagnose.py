"""``gimbal-pin diagnose``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import choose_filter, describe_origin, describe_run, load_logs
from gimbal_pin.cli.paths import Writes
from gimbal_pin.cli.present import present, tell

if TYPE_CHECKING:
    from gimbal_pin.diagnosis import Diagnosis
    from gimbal_pin.log.log import Log
    from gimbal_pin.regression import Filtering
    from gimbal_pin.rig.rig import Rig


HeldOutRows = Annotated[
    str | None,
    opt.optional("WHAT", "last-third, log:N or none", "every fifth block of logs of 25 s and more"),
]


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
    holdout: HeldOutRows = None,
    seed: opt.Seed = 0,
    json: opt.Json = None,
) -> None:
    """Find what the simulation gets wrong, why, and what the extended model gains.

    -o writes a report, too, and the next experiment where a finding is ambiguous.

    It looks for, of friction: stribeck, asymmetric-friction, load-dependent-friction, presliding,
    position-dependent-friction, friction-drift, quadratic-drag; of motor and drive: cogging, torque-ripple,
    torque-gain, torque-bias, actuator-lag, delay, saturation, dead-zone; of structure: cable-spring,
    joint-flexibility, backlash, armature; of the rig: encoder-offset, base-tilt, platform-motion, and, where its YAML
    says `inertia: trusted`, payload-shift, payload-mass, off-diagonal-inertia; of the data: acceleration-noise,
    clock, commanded-torque, controller-formula, filtered-velocity, stuck-channel, outliers.

    Args:
        urdf: write the rig's URDF with the bodies and friction of the extended model
        mjcf: write the extended model for MuJoCo; what that cannot hold is told
        cutoff: highest frequency that is looked at (default: 12, less for slow loggers, more for teeth)
    """
    asked = describe_run("diagnose", locals())
    origin = describe_origin(diagnose, locals())
    import numpy as np

    from gimbal_pin.diagnosis import diagnose as run
    from gimbal_pin.diagnosis import plan_next_experiment
    from gimbal_pin.diagnosis.file import DIAGNOSIS_FILES, list_writers, write_diagnosis
    from gimbal_pin.export.recordings import check_recordings, write_recordings
    from gimbal_pin.report.diagnosis_text import report_diagnosis
    from gimbal_pin.report.pages import describe_record
    from gimbal_pin.report.sections.diagnosis import choose_filtering

    check_recordings(mcap, rrd)
    loaded, read = load_logs(rig, payload, logs, map, moving=True)
    filtering = choose_band_filter(read, cutoff, alignment)
    found = run(loaded, read, holdout=holdout, filtering=filtering, mass=mass)
    if urdf is not None or mjcf is not None:
        export_bodies(loaded, found, read, urdf, mjcf, holdout=holdout, alignment=alignment)
    looked_at = choose_filtering(found)
    if looked_at is not None:
        write_recordings(found.after, read, replace(looked_at, alignment=alignment), mcap, rrd)
    else:
        why = "is not written: nothing of the model holds before the logs are mended"
        tell([f"{file} {why}" for file in (mcap, rrd) if file is not None])
    files: Mapping[str, Path] = {}
    if output is not None:
        found = plan_next_experiment(found, np.random.default_rng(seed))
        written = {what: DIAGNOSIS_FILES[what] for what in (*list_writers(found), "diagnosis")}
        page = replace(describe_record(found), origin=replace(origin, files=written)).to_html()
        files, notes = write_diagnosis(found, output, page, report_diagnosis(found), asked)
        tell(notes)
    lie = "\n".join(f"{what}: {path}" for what, path in files.items())
    text = f"{describe_record(found).to_text()}\n\n{lie}".rstrip("\n")
    present(text, report_diagnosis(found), json)


def choose_band_filter(
    logs: Sequence[Log], cutoff: float | None, alignment: float | None
) -> Filtering | None:
    """Return the band that the options ask for; None where they ask for nothing."""
    from gimbal_pin.diagnosis import SETTINGS, choose_band
    from gimbal_pin.regression import Filtering

    if cutoff is None and alignment is None:
        return None
    band = choose_band(logs, SETTINGS) if cutoff is None else cutoff
    return Filtering(cutoff=band, smoothing=SETTINGS.smoothing, alignment=alignment)


def export_bodies(
    given: Rig,
    found: Diagnosis,
    logs: Sequence[Log],
    urdf: Path | None,
    mjcf: Path | None,
    *,
    holdout: str | None,
    alignment: float | None,
) -> None:
    """Write the extended model with bodies that can be built, as a URDF, for MuJoCo, or both.

    Bodies and friction are fitted again beside its causes, for only `identify` returns bodies that can exist.
    """
    from gimbal_pin.export.mjcf import convert_to_mjcf
    from gimbal_pin.identification import identify, refittable_effects
    from gimbal_pin.log.io.files import atomic_write

    extended = found.after
    rig = extended.rig.with_phi(given.phi)
    again = identify(
        rig,
        logs,
        refittable_effects(extended),
        holdout=holdout,
        filtering=choose_filter(None, alignment),
        examined="never",
    )
    if urdf is not None:
        atomic_write(urdf, again.to_urdf())
    if mjcf is not None:
        terms = {term.effect: term for term in (*extended.terms, *again.model.terms)}
        bodies = rig.with_phi(again.consistent.phi)
        text, unwritten = convert_to_mjcf(
            replace(extended, rig=bodies, terms=tuple(terms.values()))
        )
        atomic_write(mjcf, text)
        tell(unwritten)
