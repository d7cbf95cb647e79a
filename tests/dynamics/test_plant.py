"""The plant: closed forms, energy, true stick, and MuJoCo on the same URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product
from math import inf
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree
from scipy.integrate import solve_ivp

from gimbal_pin.dynamics import Model, Plant, State, nominal
from gimbal_pin.effects import Coulomb, QuadraticDrag, Term, Viscous
from gimbal_pin.rig import Rig
from tests.mujoco_peer import rigid_bodies
from tests.rigs import bundled, energy, spelled

WHEEL = """<robot name="wheel"><link name="base"/>
  <link name="wheel"><inertial><mass value="3"/>
    <inertia ixx="0.2" iyy="0.4" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="axle" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 1 0"/></joint></robot>"""
"""A mass whose centre lies on its horizontal axis: gravity does nothing."""

SLOPE = 0.4
SLEDGE = f"""<robot name="sledge"><link name="base"/>
  <link name="sledge"><inertial><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="slope" type="prismatic"><parent link="base"/><child link="sledge"/><origin rpy="0 {SLOPE} 0"/>
    <axis xyz="1 0 0"/><limit lower="-99" upper="99" effort="99" velocity="99"/></joint></robot>"""
"""2 kg on rails that fall by 0.4 rad along +x."""

ARM = (
    '<inertial><origin xyz="0 0 -0.2"/><mass value="{0}"/>'
    '<inertia ixx="{1}" iyy="{1}" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<axis xyz="0 1 0"/><limit lower="-99" upper="99" effort="99" velocity="99"/>'
PENDULUM = f"""<robot name="pendulum"><link name="base"/>
  <link name="upper">{ARM.format(0.6, 0.009)}</link><link name="lower">{ARM.format(0.5, 0.008)}</link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>{LIMIT}</joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/>{LIMIT}</joint>
</robot>"""
"""A double pendulum: its joints push each other hard, unlike a gimbal's."""


def known(name: str) -> Rig:
    """A bundled rig or one of the three above."""
    own = {"wheel": WHEEL, "sledge": SLEDGE, "pendulum": PENDULUM}
    return spelled(own[name]) if name in own else bundled(name)


def rubbing(rig: Rig, dry: Sequence[float], viscous: Sequence[float] = ()) -> Model:
    """The rig with Coulomb (and viscous) friction of these sizes."""
    terms = [Term(Coulomb(joint), (float(size),)) for joint, size in zip(rig.joints, dry)]
    return Model(
        rig,
        (
            *terms,
            *(Term(Viscous(joint), (float(size),)) for joint, size in zip(rig.joints, viscous)),
        ),
    )


def run(model: Model, state: State, tau: np.ndarray, seconds: float, steps: int) -> State:
    plant = Plant(model)
    for k in range(steps):
        state = plant.step(k * seconds / steps, state, tau, seconds / steps)
    return state


def drawn(rig: Rig, seed: int) -> tuple[State, np.ndarray]:
    """A pose, rates and a torque of the size that the rig knows."""
    draw = np.random.default_rng(seed).uniform(-1, 1, (3, rig.n))
    return State(draw[0], 2 * draw[1]), 0.3 * draw[2]


def gravity(rig: Rig, q: np.ndarray) -> np.ndarray:
    return pin.computeGeneralizedGravity(rig.model, rig.model.createData(), q)


# --- without friction -----------------------------------------------------------------------------------------------

SMOOTH = ["thesis", "handheld", "turret", "pendulum"]


@pytest.mark.parametrize("name", SMOOTH)
def test_error_falls_with_the_fourth_power_of_the_step(name: str) -> None:
    """Against an integrator of eighth order on ABA; friction of size zero must not spoil it."""
    rig = known(name)
    state, tau = drawn(rig, 1)

    def flow(_: float, y: np.ndarray) -> np.ndarray:
        q, v = np.split(y, 2)
        return np.concatenate([v, pin.aba(rig.model, rig.model.createData(), q, v, tau)])

    exact = solve_ivp(
        flow, (0, 1), np.concatenate([state.q, state.v]), "DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]
    for model in (Model(rig, ()), rubbing(rig, np.zeros(rig.n), np.zeros(rig.n))):
        errors = [
            np.linalg.norm(np.concatenate(run(model, state, tau, 1, n)[:2]) - exact)
            for n in (128, 256, 512)
        ]
        assert errors[-1] < 1e-5
        for coarse, fine in pairwise(errors):
            assert np.log2(coarse / fine) == pytest.approx(4, abs=0.4)


@pytest.mark.parametrize("name", SMOOTH)
def test_energy_is_kept(name: str) -> None:
    rig = known(name)
    state, tau = drawn(rig, 2)
    after = run(Model(rig, ()), state, 0 * tau, 1.0, 1000)
    assert np.abs(after.q - state.q).max() > 0.1
    assert energy(rig, after.q, after.v) == pytest.approx(energy(rig, state.q, state.v), abs=1e-7)


@given(st.integers(0, 2**32 - 1), st.sampled_from([*SMOOTH, "wheel", "sledge"]))
def test_inverse_undoes_the_plant(seed: int, name: str) -> None:
    """Model.inverse(q, v, a) of the plant's acceleration is the torque that it was given, while all joints slide."""
    rig = known(name)
    state, tau = drawn(rig, seed)
    size = np.random.default_rng(seed).uniform(0, 0.5, (2, rig.n))
    model = rubbing(rig, *size)
    plant = Plant(model)
    contact = plant.contact(0.0, state, tau)
    assert contact.slide == tuple(np.sign(state.v)) and not contact.stuck
    a = plant.acceleration(0.0, state, tau)
    torque = model.inverse(state.q[None], state.v[None], a[None])[0]
    np.testing.assert_allclose(torque, tau, rtol=0, atol=1e-10)


# --- one joint, in closed form --------------------------------------------------------------------------------------


def closed_form(
    q: float, v: float, push: float, dry: float, mass: float, seconds: float
) -> tuple[float, float]:
    """``mass a = push - dry sign(v)``, sticking at v = 0 while |push| <= dry."""
    while True:
        way = np.sign(v) or (np.sign(push) if abs(push) > dry else 0.0)
        if not way:
            return q, 0.0
        a = (push - way * dry) / mass
        stop = -v / a if a * v < 0 else inf
        if stop >= seconds:
            return q + (v + a * seconds / 2) * seconds, v + a * seconds
        q = q + v * stop / 2
        v = 0.0
        seconds = seconds - stop


FORCE = st.floats(0, 5).map(lambda x: round(x, 3))
PUSH = st.floats(-5, 5).map(lambda x: round(x, 3))


@given(PUSH, PUSH, FORCE, st.floats(0.01, 3), st.integers(1, 200))
def test_wheel_slides_stops_and_sticks_as_on_paper(
    v: float, push: float, dry: float, seconds: float, steps: int
) -> None:
    """Acceleration is constant between stops: any step is exact, but for the last 1e-9 s of one in which it stops."""
    rig = known("wheel")
    after = run(
        rubbing(rig, [dry]), State(np.array([0.3]), np.array([v])), np.array([push]), seconds, steps
    )
    q, rate = closed_form(0.3, v, push, dry, 0.4, seconds)
    assert after.v[0] == pytest.approx(rate, abs=2e-7)
    assert after.q[0] == pytest.approx(q, abs=1e-6)
    if closed_form(0.3, v, push, dry, 0.4, 0.99 * seconds)[1] == rate == 0:
        assert after.v[0] == 0


@given(PUSH, PUSH, st.floats(0, 15).map(lambda x: round(x, 3)), st.floats(0.01, 2))
def test_sledge_on_a_slope(v: float, push: float, dry: float, seconds: float) -> None:
    """Gravity pulls with m g sin(slope) down the rails; under more dry friction than that, it stays where it is."""
    rig = known("sledge")
    after = run(
        rubbing(rig, [dry]), State(np.zeros(1), np.array([v])), np.array([push]), seconds, 50
    )
    q, rate = closed_form(0.0, v, push + 2 * 9.81 * np.sin(SLOPE), dry, 2.0, seconds)
    assert after.v[0] == pytest.approx(rate, abs=2e-7)
    assert after.q[0] == pytest.approx(q, abs=1e-6)


@pytest.mark.parametrize(("share", "moves"), [(0.999, False), (1.0, False), (1.001, True)])
@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_breakaway_is_sharp(share: float, moves: bool, way: float) -> None:
    state = State(np.array([0.3]), np.zeros(1))
    after = run(rubbing(known("wheel"), [0.25]), state, np.array([way * share * 0.25]), 1.0, 100)
    assert (after.q[0] != 0.3) == moves
    assert np.sign(after.v[0]) == (way if moves else 0)


# --- several joints -------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.sampled_from(SMOOTH))
def test_below_breakaway_nothing_moves_at_all(seed: int, name: str) -> None:
    rig = known(name)
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, rig.n)
    dry = rng.uniform(0.01, 1, rig.n)
    tau = gravity(rig, q) + rng.uniform(-0.999, 0.999, rig.n) * dry
    after = run(rubbing(rig, dry, dry), State(q, np.zeros(rig.n)), tau, 0.05, 50)
    np.testing.assert_array_equal(after.q, q)
    np.testing.assert_array_equal(after.v, 0)


@given(st.integers(0, 2**32 - 1), st.sampled_from(SMOOTH), st.floats(1.01, 3))
def test_above_breakaway_the_pushed_joint_moves(seed: int, name: str, share: float) -> None:
    rig = known(name)
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, rig.n)
    dry = rng.uniform(0.01, 1, rig.n)
    joint = int(rng.integers(rig.n))
    way = rng.choice([-1.0, 1.0])
    tau = gravity(rig, q) + way * share * dry * (np.arange(rig.n) == joint)
    after = run(rubbing(rig, dry), State(q, np.zeros(rig.n)), tau, 1e-3, 1)
    assert after.v[joint] * way > 0


