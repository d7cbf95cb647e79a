"""Laws of friction that differs by direction, from rest on or setting in with the rate."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin.diagnosis import solve_causes
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import AsymmetricFriction, Sample, Term, parse_effect, read_term
from gimbal_pin.errors import UsageError
from tests.candidates import refined
from tests.refitted import RIG, first

RATE = np.linspace(-3.0, 3.0, 61)
MOVING = Sample(0.0, 0.0, RATE, 0.0, slide=np.sign(RATE), tau=0.0)
JOINT = RIG.joints[0]


def test_what_sets_in_at_once_is_dry_and_what_sets_in_beyond_all_rates_is_viscous() -> None:
    dry, viscous = AsymmetricFriction("tilt").basis(MOVING)
    (swift,), (slow,) = (
        AsymmetricFriction("tilt", speed).basis(MOVING._replace(v=1e-4 * RATE))
        for speed in (1e-12, 10.0)
    )
    np.testing.assert_allclose(swift, dry, atol=1e-6)
    np.testing.assert_allclose(10.0 * slow, 1e-4 * viscous, rtol=1e-4)


def test_at_its_speed_half_of_it_is_there_either_way_and_at_rest_none() -> None:
    effect = AsymmetricFriction("tilt", 0.4)
    rates = np.array([-0.4, 0.0, 0.4])
    np.testing.assert_allclose(
        effect.basis(MOVING._replace(v=rates, slide=np.sign(rates)))[0], [0.5, 0.0, 0.5]
    )
    assert "half of that is there at 0.4 rad/s" in effect.says((0.1,))
    assert "half of" not in AsymmetricFriction("tilt").says((0.1, 0.0))


def test_its_sentence_holds_the_figures_that_stand_below_it() -> None:
    """Of the direction that takes more, whichever that is."""
    told = AsymmetricFriction("tilt", 0.4, thin=True).says((-0.1, 0.02))
    assert (
        "in the negative direction friction is up to 0.1 N m (-0.02 N m per rad/s) above the mean"
        in told
    )


@pytest.mark.parametrize(
    ("values", "speed", "thin"),
    [
        ((0.05,), 0.4, False),
        ((-0.1,), 0.1, False),
        ((0.05, 0.03), 0.3, True),
        ((-0.1, -0.02), 0.2, True),
    ],
)
def test_a_difference_that_sets_in_with_the_rate_is_fitted_with_its_speed(
    values: tuple[float, ...], speed: float, thin: bool
) -> None:
    state = first(Term(AsymmetricFriction(JOINT, speed, thin), values))
    found = refined(state, AsymmetricFriction(JOINT, 1.5 * speed, thin))
    assert isinstance(found, AsymmetricFriction) and found.speed == pytest.approx(speed, rel=0.1)
    after = solve_causes(state.problem, (found,), state)
    assert after.coefficients(found).tolist() == pytest.approx(values, rel=0.1)
    assert after.fit.dispersion[0] < 2


@pytest.mark.parametrize(
    "given", ["coulomb=0.2,speed=0.3", "coulomb=-0.2,speed=0.01", "coulomb=0.0,viscous=0.1"]
)
def test_a_difference_that_makes_friction_push_at_any_rate_is_refused(given: str) -> None:
    with pytest.raises(UsageError, match=rf"joint {JOINT}.* rad/s: it would push"):
        plant_with(nominal(RIG), [parse_effect(f"asymmetric-friction:{JOINT}:{given}", RIG)])


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_difference_of_less_than_the_friction_that_it_is_of_is_planted_at_any_rate(
    speed: float,
) -> None:
    dry, viscous = 0.9 * RIG.friction[RIG.joint_index(JOINT)]
    text = f"asymmetric-friction:{JOINT}:coulomb={dry},viscous={-viscous},speed={speed}"
    assert plant_with(nominal(RIG), [parse_effect(text, RIG)]).plant.terms


def test_a_viscous_part_beside_a_speed_is_planted_too() -> None:
    given = "asymmetric-friction:tilt:coulomb=0.1,speed=0.4"
    limited, both, plain = (
        parse_effect(text, RIG) for text in (given, given + ",viscous=0.2", given[:-10])
    )
    assert limited == Term(AsymmetricFriction("tilt", 0.4), (0.1,))
    assert plain == Term(AsymmetricFriction("tilt"), (0.1, 0.0))
    assert (
        isinstance(both, Term) and isinstance(limited, Term) and read_term(both.to_dict()) == both
    )
    np.testing.assert_allclose(both.torque(MOVING) - limited.torque(MOVING), 0.2 * np.abs(RATE))
