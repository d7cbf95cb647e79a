"""Laws of the gains in the units of drives: whatever the unit, the same errors give the same torque at the joint."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from gimbal_pin.control import Pid, convert_gains, stored, tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.report import show_controller
from gimbal_pin.rig import Motor, Rig

GAINS = st.builds(Pid.placed, st.floats(0.5, 30), st.floats(1, 2), st.floats(0, 0.15))
MOTORS = st.builds(
    Motor,
    torque_constant=st.floats(0.01, 10),
    gear_ratio=st.sampled_from([-7.0, 0.5, 1.0, 50.0]),
    encoder_bits=st.just(14),
)
ERRORS = st.builds(lambda a, b, c: Polynomial([0.0, a, b, c]), *[st.floats(-1, 1)] * 3)
INERTIA = st.floats(1e-4, 2.0)


@given(GAINS, INERTIA, MOTORS, ERRORS, st.floats(0, 2))
def test_every_unit_gives_the_torque_of_the_pid(
    gains: Pid, inertia: float, motor: Motor, e: Polynomial, t: float
) -> None:
    found = convert_gains(gains, inertia, motor)
    constant = motor.torque_constant
    turns = abs(motor.gear_ratio)
    assert (
        constant is not None
        and found.current is not None
        and found.count is not None
        and found.odrive is not None
    )

    def torque(law: Pid, per_rad: float) -> float:
        """Of a PID that sees the joint's error times so much."""
        seen = per_rad * e
        return float(law.kp * seen(t) + law.ki * seen.integ()(t) + law.kd * seen.deriv()(t))

    wanted = inertia * torque(gains, 1.0)
    same = pytest.approx(wanted, rel=1e-9, abs=1e-9 * inertia * sum(gains))
    assert torque(found.torque, 1.0) == same
    assert constant * torque(found.current, turns) == same
    assert constant * torque(found.count, 1 / motor.encoder_step) == same
    shaft = turns / (2 * pi) * e
    slip = found.odrive.pos_gain * shaft + shaft.deriv()
    given_back = found.odrive.vel_gain * slip(t) + found.odrive.vel_integrator_gain * slip.integ()(
        t
    )
    assert turns * given_back == same
    assert found.odrive.torque_constant * turns == pytest.approx(constant)


@given(GAINS, INERTIA, MOTORS, st.floats(0.1, 10))
def test_constants_scale_what_they_are_in(
    gains: Pid, inertia: float, motor: Motor, factor: float
) -> None:
    assert motor.torque_constant is not None
    plain = convert_gains(gains, inertia, motor)
    stronger = convert_gains(
        gains, inertia, replace(motor, torque_constant=factor * motor.torque_constant)
    )
    geared = convert_gains(gains, inertia, replace(motor, gear_ratio=factor * motor.gear_ratio))
    heavier = convert_gains(gains, factor * inertia, motor)
    assert plain.current and stronger.current and geared.current and heavier.current
    assert plain.count and stronger.count and plain.odrive and geared.odrive and heavier.odrive
    assert stronger.torque == geared.torque == plain.torque
    assert factor * stronger.current.kd == pytest.approx(plain.current.kd)
    assert factor * stronger.count.ki == pytest.approx(plain.count.ki)
    assert factor * geared.current.kp == pytest.approx(plain.current.kp)
    assert geared.count == plain.count
    assert factor**2 * geared.odrive.vel_gain == pytest.approx(plain.odrive.vel_gain)
    assert geared.odrive.pos_gain == pytest.approx(plain.odrive.pos_gain)
    assert heavier.odrive.pos_gain == pytest.approx(plain.odrive.pos_gain)
    assert heavier.odrive.vel_gain == pytest.approx(factor * plain.odrive.vel_gain)


def test_what_no_cascade_can_do_is_said() -> None:
    rig = Rig.load("turret")
    fast = tune(nominal(rig), kind="pid", bandwidth_hz=2.0, integral=0.5)
    assert all(own.current is not None and own.odrive is None for own in fast.drive_gains)
    assert "pan and tilt: no gains of ODrive's cascade" in show_controller(fast).to_text()


def test_only_units_whose_constants_are_known() -> None:
    rig = Rig.load("turret")
    bare = replace(rig, motors=tuple(replace(motor, torque_constant=None) for motor in rig.motors))
    known, unknown = (
        show_controller(tune(nominal(one), kind="pid")).to_text() for one in (rig, bare)
    )
    units = ("KP, A/rad", "KP, A/count", "ODrive")
    assert "KP, N m/rad" in known and all(unit in known for unit in units)
    assert "KP, N m/rad" in unknown and not any(unit in unknown for unit in units)
    uncounted = replace(
        rig, motors=tuple(replace(motor, encoder_bits=None) for motor in rig.motors)
    )
    said = show_controller(tune(nominal(uncounted), kind="pid")).to_text()
    assert "A/rad" in said and "A/count" not in said


def test_the_file_holds_them_and_is_read_back() -> None:
    rig = Rig.load("turret")
    tuning = tune(nominal(rig), kind="pid")
    data = tuning.to_dict()
    again = stored(data, rig)
    assert again.law == tuning.controller
    for joint, own, moment in zip(rig.joints, tuning.drive_gains, tuning.inertia):
        drive = data["joints"][joint]["drive"]
        assert drive["torque"]["kp"] == data["joints"][joint]["kp"] * moment
        assert own.odrive is not None and drive["odrive"] == own.odrive._asdict()