def consistent_modes(
    rig: Rig, q: np.ndarray, tau: np.ndarray, dry: np.ndarray
) -> list[tuple[tuple, np.ndarray]]:
    """Every way to slide or stick from rest that keeps its promises, by trying all 3^n."""
    upper = np.triu(pin.crba(rig.model, rig.model.createData(), q))
    D = upper + np.triu(upper, 1).T
    net = tau - gravity(rig, q)
    out = []
    for mode in product((-1.0, 0.0, 1.0), repeat=rig.n):
        free = np.flatnonzero(mode)
        a = np.zeros(rig.n)
        a[free] = np.linalg.solve(D[np.ix_(free, free)], (net - dry * mode)[free])
        holding = net - D @ a
        if all(s * x >= 0 if s else abs(h) <= f for s, x, h, f in zip(mode, a, holding, dry)):
            out.append((mode, a))
    return out


@given(st.integers(0, 2**32 - 1), st.sampled_from(["pendulum", "pendulum", *SMOOTH]))
def test_from_rest_the_joints_slide_in_the_one_consistent_way(seed: int, name: str) -> None:
    """A joint that another one drags may not go the way that it was pushed at first."""
    rig = known(name)
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, rig.n)
    dry = rng.uniform(0.01, 0.3, rig.n)
    tau = gravity(rig, q) + 0.5 * rng.normal(size=rig.n)
    ((mode, a),) = consistent_modes(rig, q, tau, dry)
    plant = Plant(rubbing(rig, dry))
    state = State(q, np.zeros(rig.n))
    contact = plant.contact(0.0, state, tau)
    assert contact.slide == mode
    np.testing.assert_allclose(
        plant.acceleration(0.0, state, tau), a, atol=1e-9 * (1 + np.abs(a).max())
    )
    after = plant.step(0.0, state, tau, 1e-5)
    np.testing.assert_allclose(after.v, 1e-5 * a, atol=1e-6 * (1 + np.abs(a).max()) * 1e-2)


