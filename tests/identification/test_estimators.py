"""Estimators that simulate, the pull towards the URDF, and the test for bias by noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import (
    ESTIMATORS,
    fit_idim,
    fit_output_error,
    given_beta,
    greatest_base_motion,
)
from gimbal_pin.identification.bias_test import check_bias
from gimbal_pin.log import Log
from gimbal_pin.regression import (
    DesignBlocks,
    Estimate,
    Filtering,
    Method,
    compute_blocks,
    fit_ridge,
    fit_weighted,
)
from tests.bench_logs import prescribed, rows_of
from tests.identification.logs import carry, list_times, sway
from tests.rigs import bundled

RIG = bundled("turret", "infrared")
LOG = prescribed(nominal(RIG), 3, 8.0, torque_noise=0.01)
WIDE = Filtering(60.0, alignment=0.0)
"""A cutoff that lets the noise of differentiated angles in."""


def quantise(log: Log, bits: int) -> Log:
    """Return the log with angles of an encoder and without rates."""
    step = 2 * np.pi / 2**bits
    return replace(log, q=np.round(log.q / step) * step, v=None)


COARSE = compute_blocks(rows_of(RIG, quantise(LOG, 15), WIDE))
QUIET = compute_blocks(rows_of(RIG, replace(LOG, v=None), WIDE))


def test_noisy_angles_bias_least_squares_and_no_estimator_that_simulates() -> None:
    """Largest relative error among parameters that move a fifth of some joint's torque."""
    planted = given_beta(RIG, COARSE.design.reduction)
    width = len(planted)
    A, b = (np.concatenate([getattr(block, name) for block in COARSE]) for name in ("A", "b"))
    torque = np.sqrt(np.mean((A[:, :, :width] * planted) ** 2, axis=0))
    heavy = np.any(torque > 0.2 * np.sqrt(np.mean(b**2, axis=0))[:, None], axis=0)
    assert heavy.sum() >= 3

    def find_worst(found: Estimate) -> float:
        return float(np.max(np.abs(found.theta[:width] / planted - 1)[heavy]))

    assert find_worst(fit_weighted(COARSE)) > 0.2
    assert find_worst(fit_idim(COARSE)) < 0.03
    assert find_worst(fit_output_error(COARSE)) < 0.03


def test_bias_is_found_where_the_angles_are_noisy() -> None:
    noisy = check_bias(COARSE, "noisy")
    quiet = check_bias(QUIET, "always")
    assert noisy is not None and noisy.test is not None
    assert quiet is not None and quiet.test is not None
    assert noisy.test.biased and noisy.by_noise
    assert quiet.test.p_value > 0.01 and not quiet.test.biased
    skipped = check_bias(QUIET, "noisy")
    assert skipped is not None and skipped.test is None
    assert check_bias(QUIET, "never") is None
    assert not replace(noisy, noise=noisy.noise / 10).by_noise


def test_trust_leads_from_the_data_to_the_urdf() -> None:
    rows = replace(QUIET.design, rig=RIG.with_phi(1.3 * RIG.phi))
    blocks = DesignBlocks(rows, QUIET.blocks)
    free = fit_weighted(blocks)
    width = len(rows.mixing)
    loose, some, tight = (fit_ridge(blocks, trust) for trust in (1e4, 0.1, 1e-9))
    np.testing.assert_allclose(loose.theta, free.theta, atol=1e-2 * free.std.min())
    given = given_beta(rows.rig, rows.reduction)
    np.testing.assert_allclose(tight.theta[:width], given, rtol=1e-4, atol=1e-6)
    assert np.all(some.std <= 1.05 * free.std)
    assert np.all(tight.std[:width] < free.std[:width])


@pytest.mark.parametrize(
    "name", [Method.INSTRUMENTAL, Method.OUTPUT_ERROR, Method.RIDGE, Method.PHYSICAL]
)
def test_rows_of_several_rigs_are_refused(name: Method) -> None:
    with pytest.raises(UsageError, match="several payloads"):
        ESTIMATORS[name](list(QUIET))


def test_estimators_that_simulate_know_a_base_that_moves() -> None:
    rig = bundled("turret")
    log = carry(nominal(rig), sway(list_times(6.0)), 6.0)
    assert greatest_base_motion(rig, [log]) == "rotating"
    blocks = compute_blocks(rows_of(rig, log, base="rotating"))
    first = fit_weighted(blocks).theta
    scale = np.abs(first).max()
    np.testing.assert_allclose(fit_idim(blocks).theta, first, atol=1e-3 * scale)
    np.testing.assert_allclose(fit_output_error(blocks).theta, first, atol=5e-3 * scale)
