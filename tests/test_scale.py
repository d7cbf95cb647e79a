"""Laws of limits: what a drive's limit leaves open of all that moves there, and of which side it is told."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin.diagnosis.finding import Finding
from gimbal_pin.diagnosis.plainer import plainer
from gimbal_pin.diagnosis.scale import Limited, limited, scaled
from gimbal_pin.diagnosis.shapes import FINE, refined
from gimbal_pin.diagnosis.state import State, solved
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.effects.saturation import Saturation
from gimbal_pin.parameter import Parameter
from tests.test_thresholds import RIG, looped

GAIN = dict.fromkeys(("torque_rmse_before", "torque_rmse_after", "rollout_rmse_before", "rollout_rmse_after"), 1.0)


def told(cause: str, joint: str, *figures: Parameter) -> Finding:
    return Finding(cause, joint, "named", (cause,), figures, GAIN, 0.001, 1.0, 0.5, 1.0, (), f"{joint}: {cause}", None)


@cache
def asked() -> tuple[float, float]:
    """Largest torque either way that pan is commanded where nothing limits it, N m."""
    torque = np.concatenate(looped().problem.evidence.torque)[:, 0]
    return -float(torque.min()), float(torque.max())


def with_limit(state: State, side: int, limit: float) -> State:
    """The state with a limit of one side, or of both, as a search refines it."""
    return solved(state.problem, (refined(state, Saturation("pan", limit, side), FINE),), state)


def test_a_limit_of_which_one_side_was_reached_is_told_as_one_of_both() -> None:
    """A supply clips both ways; a log that reaches it one way only denies nothing of that."""
    low, high = asked()
    side = 1 if high > low else -1
    limit = max(0.5 * (low + high), 0.85 * max(low, high))
    assert limit > min(low, high)
    (cause,) = plainer(with_limit(looped(Saturation("pan", limit)), side, limit)).causes
    assert isinstance(cause, Saturation) and cause.side == 0 and cause.limit == pytest.approx(limit, rel=0.05)


@pytest.mark.parametrize("side", [1, -1])
def test_a_limit_that_the_other_side_denies_stays_one_of_its_side(side: int) -> None:
    limit = 0.9 * min(asked())
    (cause,) = plainer(with_limit(looped(Saturation("pan", limit, side)), side, limit)).causes
    assert isinstance(cause, Saturation) and cause.side == side


@pytest.mark.parametrize(("given", "side"), [("", 0), (",side=1", 1), (",side=-1", -1), (",side=0", 0)])
def test_the_side_of_a_limit_can_be_planted(given: str, side: int) -> None:
    planted = parse_effect(f"saturation:pan:limit=0.5{given}", RIG)
    assert planted == Saturation("pan", 0.5, side)


def test_a_limit_that_bites_most_of_the_time_leaves_a_factor_open_on_all_that_is_a_torque_there() -> None:
    """``std² + (value off)²`` for limit's own joint and torques alone; nothing where it bites seldom."""
    limit = told("saturation", "pan", Parameter("limit", 0.4, "N m", std=0.06))
    figures = (
        Parameter("amplitude", 0.05, "N m", std=0.001),
        Parameter("stiffness", 2.0, "N m/rad", std=0.0),
        Parameter("phase", 1.0, "rad", std=0.1),
        Parameter("harmonic", 14.0, "per turn"),
    )
    cogs, away = told("cogging", "pan", *figures), told("cogging", "tilt", *figures)
    limits = (Limited(limit, 0.9),)
    assert limits[0].off == pytest.approx(0.15) and "90 %" in limits[0].note and "± 15 %" in limits[0].note
    size, spring, phase, harmonic = scaled(cogs, limits).parameters
    assert size.std == pytest.approx(np.hypot(0.001, 0.0075)) and spring.std == pytest.approx(0.3)
    assert phase == figures[2] and harmonic == figures[3]
    assert scaled(away, limits) == away and scaled(limit, limits) == limit and scaled(cogs, ()) == cogs
    unknown = replace(limit, parameters=(Parameter("limit", 0.4, "N m"),))
    assert scaled(cogs, (Limited(unknown, 0.9),)) == cogs and "not at all closely" in Limited(unknown, 0.9).note


def test_the_share_of_the_time_at_a_limit_is_that_of_the_commands_beyond_it() -> None:
    state = looped()
    torque = np.concatenate(state.problem.evidence.torque)[:, 0]
    finding = told("saturation", "pan", Parameter("limit", 0.1, "N m", std=0.01))
    shares = {}
    for quantile in (0.1, 0.3, 0.6):
        cause = Saturation("pan", float(np.quantile(np.abs(torque), quantile)))
        for one in limited(solved(state.problem, (cause,), state), [finding]):
            shares[quantile] = one.share
    assert set(shares) == {0.1, 0.3} and all(share == pytest.approx(1 - q, abs=0.1) for q, share in shares.items())
    assert not list(limited(state, [finding]))
