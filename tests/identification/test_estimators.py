"""Laws of the estimators.

Those that simulate are not biased by noise, whose bias a test finds; trust leads from the data to the URDF; and bodies
that can exist are the optimum of a semidefinite solver.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.errors import DataError, UsageError
from gimbal_pin.identification import (
    ESTIMATORS,
    fit_idim,
    fit_output_error,
    given_beta,
)
from gimbal_pin.identification.bias_test import check_bias
from gimbal_pin.log import Array
from gimbal_pin.regression import (
    PSEUDO_INERTIA_BASIS,
    DesignBlocks,
    Filtering,
    Method,
    build_program,
    compute_blocks,
    compute_residual_power,
    count_effective_rows,
    factor_rows,
    factor_wide_states,
    find_nearest_bodies,
    fit_physical,
    fit_ridge,
    fit_weighted,
    map_phi_to_base,
    weigh_joints,
)
from gimbal_pin.rig import is_physical
from tests.bench_logs import prescribed, rows_of
from tests.rigs import bundled

RIG = bundled("turret", "infrared")
LOG = replace(prescribed(nominal(RIG), 3, 8.0, torque_noise=0.01), v=None)
WIDE = Filtering(60.0, alignment=0.0)
"""A cutoff that lets the noise of differentiated angles in."""
STEP = 2 * np.pi / 2**15
"""Of an encoder, rad."""
COARSE = compute_blocks(rows_of(RIG, replace(LOG, q=np.round(LOG.q / STEP) * STEP), WIDE))
QUIET = compute_blocks(rows_of(RIG, LOG, WIDE))


def test_noisy_angles_bias_least_squares_and_no_estimator_that_simulates() -> None:
    """Largest relative error among parameters that move a fifth of some joint's torque."""
    planted = given_beta(RIG, COARSE.design.reduction)
    width = len(planted)
    A, b = (np.concatenate([getattr(block, name) for block in COARSE]) for name in ("A", "b"))
    torque = np.sqrt(np.mean((A[:, :, :width] * planted) ** 2, axis=0))
    heavy = np.any(torque > 0.2 * np.sqrt(np.mean(b**2, axis=0))[:, None], axis=0)
    assert heavy.sum() >= 3
    plain, idim, output = (
        np.max(np.abs(fit(COARSE).theta[:width] / planted - 1)[heavy])
        for fit in (fit_weighted, fit_idim, fit_output_error)
    )
    assert plain > 0.2
    assert max(idim, output) < 0.03


def test_bias_is_found_where_the_angles_are_noisy() -> None:
    noisy, quiet, skipped = (
        check_bias(COARSE, "noisy"),
        check_bias(QUIET, "always"),
        check_bias(QUIET, "noisy"),
    )
    assert noisy is not None and noisy.test is not None
    assert quiet is not None and quiet.test is not None
    assert noisy.test.biased and noisy.by_noise
    assert quiet.test.p_value > 0.01 and not quiet.test.biased
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


# --- Bodies that can exist ---------------------------------------------------------------------------


def solve_semidefinite(mixing: Array, rows: Array, target: Array) -> float:
    """Return by cvxpy the shortest residual that bodies and friction of no negative size reach."""
    cp = pytest.importorskip("cvxpy", reason="cvxpy is the oracle: pip install 'gimbal-pin[test]'")
    phi = cp.Variable(mixing.shape[1])
    free = cp.Variable(rows.shape[1] - len(mixing) + 1)
    exist = [
        sum(phi[10 * i + k] * PSEUDO_INERTIA_BASIS[k] for k in range(10)) >> 0
        for i in range(mixing.shape[1] // 10)
    ]
    theta = cp.hstack([mixing @ phi, free[:-1]])
    problem = cp.Problem(cp.Minimize(cp.norm(rows @ theta - target)), [*exist, free >= 0])
    return float(problem.solve(solver=cp.CLARABEL))


@pytest.mark.parametrize(("name", "seed"), [("thesis", 0), ("handheld", 3)])
def test_nearest_bodies_are_those_of_a_semidefinite_program(name: str, seed: int) -> None:
    """Of base parameters wrong by several of their deviations, which span decades."""
    rig = bundled(name, "cinema")
    mixing = map_phi_to_base(rig, reduce_parameters(rig))
    rng = np.random.default_rng(seed)
    beta = mixing @ rig.phi
    std = 10.0 ** rng.uniform(-2.5, 0.0, len(beta)) * np.abs(beta) + 1e-4
    beta = beta + 3 * std * rng.standard_normal(len(beta))
    found = find_nearest_bodies(rig.phi, mixing, beta, np.diag(std**2))
    best = solve_semidefinite(mixing, np.diag(1 / std), beta / std)
    assert is_physical(found.phi)
    assert found.distance == pytest.approx(best, rel=1e-4, abs=1e-4)


def test_physical_fit_is_that_of_a_semidefinite_program() -> None:
    """Of a torque as noisy as large its residual is the least that bodies reach, and more than the free estimate's."""
    rig = bundled("thesis")
    blocks = compute_blocks(rows_of(rig, prescribed(nominal(rig), 1, 8.0, torque_noise=1.0)))
    factors = factor_rows(blocks)
    count = count_effective_rows(blocks)
    found = fit_physical(blocks)
    scale = weigh_joints(compute_residual_power(factors, found.theta, count))
    wide = factor_wide_states(blocks.design, factors.shape[2] - 1)
    stack = build_program(factors, wide, scale, count)
    mixing = blocks.design.mixing
    assert found.phi is not None and is_physical(found.phi)
    np.testing.assert_allclose(mixing @ found.phi, found.theta[: len(mixing)], atol=1e-9)
    best = solve_semidefinite(mixing, stack[:, :-1], stack[:, -1])
    assert np.linalg.norm(stack @ np.append(found.theta, -1.0)) == pytest.approx(best, rel=1e-5)
    free = fit_weighted(blocks).theta
    assert np.linalg.norm(stack @ np.append(free, -1.0)) < 0.999 * best


@pytest.mark.parametrize(("beta", "variance"), [(np.inf, 1.0), (0.0, np.nan)])
def test_estimate_beyond_all_bodies_is_refused(beta: float, variance: float) -> None:
    phi = RIG.phi
    one = np.eye(len(phi))
    with np.errstate(all="ignore"), pytest.raises(DataError, match="look at the units"):
        find_nearest_bodies(phi, one, np.full(len(phi), beta), variance * one)
