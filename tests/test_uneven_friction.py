"""Laws of friction that differs by direction, from rest on or setting in with the rate."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.plainer import plainer
from gimbal_pin.diagnosis.search import replaced
from gimbal_pin.diagnosis.shapes import refined
from gimbal_pin.diagnosis.state import State, consistent, solved, without
from gimbal_pin.effects.asymmetric_friction import AsymmetricFriction
from gimbal_pin.effects.base import Sample, Term
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.effects.plain import term_from
from gimbal_pin.errors import UsageError
from gimbal_pin.model import nominal
from gimbal_pin.planting import plant_with
from tests.refitted import RIG, first
from tests.test_forms import SEEN

RATE = np.linspace(-3.0, 3.0, 61)
MOVING = Sample(0.0, 0.0, RATE, 0.0, slide=np.sign(RATE), tau=0.0)
JOINT = RIG.joints[0]


def test_what_sets_in_at_once_is_dry_and_what_sets_in_beyond_all_rates_is_viscous() -> None:
    dry, viscous = AsymmetricFriction("tilt").basis(MOVING)
    (swift,), (slow,) = (
        AsymmetricFriction("tilt", speed).basis(MOVING._replace(v=1e-4 * RATE)) for speed in (1e-12, 10.0)
    )
    np.testing.assert_allclose(swift, dry, atol=1e-6)
    np.testing.assert_allclose(10.0 * slow, 1e-4 * viscous, rtol=1e-4)


def test_at_its_speed_half_of_it_is_there_either_way_and_at_rest_none() -> None:
    effect, rates = AsymmetricFriction("tilt", 0.4), np.array([-0.4, 0.0, 0.4])
    np.testing.assert_allclose(effect.basis(MOVING._replace(v=rates, slide=np.sign(rates)))[0], [0.5, 0.0, 0.5])
    assert "half of that is there at 0.4 rad/s" in effect.says((0.1,))
    assert "half of" not in AsymmetricFriction("tilt").says((0.1, 0.0))


def test_its_sentence_holds_the_figures_that_stand_below_it() -> None:
    """Of the direction that takes more, whichever that is."""
    told = AsymmetricFriction("tilt", 0.4, thin=True).says((-0.1, 0.02))
    assert "in the negative direction friction is up to 0.1 N m (-0.02 N m per rad/s) above the mean" in told


def test_speeds_are_tried_from_what_the_rates_noise_hides_to_the_fastest() -> None:
    noisy = SEEN._replace(rate_std=0.01)
    forms = [one for one in AsymmetricFriction("tilt").akin(noisy) if isinstance(one, AsymmetricFriction)]
    for thin in (False, True):
        speeds = [one.speed for one in forms if one.thin == thin]
        assert speeds[0] == pytest.approx(3 * noisy.rate_std) and speeds[-1] == pytest.approx(SEEN.rate)
        assert all(b / a < 2 for a, b in pairwise(speeds))
        others = AsymmetricFriction("tilt", 0.4, thin).akin(noisy)
        assert others == tuple(one for one in forms if one.thin != thin), "all but the form that it has"


@pytest.mark.parametrize(("size", "speed"), [(0.05, 0.4), (-0.1, 0.1)])
def test_a_difference_that_sets_in_with_the_rate_is_found_with_its_speed(size: float, speed: float) -> None:
    """From where the form without a speed stands."""
    plain = standing(Term(AsymmetricFriction(JOINT, speed), (size,)))
    found = replaced(plain, plain.causes, Library(plain.problem, ()))
    assert found is not None and found.fit.dispersion[0] < 2 < plain.fit.dispersion[0]
    (cause,) = found.causes
    assert isinstance(cause, AsymmetricFriction) and cause.speed == pytest.approx(speed, rel=0.1)
    assert found.coefficients(cause)[0] == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize(("values", "speed"), [((0.05, 0.03), 0.3), ((0.05, -0.03), 0.3), ((-0.1, -0.02), 0.2)])
def test_a_film_that_thins_and_is_viscous_is_found_with_both(values: tuple[float, float], speed: float) -> None:
    """The one form alone is taken up by another speed, far from the true one."""
    plain = standing(Term(AsymmetricFriction(JOINT, speed, thin=True), values))
    found = replaced(plain, plain.causes, Library(plain.problem, ()))
    assert found is not None
    (cause,) = plainer(found).causes
    assert isinstance(cause, AsymmetricFriction) and cause.thin and cause.speed == pytest.approx(speed, rel=0.1)
    assert found.coefficients(cause).tolist() == pytest.approx(values, rel=0.1)


@pytest.mark.parametrize(("size", "speed"), [(0.05, 0.4), (-0.1, 0.1)])
def test_a_film_that_only_thins_is_told_no_viscous_part(size: float, speed: float) -> None:
    plain = standing(Term(AsymmetricFriction(JOINT, speed), (size,)))
    both = refined(without(plain, plain.causes[0]), AsymmetricFriction(JOINT, speed, thin=True))
    (cause,) = plainer(consistent(solved(plain.problem, (both,), plain))).causes
    assert isinstance(cause, AsymmetricFriction) and not cause.thin


@pytest.mark.parametrize("given", ["coulomb=0.2,speed=0.3", "coulomb=-0.2,speed=0.01", "coulomb=0.0,viscous=0.1"])
def test_a_difference_that_makes_friction_push_at_any_rate_is_refused(given: str) -> None:
    with pytest.raises(UsageError, match=rf"joint {JOINT}.* rad/s: it would push"):
        plant_with(nominal(RIG), [parse_effect(f"asymmetric-friction:{JOINT}:{given}", RIG)])


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_difference_of_less_than_the_friction_that_it_is_of_is_planted_at_any_rate(speed: float) -> None:
    dry, viscous = 0.9 * RIG.friction[RIG.joint_index(JOINT)]
    text = f"asymmetric-friction:{JOINT}:coulomb={dry},viscous={-viscous},speed={speed}"
    assert plant_with(nominal(RIG), [parse_effect(text, RIG)]).plant.terms


@pytest.mark.parametrize("values", [(0.05, 0.0), (0.0, 0.05), (-0.05, 0.02)])
def test_a_difference_that_is_there_from_rest_on_has_no_speed(values: tuple[float, float]) -> None:
    plain = standing(Term(AsymmetricFriction(JOINT), values))
    assert replaced(plain, plain.causes, Library(plain.problem, ())) is None


def test_a_viscous_part_beside_a_speed_is_planted_too() -> None:
    given = "asymmetric-friction:tilt:coulomb=0.1,speed=0.4"
    limited, both, plain = (parse_effect(text, RIG) for text in (given, given + ",viscous=0.2", given[:-10]))
    assert limited == Term(AsymmetricFriction("tilt", 0.4), (0.1,))
    assert plain == Term(AsymmetricFriction("tilt"), (0.1, 0.0))
    assert isinstance(both, Term) and isinstance(limited, Term) and term_from(both.to_dict()) == both
    np.testing.assert_allclose(both.torque(MOVING) - limited.torque(MOVING), 0.2 * np.abs(RATE))


def standing(term: Term) -> State:
    """A log of a term, with the form without a speed fitted to it."""
    state = first(term)
    return consistent(solved(state.problem, (AsymmetricFriction(term.effect.joint),), state))
