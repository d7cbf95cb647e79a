"""Laws of gaps and springs between motor and link: where a gap opens, what a search moves along, what hushes."""

from __future__ import annotations

from dataclasses import replace
from math import copysign, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from gimbal_pin.diagnosis import BAND
from gimbal_pin.diagnosis.contenders import hushes
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.search import forward, swapped
from gimbal_pin.diagnosis.shapes import measure
from gimbal_pin.diagnosis.state import Problem, solved, without
from gimbal_pin.diagnosis.verdict import at_bound
from gimbal_pin.effects.backlash import Backlash
from gimbal_pin.effects.base import Term
from gimbal_pin.effects.joint_flexibility import JointFlexibility
from gimbal_pin.effects.presliding import Presliding
from gimbal_pin.effects.signal import Borne, Signal
from gimbal_pin.log import Array, Log
from gimbal_pin.model import nominal
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed

RIG = Rig.load("turret")
JOINT = RIG.joints[-1]


def two_masses(push: Array, gap: float, rotor: float, link: float, load: float, dt: float) -> Array:
    """Rate of a rotor that `push`, N m, drives through a gap, landing without a bounce, a link that bears a load."""
    place, rates, out, touching = gap / 2, [0.0, 0.0], [], True
    for u in push.tolist():
        between = (link * u + rotor * load) / (rotor + link)  # what holds the two together while they touch
        touching = touching and between * place >= 0
        if touching:
            rates = [rates[0] + (u - load) / (rotor + link) * dt] * 2
        else:
            before = rates[0] - rates[1]
            rates = [rates[0] + u / rotor * dt, rates[1] - load / link * dt]
            place += (before + rates[0] - rates[1]) / 2 * dt
            if abs(place) >= gap / 2:
                rates = [(rotor * rates[0] + link * rates[1]) / (rotor + link)] * 2
                place, touching = copysign(gap / 2, place), True
        out.append(rates[0])
    return np.array(out)


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.6), st.floats(-0.3, 0.3), st.floats(0.0, 0.2))
@settings(deadline=None, max_examples=25)
def test_a_gap_passes_on_what_the_rigid_joint_would_ask_for(seed: int, share: float, load: float, brake: float) -> None:
    """Impulse of what acts, less friction and load, is the momentum of both masses at the rotor's rate."""
    rng, dt, inertia = np.random.default_rng(seed), 1e-4, 0.004
    t = dt * np.arange(8000)
    friction = brake * np.sign(np.sin(2 * np.pi * t + rng.uniform(0, 6)))
    command = load + friction + 0.5 * np.sin(2 * np.pi * rng.uniform(2, 4) * t + 0.3)
    signal = Backlash(JOINT, 0.01, inertia, share)
    link = inertia * (1 / share - 1)
    rate = two_masses(command - friction, signal.gap, inertia, link, load, dt)
    acting = signal.along(command, dt, Borne(friction, np.full_like(t, load)))
    impulse = np.cumsum(acting - friction - load) * dt
    assert np.mean(np.abs(impulse - (inertia + link) * rate)) < 0.01 * np.max(np.abs(impulse)) + 1e-12


def test_who_knows_nothing_of_a_joint_takes_it_to_bear_nothing() -> None:
    x = np.sin(np.arange(500) / 20)
    gap, ring = Backlash(JOINT, 0.01, 1e-3, 0.3), JointFlexibility(JOINT, 9.0, 0.05, 0.3)
    np.testing.assert_array_equal(gap.along(x, 1e-3, None), gap.acting(x, 1e-3))
    np.testing.assert_allclose(gap.along(x, 1e-3, Borne(0 * x, 0 * x)), gap.acting(x, 1e-3))
    np.testing.assert_array_equal(ring.along(x, 1e-3, Borne(x, x)), ring.acting(x, 1e-3))


