"""Laws of gaps and springs between motor and link: where a gap opens, what a spring passes on, that logs tell them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import copysign, sqrt
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gimbal_pin.control import tune
from gimbal_pin.diagnosis import DIAGNOSIS_BAND, Problem, gather, solve_causes
from gimbal_pin.dynamics import nominal, reduce_parameters, simulate
from gimbal_pin.effects import Backlash, JointFlexibility, JointLoad, Presliding, Term
from gimbal_pin.log import Array, Motion
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier, prescribed
from tests.candidates import refined, worth

RIG = Rig.load("turret")
JOINT = RIG.joints[-1]


def two_masses(push: Array, gap: float, rotor: float, link: float, load: float, dt: float) -> Array:
    """Rate of a rotor that `push`, N m, drives through a gap, landing without a bounce, a link that bears a load."""
    place = gap / 2
    rates = [0.0, 0.0]
    out = []
    touching = True
    for u in push.tolist():
        between = (link * u + rotor * load) / (
            rotor + link
        )  # what holds the two together while they touch
        touching = touching and between * place >= 0
        if touching:
            rates = [rates[0] + (u - load) / (rotor + link) * dt] * 2
        else:
            before = rates[0] - rates[1]
            rates = [rates[0] + u / rotor * dt, rates[1] - load / link * dt]
            place += (before + rates[0] - rates[1]) / 2 * dt
            if abs(place) >= gap / 2:
                rates = [(rotor * rates[0] + link * rates[1]) / (rotor + link)] * 2
                place = copysign(gap / 2, place)
                touching = True
        out.append(rates[0])
    return np.array(out)


@given(st.floats(0.5, 500.0), st.floats(1e-3, 0.5), st.floats(1e-6, 0.95))
def test_a_spring_within_its_bounds_is_felt(frequency: float, damping: float, share: float) -> None:
    """Whatever a search comes by on its way can be computed: it refused a soft spring before a light rotor."""
    load = np.ones((40, 1))
    inertial = np.linspace(-1.0, 1.0, 40)[:, None]
    assert np.all(
        np.isfinite(JointFlexibility(JOINT, frequency, damping, share).felt(load, inertial, 0.005))
    )


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.6), st.floats(-0.3, 0.3), st.floats(0.0, 0.2))
def test_a_gap_passes_on_what_the_rigid_joint_would_ask_for(
    seed: int, share: float, load: float, brake: float
) -> None:
    """Impulse of what acts, less friction and load, is the momentum of both masses at the rotor's rate."""
    rng = np.random.default_rng(seed)
    dt = 1e-4
    inertia = 0.004
    t = dt * np.arange(8000)
    friction = brake * np.sign(np.sin(2 * np.pi * t + rng.uniform(0, 6)))
    command = load + friction + 0.5 * np.sin(2 * np.pi * rng.uniform(2, 4) * t + 0.3)
    signal = Backlash(JOINT, 0.01, inertia, share)
    link = inertia * (1 / share - 1)
    rate = two_masses(command - friction, signal.gap, inertia, link, load, dt)
    acting = signal.along(command, dt, JointLoad(friction, np.full_like(t, load)))
    impulse = np.cumsum(acting - friction - load) * dt
    assert (
        np.mean(np.abs(impulse - (inertia + link) * rate)) < 0.01 * np.max(np.abs(impulse)) + 1e-12
    )


def test_who_knows_nothing_of_a_joint_takes_it_to_bear_nothing() -> None:
    x = np.sin(np.arange(500) / 20)
    gap = Backlash(JOINT, 0.01, 1e-3, 0.3)
    ring = JointFlexibility(JOINT, 9.0, 0.05, 0.3)
    np.testing.assert_array_equal(gap.along(x, 1e-3, None), gap.acting(x, 1e-3))
    np.testing.assert_allclose(gap.along(x, 1e-3, JointLoad(0 * x, 0 * x)), gap.acting(x, 1e-3))
    np.testing.assert_array_equal(ring.along(x, 1e-3, None), ring.acting(x, 1e-3))
    on_link = replace(ring, rotor_share=0.0)
    np.testing.assert_array_equal(on_link.along(x, 1e-3, JointLoad(x, x)), on_link.acting(x, 1e-3))


class Swung(NamedTuple):
    """Two masses on a spring, the rotor behind dry friction: push and friction, N m, the rotor's acceleration."""

    push: Array
    friction: Array
    acceleration: Array
    still: NDArray[np.bool_]


def swung(
    ring: JointFlexibility, inertia: float, dry: float, load: Array, push: Array, dt: float
) -> Swung:
    """Integrate them, the link swinging already; the rotor sticks where the friction can hold it."""
    rotor = ring.rotor_share * inertia
    link = (1 - ring.rotor_share) * inertia
    w = 2 * np.pi * ring.frequency
    k = w * w * rotor * link / inertia
    c = 2 * ring.damping * w * rotor * link / inertia
    bend = 0.3 / k
    bending = 0.0
    rate = 0.0
    rows = []
    for u, asked in zip(push.tolist(), load.tolist()):
        spring = k * bend + c * bending
        free = rate + (u - spring) / rotor * dt
        brake = max(-dry, min(dry, free * rotor / dt))
        a = (u - spring - brake) / rotor
        rows.append((brake, a, abs(rate + a * dt) < 1e-12))
        rate += a * dt
        bending += (a - (spring - asked) / link) * dt
        bend += bending * dt
    brakes, accelerations, still = map(np.array, zip(*rows))
    return Swung(push, brakes, accelerations, still)


