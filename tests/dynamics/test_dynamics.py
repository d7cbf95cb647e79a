"""Dynamics: Pinocchio's against three strangers — the thesis's closed form, MuJoCo, and the energy balance."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lxml import etree

from gimbal_pin.dynamics import compute_rnea
from gimbal_pin.rig import Rig, bundled_payloads
from tests.mujoco_peer import rigid_bodies, torque
from tests.rigs import BODY, VARIETY, bundled, energy, spelled, states

JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>'
    '<origin xyz="0.1 0.2 -0.3" rpy="0.4 0.5 -0.6"/><axis xyz="{4}"/>'
    '<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'
)
ODD = {
    "tree": "".join(
        BODY.format(name, mass) for name, mass in (("a", 2), ("b", 1.5), ("c", 1), ("d", 0.7))
    )
    + JOINT.format("j1", "revolute", "base", "a", "0 0 1")
    + JOINT.format("j2", "revolute", "a", "b", "1 1 0")
    + JOINT.format("j3", "revolute", "a", "c", "0 -1 0")
    + JOINT.format("j4", "revolute", "c", "d", "0.3 0.4 0.5"),
    "prismatic": "".join(BODY.format(name, mass) for name, mass in (("a", 2), ("b", 1.5), ("c", 1)))
    + JOINT.format("j1", "revolute", "base", "a", "0 1 0")
    + JOINT.format("j2", "prismatic", "a", "b", "0 0 2")
    + JOINT.format("j3", "revolute", "b", "c", "1 0 0"),
    "continuous": "".join(BODY.format(name, mass) for name, mass in (("a", 2), ("b", 1.5)))
    + JOINT.format("j1", "continuous", "base", "a", "0 0 1")
    + '<joint name="j2" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 1"/></joint>',
    "fixed": "".join(BODY.format(name, mass) for name, mass in (("a", 2), ("b", 1.5), ("c", 1)))
    + JOINT.format("j1", "revolute", "base", "a", "0 1 0")
    + JOINT.format("weld", "fixed", "a", "b", "0 0 1")
    + JOINT.format("j2", "revolute", "b", "c", "1 0 0"),
}
"""Rigs that are no gimbals: joints of other kinds, branches, axes askew, links welded together."""


def odd(name: str) -> Rig:
    return spelled(f'<robot name="{name}"><link name="base"/>{ODD[name]}</robot>')


# --- the thesis: three concentric axes, modified Denavit-Hartenberg frames -----------------------------------------

THREE = hnp.arrays(float, 3, elements=st.floats(-3, 3, allow_subnormal=False))


def turns(q: np.ndarray) -> list[np.ndarray]:
    """R_01, R_02, R_03 from R_{i-1,i} (3.15, 3.18, 3.21)."""
    out = []
    R = np.eye(3)
    for c, s in zip(np.cos(q), np.sin(q)):
        R = R @ np.array([[-s, 0, c], [c, 0, s], [0, 1, 0]])
        out.append(R)
    return out


def spins(q: np.ndarray) -> list[np.ndarray]:
    """J_ω of the three bodies (3.32, 3.33)."""
    (c1, c2, _) = np.cos(q)
    (s1, s2, _) = np.sin(q)
    full = np.array([[0 * c1, c1, -s1 * c2], [0 * c1, s1, c1 * c2], [1 + 0 * c1, 0 * c1, s2]])
    return [full * np.array([1, 0, 0]), full * np.array([1, 1, 0]), full]


def D(q: np.ndarray, bodies: list[pin.Inertia]) -> np.ndarray:
    """Σ m J_vᵀ J_v + J_ωᵀ R I Rᵀ J_ω (3.46); the axes meet in one point, so that J_v = -[R c]× J_ω."""
    total = np.zeros((3, 3), dtype=q.dtype)
    for body, R, J in zip(bodies, turns(q), spins(q)):
        Jv = -np.cross(R @ body.lever, J.T).T
        total = total + body.mass * Jv.T @ Jv + J.T @ R @ body.inertia @ R.T @ J
    return total


def C(q: np.ndarray, v: np.ndarray, bodies: list[pin.Inertia]) -> np.ndarray:
    """C_kj = Σ_i c_ijk v_i, c_ijk = ½(∂d_kj/∂q_i + ∂d_ki/∂q_j - ∂d_ij/∂q_k) (3.56, 3.57), by complex step."""
    slope = np.array([D(q + 1e-30j * unit, bodies).imag / 1e-30 for unit in np.eye(3)])
    christoffel = 0.5 * (
        np.einsum("ikj->ijk", slope) + np.einsum("jki->ijk", slope) - np.einsum("kij->ijk", slope)
    )
    return np.einsum("ijk,i->kj", christoffel, v)


def G(q: np.ndarray, bodies: list[pin.Inertia]) -> np.ndarray:
    """g1 = 0, (3.64), (3.65); l.m.. is mass · lever · 9.81."""
    (_, c2, c3) = np.cos(q)
    (_, s2, s3) = np.sin(q)
    l2mx, _, l2mz = bodies[1].mass * bodies[1].lever * 9.81
    l3mx, l3my, l3mz = bodies[2].mass * bodies[2].lever * 9.81
    g2 = l3my * c2 + l2mz * c2 - l2mx * s2 - l3mz * c3 * s2 + l3mx * s2 * s3
    return np.array([0.0, g2, -c2 * (l3mx * c3 + l3mz * s3)])


def drawn(rig: Rig, seed: int) -> Rig:
    """The rig with other bodies: clouds of point masses off centre, so that every inertia is full and physical."""
    rng = np.random.default_rng(seed)
    phi = []
    for _ in range(rig.n):
        masses = rng.uniform(0.1, 1, 6)
        points = rng.uniform(-0.3, 0.3, (6, 3)) + rng.uniform(-0.2, 0.2, 3)
        com = masses @ points / masses.sum()
        arms = points - com
        inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arms))
        phi.append(pin.Inertia(masses.sum(), com, inertia).toDynamicParameters())
    return rig.with_phi(np.concatenate(phi))


def diagonal(rig: Rig) -> Rig:
    """The thesis's assumption: inertias at the centres of mass are diagonal."""
    bodies = [
        pin.Inertia(b.mass, b.lever, np.diag(np.diag(b.inertia))) for b in rig.model.inertias[1:]
    ]
    return rig.with_phi(np.concatenate([body.toDynamicParameters() for body in bodies]))


