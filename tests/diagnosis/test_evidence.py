"""Laws of what of a log counts: rows of unit noise, the band of a turning joint's lines, and swift turns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d

from gimbal_pin.diagnosis import DIAGNOSIS_BAND, choose_band, diagnose, gather
from gimbal_pin.diagnosis.reversals import find_shifts, open_turns
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import Presliding, Term
from gimbal_pin.log import Array, Log, Motion
from tests.diagnosis.cases import few
from tests.refitted import ALIGNED, RIG, plant, refit
from tests.rigs import spelled

ROTOR = """<robot name="rotor"><link name="base"/><link name="disc"><inertial><mass value="0.2"/>
<inertia ixx="1e-4" iyy="1e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="motor" type="continuous"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/></joint></robot>"""


def test_white_torque_noise_becomes_rows_of_unit_noise() -> None:
    """Unit variance after whitening, whatever the joint's torque; the pass band is seven eighths of the rows'."""
    t = 0.002 * np.arange(15_001)
    steady = 1e-3 * np.ones((15_001, 2))
    noise = np.random.default_rng(3).standard_normal(steady.shape) * [0.02, 0.3]
    still = Log("still", RIG.joints, t, np.cumsum(steady, axis=0), None, noise)
    found = gather(RIG, [still], DIAGNOSIS_BAND)
    white = found.whiten_all(found.torque)[40:-40]
    np.testing.assert_allclose(np.var(white, axis=0), 0.875, atol=0.12)


# the band


def spinning(amplitude: float, noise: float, turns: float = 0.8, teeth: int = 72) -> Log:
    """A loop holds a rate that wavers; its torque is friction, inertia and teeth, with white noise."""
    t = 1e-3 * np.arange(10000)
    rate = 2 * np.pi * turns
    waver = 2 * np.pi * 1.3
    q = rate * t + 0.05 * np.sin(waver * t)
    v = rate + 0.05 * waver * np.cos(waver * t)
    a = -0.05 * waver**2 * np.sin(waver * t)
    tau = 2e-4 * a + 4e-3 + 1e-3 * v + amplitude * np.cos(teeth * q)
    tau += noise * np.random.default_rng(0).standard_normal(len(t))
    return Log("spinning", ("motor",), t, q[:, None], v[:, None], tau[:, None])


@pytest.mark.parametrize(("turns", "teeth"), [(0.3, 84), (0.8, 72), (1.0, 18)])
def test_the_band_holds_the_lines_of_the_teeth(turns: float, teeth: int) -> None:
    log = spinning(5e-3, 1e-4, turns, teeth)
    assert choose_band(spelled(ROTOR), [log]).cutoff >= turns * teeth


@pytest.mark.parametrize("noise", [1e-5, 1e-3, 1e-1])
def test_the_band_follows_no_noise(noise: float) -> None:
    assert choose_band(spelled(ROTOR), [spinning(0.0, noise)]) == DIAGNOSIS_BAND


def test_teeth_that_pass_quickly_are_named() -> None:
    found = diagnose(spelled(ROTOR), spinning(5e-3, 1e-3), few("cogging", "stribeck"))
    assert [(one.cause, one.status) for one in found.findings] == [("cogging", "named")]
    figures = {p.name: p.value for p in found.findings[0].parameters}
    assert figures["harmonic"] == 72 and figures["amplitude"] == pytest.approx(5e-3, rel=0.05)


# turns


def turning(ramp: float, dt: float = 0.004) -> Motion:
    """Constant rates and turns of `ramp` s: almost all torque goes into the turns."""
    t = dt * np.arange(round(12.0 / dt) + 1)
    v = np.empty((len(t), 2))
    for j in range(2):
        period = 1.9 + 0.5 * j
        top = 0.7 + 0.3 * np.sin(0.7 * t + j)
        # A triangle of slope 2 / ramp about its zeros, cut at the top.
        triangle = 1 - 4 * np.abs((t / period + 0.25 * j) % 1.0 - 0.5)
        v[:, j] = np.clip(triangle * period / (2 * ramp), -top, top)
    v = gaussian_filter1d(v, 0.016 / dt, axis=0, mode="nearest")
    q = cumulative_trapezoid(v, dx=dt, axis=0, initial=0.0)
    return Motion(t, q - q.mean(axis=0), v, np.gradient(v, dt, axis=0))


def logged(motion: Motion, torque: Array) -> Log:
    """A log of a motion under these torques, with the noise of encoders, gyros and torque sensors."""
    rng = np.random.default_rng(3)
    q, v, tau = (
        x + s * rng.standard_normal(x.shape)
        for x, s in ((motion.q, 1e-5), (motion.v, 1e-3), (torque, 1e-2))
    )
    return Log("turning", RIG.joints, motion.t, q, v, tau)


@pytest.mark.parametrize(
    ("ramp", "friction", "late", "opens"),
    [
        (0.12, 0.002, 0, True),
        (0.12, 5.0, 0, False),
        (1.9, 0.05, 0, False),
        (0.12, 0.002, -1, False),
        (0.12, 0.002, 1, False),
    ],
)
def test_the_gate_opens_at_swift_turns_alone(
    ramp: float, friction: float, late: int, opens: bool
) -> None:
    """It stays shut at slow turns, under more friction than acceleration, and where torque acts at another time."""
    motion = turning(ramp)
    tau = nominal(RIG).inverse(motion.q, motion.v, motion.a) + friction * np.sign(motion.v)
    log = logged(motion, np.roll(tau, late, axis=0))
    state = refit(log)
    before = state.problem.evidence
    after = open_turns(before, state, ALIGNED)
    assert np.all(after.parts[0].gate >= before.parts[0].gate)
    assert bool(np.any(after.used > before.used + 0.02)) == opens
    if ramp == 0.12 and friction == 0.002:
        np.testing.assert_allclose(find_shifts(state), abs(late) * log.dt, atol=0.15 * log.dt)


def test_friction_that_builds_up_where_joints_turn_swiftly_is_found() -> None:
    motion = turning(0.12)
    bristles = Term(Presliding("pan", 2e-3), (0.05,))
    log = logged(motion, plant(bristles).inverse(motion.q, motion.v, motion.a))
    causes = few("presliding", "stribeck", "cogging", "backlash")
    found = diagnose(RIG, log, causes, filtering=ALIGNED)
    assert [(one.cause, one.joint) for one in found.findings] == [("presliding", "pan")]