@given(
    st.floats(5.0, 25.0),
    st.floats(0.02, 0.3),
    st.floats(0.1, 0.6),
    st.floats(0.0, 0.2),
    st.integers(0, 99),
)
def test_a_spring_passes_on_what_the_link_asks_for_while_the_rotor_sticks_too(
    frequency: float, damping: float, share: float, dry: float, seed: int
) -> None:
    """``y = (I + J) a + friction + load``, whatever friction is taken to hold the rotor where it stands."""
    dt = 1e-4
    inertia = 0.01
    rng = np.random.default_rng(seed)
    ring = JointFlexibility(JOINT, frequency, damping, share)
    t = 1e-4 * np.arange(15000)
    load = 0.1 + 0.05 * np.sin(2 * np.pi * 0.7 * t + rng.uniform(0, 6))
    push = (
        load + 0.25 * np.sin(2 * np.pi * rng.uniform(1, 3) * t) + 0.05 * np.sin(2 * np.pi * 5 * t)
    )
    was = swung(ring, inertia, dry, load, push, dt)
    told = np.where(was.still, rng.normal(size=len(t)), was.friction)
    acting = ring.along(push, dt, JointLoad(told, load, inertia * was.acceleration, was.still))
    wrong = acting - (inertia * was.acceleration + was.friction + load)
    assert np.sqrt(np.mean(wrong[~was.still] ** 2)) < 0.02 * np.sqrt(np.mean(push**2))


@given(st.floats(5.0, 60.0), st.floats(0.05, 0.5), st.floats(0.8, 1.4))
def test_a_resonance_is_moved_along_its_zero(frequency: float, share: float, factor: float) -> None:
    one = JointFlexibility(JOINT, frequency, 0.05, share)
    other = one.moved("frequency", factor * frequency)
    assert isinstance(other, JointFlexibility)
    assert sqrt(other.rotor_share) * other.frequency == pytest.approx(sqrt(share) * frequency)
    assert other.damping / other.frequency == pytest.approx(0.05 / frequency)
    assert JointFlexibility(JOINT, frequency).moved("frequency", 9.0) == JointFlexibility(
        JOINT, 9.0
    )


def brisk(joint: int, seed: int, seconds: float, dt: float) -> Motion:
    """A slow motion of all joints, and fast sines of one."""
    slow = fourier(RIG, 0, seconds, dt)
    rng = np.random.default_rng(seed)
    q, v, a = map(np.array, (slow.q, slow.v, slow.a))
    for w in 2 * np.pi * np.linspace(1.0, 11.0, 21):
        size = 0.3 / w**1.5
        phase = w * slow.t + rng.uniform(0, 2 * np.pi)
        for x, y in zip((q, v, a), (np.sin(phase), w * np.cos(phase), -w * w * np.sin(phase))):
            x[:, joint] += size * y
    return Motion(slow.t, q, v, a)


def test_a_spring_is_found_by_its_zero() -> None:
    """Simulation and fit are of one formula, with dry friction on the rotor, which turns round and sticks."""
    true = JointFlexibility(JOINT, 13.0, 0.08, 0.2)
    controller = tune(nominal(RIG), bandwidth_hz=2.0).controller
    reference = brisk(RIG.joint_index(JOINT), 5, 6.0, controller.dt)
    log = simulate(nominal(RIG), controller, reference, rng=np.random.default_rng(5), drive=(true,))
    problem = Problem.of(gather(RIG, [log], DIAGNOSIS_BAND), reduce_parameters(RIG))
    seen = problem.evidence.seen[RIG.joint_index(JOINT)]
    state = solve_causes(problem, (), solve_causes(problem, ()))
    found = refined(state, max(JointFlexibility.tried(JOINT, seen), key=partial(worth, state)))
    assert isinstance(found, JointFlexibility)
    stiff, told = (x.frequency / sqrt(1 / x.rotor_share - 1) for x in (true, found))
    assert told == pytest.approx(stiff, rel=0.1)


@pytest.mark.parametrize(("stroke", "damping"), [(0.03, 0.2), (0.08, 0.05)])
def test_damped_bristles_are_recovered(stroke: float, damping: float) -> None:
    name = RIG.joints[0]
    term = Term(Presliding(name, stroke, True), (0.1, damping))
    plain = nominal(RIG)
    log = prescribed(
        replace(plain, terms=(*plain.terms, term)), seconds=14.0, torque_noise=1e-3, dt=2e-3
    )
    problem = Problem.of(
        gather(RIG, [log], replace(DIAGNOSIS_BAND, alignment=0.0)), reduce_parameters(RIG)
    )
    first = solve_causes(problem, (), solve_causes(problem, ()))
    tried = [refined(first, one) for one in Presliding.tried(name, problem.evidence.seen[0])]
    found = max(tried, key=partial(worth, first))
    state = solve_causes(problem, (found,), first)
    assert isinstance(found, Presliding) and found.damped
    assert found.stroke == pytest.approx(stroke, rel=0.1)
    assert state.coefficients(found)[1] == pytest.approx(damping, rel=0.2)


@given(st.floats(15, 30), st.floats(0.1, 0.3), st.floats(1.5, 3.0))
def test_far_under_its_resonance_a_spring_shows_one_figure_of_two(
    hertz: float, share: float, factor: float
) -> None:
    command = np.sin(2 * np.pi * 2.0 * np.arange(2000) / 1000) * np.hanning(2000)
    other = factor * hertz, 1 / (1 + (1 / share - 1) * factor**2)  # the same (1/r - 1)/ω²
    one, two = (
        command - JointFlexibility("pan", f, 0.05, r).acting(command, 1e-3)
        for f, r in ((hertz, share), other)
    )
    assert np.linalg.norm(one - two) < 0.05 * np.linalg.norm(one)
