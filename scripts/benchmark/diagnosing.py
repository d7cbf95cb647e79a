"""One log against the whole library: 60 s at 500 Hz of a three-axis rig with two causes in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmark.data import DT, noisy_log
from benchmark.figure import Figure
from benchmark.timing import wall_and_cpu
from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.dynamics.simulation import plant_with
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.log.log import Log
from gimbal_pin.rig.rig import Rig

SECONDS, RATE = 60.0, 500.0
ROUNDS = 3
PLANTED = ("cogging:yaw:amplitude=0.03,harmonic=42", "stribeck:tilt:speed=0.1,extra=0.05")


def measure() -> Iterator[Figure]:
    """Yield the time that a diagnosis takes, and the processor's time in it."""
    rig = Rig.load("thesis")
    plant = plant_with(nominal(rig), [parse_effect(text, rig) for text in PLANTED]).plant
    log = held(noisy_log(plant, round(SECONDS / DT), np.random.default_rng(3)), round(1 / (RATE * DT)))

    def ours() -> Diagnosis:
        return diagnose(rig, [log], rng=np.random.default_rng(0))

    wall, cpu = wall_and_cpu(ours, ROUNDS, "diagnosis")
    name = f"diagnosis over the whole library, {SECONDS:g} s at {RATE:g} Hz, three axes"
    yield Figure(name, wall, "s", at_most=10.0)
    yield Figure("the same, processor time", cpu, "s")


def held(log: Log, step: int) -> Log:
    """Every so manyth sample, with the torque half way to the next: that of a drive that holds its command."""
    assert log.tau is not None and log.v is not None
    tau = log.tau[step // 2 :: step]
    rows = slice(0, len(tau) * step, step)
    return replace(log, t=log.t[rows], q=log.q[rows], v=log.v[rows], tau=tau)
