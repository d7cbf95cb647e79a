"""Laws of drives that pass nothing up to a threshold and all beyond it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from gimbal_pin.control import ComputedTorque, Pid
from gimbal_pin.diagnosis import Problem, State, gather, solve_causes
from gimbal_pin.dynamics import Sensors, nominal, reduce_parameters, simulate
from gimbal_pin.effects import DeadZone
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.candidates import refined, worth
from tests.diagnosis.test_forms import DIAGNOSIS_BAND

RIG = Rig.load("turret")
DT = 2e-3


@cache
def looped(*drive: DeadZone) -> State:
    """The refitted model without any cause, on a log of a closed loop whose drive that is."""
    model = nominal(RIG)
    law = ComputedTorque(model, (Pid.placed(6.0, 1.0, 0.2),) * RIG.n, DT, lead=1.5 * DT)
    sense = Sensors(np.full(RIG.n, 2 * np.pi / 2**18), np.full(RIG.n, 2e-3), np.zeros(RIG.n))
    log = simulate(
        model,
        law,
        fourier(RIG, 2, 14.0, DT),
        rng=np.random.default_rng(2),
        sensors=sense,
        drive=drive,
    )
    problem = Problem.of(gather(RIG, [log], DIAGNOSIS_BAND), reduce_parameters(RIG))
    return solve_causes(problem, (), solve_causes(problem, ()))


def test_what_comes_to_the_samples_as_the_torque_did_is_the_torque() -> None:
    for part in looped().problem.evidence.parts:
        assert part.logged is not None
        for j, tau in enumerate(part.channels.tau.T):
            np.testing.assert_allclose(part.logged.smoothed(part.logged.tau[:, j]), tau, atol=1e-12)
            np.testing.assert_allclose(
                part.acted(DeadZone(RIG.joints[j], 1e-12, whole=True), tau, j, None), tau
            )


def test_a_threshold_explains_more_than_an_edge_though_the_command_crosses_it_all_the_time() -> (
    None
):
    """No edge of a smoothed torque, however sharp, explains as much."""
    joint, width = 0, 0.12
    place = RIG.joints[joint]
    state = looped(DeadZone(place, width, whole=True))
    edge = max(
        (refined(state, DeadZone(place, x * width, 12.0)) for x in (0.83, 1.07)),
        key=lambda c: worth(state, c),
    )
    best = DeadZone(place, width, whole=True)
    assert worth(state, best) > worth(state, edge)
    after, mended = (
        solve_causes(state.problem, (cause,), state).fit.dispersion[joint] for cause in (best, edge)
    )
    assert after < mended / 2


def test_a_threshold_passes_nothing_or_all() -> None:
    zone = DeadZone("pan", 0.1, whole=True)
    x = np.linspace(-1.0, 1.0, 401)
    np.testing.assert_array_equal(zone.passed(x), np.where(np.abs(x) > 0.1, x, 0.0))
    assert [zone.passed(float(one)) for one in x] == zone.passed(x).tolist()
    assert zone.passed(zone.command(0.5)) == pytest.approx(0.5) and zone.command(0.0) == 0.0
