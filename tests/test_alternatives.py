"""Laws of figures told by forms that a log cannot tell apart: doubt only grows, and phases go round."""

from __future__ import annotations

from math import inf, isnan, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin import bench_run
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.diagnosis.alternatives import apart, doubt
from gimbal_pin.effects import CAUSES
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.model import nominal
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.simulation import plant_with

ANGLE = st.floats(-pi, pi)


def figure(name: str, value: float, std: float = nan) -> Parameter:
    return Parameter(name, value, "1", -inf, inf, std)


@given(ANGLE, ANGLE, st.integers(-3, 3))
def test_phases_differ_by_no_more_than_half_a_turn_however_they_are_counted(a: float, b: float, turns: int) -> None:
    gap = apart(figure("phase", a), figure("phase", b))
    assert 0 <= gap <= pi + 1e-9
    assert apart(figure("phase", a), figure("phase", b + 2 * pi * turns)) == pytest.approx(gap, abs=1e-9)


@given(st.floats(-9, 9), st.floats(0, 9), st.lists(st.tuples(st.floats(-9, 9), st.floats(0, 9)), max_size=4))
def test_every_other_form_can_only_add_doubt(value: float, std: float, others: list[tuple[float, float]]) -> None:
    said = [[figure("amplitude", *each), figure("other", 99.0)] for each in others]
    doubts = [doubt(figure("amplitude", value, std), said[:k]) for k in range(len(said) + 1)]
    assert doubts == sorted(doubts) and doubts[0] == std
    assert all(doubts[-1] >= max(abs(x - value), own) for x, own in others)


def test_a_form_that_runs_out_of_a_figures_bounds_says_no_more_than_the_bound() -> None:
    stiffness = Parameter("stiffness", 2.0, "N m/rad", 0.0, inf, 0.1)
    assert apart(stiffness, Parameter("stiffness", -50.0, "N m/rad")) == 2.0
    assert isnan(doubt(Parameter("stiffness", 2.0, "N m/rad"), [[stiffness]]))


def test_what_was_planted_lies_within_the_deviation() -> None:
    rig = Rig.load("turret")
    plant = plant_with(nominal(rig), [parse_effect("cogging:pan:amplitude=0.05,harmonic=6", rig)]).plant
    log = bench_run(plant, rng=np.random.default_rng(4), seconds=12)
    found = diagnose(rig, [log], {"cogging": CAUSES["cogging"]}, rng=np.random.default_rng(0))
    told = {p.name: p for p in found.findings[0].parameters}
    assert told["harmonic"].value == 6.0
    assert abs(told["amplitude"].value - 0.05) < 3 * told["amplitude"].std < 0.05
