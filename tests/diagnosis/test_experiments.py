"""Laws of logs to come: the next experiment separates what it promises; a rehearsal states sizes that are found."""

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
    plan_next_experiment,
    rehearse,
    write_diagnosis,
)
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import CAUSES, parse_effect
from gimbal_pin.log import Log, Motion, read_motion
from gimbal_pin.report.sections.experiment import describe_next_experiment
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier

RIG = Rig.load("turret")
DT = 0.005
SPRING = "cable-spring:pan:stiffness=0.05"
BIAS = "torque-bias:pan:bias=0.03"


def move(travel: float) -> Motion:
    """Return 18 s of two joints to and fro over a part of their travel, at two incommensurable rates."""
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
    tau = plant.inverse_dynamics(motion.q, motion.v, motion.a, t=motion.t)
    tau += draw[2] * (3e-3 if noise is None else noise * np.sqrt(np.mean(tau**2, axis=0)))
    q = motion.q + 1e-5 * draw[0]
    return Log(f"log {seed}", rig.joints, motion.t, q, motion.v + 1e-4 * draw[1], tau)


@cache
def begin(planted: str) -> Diagnosis:
    """Return the diagnosis of a first log of a rig that hides a cause."""
    return diagnose(RIG, record(move(1.0 if planted == BIAS else 0.4), planted, 0))


@cache
def follow(planted: str) -> NextExperiment:
    """Return the experiment designed on a first log."""
    return plan(begin(planted))


def plan(diagnosis: Diagnosis) -> NextExperiment:
    """Return the next experiment of a diagnosis."""
    rng = np.random.default_rng(3)
    planned = plan_next_experiment(diagnosis, rng, dt=DT).planned
    assert planned is not None
    return planned


# the next experiment


def test_the_next_experiment_names_what_was_ambiguous() -> None:
    """A spring that looks like cogging and a tilt on a first log is named on the log of the motion, as expected."""
    assert begin(SPRING).findings[0].alike[0] == "cable-spring"
    assert {"cogging"} < {*begin(SPRING).findings[0].alike}
    planned = follow(SPRING)
    assert planned.motion is not None and planned.finished
    assert {one.rival for one in planned.partings} == {*begin(SPRING).findings[0].alike[1:]}
    for one in planned.partings:
        assert one.nats_now is not None and one.nats_expected is not None
        assert one.is_named and one.nats_expected > 3 * one.nats_now
    after = diagnose(RIG, record(planned.motion, SPRING, 1))
    assert [(x.cause, x.joint, x.status) for x in after.findings] == [
        ("cable-spring", "pan", "named")
    ]
    assert plan_next_experiment(after, np.random.default_rng(0)).planned is None


def test_no_motion_separates_a_bias_from_asymmetric_friction() -> None:
    """They are one torque: no motion, and other experiments in its place."""
    assert begin(BIAS).verdict == "ambiguous"
    planned = follow(BIAS)
    assert planned.motion is None and planned.seconds == 0.0
    (one,) = planned.partings
    assert one.nats_expected is None and not one.is_named
    assert one.instead == tuple(CAUSES[name].experiment for name in (one.cause, one.rival))
    lines = describe_next_experiment(planned)
    assert len({*lines}) == len(lines) and all(len(line.split()) <= 25 for line in lines)


def test_no_motion_is_tried_where_one_cause_acts_on_the_command() -> None:
    (finding, *_) = begin(SPRING).findings
    drive = replace(finding, cause="delay", alike=("delay", "actuator-lag"))
    planned = plan(replace(begin(SPRING), findings=(drive,)))
    assert planned.motion is None and not planned.partings[0].is_tried
    assert "no motion was tried" in describe_next_experiment(planned)[0]


def test_the_next_experiment_is_a_file_that_holds_the_joints_that_the_logs_hold(
    tmp_path: Path,
) -> None:
    held = Rig.load("turret", fixed={"tilt": 0.1})
    both = move(0.2)
    alone = Motion(both.t, both.q[:, :1], both.v[:, :1], both.a[:, :1])
    found = diagnose(held, record(alone, SPRING, 0, rig=held))
    assert found.verdict == "ambiguous"
    files, _ = write_diagnosis(replace(found, planned=plan(found)), tmp_path, "page")
    motion = read_motion(files["next experiment"], RIG)
    assert np.ptp(motion.q[:, 0]) > 0.1
    assert np.all(motion.q[:, 1] == 0.1) and not motion.v[:, 1].any()
    assert "next experiment" not in write_diagnosis(found, tmp_path / "none", "page")[0]


