"""A case on disk: log and rig in one folder, the truth in another."""

import os
from io import StringIO

import numpy as np

from .urdf import urdf_text, yaml_text


def write_whole(path, text):
    """Write a file whole or not at all."""
    beside = path.with_name(f".{path.name}.part")
    beside.write_text(text, encoding="utf-8")
    os.replace(beside, path)
    return path


def csv_text(columns):
    """Header row, one row per sample, twelve digits."""
    text = StringIO()
    table = np.column_stack(list(columns.values()))
    np.savetxt(text, table, "%.12g", delimiter=",", header=",".join(columns), comments="")
    return text.getvalue()


def write(case, folder):
    """Write log.csv, rig.urdf and rig.yaml: what a diagnoser may read."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "log.csv", csv_text(case.log))
    write_whole(folder / "rig.urdf", urdf_text(case.given))
    overlay = yaml_text(case.given, case.encoder_bits, case.plan.trusted)
    write_whole(folder / "rig.yaml", overlay)
