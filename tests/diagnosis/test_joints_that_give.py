"""Laws of drives, gaps and springs between motor and link: what they pass on under load, and that logs tell them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import tune
from gimbal_pin.diagnosis import DIAGNOSIS_BAND, State
from gimbal_pin.diagnosis.shapes import form, shape_names
from gimbal_pin.dynamics import nominal, simulate
from gimbal_pin.effects import Backlash, DeadZone, JointFlexibility, JointLoad, Saturation, Signal
from gimbal_pin.log import Motion
from tests.bench_logs import fourier
from tests.candidates import refined, worth
from tests.diagnosis.test_search import find_best
from tests.refitted import RIG, refit

JOINT = "tilt"


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_gap_feels_the_command_less_friction_and_what_its_link_bears(share: float) -> None:
    """``x/J`` is the rotor's acceleration less the link's, which the load brakes; with the encoder there it is x."""
    command = 0.3 + 0.5 * np.sin(0.018 * np.arange(800))
    gap = Backlash(JOINT, 0.01, 0.004, share)
    beside = share / (1 - share) * 0.2 - 0.1 if share else 0.0
    acting = gap.acting(command + beside, 1e-3) - beside
    borne = JointLoad(np.full(800, 0.1), np.full(800, 0.2))
    np.testing.assert_allclose(gap.along(command, 1e-3, borne), acting)
    np.testing.assert_array_equal(gap.along(command, 1e-3, None), gap.acting(command, 1e-3))


def test_a_gap_at_rest_does_not_knock_at_the_noise_of_a_rate() -> None:
    command = np.full(400, 0.1)
    brake = 0.5 * np.sign(np.random.default_rng(0).standard_normal(400))
    load = np.full(400, 0.05)
    gap = Backlash(JOINT, 2e-3, 0.01, 0.3)
    held, moving = (JointLoad.along(brake, load, command, np.full(400, x)) for x in (True, False))
    np.testing.assert_allclose(gap.along(command, 2e-3, held), command)
    assert np.abs(gap.along(command, 2e-3, moving) - command).max() > 0.5
    np.testing.assert_array_equal(moving.brake, brake)


@given(st.floats(5, 25), st.floats(0.02, 0.3), st.floats(0.1, 0.6), st.floats(0, 0.2))
def test_a_spring_passes_on_what_the_link_asks_for_while_the_rotor_sticks_too(
    frequency: float, damping: float, share: float, dry: float
) -> None:
    """``y = (I + J) a + friction + load``, whatever friction is taken to hold the rotor where it stands."""
    dt = 1e-4
    inertia = 0.01
    rng = np.random.default_rng(3)
    ring = JointFlexibility(JOINT, frequency, damping, share)
    t = dt * np.arange(15000)
    load = 0.1 + 0.05 * np.sin(4.4 * t)
    push = load + 0.25 * np.sin(12.0 * t) + 0.05 * np.sin(31.4 * t)
    rotor = share * inertia
    link = (1 - share) * inertia
    w = 2 * np.pi * frequency
    k = w * w * rotor * link / inertia
    c = 2 * damping * w * rotor * link / inertia
    bend = 0.3 / k
    bending = 0.0
    rate = 0.0
    rows = []
    for u, asked in zip(push.tolist(), load.tolist()):
        spring = k * bend + c * bending
        free = rate + (u - spring) / rotor * dt
        brake = max(-dry, min(dry, free * rotor / dt))
        a = (u - spring - brake) / rotor
        rate += a * dt
        rows.append((brake, a, abs(rate) < 1e-12))
        bending += (a - (spring - asked) / link) * dt
        bend += bending * dt
    friction, acceleration, still = np.array(rows).T
    moves = still == 0
    told = np.where(moves, friction, rng.normal(size=len(t)))
    borne = JointLoad(told, load, inertia * acceleration, ~moves)
    wrong = ring.along(push, dt, borne) - (inertia * acceleration + friction + load)
    assert np.sqrt(np.mean(wrong[moves] ** 2)) < 0.02 * np.sqrt(np.mean(push**2))


@given(st.floats(5.0, 60.0), st.floats(0.05, 0.5), st.floats(0.8, 1.4))
def test_a_resonance_is_moved_along_its_zero(frequency: float, share: float, factor: float) -> None:
    other = JointFlexibility(JOINT, frequency, 0.05, share).moved("frequency", factor * frequency)
    assert isinstance(other, JointFlexibility)
    assert sqrt(other.rotor_share) * other.frequency == pytest.approx(sqrt(share) * frequency)
    assert other.damping / other.frequency == pytest.approx(0.05 / frequency)


# told by a log


def looped(drive: Signal, reference: Motion, bandwidth: float = 6.0) -> State:
    """The refitted model without any cause, on a log of a closed loop with this drive."""
    dt = float(reference.t[1] - reference.t[0])
    law = tune(nominal(RIG), bandwidth_hz=bandwidth, dt=dt).controller
    log = simulate(nominal(RIG), law, reference, rng=np.random.default_rng(2), drive=(drive,))
    noise = 2e-3 * np.random.default_rng(4).normal(size=log.q.shape)
    return refit(replace(log, tau=np.asarray(log.tau) + noise), filtering=DIAGNOSIS_BAND)


@pytest.mark.parametrize(
    "drive",
    [
        DeadZone("pan", 0.06),
        DeadZone("pan", 0.12, 4.0),
        Saturation("tilt", 0.8, 0, 2.0),
        Saturation("pan", 0.3, -1),
    ],
    ids=str,
)
def test_a_drive_without_memory_is_told_with_its_shape(drive: Signal) -> None:
    state = looped(drive, fourier(RIG, 2, 8.0, 2e-3))
    best = find_best(state, type(drive), drive.joint)
    assert form(best) == form(drive)
    for name in shape_names(best):
        tolerance = 0.2 if name == "sharpness" else 0.1
        assert getattr(best, name) == pytest.approx(getattr(drive, name), rel=tolerance)


def test_a_threshold_explains_more_than_an_edge_though_the_command_crosses_it_all_the_time() -> (
    None
):
    """No edge of a smoothed torque, however sharp, explains as much."""
    drive = DeadZone("pan", 0.12, whole=True)
    state = looped(drive, fourier(RIG, 2, 8.0, 2e-3))
    edge = max(
        (refined(state, DeadZone("pan", x, 12.0)) for x in (0.1, 0.13)), key=partial(worth, state)
    )
    left = float(np.sum(state.fit.residual[state.fit.rows(0)] ** 2))
    assert left - worth(state, drive) < (left - worth(state, edge)) / 2


def test_a_gap_in_which_the_loop_chatters_is_told_by_every_sample() -> None:
    """What the rotor crosses under a torque goes by the product of gap and inertia alone."""
    true = Backlash("pan", 0.012, 0.01)
    state = looped(true, fourier(RIG, 3, 8.0, 1e-3), 8.0)
    near = find_best(state, Backlash, "pan").akin(state.problem.evidence.seen[0])
    found = refined(state, max(near, key=partial(worth, state)))
    assert isinstance(found, Backlash) and not found.rotor_share
    assert found.gap * found.inertia == pytest.approx(true.gap * true.inertia, rel=0.02)


def test_a_spring_is_found_by_its_zero() -> None:
    """With dry friction on the rotor, which turns round and sticks."""
    true = JointFlexibility(JOINT, 13.0, 0.08, 0.2)
    slow = fourier(RIG, 0, 6.0, 2e-3)
    w = 2 * np.pi * np.linspace(1.0, 11.0, 21)
    phase = np.outer(slow.t, w) + np.random.default_rng(5).uniform(0, 2 * np.pi, 21)
    q, v, a = (np.array(x) for x in (slow.q, slow.v, slow.a))
    q[:, 1] += np.sin(phase) @ (0.3 / w**1.5)
    v[:, 1] += np.cos(phase) @ (0.3 / w**0.5)
    a[:, 1] -= np.sin(phase) @ (0.3 * w**0.5)
    state = looped(true, Motion(slow.t, q, v, a), 2.0)
    seen = state.problem.evidence.seen[1]
    found = refined(state, max(JointFlexibility.tried(JOINT, seen), key=partial(worth, state)))
    assert isinstance(found, JointFlexibility)
    stiff, told = (x.frequency / sqrt(1 / x.rotor_share - 1) for x in (true, found))
    assert told == pytest.approx(stiff, rel=0.1)
