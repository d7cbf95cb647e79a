"""A joint's gains in the units that drives take."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import NamedTuple

from gimbal_pin.control.laws import Pid
from gimbal_pin.rig.config import Motor


class Cascade(NamedTuple):
    """Gains of ODrive's cascade, ``v_err = pos_gain e + v_ref - v``, of the motor's shaft.

    ``tau = vel_gain v_err + vel_integrator_gain ∫ v_err``. As firmware 0.5 and its page "Control" define them
    (docs.odriverobotics.com/v/0.5.6/control.html), with the wanted rate in `input_vel`.

    Attributes:
        pos_gain: (turn/s)/turn.
        vel_gain: N m/(turn/s).
        vel_integrator_gain: N m/((turn/s) s).
        torque_constant: What `motor.config.torque_constant` must be for these to be N m, N m/A.
    """

    pos_gain: float
    vel_gain: float
    vel_integrator_gain: float
    torque_constant: float


@dataclass(frozen=True)
class DriveGains:
    """``kp e + ki ∫e + kd ė`` of one joint, in every unit that its motor's constants allow; None: they do not.

    Attributes:
        torque: Torque at the joint by its angle: N m/rad, N m/(rad s), N m s/rad.
        current: Current by the angle of the motor's shaft: A/rad, A/(rad s), A s/rad.
        count: Current by steps of the encoder: A/count, A/(count s), A s/count.
        odrive: ODrive's cascade; None, too, where the integral action is too fast for any cascade.
    """

    torque: Pid
    current: Pid | None = None
    count: Pid | None = None
    odrive: Cascade | None = None


def convert_gains(gains: Pid, inertia: float, motor: Motor, is_sliding: bool = False) -> DriveGains:
    """Return gains in acceleration, times a joint's inertia, in the units of its drive.

    A shaft that turns N times per turn of the joint has 1/N of the joint's torque at N times its angle. With
    ``e = e(0) + ∫ė`` the cascade is ``vel_gain (ė + (a + b) e + a b ∫e)`` but for the constant b e(0), which its
    integrator takes up: -a = -`pos_gain` and -b are the zeros of ``kd s² + kp s + ki``, the faster one first.

    Args:
        gains: 1/s², 1/s³, 1/s.
        inertia: At the joint, kg m².
        motor: Its constants, at the joint; without a torque constant only torques are known.
        is_sliding: Whether the joint slides: it has no turns, and no counts in a turn.
    """
    torque = _scale(gains, inertia)
    constant = motor.torque_constant
    turns = abs(motor.gear_ratio)
    if constant is None or is_sliding or not turns:
        return DriveGains(torque)
    current = _scale(torque, 1 / (constant * turns))
    count = _scale(torque, motor.encoder_step / constant) if motor.encoder_step else None
    kp, ki, kd = torque
    square = kp**2 - 4 * kd * ki
    if square < 0:
        return DriveGains(torque, current, count)
    fast = (kp + sqrt(square)) / (2 * kd)
    per_turn = 2 * pi / turns**2
    cascade = Cascade(fast, kd * per_turn, ki / fast * per_turn, constant / turns)
    return DriveGains(torque, current, count, cascade)


def _scale(gains: Pid, factor: float) -> Pid:
    """Return all three gains times a factor."""
    return Pid(gains.kp * factor, gains.ki * factor, gains.kd * factor)
