"""A new camera on a known gimbal from ten seconds of motion: how far off its mass moment and inertia are."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimation.jobs import CORES, results
from gimbal_pin.control.experiment import bench_run
from gimbal_pin.control.tuning import tune
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.effects import PayloadShift
from gimbal_pin.identification import identify
from gimbal_pin.identification.payloads import Carried, identify_new, stated
from gimbal_pin.log.log import Log
from gimbal_pin.rig.files import bundled_payloads, bundled_rigs
from gimbal_pin.rig.rig import Rig

BARE = "none"
DT = 2e-3
PERIOD = 10.0
"""Time after which a motion repeats, s."""
KNOWING = 40.0
"""Time from which the gimbal is known, s."""
SHIFT = 0.015
"""How far the new camera may sit from where its URDF has it, m."""
WITHIN = {"kg m": 0.02, "kg m^2": 0.05}
"""Share of the largest such parameter by which one may be off."""


def recorded(rig: Rig, seed: int, seconds: float) -> Log:
    """Return a closed loop of a rig with its own sensors and 1 % torque noise, in motions that `excite` designs."""
    plant = nominal(rig)
    law = tune(plant, bandwidth_hz=4.0, dt=DT).controller
    return bench_run(plant, law, rng=np.random.default_rng(seed), seconds=seconds, period=PERIOD)


def one(seconds: float, seed: int) -> dict[str, Any]:
    """Learn a gimbal with one camera, mount another one askew, and return its errors by unit and their z."""
    rng, names = np.random.default_rng(seed), bundled_rigs()
    name = names[seed % len(names)]
    first, second = rng.permutation([p for p in bundled_payloads() if p != BARE])[:2].tolist()
    reference, rig = Rig.load(name, first), Rig.load(name, second)
    known = identify(reference, [recorded(reference, 2 * seed, KNOWING)], holdout="none")
    true = PayloadShift(*rng.uniform(-SHIFT, SHIFT, 3).tolist()).apply(rig)
    found = identify_new(rig, [recorded(true, 2 * seed + 1, seconds)], known.model)
    camera, own = found.cameras[second], Carried.of(rig, known.reduction)
    mine = slice(10 * own.body, 10 * own.body + 10)
    truth = own.shown(stated(reference) + true.phi[mine] - reference.phi[mine])
    away = camera.value - truth
    off = {}
    for unit in WITHIN:
        these = [k for k, one in enumerate(camera.units) if one == unit]
        off[unit] = float(np.abs(away[these]).max() / np.abs(truth[these]).max())
    return {"rig": name, **off, "z": (away / camera.std).tolist()}


def camera(logs: int = 30, seconds: float = 10.0, workers: int = CORES, resume: Path | None = None) -> None:
    """Measure how well a new camera is known from a short motion, over rigs, pairs of cameras, places and seeds.

    Args:
        logs: Number of new cameras.
        seconds: Length of each one's motion, s.
        workers: Processes.
        resume: File of results to go on from.
    """
    rows = results(partial(one, seconds), range(logs), workers, resume)
    for name in sorted({row["rig"] for row in rows}):
        some = [row for row in rows if row["rig"] == name]
        moment, inertia = (100 * np.array([row[unit] for row in some]) for unit in WITHIN)
        z = np.concatenate([row["z"] for row in some])
        print(
            f"{name:9} {len(some)} cameras: mass moment off by {np.median(moment):.2g} % ({moment.max():.2g} at most), "
            f"inertia {np.median(inertia):.2g} % ({inertia.max():.2g}); in deviations {np.sqrt(np.mean(z**2)):.2g} rms"
        )
    missed = {unit: sum(row[unit] > limit for row in rows) for unit, limit in WITHIN.items()}
    passed = not any(missed.values())
    print(
        f"{logs} new cameras, {seconds:g} s each: {missed['kg m']} mass moments off by more than 2 %, "
        f"{missed['kg m^2']} inertias by more than 5 %: {'PASS' if passed else 'FAIL'}"
    )
    sys.exit(not passed)
