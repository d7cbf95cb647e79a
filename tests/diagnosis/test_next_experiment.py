"""Laws of the next experiment: it parts what was ambiguous, as far as promised, and knows what no motion parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimbal_pin.diagnosis import (
    DIAGNOSIS_BAND,
    Diagnosis,
    NextExperiment,
    Rival,
    diagnose,
    next_experiment,
    planned,
    solve_causes,
    write_diagnosis,
)
from gimbal_pin.diagnosis.next_experiment import Contest, build_contest, imagined
from gimbal_pin.diagnosis.parting import SURE, Apart, Parting
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import CAUSES, Backlash, Cause, JointFlexibility, parse_effect
from gimbal_pin.excitation import Envelope
from gimbal_pin.log import Array, Log, Motion, read_motion
from gimbal_pin.rig import Rig

DT, SECONDS = 0.005, 30.0


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


def few(*names: str) -> Mapping[str, type[Cause]]:
    return {name: CAUSES[name] for name in names}


def small(travel: float, seconds: float = 18.0) -> Motion:
    """Two joints to and fro over a part of their travel, at two incommensurable rates."""
    t = DT * np.arange(round(seconds / DT) + 1)
    size = travel / 4 * np.array([1.0, 0.7])
    slow = np.array([1.38, 2.28])
    fast = np.array([2.62, 3.2])
    q, v, a = (np.zeros((len(t), 2)) for _ in range(3))
    for w in (slow, fast):
        q += size * np.sin(np.outer(t, w))
        v += size * w * np.cos(np.outer(t, w))
        a -= size * w**2 * np.sin(np.outer(t, w))
    return Motion(t, q, v, a)


def recorded(rig: Rig, motion: Motion, planted: str, seed: int) -> Log:
    """A log of the motion on a rig that hides a cause; sensors whose noise does not depend on the motion."""
    plant = plant_with(nominal(rig), [parse_effect(planted, rig)]).plant
    rng = np.random.default_rng(seed)
    shape = motion.q.shape
    q, v = (x + std * rng.standard_normal(shape) for x, std in ((motion.q, 1e-5), (motion.v, 1e-3)))
    tau = plant.inverse(motion.q, motion.v, motion.a, t=motion.t) + 3e-3 * rng.standard_normal(
        shape
    )
    return Log(f"log {seed}", rig.joints, motion.t, q, v, tau)


def said(rig: Rig, logs: list[Log], causes: Mapping[str, type[Cause]]) -> Diagnosis:
    band = replace(DIAGNOSIS_BAND, alignment=0.0)  # the torque is that of the sample itself
    return diagnose(
        rig, logs, causes, rng=np.random.default_rng(1), holdout="last-third", filtering=band
    )


def designed(
    found: Diagnosis, causes: Mapping[str, type[Cause]], tries: int = 10
) -> NextExperiment:
    plan = next_experiment(
        found, causes, rng=np.random.default_rng(3), seconds=SECONDS, tries=tries, dt=DT
    )
    assert plan is not None
    return plan


AMBIGUOUS = {
    "cogging:pan:amplitude=0.05,harmonic=3": ("cogging", "cable-spring", 0.4),
    "stribeck:pan:extra=0.03,speed=0.2": ("stribeck", "quadratic-drag", 0.6),
    "quadratic-drag:pan:drag=0.02": ("quadratic-drag", "stribeck", 0.94),
}


@cache
def begun(planted: str) -> tuple[Log, Diagnosis]:
    """The first log of a rig that hides one of `AMBIGUOUS`, and what it says."""
    rig = Rig.load("turret")
    (name, rival, travel) = AMBIGUOUS[planted]
    log = recorded(rig, small(travel), planted, 0)
    return log, said(rig, [log], few(name, rival))


@cache
def follows(planted: str) -> NextExperiment:
    """The experiment designed on that first log."""
    return designed(begun(planted)[1], few(*AMBIGUOUS[planted][:2]))


@pytest.mark.parametrize("planted", AMBIGUOUS)
def test_the_next_experiment_parts_what_was_ambiguous(rig: Rig, planted: str) -> None:
    """Ambiguous on a first log, named with the next one, as is promised: one pair by its range, two by their odds."""
    name, rival, _ = AMBIGUOUS[planted]
    causes = few(name, rival)
    (first, before) = begun(planted)
    assert before.verdict == "ambiguous" and {name, rival} <= set(before.findings[0].alike)
    plan = follows(planted)
    promised = next(p for p in plan.partings if {p.cause, p.rival} == {name, rival})
    assert plan.motion is not None and promised.expected is not None
    assert (
        promised.expected.deviations > 3 * promised.now.deviations and promised.outcome == "named"
    )
    assert promised.now.probability < SURE <= promised.expected.probability
    after = said(rig, [first, recorded(rig, plan.motion, planted, 1)], causes)
    assert after.verdict == "named" and [(f.cause, f.joint) for f in after.findings] == [
        (name, planted.split(":")[1])
    ]
    assert planned(after, causes, rng=np.random.default_rng(0)).planned is None


def test_no_name_is_promised_where_the_joint_cannot_turn_far_enough(rig: Rig) -> None:
    """Once per turn or a spring: a joint that stops before one turn is over does not say."""
    causes = few("cogging", "cable-spring")
    found = said(rig, [recorded(rig, small(0.4), "cable-spring:pan:stiffness=0.05", 0)], causes)
    assert found.findings[0].cause == "cogging" and set(causes) <= set(found.findings[0].alike)
    (parting,) = designed(found, causes).partings
    assert (
        parting.outcome == "few"
        and parting.expected is not None
        and parting.expected.probability == 0.5
    )


@pytest.fixture(scope="module")
def ambiguous() -> Diagnosis:
    return begun("cogging:pan:amplitude=0.05,harmonic=3")[1]


@pytest.fixture(scope="module")
def plan() -> NextExperiment:
    return follows("cogging:pan:amplitude=0.05,harmonic=3")


def test_it_keeps_to_the_limits_and_to_rest(rig: Rig, plan: NextExperiment) -> None:
    motion = plan.motion
    assert motion is not None and plan.seconds == pytest.approx(SECONDS)
    assert Envelope.of(rig).find_largest_shares(nominal(rig), motion).max() <= 1 - 0.99 * 0.05
    for end in (0, -1):
        np.testing.assert_allclose([motion.v[end], motion.a[end]], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.gradient(motion.q, DT, axis=0)[1:-1], motion.v[1:-1], atol=1e-2)


def test_it_is_a_file_that_others_read(
    rig: Rig, ambiguous: Diagnosis, plan: NextExperiment, tmp_path
) -> None:  # type: ignore[no-untyped-def]
    files, _ = write_diagnosis(replace(ambiguous, planned=plan), tmp_path, "page")
    motion = read_motion(files["next experiment"], rig)
    np.testing.assert_allclose(motion.q, plan.motion.q if plan.motion else 0.0, atol=1e-12)
    assert "next experiment" not in write_diagnosis(ambiguous, tmp_path / "none", "page")[0]
    data = replace(ambiguous, planned=plan).to_dict()["next_experiment"]
    for what in ("deviations", "share", "probability"):
        assert data["partings"][0][f"{what}_expected"] > data["partings"][0][f"{what}_now"]


def test_more_rows_never_bring_two_causes_nearer(
    ambiguous: Diagnosis, plan: NextExperiment
) -> None:
    """A separation is the smallest sum of squares: rows are only ever added to it."""
    assert all(
        p.expected is None or p.expected.deviations >= p.now.deviations * (1 - 1e-9)
        for p in plan.partings
    )
    assert all(p.now.share <= 1 for p in plan.partings)


def test_an_interrupted_search_keeps_the_best_so_far(
    ambiguous: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: Iterator[int] = iter(range(100))

    expected = Contest.expected

    def interrupted(each: Contest, *at: Any) -> Apart:
        if next(calls) == 3:
            raise KeyboardInterrupt
        return expected(each, *at)

    monkeypatch.setattr(Contest, "expected", interrupted)
    plan = designed(ambiguous, few("cogging", "cable-spring"))
    assert plan.motion is not None and not plan.finished and "interrupted" in plan.lines[-1]


def test_no_motion_parts_a_bias_from_asymmetric_friction(rig: Rig) -> None:
    """They are one torque: no file, and a sentence that says so and what would part them."""
    causes = few("torque-bias", "asymmetric-friction")
    found = said(rig, [recorded(rig, small(1.0), "torque-bias:pan:bias=0.03", 4)], causes)
    assert found.verdict == "ambiguous"
    plan = designed(found, causes, tries=6)
    assert plan.motion is None and plan.seconds == 0.0
    assert [p.expected for p in plan.partings] == [None]
    assert (
        "one torque" not in plan.lines[0]
        and "holds at rest" in plan.lines[0]
        and len(plan.lines) == 1
    )
    assert (
        "can be the same torque in every motion that was tried; what else may part them"
        in plan.lines[0]
    )


def parted(rival: str, now: Apart, expected: Apart | None) -> Parting:
    return Parting("cogging", "pan", rival, now, expected, ("slow sweeps", f"what shows {rival}"))


def test_rivals_that_fare_alike_are_told_together() -> None:
    """One line for each thing that is to be said, with every figure; what is promised is rounded down."""
    far = Apart(12.0, 0.6, 0.9999, 1.0)
    near = Apart(1.4, 0.5, 0.52, 0.52)
    rivals = [("a", near, far), ("b", near, far), ("d", near, near), ("e", near, None)]
    lines = NextExperiment(("pan",), None, tuple(parted(*row) for row in rivals)).lines
    assert all(line.count("slow sweeps") <= 1 for line in lines)
    assert lines[
        0
    ] == "pan: cogging is 1.1 times as likely as a, b so far and, if it is there, " + (
        "at least 100 times with the next experiment, in 19 of 20 logs"
    )
    assert (
        "likely as d" in lines[1]
        and "too little to name it; try also slow sweeps; or what shows d" in lines[1]
    )
    assert "cogging and e can be the same" in lines[2] and len(lines) == 3


def test_a_motion_that_leaves_every_finding_a_rival_is_said_to_name_none() -> None:
    far = Apart(12.0, 0.6, SURE, 1.0)
    near = Apart(1.4, 0.5, 0.99 * SURE, 1.0)
    motion = small(1.0)
    for rest, named in ((far, True), (near, False)):
        rivals = (parted("a", near, far), parted("b", near, rest))
        (last,) = NextExperiment(("pan",), motion, rivals).lines[-1:]
        assert ("it names no cause, as each keeps a rival" in last) != named


@cache
def cogged() -> Diagnosis:
    """What a log of a cogging motor says."""
    log = recorded(Rig.load("turret"), small(0.8), "cogging:pan:amplitude=0.05,harmonic=3", 0)
    return said(Rig.load("turret"), [log], few("cogging"))


@pytest.mark.parametrize(
    "cause", [JointFlexibility("tilt", 30.0, 0.1, 0.3), Backlash("tilt", 1e-3, 1e-3, 0.25)]
)
def test_what_is_behind_the_motors_friction_is_imagined_on_another_motion(
    rig: Rig, cause: Cause
) -> None:
    """What the joint bears comes from the logs: a motion of another length has other rows than their fit."""
    found = cogged()
    assert found.state is not None
    state = solve_causes(found.state.problem, (*found.state.causes, cause), found.state)
    against = build_contest(state, cause, CAUSES["actuator-lag"], Rival("actuator-lag", 0.0, 0.0))
    assert against is not None
    after = against.expected(*imagined(state.problem, small(0.8, 9.0), nominal(rig)))
    assert np.isfinite(after).all() and after.deviations >= 0


def test_a_joint_bears_on_the_same_motion_imagined_what_it_bears_along_the_log() -> None:
    """The logs' fit asked on the logs' own rows and torque: nothing is lost by way of the imagination."""
    found = cogged()
    assert found.state is not None
    state = solve_causes(found.state.problem, found.state.causes, found.state)
    asked: list[Array] = [x - y for x, y in zip(state.acting, state.unexplained)]
    again = replace(state, torque=asked, acting=asked, learned=state)
    for one, other in zip(state.bearing, again.bearing):
        np.testing.assert_allclose(other[0].load, one[0].load, atol=1e-9)
        np.testing.assert_allclose(other[0].brake, one[0].brake, atol=1e-9)


def test_a_joint_that_the_logs_hold_is_held_by_the_next_one(rig: Rig, tmp_path: Path) -> None:
    """What is planned for the joints that move is a motion of all: the whole rig plays it."""
    held = Rig.load("turret", fixed={"tilt": 0.1})
    both = small(0.4)
    alone = replace(both, **{name: getattr(both, name)[:, :1] for name in "qva"})
    causes = few("cogging", "cable-spring")
    found = said(held, [recorded(held, alone, "cogging:pan:amplitude=0.05,harmonic=3", 0)], causes)
    assert found.verdict == "ambiguous"
    files, _ = write_diagnosis(
        replace(found, planned=designed(found, causes, tries=4)), tmp_path, "page"
    )
    motion = read_motion(files["next experiment"], rig)
    assert (
        np.ptp(motion.q[:, 0]) > 0.1 and np.all(motion.q[:, 1] == 0.1) and not motion.v[:, 1].any()
    )
