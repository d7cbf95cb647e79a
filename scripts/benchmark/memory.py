"""Peak memory of identifying a short and a long log, each in a process of its own: ``python -m benchmark.memory N``."""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

import numpy as np
from tqdm import tqdm

from benchmark.data import noisy_log
from benchmark.figure import Figure
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.identification import identify
from gimbal_pin.log.log import Log
from gimbal_pin.rig.rig import Rig

COUNTS = (100_000, 1_000_000)
MB = 1e6


def measure() -> Iterator[Figure]:
    """Yield the peaks, and by how much more than the log the longer one takes."""
    beyond = []
    for count in tqdm(COUNTS, "memory", unit="log", disable=None, leave=False):
        found = json.loads(
            subprocess.check_output([sys.executable, "-m", "benchmark.memory", str(count)])
        )
        of = f"{count:,} samples: ".replace(",", " ")
        yield Figure(f"{of}peak memory of identifying", found["peak"] / MB, "MB")
        yield Figure(f"{of}the same less the log's own", (found["peak"] - found["log"]) / MB, "MB")
        yield Figure(f"{of}time of identifying", found["seconds"], "s")
        beyond.append(found["peak"] - found["log"])
    yield Figure(
        "growth of memory beyond the log itself", (beyond[1] - beyond[0]) / MB, "MB", at_most=50.0
    )


def identified(count: int) -> dict[str, float]:
    """Identify one log here; return the peak and the log's own size, bytes, and the time, s."""
    rig = Rig.load("thesis")
    log = noisy_log(nominal(rig), count, np.random.default_rng(0))
    begin = perf_counter()
    identify(rig, [log])
    return {"peak": peak(), "log": size(log), "seconds": perf_counter() - begin}


def peak() -> float:
    """Largest resident memory of this process so far, bytes.

    On Linux a process inherits `ru_maxrss` from the one that started it, so there the kernel's own mark is read.
    """
    status = Path("/proc/self/status")
    if status.exists():
        return 1024.0 * float(re.findall(r"VmHWM:\s*(\d+) kB", status.read_text())[0])
    unit = 1 if sys.platform == "darwin" else 1024
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit)


def size(log: Log) -> float:
    """Memory of a log's channels, bytes."""
    return float(sum(x.nbytes for x in (log.t, log.q, log.v, log.tau) if x is not None))


if __name__ == "__main__":
    print(json.dumps(identified(int(sys.argv[1]))))
