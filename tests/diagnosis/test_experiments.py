"""Laws of what a log will show: the next experiment parts what it promises, a rehearsal says from what size on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import (
    Diagnosis,
    NextExperiment,
    Rehearsal,
    Rehearsed,
    diagnose,
    next_experiment,
    planned,
    rehearse,
    write_diagnosis,
)
from gimbal_pin.diagnosis.parting import SURE
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import CAUSES, parse_effect
from gimbal_pin.excitation import Envelope
from gimbal_pin.log import Log, Motion, read_motion
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.diagnosis.cases import DT, few
from tests.refitted import ALIGNED, RIG

TEETH = "cogging:pan:amplitude=0.05,harmonic=3"
SPRING = "cable-spring:pan:stiffness=0.05"
BIAS = "torque-bias:pan:bias=0.03"
PAIRS = {
    TEETH: ("cogging", "cable-spring"),
    SPRING: ("cogging", "cable-spring"),
    BIAS: ("torque-bias", "asymmetric-friction"),
}
KINDS = few(
    "torque-bias", "asymmetric-friction", "quadratic-drag", "cable-spring", "encoder-offset"
)


def move(travel: float) -> Motion:
    """Return two joints to and fro over a part of their travel, at two incommensurable rates."""
    t = DT * np.arange(3601)
    size = travel / 4 * np.array([1.0, 0.7])
    w = np.array([[1.38, 2.28], [2.62, 3.2]])[:, None]
    phase = t[:, None] * w
    q = np.sum(size * np.sin(phase), axis=0)
    v = np.sum(size * w * np.cos(phase), axis=0)
    return Motion(t, q, v, np.sum(-size * w**2 * np.sin(phase), axis=0))


def record(
    motion: Motion, planted: str, seed: int, noise: float | None = None, rig: Rig = RIG
) -> Log:
    """Return a log of a motion with a cause, and torque noise of 3 mN m or of a share of each joint's torque."""
    plant = plant_with(nominal(rig), [parse_effect(planted, rig)]).plant
    draw = np.random.default_rng(seed).standard_normal((3, *motion.q.shape))
    tau = plant.inverse(motion.q, motion.v, motion.a, t=motion.t)
    tau += draw[2] * (3e-3 if noise is None else noise * np.sqrt(np.mean(tau**2, axis=0)))
    q = motion.q + 1e-5 * draw[0]
    return Log(f"log {seed}", rig.joints, motion.t, q, motion.v + 1e-4 * draw[1], tau)


def tell(logs: list[Log], planted: str, rig: Rig = RIG) -> Diagnosis:
    """Diagnose logs among the causes of a pair."""
    causes = few(*PAIRS[planted])
    return diagnose(rig, logs, causes, holdout="last-third", filtering=ALIGNED)


@cache
def begin(planted: str) -> tuple[Log, Diagnosis]:
    """Return the first log of a rig that hides one of `PAIRS`, and what it says."""
    log = record(move(1.0 if planted == BIAS else 0.4), planted, 0)
    return log, tell([log], planted)


@cache
def follow(found: Diagnosis, planted: str) -> NextExperiment:
    """Return the experiment designed on a first log."""
    rng = np.random.default_rng(3)
    plan = next_experiment(found, few(*PAIRS[planted]), rng=rng, seconds=30.0, tries=5, dt=DT)
    assert plan is not None
    return plan


def test_the_next_experiment_parts_what_was_ambiguous() -> None:
    """Ambiguous on a first log, named with the next one, as is promised."""
    first, before = begin(TEETH)
    assert before.verdict == "ambiguous" and set(PAIRS[TEETH]) <= set(before.findings[0].alike)
    plan = follow(before, TEETH)
    (promised,) = (p for p in plan.partings if {p.cause, p.rival} == set(PAIRS[TEETH]))
    assert plan.motion is not None and promised.expected is not None
    assert promised.expected.deviations > 3 * promised.now.deviations
    assert promised.outcome == "named"
    assert promised.now.probability < SURE <= promised.expected.probability
    after = tell([first, record(plan.motion, TEETH, 1)], TEETH)
    assert after.verdict == "named"
    assert [(one.cause, one.joint) for one in after.findings] == [("cogging", "pan")]
    assert planned(after, few(*PAIRS[TEETH]), rng=np.random.default_rng(0)).planned is None


def test_no_name_is_promised_where_the_joint_cannot_turn_far_enough() -> None:
    """Once per turn or a spring: a joint that stops before one turn is over does not say."""
    (parting,) = follow(begin(SPRING)[1], SPRING).partings
    assert parting.outcome == "few" and parting.expected is not None
    assert parting.expected.probability == 0.5


