"""Excitation: exact gradients, limits that hold between the samples too, rest at both ends, better than chance."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
from dataclasses import replace
from math import inf
from pathlib import Path
from select import select
from time import monotonic

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import Model, compute_gravity, compute_regressor, compute_rnea, nominal
from gimbal_pin.effects import CAUSES, Coulomb, Effect, LoadDependentFriction, Stribeck, Term
from gimbal_pin.errors import UsageError
from gimbal_pin.excitation import (
    Condition,
    Criterion,
    Determinant,
    Envelope,
    Excitation,
    ExcitationColumns,
    Series,
    assume_limits,
    build_criterion_after_logs,
    build_links,
    compute_joint_reach,
    compute_regressor_gradient,
    count_periods,
    excite,
    find_crest,
    list_shown_effects,
)
from gimbal_pin.log import Array, Log, Motion, read_motion
from gimbal_pin.regression import Filtering, compute_settling_time
from gimbal_pin.rig import Limits, Rig
from tests.command_line import Run, heard, refused, result
from tests.excitation.designs import (
    RIGS,
    SLIDER,
    assert_within,
    crane,
    designed,
    differences,
    moved,
    problem,
)

PENDULUM = Path(__file__).parents[3] / "shared/data/dfki_double_pendulum/double_pendulum.urdf"


@given(st.integers(0, 10**6))
def test_a_crest_between_samples_is_found(seed: int) -> None:
    """Of sines sampled thirty times a period: within a hundredth of what the samples miss, and no less than they."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.1, 2.0, 3)
    phase = rng.uniform(0, 2 * np.pi, 3)
    sampled = size * np.sin(2 * np.pi * np.arange(40)[:, None] / 30 + phase)
    assert np.abs(find_crest(sampled) - size).max() < 0.01 * (1 - np.cos(np.pi / 30)) * size.max()
    assert (find_crest(sampled) >= sampled.max(axis=0)).all()
    assert find_crest(np.full((5, 1), 0.5)) == pytest.approx(0.5)


def pendulum() -> Rig:
    if not PENDULUM.is_file():
        pytest.skip("needs ../shared/data/dfki_double_pendulum, which is not beside this checkout")
    return Rig.load(PENDULUM)


# gradients


@pytest.mark.parametrize(
    "criterion", [Condition(), Condition(sharpness=8.0), Determinant()], ids=["m64", "m8", "det"]
)
@pytest.mark.parametrize("name", RIGS)
def test_gradient_is_that_of_the_criterion(name: str, criterion: Criterion) -> None:
    at = problem(Rig.load(name), criterion)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        x = at.draw_start(rng)
        along = rng.standard_normal((6, len(x)))
        exact = along @ at.evaluate(x)[1]
        rough = differences(lambda x: at.evaluate(x)[0], x, along)
        assert np.abs(exact - rough).max() < 1e-5 * np.abs(rough).max()


def test_gradient_holds_with_effects_that_see_rate_and_load() -> None:
    rig = Rig.load("thesis")
    effects = (
        Stribeck("tilt", 0.2),
        LoadDependentFriction("roll"),
        LoadDependentFriction("tilt", True, 0.5, 0.2),
    )
    at = problem(rig, Determinant(), effects)
    x = at.draw_start(np.random.default_rng(3))
    rough = differences(lambda x: at.evaluate(x)[0], x)
    assert np.abs(at.evaluate(x)[1] - rough).max() < 1e-5 * np.abs(rough).max()
    assert len(at.columns.scale) == len(problem(rig).columns.scale) + 3


def test_jacobian_of_the_limits_is_exact_torque_included() -> None:
    rig = Rig.load("thesis")
    carrying = (
        Term(LoadDependentFriction("roll"), (0.1,)),
        Term(LoadDependentFriction("tilt", True, 0.5, 0.2), (0.1,)),
    )
    terms = (*nominal(rig).terms, *carrying, Term(Stribeck("tilt", 0.2), (0.02,)))
    at = problem(
        moved(rig, effort=1.0, acceleration=inf), model=Model(moved(rig, effort=1.0), terms)
    )
    assert at.driven.all()
    x = at.draw_start(np.random.default_rng(4))
    assert np.abs(at.differentiate_room(x) - differences(at.compute_room, x)).max() < 1e-6


