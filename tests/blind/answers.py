"""Store the answers of one engine on a folder of drawn logs as a CSV file of one line per log.

A stored line holds what `judge` reads of the truth and of the answer, so that an engine that is no longer in the
project is judged, and compared in pairs with its successor, by the rules of the day.
"""

import csv
import json

from .judge import get_errors, judge

TRUTH_KEYS = ("stratum", "rig", "joints", "faults", "data", "noise_floor")
CAUSE_KEYS = (
    "cause", "form", "joint", "foreign", "outside", "kin", "parameters", "comparable", "snr", "projected_rms",
)  # fmt: skip
FINDING_KEYS = ("cause", "joint", "status", "class", "probability", "parameters", "rivals")


def write(path, folder):
    """Write the answers on all diagnosed logs of a folder, and return their number.

    Args:
        path: CSV file.
        folder: Folder of the draw; each log has ``truth.json``, ``diagnosis.json`` and, where it was measured, a file
            ``seconds`` with the processor time of the diagnosis.
    """
    rows = [_make_row(file.parent) for file in sorted(folder.glob("*/diagnosis.json"))]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["log", "stratum", "seconds", "verdict", "truth", "answer"])
        writer.writerows(rows)
    return len(rows)


def read(path):
    """Return the judged case of every line, by the name of its log."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {row["log"]: judge(json.loads(row["truth"]), json.loads(row["answer"])) for row in rows}


def encode_answer(answer):
    """Return what is kept of ``diagnose --json`` as one line of JSON, errors as in schema 2."""
    kept = _select(answer, ("verdict", "exit", "causes"))
    kept["findings"] = [_select(finding, FINDING_KEYS) for finding in answer.get("findings", ())]
    errors = get_errors(answer)
    kept["held_out"] = {
        stage: {"torque_rmse": {joint: pair[k] for joint, pair in errors.items()}}
        for k, stage in enumerate(("refitted", "extended"))
    }
    return _encode(kept)


def _make_row(place):
    """Return the line of one log."""
    truth = json.loads((place / "truth.json").read_text(encoding="utf-8"))
    answer = json.loads((place / "diagnosis.json").read_text(encoding="utf-8"))
    clock = place / "seconds"
    seconds = clock.read_text(encoding="utf-8").strip() if clock.exists() else ""
    kept = _select(truth, TRUTH_KEYS)
    kept["causes"] = [_select(cause, CAUSE_KEYS) for cause in truth["causes"]]
    verdict = answer["verdict"]
    return [place.name, truth["stratum"], seconds, verdict, _encode(kept), encode_answer(answer)]


def _select(record, keys):
    """Return the entries of a record that are among the keys."""
    return {key: record[key] for key in keys if key in record}


def _encode(record):
    """Return a record as one line of JSON, each number with the four digits that a comparison needs."""
    rounded = json.loads(json.dumps(record), parse_float=lambda text: float(f"{float(text):.4g}"))
    return json.dumps(rounded, separators=(",", ":"))
