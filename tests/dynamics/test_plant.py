"""Laws of the plant.

It agrees with closed forms; its energy grows by the work of the torque, less what friction takes; it inverts
`Model.inverse_dynamics`; and a joint sticks exactly as long as its dry friction can hold it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import Model, Plant, State, nominal
from gimbal_pin.effects import Coulomb, QuadraticDrag, Term, Viscous
from gimbal_pin.log import Array
from gimbal_pin.rig import Rig
from tests.dynamics.odd_rigs import ALL, known
from tests.dynamics.test_dynamics import shake
from tests.rigs import energy, spelled

COUPLED = ["handheld", "double-pendulum"]
"""A gimbal, and joints that push each other hard."""


def rub(rig: Rig, dry: Sequence[float], viscous: Sequence[float]) -> Model:
    """Return the rig with Coulomb and viscous friction of these sizes."""
    terms = [Term(Coulomb(joint), (float(size),)) for joint, size in zip(rig.joints, dry)]
    terms += [Term(Viscous(joint), (float(size),)) for joint, size in zip(rig.joints, viscous)]
    return Model(rig, tuple(terms))


def run(model: Model, state: State, tau: Array, seconds: float, steps: int) -> State:
    """Return the state after so many equal steps."""
    plant = Plant(model)
    for k in range(steps):
        state = plant.step(k * seconds / steps, state, tau, seconds / steps)
    return state


def draw(rig: Rig, rng: np.random.Generator) -> tuple[State, Array]:
    """Return a pose, rates and a torque of the size that the rig knows."""
    q, v, tau = rng.uniform(-1, 1, (3, rig.n))
    return State(q, 2 * v), 0.3 * tau


def weigh(rig: Rig, q: Array) -> Array:
    """Return the torque of gravity."""
    return pin.computeGeneralizedGravity(rig.model, rig.model.createData(), q)


@given(st.integers(0, 2**32 - 1), st.sampled_from(COUPLED), st.sampled_from([0.0, 1.0]))
def test_energy_grows_by_the_work_of_the_torque_less_what_friction_takes(
    seed: int, name: str, size: float
) -> None:
    rig = known(name)
    rng = np.random.default_rng(seed)
    dry = size * rng.uniform(0, 0.3, rig.n) * (rng.random(rig.n) < 0.8)
    plant = Plant(rub(rig, dry, size * rng.uniform(0, 0.1, rig.n)))
    state, tau = draw(rig, rng)
    levels = []
    for k in range(200):
        levels.append(energy(rig, state.q, state.v) - tau @ state.q)
        state = plant.step(k * 1e-3, state, tau, 1e-3)
    gains = np.diff(levels)
    assert gains.max() <= 1e-9
    assert size or gains.min() >= -1e-9


@given(st.integers(0, 2**32 - 1), st.sampled_from(ALL), st.booleans(), st.booleans())
def test_inverse_undoes_the_plant(seed: int, name: str, sticks: bool, is_shaken: bool) -> None:
    """The torque of `Model.inverse_dynamics` for the plant's acceleration is the given one, but at a stuck joint."""
    rig = known(name)
    rng = np.random.default_rng(seed)
    state, tau = draw(rig, rng)
    dry, viscous = rng.uniform(0, 0.5, (2, rig.n))
    platform = shake(seed)[0] if is_shaken else None
    if sticks:
        state.v[0] = 0.0
        dry[0] = 1e6
    model = rub(rig, dry, viscous)
    a = Plant(model, platform).acceleration(3.0, state, tau)
    at = None if platform is None else platform.part(slice(3, 4))
    found = model.inverse_dynamics(state.q[None], state.v[None], a[None], platform=at)[0]
    assert not sticks or a[0] == 0
    np.testing.assert_allclose(found[sticks:], tau[sticks:], rtol=0, atol=1e-8)


def slide(
    q: float, v: float, push: float, dry: float, mass: float, seconds: float
) -> tuple[float, float]:
    """Return ``mass a = push - dry sign(v)`` in closed form, sticking at v = 0 while |push| <= dry."""
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


