"""Laws of the diagnosis: what is planted is found with its size, what is foreign is unknown, and noise is not named."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.diagnosis.commands import DriveTest
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import CAUSES, Saturation, parse_effect
from gimbal_pin.errors import DataError
from gimbal_pin.identification import read_model
from gimbal_pin.log import Array, Log
from tests.bench_logs import prescribed
from tests.diagnosis.cases import TEETH, find, log_of, prescribe, push
from tests.refitted import ALIGNED, RIG, record
from tests.rigs import spelled

# what is planted

LATE = "delay:tilt:time=0.02"
PLANTED = (
    ("turret", *TEETH),
    (
        "turret",
        "position-dependent-friction:pan:amplitude=0.02,harmonic=3",
        "dead-zone:tilt:width=0.03",
    ),
    (
        "turret",
        "friction-drift:pan:coulomb=0.1,span=8",
        "torque-ripple:tilt:amplitude=0.15,harmonic=9",
    ),
    ("turret", "saturation:pan:limit=0.45", "load-dependent-friction:tilt:mu=0.2"),
    ("turret", "presliding:pan:stroke=0.05,level=0.06", "torque-bias:tilt:bias=0.05"),
    ("turret", "asymmetric-friction:pan:viscous=0.02", "quadratic-drag:tilt:drag=0.02,power=2"),
    ("turret", "actuator-lag:pan:time_constant=0.012", LATE),
    ("turret", "backlash:pan:gap=0.01,inertia=0.002", "cable-spring:tilt:stiffness=0.3,rest=0.2"),
    ("prescribed", "base-tilt:pitch=1.5"),
    ("thesis", "armature:tilt:inertia=0.02", "torque-gain:roll:gain=0.8"),
    ("trusted", "payload-mass:extra=0.3"),
    ("trusted", "encoder-offset:tilt:offset=0.1"),
)
"""Rig and what is planted in its log; causes of the payload stand in test_given_model too."""
CASES = [pytest.param(case, text, id=text) for case in PLANTED for text in case[1:]]


def parse(text: str) -> tuple[str, str | None, dict[str, float]]:
    """Return name, joint and sizes of a planted cause."""
    place, _, figures = text.rpartition(":")
    name, _, joint = place.partition(":")
    sizes = dict(pair.split("=") for pair in figures.split(","))
    return name, joint or None, {key: float(size) for key, size in sizes.items()}


@pytest.mark.parametrize(("case", "text"), CASES)
def test_a_planted_cause_is_found_with_its_size(case: tuple[str, ...], text: str) -> None:
    """As the name or in the class, with sizes within three deviations or a fifth."""
    found = find(*case)
    name, joint, sizes = parse(text)
    (finding,) = (one for one in found.stated if name in one.alike and one.joint == joint)
    assert finding.nats > 6 and finding.after < finding.before
    told = {p.name: p for p in finding.parameters if finding.cause == name}
    for key in sizes.keys() & told.keys():
        slack = max(3 * np.nan_to_num(told[key].std), 0.2 * abs(sizes[key]))
        assert told[key].value == pytest.approx(sizes[key], abs=slack), key


@pytest.mark.parametrize("case", PLANTED)
def test_nothing_else_is_found(case: tuple[str, ...]) -> None:
    found = find(*case)
    assert len(found.stated) == len(case) - 1
    assert found.verdict in ("named", "ambiguous") and not found.unexplained
    assert json.loads(json.dumps(found.to_dict()))["verdict"] == found.verdict


def test_every_cause_of_the_library_is_planted() -> None:
    names = {parse(text)[0] for case in PLANTED for text in case[1:]}
    assert {*CAUSES} - names == {"joint-flexibility", "off-diagonal-inertia", "payload-shift"}


def test_a_size_is_as_far_off_as_it_says_where_the_shape_is_fitted() -> None:
    found = diagnose(RIG, prescribe("prescribed", *TEETH))
    (finding,) = (one for one in found.stated if one.cause == "stribeck")
    extra = next(p for p in finding.parameters if p.name == "extra")
    assert abs(extra.value - 0.03) < 4 * extra.std


def test_of_a_gap_and_its_rotor_the_product_alone_is_known() -> None:
    found = find(*next(case for case in PLANTED if case[1].startswith("backlash")))
    (finding,) = (one for one in found.stated if one.cause == "backlash")
    told = {p.name: p for p in finding.parameters}
    assert told["gap"].value * told["inertia"].value == pytest.approx(2e-5, rel=0.1)
    assert not told["gap"].is_known and not told["inertia"].is_known


def test_a_link_on_a_spring_is_found() -> None:
    """The link swings at 2.2 Hz, inside the band."""
    (finding,) = find("turret", "joint-flexibility:tilt:frequency=4,rotor_share=0.3").stated
    assert finding.cause == "joint-flexibility"


def test_gravity_of_a_turned_base_points_down() -> None:
    turned = plant_with(nominal(RIG), [parse_effect("base-tilt:roll=1.2,pitch=-0.4", RIG)]).plant
    (finding,) = diagnose(RIG, prescribed(turned, 3, 12.0, 0.01, 4e-3)).stated
    assert finding.parameters[0].value == pytest.approx(1.2, abs=0.1)


TWO_LINKS = """<mujoco><worldbody><body name="upper">
<inertial pos="0 0 0.05" mass="1" diaginertia="0.01 0.01 0.005"/>
<joint name="shoulder" axis="0 1 0" damping="0.6"/><body name="lower" pos="0 0 0.1">
<inertial pos="0 0 0.05" mass="0.6" diaginertia="0.006 0.006 0.003"/>
<joint name="elbow" axis="0 1 0" armature="0.2" damping="0.4"/></body></body></worldbody></mujoco>"""


def test_a_rotor_that_is_stated_is_no_finding() -> None:
    rig = spelled(TWO_LINKS)
    found = diagnose(rig, record(nominal(rig), dt=4e-3), filtering=ALIGNED)
    assert found.verdict == "nothing"


# what is not there


def test_a_clean_log_is_silent_and_states_its_limits() -> None:
    found = find("turret")
    assert found.verdict == "nothing"
    assert not found.findings and not found.unexplained and found.candidate is None
    assert not found.lacking
    level = dict(zip(RIG.joints, np.std(np.asarray(log_of().tau), axis=0)))
    assert found.detection_limit.keys() == level.keys()
    for joint, limit in found.detection_limit.items():
        assert 0.002 * level[joint] < limit < 0.05 * level[joint]
    assert {left.state for left in found.residual.values()} == {"noise"}


def test_no_limit_below_the_torques_that_move_a_joint_gains() -> None:
    """Clipping both sides makes the error as small as one likes, and predicts no motion."""
    explanation = find("turret").explanation
    assert explanation is not None
    search = explanation.search
    for joint, seen in enumerate(search.problem.ranges):
        for share in (0.05, 0.2, 0.4, 0.7):
            limit = Saturation.inside(RIG.joints[joint], share * seen.peak, 0)
            hit = DriveTest(search, explanation.found.final, joint).measure([limit], 0.0)[0].hit
            assert hit.gain < 0, (joint, share)


def whip(t: Array) -> Array:
    """Return a cable that hits at times of its own and rings off."""
    begun = t[:, None] - np.random.default_rng(0).uniform(1, 13, 8)
    past = np.maximum(begun, 0)
    return np.asarray(np.exp(-past / 0.15) * np.sin(8 * np.pi * past)).sum(axis=1)


FOREIGN: Mapping[str, tuple[int, Callable[[Log], Array]]] = {
    "whip": (0, lambda log: 0.06 * whip(log.t)),
    "other joint's angle": (0, lambda log: 0.04 * np.sin(2 * log.q[:, 1] + 0.4)),
    "failing gain": (0, lambda log: 0.02 * log.t * np.asarray(log.tau)[:, 0]),
    "elastic stop": (0, lambda log: 3 * np.maximum(log.q[:, 0] - 0.7, 0) ** 1.5),
    "coupling": (1, lambda log: 0.02 * np.sin(2 * log.q[:, 0] + 0.4)),
}
"""Name → joint and torque of an effect that no cause of the library has."""


@pytest.mark.parametrize("kind", FOREIGN)
def test_an_effect_from_outside_the_library_is_unknown(kind: str) -> None:
    joint, torque = FOREIGN[kind]
    found = diagnose(RIG, push(torque(prescribe("prescribed")), joint))
    assert (found.verdict, found.stated) == ("unknown", ())
    assert found.unexplained == [RIG.joints[joint]]


@pytest.mark.parametrize("kind", ["one second", "one joint", "still", "torque of noise"])
def test_a_log_that_cannot_answer_is_refused(kind: str) -> None:
    log = prescribe("prescribed")
    assert log.v is not None
    noise = np.random.default_rng(0).standard_normal(log.q.shape)
    logs = {
        "one second": log.part(slice(0, 250)),
        "one joint": replace(log, q=log.q * [0.0, 1.0], v=log.v * [0.0, 1.0]),
        "still": replace(log, q=0.0 * log.q, v=0.0 * log.v),
        "torque of noise": replace(log, tau=noise).part(slice(0, 2500)),
    }
    with pytest.raises(DataError):
        diagnose(RIG, logs[kind])


def test_a_log_of_a_low_rate_has_a_band_of_its_own() -> None:
    found = diagnose(RIG, prescribed(nominal(RIG), 3, 20.0, torque_noise=0.01, dt=1.0 / 30))
    assert found.verdict == "nothing"
    assert found.held_out is not None and found.held_out.cutoff_hz == pytest.approx(6.0, rel=0.01)


# figures


def measure_findings(found: Diagnosis) -> dict[str, tuple[float, ...]]:
    """Return the sizes of what is stated, by cause."""
    return {one.cause: tuple(p.value for p in one.sized) for one in found.stated}


def split_log(log: Log) -> list[Log]:
    """Return a log as two pieces."""
    half = len(log.t) // 2
    pieces = (log.part(slice(0, half)), log.part(slice(half, None)))
    return [replace(part, name=f"{k}.csv") for k, part in enumerate(pieces)]


@cache
def find_teeth(holdout: str | None) -> Diagnosis:
    """Return what is found of teeth and breakaway where some rows are held out."""
    if holdout is None:
        return find("turret", *TEETH)
    log = log_of(*TEETH)
    return diagnose(RIG, split_log(log) if holdout == "log:2" else log, holdout=holdout)


@pytest.mark.parametrize(
    ("holdout", "how", "share"),
    [
        (None, "every fifth block", 0.2),
        ("last-third", "last third", 1 / 3),
        ("log:2", "log 2 of 2", 0.5),
        ("none", "cross-validated", 1.0),
    ],
)
def test_errors_are_of_the_rows_that_were_asked_for(
    holdout: str | None, how: str, share: float
) -> None:
    """The three models have the same; what no fit has seen is predicted to the noise."""
    log = log_of(*TEETH)
    found = find_teeth(holdout)
    held = found.held_out
    assert held is not None and held.how == how
    assert np.mean(held.traces.is_shown) == pytest.approx(share, abs=0.02)
    assert measure_findings(found).keys() == {"cogging", "stribeck"}
    passed = np.sqrt(2 * held.cutoff_hz * log.dt)
    for j, joint in enumerate(RIG.joints):
        noise = 0.01 * np.sqrt(np.mean(np.asarray(log.tau)[:, j] ** 2)) * passed
        urdf, refitted, extended = (x.torque_rmse[joint] for x in held.stages.values())
        assert extended == pytest.approx(noise, rel=0.4)
        assert 10 * extended < refitted < 1.2 * urdf
        left = held.traces.extended[held.traces.is_shown, j]
        scale = np.sqrt(held.used[joint])
        assert np.sqrt(np.mean(left**2)) == pytest.approx(extended * scale)


def test_findings_do_not_know_the_rows_that_the_errors_are_of() -> None:
    log = log_of(*TEETH)
    late = log.t > log.t[0] + 0.7 * (log.t[-1] - log.t[0])
    other = replace(log, tau=np.asarray(log.tau) * np.where(late, 1.3, 1.0)[:, None])
    plain = find_teeth("last-third")
    changed = diagnose(RIG, other, holdout="last-third")
    for one, two in zip(plain.stated, changed.stated, strict=True):
        assert (one.cause, one.joint, one.status) == (two.cause, two.joint, two.status)
        # The filters remember a few rows beyond the cut.
        assert two.nats == pytest.approx(one.nats, rel=0.03)
    assert plain.held_out is not None and changed.held_out is not None
    for joint, error in plain.held_out.extended.torque_rmse.items():
        assert changed.held_out.extended.torque_rmse[joint] > 5 * error


# what makes no difference


@pytest.mark.parametrize("change", ["order and time", "pieces"])
def test_the_answer_does_not_hang_on(change: str) -> None:
    """The order of joints and the time of day change nothing; a cut changes the folds."""
    log = log_of(*TEETH)
    assert log.v is not None and log.tau is not None
    turned = {name: getattr(log, name)[:, ::-1] for name in ("q", "v", "tau")}
    swapped = replace(log, joints=log.joints[::-1], t=log.t + 1234.5, **turned)
    plain = find("turret", *TEETH)
    other = diagnose(RIG, split_log(log) if change == "pieces" else swapped)
    assert other.verdict == plain.verdict
    parts = {one.cause: one for one in plain.stated}
    assert parts.keys() == {one.cause for one in other.stated}
    for one in other.stated:
        same = parts[one.cause]
        assert (one.joint, one.status) == (same.joint, same.status)
        for new, old in zip(one.sized, same.sized, strict=True):
            slack = 2.0 if change == "pieces" else 0.2
            assert new.value == pytest.approx(old.value, abs=slack * old.std)


@pytest.mark.parametrize("case", [PLANTED[0], PLANTED[6]])
def test_the_extended_model_is_read_as_it_was_written(
    case: tuple[str, ...], tmp_path: Path
) -> None:
    model = find(*case).after
    find(*case).save(tmp_path / "extended.yaml")
    again = read_model(tmp_path / "extended.yaml", model.rig)
    assert again.terms == model.terms and again.drive == model.drive
    assert again.estimated is not None and model.estimated is not None
    np.testing.assert_allclose(again.estimated.covariance, model.estimated.covariance)
