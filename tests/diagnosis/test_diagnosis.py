"""Laws of the diagnosis: noise is not named, what is planted is found with its size, what cannot be told is said so."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import LISTED, diagnose
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import Sample, TorqueTable, parse_effect
from gimbal_pin.errors import DataError
from gimbal_pin.identification import identify, read_model
from gimbal_pin.log import Array, Log
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed
from tests.diagnosis.cases import CASES, detent, few, found, log_of, notch, push
from tests.refitted import ALIGNED, RIG, record
from tests.rigs import spelled

HIDING = [name for name, case in CASES.items() if case.planted]
FEW = ("cogging", "stribeck", "torque-bias", "cable-spring")
FOREIGN = ("saturation", "delay", *FEW)


@pytest.mark.parametrize("case", CASES)
def test_what_is_planted_is_found_and_nothing_else(case: str) -> None:
    """The right name, or a class that holds it; its figures within four deviations or a tenth."""
    said = found(case)
    planted = dict(text.rsplit(":", 1) for text in CASES[case].planted)
    assert said.verdict == CASES[case].verdict and len(said.findings) == len(planted)
    for place, figures in planted.items():
        name, _, joint = place.partition(":")
        (one,) = (x for x in said.findings if (x.joint or "") == joint and name in x.alike)
        told = {p.name: p for p in one.parameters if one.cause == name}
        for key, value in (pair.split("=") for pair in figures.split(",") if told):
            true = float(value)
            away = abs(told[key].value - true)
            assert away < max(4 * np.nan_to_num(told[key].std), 0.1 * true)


@pytest.mark.parametrize("case", HIDING)
def test_a_finding_explains_torque_that_no_fit_has_seen(case: str) -> None:
    said = found(case)
    for one in said.findings:
        assert one.gain["torque_rmse_after"] < 0.8 * one.gain["torque_rmse_before"]
        assert one.gain["rollout_rmse_after"] < 1.05 * one.gain["rollout_rmse_before"]
        assert one.false_alarm < 1e-3 and 0 < one.visible_fraction <= 1
    shares = [one.explained_share for one in said.findings]
    assert shares == sorted(shares, reverse=True)
    assert not any(opinion.is_open for opinion in said.opinions.values())
    assert json.loads(json.dumps(said.to_dict()))["verdict"] == said.verdict


def test_nothing_is_extended_where_nothing_is_found() -> None:
    said = found("nothing")
    assert not said.is_extended and said.baseline == said.extended
    assert said.candidate is None and not said.unexplained
    assert all(0 < limit < 0.05 for limit in said.detection_limit.values())


def test_probabilities_of_findings_and_rivals_are_of_one() -> None:
    """Rivals are the nearest of each other name, in order."""
    said = found("teeth and breakaway")
    for one in said.findings:
        names = [rival.cause for rival in one.rivals]
        assert names and len({one.cause, *names}) == len(names) + 1
        assert np.all(np.diff([rival.log_odds for rival in one.rivals]) <= 0)
        total = sum(chance for *_, chance in one.probabilities)
        assert one.probability <= total <= LISTED * (1 + 1e-12)
    first = said.findings[0]
    assert first.status == "named" and first.probability > 0.95 * LISTED
    listed = said.to_dict()["causes"]
    assert listed[0]["probability"] == max(one.probability for one in said.findings)


@pytest.mark.parametrize("case", ["teeth and breakaway", "cable", "delay", "detent"])
def test_the_extended_model_is_read_as_it_was_written(case: str, tmp_path: Path) -> None:
    said = detent() if case == "detent" else found(case)
    said.save(tmp_path / "extended.yaml")
    again = read_model(tmp_path / "extended.yaml", said.after.rig)
    assert again.terms == said.after.terms and again.drive == said.after.drive
    assert again.estimated is not None and said.after.estimated is not None
    np.testing.assert_allclose(again.estimated.covariance, said.after.estimated.covariance)


# what no rig knows of: the unit, and how loud a sensor is


def test_the_unit_of_torque_changes_no_finding() -> None:
    log = log_of("ripple")
    other = diagnose(RIG, replace(log, tau=8.0 * np.asarray(log.tau)), few(*CASES["ripple"].causes))
    (one,) = found("ripple").findings
    (scaled,) = other.findings
    assert (scaled.cause, scaled.joint, scaled.status) == (one.cause, one.joint, one.status)
    values = [[p.value for p in x.parameters] for x in (one, scaled)]
    np.testing.assert_allclose(*values, rtol=0.01, atol=0.01)
    for joint, limit in found("ripple").detection_limit.items():
        assert other.detection_limit[joint] == pytest.approx(8.0 * limit, rel=0.05)


def test_more_noise_makes_nobody_surer() -> None:
    """Names go, and none come; deviations and what would be found grow."""
    log = log_of("ripple")
    causes = few(*CASES["ripple"].causes)
    noise = np.random.default_rng(9).standard_normal(log.q.shape)
    logs = [replace(log, tau=log.tau + size * noise) for size in (0.02, 0.5)]
    said = [found("ripple"), *(diagnose(RIG, one, causes) for one in logs)]
    named = [{(one.cause, one.joint) for one in each.findings} for each in said]
    assert named[0] == named[1] == {("torque-ripple", "tilt")} and not named[2]
    sizes = [each.findings[0].parameters[0].std for each in said[:2]]
    assert sizes[1] > sizes[0]
    limits = [list(each.detection_limit.values()) for each in said]
    assert np.all(np.diff(limits, axis=0) > 0)


# what cannot be told


def hum(log: Log) -> Array:
    """A tone that has nothing to do with the motion."""
    return np.asarray(0.1 * np.std(np.asarray(log.tau)[:, 0]) * np.sin(46.0 * log.t))


def slosh(log: Log) -> Array:
    """A resonance that wanders."""
    return np.asarray(0.3 * np.sin(2 * np.pi * 3.1 * log.t + 4 * np.sin(0.7 * log.t)))


def jumps(log: Log) -> Array:
    """A torque that jumps at times of its own, with some of every harmonic."""
    times = np.cumsum(np.random.default_rng(0).exponential(0.4, 200))
    return np.asarray(0.1 * (-1.0) ** np.searchsorted(times, log.t))


def walk(log: Log) -> Array:
    """A torque that wanders at random."""
    steps = np.cumsum(np.random.default_rng(0).standard_normal(len(log)))
    return np.asarray(1.5 * np.std(np.asarray(log.tau)[:, 0]) / np.std(steps) * steps)


@pytest.mark.parametrize(
    ("foreign", "verdict"),
    [(hum, "nothing"), (slosh, "nothing"), (jumps, "nothing"), (walk, "unknown")],
)
def test_what_the_library_does_not_have_gets_no_name_of_it(
    foreign: Callable[[Log], Array], verdict: str
) -> None:
    log = log_of("nothing")
    said = diagnose(RIG, push(log, foreign(log)), few(*FOREIGN))
    assert not said.findings and said.verdict == verdict
    assert said.unexplained == (["pan"] if verdict == "unknown" else [])
    assert said.residual["tilt"].state == "noise"
    near = said.candidate
    assert near is None or near.after < near.before


def table(angles: Array) -> Array:
    """What the extended model of the detent has at some angles."""
    (term,) = (x for x in detent().after.terms if isinstance(x.effect, TorqueTable))
    zero = np.zeros(len(angles))
    return np.asarray(term.torque(Sample(zero, angles, zero, zero, zero, zero)))


def test_a_detent_has_no_name_and_its_curve_lies_within_its_band() -> None:
    """Where the log did not go the table says nothing."""
    curve = detent().residual["pan"].curve
    assert detent().verdict == "unknown" and curve is not None and curve.over == "angle"
    knots = np.array(curve.knots)
    size = np.array(curve.torque)
    assert knots[np.argmax(np.abs(size))] == pytest.approx(np.radians(15), abs=0.05)
    assert any(low < np.radians(15) < high for low, high in curve.acts)
    assert np.mean(np.abs(size - notch(knots)) < 2 * np.array(curve.std)) > 0.85
    assert detent().residual["tilt"].curve is None
    before, after = (x["torque_rmse"]["pan"] for x in (detent().baseline, detent().extended))
    assert after < 0.8 * before
    np.testing.assert_allclose(table(knots), size)
    step = knots[1] - knots[0]
    assert not table(np.array([knots[0] - step, knots[-1] + step, -9.0, 9.0])).any()


def test_one_weak_motor_is_told_and_not_all_others_at_the_reciprocal() -> None:
    """``g`` at one joint and ``1/g`` at all others are the same log: the fewest are told."""
    rig = Rig.load("thesis")
    plant = plant_with(nominal(rig), [parse_effect("torque-gain:tilt:gain=0.8", rig)]).plant
    log = record(plant, 0, noise=0.01, dt=4e-3)
    said = diagnose(rig, log, few("torque-gain", "armature"), filtering=ALIGNED)
    assert [(one.cause, one.joint) for one in said.findings] == [("torque-gain", "tilt")]
    assert said.findings[0].parameters[0].value == pytest.approx(0.8, abs=0.01)
    assert said.after.lags == {}, "the alignment was stated"


TWO_LINKS = """<mujoco><worldbody><body name="upper">
<inertial pos="0 0 0.05" mass="1" diaginertia="0.01 0.01 0.005"/>
<joint name="shoulder" axis="0 1 0" damping="0.6"/><body name="lower" pos="0 0 0.1">
<inertial pos="0 0 0.05" mass="0.6" diaginertia="0.006 0.006 0.003"/>
<joint name="elbow" axis="0 1 0" armature="{}" damping="0.4"/></body></body></worldbody></mujoco>"""
"""The elbow's bodies act at the shoulder, too, and its rotor does not."""


