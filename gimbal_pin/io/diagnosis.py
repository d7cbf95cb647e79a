"""A diagnosis as files: its JSON, and the extended model that `tune`, `track` and `simulate` read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.io import write_motion
from gimbal_pin.io.files import output_folder, write_json
from gimbal_pin.io.model import write_extended

NEXT = "next_experiment.csv"
"""File of the motion that parts what is ambiguous."""


def write_diagnosis(found: Diagnosis, folder: str | Path) -> Mapping[str, Path]:
    """Write ``diagnosis.json``, ``extended.yaml`` and a planned ``next_experiment.csv``; return what → path."""
    place = output_folder(folder)
    files = {"diagnosis": place / "diagnosis.json", "extended model": place / "extended.yaml"}
    write_json(found.to_dict(), files["diagnosis"])
    write_extended(found.after.model, files["extended model"])
    if found.planned is not None and found.planned.motion is not None:
        files["next experiment"] = place / NEXT
        write_motion(found.planned.motion, found.planned.joints, files["next experiment"])
    return files
