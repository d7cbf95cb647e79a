"""False-alarm rates of the checks of a log's data, on clean simulated logs with a drive's sensors.

Each log has a bundled rig and payload, bodies and friction that differ from the URDF's, a closed loop on a sum of
sines, and a sampling rate of 30 Hz to 1 kHz. Encoders have 12 to 19 bits. Rates are a gyro's, differences of the
angles, or absent. The torque has coloured noise, passes a low-pass of the drive or one off line, and is quantised. The
host's clock jitters by up to 5 % of a period.

A check raises a false alarm where it alters the log or calls its physics unreliable. A remark that a fault does no
harm is counted in the column "remarks".
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import tyro
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt
from tqdm import tqdm

from gimbal_pin.checks import CHECKS, check_log, find_shifted_torques
from gimbal_pin.control import bench_run, tune
from gimbal_pin.control.experiment import perturbed
from gimbal_pin.errors import GimbalPinError
from gimbal_pin.identification import identify
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import fourier
from tests.blind.table import wilson
from tests.rigs import COMBINATIONS

RATES_HZ = (30.0, 50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0)
SLOWEST_LOOP_HZ = 200.0
"""Sampling rate of the controller of logs that are sampled more slowly."""
MODEL_ERROR = 0.2
"""Relative size of the bodies' difference from the URDF, see `perturbed`."""
OTHERS = ("refused", "torque-time", "two-rigs")
"""What is counted beside the checks: a log that is refused, a torque at another time, halves of two rigs."""


class Outcome(NamedTuple):
    """Checks that raised an alarm on one log, those that made a remark, and a description of the log."""

    alarms: tuple[str, ...]
    remarks: tuple[str, ...]
    description: str


def draw_log(rng: np.random.Generator) -> tuple[Rig, Log]:
    """Return a rig as its URDF states it and a clean log of a rig that differs from it."""
    rig = Rig.load(*COMBINATIONS[rng.integers(len(COMBINATIONS))])
    rate = float(rng.choice(RATES_HZ))
    every = int(np.ceil(SLOWEST_LOOP_HZ / rate)) if rate < SLOWEST_LOOP_HZ else 1
    dt = 1.0 / (rate * every)
    plant = perturbed(rig, MODEL_ERROR, rng)
    seconds = float(rng.uniform(8.0, 20.0))
    law = tune(plant, bandwidth_hz=4.0, dt=dt).controller
    log = bench_run(
        plant,
        law,
        rng=rng,
        torque_noise=0.0,
        encoder_bits=float(rng.uniform(12.0, 19.0)),
        reference=fourier(rig, int(rng.integers(2**31)), seconds, dt),
    )
    log = replace(log, tau=report_torque(np.asarray(log.tau), dt, rng)).part(
        slice(None, None, every)
    )
    kind = rng.choice(["gyro", "differences", "none"])
    if kind != "gyro":
        log = replace(log, v=np.gradient(log.q, log.t, axis=0) if kind == "differences" else None)
    jitter = rng.choice([0.0, 0.01, 0.05]) * log.dt * rng.standard_normal(len(log))
    t = log.t + np.clip(jitter, -0.4 * log.dt, 0.4 * log.dt)
    return rig, replace(log, t=t, name=f"{rig.name}, {rate:g} Hz, rates: {kind}, {seconds:.0f} s")


def report_torque(tau: Array, dt: float, rng: np.random.Generator) -> Array:
    """Return torques, (N, n), as a drive reports them: with coloured noise, behind a low-pass, and quantised."""
    size = np.sqrt(np.mean(tau**2, axis=0))
    keep = rng.uniform(0.0, 0.99)
    white = np.sqrt(1 - keep**2) * rng.standard_normal(tau.shape)
    tau = tau + rng.uniform(0.002, 0.03) * size * lfilter([1.0], [1.0, -keep], white, axis=0)
    kind = rng.choice(["plain", "drive", "off line"], p=[0.4, 0.4, 0.2])
    if kind == "drive":
        corner = min(rng.uniform(20.0, 200.0), 0.4 / dt)
        tau = sosfilt(butter(1, corner, fs=1.0 / dt, output="sos"), tau - tau[0], axis=0) + tau[0]
    if kind == "off line":
        tau = sosfiltfilt(butter(2, rng.uniform(5.0, 15.0), fs=1.0 / dt, output="sos"), tau, axis=0)
    step = rng.choice([0.0, 1e-3, 0.02, 0.1]) * size
    return np.where(step > 0, step * np.round(tau / np.where(step > 0, step, 1.0)), tau)


def examine(seed: int, number: int) -> Outcome:
    """Return what the checks say of one log; it depends on seed and number alone."""
    rig, log = draw_log(np.random.default_rng([seed, number]))
    try:
        checked = check_log(rig, log)
        shifts = find_shifted_torques(rig, checked.log, Filtering())
        fit = identify(rig, [log], examined="noisy")
    except GimbalPinError as error:
        return Outcome(("refused",), (), f"{number}: {log.name}: {error}")
    altered = {one.cause for one in checked.alterations}
    alarms = [f.cause for f in checked.faults if f.makes_physics_unreliable or f.cause in altered]
    alarms += ["torque-time"] * any(shift.beyond for shift in shifts) + [
        "two-rigs"
    ] * fit.is_of_two_rigs
    remarks = [f.cause for f in checked.faults if f.cause not in alarms] + ["torque-time"] * bool(
        shifts
    )
    said = "; ".join(fault.sentence for fault in checked.faults)
    return Outcome(tuple(alarms), tuple(remarks), f"{number}: {log.name}: {said}")


def main(
    count: int = 200,
    seed: int | None = None,
    jobs: int = os.cpu_count() or 1,
    verbose: bool = False,
) -> None:
    """Draw clean logs and print the false-alarm rate of every check with its 95 % bounds (Wilson).

    Args:
        count: How many logs are drawn.
        seed: Seed of the draw; None: a fresh one, which is printed.
        jobs: Processes.
        verbose: Describe every log of which anything was said.
    """
    first = int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else seed
    with ProcessPoolExecutor(jobs) as pool:
        outcomes = list(
            tqdm(
                pool.map(partial(examine, first), range(count)),
                total=count,
                disable=None,
                file=sys.stderr,
            )
        )
    alarms, remarks = (Counter(name for one in outcomes for name in one[k]) for k in (0, 1))
    print(f"{count} clean logs, seed {first}")
    print(f"{'check':20} {'alarms':>6} {'rate':>7}  {'95 % bounds':15} remarks")
    for name in (*CHECKS, *OTHERS):
        low, high = (100 * bound for bound in wilson(alarms[name], count))
        share = 100 * alarms[name] / count
        print(
            f"{name:20} {alarms[name]:6d} {share:5.1f} %  {low:4.1f} … {high:4.1f} %   {remarks[name]}"
        )
    for one in outcomes:
        if one.alarms or (verbose and one.remarks):
            print(f"{', '.join(one.alarms or one.remarks)} <- {one.description}")
    sys.exit(bool(alarms))


if __name__ == "__main__":
    tyro.cli(main)
