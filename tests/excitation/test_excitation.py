"""Laws of designed motions.

Gradients are exact; limits hold between the samples too; a motion starts and ends at rest, repeats itself, and beats
chance; what nobody states is assumed; what was learnt before counts; one refusal per kind of impossible demand.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import Model, compute_gravity, compute_rnea, nominal
from gimbal_pin.effects import Coulomb, LoadDependentFriction, Stribeck, Term
from gimbal_pin.errors import UsageError
from gimbal_pin.excitation import (
    Condition,
    Criterion,
    Determinant,
    Envelope,
    ExcitationColumns,
    Series,
    assume_limits,
    build_criterion_after_logs,
    compute_joint_reach,
    count_periods,
    excite,
    list_shown_effects,
)
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.regression import Filtering, compute_settling_time
from gimbal_pin.rig import Limits, Rig
from tests.command_line import Run, refused
from tests.excitation.designs import (
    SLIDER,
    assert_within,
    designed,
    differences,
    moved,
    problem,
)
from tests.rigs import bundled, spelled


def branch() -> Rig:
    """Return a slide that carries two swinging arms, one with a wrist: a tree, not a chain."""
    text = SLIDER.replace("</robot>", "")
    for name, parent, axis in (("left", "cart", "0.6 0 0.8"), ("hand", "boom", "1 0 0")):
        text += f"""<link name="{name}"><inertial><origin xyz="0.1 0.05 0"/><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="to_{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/><origin xyz="0.1 0.2 0.3"
rpy="0.3 -0.2 0.5"/><axis xyz="{axis}"/><limit lower="-1" upper="1" effort="5" velocity="4"/></joint>"""
    return spelled(text + "</robot>")


LOADED = (LoadDependentFriction("roll"), LoadDependentFriction("tilt", True))


@pytest.mark.parametrize(
    ("name", "criterion", "effects", "speed"),
    [
        ("handheld", Condition(), (), 0.9),
        ("thesis", Determinant(), (Stribeck("tilt", 0.2), *LOADED), 0.0),
        ("tree", Determinant(), (), 0.0),
    ],
)
def test_gradient_is_that_of_the_criterion(
    name: str, criterion: Criterion, effects: tuple, speed: float
) -> None:
    """With a speed that is not reached, with effects that see rate and load, and on a tree."""
    rig = branch() if name == "tree" else bundled(name)
    at = replace(problem(rig, criterion, effects), speed=speed)
    rng = np.random.default_rng(3)
    x = at.draw_start(rng)
    along = rng.standard_normal((6, len(x)))
    rough = differences(lambda x: at.evaluate(x)[0], x, along)
    exact = along @ at.evaluate(x)[1]
    np.testing.assert_allclose(exact, rough, rtol=0, atol=1e-5 * np.abs(rough).max())


def test_jacobian_of_the_limits_is_exact_torque_included() -> None:
    rig = moved(bundled("thesis"), effort=1.0, acceleration=inf)
    terms = tuple(Term(effect, (0.1,)) for effect in LOADED)
    carrying = (*nominal(rig).terms, *terms, Term(Stribeck("tilt", 0.2), (0.02,)))
    at = problem(rig, model=Model(rig, carrying))
    assert at.driven.all()
    x = at.draw_start(np.random.default_rng(4))
    assert np.abs(at.differentiate_room(x) - differences(at.compute_room, x)).max() < 1e-6


@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_a_design_keeps_its_limits_and_shows_friction_better_than_chance(name: str) -> None:
    rig = bundled(name)
    found = designed(name, 0)
    assert_within(rig, nominal(rig), found)
    v = found.motion.v
    rates = np.array([limit.velocity for limit in rig.limits])
    for side in (v, -v):
        assert (np.mean(side > 0, axis=0) > 0.25).all()
        assert (side.max(axis=0) > 0.3 * rates).all()
    at = problem(rig)
    rng = np.random.default_rng(5)
    grid = replace(at, per_period=48).coarse
    chance = [at.motion(at.draw_start(rng), grid) for _ in range(10)]
    least = min(map(at.columns.compute_condition_number, chance))
    assert found.condition_number < 0.7 * least


def test_a_motion_rests_at_both_ends_repeats_itself_and_is_smooth() -> None:
    found = designed("turret", 0)
    motion = found.motion
    assert np.abs([motion.v[[0, -1]], motion.a[[0, -1]]]).max() < 1e-12
    assert (motion.t[0], motion.t[-1], found.seconds) == (0.0, 10.0, 10.0)
    later = found.series.motion(found.coefficients, motion.t + found.seconds)
    np.testing.assert_allclose(later.q, motion.q, atol=1e-9)
    for x, slope, off in ((motion.q, motion.v, 1e-4), (motion.v, motion.a, 1e-3)):
        np.testing.assert_allclose(np.gradient(x, motion.t[1], axis=0)[1:-1], slope[1:-1], atol=off)


def test_same_seed_same_motion() -> None:
    again = excite(bundled("turret"), starts=1, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(again.coefficients, designed("turret", 1).coefficients)
    assert not np.array_equal(again.coefficients, designed("turret", 0).coefficients)


def test_a_stated_rotor_hides_no_parameter() -> None:
    """It is known, and no column beside that of its joint's inertia."""
    plain = bundled("turret")
    motors = tuple(replace(motor, rotor_inertia=0.01) for motor in plain.motors)
    found = excite(replace(plain, motors=motors), starts=1, rng=np.random.default_rng(0))
    assert found.condition_number < 1.2 * designed("turret", 0).condition_number


