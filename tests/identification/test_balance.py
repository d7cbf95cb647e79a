"""Laws of the balance: slid as it says, gravity takes least and what was foretold; a moved camera is moved back."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin.dynamics import Model, compute_rnea, nominal
from gimbal_pin.dynamics.checking import compute_gravity_load, spread_poses
from gimbal_pin.effects import PayloadShift
from gimbal_pin.identification import Balance, Identified, compare_payload, identify
from gimbal_pin.log import Array
from gimbal_pin.regression import Filtering
from gimbal_pin.report import show_parameters
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed

MINIMISED = "gravity's torque over the motors' limits is least, mean square over all joints"

RIGS = ("thesis", "handheld", "turret")


@cache
def found(name: str, shift: tuple[float, ...] = ()) -> Identified:
    rig = Rig.load(name)
    log = prescribed(
        slid(rig, np.array(shift or (0.0, 0.0, 0.0))), 1, seconds=14.0, torque_noise=0.01, dt=0.004
    )
    return identify(rig, [log], filtering=Filtering(alignment=0.0))


def slid(rig: Rig, way: Array) -> Model:
    return nominal(PayloadShift(*way.tolist()).apply(rig))


def told(name: str, shift: tuple[float, ...] = ()) -> Balance:
    out = compare_payload(found(name, shift)).balance
    assert out is not None
    return out


@pytest.mark.parametrize("name", RIGS)
def test_slid_as_it_says_gravity_takes_what_it_says(name: str) -> None:
    """On the true rig: the load falls to what was foretold, and any other way of a millimetre makes it larger."""
    rig = Rig.load(name)
    said = told(name)
    load = compute_gravity_load(slid(rig, said.way).rig)
    for joint, torque in zip(rig.joints, load):
        assert torque == pytest.approx(
            said.after[joint], abs=0.02 * max(said.before.values()) + 1e-9
        )
    best = total(rig, said.way)
    for axis in np.eye(3):
        shown = np.abs(said.way) > 0
        for sign in (-1, 1):
            assert total(rig, said.way + sign * 2e-3 * axis * shown) >= best - 1e-9
    assert best <= total(rig, np.zeros(3))


def total(rig: Rig, way: Array) -> float:
    """Gravity over the motors' torque, mean square over poses within the limits."""
    q = spread_poses(rig, 400)
    torque = compute_rnea(slid(rig, way).rig, q, np.zeros_like(q), np.zeros_like(q))
    return float(np.mean((torque / rig.tau_max) ** 2))


@pytest.mark.parametrize("name", RIGS)
def test_a_camera_that_was_moved_is_to_be_moved_back(name: str) -> None:
    """The way changes by just what the camera was moved by, against its direction."""
    moved = (0.012, -0.006, 0.009)
    before = told(name)
    after = told(name, moved)
    shown = np.abs(before.way) > 0
    std = np.hypot(before.std, after.std)[shown]
    np.testing.assert_array_less(
        np.abs(after.way - before.way + np.array(moved))[shown], 4 * std + 1e-6
    )
    assert list(shown) == ([True, False, True] if name == "turret" else [True, True, True])


def test_the_share_of_the_motor_is_gravity_over_its_torque() -> None:
    said = told("thesis", (0.02, 0.0, 0.0))
    load = compute_gravity_load(slid(Rig.load("thesis"), np.array([0.02, 0.0, 0.0])).rig)
    assert said.held["tilt"] == pytest.approx(load[2] / 3.6, rel=0.02)
    weak = replace(said, available=dict.fromkeys(said.available, 0.5))
    assert "cannot hold it" in weak.holding() and "hold it" in said.holding()
    assert not weak.to_dict()["holds_unbalanced"] and said.to_dict()["holds_unbalanced"]


def test_the_json_holds_millimetres_and_nothing_where_nothing_is_mounted() -> None:
    row = compare_payload(found("turret")).to_dict()["balance"]
    np.testing.assert_allclose(row["slide_mm"], 1e3 * told("turret").way)
    assert row["slide_mm"][1] == 0.0
    np.testing.assert_allclose(
        row["moment_kg_mm"], np.array(row["slide_mm"]) * row["stated_mass"] / 1e3
    )
    rig = Rig.load("turret", "none")
    log = prescribed(nominal(rig), 1, seconds=14.0, dt=0.004)
    assert compare_payload(identify(rig, [log], filtering=Filtering(alignment=0.0))).balance is None


def test_one_sentence_alone_says_how_to_slide_the_payload() -> None:
    """The comparison with the URDF says where it sits: to slide it there is another way than to balance it."""
    one = found("turret", (0.02, 0.0, 0.0))
    said = show_parameters(one, compare_payload(one)).to_text()
    assert re.search(
        r"against its URDF \(± 95 %\)\n  the payload sits (20|19\.9)\S* ± \S+ mm further forward",
        said,
    )
    assert len(re.findall("slide", said)) == 1 and "to balance the payload, slide it" in said


@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_no_way_that_brute_force_tries_is_better(name: str) -> None:
    """Least of what it says it minimises, over every way on a grid about it and many at random, on the fitted model."""
    one = found(name, (0.012, -0.006, 0.009))
    said = compare_payload(one).balance
    assert said is not None and any(MINIMISED in sentence for sentence in said.sentences)
    fitted = one.model.rig
    best = total(fitted, said.way)
    steps = np.array([-0.02, -0.005, -0.001, 0.0, 0.001, 0.005, 0.02])
    grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(0)
    for way in (*grid[:: 2 if name == "turret" else 5], *(0.05 * rng.standard_normal((30, 3)))):
        assert total(fitted, said.way + way) >= best * (1 - 1e-9) - 1e-15
    assert best < total(fitted, np.zeros(3))


@pytest.mark.parametrize("mass", [0.4, 3.0])
def test_twice_the_mass_is_slid_half_as_far(mass: float) -> None:
    """Joint torques show mass times way: with a mass that was weighed beside the URDF's the way alone changes."""
    stated = told("turret")
    weighed = compare_payload(found("turret"), mass).balance
    assert (
        weighed is not None and weighed.mass == pytest.approx(mass) and weighed.source == "weighed"
    )
    np.testing.assert_allclose(mass * weighed.way, stated.mass * stated.way, rtol=1e-9, atol=1e-12)
    assert stated.source == "stated" and "half as far if it weighs twice that" in stated.how()
    assert "that were weighed" in weighed.how() and "proportion" not in weighed.how()
    assert weighed.after == pytest.approx(stated.after)
