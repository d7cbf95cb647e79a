"""Logs of planted terms."""

from __future__ import annotations

import numpy as np

from gimbal_pin.dynamics import Model, nominal
from gimbal_pin.effects import Term
from gimbal_pin.log import Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier

RIG = Rig.load("turret")
ALIGNED = Filtering(cutoff=12.0, smoothing=2.5, alignment=0.0)


def record(
    model: Model, seed: int = 3, seconds: float = 8.0, noise: float = 1e-3, dt: float = 2e-3
) -> Log:
    """A log of a model's prescribed motion, with white torque noise, N m."""
    motion = fourier(model.rig, seed, seconds, dt)
    tau = model.inverse_dynamics(motion.q, motion.v, motion.a, t=motion.t)
    tau += noise * np.random.default_rng(seed + 1).standard_normal(tau.shape)
    return Log("log", model.rig.joints, motion.t, motion.q, motion.v, tau)


def plant(*terms: Term, rig: Rig = RIG) -> Model:
    """The nominal model of a rig with terms on top."""
    return Model(rig, (*nominal(rig).terms, *terms))