@pytest.mark.parametrize("stated", [0.2, 0.0])
def test_a_rotor_is_found_unless_it_is_stated(stated: float) -> None:
    """Until it is found its joint is not explained, and `identify` names the verb that finds it."""
    rig, given = (spelled(TWO_LINKS.format(rotor)) for rotor in (0.2, stated))
    log = record(nominal(rig), dt=4e-3)
    said = diagnose(given, log, few("armature", "stribeck"), filtering=ALIGNED)
    assert said.verdict == ("nothing" if stated else "named")
    sizes = {(one.cause, one.joint): one.parameters[0].value for one in said.findings}
    assert sizes == ({} if stated else {("armature", "elbow"): pytest.approx(0.2, rel=0.01)})
    found = identify(given, log, filtering=EXACT)
    open_ = [joint for joint, opinion in found.opinions.items() if opinion.is_open]
    assert open_ == ([] if stated else ["elbow"])
    assert ("gimbal-pin diagnose" in found.warnings[0]) == (not stated)


# logs that cannot answer


def stopped(x: Array | None, joints: int) -> Array:
    """Channels of joints of which the first so many never moved."""
    out = np.array(x)
    out[:, :joints] = 0.0
    return out


@pytest.mark.parametrize("kind", ["one second", "one joint", "still", "torque of noise", "10 Hz"])
def test_a_log_that_cannot_answer_is_refused(kind: str) -> None:
    log = log_of("nothing")
    joints = {"one joint": 1, "still": 2}.get(kind, 0)
    log = replace(log, q=stopped(log.q, 0), v=stopped(log.v, 0))
    if joints:
        log = replace(log, q=stopped(log.q, joints), v=stopped(log.v, joints))
    if kind == "one second":
        log = log.part(slice(0, 200))
    if kind == "torque of noise":
        log = replace(log, tau=0.3 * np.random.default_rng(0).standard_normal(log.q.shape))
    if kind == "10 Hz":
        log = prescribed(nominal(RIG), 3, 20.0, dt=0.1)
    with pytest.raises(DataError):
        diagnose(RIG, log, few(*FEW))


