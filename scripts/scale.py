"""What docs/pages/scale.md says of the fleet engine: killed processes, memory, throughput, bytes, core-hours.

Every figure is printed by one of the verbs: `kills`, `stub`, `merge`, `bytes`, `rate`.
"""

from __future__ import annotations

import json
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import psutil
import tyro
from tyro.conf import Positional

from gimbal_pin.fleet import Run, engine, open_executors, run_units

MEGABYTE = 2**20


class Waiting(NamedTuple):
    """A unit that waits 50 ms."""

    seed: int

    def wait(self) -> dict[str, float]:
        """Stand for a rig's simulation."""
        time.sleep(0.05)
        return {"seed": self.seed}


@dataclass(frozen=True)
class Counted:
    """Work that leaves a line in a file for each unit it begins."""

    work: engine.Work
    log: str

    def __call__(self, unit: Any) -> Any:
        """Append the unit's seed, and compute it."""
        with open(self.log, "a") as file:
            file.write(f"{unit.seed}\n")
        return self.work(unit)


def campaign(count: int, seconds: float, platform: bool = False) -> tuple[engine.Work, Sequence[Any]]:
    """A Monte Carlo study of the turret, and its units; of 0 s units that wait."""
    if not seconds:
        return Waiting.wait, [Waiting(k) for k in range(count)]
    from gimbal_pin import Rig, nominal
    from gimbal_pin.fleet.study import make_study
    from gimbal_pin.fleet.variation import RigDesign, Variation, choose_default_vary

    model = nominal(Rig.load("turret"))
    variation = Variation(model, choose_default_vary(model))
    return make_study(variation, None, False, platform, seconds).run, RigDesign(variation.inputs, count)


def coordinate(folder: Positional[str], log: Positional[str], count: int = 40, seconds: float = 1.0) -> None:
    """Run a study in a pool of two, as a coordinator of its own."""
    work, design = campaign(count, seconds)
    run_units(Run(Counted(work, log), design, folder), workers=2, quiet=True)


def kills(
    whom: Positional[Literal["worker", "coordinator"]],
    times: int = 10,
    count: int = 40,
    seconds: float = 1.0,
    seed: int = 0,
) -> None:
    """Kill a worker or the coordinator at random moments; the table has to be as without, to the bit.

    Args:
        whom: Which process gets SIGKILL.
        times: Kills, each of a run of its own.
        count: Rigs.
        seconds: How long each is simulated, s; 0: units that wait 50 ms.
        seed: Of the moments and of which worker.
    """
    rng = np.random.default_rng(seed)
    with TemporaryDirectory() as own:
        work, design = campaign(count, seconds)
        places = {unit.seed: k for k, unit in enumerate(design)}
        run_units(Run(work, design, f"{own}/whole"), partial(ThreadPoolExecutor, 1), workers=1, quiet=True)
        whole = pd.read_parquet(f"{own}/whole/results.parquet")
        for number in range(times):
            folder, log = f"{own}/{number}", Path(own, f"{number}.log")
            command = [
                sys.executable,
                __file__,
                "coordinate",
                folder,
                str(log),
                "--count",
                str(count),
                "--seconds",
                str(seconds),
            ]
            coordinator = subprocess.Popen(command)
            moment = int(rng.integers(count))  # units begun: seconds would depend on the machine
            while coordinator.poll() is None and (not log.exists() or len(log.read_text().split()) <= moment):
                time.sleep(0.002)
            victim = psutil.Process(coordinator.pid)
            if whom == "worker":
                workers = [child for child in victim.children() if "spawn_main" in " ".join(child.cmdline())]
                victim = workers[rng.integers(len(workers))]
            parts = [engine.PART.search(path.name) for path in Path(folder, engine.PARTS).iterdir()]
            done = {k for part in parts if part for k in range(int(part[1]), int(part[2]) + 1)}
            victim.send_signal(signal.SIGKILL)
            if coordinator.wait():
                subprocess.run(command, check=True)
            begun = np.bincount([places[int(word)] for word in log.read_text().split()], minlength=count)
            pd.testing.assert_frame_equal(whole, pd.read_parquet(f"{folder}/results.parquet"), check_exact=True)
            assert begun.min() == 1 and not done & set(np.flatnonzero(begun > 1).tolist())
            print(
                f"{whom} killed after {moment:3} units: {(begun - 1).sum():2} computed twice, the same table",
                flush=True,
            )


