"""Laws of the estimators that simulate, of the pull towards the URDF, of residuals' colour, and of the bias test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.dynamics.model import nominal
from gimbal_pin.errors import UsageError
from gimbal_pin.estimation.estimators import ESTIMATORS, Hausman, Ridge, hausman, idim, output_error, weighted
from gimbal_pin.estimation.estimators.closed_loop import runs
from gimbal_pin.estimation.estimators.colour import colour, coloured, cramer_rao
from gimbal_pin.estimation.estimators.hausman import LEVEL, NOISY, BiasCheck, check_bias, noise_share
from gimbal_pin.estimation.identification import given_beta, greatest_base_motion
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Block, DesignBlocks, Filtering, compute_blocks
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import EXACT, prescribed, rows_of
from tests.test_moving_log import carried, swaying

WIDE = Filtering(60.0, alignment=0.0)


def quantised(log: Log, bits: int) -> Log:
    step = 2 * np.pi / 2**bits
    return replace(log, q=np.round(log.q / step) * step, v=None)


@pytest.fixture(scope="module")
def turret() -> Rig:
    return Rig.load("turret", "infrared")


@pytest.fixture(scope="module")
def log(turret: Rig) -> Log:
    return prescribed(nominal(turret), 3, 10.0, torque_noise=0.01)


@pytest.fixture(scope="module")
def coarse(turret: Rig, log: Log) -> DesignBlocks:
    """Encoders of 15 bits, differentiated twice under a cutoff that lets their noise in."""
    return compute_blocks(rows_of(turret, quantised(log, 15), WIDE))


@pytest.fixture(scope="module")
def quiet(turret: Rig, log: Log) -> DesignBlocks:
    """The same with exact angles."""
    return compute_blocks(rows_of(turret, replace(log, v=None), WIDE))


def heaviest(rig: Rig, blocks: DesignBlocks) -> tuple[Array, Array]:
    """Base parameters that move a fifth of some joint's torque, and the truth."""
    truth = given_beta(rig, blocks.design.reduction)
    A, b = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("A", "b"))
    share = np.sqrt(np.mean(A[:, :, : len(truth)] ** 2, axis=0) / np.mean(b**2, axis=0)[:, None]) * np.abs(truth)
    return share.max(axis=0) >= 0.2, truth


def test_noisy_angles_bias_least_squares_and_neither_of_those_that_simulate(turret: Rig, coarse: DesignBlocks) -> None:
    heavy, truth = heaviest(turret, coarse)

    def worst(theta: Array) -> float:
        return float(np.max(np.abs(theta[: len(truth)] / truth - 1)[heavy]))

    assert heavy.sum() >= 3 and worst(weighted(coarse).theta) > 0.2
    assert worst(idim(coarse).theta) < 0.03 and worst(output_error(coarse).theta) < 0.03


def test_the_bias_test_flags_the_noisy_log_and_not_the_quiet_one(coarse: DesignBlocks, quiet: DesignBlocks) -> None:
    flagged, clear = check_bias(coarse, "noisy"), check_bias(quiet, "always")
    assert flagged is not None and flagged.test is not None and flagged.noise > NOISY
    assert (
        flagged.test.biased
        and flagged.by_noise
        and "instrumental" in flagged.sentence
        and flagged.to_dict()["biased"] is True
    )
    assert clear is not None and clear.test is not None and clear.test.p_value > LEVEL and not clear.test.biased


def test_little_noise_is_not_worth_a_test_and_nobody_asked_gets_none(quiet: DesignBlocks) -> None:
    found = check_bias(quiet, "noisy")
    assert found is not None and found.test is None and found.noise < NOISY and found.to_dict()["biased"] is None
    assert check_bias(quiet, "never") is None


def test_a_difference_that_noise_cannot_make_is_the_models() -> None:
    """Bias goes with the square of the noise's share: the same difference at a tenth of the noise has another cause."""
    test = Hausman(900.0, 12, 0.0, 0.04)
    noisy, quiet = BiasCheck(0.2, test), BiasCheck(0.02, test)
    assert noisy.by_noise and "use --estimator output-error" in noisy.sentence
    used = BiasCheck(0.2, test, method="output-error").sentence
    assert "biased" in used and "use --estimator" not in used
    assert not quiet.by_noise and "diagnose" in quiet.sentence and "output-error" not in quiet.sentence


def test_columns_that_are_their_own_instruments_say_nothing_else(coarse: DesignBlocks) -> None:
    found = hausman(coarse, [block.A for block in coarse])
    assert found.p_value == 1.0 and found.change < 1e-9


def test_noise_share_goes_with_the_encoders_step(turret: Rig, log: Log) -> None:
    fine, rough = (noise_share(quantised(log, bits), EXACT, compute_blocks(rows_of(turret, log))) for bits in (16, 12))
    assert rough / fine == pytest.approx(16.0, rel=0.2)


