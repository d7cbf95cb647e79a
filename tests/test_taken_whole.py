"""Laws of causes that lose by their first part alone, of what hides them, and of what their leftover speaks of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from gimbal_pin.diagnosis import verdict
from gimbal_pin.diagnosis.library import Library, library
from gimbal_pin.diagnosis.restart import alone, composed, leaning, second
from gimbal_pin.diagnosis.score import local
from gimbal_pin.diagnosis.search import WORSE, combed, entered, forward, left, regrown, swapped
from gimbal_pin.diagnosis.shapes import measure
from gimbal_pin.diagnosis.state import State, solved
from gimbal_pin.effects import CAUSES
from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.base_tilt import BaseTilt
from gimbal_pin.effects.cable_spring import CableSpring
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.dead_zone import DeadZone
from gimbal_pin.effects.load_dependent_friction import LoadDependentFriction
from gimbal_pin.effects.position_dependent_friction import PositionDependentFriction
from gimbal_pin.effects.stribeck import Stribeck
from gimbal_pin.effects.torque_ripple import TorqueRipple
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter
from tests.refitted import RIG, first
from tests.test_gates import Winding

AT = RIG.joints[1]


@dataclass(frozen=True)
class Peaked(Effect):
    """``exp(2 cos 6q) slide``: dry friction that peaks six times a turn."""

    name: ClassVar[str] = "peaked"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("size", 0.0, "N m", 0.0, np.inf),)

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The peaks."""
        return (np.exp(2 * np.cos(6 * np.asarray(at.q))) * at.slide,)

    def says(self, values: tuple[float, ...] = ()) -> str:  # type: ignore[override]
        """Nothing."""
        return ""


def shelf_of(state: State, *names: str) -> Library:
    """A library of some causes."""
    return Library(state.problem, library(state.problem, {name: CAUSES[name] for name in names}))


def with_all(state: State, *causes: Cause) -> State:
    """Causes fitted beside each other."""
    return solved(state.problem, causes, state)


def test_noise_is_as_loud_where_a_column_acts_as_anywhere_unless_it_is_louder_there() -> None:
    rng = np.random.default_rng(1)
    noise, here = rng.standard_normal((20000, 2)), np.zeros((20000, 2, 1))
    here[:2000] = 1.0
    np.testing.assert_allclose(local(here, noise), 1.0, atol=0.15)
    np.testing.assert_allclose(local(here, 7.0 * noise), local(here, noise))
    louder = noise * (1.0 + 2.0 * here[:, :, 0])
    np.testing.assert_allclose(local(here, louder), 9.0 / (0.9 + 0.1 * 9.0), rtol=0.1)
    assert np.all(local(here, noise * (1.0 - here[:, :, 0])) == 1.0)  # no quieter than on the whole
    np.testing.assert_allclose(local(here, noise * here[:, :, 0]), 10.0)


def test_what_peaks_over_the_angle_is_tried_with_its_overtone() -> None:
    state = first(Term(Peaked(AT), (0.02,)))
    one = PositionDependentFriction(AT, (6.0,))
    rows = [(measure(state, one), one)]
    ((two, after),) = combed(state, rows, DeadZone(AT, 0.01))
    assert two == PositionDependentFriction(AT, (6.0, 12.0)) and after.causes == (two,)
    assert left(after) < left(with_all(state, one))
    assert not combed(state, rows, one)
    assert not combed(state, rows, DeadZone(RIG.joints[0], 0.01))


@pytest.mark.parametrize(("roll", "pitch"), [(0.01, 0.006), (-0.004, 0.009)])
def test_a_base_that_leans_about_both_axes_is_found_at_once(roll: float, pitch: float) -> None:
    state = first(rig=BaseTilt(roll=roll, pitch=pitch).apply(RIG))
    found = leaning(state, shelf_of(state, "base-tilt", "cogging"))
    assert found is not None and {cause.name for cause in found.causes} == {"base-tilt"}
    angles = {cause.roll != 0: found.coefficients(cause)[0] for cause in found.causes if isinstance(cause, BaseTilt)}
    assert angles[True] == pytest.approx(roll, abs=1e-3) and angles[False] == pytest.approx(pitch, abs=1e-3)
    assert left(found) < min(left(with_all(state, cause)) for cause in found.causes)


def test_a_base_that_is_not_looked_for_does_not_lean() -> None:
    state = first()
    assert leaning(state, shelf_of(state, "cogging")) is None