# what a design promises


@pytest.mark.parametrize("name", RIGS)
def test_limits_hold_between_the_samples(name: str) -> None:
    rig = Rig.load(name)
    found = designed(name, 0)
    assert_within(rig, nominal(rig), found, margin=0.05)
    assert max(max(used.values()) for used in found.limits_used.values()) == pytest.approx(
        0.95, abs=0.01
    )


@pytest.mark.parametrize("name", RIGS)
def test_starts_and_ends_at_rest_and_repeats(name: str) -> None:
    found = designed(name, 0)
    for end in (0, -1):
        assert np.abs(found.motion.v[end]).max() < 1e-12
        assert np.abs(found.motion.a[end]).max() < 1e-12
    t = found.motion.t
    assert t[0] == 0.0
    assert t[-1] == found.seconds == 10.0
    later = found.series.motion(found.coefficients, t + found.seconds)
    assert np.abs(later.q - found.motion.q).max() < 1e-9


@pytest.mark.parametrize("name", RIGS)
def test_rate_and_acceleration_are_the_derivatives(name: str) -> None:
    motion = designed(name, 0).motion
    dt = motion.t[1]
    assert np.abs((motion.q[2:] - motion.q[:-2]) / (2 * dt) - motion.v[1:-1]).max() < 1e-4
    assert np.abs((motion.v[2:] - motion.v[:-2]) / (2 * dt) - motion.a[1:-1]).max() < 1e-3


@pytest.mark.parametrize("name", RIGS)
def test_much_better_than_random_motions_within_the_same_limits(name: str) -> None:
    rig = Rig.load(name)
    rng = np.random.default_rng(5)
    at = problem(rig)
    grid = replace(at, per_period=48).coarse
    chance = [
        at.columns.compute_condition_number(at.motion(at.draw_start(rng), grid)) for _ in range(10)
    ]
    assert designed(name, 0).condition_number < 0.7 * min(chance)


@pytest.mark.parametrize("name", RIGS)
def test_friction_shows_on_both_sides_of_standstill(name: str) -> None:
    rig = Rig.load(name)
    v = designed(name, 0).motion.v
    fast = 0.3 * np.array([limit.velocity for limit in rig.limits])
    for side in (v, -v):
        assert (np.mean(side > 0, axis=0) > 0.25).all()
        assert (side.max(axis=0) > fast).all()


def test_same_seed_same_motion() -> None:
    again = excite(Rig.load("turret"), starts=1, rng=np.random.default_rng(1))
    assert np.array_equal(again.coefficients, designed("turret", 1).coefficients)
    assert not np.array_equal(again.coefficients, designed("turret", 0).coefficients)


def test_each_criterion_is_best_by_its_own_measure() -> None:
    rig = Rig.load("turret")
    determinant = Determinant()
    by_condition = designed("turret", 0)
    by_determinant = excite(rig, starts=1, rng=np.random.default_rng(0), criterion=determinant)
    columns = ExcitationColumns.of(rig)

    def information(found: Excitation) -> float:
        return determinant.value(columns.scale_rows(found.motion))

    assert information(by_determinant) < information(by_condition)
    assert by_condition.condition_number < by_determinant.condition_number


def test_json_has_the_contracts_keys() -> None:
    found = designed("thesis", 0)
    read = json.loads(json.dumps(found.to_dict()))
    assert {"schema", "criterion", "condition_number", "seconds", "limits_used"} <= read.keys()
    assert list(read["limits_used"]) == ["yaw", "roll", "tilt"]
    assert all(list(used) == ["q", "dq", "ddq", "tau"] for used in read["limits_used"].values())


# limits that bind, are missing, or cannot be kept


def test_pendulum_is_kept_within_its_torque() -> None:
    rig = pendulum()
    found = excite(rig, starts=1, rng=np.random.default_rng(0))
    assert_within(rig, nominal(rig), found, margin=0.05)
    assert found.limits_used["shoulder"]["tau"] == pytest.approx(0.95, abs=0.01)
    assert found.limits_used["shoulder"]["ddq"] == 0.0
    assert found.condition_number < 10