def test_a_true_model_follows_its_log(turret: Rig) -> None:
    """In the loop the model of a log without noise stays within a thousandth of what the rig moved."""
    log = prescribed(nominal(turret), 1, 8.0)
    (run,) = runs(rows_of(turret, log), nominal(turret), log, calm=False)
    inner = run.error[len(run.t) // 10 : -len(run.t) // 10]
    assert np.abs(inner).max() < 1e-3 * np.ptp(log.q)


@pytest.mark.parametrize("bits", [11, 24])
def test_lost_samples_leave_instruments_and_rows_of_one_shape(turret: Rig, log: Log, bits: int) -> None:
    """Whether the motion closes a hole depends on its resolution: the simulated motion has the measured one's holes."""
    some = np.ones(len(log), bool)
    for begin, lost in ((3000, 40), (6000, 60), (8000, 300)):
        some[begin : begin + lost] = False
    torn = quantised(log, bits)
    torn = replace(torn, t=torn.t[some], q=torn.q[some], tau=np.asarray(torn.tau)[some], v=None)
    blocks = compute_blocks(rows_of(turret, torn, EXACT))
    free = weighted(blocks)
    assert np.all(np.abs(idim(blocks).theta - free.theta) < 6 * free.std)


def test_trust_leads_from_the_data_to_the_urdf(turret: Rig, quiet: DesignBlocks) -> None:
    heavier = turret.with_phi(1.3 * turret.phi)
    rows = replace(quiet.rows, rig=heavier)
    blocks = DesignBlocks(rows, quiet.blocks)
    free, given, width = weighted(blocks), given_beta(heavier, rows.reduction), len(rows.mixing)
    loose, tight = Ridge(1e4)(blocks), Ridge(1e-9)(blocks)
    assert np.allclose(loose.theta, free.theta, atol=1e-2 * free.std.min())
    assert np.allclose(tight.theta[:width], given, rtol=1e-4, atol=1e-6)
    assert np.all(Ridge(0.1)(blocks).std <= 1.05 * free.std) and np.all(tight.std[:width] < free.std[:width])


@pytest.mark.parametrize("name", ["instrumental", "output-error", "ridge", "physical"])
def test_rows_mixed_from_several_rigs_are_refused(name: str, quiet: DesignBlocks) -> None:
    with pytest.raises(UsageError, match="several payloads"):
        ESTIMATORS[name](list(quiet))


def test_an_autoregressive_colour_is_found() -> None:
    rng, polynomial = np.random.default_rng(0), np.array([1.0, -1.2, 0.5])
    noise = lfilter([1.0], polynomial, rng.standard_normal(100_000))[500:]
    gamma = np.array([np.mean(noise[: len(noise) - k] * noise[k:]) for k in range(9)])
    found = colour(gamma, len(noise))
    assert np.allclose(found.polynomial[:3], polynomial, atol=0.02) and found.power == pytest.approx(1.0, rel=0.02)
    assert np.abs(found.polynomial[3:]).max(initial=0.0) < 0.02


def test_coloured_covariance_is_that_of_many_estimates() -> None:
    """Slow noise on slow columns: white deviations are far too small, the coloured ones are those of repetition."""
    rng, count = np.random.default_rng(1), 150
    t = np.arange(400.0)
    A = np.stack([np.ones_like(t), np.sin(0.05 * t), np.sin(0.9 * t)], axis=1)[:, None, :]
    thetas, stated = [], []
    gain = np.linalg.inv(A[:, 0].T @ A[:, 0])
    for _ in range(count):
        b = lfilter([1.0], [1.0, -0.9], rng.standard_normal(500))[100:, None]
        block = Block(t, A, b, b, b, np.ones_like(b))
        thetas.append(gain @ A[:, 0].T @ b[:, 0])
        stated.append(np.diag(coloured([block], [A], thetas[-1], gain, np.ones(1))))
    true, white = np.var(thetas, axis=0), np.diag(gain) * 1.0 / (1 - 0.81)
    assert np.allclose(np.mean(stated, axis=0), true, rtol=0.25)
    assert true[0] > 5 * white[0] and true[2] < 0.5 * white[2]


def test_estimators_that_simulate_know_a_base_that_moves() -> None:
    """They say what least squares says of a log without noise; output error up to its step of 4 ms over jumps."""
    rig = Rig.load("turret")
    log = carried(nominal(rig), swaying(1e-3 * np.arange(6001)), 6.0)
    assert greatest_base_motion(rig, [log]) == "rotating"
    blocks = compute_blocks(rows_of(rig, log, base="rotating"))
    first = weighted(blocks).theta
    assert np.abs(idim(blocks).theta - first).max() < 1e-3 * np.abs(first).max()
    assert np.abs(output_error(blocks).theta - first).max() < 5e-3 * np.abs(first).max()


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_the_bound_is_the_one_of_the_noises_own_covariance(memory: float) -> None:
    """``(Aᵀ Γ⁻¹ A)⁻¹`` written out for a process of one pole, and no least squares of these rows is below it."""
    rng, m = np.random.default_rng(4), 1500
    A = lfilter([1.0], [1.0, -0.9], rng.standard_normal((m, 1, 3)), axis=0)
    noise = lfilter([1.0], [1.0, -memory], rng.standard_normal((m, 1)), axis=0)
    theta, ones = np.array([1.0, -2.0, 0.5]), np.ones((m, 1))
    block = Block(0.1 * np.arange(m), A, (A @ theta) + noise, ones, ones, ones)
    gamma = memory ** np.abs(np.subtract.outer(np.arange(m), np.arange(m))) / (1 - memory**2)
    flat = A[:, 0]
    exact = np.sqrt(np.diag(np.linalg.inv(flat.T @ np.linalg.solve(gamma, flat))))
    found = weighted([block])
    np.testing.assert_allclose(cramer_rao([block], found.theta), exact, rtol=0.08)
    plain = np.linalg.pinv(flat)
    assert (np.sqrt(np.diag(plain @ gamma @ plain.T)) >= 0.999 * exact).all()