def test_one_cause_in_another_form_stands_for_several() -> None:
    state = first(Term(LoadDependentFriction(AT, True, 0.5, 0.1), (0.3,)))
    shelf = shelf_of(state, "load-dependent-friction", "cable-spring", "stribeck")
    several = with_all(state, PositionDependentFriction(AT, (1.0, 2.0)), TorqueRipple(AT, (1.0,)), CableSpring(AT))
    one = alone(several, AT, shelf)
    assert one is not None and left(one) <= left(several) + WORSE
    (cause,) = one.causes
    assert isinstance(cause, LoadDependentFriction) and cause.weighs
    assert alone(with_all(state, *several.causes[:2]), AT, shelf) is None


def test_what_gains_most_may_leave_more_than_another_and_then_the_search_begins_with_that() -> None:
    """Ripple reads the torque that it is a part of, and gains less at first than a limit that leaves more."""
    state = first(Term(TorqueRipple(AT, (9.0, 18.0)), (0.4, 0.0, 0.25, 0.0)))
    shelf = shelf_of(state, "saturation", "torque-ripple")
    ended = forward(state, shelf)
    other = second(ended, AT, shelf)
    assert other is not None and left(other) < left(entered(state, ended.causes[0]))
    assert [cause.name for cause in (*ended.causes, *other.causes)] == ["saturation", "torque-ripple"]
    best = composed(state, shelf)
    assert {cause.name for cause in best.causes} == {"torque-ripple"} and np.all(best.fit.dispersion < 1.2)


def test_where_one_cause_may_stand_there_is_no_second() -> None:
    state = first(Term(Stribeck(AT, 0.25), (0.1,)))
    assert second(state, AT, shelf_of(state, "stribeck")) is None
    assert second(state, AT, Library(state.problem, [])) is None


def test_no_one_cause_stands_for_three_that_are_there() -> None:
    three = (Stribeck(AT, 0.25), PositionDependentFriction(AT, (2.0,)), CableSpring(AT))
    state = first(Term(three[0], (0.1,)), Term(three[1], (0.03, 0.02)), Term(three[2], (0.2, 0.0)))
    shelf = shelf_of(state, "load-dependent-friction", "cable-spring", "stribeck")
    assert alone(with_all(state, *three), AT, shelf) is None


def test_of_several_that_were_pruned_at_a_joint_what_is_clear_by_itself_comes_back() -> None:
    state, two = first(Term(Stribeck(AT, 0.25), (0.1,))), (Stribeck(AT, 0.2), TorqueRipple(AT, (1.0,)))
    shelf, before = shelf_of(state, "stribeck", "cogging", "quadratic-drag"), with_all(state, *two)
    (back,) = regrown(before, state, shelf, 1e-4, verdict.material).causes
    assert isinstance(back, Stribeck) and back.place == AT
    assert regrown(before, state, shelf, 0.0, verdict.material) is state
    for others in (two[:1], (two[0], TorqueRipple(RIG.joints[0], (1.0,)))):
        assert regrown(with_all(state, *others), state, shelf, 1e-4, verdict.material) is state


def test_nothing_comes_back_where_there_is_nothing() -> None:
    none = first()
    before = with_all(none, Stribeck(AT, 0.2), TorqueRipple(AT, (1.0,)))
    assert regrown(before, none, shelf_of(none, "stribeck", "cogging"), 1e-5, verdict.material) is none


def test_a_swap_leaves_no_more() -> None:
    state = first(Term(LoadDependentFriction(AT), (0.2,)), Term(Stribeck(AT, 0.25), (0.1,)))
    shelf = shelf_of(state, "stribeck", "load-dependent-friction", "torque-ripple", "position-dependent-friction")
    before = forward(state, shelf)
    assert left(swapped(before, shelf)) <= left(before) + WORSE


def test_what_another_cause_left_at_its_joint_says_nothing_of_the_base() -> None:
    state = first(Term(Winding(AT), (0.05,)), rig=BaseTilt(pitch=0.02).apply(RIG))
    tilt = BaseTilt(pitch=1e-3)
    found = with_all(state, tilt)
    size = verdict.loudness(state, measure(state, tilt))
    assert verdict.shaken(found, tilt) == [0] and size[1] ** 2 < found.fit.dispersion[1]
    assert verdict.shaken(found, Winding(AT)) == [1]
    assert not verdict.doubtful(state, found, found.causes[0])
