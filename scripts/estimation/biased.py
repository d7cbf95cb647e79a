"""Coarse encoders differentiated twice, without a gyro: least squares is biased, what is used instead is not."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimation.jobs import CORES, results
from estimation.logs import drawn
from gimbal_pin.control.experiment import bench_run
from gimbal_pin.control.tuning import tune
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.identification import (
    compare_with_instruments,
    fit_idim,
    fit_output_error,
    given_beta,
)
from gimbal_pin.identification.output_error import build_instruments
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    Block,
    DesignBlocks,
    Filtering,
    compute_blocks,
    fit_physical,
    fit_weighted,
)
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import rows_of

EXACT = 40
"""Bits of an encoder whose steps nobody sees."""
EXCITED = 0.1
"""Share of a joint's torque rms that a well-excited base parameter moves."""
BIASED, WITHIN = 0.2, 0.03
FLAGGED, FALSE = 0.95, 0.05


def one(bits: int, cutoff: float, seconds: float, compared: int, seed: int) -> dict[str, Any]:
    """Return the test's p-values, and the errors of three estimators' well-excited base parameters, over their values.

    The same closed loop is run with coarse and with exact encoders; the test is asked of both at the same high cutoff,
    and of the coarse log with its gyro at the cutoff that identify takes by itself.
    """
    rig, plant, rng = drawn(seed, 0.1)
    mover = tune(nominal(rig), bandwidth_hz=4.0).controller
    coarse, exact = (
        bench_run(plant, mover, rng=rng, seconds=seconds, encoder_bits=b) for b in (bits, EXACT)
    )
    wide = Filtering(cutoff)
    blocks = rows(rig, replace(coarse, v=None), wide)
    truth = given_beta(plant.rig, reduce_parameters(rig))
    well = excited(rows(rig, exact, Filtering()), truth)
    rivals = (fit_weighted, fit_idim, fit_output_error) if seed < compared else ()
    errors = {each.__name__: error(each(blocks).theta, truth, well) for each in rivals}
    clean = rows(rig, replace(exact, v=None), wide), rows(rig, coarse, Filtering())
    simulated = [(each, build_instruments(each, fit_physical(each))) for each in (blocks, *clean)]
    p = [compare_with_instruments(*pair).p_value for pair in simulated]
    return {"rig": rig.name, "p": p, "well": int(well.sum()), "parameters": len(truth), **errors}


def rows(rig: Rig, log: Log, filtering: Filtering) -> DesignBlocks:
    """Return the rows of a log."""
    return compute_blocks(rows_of(rig, log, filtering))


def excited(blocks: Sequence[Block], truth: Array) -> Array:
    """Whether a base parameter moves a good share of some joint's torque, (b,)."""
    A = np.concatenate([x.A[:, :, : len(truth)] for x in blocks])
    b = np.concatenate([x.b for x in blocks])
    share = np.sqrt(np.mean(A**2, axis=0) / np.mean(b**2, axis=0)[:, None]) * np.abs(truth)
    return np.asarray(share.max(axis=0) >= EXCITED)


def error(theta: Array, truth: Array, well: Array) -> list[float]:
    """Return the relative errors of the well-excited base parameters."""
    return list(np.abs(theta[: len(truth)] / truth - 1.0)[well])


def biased(
    logs: int = 100,
    bits: int = 16,
    cutoff: float = 80.0,
    seconds: float = 20.0,
    compared: int = 50,
    workers: int = CORES,
    resume: Path | None = None,
) -> None:
    """Measure bias of least squares, instrumental variables and output error, and what the test says of it.

    Args:
        logs: Number of logs.
        bits: Resolution of the encoders.
        cutoff: Low-pass on columns and torque, Hz: high, so that the encoders' noise, differentiated twice, comes in.
        seconds: Length of each, s.
        compared: On how many of them the estimators are compared; the test is asked of all.
        workers: Processes.
        resume: File of results to go on from.
    """
    found = results(partial(one, bits, cutoff, seconds, compared), range(logs), workers, resume)
    names = ("fit_weighted", "fit_idim", "fit_output_error")
    both = [row for row in found if names[0] in row]
    worst = np.array([[max(row[name]) for name in names] for row in both])
    counted, total = (sum(row[what] for row in both) for what in ("well", "parameters"))
    print(
        f"{len(both)} logs for the estimators: {counted} of {total} base parameters are well excited"
    )
    for name, column in zip(names, worst.T):
        every = np.concatenate([row[name] for row in both])
        print(
            f"{name:12} worst of each log: median {100 * np.median(column):.2f} %, largest {100 * column.max():.2f} %; "
            f"rms of all {100 * np.sqrt(np.mean(every**2)):.2f} %; over 3 %: {int(np.sum(every > WITHIN))} parameters"
        )
    flags = np.mean(np.array([row["p"] for row in found]) < 0.01, axis=0)
    for what, share in zip(
        ("coarse", "exact encoders, same cutoff", "coarse, with gyro at 4 Hz"), flags
    ):
        print(f"Durbin-Wu-Hausman at 1 %, {what}: {100 * share:.0f} % called biased")
    median = float(np.median(worst[:, 0]))
    right = bool((worst[:, 1:] <= WITHIN).all())
    passed = median > BIASED and right and flags[0] >= FLAGGED and (flags[1:] <= FALSE).all()
    print(
        f"{len(found)} logs, {bits} bits, no gyro, {cutoff:g} Hz: least squares off by {100 * median:.0f} % (over 20), "
        f"instrumental {100 * worst[:, 1].max():.2f} %, output error {100 * worst[:, 2].max():.2f} % at worst (3), "
        f"flagged {100 * flags[0]:.0f} % (95), clean {100 * flags[1:].max():.0f} % (5): {'PASS' if passed else 'FAIL'}"
    )
    sys.exit(not passed)