@given(THREE)
def test_pose_of_the_cradle_is_equation_3_24(q: np.ndarray) -> None:
    rig = bundled("thesis")
    data = rig.model.createData()
    pin.forwardKinematics(rig.model, data, q)
    (c1, c2, c3) = np.cos(q)
    (s1, s2, s3) = np.sin(q)
    R_03 = [
        [c1 * c3 - s1 * s2 * s3, -s1 * c2, c1 * s3 + s1 * s2 * c3],
        [s1 * c3 + c1 * s2 * s3, c1 * c2, s1 * s3 - c1 * s2 * c3],
        [-c2 * s3, s2, c2 * c3],
    ]
    np.testing.assert_allclose(data.oMi[3].rotation, R_03, atol=1e-12)
    np.testing.assert_allclose(turns(q)[2], R_03, atol=1e-12)
    h = rig.model.jointPlacements[1].translation[2]
    assert h != 0
    np.testing.assert_allclose(data.oMi[3].translation, [0, 0, h], atol=1e-15)


@given(THREE)
def test_jacobians_are_equations_3_32_and_3_33(q: np.ndarray) -> None:
    rig = bundled("thesis")
    data = rig.model.createData()
    pin.computeJointJacobians(rig.model, data, q)
    for body, J in enumerate(spins(q), start=1):
        ours = pin.getJointJacobian(rig.model, data, body, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(ours[3:], J, atol=1e-12)
        np.testing.assert_allclose(ours[:3], 0, atol=1e-12)


@given(THREE, THREE, THREE, st.integers(0, 2**32 - 1), st.booleans())
def test_torque_is_the_thesis_closed_form(
    q: np.ndarray, v: np.ndarray, a: np.ndarray, seed: int, as_thesis: bool
) -> None:
    rig = drawn(bundled("thesis"), seed)
    rig = diagonal(rig) if as_thesis else rig
    bodies = list(rig.model.inertias[1:])
    expected = D(q, bodies) @ a + C(q, v, bodies) @ v + G(q, bodies)
    np.testing.assert_allclose(
        compute_rnea(rig, q[None], v[None], a[None])[0], expected, rtol=1e-11, atol=1e-11
    )


@pytest.mark.parametrize("payload", bundled_payloads())
def test_bundled_thesis_rig_is_the_closed_form(payload: str) -> None:
    rig = Rig.load("thesis", payload)
    bodies = list(rig.model.inertias[1:])
    for q, v, a in zip(*states(3, 1, 20)):
        expected = D(q, bodies) @ a + C(q, v, bodies) @ v + G(q, bodies)
        np.testing.assert_allclose(
            compute_rnea(rig, q[None], v[None], a[None])[0], expected, rtol=1e-11, atol=1e-11
        )


# --- MuJoCo ---------------------------------------------------------------------------------------------------------


def mujoco_torque(rig: Rig, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    return torque(rigid_bodies(etree.fromstring(rig.urdf.encode())), rig.joints, q, v, a)


@pytest.mark.parametrize(("name", "payload"), VARIETY)
def test_torque_is_mujocos_on_every_bundled_rig(name: str, payload: str) -> None:
    rig = bundled(name, payload)
    at = states(rig.n, 2, 20)
    np.testing.assert_allclose(compute_rnea(rig, *at), mujoco_torque(rig, *at), rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ODD)
def test_torque_is_mujocos_on_any_other_urdf(name: str) -> None:
    rig = odd(name)
    at = states(rig.n, 3, 20)
    scale = np.abs(compute_rnea(rig, *at)).max()
    np.testing.assert_allclose(
        compute_rnea(rig, *at), mujoco_torque(rig, *at), rtol=0, atol=1e-9 * max(1.0, scale)
    )


# --- energy ---------------------------------------------------------------------------------------------------------


def power_balance(rig: Rig, seed: int) -> None:
    """d/dt (T + V) = q̇ᵀ τ along a random Fourier motion; five-point differences err by (ω h)⁴/30 < 2e-11."""
    rng = np.random.default_rng(seed)
    omega = rng.uniform(0.5, 5, (3, rig.n))
    phase = rng.uniform(0, 6, (3, rig.n))
    size = rng.uniform(0.1, 1, (3, rig.n))

    def motion(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s = np.sin(omega * t + phase)
        c = np.cos(omega * t + phase)
        return (size * s).sum(0), (size * omega * c).sum(0), (-size * omega**2 * s).sum(0)

    h = 1e-3
    for t in rng.uniform(0, 10, 5):
        E = {k: energy(rig, *motion(t + k * h)[:2]) for k in (-2, -1, 1, 2)}
        rate = (8 * (E[1] - E[-1]) - (E[2] - E[-2])) / (12 * h)
        q, v, a = motion(t)
        tau = compute_rnea(rig, q[None], v[None], a[None])[0]
        np.testing.assert_allclose(rate, v @ tau, rtol=0, atol=1e-8 * (1 + np.abs(v) @ np.abs(tau)))


@pytest.mark.parametrize(("name", "payload"), VARIETY)
def test_power_is_the_rate_of_energy_on_every_bundled_rig(name: str, payload: str) -> None:
    power_balance(bundled(name, payload), seed=4)


@pytest.mark.parametrize("name", ODD)
def test_power_is_the_rate_of_energy_on_any_other_urdf(name: str) -> None:
    power_balance(odd(name), seed=5)
