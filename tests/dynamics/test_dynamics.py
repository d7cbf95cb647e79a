"""Laws of the rigid rig, on a base that stands or moves.

The torque is what Lagrange's equations give in the thesis's frames, MuJoCo's inverse dynamics, and the regressor times
the parameters.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

from gimbal_pin.dynamics import Model, compute_regressor, compute_rnea, nominal, plant_with
from gimbal_pin.dynamics.regressor import compute_coupling
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.log import Array, Platform
from gimbal_pin.rig import GRAVITY
from tests.dynamics.odd_rigs import ALL, known
from tests.mujoco_peer import rigid_bodies, torque
from tests.rigs import VARIETY, bundled, states


def shake(seed: int, count: int = 20) -> tuple[Platform, Array]:
    """Return wild attitudes and motions of a platform, and its acceleration in the world."""
    rng = np.random.default_rng(seed)
    angles, rates, accelerations = rng.uniform(-1.2, 1.2, (3, count, 3))
    world = rng.uniform(-10, 10, (count, 3))
    t = np.arange(float(count))
    return Platform.turning(t, angles, 3 * rates, 20 * accelerations, world), world


def turns(q: Array) -> list[Array]:
    """R_01, R_02, R_03 of the thesis, from R_{i-1,i} (3.15, 3.18, 3.21)."""
    out = []
    R = np.eye(3)
    for c, s in zip(np.cos(q), np.sin(q)):
        R = R @ np.array([[-s, 0, c], [c, 0, s], [0, 1, 0]])
        out.append(R)
    return out


def inertia(q: Array, bodies: list[pin.Inertia]) -> Array:
    """Σ m J_vᵀ J_v + J_ωᵀ R I Rᵀ J_ω (3.46); the axes meet in one point, so that J_v = -[R c]× J_ω."""
    (c1, c2, _) = np.cos(q)
    (s1, s2, _) = np.sin(q)
    spin = np.array([[0, c1, -s1 * c2], [0, s1, c1 * c2], [1, 0, s2]])
    total = np.zeros((3, 3), dtype=q.dtype)
    for k, (body, R) in enumerate(zip(bodies, turns(q))):
        J = spin * (np.arange(3) <= k)
        Jv = -np.cross(R @ body.lever, J.T).T
        total = total + body.mass * Jv.T @ Jv + J.T @ R @ body.inertia @ R.T @ J
    return total


def height(q: Array, bodies: list[pin.Inertia]) -> Array:
    """Σ m g z over the centres of mass, J."""
    lifted = [body.mass * (R @ body.lever)[2] for body, R in zip(bodies, turns(q))]
    return GRAVITY * sum(lifted)


def lagrange(q: Array, v: Array, a: Array, bodies: list[pin.Inertia]) -> Array:
    """``D a + Ḋ v - ½ ∂(vᵀ D v)/∂q + ∂V/∂q``, derivatives by complex step."""
    steps = q + 1e-30j * np.eye(3)
    slope = np.array([inertia(step, bodies).imag for step in steps]) / 1e-30
    gravity = np.array([height(step, bodies).imag for step in steps]) / 1e-30
    turning = np.einsum("i,ijk,k->j", v, slope, v) - np.einsum("j,ijk,k->i", v, slope, v) / 2
    return inertia(q, bodies) @ a + turning + gravity


@pytest.mark.parametrize("other", [0.0, 0.1])
def test_torque_is_that_of_lagranges_equations_in_the_thesis_frames(other: float) -> None:
    """Of the bundled thesis rig, and of one with any other bodies."""
    stated = bundled("thesis", "cinema")
    rig = stated.with_phi(stated.phi + other * np.random.default_rng(1).normal(size=30))
    bodies = list(rig.model.inertias[1:])
    at = states(3, 1)
    expected = [lagrange(*state, bodies) for state in zip(*at)]
    np.testing.assert_allclose(compute_rnea(rig, *at), expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", [*VARIETY, "crane", "tree"], ids=str)
def test_torque_is_mujocos_on_a_base_that_stands_or_moves(name: str | tuple[str, str]) -> None:
    """MuJoCo moves the base by a free joint, whose rate is in the body's frame; no joint feels its speed."""
    rig = known(name) if isinstance(name, str) else bundled(*name)
    at = states(rig.n, 2)
    fixed = rigid_bodies(etree.fromstring(rig.urdf.encode()))
    still = torque(fixed, rig.joints, *at)
    slack = 1e-11 * np.abs(still).max()
    np.testing.assert_allclose(compute_rnea(rig, *at), still, rtol=0, atol=slack)

    robot = etree.fromstring(rig.urdf.encode())
    robot.insert(0, etree.Element("link", name="world"))
    joint = etree.SubElement(robot, "joint", name="free", type="floating")
    etree.SubElement(joint, "parent", link="world")
    etree.SubElement(joint, "child", link=rig.base)
    platform, world = shake(1)
    assert platform.quat is not None
    place, speed = np.random.default_rng(0).normal(size=(2, 20, 3))
    base = zip(
        np.hstack([place, platform.quat]),
        np.hstack([speed, platform.w]),
        np.hstack([world, platform.dw]),
    )
    moved = compute_rnea(rig, *at, platform)
    expected = torque(rigid_bodies(robot), rig.joints, *at, list(base))
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_a_torque_that_speeds_up_one_joint_asks_its_coupling_of_the_others() -> None:
    """``M_j / (M_jj + rotor)``: the torques for an acceleration of one joint alone, over its own."""
    rig = bundled("turret")
    rotor = 2e-3
    q, _, _ = states(rig.n, 3)
    still = np.zeros_like(q)
    for j in range(rig.n):
        alone = np.zeros_like(q)
        alone[:, j] = 1.0
        mass = compute_rnea(rig, q, still, alone) - compute_rnea(rig, q, still, still)
        own = mass[:, [j]] + rotor
        np.testing.assert_allclose(compute_coupling(mass, j, rotor), mass / own)


@pytest.mark.parametrize("name", ALL)
def test_regressor_times_the_parameters_of_any_bodies_is_the_torque(name: str) -> None:
    stated = known(name)
    change = np.random.default_rng(7).uniform(0.5, 2, 10 * stated.n)
    rig = stated.with_phi(stated.phi * change)
    at = states(rig.n, 6)
    for platform in (None, shake(5)[0]):
        expected = compute_rnea(rig, *at, platform)
        found = compute_regressor(stated, *at, platform) @ rig.phi
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
        alone = Model(rig, ()).inverse_dynamics(*at, platform=platform)
        np.testing.assert_array_equal(alone, expected)


@pytest.mark.parametrize("terms", ["", "load-dependent-friction"])
def test_the_torque_of_one_pose_is_that_of_its_row_among_many(terms: str) -> None:
    rig = bundled("thesis")
    model = nominal(rig)
    if terms:
        model = plant_with(model, [parse_effect(f"{terms}:{rig.joints[1]}:mu=0.2", rig)])[0]
    many = states(rig.n, 6)
    rows = model.inverse_dynamics(*many)
    for k, at in enumerate(zip(*many)):
        np.testing.assert_allclose(model.inverse_dynamics(*at), rows[k], rtol=1e-9, atol=1e-12)
        listed = model.inverse_dynamics(*(x.tolist() for x in at))
        assert listed.shape == (rig.n,)
