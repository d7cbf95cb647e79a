"""Laws of what a model misses: noise is none of it, and where something is missed the deviations hold it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin import text
from gimbal_pin.estimators import weighted
from gimbal_pin.identification import given_beta, identify
from gimbal_pin.identification.misfit import GROUPS, honest, misfit
from gimbal_pin.log import Array, Log
from gimbal_pin.model import nominal
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig
from gimbal_pin.rows import kept
from tests.bench_logs import EXACT, prescribed, rows_of


@pytest.fixture(scope="module")
def turret() -> Rig:
    return Rig.load("turret")


def rippling(log: Log, size: float) -> Log:
    """The log with a ripple of 14 per turn at its first joint, as a share of that joint's torque."""
    tau = np.array(log.tau)
    tau[:, 0] += size * np.std(tau[:, 0]) * np.sin(14 * log.q[:, 0] + 0.7)
    return replace(log, tau=tau)


def deviations_off(rig: Rig, log: Log) -> tuple[Array, Array]:
    """Errors in deviations without and with what the model misses."""
    blocks = kept(rows_of(rig, log))
    plain = weighted(blocks)
    held, _ = honest(blocks, plain)
    assert np.array_equal(held.theta, plain.theta)
    true = np.concatenate([given_beta(rig, reduce(rig)), rig.friction.ravel()])
    return (plain.theta - true) / plain.std, (plain.theta - true) / held.std


def test_a_ripple_that_the_model_lacks_is_held_by_the_deviations(turret: Rig) -> None:
    logs = [prescribed(nominal(turret), seed, 20.0, torque_noise=0.01, dt=4e-3) for seed in range(2)]
    off = [deviations_off(turret, rippling(log, 1.0)) for log in logs]
    without, held = (np.array(x) for x in zip(*off))
    assert np.sqrt(np.mean(held**2)) < min(1.25, np.sqrt(np.mean(without**2)))


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_nothing_that_the_model_misses(seed: int) -> None:
    """White noise beside columns of any kind; what is a function of them is found to its size."""
    rng = np.random.default_rng(seed)
    A, X = rng.standard_normal((600, 5)), rng.standard_normal((600, len(GROUPS)))
    noise = rng.standard_normal(600)
    assert misfit(A, X, A.sum(axis=1) + noise, 600.0).size < 0.25
    missed = 2.0 * X[:, GROUPS == 1] @ rng.standard_normal(int(np.sum(GROUPS == 1)))
    found = misfit(A, X, A.sum(axis=1) + missed + noise, 600.0)
    assert found.size == pytest.approx(np.std(missed), rel=0.15) and found.noise == pytest.approx(1.0, rel=0.15)


def test_a_joint_that_is_not_explained_is_said_first(turret: Rig) -> None:
    log = prescribed(nominal(turret), 1, 20.0, torque_noise=0.01, dt=4e-3)
    found = identify(turret, [rippling(log, 1.0)], filtering=EXACT)
    first, fit = found.warnings[0], found.held_out.fit_percent["pan"]
    assert first.startswith("pan is not explained: ") and "run diagnose" in first and fit < 90
    assert text.identified(found).startswith(f"warning: {first}\n")
    assert not any(said.startswith("tilt is not explained") for said in found.warnings)
    assert not any("not explained" in said for said in identify(turret, [log], filtering=EXACT).warnings)
    assert found.to_dict()["misfit"]["pan"]["torque_rms"] > 10 * found.to_dict()["misfit"]["tilt"]["torque_rms"]
