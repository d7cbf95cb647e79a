"""Physical fit of noisy logs: always consistent, hardly ever worse, and every program loads what is written."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from estimation.jobs import CORES, results
from estimation.logs import drawn, noisy
from gimbal_pin.dynamics.model import Model
from gimbal_pin.identification import identify, measure_accuracy
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    Block,
    DesignBlocks,
    compute_autocovariance,
    compute_blocks,
    fit_autoregression,
    fit_physical,
    fit_weighted,
    join_blocks,
)
from gimbal_pin.rig.inertia import is_physical as can_exist
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import EXACT, rows_of, true_theta
from tests.rigs import taken_by_all

WORSE = 1.01


def one(seconds: float, noise: float, corner: float, seed: int) -> dict[str, Any]:
    """Fit one log with and without the constraint; compare the torque of another motion, as noisy and without noise."""
    rig, plant, rng = drawn(seed)
    log = noisy(plant, rng, seconds, noise, corner)[0]
    found, free = (
        identify(rig, [log], estimator=e, holdout="none", filtering=EXACT)
        for e in (fit_physical, fit_weighted)
    )
    limit = bound(rig, plant, log)
    ratios = []
    joint = 0.0
    apart = 0.0
    for test in noisy(plant, rng, 30.0, noise, corner):
        blocks = rows(rig, test)
        apart = moved(blocks, found.estimate.theta - free.estimate.theta) / unavoidable(
            blocks, limit
        )
        errors = np.array([left(rig, blocks, each.estimate.theta) for each in (found, free)])
        whole = np.linalg.norm(errors, axis=1)
        ratios.append(float(whole[0] / whole[1]))
        joint = joint or float((errors[0] / errors[1]).max())
    return {
        "consistent": bool(can_exist(found.consistent.phi) and found.physical),
        "ratio": ratios[0],
        "joint": joint,
        "clean": ratios[1],
        "moved": not bool(free.physical),
        "apart": apart,
        "loads": taken_by_all(found.to_urdf(), rig.n),
    }


def rows(rig: Rig, log: Log) -> DesignBlocks:
    """Return the rows of a log."""
    return compute_blocks(rows_of(rig, log))


def bound(rig: Rig, plant: Model, log: Log) -> Array:
    """Cramér and Rao's bound on the covariance of unbiased estimates, (k, k), by the colour of the noise itself."""
    whole = join_blocks(rows(rig, log))
    truth = true_theta(plant.rig)
    gamma = compute_autocovariance(
        [block.b - block.A @ truth for block in whole], [block.share for block in whole]
    )
    information = np.zeros((len(truth), len(truth)))
    for block in whole:
        for j, column in enumerate(gamma.T):
            polynomial, power = fit_autoregression(column, float(np.sum(block.share[:, j] ** 2)))
            white = lfilter(polynomial, [1.0], block.A[:, j], axis=0)
            information += white.T @ white / power
    return np.linalg.inv(information)


def moved(blocks: Sequence[Block], change: Array) -> float:
    """Torque that a change of parameters moves, N m rms."""
    return float(np.sqrt(np.mean(np.concatenate([block.A @ change for block in blocks]) ** 2)))


def unavoidable(blocks: Sequence[Block], covariance: Array) -> float:
    """Torque by which estimates of this covariance are off, N m rms."""
    A = np.concatenate([block.A for block in blocks]).reshape(-1, len(covariance))
    return float(np.sqrt(np.mean(np.sum(A @ covariance * A, axis=1))))


def left(rig: Rig, blocks: Sequence[Block], theta: Array) -> list[float]:
    """Return each joint's torque error, N m rms."""
    return list(measure_accuracy(rig.joints, blocks, theta, "held out").torque_rmse.values())


def physical(
    logs: int = 200,
    seconds: float = 20.0,
    noise: float = 0.1,
    corner: float = 2.0,
    workers: int = CORES,
    resume: Path | None = None,
) -> None:
    """Measure the physical fit against weighted least squares.

    Args:
        logs: Number of logs.
        seconds: Length of each, s.
        noise: Coloured noise on the torque, as a share of each joint's torque rms.
        corner: Corner of that noise, Hz.
        workers: Processes.
        resume: File of results to go on from.
    """
    found = results(partial(one, seconds, noise, corner), range(logs), workers, resume)
    ratio = np.array([row["ratio"] for row in found])
    consistent, loaded = (sum(row[name] for row in found) for name in ("consistent", "loads"))
    moved = sum(row["moved"] for row in found)
    passed = consistent == loaded == len(found) and ratio.max() <= WORSE
    over = [row["apart"] for row in found if row["ratio"] > WORSE]
    if over:
        print(
            f"{len(over)} over {WORSE}: there the two fits differ by {min(over):.2f} to {max(over):.2f} of what the "
            "Cramér-Rao bound leaves of error in that torque: the log does not tell which is the better one"
        )
    clean = np.array([row["clean"] for row in found if row["moved"]])
    print(
        f"held-out error of all joints over that without the constraint: median {np.median(ratio):.4f}, "
        f"least {ratio.min():.4f}; "
        f"worst of a single joint {max(row['joint'] for row in found):.3f}; "
        f"of the noise-free torque, where the constraint acts: median {np.median(clean):.3f}, worst {clean.max():.3f}"
    )
    print(
        f"{len(found)} logs ({moved} of them left what can exist without the constraint): {consistent} consistent, "
        f"{loaded} URDFs load in three programs, worst ratio {ratio.max():.4f} ({WORSE}): "
        f"{'PASS' if passed else 'FAIL'}"
    )
    sys.exit(not passed)
