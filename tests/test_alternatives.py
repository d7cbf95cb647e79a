"""Laws of figures told by forms that a log cannot tell apart: doubt only grows, and phases go round."""

from __future__ import annotations

from math import inf, pi
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin import bench_run
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.diagnosis.alternatives import CLOSE, alternatives, apart, doubt, near
from gimbal_pin.diagnosis.finding import APART
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.state import State
from gimbal_pin.diagnosis.verdict import compared
from gimbal_pin.effects import CAUSES
from gimbal_pin.effects.cable_spring import CableSpring
from gimbal_pin.effects.cogging import Cogging
from gimbal_pin.effects.joint_flexibility import JointFlexibility
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.effects.saturation import Saturation
from gimbal_pin.effects.stribeck import Stribeck
from gimbal_pin.effects.torque_bias import TorqueBias
from gimbal_pin.model import nominal
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.simulation import plant_with
from gimbal_pin.tuning import tune

ANGLE = st.floats(-pi, pi)


def figure(name: str, value: float) -> Parameter:
    return Parameter(name, value, "1", -inf, inf)


@given(ANGLE, ANGLE, st.integers(-3, 3))
def test_phases_differ_by_no_more_than_half_a_turn_however_they_are_counted(a: float, b: float, turns: int) -> None:
    gap = apart(figure("phase", a), figure("phase", b))
    assert 0 <= gap <= pi + 1e-9
    assert apart(figure("phase", a), figure("phase", b + 2 * pi * turns)) == pytest.approx(gap, abs=1e-9)


@given(st.floats(-9, 9), st.lists(st.floats(-9, 9), max_size=4))
def test_every_other_form_can_only_add_doubt(value: float, others: list[float]) -> None:
    said = [[figure("amplitude", x), figure("other", 99.0)] for x in others]
    gaps = [doubt(figure("amplitude", value), said[:k]) for k in range(len(said) + 1)]
    assert gaps == sorted(gaps) and gaps[0] == 0.0


def test_a_form_that_runs_out_of_a_figures_bounds_says_no_more_than_the_bound() -> None:
    stiffness = Parameter("stiffness", 2.0, "N m/rad", 0.0, inf)
    assert apart(stiffness, Parameter("stiffness", -50.0, "N m/rad")) == 2.0


def test_of_forms_that_fit_as_well_one_with_more_parameters_adds_no_doubt() -> None:
    linear, stiffening = CableSpring("pan"), CableSpring("pan", stiffening=True)
    assert near(stiffening, linear, 1.0) and not near(linear, stiffening, 1.0)
    assert near(Stribeck("pan", 0.1, 1), Stribeck("pan", 0.2, 2), 1.0)
    assert not near(Stribeck("pan", 0.1, 1), Stribeck("pan", 0.2, 2), 2 * CLOSE)


@pytest.mark.parametrize(("share", "one"), [(0.4, False), (0.6, True)])
def test_a_form_that_leaves_most_of_it_is_none_of_a_causes(
    share: float, one: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what acts in three blocks of time Vuong's z is under two, whatever the other form leaves there."""
    limit, other = Saturation("pan", 0.6), Saturation("pan", 4.0, knee=2.0)
    gains = {limit: 900.0, other: 900.0 * share}
    blocks = np.where(np.arange(40) < 3, (gains[limit] - gains[other]) / 3, 0.0)
    rival = compared(limit, other, blocks)[0]
    assert rival.z < APART and not near(limit, other, rival.delta)
    for name, stands in {
        "without": lambda state, cause: state,
        "other_forms": lambda base, cause, shelf: [other],
        "worth": lambda base, cause: gains[cause],
        "versus": lambda base, cause, other: rival,
    }.items():
        monkeypatch.setattr(f"gimbal_pin.diagnosis.alternatives.{name}", stands)
    assert alternatives(cast(State, None), limit, cast(Library, None)) == ([other] if one else [])


@settings(max_examples=20)
@given(st.floats(15, 30), st.floats(0.1, 0.3), st.floats(1.5, 3.0))
def test_far_under_its_resonance_a_spring_shows_one_figure_of_two(hertz: float, share: float, factor: float) -> None:
    command = np.sin(2 * pi * 2.0 * np.arange(2000) / 1000) * np.hanning(2000)
    other = factor * hertz, 1 / (1 + (1 / share - 1) * factor**2)  # the same (1/r - 1)/ω²
    one, two = (command - JointFlexibility("pan", f, 0.05, r).acting(command, 1e-3) for f, r in ((hertz, share), other))
    assert np.linalg.norm(one - two) < 0.05 * np.linalg.norm(one)


def test_what_was_planted_lies_within_the_deviation() -> None:
    rig = Rig.load("turret")
    plant = plant_with(nominal(rig), [parse_effect("cogging:pan:amplitude=0.05,harmonic=6", rig)]).plant
    law = tune(plant, bandwidth_hz=4.0, dt=0.004).controller
    log = bench_run(plant, law, rng=np.random.default_rng(4), seconds=12)
    found = diagnose(rig, [log], {"cogging": CAUSES["cogging"]}, rng=np.random.default_rng(0))
    told = {p.name: p for p in found.findings[0].parameters}
    assert told["harmonic"].value == 6.0
    assert abs(told["amplitude"].value - 0.05) < 3 * told["amplitude"].std < 0.05


@given(st.floats(-1e-3, 1e-3), st.integers(5, 200))
def test_two_that_are_one_function_are_never_told_apart(gain: float, blocks: int) -> None:
    """A constant is a spring of no stiffness: what is left of their difference is that of their parameters' number."""
    rival, _ = compared(TorqueBias("pan"), CableSpring("pan"), np.full(blocks, gain / blocks))
    assert rival.delta == pytest.approx(1.0, abs=1e-3) and abs(rival.z) < APART


@given(st.floats(-1e4, 1e4), st.floats(100.0, 1e4), st.integers(0, 9))
def test_what_differs_by_far_more_than_parameters_do_is_parted_as_its_blocks_say(
    gain: float, spread: float, seed: int
) -> None:
    """Vuong's own statistic."""
    gains = 2 * spread * np.random.default_rng(seed).standard_normal(50) + gain
    rival, each = compared(TorqueBias("pan"), CableSpring("pan"), gains)
    assert rival.delta == pytest.approx(np.sum(each) + 1)
    assert rival.z == pytest.approx(rival.delta / (np.std(each) * np.sqrt(50)), rel=1e-3)


@given(st.lists(st.integers(1, 30), min_size=1, max_size=6, unique=True))
def test_what_two_forms_have_in_common_makes_no_difference_by_luck(shared: list[int]) -> None:
    """However many harmonics both have."""
    one, other = (Cogging("pan", (*map(float, shared), last)) for last in (40.0, 41.0))
    rivals = [
        compared(Cogging("pan", (40.0,)), Cogging("pan", (41.0,)), np.ones(20)),
        compared(one, other, np.ones(20)),
    ]
    assert rivals[0][0].z == rivals[1][0].z > 0
