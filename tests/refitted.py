"""The refitted model of a log of some terms: where the search begins."""

from __future__ import annotations

import numpy as np

from gimbal_pin.diagnosis import Problem, State, solve_causes
from gimbal_pin.dynamics import Model, nominal, reduce_parameters
from gimbal_pin.effects import Term
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.diagnosis.test_forms import ALIGNED, gather

RIG = Rig.load("turret")


def first(*terms: Term, rig: Rig | None = None, given: Rig = RIG) -> State:
    """The refitted model without any cause, on a log of these terms on a rig, which may be another than the given."""
    motion = fourier(given, 3, 14.0, 2e-3)
    tau = Model(rig or given, (*nominal(given).terms, *terms)).inverse(
        motion.q, motion.v, motion.a, t=motion.t
    )
    tau += 1e-3 * np.random.default_rng(4).standard_normal(tau.shape)
    log = Log("whole", given.joints, motion.t, motion.q, motion.v, tau)
    problem = Problem.of(gather(given, [log], ALIGNED), reduce_parameters(given))
    return solve_causes(problem, (), solve_causes(problem, ()))
