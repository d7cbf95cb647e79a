"""Laws of what used to lose true causes: short strokes, short delays, warm friction, gaps at rest, bent springs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from gimbal_pin.diagnosis import verdict
from gimbal_pin.diagnosis.contenders import outbends, swells
from gimbal_pin.diagnosis.score import NOTHING
from gimbal_pin.diagnosis.search import polished, pruned, reshaped
from gimbal_pin.diagnosis.shapes import measure, refined, worth
from gimbal_pin.diagnosis.state import Problem, State, solved, without
from gimbal_pin.effects.actuator_lag import ActuatorLag
from gimbal_pin.effects.backlash import Backlash
from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.cable_spring import CableSpring
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.cogging import Cogging
from gimbal_pin.effects.coulomb import Coulomb
from gimbal_pin.effects.delay import Delay
from gimbal_pin.effects.friction_drift import FrictionDrift
from gimbal_pin.effects.presliding import Presliding
from gimbal_pin.effects.resistance import Resistance
from gimbal_pin.effects.seen import Seen
from gimbal_pin.effects.signal import Borne
from gimbal_pin.effects.torque_ripple import TorqueRipple
from gimbal_pin.log import Array
from gimbal_pin.model import Model, nominal
from gimbal_pin.parameter import Parameter
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig
from tests.test_forms import ALIGNED, gather, prescribed

RIG = Rig.load("turret")
SEEN = Seen(60.0, 0.005, 12.0, 2.0, 1.0, 1e-3, 1.0, 1.2)


@dataclass(frozen=True)
class Winding(Effect):
    """``exp(1.5 q)``: a cable that winds up, which no polynomial of the library is."""

    name: ClassVar[str] = "winding"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("size", 0.0, "N m", 0.0, np.inf),)

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The curve."""
        return (np.exp(1.5 * np.asarray(at.q)),)

    @classmethod
    def tried(cls, joint: str, seen: Seen) -> tuple[Cause, ...]:
        """Itself."""
        return (cls(joint),)

    def says(self, values: tuple[float, ...] = ()) -> str:  # type: ignore[override]
        """Nothing."""
        return ""


def first(*terms: Term, seed: int = 3) -> State:
    """The refitted model without any cause, on a log of these terms."""
    log = prescribed(Model(RIG, (*nominal(RIG).terms, *terms)), seed, seconds=14.0, torque_noise=1e-4, dt=2e-3)
    problem = Problem.of(gather(RIG, [log], ALIGNED, {log.name: 0.0}), reduce(RIG))
    return solved(problem, (), solved(problem, ()))


@pytest.mark.parametrize(("joint", "seed"), [(0, 3), (1, 5)])
def test_a_short_stroke_shows_though_bristles_slide_most_of_the_time(joint: int, seed: int) -> None:
    place, level = RIG.joints[joint], 0.5
    state = first(Term(Presliding(place, 6e-3), (level,)), seed=seed)
    found = refined(state, Presliding(place, 1.2e-2))
    assert isinstance(found, Presliding)
    score = measure(state, found)
    assert found.stroke == pytest.approx(6e-3, rel=0.1)
    assert score.beta[0] == pytest.approx(level, rel=0.3)
    assert score.visible > 0.01 and not outbends(state, score, found)
    short = Presliding(place, 2e-3)
    assert outbends(state, measure(state, short), short) or not len(measure(state, short).beta)


@pytest.mark.parametrize("kind", [Delay, ActuatorLag])
def test_the_grid_of_times_reaches_a_tenth_of_a_sample(kind: type[Cause]) -> None:
    times = np.array([next(x for x in (getattr(c, s.name) for s in c.shapes)) for c in kind.tried("tilt", SEEN)])
    assert times[0] == pytest.approx(SEEN.dt / 10) and np.all(np.diff(np.log(times)) < np.log(2.2))


def test_a_joint_is_simulated_as_warm_as_its_motor() -> None:
    term = Term(FrictionDrift("tilt", thermal=True), (0.3, 0.1))
    joints = Resistance([[Term(Coulomb("tilt"), (1.0,)), term]])
    joints.warm = [45.0]
    at = Sample(0.0, 0.2, 0.7, 0.0, 1.0, 0.0, 45.0)
    assert -joints.net([0.0], 0.0, [0.2], [0.7], [1.0], [0.0], (), [0.0])[0] == pytest.approx(term.torque(at))
    assert joints.level(0.0, 0.2, 0.0, 0, 1.0) == pytest.approx(1.0 + 0.3 * 2.0)


def test_a_gap_at_rest_does_not_knock_at_the_noise_of_a_rate() -> None:
    rng, count = np.random.default_rng(0), 400
    command = np.full(count, 0.1)
    brake, load = 0.5 * np.sign(rng.standard_normal(count)), np.full(count, 0.05)
    gap = Backlash("tilt", 2e-3, 0.01, 0.3)
    held = Borne.along(brake, load, command, np.full(count, True))
    np.testing.assert_allclose(gap.along(command, 2e-3, held), command)
    assert np.abs(gap.along(command, 2e-3, Borne(brake, load)) - command).max() > 0.5
    np.testing.assert_array_equal(Borne.along(brake, load, command, np.full(count, False)).brake, brake)


def test_a_spring_outlasts_the_harmonics_that_mend_its_form() -> None:
    place = RIG.joints[0]
    state = first(Term(Winding(place), (0.3,)))
    spring, teeth = CableSpring(place, stiffening=True), Cogging(place, (2.0, 3.0, 4.0))
    both = polished(solved(state.problem, (spring, teeth), state))
    alone = measure(solved(state.problem, (teeth,), both, keep=True), spring)
    assert alone.gain == 0.0, "beside the harmonics no spring stands"
    kept, _ = pruned(both, 1e-5, verdict.material)
    assert spring in kept.causes


def test_a_shape_that_stood_on_what_is_left_out_is_refined_again() -> None:
    """Bristles of too short a stroke ask for damping that would push: they are none as they are, and not so far off."""
    place = RIG.joints[0]
    state = first(Term(Presliding(place, 2e-2, damped=True), (0.5, 0.1)))
    short = solved(state.problem, (Presliding(place, 1.6e-2, damped=True),), state)
    assert worth(without(short, short.causes[0]), short.causes[0]) == 0.0
    found = reshaped(short)
    (bristles,) = found.causes
    assert isinstance(bristles, Presliding) and bristles.stroke == pytest.approx(2e-2, rel=0.05)
    assert worth(without(found, bristles), bristles) > 0 and reshaped(found) is found


@pytest.mark.parametrize(("depth", "swollen"), [(0.05, False), (0.6, False), (0.75, True), (1.5, True)])
def test_no_motor_gives_five_times_as_much_at_one_angle_as_at_another(depth: float, swollen: bool) -> None:
    """``(1 + s)/(1 - s)``, whatever the phase, and of a gain that inverts the torque none."""
    state, place = first(), RIG.joints[0]
    for phase in np.linspace(0.0, 2 * np.pi, 5):
        found = NOTHING._replace(beta=depth * np.array([np.cos(phase), np.sin(phase)]))
        assert swells(state, found, TorqueRipple(place, (18.0,))) == swollen
        assert not swells(state, found, Cogging(place, (18.0,)))
