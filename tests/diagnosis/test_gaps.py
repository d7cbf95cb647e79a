"""A gap in which the loop chatters is found."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gimbal_pin.control import tune
from gimbal_pin.diagnosis import DIAGNOSIS_BAND, Problem, State, gather, solve_causes
from gimbal_pin.dynamics import nominal, reduce_parameters, simulate
from gimbal_pin.effects import Backlash
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.candidates import refined, worth

RIG = Rig.load("turret")
JOINT = RIG.joints[-1]


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


def plain(log: Log) -> State:
    """The refitted model of a log, without any cause."""
    problem = Problem.of(gather(RIG, [log], DIAGNOSIS_BAND), reduce_parameters(RIG))
    return solve_causes(problem, (), solve_causes(problem, ()))