@given(st.integers(0, 2**32 - 1), st.sampled_from(SMOOTH))
def test_energy_never_grows_without_torque(seed: int, name: str) -> None:
    rig = known(name)
    rng = np.random.default_rng(seed)
    dry = rng.uniform(0, 0.3, rig.n) * (rng.random(rig.n) < 0.8)
    viscous = rng.uniform(0, 0.1, rig.n)
    state, _ = drawn(rig, seed)
    plant = Plant(rubbing(rig, dry, viscous))
    none = np.zeros(rig.n)
    levels = [energy(rig, state.q, state.v)]
    for k in range(300):
        state = plant.step(k * 1e-3, state, none, 1e-3)
        levels.append(energy(rig, state.q, state.v))
    assert np.diff(levels).max() <= 1e-9


@pytest.mark.parametrize(
    ("name", "joint"), [("thesis", 0), ("thesis", 1), ("handheld", 0), ("pendulum", 0)]
)
def test_a_stuck_joint_is_a_weld_until_the_others_pull_too_hard(
    tmp_path: Path, name: str, joint: int
) -> None:
    """While it sticks, the rest moves as if its joint were fixed; its reaction is what RNEA says, within friction."""
    rig = known(name)
    head, tail = rig.urdf.split(f'<joint name="{rig.joints[joint]}" type="revolute"')
    path = tmp_path / "welded.urdf"
    path.write_text(head + f'<joint name="{rig.joints[joint]}" type="fixed"' + tail)
    welded = Rig.load(path)
    moving = np.arange(rig.n) != joint
    q = np.full(rig.n, 0.0)
    v = np.where(moving, [1.5, -1.2, 2.0][: rig.n], 0.0)
    plant = Plant(rubbing(rig, 5.0 * ~moving))
    fixed = Plant(Model(welded, ()))
    state = State(q, v)
    other = State(q[moving], v[moving])
    reaction = []
    for k in range(300):
        a = plant.acceleration(0.0, state, 0 * q)
        reaction.append(-pin.rnea(rig.model, rig.model.createData(), state.q, state.v, a)[joint])
        state = plant.step(k * 1e-3, state, 0 * q, 1e-3)
        other = fixed.step(k * 1e-3, other, 0 * q[moving], 1e-3)
    assert state.q[joint] == state.v[joint] == 0
    np.testing.assert_allclose(state.q[moving], other.q, atol=1e-10)
    assert np.abs(state.q[moving]).min() > 0.01
    peak = np.abs(reaction).max()
    assert 0 < peak < 5
    for share, stays in ((1.01, True), (0.9, False)):
        assert (
            run(rubbing(rig, share * peak * ~moving), State(q, v), 0 * q, 0.3, 300).q[joint] == 0
        ) == stays


