"""A case on disk: log and rig in one folder, the truth in another."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .cases import Case
from .corruption import Columns
from .urdf import urdf_text, yaml_text

FORMAT = "%.12g"


@dataclass(frozen=True)
class CaseFiles:
    """What a diagnoser may read."""

    log: Path
    urdf: Path
    rig: Path


@dataclass(frozen=True)
class TruthFiles:
    """What it may not."""

    truth: Path
    perfect_log: Path
    oracle: Path


def write_whole(path: Path, text: str) -> Path:
    """Write a file whole or not at all."""
    beside = path.with_name(f".{path.name}.part")
    beside.write_text(text, encoding="utf-8")
    os.replace(beside, path)
    return path


def csv_text(columns: Columns) -> str:
    """Header row, one row per sample, twelve digits."""
    table = np.column_stack(list(columns.values()))
    line = ",".join([FORMAT] * table.shape[1])
    return "\n".join([",".join(columns), *(line % tuple(row) for row in table.tolist())]) + "\n"


def read_csv(path: Path) -> Columns:
    """The columns of a written log."""
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        table = np.loadtxt(file, delimiter=",", ndmin=2)
    return {name: table[:, i] for i, name in enumerate(names)}


def write(case: Case, folder: Path) -> CaseFiles:
    """log.csv, rig.urdf and rig.yaml."""
    folder.mkdir(parents=True, exist_ok=True)
    return CaseFiles(
        log=write_whole(folder / "log.csv", csv_text(case.log)),
        urdf=write_whole(folder / "rig.urdf", urdf_text(case.given)),
        rig=write_whole(
            folder / "rig.yaml", yaml_text(case.given, case.encoder_bits, case.plan.trusted)
        ),
    )


def write_truth(case: Case, folder: Path) -> TruthFiles:
    """truth.json, perfect.csv (the same log from perfect sensors) and oracle.npz; keep them from the diagnoser."""
    folder.mkdir(parents=True, exist_ok=True)
    oracle = folder / "oracle.npz"
    beside = folder / ".oracle.part.npz"
    np.savez_compressed(beside, allow_pickle=False, **case.oracle)
    os.replace(beside, oracle)
    return TruthFiles(
        truth=write_whole(folder / "truth.json", json.dumps(case.truth, indent=1) + "\n"),
        perfect_log=write_whole(folder / "perfect.csv", csv_text(case.perfect)),
        oracle=oracle,
    )
