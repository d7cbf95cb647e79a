"""Time of a diagnosis over the whole library: 60 s at 500 Hz of one, three and seven axes with two causes."""

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

SECONDS = 60.0
RATE = 500.0
ROUNDS = 3
LONGEST_SECONDS = {"one": 1.0, "three": 4.0, "seven": 15.0}
"""Longest time of a diagnosis, s, by the rig's axes."""


def measure() -> Iterator[Figure]:
    """Yield the wall time and the processor time of a diagnosis."""
    for axes, rig in (("one", chain(1)), ("three", Rig.load("thesis")), ("seven", chain(7))):
        count = round(SECONDS / DT)
        step = round(1 / (RATE * DT))
        log = hold_commands(noisy_log(plant_two_causes(rig), count, np.random.default_rng(3)), step)
        wall, cpu = wall_and_cpu(partial(diagnose, rig, [log]), ROUNDS, "diagnosis")
        name = f"diagnosis over the whole library, {SECONDS:g} s at {RATE:g} Hz, {axes} axes"
        yield Figure(name, wall, "s", at_most=LONGEST_SECONDS[axes])
        yield Figure("the same, processor time", cpu, "s")


def plant_two_causes(rig: Rig) -> Model:
    """Return a rig with cogging at its first joint and Stribeck friction at its last."""
    first = rig.joints[0]
    last = rig.joints[-1]
    texts = f"cogging:{first}:amplitude=0.03,harmonic=42", f"stribeck:{last}:speed=0.1,extra=0.05"
    return plant_with(nominal(rig), [parse_effect(text, rig) for text in texts]).plant


def hold_commands(log: Log, step: int) -> Log:
    """Return every `step`-th sample, with the torque half way to the next: a drive holds its command."""
    assert log.tau is not None and log.v is not None
    tau = log.tau[step // 2 :: step]
    rows = slice(0, len(tau) * step, step)
    return replace(log, t=log.t[rows], q=log.q[rows], v=log.v[rows], tau=tau)
