"""Laws of what a model misses: noise is none of it, and where something is missed the deviations hold it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.dynamics.apply import plant_with
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.dynamics.reduction import reduce
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import LogError
from gimbal_pin.estimation.estimators import weighted
from gimbal_pin.estimation.identification import given_beta, identify
from gimbal_pin.estimation.identification.misfit import GROUPS, misfit, with_misfit
from gimbal_pin.estimation.rows import regression
from gimbal_pin.log.io import write_log
from gimbal_pin.log.log import Array, Log
from gimbal_pin.report import text
from gimbal_pin.rig.consistency import likeliest
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import EXACT, prescribed, rows_of
from tests.command_line import Run


@pytest.fixture(scope="module")
def turret() -> Rig:
    return Rig.load("turret")


def test_a_torque_in_another_unit_is_refused_with_the_map_that_mends_it() -> None:
    rig = Rig.load("drone")
    log = prescribed(nominal(rig), 1, 6.0, dt=4e-3)
    loud = replace(log, tau=2000.0 * rig.tau_max * log.tau / np.abs(log.tau).max(axis=0))  # type: ignore[operator]
    with pytest.raises(
        LogError, match=r"tau_yaw.*times the motor's 4.5 N m.*--map 'tau_yaw=tau_yaw\*0.00075'.* from mA"
    ):
        identify(rig, [loud])


def test_what_no_log_determines_stays_near_the_urdf(turret: Rig) -> None:
    """A value as vague as can be leaves the URDF's bodies as they are; a sharp one moves them all the way."""
    rig, mixing = turret, rows_of(turret, prescribed(nominal(turret), 1, 4.0, dt=4e-3)).mixing
    beta = mixing @ rig.phi
    vague = likeliest(rig.phi, mixing, 1.5 * beta, np.diag((100 * beta + 1.0) ** 2), 0.3)
    sharp = likeliest(rig.phi, mixing, 1.2 * beta, np.diag((1e-4 * np.abs(beta) + 1e-9) ** 2), 0.3)
    assert np.allclose(vague, rig.phi, rtol=0.01, atol=1e-4)
    assert np.allclose(mixing @ sharp, 1.2 * beta, rtol=2e-3, atol=1e-6)


def test_an_inertia_just_under_zero_is_undetermined(turret: Rig) -> None:
    found = identify(turret, [prescribed(nominal(turret), 1, 20.0, torque_noise=0.01, dt=4e-3)], filtering=EXACT)
    k = found.names.index("tilt.Fv")
    theta = found.estimate.theta.copy()
    theta[k] = -1.5 * found.estimate.std[k]
    said = replace(found, estimate=replace(found.estimate, theta=theta)).warnings
    assert any(one.startswith("undetermined") and "tilt.Fv (-" in one for one in said)
    assert not any(one.startswith("undetermined") for one in found.warnings)


def rippling(log: Log, size: float) -> Log:
    """The log with a ripple of 14 per turn at its first joint, as a share of that joint's torque."""
    tau = np.array(log.tau)
    tau[:, 0] += size * np.std(tau[:, 0]) * np.sin(14 * log.q[:, 0] + 0.7)
    return replace(log, tau=tau)


def deviations_off(rig: Rig, log: Log) -> tuple[Array, Array]:
    """Errors in deviations without and with what the model misses."""
    blocks = regression(rows_of(rig, log))
    plain = weighted(blocks)
    held, _ = with_misfit(blocks, plain)
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


def test_the_urdf_has_the_bodies_of_the_extended_model(run: Run, tmp_path: Path, turret: Rig) -> None:
    """With the cogging that was found in the equations they are nearer to the truth, by either verb the same."""
    log, folder = tmp_path / "log.csv", tmp_path / "found"
    teeth = parse_effect("cogging:pan:amplitude=0.05,harmonic=7", turret)
    write_log(prescribed(plant_with(nominal(turret), [teeth]).plant, 3, 8.0, torque_noise=0.01, dt=4e-3), log)
    urdfs = [tmp_path / f"{name}.urdf" for name in ("plain", "diagnosed", "extended")]
    still = ("--alignment", "0")
    assert run("identify", "turret", log, "--urdf", urdfs[0], *still)[0] == 0
    assert run("diagnose", "turret", log, "-o", folder, "--urdf", urdfs[1], *still)[0] == 0
    assert run("identify", "turret", log, "--extended", folder / "extended.yaml", "--urdf", urdfs[2], *still)[0] == 0
    known = reduce(turret)
    off = [np.linalg.norm(given_beta(Rig.load(urdf), known) - given_beta(turret, known)) for urdf in urdfs]
    assert off[1] < 0.5 * off[0] and off[2] == pytest.approx(off[1], rel=1e-6)
