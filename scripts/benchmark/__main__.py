"""Measure everything in one run, print the table, and exit with 1 if a requirement is missed."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import tyro

from benchmark import diagnosing, excitation, memory, online, regression, simulation, size
from benchmark.figure import Figure, line, summary
from gimbal_pin.log.io.files import write_json

PARTS = {part.__name__.rpartition(".")[2]: part for part in (
    regression, memory, size, simulation, online, diagnosing, excitation
)}  # fmt: skip


def main(
    only: Sequence[str] = tuple(PARTS),
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
) -> None:
    """Compare speed, memory and excitation with their requirements, on the bundled rig `thesis`.

    Args:
        only: Parts that are measured.
        json: Write the figures as JSON, too.
    """
    print(f"{machine()}\n{'':72}{'measured':>12}{'required':>22}", flush=True)
    figures: list[Figure] = []
    for part in only:
        for figure in PARTS[part].measure():
            print(line(figure), flush=True)
            figures.append(figure)
    if json is not None:
        write_json(report(figures), json)
    print(summary(figures))
    sys.exit(any(figure.passed is False for figure in figures))


def machine() -> str:
    """What it ran on."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("pin", "numpy", "scipy", "mujoco"))
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    return f"Python {platform.python_version()}, {packages}; {os.cpu_count()} cores, OMP_NUM_THREADS {threads}"


def report(figures: Sequence[Figure]) -> dict[str, object]:
    """Return what the JSON file holds."""
    return {
        "schema": 1,
        "machine": machine(),
        "figures": [figure.to_dict() for figure in figures],
        "passed": all(figure.passed is True for figure in figures if figure.required),
    }


if __name__ == "__main__":
    tyro.cli(main)