def test_no_motion_parts_a_bias_from_asymmetric_friction() -> None:
    """They are one torque: no motion, and a sentence that says so."""
    assert begin(BIAS)[1].verdict == "ambiguous"
    plan = follow(begin(BIAS)[1], BIAS)
    assert plan.motion is None and plan.seconds == 0.0 and len(plan.lines) == 1
    assert [p.expected for p in plan.partings] == [None]


def test_the_next_experiment_keeps_to_the_limits_and_to_rest() -> None:
    """More rows never bring two causes nearer: a separation is the smallest sum of squares."""
    plan = follow(begin(TEETH)[1], TEETH)
    motion = plan.motion
    assert motion is not None and plan.seconds == pytest.approx(30.0)
    assert Envelope.of(RIG).find_largest_shares(nominal(RIG), motion).max() <= 1 - 0.99 * 0.05
    for end in (0, -1):
        np.testing.assert_allclose([motion.v[end], motion.a[end]], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.gradient(motion.q, DT, axis=0)[1:-1], motion.v[1:-1], atol=1e-2)
    for p in plan.partings:
        assert p.now.share <= 1
        assert p.expected is None or p.expected.deviations >= p.now.deviations * (1 - 1e-9)


def test_the_next_experiment_is_a_file_that_holds_the_joints_that_the_logs_hold(
    tmp_path: Path,
) -> None:
    held = Rig.load("turret", fixed={"tilt": 0.1})
    both = move(0.4)
    alone = Motion(both.t, both.q[:, :1], both.v[:, :1], both.a[:, :1])
    found = tell([record(alone, TEETH, 0, rig=held)], TEETH, held)
    files, _ = write_diagnosis(replace(found, planned=follow(found, TEETH)), tmp_path, "page")
    motion = read_motion(files["next experiment"], RIG)
    assert np.ptp(motion.q[:, 0]) > 0.1
    assert np.all(motion.q[:, 1] == 0.1) and not motion.v[:, 1].any()
    assert "next experiment" not in write_diagnosis(found, tmp_path / "none", "page")[0]


# rehearsals

MOTION = fourier(RIG, 3, 16.0, DT)


@cache
def rehearsed(noise: float = 0.01) -> Rehearsal:
    """Rehearse a motion with so much torque noise."""
    return rehearse(RIG, MOTION, KINDS, torque_noise=noise, rng=0)


def row(found: Rehearsal, cause: str) -> Rehearsed:
    """Return what is said of a cause at the first joint."""
    (one,) = (one for one in found.causes if (one.cause, one.joint) == (cause, "pan"))
    return one


@pytest.mark.parametrize(
    ("factor", "alike"), [(1 / 3, []), (2.0, [("quadratic-drag",)])], ids=["less", "more"]
)
def test_a_log_shows_twice_what_is_told_and_not_a_third_of_it(
    factor: float, alike: list[tuple[str, ...]]
) -> None:
    """It names it, too, from the size from which a cause alone is named."""
    told = row(rehearsed(), "quadratic-drag")
    assert told.seen_from is not None and told.named_from is not None
    size = told.named_from if alike else told.seen_from
    name, joint, figures = size.effect.split(":")
    drag = factor * float(figures.partition("=")[2])
    log = record(MOTION, f"{name}:{joint}:drag={drag}", 1, noise=0.01)
    found = diagnose(RIG, log, KINDS, filtering=ALIGNED)
    assert [one.alike for one in found.findings] == alike


def test_what_a_log_cannot_tell_apart_or_show_is_said_beforehand() -> None:
    """A constant torque is friction that differs by direction; an upright axis hides where its encoder has its zero."""
    told = row(rehearsed(), "asymmetric-friction")
    assert told.seen_from is not None and told.named_from is None
    assert "torque-bias" in [one.cause for one in told.confused_with]
    hidden = row(rehearsed(), "encoder-offset")
    assert (hidden.seen_from, hidden.shown) == (None, 0)
    assert hidden.why == CAUSES["encoder-offset"].hidden


def test_noise_hides_in_proportion() -> None:
    """Where noise and not an error of form is what hides a cause, twice the noise hides one twice as large."""
    less, more = (row(rehearsed(noise), "torque-bias").seen_from for noise in (0.05, 0.1))
    assert less is not None and more is not None
    assert 1.6 < more.share_of_torque / less.share_of_torque < 2.5


def test_every_size_is_an_effect_that_simulate_plants() -> None:
    shown = [one for one in rehearsed().causes if one.seen_from is not None]
    assert {one.cause for one in shown} == {*KINDS} - {"encoder-offset"}
    for one in shown:
        for size in filter(None, (one.seen_from, one.named_from)):
            parse_effect(size.effect, RIG)
            assert 0 < size.share_of_torque <= 1
        assert one.forms >= one.shown > 0 and one.why is None
