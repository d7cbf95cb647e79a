"""Laws of the next experiment: it parts what was ambiguous, as far as promised, and knows what no motion parts."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import (
    Diagnosis,
    NextExperiment,
    diagnose,
    next_experiment,
    planned,
    write_diagnosis,
)
from gimbal_pin.diagnosis.parting import SURE
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.excitation import Envelope
from gimbal_pin.log import Log, Motion, read_motion
from gimbal_pin.rig import Rig
from tests.diagnosis.cases import DT, few
from tests.refitted import ALIGNED, RIG

COGGING = "cogging:pan:amplitude=0.05,harmonic=3"
PAIRS = {
    COGGING: ("cogging", "cable-spring", 0.4),
    "stribeck:pan:extra=0.03,speed=0.2": ("stribeck", "quadratic-drag", 0.6),
    "cable-spring:pan:stiffness=0.05": ("cogging", "cable-spring", 0.4),
    "torque-bias:pan:bias=0.03": ("torque-bias", "asymmetric-friction", 1.0),
}


def small(travel: float) -> Motion:
    """Two joints to and fro over a part of their travel, at two incommensurable rates."""
    t = DT * np.arange(3601)
    size = travel / 4 * np.array([1.0, 0.7])
    w = np.array([[1.38, 2.28], [2.62, 3.2]])[:, None]
    phase = t[:, None] * w
    q = np.sum(size * np.sin(phase), axis=0)
    v = np.sum(size * w * np.cos(phase), axis=0)
    return Motion(t, q, v, np.sum(-size * w**2 * np.sin(phase), axis=0))


def recorded(rig: Rig, motion: Motion, planted: str, seed: int) -> Log:
    """A log of the motion on a rig that hides a cause; sensors whose noise does not depend on the motion."""
    plant = plant_with(nominal(rig), [parse_effect(planted, rig)]).plant
    draw = np.random.default_rng(seed).standard_normal((3, *motion.q.shape))
    tau = plant.inverse(motion.q, motion.v, motion.a, t=motion.t) + 3e-3 * draw[2]
    q = motion.q + 1e-5 * draw[0]
    return Log(f"log {seed}", rig.joints, motion.t, q, motion.v + 1e-3 * draw[1], tau)


def said(logs: list[Log], planted: str, rig: Rig = RIG) -> Diagnosis:
    causes = few(*PAIRS[planted][:2])
    return diagnose(rig, logs, causes, holdout="last-third", filtering=ALIGNED)


@cache
def begun(planted: str) -> tuple[Log, Diagnosis]:
    """The first log of a rig that hides one of `PAIRS`, and what it says."""
    log = recorded(RIG, small(PAIRS[planted][2]), planted, 0)
    return log, said([log], planted)


def design(found: Diagnosis, planted: str) -> NextExperiment:
    causes = few(*PAIRS[planted][:2])
    plan = next_experiment(
        found, causes, rng=np.random.default_rng(3), seconds=30.0, tries=5, dt=DT
    )
    assert plan is not None
    return plan


@cache
def follows(planted: str) -> NextExperiment:
    """The experiment designed on that first log."""
    return design(begun(planted)[1], planted)


@pytest.mark.parametrize("planted", [*PAIRS][:2])
def test_the_next_experiment_parts_what_was_ambiguous(planted: str) -> None:
    """Ambiguous on a first log, named with the next one, as is promised."""
    name, rival, _ = PAIRS[planted]
    first, before = begun(planted)
    assert before.verdict == "ambiguous" and {name, rival} <= set(before.findings[0].alike)
    plan = follows(planted)
    (promised,) = (p for p in plan.partings if {p.cause, p.rival} == {name, rival})
    assert plan.motion is not None and promised.expected is not None
    assert promised.expected.deviations > 3 * promised.now.deviations
    assert promised.outcome == "named"
    assert promised.now.probability < SURE <= promised.expected.probability
    after = said([first, recorded(RIG, plan.motion, planted, 1)], planted)
    assert after.verdict == "named"
    assert [(one.cause, one.joint) for one in after.findings] == [(name, "pan")]
    assert planned(after, few(name, rival), rng=np.random.default_rng(0)).planned is None


def test_no_name_is_promised_where_the_joint_cannot_turn_far_enough() -> None:
    """Once per turn or a spring: a joint that stops before one turn is over does not say."""
    (parting,) = follows("cable-spring:pan:stiffness=0.05").partings
    assert parting.outcome == "few" and parting.expected is not None
    assert parting.expected.probability == 0.5


def test_no_motion_parts_a_bias_from_asymmetric_friction() -> None:
    """They are one torque: no motion, and a sentence that says so."""
    assert begun("torque-bias:pan:bias=0.03")[1].verdict == "ambiguous"
    plan = follows("torque-bias:pan:bias=0.03")
    assert plan.motion is None and plan.seconds == 0.0 and len(plan.lines) == 1
    assert [p.expected for p in plan.partings] == [None]


def test_it_keeps_to_the_limits_and_to_rest() -> None:
    """More rows never bring two causes nearer: a separation is the smallest sum of squares."""
    plan = follows(COGGING)
    motion = plan.motion
    assert motion is not None and plan.seconds == pytest.approx(30.0)
    assert Envelope.of(RIG).find_largest_shares(nominal(RIG), motion).max() <= 1 - 0.99 * 0.05
    for end in (0, -1):
        np.testing.assert_allclose([motion.v[end], motion.a[end]], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.gradient(motion.q, DT, axis=0)[1:-1], motion.v[1:-1], atol=1e-2)
    for p in plan.partings:
        assert p.now.share <= 1
        assert p.expected is None or p.expected.deviations >= p.now.deviations * (1 - 1e-9)


def test_it_is_a_file_that_others_read_and_holds_the_joints_that_the_logs_hold(
    tmp_path: Path,
) -> None:
    held = Rig.load("turret", fixed={"tilt": 0.1})
    alone = replace(small(0.4), **{name: getattr(small(0.4), name)[:, :1] for name in "qva"})
    found = said([recorded(held, alone, COGGING, 0)], COGGING, held)
    files, _ = write_diagnosis(replace(found, planned=design(found, COGGING)), tmp_path, "page")
    motion = read_motion(files["next experiment"], RIG)
    assert np.ptp(motion.q[:, 0]) > 0.1
    assert np.all(motion.q[:, 1] == 0.1) and not motion.v[:, 1].any()
    assert "next experiment" not in write_diagnosis(found, tmp_path / "none", "page")[0]
