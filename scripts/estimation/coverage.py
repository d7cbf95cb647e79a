"""95 % intervals of logs with coloured noise: how often the truth is in them."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from estimation.jobs import CORES, results
from estimation.logs import drawn, noisy
from gimbal_pin.identification import ESTIMATORS, identify
from gimbal_pin.regression import Filtering, Method
from tests.bench_logs import true_theta

NORMAL = 1.959964
BAND = (0.93, 0.97)
CORNERS = (0.3, 10.0)


def one(estimator: str, seconds: float, noise: float, seed: int) -> dict[str, Any]:
    """Identify one log; return every parameter's error in its own deviations."""
    rig, plant, rng = drawn(seed)
    corner = float(np.exp(rng.uniform(*np.log(CORNERS))))
    log = noisy(plant, rng, seconds, noise, corner)[0]
    method = ESTIMATORS[Method(estimator)]
    found = identify(
        rig, [log], estimator=method, holdout="none", filtering=Filtering(alignment=0.0)
    )
    return {
        "corner": corner,
        "z": ((found.estimate.theta - true_theta(plant.rig)) / found.estimate.std).tolist(),
    }


def coverage(
    logs: int = 500,
    seconds: float = 40.0,
    noise: float = 0.05,
    estimator: Literal[
        "ols", "weighted", "robust", "instrumental", "output-error", "ridge", "physical"
    ] = "weighted",
    workers: int = CORES,
    resume: Path | None = None,
) -> None:
    """Measure the coverage of 95 % intervals, pooled over the parameters of all logs.

    The noise on the torque is white through a low-pass of 0.3 to 10 Hz, drawn per log; the sensors are the rig's.

    Args:
        logs: Number of logs.
        seconds: Length of each, s.
        noise: Noise, as a share of each joint's torque rms.
        estimator: Estimator.
        workers: Processes.
        resume: File of results to go on from.
    """
    rows = results(partial(one, estimator, seconds, noise), range(logs), workers, resume)
    middle = float(np.sqrt(CORNERS[0] * CORNERS[1]))
    for name, some in (
        ("below", [r for r in rows if r["corner"] < middle]),
        ("above", [r for r in rows if r["corner"] >= middle]),
    ):
        z = np.abs(np.concatenate([row["z"] for row in some]))
        print(
            f"corner {name} {middle:.1f} Hz: {len(some)} logs, {100 * np.mean(z < NORMAL):.1f} % covered"
        )
    z = np.concatenate([row["z"] for row in rows])
    share = float(np.mean(np.abs(z) < NORMAL))
    passed = BAND[0] <= share <= BAND[1]
    print(
        f"{len(rows)} logs, {len(z)} parameters, {estimator}: {100 * share:.1f} % of the 95 % intervals hold the truth "
        f"(93 to 97), errors of {np.std(z):.2f} deviations rms: {'PASS' if passed else 'FAIL'}"
    )
    sys.exit(not passed)
