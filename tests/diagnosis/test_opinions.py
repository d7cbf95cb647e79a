"""Laws of the one state that a joint's torque has: a poor fit is neither explained nor nothing, whoever says it."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from markupsafe import Markup
from scipy.signal import butter, sosfiltfilt

from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.identification import Identified, Opinion, identify, judge_joint
from gimbal_pin.log import Log
from gimbal_pin.report import show_diagnosis, tables
from gimbal_pin.report.pages import describe_record
from gimbal_pin.report.summary import missed
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.control.test_compensation import with_causes

FEW = {name: CAUSES[name] for name in ("cogging", "stribeck", "delay")}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


def touch(log: Log, size: float, joint: int = 1, hertz: float = 1.0) -> Log:
    """Return a log on which a hand pushes a joint slowly, with a torque of so many times the joint's own."""
    noise = np.random.default_rng(7).standard_normal(len(log))
    push = sosfiltfilt(butter(3, hertz, output="sos", fs=1 / log.dt), noise)
    tau = np.array(log.tau)
    tau[:, joint] += size * np.std(tau[:, joint]) / np.std(push) * push
    return replace(log, tau=tau)


@pytest.fixture(scope="module")
def touched(rig: Rig) -> Diagnosis:
    log = touch(prescribed(nominal(rig), seconds=12.0, torque_noise=0.01, dt=4e-3), 1.5)
    return diagnose(rig, [log], FEW)


def test_no_poor_or_degraded_fit_is_explained() -> None:
    for fit, structured, lacks, worse in product(np.linspace(-50, 100, 61), *[(False, True)] * 3):
        state = judge_joint(float(fit), 0.9, structured, lacks, worse)
        assert not (
            state in (Opinion.EXPLAINED, Opinion.NOISE_LEFT) and (fit <= 50 or structured or worse)
        )
        assert state is not Opinion.EXPLAINED or fit > 90
        assert state.is_open == (state in (Opinion.STRUCTURE_LEFT, Opinion.NOT_EXPLAINED))
    assert judge_joint(float("nan"), 0.9, True, True, True) is judge_joint(
        99.0, 0.0, True, True, True
    )


@pytest.mark.parametrize(("size", "joint", "hertz"), [(1.5, 1, 1.0), (2.5, 0, 0.5), (1.2, 1, 3.0)])
def test_a_joint_of_which_half_the_torque_is_left_is_not_explained(
    rig: Rig, size: float, joint: int, hertz: float
) -> None:
    """It is said first, with the way on; the other joint is explained."""
    log = touch(
        prescribed(nominal(rig), seconds=12.0, torque_noise=0.01, dt=4e-3), size, joint, hertz
    )
    found = identify(rig, [log])
    name = rig.joints[joint]
    other = rig.joints[1 - joint]
    assert (
        found.held_out is not None
        and found.held_out.fit_percent[name] < 50 < found.held_out.fit_percent[other]
    )
    assert found.opinions[name] is Opinion.NOT_EXPLAINED
    assert (
        found.warnings[0].startswith(f"{name} is not explained")
        and "gimbal-pin diagnose" in found.warnings[0]
    )
    assert found.to_dict()["misfit"][name]["opinion"] == "not explained"
    assert states_of(tables.torque_errors(found))[name] == "not explained"


@pytest.mark.parametrize(("joint", "size"), [(1, 0.2), (1, 0.45), (0, 0.9)])
def test_a_refit_that_is_worse_than_the_urdf_is_not_explained(
    rig: Rig, joint: int, size: float
) -> None:
    """The training part is touched, the held-out part is not: there the URDF, which is the truth, fits best."""
    log = prescribed(nominal(rig), seconds=12.0, torque_noise=0.01, dt=4e-3)
    tau = np.where(
        np.arange(len(log))[:, None] < 2 * len(log) // 3, touch(log, size, joint).tau, log.tau
    )
    name = rig.joints[joint]
    found = identify(rig, [replace(log, tau=tau)])
    assert found.held_out is not None
    urdf, rubbing = found.simpler
    fits = [one.fit_percent[name] for one in (found.held_out, urdf, rubbing)]
    assert 50 < fits[0] < 90 and fits[1] > 95
    assert found.opinions[name] is Opinion.NOT_EXPLAINED and "the URDF" in found.warnings[0]


