"""Laws of the estimators that simulate, of the pull towards the URDF, of residuals' colour, and of the bias test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import (
    ESTIMATORS,
    Hausman,
    compare_with_instruments,
    fit_idim,
    fit_output_error,
    given_beta,
    greatest_base_motion,
)
from gimbal_pin.identification.bias_test import BiasCheck, check_bias
from gimbal_pin.log import Array, Log
from gimbal_pin.regression import (
    DesignBlocks,
    Filtering,
    Method,
    compute_blocks,
    fit_ridge,
    fit_weighted,
)
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed, rows_of
from tests.identification.test_moving_log import carried, swaying

NOISY = 0.03

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
    share = np.sqrt(
        np.mean(A[:, :, : len(truth)] ** 2, axis=0) / np.mean(b**2, axis=0)[:, None]
    ) * np.abs(truth)
    return share.max(axis=0) >= 0.2, truth


def test_noisy_angles_bias_least_squares_and_neither_of_those_that_simulate(
    turret: Rig, coarse: DesignBlocks
) -> None:
    heavy, truth = heaviest(turret, coarse)

    def worst(theta: Array) -> float:
        return float(np.max(np.abs(theta[: len(truth)] / truth - 1)[heavy]))

    assert heavy.sum() >= 3 and worst(fit_weighted(coarse).theta) > 0.2
    assert worst(fit_idim(coarse).theta) < 0.03 and worst(fit_output_error(coarse).theta) < 0.03


def test_the_bias_test_flags_the_noisy_log_and_not_the_quiet_one(
    coarse: DesignBlocks, quiet: DesignBlocks
) -> None:
    flagged = check_bias(coarse, "noisy")
    clear = check_bias(quiet, "always")
    assert flagged is not None and flagged.test is not None and flagged.noise > NOISY
    assert (
        flagged.test.biased
        and flagged.by_noise
        and "instrumental" in flagged.sentence
        and flagged.to_dict()["biased"] is True
    )
    assert (
        clear is not None
        and clear.test is not None
        and clear.test.p_value > 0.01
        and not clear.test.biased
    )


def test_little_noise_is_not_worth_a_test_and_nobody_asked_gets_none(quiet: DesignBlocks) -> None:
    found = check_bias(quiet, "noisy")
    assert (
        found is not None
        and found.test is None
        and found.noise < NOISY
        and found.to_dict()["biased"] is None
    )
    assert check_bias(quiet, "never") is None


def test_a_difference_that_noise_cannot_make_is_the_models() -> None:
    """Bias goes with the square of the noise's share: the same difference at a tenth of the noise has another cause."""
    test = Hausman(900.0, 12, 0.0, 0.04)
    noisy = BiasCheck(0.2, test)
    quiet = BiasCheck(0.02, test)
    assert noisy.by_noise and "use --estimator output-error" in noisy.sentence
    used = BiasCheck(0.2, test, method=Method.OUTPUT_ERROR).sentence
    assert "biased" in used and "use --estimator" not in used
    assert (
        not quiet.by_noise and "diagnose" in quiet.sentence and "output-error" not in quiet.sentence
    )


def test_columns_that_are_their_own_instruments_say_nothing_else(coarse: DesignBlocks) -> None:
    found = compare_with_instruments(coarse, [block.A for block in coarse])
    assert found.p_value == 1.0 and found.change < 1e-9


def test_lost_samples_leave_instruments_and_rows_of_one_shape(turret: Rig, log: Log) -> None:
    """Whether the motion closes a hole depends on its resolution: the simulated motion has the measured one's holes."""
    some = np.ones(len(log), bool)
    for begin, lost in ((3000, 40), (6000, 60), (8000, 300)):
        some[begin : begin + lost] = False
    torn = quantised(log, 11)
    torn = replace(torn, t=torn.t[some], q=torn.q[some], tau=np.asarray(torn.tau)[some], v=None)
    blocks = compute_blocks(rows_of(turret, torn, EXACT))
    free = fit_weighted(blocks)
    assert np.all(np.abs(fit_idim(blocks).theta - free.theta) < 6 * free.std)


def test_trust_leads_from_the_data_to_the_urdf(turret: Rig, quiet: DesignBlocks) -> None:
    heavier = turret.with_phi(1.3 * turret.phi)
    rows = replace(quiet.design, rig=heavier)
    blocks = DesignBlocks(rows, quiet.blocks)
    free = fit_weighted(blocks)
    given = given_beta(heavier, rows.reduction)
    width = len(rows.mixing)
    loose, tight = (fit_ridge(blocks, trust) for trust in (1e4, 1e-9))
    assert np.allclose(loose.theta, free.theta, atol=1e-2 * free.std.min())
    assert np.allclose(tight.theta[:width], given, rtol=1e-4, atol=1e-6)
    assert np.all(fit_ridge(blocks, 0.1).std <= 1.05 * free.std) and np.all(
        tight.std[:width] < free.std[:width]
    )


@pytest.mark.parametrize(
    "name", [Method.INSTRUMENTAL, Method.OUTPUT_ERROR, Method.RIDGE, Method.PHYSICAL]
)
def test_rows_mixed_from_several_rigs_are_refused(name: Method, quiet: DesignBlocks) -> None:
    with pytest.raises(UsageError, match="several payloads"):
        ESTIMATORS[name](list(quiet))


def test_estimators_that_simulate_know_a_base_that_moves() -> None:
    """They say what least squares says of a log without noise; output error up to its step of 4 ms over jumps."""
    rig = Rig.load("turret")
    log = carried(nominal(rig), swaying(1e-3 * np.arange(6001)), 6.0)
    assert greatest_base_motion(rig, [log]) == "rotating"
    blocks = compute_blocks(rows_of(rig, log, base="rotating"))
    first = fit_weighted(blocks).theta
    assert np.abs(fit_idim(blocks).theta - first).max() < 1e-3 * np.abs(first).max()
    assert np.abs(fit_output_error(blocks).theta - first).max() < 5e-3 * np.abs(first).max()