def test_torque_limit_counts_the_friction_of_the_model_given() -> None:
    rig = moved(Rig.load("turret"), effort=1.0, acceleration=inf, velocity=100.0)
    stiff = Model(rig, (*nominal(rig).terms, Term(Coulomb("pan"), (0.4,))))
    options = {"starts": 1, "harmonics": 4, "seconds": 4.0, "speed": 0.0}
    found = excite(rig, rng=np.random.default_rng(0), torque_model=stiff, **options)
    assert_within(rig, stiff, found, margin=0.05)
    assert max(used["tau"] for used in found.limits_used.values()) == pytest.approx(0.95, abs=0.01)
    light = excite(rig, rng=np.random.default_rng(0), **options)
    heavy = np.abs(stiff.inverse(light.motion.q, light.motion.v, light.motion.a)).max(axis=0)
    assert (heavy > 0.95 * rig.tau_max).any()


def test_joint_without_angle_limits_turns_at_most_half_a_turn_either_way() -> None:
    rig = replace(Rig.load("turret"), limits=(Limits(effort=4.0, velocity=3.0),) * 2)
    found = excite(rig, starts=1, rng=np.random.default_rng(0))
    assert np.abs(found.motion.q).max() <= np.pi
    assert all(used["dq"] > 0.2 and used["ddq"] == 0 for used in found.limits_used.values())


@pytest.mark.parametrize("stated", [0, 5e4])
def test_limits_that_nobody_states_are_assumed_and_said(
    run: Run, tmp_path: Path, stated: float
) -> None:
    """No point then moves faster than people may stand beside; with one's own limits nothing is assumed."""
    source = Rig.load("turret").urdf
    (tmp_path / "turret.urdf").write_text(
        re.sub(r'(velocity|effort)="[^"]*"', rf'\1="{stated:g}"', source)
    )
    excited = ("excite", tmp_path / "turret.urdf", "--starts", 1, "-o")
    guessed = result(run, *excited, tmp_path / "out.csv")["assumed"]
    rates = {one["joint"]: one["value"] for one in guessed if one["quantity"] == "velocity"}
    assert {one["quantity"] for one in guessed} == {"velocity", "acceleration", "lower", "upper"}
    assert {one["stated"] for one in guessed if one["quantity"] == "velocity"} == {stated or None}
    rig = Rig.load(tmp_path / "turret.urdf")
    assert rates.keys() == set(rig.joints)
    assert np.array(list(rates.values())) @ compute_joint_reach(rig) == pytest.approx(0.25)
    motion = read_motion(tmp_path / "out.csv", rig)
    assert (
        np.abs(motion.q).max() <= 0.25
        and (np.abs(motion.v).max(axis=0) <= list(rates.values())).all()
    )
    said = run(*excited, tmp_path / "out.csv")[1]
    assert "assumed pan.velocity" in said and "--limit pan.velocity=NUMBER" in said
    limits = [
        f"--limit={joint}.{limit}" for joint in rig.joints for limit in ("velocity=1.5", "effort=4")
    ]
    assert not result(run, *excited, tmp_path / "out.csv", *limits)["assumed"]


def test_assuming_limits_twice_changes_nothing_and_stated_ones_stay() -> None:
    for name in RIGS:
        assert (
            assume_limits(Rig.load(name)) == (Rig.load(name), ())
            or not assume_limits(Rig.load(name))[1]
        )
    assumed, said = assume_limits(moved(Rig.load("thesis"), velocity=inf))
    assert len(said) > 2 and not assume_limits(assumed)[1]


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("effort", [None, 2.0])
def test_a_first_motion_is_the_same_at_a_tenth_and_pushes_with_a_tenth(
    name: str, effort: float | None
) -> None:
    rig = Rig.load(name)
    if (
        effort is not None
    ):  # the torque alone bounds the motion: with gravity's help it pushes with over one limit
        rig = moved(rig, effort=effort, acceleration=inf, velocity=50.0)
    full, first = (excite(rig, starts=1, rng=1, first=first) for first in (False, True))
    swing = np.ptp(first.motion.q, axis=0) / np.ptp(full.motion.q, axis=0)
    assert swing == pytest.approx(np.full(rig.n, 0.1), rel=1e-3)
    assert first.coefficients[0] == pytest.approx(full.coefficients[0])
    assert first.seconds >= full.seconds
    assert first.seconds > full.seconds or effort is None or name == "turret"
    motion = first.motion
    push = compute_rnea(rig, motion.q, motion.v, motion.a) - compute_gravity(rig, motion.q)
    push += motion.a * np.array([motor.armature for motor in rig.motors])
    assert (np.abs(push).max(axis=0) <= 0.1 * rig.tau_max).all()


