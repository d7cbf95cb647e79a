"""Laws of what is easily lost: short strokes, short delays, warm friction, gaps at rest."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin.diagnosis import Problem, State, solve_causes
from gimbal_pin.dynamics import Model, nominal, reduce_parameters
from gimbal_pin.effects import (
    ActuatorLag,
    Backlash,
    Cause,
    Coulomb,
    Delay,
    FrictionDrift,
    JointLoad,
    OperatingRange,
    Presliding,
    Resistance,
    Sample,
    Term,
)
from gimbal_pin.rig import Rig
from tests.candidates import measure, refined
from tests.diagnosis.test_forms import ALIGNED, gather, prescribed

RIG = Rig.load("turret")
SEEN = OperatingRange(60.0, 0.005, 12.0, 2.0, 1.0, 1e-3, 1.0, 1.2)


def first(*terms: Term, seed: int = 3) -> State:
    """The refitted model without any cause, on a log of these terms."""
    log = prescribed(
        Model(RIG, (*nominal(RIG).terms, *terms)), seed, seconds=14.0, torque_noise=1e-4, dt=2e-3
    )
    problem = Problem.of(gather(RIG, [log], ALIGNED), reduce_parameters(RIG))
    return solve_causes(problem, (), solve_causes(problem, ()))


@pytest.mark.parametrize(("joint", "seed"), [(0, 3), (1, 5)])
def test_a_short_stroke_shows_though_bristles_slide_most_of_the_time(joint: int, seed: int) -> None:
    place = RIG.joints[joint]
    level = 0.5
    state = first(Term(Presliding(place, 6e-3), (level,)), seed=seed)
    found = refined(state, Presliding(place, 1.2e-2))
    assert isinstance(found, Presliding)
    score = measure(state, found)
    assert found.stroke == pytest.approx(6e-3, rel=0.1)
    assert score.beta[0] == pytest.approx(level, rel=0.3)
    assert score.visible > 0.01


@pytest.mark.parametrize("kind", [Delay, ActuatorLag])
def test_the_grid_of_times_reaches_a_tenth_of_a_sample(kind: type[Cause]) -> None:
    times = np.array(
        [next(x for x in (getattr(c, s.name) for s in c.shapes)) for c in kind.tried("tilt", SEEN)]
    )
    assert times[0] == pytest.approx(SEEN.dt / 10) and np.all(np.diff(np.log(times)) < np.log(2.2))


def test_a_joint_is_simulated_as_warm_as_its_motor() -> None:
    term = Term(FrictionDrift("tilt", thermal=True), (0.3, 0.1))
    joints = Resistance([[Term(Coulomb("tilt"), (1.0,)), term]])
    joints.warm = [45.0]
    at = Sample(0.0, 0.2, 0.7, 0.0, 1.0, 0.0, 45.0)
    net = [0.0]
    joints.take(net, 0.0, [0.2], [0.7], [1.0], [0.0], (), [0.0])
    assert -net[0] == pytest.approx(term.torque(at))
    assert joints.level(0.0, 0.2, 0.0, 0, 1.0) == pytest.approx(1.0 + 0.3 * 2.0)


def test_a_gap_at_rest_does_not_knock_at_the_noise_of_a_rate() -> None:
    rng = np.random.default_rng(0)
    count = 400
    command = np.full(count, 0.1)
    brake = 0.5 * np.sign(rng.standard_normal(count))
    load = np.full(count, 0.05)
    gap = Backlash("tilt", 2e-3, 0.01, 0.3)
    held = JointLoad.along(brake, load, command, np.full(count, True))
    np.testing.assert_allclose(gap.along(command, 2e-3, held), command)
    assert np.abs(gap.along(command, 2e-3, JointLoad(brake, load)) - command).max() > 0.5
    np.testing.assert_array_equal(
        JointLoad.along(brake, load, command, np.full(count, False)).brake, brake
    )