# what a log shows


@cache
def nothing(noise: float) -> Diagnosis:
    """Return the diagnosis of a log that hides next to nothing."""
    return diagnose(RIG, record(MOTION, "torque-bias:pan:bias=1e-6", 1, noise=noise))


def test_the_detection_limit_is_found_and_grows_with_the_noise() -> None:
    """Cogging, of which the model explains nothing, is found at one and a half times the limit, not at a third."""
    quiet, loud = (nothing(noise).detection_limit for noise in (0.05, 0.2))
    assert nothing(0.05).verdict == "nothing"
    for joint in RIG.joints:
        assert 0 < quiet[joint] < loud[joint]
    for factor, count in ((1.5, 1), (1 / 3, 0)):
        amplitude = factor * np.sqrt(2) * loud["pan"]
        planted = f"cogging:pan:amplitude={amplitude},harmonic=9"
        found = diagnose(RIG, record(MOTION, planted, 2, noise=0.2))
        assert len(found.findings) == count


def test_a_cause_is_untestable_where_the_model_explains_all_of_it() -> None:
    """An upright axis hides where its encoder has its zero; a rotor is inertia; cogging is neither."""
    hidden = {(one.cause, one.joint): one.why for one in nothing(0.05).untestable}
    assert hidden["encoder-offset", "pan"] == CAUSES["encoder-offset"].hidden
    assert ("armature", "pan") in hidden
    assert not {"cogging", "stribeck"} & {cause for cause, _ in hidden}


# rehearsals

MOTION = fourier(RIG, 3, 20.0, DT)


@cache
def rehearsed() -> Rehearsal:
    """Rehearse a motion with torque noise of 1 %."""
    return rehearse(RIG, MOTION, torque_noise=0.01, rng=0)


def row(found: Rehearsal, cause: str) -> Rehearsed:
    """Return what is stated of a cause at the first joint."""
    (one,) = (one for one in found.causes if (one.cause, one.joint) == (cause, "pan"))
    return one


@pytest.mark.parametrize("cause", ["quadratic-drag", "torque-bias", "cogging"])
def test_a_log_shows_twice_what_is_stated_and_not_a_third_of_it(cause: str) -> None:
    seen = row(rehearsed(), cause).seen_from
    assert seen is not None
    name, joint, texts = seen.effect.split(":")
    figures = dict(text.split("=") for text in texts.split(","))
    for factor in (2.0, 1 / 3):
        figures[seen.parameter] = str(factor * seen.value)
        planted = ",".join(f"{key}={value}" for key, value in figures.items())
        found = diagnose(RIG, record(MOTION, f"{name}:{joint}:{planted}", 1, noise=0.01))
        if factor < 1:
            assert not found.findings
        else:
            (one,) = found.findings
            assert cause in one.alike and one.joint == "pan"


def test_a_log_names_a_cause_from_the_size_from_which_it_is_named() -> None:
    told = row(rehearsed(), "quadratic-drag")
    assert told.seen_from is not None and told.named_from is not None
    assert told.named_from.value > told.seen_from.value and told.confused_with
    drag = 1.2 * told.named_from.value
    found = diagnose(RIG, record(MOTION, f"quadratic-drag:pan:drag={drag}", 1, noise=0.01))
    assert [one.alike for one in found.findings] == [("quadratic-drag",)]


def test_causes_that_a_log_cannot_tell_apart_or_show_are_listed_beforehand() -> None:
    """A constant torque is friction that differs by direction; an upright axis hides where its encoder has its zero."""
    told = row(rehearsed(), "asymmetric-friction")
    assert told.seen_from is not None and told.named_from is None
    assert "torque-bias" in [one.cause for one in told.confused_with]
    hidden = row(rehearsed(), "encoder-offset")
    assert (hidden.seen_from, hidden.shown) == (None, 0)
    assert hidden.why == CAUSES["encoder-offset"].hidden


def test_every_size_is_an_effect_that_simulate_plants() -> None:
    shown = [one for one in rehearsed().causes if one.seen_from is not None]
    assert {"cogging", "stribeck", "base-tilt", "joint-flexibility"} < {one.cause for one in shown}
    for one in shown:
        for size in filter(None, (one.seen_from, one.named_from)):
            parse_effect(size.effect, RIG)
            assert 0 < size.share_of_torque <= 1
        assert one.forms >= one.shown > 0 and one.why is None
    assert all(one.why for one in rehearsed().causes if one.seen_from is None)
