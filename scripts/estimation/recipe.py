"""README's first log over many seeds: how often the truth is in the 95 % intervals of its parameters."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimation.coverage import BAND, NORMAL
from estimation.jobs import CORES, results
from gimbal_pin.control.experiment import bench_run
from gimbal_pin.control.tuning import tune
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.excitation import excite
from gimbal_pin.identification import identify
from gimbal_pin.log.log import Log
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import true_theta

WAYS = {"last-third": "of the first two thirds", "none": "of the whole log (--refit)"}
MANY = 3
"""Parameters of one log that miss together, which is told."""


def first_log(rig: Rig, seed: int) -> Log:
    """Return what `excite RIG --starts 1` and `simulate RIG --reference` make with a seed."""
    plant = nominal(rig)
    law = tune(plant, kind="computed-torque", bandwidth_hz=8.0).controller
    motion = excite(rig, starts=1, dt=law.dt, rng=np.random.default_rng(seed)).motion
    return bench_run(
        plant, law, rng=np.random.default_rng(seed), reference=motion, torque_noise=0.01
    )


def one(name: str, seed: int) -> dict[str, Any]:
    """Identify one log both ways; return every parameter's error in its own deviations."""
    rig = Rig.load(name)
    log = first_log(rig, seed)
    truth = true_theta(rig)
    found = {way: identify(rig, [log], holdout=way).estimate for way in WAYS}
    return {
        way: ((estimate.theta - truth) / estimate.std).tolist() for way, estimate in found.items()
    }


def recipe(
    logs: int = 40, rig: str = "turret", workers: int = CORES, resume: Path | None = None
) -> None:
    """Measure the coverage of 95 % intervals on README's first log, with many seeds.

    Args:
        logs: Number of logs.
        rig: Rig.
        workers: Processes.
        resume: File of results to go on from.
    """
    rows = results(partial(one, rig), range(logs), workers, resume)
    for way, words in WAYS.items():
        out = np.abs([row[way] for row in rows]) > NORMAL
        held = 1 - float(out.mean())
        many = int(np.sum(out.sum(axis=1) >= MANY))
        print(
            f"{logs} logs of {rig}, parameters {words}: {100 * held:.1f} % of the 95 % intervals hold the truth"
            f"; in {many} logs {MANY} or more miss"
        )
    passed = BAND[0] <= held <= BAND[1]
    print(
        f"README's own way, the last: {100 * held:.1f} % (93 to 97): {'PASS' if passed else 'FAIL'}"
    )
    sys.exit(not passed)