@pytest.mark.parametrize("name", SMOOTH)
def test_smaller_steps_converge_with_friction_too(name: str) -> None:
    """Stops cost two orders: the error falls with the square of the step on the whole, worst of four runs."""
    rig = known(name)
    errors = np.zeros(3)
    for seed in range(4):
        state, tau = drawn(rig, seed)
        model = rubbing(rig, np.full(rig.n, 0.1), np.full(rig.n, 0.01))
        fine = np.concatenate(run(model, state, tau, 0.5, 2048)[:2])
        now = [
            np.abs(np.concatenate(run(model, state, tau, 0.5, n)[:2]) - fine).max()
            for n in (32, 128, 512)
        ]
        errors = np.maximum(errors, now)
    assert errors[2] < errors[0] / 50
    assert errors[2] < 1e-4


@pytest.mark.parametrize("name", SMOOTH)
def test_mujoco_slides_alike(name: str) -> None:
    """MuJoCo with the same dry and viscous friction, until a joint first stops: its friction is soft only there."""
    rig = known(name)
    model = rigid_bodies(etree.fromstring(rig.urdf.encode()))
    at = [int(model.joint(joint).dofadr[0]) for joint in rig.joints]
    dry = np.full(rig.n, 0.05)
    viscous = np.full(rig.n, 0.02)
    model.dof_frictionloss[at], model.dof_damping[at] = dry, viscous
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 1e-4
    data = mujoco.MjData(model)
    q = np.full(rig.n, 0.2)
    v = np.array([2.0, -2.0, 3.0])[: rig.n]
    data.qpos[at], data.qvel[at] = q, v
    state = State(q, v)
    plant = Plant(rubbing(rig, dry, viscous))
    for k in range(100):
        state = plant.step(k * 1e-3, state, 0 * q, 1e-3)
        mujoco.mj_step(model, data, 10)
        assert (state.v * v > 0).all()
    np.testing.assert_allclose(data.qpos[at], state.q, atol=1e-7)
    np.testing.assert_allclose(data.qvel[at], state.v, atol=1e-6)


def test_a_state_beyond_all_numbers_is_lost() -> None:
    """A drag so stiff that a step of RK4 leaves the floats' range ends in no traceback."""
    model = nominal(Rig.load("turret"))
    stiff = replace(model, terms=(*model.terms, Term(QuadraticDrag("pan", 3.0), (1.0,))))
    after = Plant(stiff).step(0.0, State(np.zeros(2), np.array([1e6, 0.0])), np.zeros(2), 2e-3)
    assert after.lost


def test_nominal_model_is_the_urdf() -> None:
    rig = known("thesis")
    q, v, a = np.random.default_rng(1).normal(size=(3, 5, 3))
    friction = nominal(rig).inverse(q, v, a) - Model(rig, ()).inverse(q, v, a)
    np.testing.assert_allclose(
        friction, rig.friction[:, 0] * np.sign(v) + rig.friction[:, 1] * v, atol=1e-12
    )