@pytest.mark.parametrize(
    "limit", ["pan.velocity", "pan=2", "pan.speed=2", "roll.velocity=2", "pan.velocity=-1"]
)
def test_a_limit_that_is_none_is_named(run: Run, tmp_path: Path, limit: str) -> None:
    refused(
        run("excite", "turret", "-o", tmp_path / "out.csv", "--limit", limit), 2, f"--limit {limit}"
    )


def test_slide_with_limits_is_moved_within_them(tmp_path: Path) -> None:
    rig = crane(tmp_path)
    found = excite(rig, starts=1, rng=np.random.default_rng(0))
    assert_within(rig, nominal(rig), found, margin=0.05)
    assert found.limits_used["slide"]["q"] > 0.5


def test_slide_without_limits_is_named(tmp_path: Path) -> None:
    rig = replace(crane(tmp_path), limits=(Limits(), Limits()))
    with pytest.raises(UsageError, match="joint 'slide': slides without limits"):
        excite(rig, rng=np.random.default_rng(0))


def test_motors_that_cannot_hold_the_payload_are_named() -> None:
    rig = moved(Rig.load("thesis"), effort=0.01)
    with pytest.raises(
        UsageError, match=r"joint '\w+': no pose was found that the motors can hold"
    ):
        excite(rig, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"velocity": 0.0}, "velocity limit of 0"),
        ({"acceleration": 0.0}, "acceleration limit of 0"),
        ({"lower": 0.3, "upper": 0.3}, "travel of 0"),
        ({"effort": 0.0}, "torque limit of 0"),
    ],
)
def test_limits_that_leave_no_motion_are_named(changes: dict[str, float], what: str) -> None:
    with pytest.raises(UsageError, match=f"joint 'pan': has a {what}"):
        excite(moved(Rig.load("turret"), **changes), rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        ({"harmonics": 1}, "harmonics"),
        ({"seconds": 0.0}, "seconds"),
        ({"seconds": -3.0}, "seconds"),
        ({"dt": 0.0}, "dt"),
        ({"dt": 0.003}, "dt"),
        ({"starts": 0}, "starts"),
        ({"margin": 1.0}, "margin"),
        ({"margin": -0.1}, "margin"),
        ({"criterion": "best"}, "criterion"),
    ],
)
def test_arguments_out_of_range_are_named(arguments: dict[str, object], place: str) -> None:
    with pytest.raises(UsageError, match=f"^{place}"):
        excite(Rig.load("turret"), rng=np.random.default_rng(0), **arguments)


# length


def test_a_longer_motion_is_never_worse_than_the_usual_one() -> None:
    """With five harmonics whatever the length 20 s were two to four times worse; a long one repeats a shorter one."""
    rig = Rig.load("turret")
    usual = designed("turret", 0).condition_number
    for seconds, periods in ((20.0, 1), (24.0, 2)):
        found = excite(rig, seconds=seconds, starts=1, rng=np.random.default_rng(0), dt=0.01)
        assert found.condition_number <= usual and found.seconds == seconds
        assert found.seconds / found.series.seconds == pytest.approx(periods, rel=1e-12)
        assert found.motion.q[0] == pytest.approx(found.motion.q[-1], abs=1e-9)
        assert_within(rig, nominal(rig), found, 0.05)


@given(seconds=st.floats(0.5, 5000.0))
def test_a_motion_repeats_five_times_unless_its_periods_get_short(seconds: float) -> None:
    count = count_periods(seconds)
    assert count == 5 if seconds >= 20.0 else count == max(1, int(seconds / 4.0))
    series = Series.of(seconds, periods=count)
    assert series.seconds >= min(seconds, 4.0) * (1 - 1e-12)
    assert seconds / series.seconds / count == pytest.approx(
        round(seconds / series.seconds / count), rel=1e-12
    )


