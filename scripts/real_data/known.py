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
        at: The joint that `share` is asked of; all joints where it is empty.
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
    at: str = ""
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
# Plain least squares on four logs, 0.69 to 0.76 kg, with the same fifth; an offset in its place, 2 N, would be wrong.
COUNTERWEIGHT = (
    Size("armature", "inertia", 0.55, 0.92, "insertion"),
    Size("torque-bias", "bias", -0.3, 0.3, "insertion"),
    *PROMPT,
)
# Plain least squares on logs in both directions: 0.0073 to 0.0081 N m.
SENSOR_ZERO = (Size("torque-bias", "bias", 0.004, 0.011), *PROMPT)
BARE = ("cable-spring", "backlash", "joint-flexibility", "saturation", "dead-zone", *RIG)
"""What a bare motor without a gear, a load or a cable cannot have, far below its rail."""
BLURRED = (*BARE, "cogging", "torque-ripple")
"""Nor, in a band of a few Hz, one that turns twenty to fifty times a second."""
UNDRIVEN = tuple(f"{cause}@pivot" for cause in ("cogging", "torque-ripple", "torque-gain", "torque-bias", "armature",
                                                "actuator-lag", "delay", "cable-spring"))  # fmt: skip
"""What a joint cannot have that turns freely, without motor, gear and cable."""

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
    # The counterweight's inertia at the tool's axis. Of a held-out third plain least squares at 4 Hz leaves 6.3, 12.4
    # and 46 % (10.7, 13.0 and 41 % of the other log's), with an inertia at the insertion 3.9, 11.4 and 10 % (3.0, 12.4
    # and 11 %). A whole model with parallelogram, wrist and counterweight is published (Wang et al., RA-L 2019):
    # Coulomb 0.050, 0.067 N m, 0.45 N, viscous 0.091, 0.218 N m s/rad, 1.20 N s/m. A model of no weight and 105 g
    # leaves twice of 205 g's log what its own model leaves at the yaw, and half as much again at the pitch.
    Known("PSM arm, three weights", ("psm_together",), ("logs-disagree|payload-mass|payload-shift",),
          ("saturation", "dead-zone"), COUNTERWEIGHT, faults=("logs-disagree",)),
    Known("PSM arm", ("psm_",), ("armature@insertion",), ("saturation", "dead-zone"), COUNTERWEIGHT, share=0.4,
          at="insertion"),
    # A current sensor's zero, or another friction in the other direction: 7.5 mN m. Of the held-out log's 53 mN m
    # plain least squares leaves 7.9, with the offset 4.3, with a viscous friction of each direction 3.0. Friction falls
    # as the motors warm up. Within one log the motor turns one way, and neither can be told from Coulomb friction:
    # least squares leaves 5 % of the torque, the current's white noise and the drift of the friction.
    Known("HSM150 motors, both ways", ("hsm150_together",), ("torque-bias|asymmetric-friction",), BLURRED, SENSOR_ZERO,
          share=0.7),
    Known("HSM150 motors", ("hsm150_",), (), (*BLURRED, "torque-bias", "asymmetric-friction"), PROMPT),
    # The author measured Coulomb friction at 68 places and in both directions, 2.0 to 3.2 N one way, 1.9 to 5.6 N the
    # other: a force over the way beside a friction over it. Of a held-out third plain least squares at 4 Hz leaves
    # 10 %, with eight coefficients of a force over the way 5 %, with a cubic spring 8 %, with friction over the way
    # beside the force 4 %, with friction that differs by direction alone 10 %. The current is what the controller asked
    # for: a law of the pendulum's energy and that table. Nobody drives the pendulum; it swings as its length says.
    Known("cart and pendulum", ("cart_",), ("cogging@belt|cable-spring@belt|position-dependent-friction@belt",),
          ("saturation", "dead-zone", *UNDRIVEN), PROMPT, share=0.8, at="belt", faults=("controller-formula",)),
    Known("camera gimbal", ("rub_gimbal",), has_torque=False),
    Known("platform in flight", ("phantom4_motion",), has_torque=False),
)  # fmt: skip


def known_of(case: str) -> Known | None:
    """Return what is known of a case's device, or None."""
    return next((one for one in DEVICES if case.startswith(one.logs)), None)
