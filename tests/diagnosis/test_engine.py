"""Laws of the evidence and of the search in it.

Rows have unit noise, bands hold the lines of teeth, and gates open at swift turns. Noise is no cause, what is planted
explains what was there, unseen data confirm it, and noise in the motion hides inertia.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from gimbal_pin.diagnosis import (
    DIAGNOSIS_BAND,
    Evidence,
    Explained,
    choose_band,
    confirm_causes,
    diagnose,
    explain,
    gather,
    is_hidden_by_noise,
)
from gimbal_pin.diagnosis.reversals import find_shifts, open_turns
from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.effects import Armature, Cogging, Delay, JointFlexibility, Presliding, Term
from gimbal_pin.log import Array, Log, Motion
from tests.bench_logs import fourier
from tests.diagnosis.cases import few
from tests.refitted import ALIGNED, RIG, plant, record, refit
from tests.rigs import spelled

DT = 4e-3
JOINT = """<robot name="joint"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 {}"/><mass value="1"/>
<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="{}"/></joint></robot>"""
ROTOR = spelled(JOINT.format(0, 1e-4, 1e-4, 2e-4, "0 0 1"))
PENDULUM = spelled(JOINT.format(-0.3, 0.01, 0.01, 0.01, "0 1 0"))
INERTIA = 0.1
"""Of the pendulum about its axis, kg m²."""


def test_white_torque_noise_becomes_rows_of_unit_noise() -> None:
    """Unit variance after whitening, whatever the joint's torque; the pass band is seven eighths of the rows'."""
    t = 0.002 * np.arange(15_001)
    steady = 1e-3 * np.ones((15_001, 2))
    noise = np.random.default_rng(3).standard_normal(steady.shape) * [0.02, 0.3]
    still = Log("still", RIG.joints, t, np.cumsum(steady, axis=0), None, noise)
    found = gather(RIG, [still], DIAGNOSIS_BAND)
    white = found.whiten_all(found.torque)[40:-40]
    np.testing.assert_allclose(np.var(white, axis=0), 0.875, atol=0.12)


@pytest.mark.parametrize(
    ("amplitude", "noise", "turns", "teeth"),
    [(5e-3, 1e-4, 0.3, 84), (5e-3, 1e-4, 0.8, 72), (0.0, 1e-5, 0.8, 0), (0.0, 1e-1, 0.8, 0)],
)
def test_the_band_holds_the_lines_of_the_teeth_and_follows_no_noise(
    amplitude: float, noise: float, turns: float, teeth: int
) -> None:
    """A loop holds a rate that wavers; its torque is friction, inertia and teeth, with white noise."""
    t = 1e-3 * np.arange(10000)
    rate = 2 * np.pi * turns
    waver = 2 * np.pi * 1.3
    q = rate * t + 0.05 * np.sin(waver * t)
    v = rate + 0.05 * waver * np.cos(waver * t)
    tau = 4e-3 + 1e-3 * v - 1e-5 * waver**2 * np.sin(waver * t) + amplitude * np.cos(teeth * q)
    tau += noise * np.random.default_rng(0).standard_normal(len(t))
    log = Log("spinning", ("swing",), t, q[:, None], v[:, None], tau[:, None])
    band = choose_band(ROTOR, [log])
    assert band.cutoff >= turns * teeth
    assert (band == DIAGNOSIS_BAND) == (teeth == 0)


# turns


def turning(ramp: float) -> Motion:
    """Return constant rates and turns of `ramp` s: almost all torque goes into the turns."""
    t = DT * np.arange(3001)[:, None]
    joint = np.arange(2)
    period = 1.9 + 0.5 * joint
    top = 0.7 + 0.3 * np.sin(0.7 * t + joint)
    # A triangle of slope 2 / ramp about its zeros, cut at the top.
    triangle = 1 - 4 * np.abs((t / period + 0.25 * joint) % 1.0 - 0.5)
    v = np.clip(triangle * period / (2 * ramp), -top, top)
    v = gaussian_filter1d(v, 0.016 / DT, axis=0, mode="nearest")
    q = cumulative_trapezoid(v, dx=DT, axis=0, initial=0.0)
    return Motion(t[:, 0], q - q.mean(axis=0), v, np.gradient(v, DT, axis=0))


def logged(motion: Motion, torque: Array) -> Log:
    """Return a log of a motion with the noise of encoders, gyros and torque sensors."""
    rng = np.random.default_rng(3)
    q, v, tau = (
        x + s * rng.standard_normal(x.shape)
        for x, s in ((motion.q, 1e-5), (motion.v, 1e-3), (torque, 1e-2))
    )
    return Log("turning", RIG.joints, motion.t, q, v, tau)


@pytest.mark.parametrize(
    ("ramp", "friction", "late"),
    [(0.12, 0.002, 0), (0.12, 5.0, 0), (1.9, 0.05, 0), (0.12, 0.002, -1), (0.12, 0.002, 1)],
)
def test_the_gate_opens_at_swift_turns_alone(ramp: float, friction: float, late: int) -> None:
    """It stays shut at slow turns, under more friction than acceleration, and where torque acts at another time."""
    motion = turning(ramp)
    tau = nominal(RIG).inverse(motion.q, motion.v, motion.a) + friction * np.sign(motion.v)
    state = refit(logged(motion, np.roll(tau, late, axis=0)))
    before = state.problem.evidence
    after = open_turns(before, state, ALIGNED)
    swift = (ramp, friction) == (0.12, 0.002)
    assert np.all(after.parts[0].gate >= before.parts[0].gate)
    assert bool(np.any(after.used > before.used + 0.02)) == (swift and not late)
    if swift:
        np.testing.assert_allclose(find_shifts(state), abs(late) * DT, atol=0.15 * DT)


def test_friction_that_builds_up_where_joints_turn_swiftly_is_found() -> None:
    motion = turning(0.12)
    bristles = Term(Presliding("pan", 2e-3), (0.05,))
    log = logged(motion, plant(bristles).inverse(motion.q, motion.v, motion.a))
    causes = few("presliding", "stribeck", "cogging", "backlash")
    found = diagnose(RIG, log, causes, filtering=ALIGNED)
    assert [(one.cause, one.joint) for one in found.findings] == [("presliding", "pan")]


# the search


def log_of(size: float = 0.0, seed: int = 1, noise: float = 0.02) -> Log:
    """Return the torque of a motion with coloured noise, and cogging of that size at the first joint.

    The noise has a corner of 1.2 Hz: all of it is within the motion's band.
    """
    motion = fourier(RIG, seed, 24.0, DT)
    tau = nominal(RIG).inverse(motion.q, motion.v, motion.a)
    white = np.random.default_rng(seed).standard_normal(tau.shape)
    colour = lfilter([np.sqrt(1 - 0.97**2)], [1, -0.97], white, axis=0)
    tau = tau + noise * np.std(tau, axis=0) * colour
    tau[:, 0] += size * np.sin(11 * motion.q[:, 0] + 0.3)
    return Log("log", RIG.joints, motion.t, motion.q, motion.v, tau)


def explain_log(log: Log, *more: str) -> Explained:
    """Explain a log by some causes and these."""
    kinds = few("torque-bias", "asymmetric-friction", "stribeck", "actuator-lag", *more)
    return explain(gather(RIG, [log], ALIGNED), reduce_parameters(RIG), kinds)


def test_what_is_planted_explains_what_was_there_and_is_seen_where_nobody_looks_for_it() -> None:
    found = explain_log(log_of(0.01), "cogging")
    (cause,) = found.state.causes
    assert (cause.name, cause.place) == ("cogging", "pan")
    assert found.before[0].share > 0.3 and found.before[1].share < 0.1
    assert found.after[0].share < 0.1 and found.left(0) < 0.1
    assert found.final.causes == (cause,) and not any(found.structured)
    found = explain_log(log_of(0.01))
    assert found.after[0].share > 0.3 and found.left(0) > 0.5
    assert found.structured == (True, False)
    assert all(cause.place != "pan" for cause in found.final.causes)


def teeth(amplitude: float, seed: int) -> Evidence:
    """Return the evidence of a motor that cogs."""
    model = plant(Term(Cogging("pan", (7.0,)), (amplitude, 0.0)))
    return gather(RIG, [record(model, seed, 16.0, 3e-4, DT)], ALIGNED)


def search(train: Evidence) -> Explained:
    """Look for cogging."""
    return explain(train, reduce_parameters(RIG), few("cogging"), timed=False)


def test_a_cause_that_unseen_data_deny_is_left_out_and_what_it_explained_is_unknown() -> None:
    found = search(teeth(0.004, 0))
    assert [cause.name for cause in found.final.causes] == ["cogging"]
    kept = confirm_causes(found, teeth(0.004, 1))
    assert kept.found is found and not kept.denied
    before, after = (x["torque_rmse"]["pan"] for x in (kept.baseline, kept.figures))
    assert after < 0.5 * before
    refuted = confirm_causes(found, teeth(0.0, 2))
    assert refuted.found.final.causes == () and refuted.figures == refuted.baseline
    assert refuted.found.structured == (True, False)
    (said,) = refuted.denied
    assert "pan" in said and "cogging" in said


def swing(shaken: float, inertia: float) -> Log:
    """Return a log of an arm whose joint shakes by so much from 4 to 12 Hz, rad; its controller damps that."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 30.0, DT)
    slow, fast = (2 * np.pi * rng.uniform(*band, 12) for band in ((0.1, 1.0), (4.0, 12.0)))

    def waves(w: Array, order: int) -> Array:
        angle = np.outer(t, w) + np.arange(12) + order * np.pi / 2
        return np.asarray(np.sin(angle) @ w**order)

    q, v, a = (0.2 * waves(slow, k) for k in range(3))
    tau = inertia * a + 9.80665 * 0.3 * np.sin(q) + 0.05 * v + 0.1 * np.tanh(v / 0.01)
    tau += 0.01 * rng.standard_normal(len(t)) - 0.5 * shaken * waves(fast, 1)
    read = q + shaken * waves(fast, 0)
    return Log("swing", ("swing",), t, read[:, None], tau=tau[:, None])


@pytest.mark.parametrize(
    ("shaken", "inertia", "told"),
    [
        (0.0, INERTIA, ""),
        (0.0, 1.3 * INERTIA, "more than the URDF's"),
        (0.02, 1.3 * INERTIA, "noise in the motion may hide inertia"),
    ],
)
def test_a_quiet_motion_tells_the_inertia_and_a_shaken_one_does_not(
    shaken: float, inertia: float, told: str
) -> None:
    found = diagnose(PENDULUM, swing(shaken, inertia), {})
    said = [note for note in found.notes if "inertia" in note]
    assert len(said) == (told != "") and all(told in note for note in said)
    assert found.state is not None
    for cause in (Armature("swing"), JointFlexibility("swing", 8.0, rotor_share=0.3)):
        assert is_hidden_by_noise(found.state, cause) == (shaken > 0)
    assert not is_hidden_by_noise(found.state, Delay("swing", 0.01))