def test_the_default_motion_is_the_same_in_every_period_and_says_why(
    run: Run, tmp_path: Path
) -> None:
    path = tmp_path / "t.csv"
    found = result(run, "excite", "turret", "-o", path, "--starts", 1, "--rate", 100)
    q = read_motion(path, Rig.load("turret")).q
    rows = round(100 * found["period"])
    assert found["periods"] == 5 and len(q) == 5 * rows + 1
    for k in range(5):
        assert np.allclose(q[k * rows : (k + 1) * rows + 1], q[: rows + 1], atol=1e-9)
    said = run("excite", "turret", "-o", path, "--starts", 1, "--rate", 100)[1]
    assert "5 periods: what differs from one to the next is noise" in said
    alone = run(
        "excite", "turret", "-o", path, "--starts", 1, "--rate", 100, "--periods", 1, "--seconds", 5
    )[1]
    assert "too few repeats" in alone


@given(seconds=st.floats(0.5, 5000.0))
def test_the_highest_harmonic_has_half_a_hertz(seconds: float) -> None:
    series = Series.of(seconds)
    shorter = Series(seconds, 3)
    fastest = series.harmonics / series.seconds
    assert (
        fastest >= 0.5 * (1 - 1e-12)
        and (fastest <= 0.6 or series.harmonics == 5)
        and series.seconds <= 20.0
    )
    assert seconds / series.seconds == pytest.approx(round(seconds / series.seconds), rel=1e-12)
    assert Series.of(10.0) == Series(10.0, 5) and Series.of(seconds, 3) == shorter


# interruption


def test_interrupted_it_returns_the_best_so_far() -> None:
    rig = Rig.load("turret")
    calls = []

    class Interrupted:
        name = "interrupted"

        def value(self, a: Array) -> float:
            return Condition().value(a)

        def factors(self, a: Array) -> tuple[Array, Array]:
            calls.append(1)
            if len(calls) == 20:
                raise KeyboardInterrupt
            return Condition().factors(a)

    found = excite(rig, rng=np.random.default_rng(0), criterion=Interrupted())
    assert not found.finished
    assert_within(rig, nominal(rig), found, margin=0.05)
    first = problem(rig)
    start = first.motion(first.draw_start(np.random.default_rng(0)), first.dense)
    assert found.condition_number < ExcitationColumns.of(rig).compute_condition_number(start)


# criteria and columns


@given(seed=st.integers(0, 10_000), sharpness=st.floats(2.0, 200.0))
def test_smooth_condition_number_lies_just_above_the_true_one(seed: int, sharpness: float) -> None:
    a = np.random.default_rng(seed).standard_normal((30, 6)) * np.logspace(-2, 1, 6)
    true = np.log(np.linalg.cond(a))
    excess = Condition(sharpness).value(a) - true
    assert -1e-9 <= excess <= 2 * np.log(6) / sharpness + 1e-9


@given(seed=st.integers(0, 10_000))
def test_information_of_two_logs_adds_up(seed: int) -> None:
    first, second = np.random.default_rng(seed).standard_normal((2, 20, 4))
    before = Determinant(0.3)
    after = Determinant(before.information(first))
    assert after.value(second) == pytest.approx(before.value(np.vstack([first, second])))


def test_yardstick_does_not_depend_on_what_is_mounted() -> None:
    motion = designed("thesis", 0).motion
    rigs = [Rig.load("thesis", payload) for payload in ("none", "cinema", "infrared")]
    numbers = [ExcitationColumns.of(rig).compute_condition_number(motion) for rig in rigs]
    assert numbers == pytest.approx([numbers[0]] * 3, rel=1e-9)
    stated = designed(
        "thesis", 0
    ).condition_number  # on another grid: thirty reversals fall between its samples
    assert numbers[0] == pytest.approx(stated, rel=2e-3)


@pytest.mark.parametrize("name", RIGS)
def test_columns_have_unit_torque_over_the_rigs_states(name: str) -> None:
    rig = Rig.load(name)
    states = Envelope.of(rig).spread()
    unit = ExcitationColumns.of(rig).scale_rows(states)
    assert np.mean(unit**2, axis=0) == pytest.approx(np.ones(unit.shape[1]))


