"""The best bodies that can exist: the same optimum as a general semidefinite solver's, in any frame and unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import tune
from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.errors import DataError
from gimbal_pin.excitation import record_log
from gimbal_pin.identification import identify, read_model, write_model
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.regression import (
    BARRIER_WEIGHTS,
    LEANT_WEIGHTS,
    PSEUDO_INERTIA_BASIS,
    Consistent,
    DesignBlocks,
    Filtering,
    anchor,
    build_program,
    compute_blocks,
    compute_residual_power,
    count_effective_rows,
    factor_rows,
    factor_wide_states,
    find_nearest_bodies,
    fit_bodies,
    fit_physical,
    fit_weighted,
    map_phi_to_base,
    weigh_joints,
)
from gimbal_pin.rig import Rig, is_physical, pseudo_inertia
from tests.bench_logs import EXACT, prescribed, rows_of, true_theta
from tests.excitation.designs import designed
from tests.rigs import taken_by_all


@pytest.mark.parametrize("seed", range(3))
def test_a_model_is_one_that_a_rig_can_have(seed: int, tmp_path: Path) -> None:
    """A hundred times slower than is any use, under noise as large as the torque: it is read back and tuned for."""
    motion = designed("thesis", 0).motion
    slow = Motion(100 * motion.t, motion.q, motion.v / 100, motion.a / 1e4)
    rig = Rig.load("thesis")
    log = record_log(nominal(rig), slow, 1.0, np.random.default_rng(seed))
    found = identify(rig, [log], holdout="none", filtering=Filtering(cutoff=0.2, alignment=0.0))
    assert not found.physical
    write_model(found, tmp_path / "model.yaml")
    assert tune(read_model(tmp_path / "model.yaml", rig)).gains


def mixing_of(rig: Rig) -> Array:
    return map_phi_to_base(rig, reduce_parameters(rig))


def oracle(mixing: Array, rows: Array, target: Array) -> float:
    """The shortest residual that bodies reach, and friction's columns after theirs, none negative, by cvxpy."""
    cp = pytest.importorskip("cvxpy", reason="cvxpy is the oracle: pip install 'gimbal-pin[test]'")
    phi = cp.Variable(mixing.shape[1])
    free = cp.Variable(rows.shape[1] - len(mixing) + 1)
    parts = cp.reshape(phi, (10, mixing.shape[1] // 10), order="F")
    exist = [
        sum(parts[k, i] * PSEUDO_INERTIA_BASIS[k] for k in range(10)) >> 0
        for i in range(mixing.shape[1] // 10)
    ]
    theta = cp.hstack([mixing @ phi, free[:-1]])
    problem = cp.Problem(cp.Minimize(cp.norm(rows @ theta - target)), [*exist, free >= 0])
    return float(problem.solve(solver=cp.CLARABEL))


def far_off(rig: Rig, seed: int) -> tuple[Array, Array]:
    """Base parameters that are wrong by several of their deviations, which span decades."""
    rng = np.random.default_rng(seed)
    beta = mixing_of(rig) @ rig.phi
    std = 10.0 ** rng.uniform(-2.5, 0.0, len(beta)) * np.abs(beta) + 1e-4
    return beta + 3 * std * rng.standard_normal(len(beta)), std


@pytest.mark.parametrize("name", ["thesis", "handheld", "turret"])
@pytest.mark.parametrize("seed", [0, 3])
def test_the_nearest_bodies_are_those_of_a_semidefinite_program(name: str, seed: int) -> None:
    rig = Rig.load(name, "cinema")
    beta, std = far_off(rig, seed)
    found = find_nearest_bodies(rig.phi, mixing_of(rig), beta, np.diag(std**2))
    best = oracle(mixing_of(rig), np.diag(1 / std), beta / std)
    assert is_physical(found.phi)
    assert found.distance == pytest.approx(best, rel=1e-4, abs=1e-4)


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
def test_the_unit_of_length_does_not_matter(seed: int, unit: float) -> None:
    """First moments change by the unit, second moments by its square; the bodies stay the same."""
    rig = Rig.load("turret")
    beta, std = far_off(rig, seed)
    rows = mixing_of(rig) / std[:, None]
    target = beta / std
    change = np.tile([1.0, *[unit] * 3, *[unit**2] * 6], rig.n)
    one = fit_bodies(rig.phi, rows, target)
    other = fit_bodies(change * rig.phi, rows / change, target)
    assert other.distance == pytest.approx(one.distance, rel=1e-4, abs=1e-5)
    assert np.allclose(other.phi / change, one.phi, rtol=2e-2, atol=1e-4 * np.abs(one.phi).max())


def test_where_nothing_is_shown_the_bodies_stay_as_they_are() -> None:
    rig = Rig.load("thesis")
    found: Consistent = fit_bodies(rig.phi, np.zeros((1, 10 * rig.n)), np.zeros(1))
    assert np.allclose(found.phi, rig.phi, rtol=1e-4, atol=1e-6) and found.distance == 0.0


def loud(rig: Rig, seed: int) -> Log:
    """A short log with so much noise on the torque that least squares leaves what can exist."""
    return prescribed(nominal(rig), seed, 8.0, torque_noise=1.0)


def posed(rig: Rig, seed: int) -> tuple[DesignBlocks, Array, Array]:
    """A loud log's rows, what the physical fit minimises with its answer's weights, and the data's part of that."""
    blocks = compute_blocks(rows_of(rig, loud(rig, seed)))
    factors = factor_rows(blocks)
    count = count_effective_rows(blocks)
    scale = weigh_joints(compute_residual_power(factors, fit_physical(blocks).theta, count))
    stack = build_program(
        factors, factor_wide_states(blocks.design, factors.shape[2] - 1), scale, count
    )
    return blocks, stack, stack[: factors.shape[0] * factors.shape[1]]


def test_the_data_are_fitted_and_not_an_estimate_moved() -> None:
    """The residual of the program is a semidefinite solver's; the projected estimate's is no better."""
    rig = Rig.load("thesis")
    blocks, stack, _ = posed(rig, 1)
    found = fit_physical(blocks)
    free = fit_weighted(blocks)
    mixing = blocks.design.mixing

    def cost(theta: Array) -> float:
        return float(np.linalg.norm(stack @ np.append(theta, -1.0)))

    assert found.phi is not None and is_physical(found.phi)
    assert cost(found.theta) == pytest.approx(oracle(mixing, stack[:, :-1], stack[:, -1]), rel=1e-5)
    width = len(mixing)
    moved = find_nearest_bodies(
        rig.phi, mixing, free.theta[:width], free.covariance[:width, :width]
    )
    assert moved.distance > 0.1, "the log is not loud enough to be a test"
    braking = np.maximum(free.theta[width:], 0.0)
    assert cost(found.theta) <= cost(np.concatenate([mixing @ moved.phi, braking])) * (1 + 1e-9)


@pytest.mark.parametrize(("name", "seed"), [("thesis", 1), ("turret", 2)])
def test_the_constraint_never_leads_away_from_the_truth(name: str, seed: int) -> None:
    """In the torque of log and limits together; the limits hold nothing that the log does not show."""
    rig = Rig.load(name)
    blocks, stack, data = posed(rig, seed)
    truth = true_theta(rig)
    free = np.linalg.lstsq(data[:, :-1], data[:, -1], rcond=None)[0]
    ours, theirs = (
        np.linalg.norm(stack[:, :-1] @ (theta - truth))
        for theta in (fit_physical(blocks).theta, free)
    )
    assert ours <= theirs * (1 + 1e-6)
    U = np.linalg.qr(data[:, :-1], mode="r")
    held = stack[len(data) :]
    times = np.linalg.svd(held[:, :-1] @ np.linalg.inv(U), compute_uv=False) ** 2
    assert 0 < times.max() <= 30.0 * (1 + 1e-6)
    np.testing.assert_allclose(
        held[:, :-1] @ free, held[:, -1], atol=1e-6 * np.abs(held[:, -1]).max()
    )


def test_what_no_log_shows_is_held_by_nothing() -> None:
    rng = np.random.default_rng(0)
    data = rng.standard_normal((30, 5))
    wide = rng.standard_normal((9, 4))
    data[:, 2] = data[:, 0] - data[:, 1]  # of columns 0, 1 and 2 two combinations show
    held = anchor(data, wide)
    assert np.abs(held[:, :-1] @ [1.0, -1.0, -1.0, 0.0]).max() < 1e-9 * np.abs(held).max()


def test_without_noise_the_constraint_changes_nothing() -> None:
    rig = Rig.load("turret")
    blocks = compute_blocks(rows_of(rig, prescribed(nominal(rig))))
    theta = fit_weighted(blocks).theta
    assert np.allclose(fit_physical(blocks).theta, theta, atol=1e-5 * np.abs(theta).max())


def test_what_is_written_loads_everywhere() -> None:
    """Bodies on the edge of what can exist, in a URDF that Pinocchio, yourdfpy and MuJoCo take."""
    rig = Rig.load("thesis")
    found = identify(rig, [loud(rig, 1)], estimator=fit_physical, holdout="none", filtering=EXACT)
    assert found.physical and max(found.torque_change.values()) == 0.0
    least = min(
        np.linalg.eigvalsh(pseudo_inertia(body))[0] for body in found.consistent.phi.reshape(-1, 10)
    )
    assert 0 < least < 1e-5, "the bodies are not on the edge"
    text = found.to_urdf()
    assert taken_by_all(text, rig.n) and np.allclose(found.model.rig.phi, found.consistent.phi)


@pytest.mark.parametrize("seed", range(4))
def test_bodies_that_are_hardly_told_apart_stay_near_the_urdf(seed: int) -> None:
    """An estimate one deviation off: no body is another one by more than it could be told, and that for a deviation."""
    rig = Rig.load("handheld", "mirrorless")
    mixing = mixing_of(rig)
    rng = np.random.default_rng(seed)
    std = 1e-2 * np.abs(mixing) @ np.abs(rig.phi) + 1e-5
    off = std * rng.standard_normal(len(std))
    exact, leant = (
        find_nearest_bodies(rig.phi, mixing, mixing @ rig.phi + off, np.diag(std**2), one)
        for one in (BARRIER_WEIGHTS, LEANT_WEIGHTS)
    )
    assert leant.distance < exact.distance + 1.0
    assert np.all(np.abs(np.log(leant.phi[::10] / rig.phi[::10])) < np.log(2.0))


@pytest.mark.parametrize(("beta", "variance"), [(np.nan, 1.0), (np.inf, 1.0), (0.0, np.nan)])
def test_what_is_beyond_all_bodies_is_an_error_that_names_the_units(
    beta: float, variance: float
) -> None:
    """An estimate that is no number any more, as of a log in other units, ends in one line and not in a traceback."""
    phi = Rig.load("turret").phi
    one = np.eye(len(phi))
    assert find_nearest_bodies(phi, one, phi, one).distance < 1e-3
    with (
        np.errstate(all="ignore"),
        pytest.raises(DataError, match="that can exist; look at the units of t, q and tau"),
    ):
        find_nearest_bodies(phi, one, np.full(len(phi), beta), variance * one)