def test_a_touched_log_has_no_verdict_of_nothing(touched: Diagnosis) -> None:
    assert touched.extended["fit_percent"]["tilt"] < 50
    assert touched.verdict == "unknown" and touched.opinions["tilt"] is Opinion.NOT_EXPLAINED
    near = touched.candidate
    assert near is None or near.after < near.before
    assert near is None or f"{near.cause} at {near.joint}" in show_diagnosis(touched).to_text()


def test_all_that_speaks_of_a_joint_agrees(touched: Diagnosis) -> None:
    """Table, page, terminal, headline and JSON read one state."""
    stated = {joint: state.value for joint, state in touched.opinions.items()}
    assert {joint: row["opinion"] for joint, row in touched.to_dict()["residual"].items()} == stated
    table = states_of(tables.residual(touched))
    assert all(table[joint].startswith(state) for joint, state in stated.items())
    for text in (
        show_diagnosis(touched).to_text(),
        describe_record(touched).to_text(),
        missed(touched),
    ):
        assert "tilt" in text and "explains the" not in text
    assert touched.unexplained == [
        joint for joint, state in touched.opinions.items() if state.is_open
    ]


def test_a_refit_that_fails_keeps_a_diagnosis_from_nothing(touched: Diagnosis) -> None:
    """Whatever is left looks like noise: a joint that refitting made worse is open, until findings undo it."""
    base = dict.fromkeys(touched.residual, 75.0)
    noise = {
        joint: replace(left, state="noise", curve=None) for joint, left in touched.residual.items()
    }

    def with_fits(urdf: float, refitted: float, extended: float) -> Diagnosis:
        fits = (urdf, urdf, refitted, extended)
        names = ("stated", "rubbing", "baseline", "extended")
        errors = {
            name: {**getattr(touched, name), "fit_percent": {**base, "pan": fit}}
            for name, fit in zip(names, fits)
        }
        return replace(touched, residual=noise, findings=(), candidate=None, **errors)

    assert with_fits(75.0, 75.0, 75.0).verdict == "nothing"
    assert (
        with_fits(75.0, 60.0, 60.0).verdict == "unknown"
        and with_fits(75.0, 60.0, 60.0).deteriorations
    )
    assert with_fits(75.0, 60.0, 95.0).verdict == "nothing"
    assert with_fits(30.0, 40.0, 45.0).verdict == "unknown"
    assert with_fits(75.0, 74.0, 74.0).verdict == "nothing"


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_a_clean_log_is_nothing_whatever_its_noise(rig: Rig, size: float) -> None:
    found = diagnose(
        rig, [prescribed(nominal(rig), 3, 12.0, torque_noise=0.01 + size, dt=4e-3)], FEW
    )
    wanted = Opinion.NOISE_LEFT if size else Opinion.EXPLAINED
    assert found.verdict == "nothing" and found.candidate is None
    assert wanted in found.opinions.values() and not any(
        one.is_open for one in found.opinions.values()
    )


def test_what_a_finding_explains_is_explained(rig: Rig) -> None:
    model = with_causes(rig, "cogging:tilt:amplitude=0.05,harmonic=11")
    found = diagnose(rig, [prescribed(model, seconds=12.0, torque_noise=0.01, dt=4e-3)], FEW)
    assert [one.cause for one in found.findings] == ["cogging"]
    assert (
        found.opinions == {"pan": Opinion.EXPLAINED, "tilt": Opinion.EXPLAINED}
        and not found.deteriorations
    )


def states_of(table: tables.Table) -> dict[str, str]:
    """Return joint → what its row says of what is left."""
    column = table.head.index("What is left")
    return {Markup(row[0]).striptags(): Markup(row[column]).striptags() for row in table.rows}


def test_the_joints_of_an_identification_have_one_state_in_all_places(rig: Rig) -> None:
    found: Identified = identify(
        rig, [prescribed(nominal(rig), seconds=12.0, torque_noise=0.4, dt=4e-3)]
    )
    stated = {joint: state.value for joint, state in found.opinions.items()}
    assert states_of(tables.torque_errors(found)) == stated
    assert {joint: one["opinion"] for joint, one in found.to_dict()["misfit"].items()} == stated
