"""Laws of two causes at one joint: what hides one beside the other, and the search that starts from both."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin.diagnosis.contenders import drives, strays
from gimbal_pin.diagnosis.fit import Fit, fit, improves
from gimbal_pin.diagnosis.library import Library, library
from gimbal_pin.diagnosis.restart import composed, coupled, stands
from gimbal_pin.diagnosis.search import forward, left, undone
from gimbal_pin.diagnosis.shapes import measure, worth
from gimbal_pin.diagnosis.state import State, solved
from gimbal_pin.effects import CAUSES
from gimbal_pin.effects.base import Term
from gimbal_pin.effects.base_tilt import BaseTilt
from gimbal_pin.effects.cogging import Cogging
from gimbal_pin.effects.coulomb import Coulomb
from gimbal_pin.effects.encoder_offset import EncoderOffset
from gimbal_pin.effects.friction_drift import FrictionDrift
from gimbal_pin.effects.presliding import Presliding
from gimbal_pin.effects.quadratic_drag import QuadraticDrag
from gimbal_pin.effects.stribeck import Stribeck
from gimbal_pin.log import Array
from tests.refitted import RIG, first
from tests.test_gates import Winding

AT = RIG.joints[1]
FRICTION = (
    "stribeck",
    "presliding",
    "quadratic-drag",
    "asymmetric-friction",
    "friction-drift",
    "cable-spring",
    "cogging",
)


def shelf_of(state: State) -> Library:
    """Causes of friction and of the angle."""
    return Library(state.problem, library(state.problem, {name: CAUSES[name] for name in FRICTION}))


def names(state: State) -> set[str]:
    """What a state holds at the joint."""
    return {cause.name for cause in state.causes if cause.place == AT}


@pytest.mark.parametrize(
    "terms",
    [
        (Term(Stribeck(AT, 0.25), (0.1,)), Term(QuadraticDrag(AT, 1.75), (0.06,))),
        (Term(Stribeck(AT, 0.25), (0.03,)), Term(Presliding(AT, 0.05), (0.08,))),
        (Term(Stribeck(AT, 0.2, 1), (0.1,)), Term(Cogging(AT, (9.0,)), (0.02, 0.0))),
    ],
    ids=lambda terms: " and ".join(term.effect.name for term in terms),
)
def test_the_best_two_causes_are_those_planted(terms: tuple[Term, ...]) -> None:
    state = first(*terms)
    found = coupled(state, AT, shelf_of(state))
    assert found is not None and names(found) == {term.effect.name for term in terms}
    assert stands(found, AT) and left(found) < left(state)


def test_where_only_one_may_stand_there_is_no_couple() -> None:
    state = first()
    assert coupled(state, AT, Library(state.problem, [Stribeck(AT, 0.2)])) is None
    assert coupled(state, AT, Library(state.problem, [])) is None


def test_stribeck_beside_bristles_is_found_and_brakes() -> None:
    bristles, extra = Term(Presliding(AT, 0.05), (0.12,)), Term(Stribeck(AT, 0.25), (0.04,))
    state = first(bristles, extra, Term(Coulomb(AT), (-0.08,)))
    beside = solved(state.problem, (bristles.effect,), state)
    found = measure(beside, extra.effect)
    friction = beside.fit.theta[len(state.problem.reduction.independent) :][2]
    assert friction < 0 < found.beta[0], "Coulomb friction alone would push"
    assert not drives(beside, found, extra.effect)
    assert names(composed(state, shelf_of(state))) == {"presliding", "stribeck"}


def test_dry_friction_that_pushes_is_still_none() -> None:
    state = first(Term(Coulomb(AT), (-0.08,)), Term(Stribeck(AT, 0.25), (0.02,)))
    cause = Stribeck(AT, 0.25)
    assert drives(state, measure(state, cause), cause)


@pytest.mark.parametrize("cause", [EncoderOffset(AT, 1e-3), BaseTilt(1e-3, 0.0), BaseTilt(0.0, 1e-3)])
def test_a_rig_is_changed_within_its_bounds(cause: EncoderOffset | BaseTilt) -> None:
    columns = first().columns(cause)
    shape = cause.shapes[0]
    assert columns.lower.tolist() == [shape.lower] and columns.upper.tolist() == [shape.upper]


def straight(columns: Array, target: Array) -> Fit:
    """A fit of some columns, (rows, c), to a target, (rows,), in forty blocks."""
    rows = len(target)
    return fit(columns[:, None], target[:, None], np.ones(1), np.floor(np.arange(rows) * 40.0 / rows))


class Lone:
    """One candidate's columns."""

    def __init__(self, own: Array) -> None:
        """Put them at the first joint."""
        self.joint, self.own, self.bulk = 0, own, 1.0


@pytest.mark.parametrize("lasting", [True, False])
@pytest.mark.parametrize("sizes", [(1.0, 0.2, 0.2, 0.2), (1.0, 1.0, 0.3, 0.3), (1.0, 1.0, 1.0, 0.3)])
def test_what_changes_with_time_tells_whole_stretches_of_it(sizes: tuple[float, ...], lasting: bool) -> None:
    rng, t = np.random.default_rng(0), np.linspace(0.0, 1.0, 1600)
    rate = np.repeat(sizes, 400) * np.sin(300 * t)
    torque = t * rate if lasting else np.exp(-((rate / 0.3) ** 2)) * np.sign(rate)
    friction = np.stack([rate, np.sign(rate)], axis=1)
    now = straight(friction, rate + 0.3 * torque + 0.02 * rng.standard_normal(len(t)))
    drift = Lone(t[:, None] * friction)
    assert improves(now, drift, False), "by interleaved parts of time friction at another speed is a drift"
    assert improves(now, drift, False, whole=True) == lasting


def test_friction_that_warms_up_strays_not() -> None:
    drift = FrictionDrift(AT, 5.0)
    state = first(Term(drift, (0.05, 0.02)))
    assert not strays(state, measure(state, drift), drift)
    assert not strays(state, measure(state, Stribeck(AT, 0.2)), Stribeck(AT, 0.2))


def test_harmonics_that_together_gain_nothing_are_undone() -> None:
    state = first(Term(Winding(AT), (0.1,)))
    two, three = Cogging(AT, (2.0, 3.0)), Cogging(AT, (2.0, 3.0, 4.0))
    assert worth(state, three) <= 0 < worth(state, two)
    for cause, is_undone in ((two, False), (three, True)):
        assert undone(solved(state.problem, (cause,), state), Cogging(AT, (3.0,))) == is_undone


def test_a_step_that_is_none_ends_the_search_at_its_joint_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    weak, strong = Stribeck(RIG.joints[0], 0.2), Stribeck(AT, 0.2)
    state = first(Term(weak, (0.01,)), Term(strong, (0.1,)))
    shelf = Library(state.problem, [weak, strong])
    assert {cause.place for cause in forward(state, shelf).causes} == {weak.joint, AT}
    monkeypatch.setattr("gimbal_pin.diagnosis.search.undone", lambda _, new: new.place == AT)
    assert {cause.place for cause in forward(state, shelf).causes} == {weak.joint}
