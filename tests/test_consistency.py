"""The best bodies that can exist: the same optimum as a general semidefinite solver's, in any frame and unit."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.consistency import BASIS, Consistent, fitted, nearest
from gimbal_pin.estimators import physical as physical_fit
from gimbal_pin.estimators import weighted
from gimbal_pin.estimators.base import effective_rows, factor, residual_power
from gimbal_pin.estimators.weighted import joint_weights
from gimbal_pin.identification import identify
from gimbal_pin.inertia import physical, pseudo_inertia
from gimbal_pin.log import Array, Log
from gimbal_pin.model import friction_effects, nominal
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig, to_pinocchio
from gimbal_pin.rows import Filtering, Rows, kept
from tests.bench_logs import prescribed

EXACT = Filtering(alignment=0.0)


def mixing_of(rig: Rig) -> Array:
    return Rows(rig, reduce(rig), (), (), EXACT).mixing


def oracle(mixing: Array, rows: Array, target: Array) -> float:
    """The shortest residual that bodies reach, and other columns after theirs, by cvxpy."""
    cp = pytest.importorskip("cvxpy", reason="cvxpy is the oracle: pip install 'gimbal-pin[test]'")
    phi, free = cp.Variable(mixing.shape[1]), cp.Variable(rows.shape[1] - len(mixing) + 1)
    parts = cp.reshape(phi, (10, mixing.shape[1] // 10), order="F")
    exist = [sum(parts[k, i] * BASIS[k] for k in range(10)) >> 0 for i in range(mixing.shape[1] // 10)]
    theta = cp.hstack([mixing @ phi, free[:-1]])
    problem = cp.Problem(cp.Minimize(cp.norm(rows @ theta - target)), exist)
    return float(problem.solve(solver=cp.CLARABEL))


def far_off(rig: Rig, seed: int) -> tuple[Array, Array]:
    """Base parameters that are wrong by several of their deviations, which span decades."""
    rng, beta = np.random.default_rng(seed), mixing_of(rig) @ rig.phi
    std = 10.0 ** rng.uniform(-2.5, 0.0, len(beta)) * np.abs(beta) + 1e-4
    return beta + 3 * std * rng.standard_normal(len(beta)), std


@pytest.mark.parametrize("name", ["thesis", "handheld", "turret"])
@pytest.mark.parametrize("seed", [0, 3])
def test_the_nearest_bodies_are_those_of_a_semidefinite_program(name: str, seed: int) -> None:
    rig = Rig.load(name, "cinema")
    beta, std = far_off(rig, seed)
    found = nearest(rig.phi, mixing_of(rig), beta, np.diag(std**2))
    best = oracle(mixing_of(rig), np.diag(1 / std), beta / std)
    assert physical(found.phi)
    assert found.distance == pytest.approx(best, rel=1e-4, abs=1e-4)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
def test_the_unit_of_length_does_not_matter(seed: int, unit: float) -> None:
    """First moments change by the unit, second moments by its square; the bodies stay the same."""
    rig = Rig.load("turret")
    beta, std = far_off(rig, seed)
    rows, target = mixing_of(rig) / std[:, None], beta / std
    change = np.tile([1.0, *[unit] * 3, *[unit**2] * 6], rig.n)
    one, other = fitted(rig.phi, rows, target), fitted(change * rig.phi, rows / change, target)
    assert other.distance == pytest.approx(one.distance, rel=1e-4, abs=1e-5)
    assert np.allclose(other.phi / change, one.phi, rtol=2e-2, atol=1e-4 * np.abs(one.phi).max())


def test_where_nothing_is_shown_the_bodies_stay_as_they_are() -> None:
    rig = Rig.load("thesis")
    found: Consistent = fitted(rig.phi, np.zeros((1, 10 * rig.n)), np.zeros(1))
    assert np.allclose(found.phi, rig.phi, rtol=1e-4, atol=1e-6) and found.distance == 0.0


def loud(rig: Rig, seed: int) -> Log:
    """A short log with so much noise on the torque that least squares leaves what can exist."""
    return prescribed(nominal(rig), seed, 8.0, torque_noise=1.0)


def test_the_data_are_fitted_and_not_an_estimate_moved() -> None:
    """The weighted residual of the data is the semidefinite program's; the projected estimate's is no better."""
    rig = Rig.load("thesis")
    rows = Rows(rig, reduce(rig), friction_effects(rig.joints), (loud(rig, 1),), EXACT)
    blocks = kept(rows)
    found, free = physical_fit(blocks), weighted(blocks)
    factors = factor(blocks)
    scale = joint_weights(residual_power(factors, found.theta, effective_rows(blocks)))
    stack = (factors * scale[:, None, None]).reshape(-1, factors.shape[2])

    def cost(theta: Array) -> float:
        return float(np.linalg.norm(stack @ np.append(theta, -1.0)))

    assert found.phi is not None and physical(found.phi)
    assert cost(found.theta) == pytest.approx(oracle(rows.mixing, stack[:, :-1], stack[:, -1]), rel=1e-5)
    width = len(rows.mixing)
    moved = nearest(rig.phi, rows.mixing, free.theta[:width], free.covariance[:width, :width])
    assert moved.distance > 0.1, "the log is not loud enough to be a test"
    assert cost(found.theta) <= cost(np.concatenate([rows.mixing @ moved.phi, free.theta[width:]])) * (1 + 1e-9)


def test_without_noise_the_constraint_changes_nothing() -> None:
    rig = Rig.load("turret")
    blocks = kept(Rows(rig, reduce(rig), friction_effects(rig.joints), (prescribed(nominal(rig)),), EXACT))
    theta = weighted(blocks).theta
    assert np.allclose(physical_fit(blocks).theta, theta, atol=1e-5 * np.abs(theta).max())


def test_what_is_written_loads_everywhere() -> None:
    """Bodies on the edge of what can exist, in a URDF that Pinocchio, yourdfpy and MuJoCo take."""
    import mujoco
    import yourdfpy

    rig = Rig.load("thesis")
    found = identify(rig, [loud(rig, 1)], estimator=physical_fit, holdout="none", filtering=EXACT)
    assert found.physical and max(found.torque_change.values()) == 0.0
    least = min(np.linalg.eigvalsh(pseudo_inertia(body))[0] for body in found.consistent.phi.reshape(-1, 10))
    assert 0 < least < 1e-5, "the bodies are not on the edge"
    text = found.to_urdf()
    assert to_pinocchio(text, "written").nv == rig.n and np.allclose(found.model.rig.phi, found.consistent.phi)
    assert mujoco.MjModel.from_xml_string(text).nv == rig.n
    assert yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False, build_scene_graph=False).robot.links
