"""A diagnosis as files: its JSON, and the extended model that `tune`, `track` and `simulate` read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.io.files import output_folder, write_json
from gimbal_pin.io.model import write_extended


def write_diagnosis(found: Diagnosis, folder: str | Path) -> Mapping[str, Path]:
    """Write ``diagnosis.json`` and ``extended.yaml`` into a folder; return what → path."""
    place = output_folder(folder)
    files = {"diagnosis": place / "diagnosis.json", "extended model": place / "extended.yaml"}
    write_json(found.to_dict(), files["diagnosis"])
    write_extended(found.after.model, files["extended model"])
    return files
