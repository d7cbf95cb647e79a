"""One log against the whole library: 60 s at 500 Hz of rigs of three and seven axes with two causes in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from benchmark.data import DT, noisy_log
from benchmark.figure import Figure
from benchmark.timing import wall_and_cpu
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.simulation import plant_with
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.log.log import Log
from gimbal_pin.rig.rig import Rig
from tests.rigs import chain

SECONDS, RATE = 60.0, 500.0
ROUNDS = 3
MOST = {"three": 10.0, "seven": 60.0}
"""Time that a diagnosis may take, s, by the rig's axes."""


def measure() -> Iterator[Figure]:
    """Yield the time that a diagnosis takes, and the processor's time in it."""
    for axes, rig in (("three", Rig.load("thesis")), ("seven", chain(7))):
        steps = round(SECONDS / DT), round(1 / (RATE * DT))
        log = held(noisy_log(plant_two_causes(rig), steps[0], np.random.default_rng(3)), steps[1])
        wall, cpu = wall_and_cpu(partial(diagnose, rig, [log]), ROUNDS, "diagnosis")
        name = f"diagnosis over the whole library, {SECONDS:g} s at {RATE:g} Hz, {axes} axes"
        yield Figure(name, wall, "s", at_most=MOST[axes])
        yield Figure("the same, processor time", cpu, "s")


def plant_two_causes(rig: Rig) -> Model:
    """A rig with cogging at its first joint and a Stribeck friction at its last."""
    first = rig.joints[0]
    last = rig.joints[-1]
    texts = f"cogging:{first}:amplitude=0.03,harmonic=42", f"stribeck:{last}:speed=0.1,extra=0.05"
    return plant_with(nominal(rig), [parse_effect(text, rig) for text in texts]).plant


def held(log: Log, step: int) -> Log:
    """Every so manyth sample, with the torque half way to the next: that of a drive that holds its command."""
    assert log.tau is not None and log.v is not None
    tau = log.tau[step // 2 :: step]
    rows = slice(0, len(tau) * step, step)
    return replace(log, t=log.t[rows], q=log.q[rows], v=log.v[rows], tau=tau)
