"""Logs whose cause today's search names wrongly: what the new diagnosis has to answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.control import repeated
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import CAUSES, RigEffect
from gimbal_pin.excitation import excite
from gimbal_pin.identification import identify
from tests.bench_logs import prescribed
from tests.diagnosis.cases import DT, few, run
from tests.diagnosis.test_evidence import logged, turning
from tests.refitted import ALIGNED, RIG

FEW = few("friction-drift", "torque-ripple", "cogging", "torque-gain")


@pytest.mark.xfail(
    strict=True, reason="a gain that drifts is no cause of the library yet: new diagnosis"
)
@pytest.mark.parametrize("loss", [0.3, 0.15])
def test_a_motor_that_loses_gain_is_a_drift_of_the_gain_or_unknown(loss: float) -> None:
    log = prescribed(nominal(RIG), seconds=16.0, torque_noise=0.005, dt=4e-3)
    tau = np.array(log.tau)
    tau[:, 0] /= 1 - loss * (log.t - log.t[0]) / (log.t[-1] - log.t[0])
    found = diagnose(RIG, replace(log, tau=tau), FEW)
    assert found.verdict == "unknown" or any("gain" in one.cause for one in found.findings)


@pytest.mark.xfail(
    strict=True, reason="short events leave too little power for the residual's test: new diagnosis"
)
def test_a_hand_that_pushes_now_and_then_is_never_nothing() -> None:
    """Six pushes of 0.3 s leave 4 % of the torque's rms, ten times the sensors' noise."""
    rng = np.random.default_rng(3)
    log = prescribed(nominal(RIG), seconds=24.0, torque_noise=0.005, dt=4e-3)
    tau = np.array(log.tau)
    for at in rng.uniform(1.0, 23.0, 6):
        pushed = np.abs(log.t - at) < 0.15
        tau[pushed] += 0.15 * np.std(tau, axis=0) * np.sign(rng.standard_normal(2))
    assert diagnose(RIG, replace(log, tau=tau), FEW).verdict != "nothing"


@pytest.mark.xfail(
    strict=True, reason="the alignment starts at half a sample and its prior holds it: prepared log"
)
def test_the_delay_of_a_slow_log_is_the_one_that_identify_fits() -> None:
    """Torque that is sampled at 25 Hz acts at its stamp, not half a sample later."""
    log = prescribed(nominal(RIG), seconds=40.0, torque_noise=0.005, dt=0.04)
    found = diagnose(RIG, log, FEW)
    assert found.after.lags
    lags = identify(RIG, log).model.lags
    for joint, (lag, std) in found.after.lags.items():
        assert abs(lag - lags[joint][0]) < 4 * np.hypot(std, lags[joint][1])


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True, reason="a power of 1.75 passes for viscous friction: Stribeck's alone is named"
)
def test_a_drag_is_found_beside_stribecks_friction_with_its_power() -> None:
    log = run(("stribeck:tilt:extra=0.1,speed=0.25", "quadratic-drag:tilt:drag=0.06,power=1.75"))
    found = diagnose(RIG, log, few("stribeck", "quadratic-drag"))
    assert {one.cause for one in found.findings} == {"stribeck", "quadratic-drag"}
    (drag,) = (p for one in found.findings for p in one.parameters if p.name == "drag")
    assert abs(drag.value - 0.06) < 4 * drag.std


@pytest.mark.xfail(
    strict=True, reason="unknown: torque-gain is neither found nor untestable nor immaterial"
)
def test_a_gain_that_this_log_cannot_show_is_told() -> None:
    rig = replace(RIG, config=replace(RIG.config, inertia="trusted"))
    log = prescribed(nominal(rig), 6, seconds=16.0, torque_noise=0.02, dt=4e-3)
    halved = replace(log, tau=np.asarray(log.tau) / np.array([0.8, 1.0]))
    bodies = {name: kind for name, kind in CAUSES.items() if issubclass(kind, RigEffect)}
    found = diagnose(rig, halved, {**few("torque-gain"), **bodies}, filtering=ALIGNED)
    assert ("torque-gain", "pan") in {(row.cause, row.joint) for row in found.untestable}
    assert any("inertia about its axis" in note for note in found.notes)


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True, reason="unknown: of a gap before a large rotor no cause is accepted: new diagnosis"
)
def test_a_gap_before_a_large_rotor_is_found() -> None:
    design = excite(
        RIG, seconds=6.0, starts=1, rng=np.random.default_rng(5), torque_model=nominal(RIG), dt=DT
    )
    planted = "backlash:pan:gap=0.02,inertia=0.005,rotor_share=0.3"
    log = run((planted,), reference=repeated(design.motion, 12.0, DT))
    found = diagnose(RIG, log, few("backlash", "delay", "dead-zone"))
    (one,) = found.findings
    assert one.joint == "pan"
    assert "backlash" in one.alike


@pytest.mark.xfail(strict=True, reason="the limit is found 3 % low: new diagnosis")
def test_a_limit_that_is_met_at_turns_alone_is_found_with_its_size() -> None:
    """Whenever the motor is at its limit, the drive asks for half as much again."""
    motion = turning(0.12)
    tau = nominal(RIG).inverse(motion.q, motion.v, motion.a)
    limit = float(np.abs(tau[:, 0]).max())
    tau[:, 0] *= np.where(np.abs(tau[:, 0]) > 0.95 * limit, 1.5, 1.0)
    causes = few("saturation", "dead-zone", "delay", "cogging")
    found = diagnose(RIG, logged(motion, tau), causes, filtering=ALIGNED)
    assert [(one.cause, one.joint) for one in found.findings] == [("saturation", "pan")]
    (told,) = (p.value for p in found.findings[0].parameters if p.name == "limit")
    assert told == pytest.approx(limit, rel=0.02)
