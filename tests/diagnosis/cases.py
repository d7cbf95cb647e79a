"""Short logs of small rigs with what is planted in them, and what the diagnosis says of each."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from gimbal_pin.control import bench_run, repeated
from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.excitation import excite
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.refitted import RIG

DT = 2e-3
SECONDS = 26.0
"""Length of a log under closed loop: from 25 s on a fifth of the rows is kept for the figures."""
SHORT_SECONDS = 14.0
"""Length of a prescribed motion."""
NOISE = 0.01
"""White noise of the torque as a share of its rms."""
TEETH = ("cogging:pan:amplitude=0.02,harmonic=14", "stribeck:tilt:extra=0.03,speed=0.2")


def trust(rig: Rig) -> Rig:
    """Return a rig whose URDF is trusted."""
    return replace(rig, config=replace(rig.config, inertia="trusted"))


RIGS = {"turret": RIG, "trusted": trust(RIG), "prescribed": RIG, "thesis": Rig.load("thesis")}
"""Rigs of the logs; those of the last two follow a prescribed motion."""


@cache
def design_motion() -> Motion:
    """Return an excitation of the turret, repeated."""
    rng = np.random.default_rng(5)
    design = excite(RIG, seconds=8.0, starts=1, rng=rng, torque_model=nominal(RIG), dt=DT)
    return repeated(design.motion, SECONDS, DT)


@cache
def log_of(*planted: str) -> Log:
    """Return a log of the turret under closed loop, with its own encoders and gyros."""
    altered = plant_with(nominal(RIG), [parse_effect(text, RIG) for text in planted])
    rng = np.random.default_rng(2)
    return bench_run(altered.plant, rng=rng, reference=design_motion(), drive=altered.drive)


@cache
def prescribe(rig: str, *planted: str) -> Log:
    """Return a log of a motion that nothing disturbs."""
    model = plant_with(nominal(RIGS[rig]), [parse_effect(text, RIGS[rig]) for text in planted])
    return prescribed(model.plant, 3, SHORT_SECONDS, NOISE, 4e-3)


@cache
def find(rig: str, *planted: str) -> Diagnosis:
    """Return what is found where causes are planted; drives need a closed loop."""
    is_free = rig in ("prescribed", "thesis")
    return diagnose(RIGS[rig], prescribe(rig, *planted) if is_free else log_of(*planted))


def push(torque: Array, joint: int = 0) -> Log:
    """Return the turret's log that hides nothing with a torque of unknown origin at a joint, N m, (N,)."""
    log = prescribe("prescribed")
    return replace(log, tau=np.asarray(log.tau) + np.outer(torque, np.eye(RIG.n)[joint]))
