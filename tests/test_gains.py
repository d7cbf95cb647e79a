"""One motor at a gain is all others at its reciprocal: the fewest are told, and of as many the given bodies' own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.diagnosis.gains import attributed, unexplained
from gimbal_pin.diagnosis.plainer import plainer
from gimbal_pin.diagnosis.shapes import TOLD
from gimbal_pin.diagnosis.state import State, consistent, solved
from gimbal_pin.effects import Cogging, TorqueGain
from gimbal_pin.effects.base import Term
from gimbal_pin.rig import Rig
from tests.refitted import first

RIG = Rig.load("thesis")
PAN, TILT, ROLL = map(TorqueGain, RIG.joints)


def log_of(*terms: Term) -> State:
    """The refitted model of a log of these terms, without any cause."""
    return first(*terms, given=RIG)


def told(state: State, causes: Sequence[TorqueGain]) -> State:
    """The state with these causes, as a search leaves it."""
    return consistent(consistent(solved(state.problem, causes, state)))


@pytest.mark.parametrize("missing", [0.25, -0.2])
@pytest.mark.parametrize("found", [(PAN, ROLL), (PAN, TILT), (TILT,)], ids=["reciprocals", "one more", "right"])
def test_one_motor_is_told_for_all_others(missing: float, found: tuple[TorqueGain, ...]) -> None:
    """Whatever a search ended with, the motor of which it is."""
    state = attributed(told(log_of(Term(TILT, (missing,))), found))
    assert state.causes == (TILT,)
    assert state.coefficients(state.causes[0])[0] == pytest.approx(missing, abs=0.02)


def test_two_motors_stay_two() -> None:
    """Two gains that differ are no reciprocal of one."""
    state = attributed(told(log_of(Term(PAN, (0.2,)), Term(TILT, (-0.3,))), (PAN, TILT)))
    assert set(state.causes) == {PAN, TILT}


def test_reciprocals_leave_as_much() -> None:
    """``g`` at one joint and ``1/g`` at all others are the same log, in units of the reported torque."""
    start = log_of(Term(TILT, (0.25,)))
    one, two = (told(start, gains) for gains in ((TILT,), (PAN, ROLL)))
    assert unexplained(one) == pytest.approx(unexplained(two), abs=TOLD)
    assert unexplained(told(start, (PAN,))) > unexplained(one) + TOLD


def test_of_two_directions_the_one_that_leaves_the_bodies_as_given() -> None:
    """A motor that is weak in one direction is not one that is strong in the other and turns lighter bodies."""
    weak = replace(TILT, side=1)
    state = attributed(told(log_of(Term(weak, (0.25,))), (replace(TILT, side=-1),)))
    assert state.causes == (weak,)


def test_a_gain_of_torques_of_one_sign_is_one_of_both_directions() -> None:
    """Of a joint whose torque never changes its sign: the plain form, and then the motor to which it belongs."""
    rig = Rig.load("handheld")
    pan, roll, tilt = map(TorqueGain, rig.joints)
    start = first(Term(tilt, (0.2,)), given=rig)
    assert all(np.all(x[:, 1] > 0) for x in start.torque)
    found = plainer(told(start, (pan, replace(roll, side=1))))
    assert set(found.causes) == {pan, roll}
    assert attributed(found).causes == (tilt,)


def test_without_a_gain_nothing_changes() -> None:
    """The state itself."""
    state = told(log_of(), (Cogging(TILT.joint, (7.0,)),))
    assert attributed(state) is state
