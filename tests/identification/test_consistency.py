"""Bodies that can exist: the optimum of a semidefinite solver, in any unit of length."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.control import tune
from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.errors import DataError
from gimbal_pin.identification import identify, read_model, write_model
from gimbal_pin.log import Array
from gimbal_pin.regression import (
    PSEUDO_INERTIA_BASIS,
    DesignBlocks,
    build_program,
    compute_blocks,
    compute_residual_power,
    count_effective_rows,
    factor_rows,
    factor_wide_states,
    find_nearest_bodies,
    fit_physical,
    fit_weighted,
    map_phi_to_base,
    weigh_joints,
)
from gimbal_pin.rig import Rig, is_physical, pseudo_inertia
from tests.bench_logs import EXACT, prescribed, rows_of
from tests.rigs import bundled, taken_by_all


def map_bodies(rig: Rig) -> Array:
    """Return the base parameters per parameter of the bodies."""
    return map_phi_to_base(rig, reduce_parameters(rig))


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


def draw_far(rig: Rig, seed: int) -> tuple[Array, Array]:
    """Return base parameters wrong by several of their deviations, which span decades."""
    rng = np.random.default_rng(seed)
    beta = map_bodies(rig) @ rig.phi
    std = 10.0 ** rng.uniform(-2.5, 0.0, len(beta)) * np.abs(beta) + 1e-4
    return beta + 3 * std * rng.standard_normal(len(beta)), std


@pytest.mark.parametrize(("name", "seed"), [("thesis", 0), ("handheld", 3), ("turret", 0)])
def test_nearest_bodies_are_those_of_a_semidefinite_program(name: str, seed: int) -> None:
    rig = bundled(name, "cinema")
    beta, std = draw_far(rig, seed)
    found = find_nearest_bodies(rig.phi, map_bodies(rig), beta, np.diag(std**2))
    best = solve_semidefinite(map_bodies(rig), np.diag(1 / std), beta / std)
    assert is_physical(found.phi)
    assert found.distance == pytest.approx(best, rel=1e-4, abs=1e-4)


@cache
def pose_loud() -> tuple[DesignBlocks, Array]:
    """Return rows of a torque as noisy as large, and what their fit minimises."""
    rig = bundled("thesis")
    blocks = compute_blocks(rows_of(rig, prescribed(nominal(rig), 1, 8.0, torque_noise=1.0)))
    factors = factor_rows(blocks)
    count = count_effective_rows(blocks)
    scale = weigh_joints(compute_residual_power(factors, fit_physical(blocks).theta, count))
    wide = factor_wide_states(blocks.design, factors.shape[2] - 1)
    return blocks, build_program(factors, wide, scale, count)


def test_physical_fit_is_that_of_a_semidefinite_program() -> None:
    """Its residual is the least that bodies reach, and more than that of the free estimate."""
    blocks, stack = pose_loud()
    mixing = blocks.design.mixing
    found = fit_physical(blocks)
    assert found.phi is not None and is_physical(found.phi)
    np.testing.assert_allclose(mixing @ found.phi, found.theta[: len(mixing)], atol=1e-9)
    cost = np.linalg.norm(stack @ np.append(found.theta, -1.0))
    best = solve_semidefinite(mixing, stack[:, :-1], stack[:, -1])
    assert cost == pytest.approx(best, rel=1e-5)
    free = fit_weighted(blocks).theta
    assert np.linalg.norm(stack @ np.append(free, -1.0)) < 0.999 * best


def test_model_at_the_edge_of_what_can_exist_is_read_everywhere(tmp_path: Path) -> None:
    """By Pinocchio, yourdfpy and MuJoCo as a URDF, and from its own file by `tune`."""
    blocks, _ = pose_loud()
    rig = blocks.design.rig
    logs = blocks.design.logs
    found = identify(rig, logs, estimator=fit_physical, holdout="none", filtering=EXACT)
    assert found.physical
    bodies = found.consistent.phi.reshape(-1, 10)
    assert 0 < min(np.linalg.eigvalsh(pseudo_inertia(body))[0] for body in bodies) < 1e-5
    assert taken_by_all(found.to_urdf(), rig.n)
    free = identify(rig, logs, holdout="none", filtering=EXACT)
    assert not free.physical
    write_model(free, tmp_path / "model.yaml")
    assert tune(read_model(tmp_path / "model.yaml", rig)).gains


@pytest.mark.parametrize(("beta", "variance"), [(np.inf, 1.0), (0.0, np.nan)])
def test_estimate_beyond_all_bodies_is_refused(beta: float, variance: float) -> None:
    phi = bundled("turret").phi
    one = np.eye(len(phi))
    with (
        np.errstate(all="ignore"),
        pytest.raises(DataError, match="look at the units of t, q and tau"),
    ):
        find_nearest_bodies(phi, one, np.full(len(phi), beta), variance * one)