def test_a_log_of_a_low_rate_is_diagnosed_in_a_band_that_it_has() -> None:
    log = prescribed(nominal(RIG), 3, 20.0, torque_noise=0.01, dt=1.0 / 30)
    said = diagnose(RIG, log, few("stribeck", "torque-bias"))
    assert not said.spoiling and not said.findings
    assert said.held is not None and said.held.band == pytest.approx(3.0)


@pytest.mark.parametrize("sizes", [(0.2, 0.2, 0.2), (0.2, 0.2, -0.2)])
def test_a_cause_is_the_same_in_every_log_of_one_rig(sizes: tuple[float, ...]) -> None:
    """A constant torque explains the logs of one rig together, and not those of a rig that was touched in between."""
    terms = [parse_effect(f"torque-bias:tilt:bias={x}", RIG) for x in sizes]
    logs = [
        record(plant_with(nominal(RIG), [term]).plant, k, noise=0.02, dt=4e-3)
        for k, term in enumerate(terms)
    ]
    said = diagnose(RIG, logs, few("torque-bias"), filtering=ALIGNED)
    named, spoilt = ([one.cause for one in part] for part in (said.findings, said.spoiling))
    same = len(set(sizes)) == 1
    assert (named, spoilt) == ((["torque-bias"], []) if same else ([], ["logs-disagree"]))
    assert said.verdict == ("ambiguous" if same else "data")


def test_logs_of_different_payloads_are_a_fault_of_the_data() -> None:
    """Cameras swapped and not told, whichever log is held out."""
    rigs = [Rig.load("turret", payload) for payload in ("infrared", "infrared", "mirrorless")]
    logs = [
        replace(record(nominal(rig), k, 12.0, dt=4e-3), name=f"{k}.csv")
        for k, rig in enumerate(rigs)
    ]
    said = diagnose(RIG, logs, few("cable-spring", "base-tilt"), filtering=ALIGNED)
    assert said.verdict == "data" and not said.findings
    assert [fault.cause for fault in said.spoiling] == ["logs-disagree"]
