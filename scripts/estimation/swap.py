"""A payload swapped in the middle of a log: when it is announced, when the new one is known, and how well."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from estimation.jobs import CORES, results
from gimbal_pin.control.experiment import bench_run
from gimbal_pin.control.tuning import tune
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.identification import Online, given_beta
from gimbal_pin.log.log import Log
from gimbal_pin.rig.files import bundled_payloads, bundled_rigs
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import fourier

BARE = "none"
DT, LEFT = 2e-3, 11.0
"""Sampling interval, and time that follows the swap, s."""
TOLD, KNOWN = 3.0, 10.0
"""Within what time a swap must be announced, and the new payload be known, s."""
CASES = ((20.0, 0.0), (8.0, 0.0), (12.0, 4.0))
"""When the payload is swapped, and how long nothing is recorded meanwhile, s."""


@cache
def recorded(name: str, payload: str, seed: int, seconds: float) -> Log:
    """Return a closed loop of a rig with its own sensors and 1 % torque noise."""
    plant = nominal(Rig.load(name, payload))
    law = tune(plant, bandwidth_hz=4.0, dt=DT).controller
    motion = fourier(plant.rig, seed, seconds, DT)
    return bench_run(plant, law, rng=np.random.default_rng([seed, len(payload)]), reference=motion)


def swapped(first: Log, second: Log, at: float, pause: float) -> Log:
    """Return one log that goes over into another of the same motion."""
    late = first.t >= at
    channels = [np.where(late[:, None], getattr(second, x), getattr(first, x)) for x in ("q", "v", "tau")]
    return Log("swap", first.joints, first.t + pause * late, *channels)


def one(seed: int) -> dict[str, Any]:
    """Follow a log per case, rig and seed; return delays, and the errors of the parameters 10 s after the swap."""
    rng, names = np.random.default_rng(seed), bundled_rigs()
    at, pause = CASES[seed // len(names) % len(CASES)]
    name = names[seed % len(names)]
    first, second = rng.permutation([p for p in bundled_payloads() if p != BARE])[:2].tolist()
    logs = [recorded(name, payload, seed, at + LEFT) for payload in (first, second)]
    online, whole = Online.of(Rig.load(name, first)), swapped(*logs, at, pause)
    memory = online.advance(online.start(), whole.part(slice(0, int(np.searchsorted(whole.t, at + pause + KNOWN)))))
    events = {what: [e.t - at - pause for e in memory.events if e.what == what] for what in ("changed", "known")}
    early = sum(t <= 0 for t in events["changed"]) + max(0, len(events["changed"]) - 1)
    rig = Rig.load(name, second)
    truth = np.concatenate([given_beta(rig, online.design.reduction), rig.friction.ravel()])
    old = given_beta(Rig.load(name, first), online.design.reduction)
    known = bool(events["known"]) and events["known"][-1] > 0
    away = float(np.linalg.norm(online.estimate(memory).theta - truth)) if known else float("inf")
    change = float(np.linalg.norm(old - truth[: len(old)]))
    told = events["changed"][0] if events["changed"] else float("inf")
    return {"told": told, "false": early, "known": events["known"][-1] if known else float("inf"), "off": away / change}


def swap(logs: int = 36, workers: int = CORES, resume: Path | None = None) -> None:
    """Swap payloads in the middle of logs, over rigs, pairs and seeds: late, early in the log, and behind a pause.

    Args:
        logs: Number of logs.
        workers: Processes.
        resume: File of results to go on from.
    """
    rows = results(one, range(logs), workers, resume)
    count = len(bundled_rigs())
    for k, (at, pause) in enumerate(CASES):
        some = [row for seed, row in enumerate(rows) if seed // count % len(CASES) == k]
        if not some:
            continue
        told, known, off = (np.array([row[what] for row in some]) for what in ("told", "known", "off"))
        where = f"swapped at {at:g} s" + (f" behind a pause of {pause:g} s" if pause else "")
        print(
            f"{where}: {len(some)} logs, announced after {np.median(told):.2f} s ({told.max():.2f} at most), "
            f"known after {np.median(known):.2f} s ({known.max():.2f}), off by {100 * off.max():.2g} % of the change"
        )
    late = sum(not row["told"] <= TOLD for row in rows)
    unknown, false = sum(not row["known"] <= KNOWN for row in rows), sum(row["false"] for row in rows)
    passed = not (late or unknown or false)
    print(
        f"{logs} swaps: {late} announced after more than {TOLD:g} s, {unknown} not known within {KNOWN:g} s, "
        f"{false} false announcements: {'PASS' if passed else 'FAIL'}"
    )
    sys.exit(not passed)
