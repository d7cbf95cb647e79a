"""Laws of gaps, with flanks that give and without: what they are, what they pass on, and that a log tells them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.control import tune
from gimbal_pin.diagnosis import DIAGNOSIS_BAND, Problem, State, gather, solve_causes
from gimbal_pin.dynamics import nominal, reduce_parameters, simulate
from gimbal_pin.effects import Backlash, JointFlexibility, parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.candidates import refined, worth

RIG = Rig.load("turret")
JOINT = RIG.joints[-1]


@given(st.floats(5.0, 40.0), st.floats(0.05, 0.15), st.floats(0.1, 0.6), st.integers(0, 99))
def test_flanks_without_a_gap_are_a_spring(
    flank: float, damping: float, share: float, seed: int
) -> None:
    """The link rings on a held motor at F's zero."""
    dt = 1e-4
    x = np.cumsum(np.random.default_rng(seed).normal(size=2000)) / 50
    loose = Backlash(JOINT, 1e-9, 1e-3, share, flank, damping)
    ring = JointFlexibility(JOINT, flank / sqrt(share), damping / sqrt(share), share)
    np.testing.assert_allclose(
        loose.acting(x, dt), ring.acting(x, dt), atol=0.01 * np.max(np.abs(x))
    )


@given(st.floats(0.1, 0.5), st.floats(10.0, 40.0), st.floats(-0.3, 0.3), st.integers(0, 99))
@settings(max_examples=8)
def test_flanks_pass_on_what_the_rigid_joint_would_ask_for(
    share: float, flank: float, load: float, seed: int
) -> None:
    """``∫(y - load) dt = (I + J) v`` of two masses that push on each other through a gap with flanks that give."""
    dt = 1e-4
    rotor = 0.004
    rng = np.random.default_rng(seed)
    link = rotor * (1 / share - 1)
    gap = 0.01
    one = Backlash(JOINT, gap, rotor, share, flank, 0.5)
    k = link * (2 * np.pi * flank) ** 2
    command = load + 0.5 * np.sin(2 * np.pi * rng.uniform(2, 4) * dt * np.arange(8000) + 0.3)
    place = one.start(command[0] + share / (1 - share) * load)[0]
    v = 0.0
    u = 0.0
    rates = []
    for push in command.tolist():
        deep = place - np.clip(place, -gap / 2, gap / 2)
        held = (k * deep + 2 * 0.5 * sqrt(k * link) * (v - u)) if deep else 0.0
        v = v + (push - held) / rotor * dt
        u = u + (held - load) / link * dt
        place += (v - u) * dt
        rates.append(v)
    beside = share / (1 - share) * load
    acting = one.acting(command + beside, dt) - beside
    impulse = np.cumsum(acting - load) * dt
    assert np.mean(np.abs(impulse - (rotor + link) * np.array(rates))) < 0.03 * np.max(
        np.abs(impulse)
    )


def test_a_gap_in_which_the_loop_chatters_is_told_by_every_sample() -> None:
    """At 27 Hz and more, far beyond the band: each flight lasts but a few samples, and its jumps are no noise."""
    true = Backlash(RIG.joints[0], 0.012, 0.01)
    controller = tune(nominal(RIG), bandwidth_hz=8.0).controller
    reference = fourier(RIG, 3, 8.0, controller.dt)
    log = simulate(nominal(RIG), controller, reference, rng=np.random.default_rng(3), drive=(true,))
    first = plain(
        replace(log, tau=log.tau + 0.01 * np.random.default_rng(4).normal(size=log.tau.shape))
    )
    assert np.max(first.fit.dispersion) > 10
    tried = Backlash.tried(true.joint, first.problem.evidence.seen[0])
    found = refined(first, max(tried, key=partial(worth, first)))
    assert isinstance(found, Backlash) and not found.rotor_share
    # What the rotor crosses under a torque goes by their product alone.
    assert found.gap * found.inertia == pytest.approx(true.gap * true.inertia, rel=0.02)


def test_flanks_that_nothing_comes_of_are_refused() -> None:
    with pytest.raises(UsageError, match="rotor_share"):
        parse_effect(f"backlash:{JOINT}:gap=0.02,inertia=0.01,flank=8", RIG)
    made = parse_effect(f"backlash:{JOINT}:gap=0.02,inertia=0.01,flank=8,rotor_share=0.3", RIG)
    assert isinstance(made, Backlash) and made.springy


def plain(log: Log) -> State:
    """The refitted model of a log, without any cause."""
    problem = Problem.of(gather(RIG, [log], DIAGNOSIS_BAND), reduce_parameters(RIG))
    return solve_causes(problem, (), solve_causes(problem, ()))