def test_each_criterion_is_best_by_its_own_measure() -> None:
    determinant = Determinant()
    by_condition = designed("turret", 0)
    by_determinant = excite(bundled("turret"), starts=1, rng=0, criterion="determinant")
    columns = ExcitationColumns.of(bundled("turret"))
    first, second = (
        determinant.value(columns.scale_rows(found.motion))
        for found in (by_condition, by_determinant)
    )
    assert second < first
    assert by_condition.condition_number < by_determinant.condition_number


def test_a_speed_that_shows_friction_is_reached() -> None:
    rig = bundled("handheld")
    found = excite(rig, starts=1, rng=np.random.default_rng(0), speed=0.6)
    for joint, limit in zip(rig.joints, rig.limits):
        assert designed("handheld", 0).speed[joint] < 0.9 * 0.6 * limit.velocity
        assert found.speed[joint] > 0.92 * 0.6 * limit.velocity


def test_torque_limit_counts_the_friction_of_the_model_given() -> None:
    rig = moved(bundled("turret"), effort=1.0, acceleration=inf, velocity=100.0)
    stiff = Model(rig, (*nominal(rig).terms, Term(Coulomb("pan"), (0.4,))))
    found = excite(rig, torque_model=stiff, starts=1, harmonics=4, seconds=4.0, speed=0.0, rng=0)
    assert_within(rig, stiff, found)


def test_a_slide_is_moved_within_its_limits_and_a_joint_without_any_by_half_a_turn() -> None:
    rig = spelled(SLIDER)
    found = excite(rig, starts=1, rng=0)
    assert_within(rig, nominal(rig), found)
    assert found.limits_used["slide"]["q"] > 0.5
    free = replace(bundled("turret"), limits=(Limits(effort=4.0, velocity=3.0),) * 2)
    turned = excite(free, starts=1, rng=0)
    assert np.abs(turned.motion.q).max() <= np.pi
    assert all(used["dq"] > 0.2 and used["ddq"] == 0 for used in turned.limits_used.values())


def test_two_rods_reach_as_far_as_they_are_long() -> None:
    rod = (
        '<link name="{1}"><inertial><origin xyz="0 0 0.3"/><mass value="2"/><inertia ixx="0.06" iyy="0.06" izz="0" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="to_{1}" type="continuous"><parent link="{0}"/>'
        '<child link="{1}"/><origin xyz="0 0 {2}"/><axis xyz="0 1 0"/></joint>'
    )
    ends = rod.format("base", "a", 1) + rod.format("a", "b", 0.6)
    rig = spelled(f'<robot name="rods"><link name="base"/>{ends}</robot>')
    np.testing.assert_allclose(compute_joint_reach(rig), [1.2, 0.6], rtol=1e-3)


def test_limits_that_nobody_states_are_assumed_and_said() -> None:
    """No point then moves faster than people may stand beside; what is assumed is assumed once."""
    rig = moved(bundled("turret"), velocity=5e4, effort=inf, acceleration=inf)
    free = replace(rig, motors=tuple(replace(motor, tau_max=inf) for motor in rig.motors))
    safe, said = assume_limits(free)
    assert {one.quantity for one in said} == {"velocity", "acceleration", "lower", "upper"}
    rates = np.array([limit.velocity for limit in safe.limits])
    assert rates @ compute_joint_reach(rig) == pytest.approx(0.25)
    np.testing.assert_allclose([limit.acceleration for limit in safe.limits], np.pi * rates)
    found = excite(free, starts=1, rng=0, seconds=5.0)
    assert found.assumed == said
    assert assume_limits(safe) == (safe, ())
    assert np.abs(found.motion.q).max() <= 0.25
    assert (np.abs(found.motion.v).max(axis=0) <= rates).all()