@given(st.floats(5.0, 60.0), st.floats(0.05, 0.5), st.floats(0.8, 1.4))
def test_a_resonance_is_moved_along_its_zero(frequency: float, share: float, factor: float) -> None:
    one = JointFlexibility(JOINT, frequency, 0.05, share)
    other = one.moved("frequency", factor * frequency)
    assert isinstance(other, JointFlexibility)
    assert sqrt(other.rotor_share) * other.frequency == pytest.approx(sqrt(share) * frequency)
    assert other.damping / other.frequency == pytest.approx(0.05 / frequency)
    assert JointFlexibility(JOINT, frequency).moved("frequency", 9.0) == JointFlexibility(JOINT, 9.0)


def commanded(signal: Signal, seed: int) -> Log:
    """A log whose commands are those that make the rig's torque behind a signal that can be undone."""
    log = prescribed(nominal(RIG), seconds=14.0, torque_noise=0.0, dt=2e-3)
    j, tau = RIG.joint_index(signal.joint), np.array(log.tau)
    tau[:, j] = tau[0, j] + lfilter([1.0], signal.response(log.dt, len(tau)), tau[:, j] - tau[0, j])
    return replace(log, tau=tau + 1e-3 * np.random.default_rng(seed).standard_normal(tau.shape))


@pytest.mark.parametrize(("frequency", "share"), [(13.0, 0.2), (36.0, 0.15)])
def test_a_spring_is_found_by_its_zero_in_the_band_or_far_above_it(frequency: float, share: float) -> None:
    true = JointFlexibility(JOINT, frequency, 0.08, share)
    log = commanded(true, 5)
    problem = Problem.of(gather(RIG, [log], replace(BAND, alignment=0.0), {log.name: 0.0}), reduce(RIG))
    seen = problem.evidence.seen[RIG.joint_index(JOINT)]
    shelf = Library(problem, JointFlexibility.tried(JOINT, seen))
    state = forward(solved(problem, (), solved(problem, ())), shelf)
    found = state.causes[0]
    assert isinstance(found, JointFlexibility)
    stiff, told = (x.frequency / sqrt(1 / x.rotor_share - 1) for x in (true, found))
    assert told == pytest.approx(stiff, rel=0.1)
    base = without(state, found)
    assert not hushes(base, measure(base, found), found)


@pytest.mark.parametrize(("true", "told"), [((6.0, 0.5, 0.2), True), ((90.0, 1e-3, 0.2), False)])
def test_a_shape_at_its_bound_is_doubted_only_where_the_log_tells_it(
    true: tuple[float, float, float], told: bool
) -> None:
    cause = JointFlexibility(JOINT, *true)
    log = commanded(cause, 6)
    problem = Problem.of(gather(RIG, [log], replace(BAND, alignment=0.0), {log.name: 0.0}), reduce(RIG))
    assert at_bound(solved(problem, (), solved(problem, ())), cause) == told


@pytest.mark.parametrize(("stroke", "damping", "slips"), [(0.03, 0.2, False), (0.08, 0.05, False), (0.05, 0.1, True)])
def test_bristles_are_told_from_others_by_damping_and_lengths(stroke: float, damping: float, slips: bool) -> None:
    name = RIG.joints[0]
    term = Term(Presliding(name, stroke, True, slips), (0.1, damping))
    plain = nominal(RIG)
    log = prescribed(replace(plain, terms=(*plain.terms, term)), seconds=14.0, torque_noise=1e-3, dt=2e-3)
    problem = Problem.of(gather(RIG, [log], replace(BAND, alignment=0.0), {log.name: 0.0}), reduce(RIG))
    shelf = Library(problem, Presliding.tried(name, problem.evidence.seen[0]))
    state = swapped(forward(solved(problem, (), solved(problem, ())), shelf), shelf)
    found = state.causes[0]
    assert isinstance(found, Presliding) and found.damped and found.slips == slips
    assert found.stroke == pytest.approx(stroke, rel=0.1)
    assert state.coefficients(found)[1] == pytest.approx(damping, rel=0.2)
