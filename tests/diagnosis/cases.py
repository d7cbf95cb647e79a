"""Short closed-loop logs of the turret with what is planted in them, and what the diagnosis says of each."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from gimbal_pin.control import bench_run, repeated, tune
from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import CAUSES, Cause, parse_effect
from gimbal_pin.excitation import excite
from gimbal_pin.log import Array, Log, Motion
from tests.refitted import RIG

DT = 0.005


class Case(NamedTuple):
    """What a log hides, the causes among which it is looked for, and the verdict."""

    planted: tuple[str, ...]
    causes: tuple[str, ...]
    verdict: str = "named"


CASES = {
    "nothing": Case((), tuple(CAUSES), "nothing"),
    "teeth and breakaway": Case(
        ("cogging:pan:amplitude=0.02,harmonic=14", "stribeck:tilt:extra=0.03,speed=0.2"),
        tuple(CAUSES),
    ),
    "tight spot and gap": Case(
        ("position-dependent-friction:pan:amplitude=0.02,harmonic=3", "dead-zone:tilt:width=0.02"),
        ("position-dependent-friction", "load-dependent-friction", "cogging", "dead-zone"),
    ),
    "lag": Case(
        ("actuator-lag:tilt:time_constant=0.012",), ("actuator-lag", "delay", "saturation")
    ),
    "delay": Case(("delay:tilt:time=0.012",), ("actuator-lag", "delay", "saturation")),
    "limit": Case(("saturation:pan:limit=0.45",), ("saturation", "dead-zone", "torque-gain")),
    "ripple": Case(
        ("torque-ripple:tilt:amplitude=0.3,harmonic=9",), ("torque-ripple", "cogging", "saturation")
    ),
    "drag": Case(("quadratic-drag:tilt:drag=0.06,power=2.3",), ("quadratic-drag", "stribeck")),
    "lean": Case(("base-tilt:roll=0.03,pitch=0.05",), ("base-tilt", "stribeck")),
    "cable": Case(
        ("cable-spring:tilt:stiffness=0.5,rest=0.2",),
        ("cable-spring", "torque-bias", "asymmetric-friction"),
    ),
    "film": Case(
        ("asymmetric-friction:pan:coulomb=0.05,speed=0.3",), ("asymmetric-friction", "torque-gain")
    ),
    "warming": Case(("friction-drift:pan:coulomb=0.1,span=5",), ("friction-drift", "stribeck")),
}


@cache
def motion() -> Motion:
    """Nine seconds of an excitation."""
    design = excite(
        RIG, seconds=6.0, starts=1, rng=np.random.default_rng(5), torque_model=nominal(RIG), dt=DT
    )
    return repeated(design.motion, 9.0, DT)


@cache
def log_of(case: str) -> Log:
    """Return a log of a case with the turret's own encoders and gyros, and 1 % torque noise."""
    planted = [parse_effect(text, RIG) for text in CASES[case].planted]
    altered = plant_with(nominal(RIG), planted)
    mover = tune(nominal(RIG), bandwidth_hz=4.0, dt=DT).controller
    rng = np.random.default_rng(2)
    return bench_run(altered.plant, mover, rng=rng, reference=motion(), drive=altered.drive)


def few(*names: str) -> dict[str, type[Cause]]:
    """Causes of these names."""
    return {name: CAUSES[name] for name in names}


@cache
def found(case: str) -> Diagnosis:
    """Return what is found in a case."""
    return diagnose(RIG, log_of(case), few(*CASES[case].causes))


def push(torque: Array) -> Log:
    """Return the log that hides nothing with a torque of unknown origin at the first joint, N m, (N,)."""
    log = log_of("nothing")
    return replace(log, tau=np.asarray(log.tau) + np.outer(torque, [1.0, 0.0]))


def notch(angle: Array) -> Array:
    """Return the torque of a detent between 10° and 20°, N m."""
    share = (angle - np.radians(10)) / np.radians(10)
    return np.where((share > 0) & (share < 1), 0.05 * np.sin(np.pi * share) ** 2, 0.0)


@cache
def detent() -> Diagnosis:
    """Return what is found where pan goes over a detent, and only teeth are looked for."""
    return diagnose(RIG, push(notch(log_of("nothing").q[:, 0])), few("cogging"))
