"""A measured double pendulum: every estimator learns from one log and predicts the torque of two others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tqdm import tqdm
from tyro.conf import Positional

from gimbal_pin import read_log
from gimbal_pin.errors import GimbalPinError
from gimbal_pin.identification import ESTIMATORS, Accuracy, Identified, WhenTested, accuracy, identify
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Design, Filtering, compute_blocks
from gimbal_pin.rig.rig import Rig

TRAIN, TESTS = "061157", ("055640", "060143")
COLUMNS = ["t=time"] + [
    f"{ours}_{joint}={theirs}{k}"
    for k, joint in ((1, "shoulder"), (2, "elbow"))
    for ours, theirs in (("q", "pos"), ("dq", "vel"), ("tau", "tau"))
]


def pendulum(folder: Positional[Path], cutoff: float = 15.0) -> None:
    """Print each estimator's torque error on the log it learnt from and on two others.

    Args:
        folder: Where double_pendulum.urdf and the three 20220812-…-PM_measured.csv are.
        cutoff: Low-pass on columns and torque, Hz.
    """
    rig = Rig.load(folder / "double_pendulum.urdf")
    train, *tests = (read(folder, rig, name) for name in (TRAIN, *TESTS))
    rows = [learnt(rig, train, tests, name, cutoff) for name in tqdm(ESTIMATORS, unit="estimator", disable=None)]
    heads = f"{'learnt from ' + TRAIN:15}" + "".join(f"{title:>26}" for title in (TRAIN, *TESTS))
    print(f"torque error, N m rms, shoulder/elbow (share of the torque's rms), {cutoff:g} Hz\n{heads}")
    print("\n".join(rows))
    refits = " ".join(f"{error(own(rig, test, cutoff)):>25}" for test in tests)
    print(f"{'fitted to each':15}{'':26} {refits}")
    print(doubt(rig, train, cutoff))


def learnt(rig: Rig, train: Log, tests: list[Log], name: str, cutoff: float) -> str:
    """Return one estimator's line; what it cannot do is said in the place of figures."""
    try:
        found = fit(rig, train, name, cutoff)
    except GimbalPinError as refusal:
        return f"{name:15}{refusal}"
    return f"{name:15}" + " ".join(f"{error(predicted(found, log, cutoff)):>25}" for log in (train, *tests))


def read(folder: Path, rig: Rig, name: str) -> Log:
    """Read one of the logs."""
    return read_log(folder / f"20220812-{name}-PM_measured.csv", rig, COLUMNS)


def fit(rig: Rig, log: Log, name: str, cutoff: float, examined: WhenTested = "never") -> Identified:
    """Identify one log as a whole."""
    method = ESTIMATORS[name]
    return identify(rig, [log], estimator=method, holdout="none", filtering=Filtering(cutoff), examined=examined)


def predicted(found: Identified, log: Log, cutoff: float) -> Accuracy:
    """Compare what a model predicts with another log's torque."""
    effects = tuple(term.effect for term in found.model.terms)
    rows = compute_blocks(Design(found.model.rig, found.reduction, effects, (log,), Filtering(cutoff)))
    return accuracy(found.model.rig.joints, rows, found.estimate.theta, log.name)


def own(rig: Rig, log: Log, cutoff: float) -> Accuracy:
    """Return what least squares leaves of a log that it was fitted to: no model of this kind leaves less."""
    return fit(rig, log, "weighted", cutoff).train


def doubt(rig: Rig, train: Log, cutoff: float) -> str:
    """Say what the bias test says of the log."""
    found = fit(rig, train, "weighted", cutoff, "always").bias
    return "" if found is None else found.sentence


def error(found: Accuracy) -> str:
    """Errors of both joints, and the worse as a share."""
    rmse = np.array(list(found.torque_rmse.values()))
    fit_percent = np.array(list(found.fit_percent.values()))
    return f"{rmse[0]:.3f}/{rmse[1]:.3f} ({100 - fit_percent[0]:.0f}/{100 - fit_percent[1]:.0f} %)"