@dataclass(frozen=True)
class Watched(Sequence[float]):
    """Units that wait for some seconds, and note the coordinator's memory when they are handed out."""

    size: int
    seconds: float
    memory: dict[int, float]

    def __len__(self) -> int:
        """Return the number of units."""
        return self.size

    def __getitem__(self, place: Any) -> Any:
        """Return how long a unit waits."""
        if place % (self.size // 10) == 0:
            self.memory[10 * place // self.size * 10] = psutil.Process().memory_info().rss / MEGABYTE
        return self.seconds


def wait_for(seconds: float) -> dict[str, float]:
    """Stand for a unit's work."""
    if seconds:
        time.sleep(seconds)
    return {"seconds": seconds, "one": 1.0, "two": 2.0}


def stub(
    count: int = 100_000, milliseconds: float = 1.0, most: int = engine.TASK_UNITS, scheduler: str | None = None
) -> None:
    """Send units that only wait through the coordinator: throughput, its memory and processor time.

    Args:
        count: Units.
        milliseconds: How long each waits.
        most: Most units of a task.
        scheduler: A Dask cluster's address; else a pool of two processes.
    """
    engine.TASK_UNITS = most
    with TemporaryDirectory() as own, open_executors(scheduler, 0 if scheduler else 2) as (factory, workers):
        units = Watched(count, milliseconds / 1000, {})
        begin, used = time.monotonic(), time.process_time()
        run_units(Run(wait_for, units, own), factory, workers=workers, quiet=True)
        taken, used = time.monotonic() - begin, time.process_time() - used
        parts, content = zip(*((1, path.stat().st_size) for path in Path(own, engine.PARTS).iterdir()))
        begin = time.monotonic()
        run_units(Run(wait_for, units, own), factory, workers=workers, quiet=True)
        merged = time.monotonic() - begin
        memory = ", ".join(
            f"{share} %: {x:.0f} MB" for share, x in sorted(units.memory.items()) if share in (10, 50, 90)
        )
        table = Path(own, engine.TABLE).stat().st_size
    print(f"{count} units of {milliseconds} ms, at most {most} per task: {count / (taken - merged):.0f} units/s")
    print(f"  {sum(parts)} parts, {sum(content) / count:.0f} bytes per unit; the table {table / count:.0f}")
    print(
        f"  coordinator: {1e6 * used / count:.0f} us of processor per unit, {1e3 * used / sum(parts):.1f} ms per task"
    )
    print(f"  resident: {memory}; at most {peak():.0f} MB with the table, which took {merged:.1f} s")


def peak() -> float:
    """Most memory that this process has had, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def merge(parts: int = 100_000, columns: int = 40) -> None:
    """Write a table of parts of one unit each: its time, and the memory that it takes.

    Args:
        parts: Parts.
        columns: Numbers of each unit.
    """
    values = {f"value_{k}": float(k) for k in range(columns)}
    with TemporaryDirectory() as own:
        os.mkdir(f"{own}/{engine.PARTS}")
        begin = time.monotonic()
        for k in range(parts):
            engine.write_part(own, k, [{"error": None, **values}])
        written, before = time.monotonic() - begin, peak()
        for count in sorted({max(parts // 10, 1), parts}):
            begin = time.monotonic()
            run = Run(wait_for, range(count), own)
            for path in () if count == parts else sorted(Path(own, engine.PARTS).iterdir())[count:]:
                shutil.move(path, Path(own, path.name))
            engine.write_table(run)
            print(f"{count} parts: table in {time.monotonic() - begin:.1f} s, {peak() - before:.0f} MB more")
            for path in Path(own).glob("part-*"):
                shutil.move(path, Path(own, engine.PARTS, path.name))
    print(f"written in {written:.1f} s: {1e3 * written / parts:.2f} ms per part of {columns} numbers")


def rate(count: int = 24, seconds: float = 5.0, platform: bool = False) -> None:
    """Simulate rigs in this process, and print what they cost: processor time, since other programs share the machine.

    Args:
        count: Rigs.
        seconds: Length of each run, s.
        platform: Hold the camera still on profile S.
    """
    with TemporaryDirectory() as own:
        work, design = campaign(count, seconds, platform)
        work(design[0])  # what is imported and compiled once
        begin = time.process_time()
        run_units(Run(work, design, own), partial(ThreadPoolExecutor, 1), workers=1, quiet=True)
        each = (time.process_time() - begin) / count
        sizes = [path.stat().st_size for path in Path(own, engine.PARTS).iterdir()]
    print(f"{count} rigs x {seconds} s{', platform S' * platform}: {each:.2f} s of processor per rig")
    print(
        f"  {60 / each:.0f} per minute of one core, {3600 / each:.0f} per core-hour; 10^6 take {1e6 * each / 3600:.0f}"
    )
    print(f"  parts: {sum(sizes) / count / 1000:.1f} kB per rig at {count / len(sizes):.1f} rigs per part")


def measure_bytes(platform: bool = False) -> None:
    """Print how many bytes go to a worker with a task.

    Args:
        platform: Hold the camera still on profile S.
    """
    work, design = campaign(engine.TASK_UNITS, 5.0, platform)
    sizes = {
        n: len(pickle.dumps((engine.compute_task, work, 0, [design[k] for k in range(n)], "s3://bucket/rigs")))
        for n in (1, 10, 100)
    }
    print(json.dumps({f"{n} rigs": size for n, size in sizes.items()}))
    print(f"{(sizes[100] - sizes[1]) / 99:.0f} bytes per rig, {sizes[1] / 1000:.0f} kB per task")


if __name__ == "__main__":
    verbs = {"kills": kills, "stub": stub, "merge": merge, "bytes": measure_bytes, "rate": rate}
    tyro.extras.subcommand_cli_from_dict({**verbs, "coordinate": coordinate})
