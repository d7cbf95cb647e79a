"""What is known of each measured device: the table that diagnoses are judged by (the README of the data)."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

LAGS = ("delay", "actuator-lag")
RIG = ("payload-mass", "payload-shift", "off-diagonal-inertia", "encoder-offset", "base-tilt")


@dataclass(frozen=True)
class Size:
    """A finding's parameter with the interval that it is known to lie in; two deviations beside it are allowed."""

    cause: str
    parameter: str
    low: float
    high: float
    joint: str | None = None


@dataclass(frozen=True)
class Known:
    """What is known of a device.

    Causes stand as ``cause``, or ``cause@joint``; ``*`` stands for any cause of physics.

    Attributes:
        device: Its name.
        logs: How the names of its cases begin.
        found: All of these must be found for *right*; alternatives are parted by ``|``.
        denied: Causes that the device does not have: naming one is *wrong*.
        sizes: Intervals of the sizes of named findings.
        harmonics: Harmonics per turn that cogging must have for *right*.
        share: Largest ratio of the held-out errors after and before the findings for *right*.
        faults: Faults of the data that its logs have; another one that makes the physics unreliable is *wrong*.
        has_torque: Whether its logs hold a torque; without, a refusal is the only right answer.
    """

    device: str
    logs: tuple[str, ...]
    found: tuple[str, ...] = ()
    denied: tuple[str, ...] = ()
    sizes: tuple[Size, ...] = ()
    harmonics: frozenset[int] = frozenset()
    share: float = inf
    faults: tuple[str, ...] = ()
    has_torque: bool = True


# A current loop follows within milliseconds; 43 ms is the least lag that was ever named for cogging.
PROMPT = tuple(
    Size(cause, name, 0.0, 0.043)
    for cause, name in (("delay", "time"), ("actuator-lag", "time_constant"))
)
ALIGNED = tuple(
    Size(cause, name, 0.0, 0.005)
    for cause, name in (("delay", "time"), ("actuator-lag", "time_constant"))
)
# An AK80-6's rotor has 0.002 to 0.003 kg m² behind its gear.
AK80 = (Size("armature", "inertia", 0.0, 0.003), *PROMPT)
# Plain least squares on two logs a week apart, kg m², with the fifth by which two logs may differ.
WRISTS = tuple(
    Size("armature", "inertia", 0.8 * low, 1.2 * high, f"wrist_{k}_joint")
    for k, (low, high) in enumerate(((0.345, 0.385), (0.531, 0.548), (0.455, 0.485)), start=1)
)
# Published rotor inertias, kg m², with the same fifth.
ROTORS = tuple(
    Size("armature", "inertia", 0.8 * x, 1.2 * x, f"joint_{k}")
    for k, x in ((3, 0.092), (4, 0.032), (5, 0.044))
)
BARE = ("cable-spring", "backlash", "joint-flexibility", "saturation", "dead-zone", *RIG)
"""What a bare motor without a gear, a load or a cable cannot have, far below its rail."""

DEVICES = (
    # Host clocks that jitter; slow_d lost two samples of five.
    Known("ODrive motor", ("odrive_",), ("cogging",), BARE, PROMPT, share=0.3, faults=("clock",)),
    Known("omodri at constant speed", ("laas_speed",), ("cogging", "controller-formula"), BARE, ALIGNED,
          frozenset({18, 72}), faults=("controller-formula",)),
    Known("omodri, accelerated", ("laas_acc",), (), BARE, PROMPT),
    Known("EMPS axis", ("emps",), ("asymmetric-friction",), ("saturation", "joint-flexibility", *LAGS, *RIG),
          share=0.5),
    # The rate is 20 ms late, by the servo's own filter.
    Known("XL330 servo", ("servo_",), ("load-dependent-friction|stribeck",), ("saturation", "joint-flexibility"),
          faults=("filtered-velocity",)),
    # The torque is the stiffness times the error; 6 N m is the most that the servo delivers.
    Known("STS3250 servo, sine", ("feetech_12h23m27",), ("load-dependent-friction",), ("joint-flexibility",),
          share=0.9, faults=("commanded-torque",)),
    Known("STS3250 servo, overloaded", ("feetech_12h24m55",), ("commanded-torque",), ("joint-flexibility",),
          faults=("commanded-torque",)),
    Known("STS3250 servo, up and down", ("feetech_12h27m27",), ("stribeck",), ("saturation", "joint-flexibility"),
          share=0.9),
    Known("TX40 arm", ("staubli",), ("armature@joint_3", "armature@joint_4"), ("*@joint_5", "*@joint_6"), ROTORS),
    # Smoothed off line at 2 Hz, with less than half of every motor's torque.
    Known("UR10 arm", ("ur10_unisa",), (), ("saturation", "joint-flexibility")),
    # The measured torque exceeds any limit below the motors' own.
    Known("FER arm", ("fer_unisa",), (), ("saturation",)),
    Known("AK80-6 pendulum", ("simple_system_identification",), ("acceleration-noise",), ("joint-flexibility",),
          AK80, faults=("acceleration-noise",)),
    Known("AK80-6 pendulum", ("simple_direct_collocation",), (), ("joint-flexibility",), AK80),
    Known("AK80-6 pendulum, gravity compensated", ("simple_gravity_compensation",), ("controller-formula",), ("*",),
          faults=("controller-formula",)),
    Known("double pendulum, mjbots", ("double_C1",), (), (), PROMPT),
    # No model of one log carries over to another.
    Known("double pendulum, three logs", ("double_three",), (), (), AK80, faults=("logs-disagree",)),
    Known("double pendulum", ("double_",), (), (), AK80),
    Known("UR10e", ("ur10e",), tuple(f"armature@wrist_{k}_joint" for k in (1, 2, 3)), LAGS, WRISTS),
    Known("TIAGo", ("tiago",), ("filtered-velocity",), ("joint-flexibility",), faults=("filtered-velocity",)),
    Known("camera gimbal", ("rub_gimbal",), has_torque=False),
    Known("platform in flight", ("phantom4_motion",), has_torque=False),
)  # fmt: skip


def known_of(case: str) -> Known | None:
    """Return what is known of a case's device, or None."""
    return next((one for one in DEVICES if case.startswith(one.logs)), None)
