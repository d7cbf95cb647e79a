"""Large inputs, each in a process of its own: ``python -m benchmark.size joints|rows``."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np
from tqdm import tqdm

from benchmark.data import noisy_log
from benchmark.diagnosing import hold_commands, plant_two_causes
from benchmark.figure import Figure
from benchmark.memory import MB, peak
from gimbal_pin.cli import main
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.identification import identify
from gimbal_pin.log.io import write_log
from gimbal_pin.rig.rig import Rig
from tests.rigs import chain

JOINTS, SECONDS, STEP = 20, 60.0, 2
"""A chain at 500 Hz: every second sample of the data's millisecond."""
ROWS = 2_000_000


def measure() -> Iterator[Figure]:
    """Yield times and the peak of memory."""
    for what in tqdm(("joints", "rows"), "size", disable=None, leave=False):
        found = json.loads(
            subprocess.check_output([sys.executable, "-m", "benchmark.size", what]).splitlines()[-1]
        )
        of = f"{JOINTS} joints, {SECONDS:g} s at 500 Hz: identifying"
        of = (
            of
            if what == "joints"
            else f"{ROWS:,} rows, three joints: diagnosing a CSV".replace(",", " ", 2)
        )
        yield Figure(f"{of}, time", found["wall"], "s", at_most=30.0)
        yield Figure("the same, processor time", found["cpu"], "s")
        yield Figure(
            "the same, peak memory",
            found["peak"] / MB,
            "MB",
            at_most=None if what == "joints" else 1000.0,
        )


def joints() -> dict[str, float]:
    """Identify a long chain here, as the command line does."""
    rig = chain(JOINTS)
    log = hold_commands(
        noisy_log(nominal(rig), round(1000 * SECONDS), np.random.default_rng(0)), STEP
    )
    begin = perf_counter()
    cpu = process_time()
    identify(rig, [log], examined="noisy")
    return {"wall": perf_counter() - begin, "cpu": process_time() - cpu, "peak": peak()}


def rows(file: Path) -> dict[str, float]:
    """Diagnose a file here by the command line."""
    begin = perf_counter()
    cpu = process_time()
    main(["diagnose", "thesis", str(file), "--json", str(file.with_suffix(".json"))])
    return {"wall": perf_counter() - begin, "cpu": process_time() - cpu, "peak": peak()}


def long_log(file: Path) -> None:
    """Write a log of so many rows, with two causes in it."""
    plant = plant_two_causes(Rig.load("thesis"))
    write_log(hold_commands(noisy_log(plant, STEP * ROWS, np.random.default_rng(3)), STEP), file)


if __name__ == "__main__":
    if sys.argv[1] == "joints":
        print(json.dumps(joints()))
    elif sys.argv[1] == "write":
        long_log(Path(sys.argv[2]))
    elif len(sys.argv) > 2:
        print(json.dumps(rows(Path(sys.argv[2]))))
    else:
        # Written and read by processes of their own: what the one took is no part of the other's peak.
        with TemporaryDirectory() as folder:
            file = str(Path(folder) / "long.csv")
            subprocess.run([sys.executable, "-m", "benchmark.size", "write", file], check=True)
            subprocess.run([sys.executable, "-m", "benchmark.size", "rows", file], check=True)