@pytest.mark.parametrize("changes", [{}, {"effort": 2.0, "acceleration": inf, "velocity": 50.0}])
def test_a_first_motion_is_the_same_at_a_tenth_and_pushes_with_a_tenth(
    changes: dict[str, float],
) -> None:
    """Where the torque alone bounds a motion, gravity helps it to push with over one limit: it takes longer."""
    rig = moved(bundled("thesis"), **changes)
    full, first = (excite(rig, starts=1, rng=1, first=first) for first in (False, True))
    swing = np.ptp(first.motion.q, axis=0) / np.ptp(full.motion.q, axis=0)
    np.testing.assert_allclose(swing, 0.1, rtol=1e-3)
    np.testing.assert_allclose(first.coefficients[0], full.coefficients[0])
    assert (first.seconds > full.seconds) == bool(changes)
    motion = first.motion
    push = compute_rnea(rig, motion.q, motion.v, motion.a) - compute_gravity(rig, motion.q)
    assert (np.abs(push).max(axis=0) <= 0.1 * rig.tau_max).all()


@pytest.mark.parametrize(
    ("changes", "arguments", "words"),
    [
        ({"velocity": 0.0}, {}, "joint 'pan': has a velocity limit of 0"),
        ({"effort": 0.0}, {}, "joint 'pan': has a torque limit of 0"),
        ({"lower": 0.3, "upper": 0.3}, {}, "joint 'pan': has a travel of 0"),
        ({"effort": 0.005}, {}, r"joint '\w+': no pose was found that the motors can hold"),
        ({}, {"harmonics": 1}, "harmonics"),
        ({}, {"seconds": 0.0}, "seconds"),
        ({}, {"dt": 0.003}, "dt"),
        ({}, {"starts": 0}, "starts"),
        ({}, {"margin": 1.0}, "margin"),
        ({}, {"speed": 1.0}, "speed"),
        ({}, {"clearance": -1.0}, "clearance"),
        ({}, {"criterion": "best"}, "criterion"),
    ],
)
def test_what_leaves_no_motion_is_named(
    changes: dict[str, float], arguments: dict[str, object], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        excite(moved(bundled("turret"), **changes), rng=0, **arguments)


def test_a_slide_without_limits_and_a_cause_that_no_motion_shows_are_named() -> None:
    with pytest.raises(UsageError, match="joint 'slide': slides without limits"):
        excite(replace(spelled(SLIDER), limits=(Limits(), Limits())), rng=0)
    with pytest.raises(UsageError, match="'simulate --effect' plants it"):
        list_shown_effects(nominal(bundled("turret")), ["delay:pan:time=0.01"])


@pytest.mark.parametrize("limit", ["pan.velocity", "pan.speed=2", "roll.velocity=2"])
def test_a_limit_that_is_none_is_named(run: Run, tmp_path: Path, limit: str) -> None:
    said = run("excite", "turret", "-o", tmp_path / "out.csv", "--limit", limit)
    refused(said, 2, f"--limit {limit}")


def test_a_longer_motion_repeats_a_shorter_one_and_is_never_worse() -> None:
    """With five harmonics whatever the length 20 s were two to four times worse."""
    rig = bundled("turret")
    found = excite(rig, seconds=24.0, starts=1, rng=np.random.default_rng(0), dt=0.01)
    assert found.condition_number <= designed("turret", 0).condition_number
    assert found.seconds / found.series.seconds == pytest.approx(2, rel=1e-12)
    np.testing.assert_allclose(found.motion.q[:1201], found.motion.q[1200:], atol=1e-9)
    assert_within(rig, nominal(rig), found)


@given(seconds=st.floats(0.5, 5000.0))
def test_periods_last_4_to_20_s_and_the_highest_harmonic_has_half_a_hertz(seconds: float) -> None:
    series = Series.of(seconds, periods=count_periods(seconds))
    times = seconds / series.seconds / count_periods(seconds)
    assert times == pytest.approx(round(times), rel=1e-12)
    assert min(seconds, 4.0) * (1 - 1e-12) <= series.seconds <= 20.0 * (1 + 1e-12)
    fastest = series.harmonics / series.seconds
    assert fastest >= 0.5 * (1 - 1e-12)
    assert fastest <= 0.6 or series.harmonics == 5


def test_interrupted_it_returns_the_best_so_far() -> None:
    rig = bundled("turret")
    calls = []

    class Interrupted(Condition):
        def factors(self, a: Array) -> tuple[Array, Array]:
            calls.append(1)
            if len(calls) == 20:
                raise KeyboardInterrupt
            return super().factors(a)

    found = excite(rig, rng=0, criterion=Interrupted())
    assert not found.finished
    assert_within(rig, nominal(rig), found)


@given(seed=st.integers(0, 10_000), sharpness=st.floats(2.0, 200.0))
def test_smooth_condition_number_lies_just_above_the_true_one(seed: int, sharpness: float) -> None:
    a = np.random.default_rng(seed).standard_normal((30, 6)) * np.logspace(-2, 1, 6)
    excess = Condition(sharpness).value(a) - np.log(np.linalg.cond(a))
    assert -1e-9 <= excess <= 2 * np.log(6) / sharpness + 1e-9


@given(st.integers(0, 1000))
def test_information_of_two_logs_adds_up_and_its_gradient_is_exact(seed: int) -> None:
    """Rows that are given twice, for half the time each, count once."""
    first, a, change = np.random.default_rng(seed).standard_normal((3, 12, 3))
    criterion = Determinant(Determinant(0.3).information(first))
    assert criterion.value(a) == pytest.approx(Determinant(0.3).value(np.vstack([first, a])))
    timed = replace(criterion, seconds=4.0)
    left, right = timed.factors(a)
    (slope,) = differences(timed.value, a, change[None])
    assert np.sum(left * (change @ right.T)) == pytest.approx(slope, rel=1e-5, abs=1e-7)
    assert timed.value(np.vstack([a, a])) == pytest.approx(timed.value(a), rel=1e-12)


def test_columns_have_unit_torque_over_the_rigs_states_whatever_is_mounted() -> None:
    rigs = [bundled("thesis", load) for load in ("none", "cinema")]
    states = Envelope.of(rigs[0]).spread()
    rows = [ExcitationColumns.of(rig).scale_rows(states) for rig in rigs]
    np.testing.assert_allclose(np.mean(rows[0] ** 2, axis=0), 1.0)
    np.testing.assert_allclose(rows[1], rows[0], rtol=1e-9, atol=1e-9)


def swing_pan() -> tuple[Log, Motion]:
    """Return a log in which the turret's pan alone swings, and its motion."""
    t = 0.005 * np.arange(3001)
    swing = 0.5 * np.exp(1.7j * t)
    q, v, a = (np.outer(x.imag, [1.0, 0.0]) for x in (swing, 1.7j * swing, -(1.7**2) * swing))
    return Log("pan", ("pan", "tilt"), t, q, v, np.zeros_like(q)), Motion(t, q, v, a)


def test_information_of_a_log_is_that_of_its_motion() -> None:
    """The integral over the true motion, away from its reversals and from the ends, where the filters settle."""
    log, motion = swing_pan()
    columns = ExcitationColumns.of(bundled("turret"))
    ends = compute_settling_time(Filtering())
    moving = (np.abs(motion.v[:, 0]) > 0.1) & (log.t > ends) & (log.t < log.t[-1] - ends)
    viscous = len(columns.places) + 1
    row = columns.scale_rows(motion)[::2, viscous] * moving
    found = columns.compute_information([log])
    assert found[viscous, viscous] == pytest.approx(0.005 * row @ row, rel=0.03)
    np.testing.assert_allclose(columns.compute_information([log, log]), 2 * found, rtol=1e-12)


def test_the_next_motion_teaches_what_the_earlier_log_left_open() -> None:
    """After a log of the pan alone the motion adds more information than one that knows of no log."""
    rig = bundled("turret")
    criterion = build_criterion_after_logs(rig, [swing_pan()[0]], 8.0)
    options = {"seconds": 8.0, "starts": 4, "dt": 0.01, "rng": 0}
    columns = ExcitationColumns.of(rig)
    found, blind = (
        criterion.value(columns.scale_rows(excite(rig, criterion=one, **options).motion))
        for one in (criterion, "condition")
    )
    assert found < blind
