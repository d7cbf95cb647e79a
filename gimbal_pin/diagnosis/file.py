"""A diagnosis as files: its JSON, and the extended model that `tune`, `track` and `simulate` read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.log.io import write_motion
from gimbal_pin.log.io.files import atomic_write, write_json, write_run

DIAGNOSIS_FILES: dict[str, str] = {
    "diagnosis": "diagnosis.json",
    "extended model": "extended.yaml",
    "next experiment": "next_experiment.csv",
    "report": "report.html",
}
"""Content that `write_diagnosis` writes → name of the file. The next experiment separates what is ambiguous."""


def list_writers(found: Diagnosis) -> dict[str, Callable[[Path], object]]:
    """Return what writes the extended model, and the next experiment where one was planned that parts anything."""
    writers: dict[str, Callable[[Path], object]] = {"extended model": found.save}
    planned = found.planned
    if planned is not None and planned.motion is not None:
        writers["next experiment"] = partial(write_motion, planned.motion, planned.joints)
    return writers


def write_diagnosis(
    found: Diagnosis,
    folder: str | Path,
    page: str,
    told: Mapping[str, object] | None = None,
    run: Mapping[str, object] | None = None,
) -> tuple[Mapping[str, Path], tuple[str, ...]]:
    """Write a diagnosis, its report and what else there is of `DIAGNOSIS_FILES`.

    Args:
        found: The diagnosis.
        folder: Where the files go.
        page: The report, a page of HTML.
        told: What JSON holds, with sentences; None: the numbers alone.
        run: What `write_run` states of the run.

    Returns:
        What → path, and the notes of `write_run`.
    """
    writers = list_writers(found)
    writers["diagnosis"] = partial(write_json, told or found.to_dict())
    writers["report"] = partial(atomic_write, content=page)
    files = {what: DIAGNOSIS_FILES[what] for what in writers}
    notes = write_run(folder, {files[what]: writers[what] for what in writers}, run or {})
    return {what: Path(folder) / name for what, name in files.items()}, notes
