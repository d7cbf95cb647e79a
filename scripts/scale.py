"""Measure the processor time of a Monte Carlo study of the turret: per rig, and per task of the calling process.

Takes about half a minute.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from tempfile import TemporaryDirectory

import tyro

from gimbal_pin import Rig, monte_carlo
from gimbal_pin.fleet import map_units


def skip(unit: int) -> dict[str, float]:
    """Stand for a rig's simulation."""
    return {f"value_{k}": float(unit) for k in range(40)}


def measure(count: int = 24, seconds: float = 5.0, platform: bool = False) -> None:
    """Print processor times in this process.

    Args:
        count: Rigs.
        seconds: Length of each run, s.
        platform: Hold the camera still on profile S.
    """
    rig = Rig.load("turret")
    with ThreadPoolExecutor(1) as pool, TemporaryDirectory() as folder:
        monte_carlo(rig, count=1, seconds=seconds, platform=platform, executor=pool)  # imports
        begin = time.process_time()
        monte_carlo(rig, count=count, seconds=seconds, platform=platform, executor=pool)
        each = (time.process_time() - begin) / count
        begin = time.process_time()
        map_units(skip, range(2000), pool, folder=folder)
        task = (time.process_time() - begin) / 2000
    print(
        f"{each:.2f} s per rig: {3600 / each:.0f} rigs per core-hour; {1e3 * task:.1f} ms per task of 40 numbers"
    )


if __name__ == "__main__":
    tyro.cli(measure)
