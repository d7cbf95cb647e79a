"""The numbers and keys of every verb's JSON stay those of `tests/golden`, on small simulated logs.

A number may move by a tenth of the standard deviation that stands beside it, or by
`RELATIVE_TOLERANCE`. Sentences, paths and times are not compared. After a change that is meant to
move numbers, write the files anew and read their diff:

    python -m tests.test_golden
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from gimbal_pin.cli import main
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.log import write_log
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed

GOLDEN = Path(__file__).parent / "golden"
PROMISES = Path(__file__).parents[1] / "docs" / "pages" / "programs.md"
RELATIVE_TOLERANCE = 2e-3
"""Change of a number without a deviation: rounding moves it by 1e-9, a search that stops by 1e-4."""
SHARE_OF_DEVIATION = 0.1
NOT_COMPARED = {"seconds_taken", "elapsed", "version", "command", "file", "path"}
MAX_LIST_LENGTH = 24
"""Longer lists of numbers are compared by their length and norm."""

LOGS = {
    "thesis": ("thesis", "zoom-lens", None),
    "drone": ("drone", "mirrorless", None),
    "ptu": ("ptu", "infrared", None),
    "turret": ("turret", "infrared", None),
    "cogging": ("turret", "infrared", "cogging:pan:amplitude=0.05,harmonic=14"),
}
"""Log → rig, payload and planted effect."""
CALLS = {
    "rigs": "rigs",
    "check-thesis": "check thesis --payload zoom-lens",
    **{f"base-{rig}": f"base {rig}" for rig in ("thesis", "handheld", "turret", "drone", "ptu")},
    "excite": "excite turret --starts 1 --seconds 5 -o {}/motion.csv",
    "rehearse": "rehearse turret {}/turret.csv",
    "inspect": "inspect {}/turret.csv --rig turret",
    "identify-thesis": "identify thesis {}/thesis.csv --payload zoom-lens",
    "identify-drone": "identify drone {}/drone.csv --payload mirrorless",
    "identify-ptu": "identify ptu {}/ptu.csv --payload infrared --estimator physical",
    "identify-two": "identify turret {}/turret.csv {}/cogging.csv --payload infrared",
    "tune-turret": "tune turret {}/turret.csv --payload infrared --plants 3 -o {}/controller.yaml",
    "diagnose-cogging": "diagnose turret {}/cogging.csv --payload infrared",
    "diagnose-clean": "diagnose turret {}/turret.csv --payload infrared",
    "pointing": "track turret --platform S --seeds 1 --seconds 2",
    "track": "track turret {}/pid.yaml --plants 3",
    "montecarlo": "montecarlo turret -o {}/many --count 4 --seconds 1 --workers 1 --sobol",
}
"""Golden file → the call that makes it; {} is the folder of logs."""
PID = "tune turret {}/turret.csv --payload infrared --plants 3 --kind pid -o {}/pid.yaml"


@cache
def record_logs() -> TemporaryDirectory[str]:
    """Return the folder of simulated logs, twelve seconds at 250 Hz with torque noise of 1 %."""
    folder = TemporaryDirectory()
    for name, (rig_name, payload, effect) in LOGS.items():
        rig = Rig.load(rig_name, payload)
        terms = [parse_effect(effect, rig)] if effect else []
        plant = plant_with(nominal(rig), terms).plant
        log = prescribed(plant, seconds=12.0, torque_noise=0.01, dt=4e-3)
        write_log(log, Path(folder.name) / f"{name}.csv")
    call(PID, folder.name)
    return folder


def call(line: str, folder: str) -> None:
    """Run a call in a folder of logs, without what it prints."""
    with redirect_stdout(StringIO()):
        main(line.replace("{}", folder).split())


def run_call(name: str) -> Any:
    """Return the JSON of a call."""
    folder = record_logs().name
    call(f"{CALLS[name]} --json {{}}/result.json", folder)
    return reduce_result(json.loads(Path(folder, "result.json").read_text(encoding="utf-8")))


def reduce_result(value: Any) -> Any:
    """Return a result without sentences, paths and times, and with long lists of numbers as length and norm."""
    if isinstance(value, dict):
        return {
            key.rpartition("/")[-1]: "..." if key in NOT_COMPARED else reduce_result(item)
            for key, item in value.items()
        }
    if isinstance(value, list):
        if len(value) <= MAX_LIST_LENGTH or not isinstance(value[0], float):
            return [reduce_result(item) for item in value]
        return {"length": len(value), "norm": float(np.linalg.norm(np.array(value, dtype=float)))}
    if isinstance(value, str) and (" " in value or "/" in value):
        return "..."
    return value


def yield_differences(
    golden: Any, result: Any, place: str = "", deviation: float = 0.0
) -> Iterator[str]:
    """Yield one line for each key that came or went, and for each value that is another."""
    if isinstance(golden, dict) and isinstance(result, dict):
        for key in golden.keys() ^ result.keys():
            yield f"{place}.{key}: {'gone' if key in golden else 'new'}"
        std = golden.get("std")
        beside = SHARE_OF_DEVIATION * std if isinstance(std, float) else 0.0
        for key in golden.keys() & result.keys():
            yield from yield_differences(golden[key], result[key], f"{place}.{key}", beside)
    elif isinstance(golden, list) and isinstance(result, list) and len(golden) == len(result):
        for k, (before, after) in enumerate(zip(golden, result)):
            yield from yield_differences(before, after, f"{place}[{k}]", deviation)
    elif isinstance(golden, float) and isinstance(result, float | int):
        tolerance = max(RELATIVE_TOLERANCE * abs(golden), deviation, 1e-9)
        if not np.isclose(golden, result, rtol=0.0, atol=tolerance, equal_nan=True):
            yield f"{place}: {golden} -> {result}"
    elif golden != result:
        yield f"{place}: {golden} -> {result}"


def collect_keys(value: Any) -> set[str]:
    """Return all keys of a result."""
    if isinstance(value, dict):
        return set(value).union(*map(collect_keys, value.values()))
    return set().union(*map(collect_keys, value)) if isinstance(value, list) else set()


def read_golden(name: str) -> dict[str, Any]:
    """Return what a call gave when its golden file was written."""
    golden: dict[str, Any] = json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))
    return golden


@pytest.mark.parametrize("name", CALLS)
def test_results_are_those_of_the_golden_files(name: str) -> None:
    differences = list(yield_differences(read_golden(name), run_call(name)))
    assert not differences, "\n".join(differences)


def test_golden_files_have_the_keys_that_the_documentation_lists() -> None:
    """The keys of the first level: a list without items shows none of its items' keys."""
    rows = re.findall(r"^\| `([\w-]+)` \| (.*) \|$", PROMISES.read_text(encoding="utf-8"), re.M)
    verbs = {call.split()[0] for call in CALLS.values()}
    for verb, text in rows:
        code = " ".join(re.findall(r"`([^`]*)`", re.split(r"[;(]", text)[0]))
        while (shallower := re.sub(r"\{[^{}]*\}|\[[^\[\]]*\]|\([^()]*\)", "", code)) != code:
            code = shallower
        goldens = [read_golden(name) for name, call in CALLS.items() if call.split()[0] == verb]
        missing = {*re.findall(r"[a-z]\w*", code)} - set().union(*map(collect_keys, goldens))
        assert verb not in verbs or not missing, verb


if __name__ == "__main__":
    for chosen in sys.argv[1:] or CALLS:
        text = json.dumps(run_call(chosen), indent=1, sort_keys=True)
        (GOLDEN / f"{chosen}.json").write_text(text + "\n", encoding="utf-8")