@given(st.integers(0, 2**32 - 1), st.sampled_from(["wheel", "slide"]), st.booleans())
def test_one_joint_slides_stops_and_sticks_as_on_paper(seed: int, name: str, rests: bool) -> None:
    """Acceleration is constant between stops: any step is exact, but for the last 1e-9 s of one in which it stops."""
    rig = known(name)
    rng = np.random.default_rng(seed)
    v, push = rng.uniform(-5, 5, 2) * [not rests, 1]
    dry = rng.uniform(0, 15)
    seconds = rng.uniform(0.01, 3)
    q = np.array([0.3])
    mass = pin.crba(rig.model, rig.model.createData(), q)[0, 0]
    net = push - weigh(rig, q)[0]
    state = State(q, np.array([v]))
    after = run(rub(rig, [dry], [0.0]), state, np.array([push]), seconds, int(rng.integers(1, 200)))
    angle, rate = slide(0.3, v, net, dry, mass, seconds)
    slack = 1e-6 * (1 + abs(net) + dry) / mass
    assert after.v[0] == pytest.approx(rate, abs=slack / 5)
    assert after.q[0] == pytest.approx(angle, abs=slack)
    if slide(0.3, v, net, dry, mass, 0.99 * seconds)[1] == rate == 0:
        assert after.v[0] == 0


@given(st.integers(0, 2**32 - 1), st.sampled_from(COUPLED))
def test_from_rest_each_joint_sticks_within_its_friction_or_slides_the_way_it_speeds_up(
    seed: int, name: str
) -> None:
    """A joint that another one drags may not go the way that it was pushed at first."""
    rig = known(name)
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, rig.n)
    dry = rng.uniform(0.01, 0.3, rig.n)
    net = 0.5 * rng.normal(size=rig.n)
    tau = weigh(rig, q) + net
    plant = Plant(rub(rig, dry, 0 * dry))
    state = State(q, np.zeros(rig.n))
    a = plant.acceleration(0.0, state, tau)
    rubs = tau - pin.rnea(rig.model, rig.model.createData(), q, 0 * q, a)
    slides = np.abs(a) > 0
    np.testing.assert_allclose(rubs[slides], (dry * np.sign(a))[slides], atol=1e-9)
    assert (np.abs(rubs) <= dry + 1e-9).all()
    after = plant.step(0.0, state, tau, 1e-5)
    np.testing.assert_allclose(after.v, 1e-5 * a, atol=1e-8 * (1 + np.abs(a).max()))
    np.testing.assert_array_equal(np.sign(after.v), np.sign(a))


@pytest.mark.parametrize("joint", [0, 1])
def test_a_stuck_joint_is_a_weld(joint: int) -> None:
    """The joints beside it move as if it were fixed."""
    rig = known("thesis")
    turning = f'<joint name="{rig.joints[joint]}" type="revolute"'
    welded = spelled(rig.urdf.replace(turning, turning.replace("revolute", "fixed")))
    moving = np.arange(3) != joint
    v = np.where(moving, [1.5, -1.2, 2.0], 0.0)
    tau = np.zeros(3)
    stuck = run(
        rub(rig, np.where(moving, 0.0, 5.0).tolist(), [0.0] * 3), State(tau, v), tau, 0.3, 300
    )
    fixed = run(Model(welded, ()), State(tau[moving], v[moving]), tau[moving], 0.3, 300)
    assert stuck.q[joint] == stuck.v[joint] == 0
    assert np.abs(fixed.q).min() > 0.01
    np.testing.assert_allclose(stuck.q[moving], fixed.q, atol=1e-10)


def test_a_state_beyond_all_numbers_is_lost() -> None:
    """A drag so stiff that a step of RK4 leaves the floats' range ends in no traceback."""
    model = nominal(known("turret"))
    stiff = replace(model, terms=(*model.terms, Term(QuadraticDrag("pan", 3.0), (1.0,))))
    after = Plant(stiff).step(0.0, State(np.zeros(2), np.array([1e6, 0.0])), np.zeros(2), 2e-3)
    assert after.lost
