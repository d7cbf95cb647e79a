"""Store the answers of one engine on a folder of drawn logs as a CSV file of one line per log.

A stored line holds what `judge` reads of the truth and of the answer, so that an engine that is no longer in the
project is judged, and compared in pairs with its successor, by the rules of the day.
"""

from __future__ import annotations

import csv
import json
from typing import Any

from .judge import judge

Json = dict[str, Any]

COLUMNS = ("log", "stratum", "seconds", "verdict", "truth", "answer")
TRUTH_KEYS = ("stratum", "rig", "joints", "faults", "data", "noise_floor")
CAUSE_KEYS = (
    "cause", "form", "joint", "foreign", "outside", "kin", "parameters", "comparable", "snr", "projected_rms",
)  # fmt: skip
FINDING_KEYS = ("cause", "joint", "status", "class", "probability", "parameters")
SIGNIFICANT_DIGITS = 4
"""Digits kept of a number: the shares that are compared are given to three."""


def write(path, folder):
    """Write the answers on all diagnosed logs of a folder, and return their number.

    Args:
        path: CSV file.
        folder: Folder of the draw; each log has ``truth.json``, ``diagnosis.json`` and, where it was measured, a file
            ``seconds`` with the processor time of the diagnosis.
    """
    answered = sorted(file.parent for file in folder.glob("*/diagnosis.json"))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(_make_row(place) for place in answered)
    return len(answered)


def read(path):
    """Return the judged case of every line, by the name of its log."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {row["log"]: judge(json.loads(row["truth"]), json.loads(row["answer"])) for row in rows}


def encode_answer(answer):
    """Return what is kept of ``diagnose --json`` as one line of JSON."""
    errors = {
        stage: _select(answer.get(stage) or {}, ("torque_rmse",))
        for stage in ("baseline", "extended")
    }
    findings = [_select(finding, FINDING_KEYS) for finding in answer.get("findings", ())]
    return _encode(_select(answer, ("verdict", "exit", "causes")) | {"findings": findings} | errors)


def _make_row(place):
    """Return the line of one log."""
    truth = json.loads((place / "truth.json").read_text(encoding="utf-8"))
    answer = json.loads((place / "diagnosis.json").read_text(encoding="utf-8"))
    clock = place / "seconds"
    kept_truth = _select(truth, TRUTH_KEYS) | {
        "causes": [_select(cause, CAUSE_KEYS) for cause in truth["causes"]]
    }
    return {
        "log": place.name,
        "stratum": truth["stratum"],
        "seconds": clock.read_text(encoding="utf-8").strip() if clock.exists() else "",
        "verdict": answer["verdict"],
        "truth": _encode(kept_truth),
        "answer": encode_answer(answer),
    }


def _select(record, keys):
    """Return the entries of a record that are among the keys."""
    return {key: record[key] for key in keys if key in record}


def _encode(record):
    """Return a record as one line of JSON with rounded numbers."""
    return json.dumps(_round(record), separators=(",", ":"))


def _round(value):
    """Return a value with every number in it rounded to `SIGNIFICANT_DIGITS`."""
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}")
    if isinstance(value, dict):
        return {key: _round(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_round(entry) for entry in value]
    return value