@given(seconds=st.floats(0.5, 100.0), harmonics=st.integers(2, 12), seed=st.integers(0, 1000))
def test_every_series_in_the_rest_basis_ends_at_rest(
    seconds: float, harmonics: int, seed: int
) -> None:
    series = Series(seconds, harmonics)
    assert series.rest.T @ series.rest == pytest.approx(np.eye(2 * harmonics - 1), abs=1e-12)
    coefficients = series.rest @ np.random.default_rng(seed).standard_normal((2 * harmonics - 1, 2))
    ends = series.motion(coefficients, np.array([0.0, seconds]))
    assert np.abs(ends.v).max() < 1e-9
    assert np.abs(ends.a).max() < 1e-9 * (2 * np.pi * harmonics / seconds + 1)
    assert ends.q[0] == pytest.approx(ends.q[1])


# what teaches most after earlier logs


def one_joint(rig: Rig, moving: int) -> Log:
    """A log in which one joint alone swings, the others standing."""
    t = 0.005 * np.arange(3001)
    q = np.zeros((len(t), rig.n))
    v = np.zeros((len(t), rig.n))
    q[:, moving], v[:, moving] = 0.5 * np.sin(1.7 * t), 0.85 * np.cos(1.7 * t)
    return Log("one joint", rig.joints, t, q, v, np.zeros_like(q))


def test_information_of_a_log_is_that_of_its_motion() -> None:
    """The integral over the true motion, away from its reversals and from the ends, where the filters settle."""
    rig = Rig.load("turret")
    log = one_joint(rig, 0)
    columns = ExcitationColumns.of(rig)
    ends = compute_settling_time(Filtering())
    moving = (np.abs(log.v[:, 0]) > 0.1) & (log.t > ends) & (log.t < log.t[-1] - ends)
    a = np.zeros_like(log.q)
    a[:, 0] = -0.5 * 1.7**2 * np.sin(1.7 * log.t)
    motion = Motion(log.t, log.q, np.asarray(log.v), a)
    rows = columns.scale_rows(motion).reshape(-1, rig.n, len(columns.scale))[:, 0] * moving[:, None]
    viscous = len(columns.places) + 1
    found = columns.compute_information([log])
    assert found[viscous, viscous] == pytest.approx(
        0.005 * rows[:, viscous] @ rows[:, viscous], rel=0.03
    )
    np.testing.assert_allclose(columns.compute_information([log, log]), 2 * found, rtol=1e-12)


def test_the_next_motion_teaches_what_the_earlier_log_left_open() -> None:
    """After a log of the pan alone the motion adds more information than one that knows of no log."""
    rig = Rig.load("turret")
    criterion = build_criterion_after_logs(rig, [one_joint(rig, 0)], 8.0)
    options = {"seconds": 8.0, "starts": 8, "dt": 0.01}
    found = excite(rig, criterion=criterion, rng=np.random.default_rng(0), **options)  # type: ignore[arg-type]
    blind = excite(rig, criterion="condition", rng=np.random.default_rng(0), **options)  # type: ignore[arg-type]
    columns = ExcitationColumns.of(rig)
    values = [criterion.value(columns.scale_rows(x.motion)) for x in (found, blind)]
    assert values[0] < values[1]
    assert found.criterion == "determinant" and "narrowed" not in found.to_dict()


@given(st.integers(0, 1000))
def test_gradient_with_prior_information_and_sampling(seed: int) -> None:
    """Its factors are its derivative, and rows that are given twice, for half the time each, count once."""
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((12, 3))
    change = rng.standard_normal((12, 3))
    root = rng.standard_normal((5, 3))
    criterion = Determinant(root.T @ root, 4.0)
    left, right = criterion.factors(a)
    slope = (criterion.value(a + 1e-6 * change) - criterion.value(a - 1e-6 * change)) / 2e-6
    assert np.sum(left * (change @ right.T)) == pytest.approx(slope, rel=1e-5, abs=1e-7)
    assert criterion.value(np.vstack([a, a])) == pytest.approx(criterion.value(a), rel=1e-12)


# the regressor's derivative


def branched(folder: Path) -> Rig:
    """A slide that carries two swinging arms, one with a wrist: a tree, not a chain."""
    text = SLIDER.replace("</robot>", "")
    for name, parent, axis in (("left", "cart", "0.6 0 0.8"), ("hand", "boom", "1 0 0")):
        text += f"""<link name="{name}"><inertial><origin xyz="0.1 0.05 0"/><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="to_{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/><origin xyz="0.1 0.2 0.3"
rpy="0.3 -0.2 0.5"/><axis xyz="{axis}"/><limit lower="-1" upper="1" effort="5" velocity="4"/></joint>"""
    path = folder / "tree.urdf"
    path.write_text(text + "</robot>")
    return Rig.load(path)


