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
    """

    device: str
    logs: tuple[str, ...]
    found: tuple[str, ...] = ()
    denied: tuple[str, ...] = ()
    sizes: tuple[Size, ...] = ()
    harmonics: frozenset[int] = frozenset()
    share: float = inf


# A current loop follows within milliseconds; 43 ms is the least lag that was ever named for cogging.
PROMPT = tuple(Size(cause, name, 0.0, 0.043) for cause, name in (("delay", "time"), ("actuator-lag", "time_constant")))
ALIGNED = tuple(Size(cause, name, 0.0, 0.005) for cause, name in (("delay", "time"), ("actuator-lag", "time_constant")))
# An AK80-6's rotor has 0.002 to 0.003 kg m² behind its gear.
AK80 = (Size("armature", "inertia", 0.0, 0.003), *PROMPT)
# Plain least squares on two logs a week apart, kg m², with the fifth by which two logs may differ.
WRISTS = tuple(
    Size("armature", "inertia", 0.8 * low, 1.2 * high, f"wrist_{k}_joint")
    for k, (low, high) in enumerate(((0.345, 0.385), (0.531, 0.548), (0.455, 0.485)), start=1)
)
# Published rotor inertias, kg m², with the same fifth.
ROTORS = tuple(
    Size("armature", "inertia", 0.8 * x, 1.2 * x, f"joint_{k}") for k, x in ((3, 0.092), (4, 0.032), (5, 0.044))
)
BARE = ("cable-spring", "backlash", "joint-flexibility", "saturation", "dead-zone", *RIG)
"""What a bare motor without a gear, a load or a cable cannot have, far below its rail."""

DEVICES = (
    Known("ODrive motor", ("odrive_",), ("cogging",), BARE, PROMPT, share=0.3),
    Known("omodri at constant speed", ("laas_speed",), ("cogging", "controller-formula"), BARE, ALIGNED,
          frozenset({18, 72})),
    Known("omodri, accelerated", ("laas_acc",), (), BARE, PROMPT),
    Known("EMPS axis", ("emps",), ("asymmetric-friction",), ("saturation", "joint-flexibility", *LAGS, *RIG),
          share=0.5),
    Known("XL330 servo", ("servo_",), ("load-dependent-friction|stribeck",), ("saturation", "joint-flexibility")),
    Known("TX40 arm", ("staubli",), ("armature@joint_3", "armature@joint_4"), ("*@joint_5", "*@joint_6"), ROTORS),
    Known("AK80-6 pendulum", ("simple_system_identification",), ("acceleration-noise",), ("joint-flexibility",),
          AK80),
    Known("AK80-6 pendulum", ("simple_direct_collocation",), (), ("joint-flexibility",), AK80),
    Known("AK80-6 pendulum, gravity compensated", ("simple_gravity_compensation",), ("controller-formula",), ("*",)),
    Known("double pendulum, mjbots", ("double_C1",), (), (), PROMPT),
    Known("double pendulum", ("double_",), (), (), AK80),
    Known("UR10e", ("ur10e",), tuple(f"armature@wrist_{k}_joint" for k in (1, 2, 3)), LAGS, WRISTS),
    Known("TIAGo", ("tiago",), ("filtered-velocity",), ("joint-flexibility",)),
)  # fmt: skip


def known_of(case: str) -> Known | None:
    """Return what is known of a case's device; None: nothing, it has no torque."""
    return next((one for one in DEVICES if case.startswith(one.logs)), None)