@pytest.mark.parametrize("which", [*RIGS, "tree"])
def test_gradient_of_the_regressor_is_exact_on_chains_and_trees(which: str, tmp_path: Path) -> None:
    rig = branched(tmp_path) if which == "tree" else Rig.load(which)
    rng = np.random.default_rng(0)
    count = 5
    states = rng.standard_normal((3, count, rig.n))
    weights = rng.standard_normal((count, rig.n, 10 * rig.n))
    by_body = weights.reshape(count, rig.n, rig.n, 10).transpose(2, 3, 1, 0)
    links = build_links(rig.model)
    gravity = rig.model.gravity.linear
    exact = compute_regressor_gradient(links, gravity, Motion(np.zeros(count), *states), by_body)

    def total(flat: Array) -> Array:
        return np.sum(weights * compute_regressor(rig, *flat.reshape(states.shape)))

    rough = differences(total, states.ravel()).reshape(states.shape)
    assert np.abs(exact - rough).max() < 1e-7 * np.abs(rough).max()


# a speed that shows friction


def test_speed_target_is_reached_and_its_gradient_exact() -> None:
    rig = Rig.load("handheld")
    at = replace(problem(rig), speed=0.9)
    x = at.draw_start(np.random.default_rng(0))
    rough = differences(lambda x: at.evaluate(x)[0], x)
    assert np.abs(at.evaluate(x)[1] - rough).max() < 1e-5 * np.abs(rough).max()
    usual = designed("handheld", 0).speed
    found = excite(rig, starts=1, rng=np.random.default_rng(0), speed=0.6)
    for joint, limit in zip(rig.joints, rig.limits):
        assert usual[joint] < 0.9 * 0.6 * limit.velocity
        assert found.speed[joint] > 0.92 * 0.6 * limit.velocity


# a real Ctrl-C, on a terminal


def test_ctrl_c_writes_the_best_so_far_and_a_bar_is_shown(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    arguments = [
        "excite",
        "turret",
        "-o",
        str(tmp_path / "t.csv"),
        "--json",
        str(tmp_path / "j.json"),
    ]
    arguments += ["--starts", "30", "--seconds", "4", "--harmonics", "3"]
    command = [sys.executable, "-m", "gimbal_pin.cli", *arguments]
    fcntl.ioctl(
        theirs, termios.TIOCSWINSZ, struct.pack("4H", 24, 100, 0, 0)
    )  # a new terminal has no size
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=theirs, text=True, preexec_fn=heard
    ) as running:
        shown = b""
        last = monotonic() + 120
        asked = False
        while (
            running.poll() is None and monotonic() < last
        ):  # a terminal that nobody reads stops who writes to it
            if select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 1000)
            if (
                re.search(rb"excitation: +[1-9]", shown) and not asked
            ):  # a bar may pass over one per cent
                running.send_signal(signal.SIGINT)
                asked = True
        running.kill()
        assert running.stdout is not None
        said = running.stdout.read()
    assert b"descent/s" in shown
    os.close(ours)
    os.close(theirs)
    assert running.returncode == 0
    assert "interrupted: this is the best it had found" in said
    assert json.loads((tmp_path / "j.json").read_text())["finished"] is False
    assert len((tmp_path / "t.csv").read_text().splitlines()) == 4_002


@pytest.mark.parametrize(
    "name", sorted(name for name, kind in CAUSES.items() if not issubclass(kind, Effect))
)
def test_a_cause_that_no_motion_is_designed_for_says_what_shows_it(name: str) -> None:
    """A drive, or a body: the refusal names the excitation that shows it, and who plants it."""
    kind = CAUSES[name]
    values = ",".join(f"{p.name}={max(p.lower, min(p.upper, 0.01)):g}" for p in kind.stated())
    asked = f"{name}:{'pan:' if kind.of_joint else ''}{values}"
    with pytest.raises(UsageError, match="'simulate --effect' plants it") as refused:
        list_shown_effects(nominal(Rig.load("turret")), [asked])
    assert kind.experiment in str(refused.value) and name in refused.value.place
