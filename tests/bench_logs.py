"""Logs for tests: a prescribed motion with the torque that it takes, and what a fit of it should find."""

from __future__ import annotations

import numpy as np

from gimbal_pin.dynamics import Model, build_friction_effects, reduce_parameters
from gimbal_pin.identification import given_beta
from gimbal_pin.log import Array, BaseMotion, Log, Motion
from gimbal_pin.regression import Design, Filtering
from gimbal_pin.rig import Rig

EXACT = Filtering(alignment=0.0)
"""The torque is that at the sample itself, as in `prescribed`."""


def fourier(rig: Rig, seed: int, seconds: float, dt: float = 1e-3) -> Motion:
    """A sum of five sines per joint, well inside the rig's limits."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(round(seconds / dt) + 1)
    q, v, a = (np.zeros((len(t), rig.n)) for _ in range(3))
    for j, limit in enumerate(rig.limits):
        for harmonic in range(1, 6):
            size = rng.normal() / harmonic
            phase = rng.uniform(0, 2 * np.pi)
            w = 0.86 * harmonic
            q[:, j] += size * np.sin(w * t + phase)
            v[:, j] += size * w * np.cos(w * t + phase)
            a[:, j] -= size * w * w * np.sin(w * t + phase)
        half = min(0.4 * (limit.upper - limit.lower), 1.2)
        scale = min(half / abs(q[:, j]).max(), 1.5 / abs(v[:, j]).max())
        for x in (q, v, a):
            x[:, j] *= scale
        q[:, j] += 0.5 * (max(limit.lower, -3) + min(limit.upper, 3))
    return Motion(t, q, v, a)


def prescribed(
    model: Model, seed: int = 0, seconds: float = 20.0, torque_noise: float = 0.0, dt: float = 1e-3
) -> Log:
    """The log of a motion that nothing disturbs: torque by inverse dynamics, at the sample itself (alignment 0)."""
    motion = fourier(model.rig, seed, seconds, dt)
    tau = model.inverse_dynamics(motion.q, motion.v, motion.a)
    noise = (
        torque_noise
        * np.sqrt(np.mean(tau**2, axis=0))
        * np.random.default_rng(seed + 1).standard_normal(tau.shape)
    )
    return Log(f"prescribed {seed}", model.rig.joints, motion.t, motion.q, motion.v, tau + noise)


def rows_of(rig: Rig, log: Log, filtering: Filtering = EXACT, base: BaseMotion = "fixed") -> Design:
    """The rows of one log for base parameters, Coulomb and viscous friction."""
    return Design(
        rig,
        reduce_parameters(rig, base=base),
        build_friction_effects(rig.joints),
        (log,),
        filtering,
    )


def true_theta(rig: Rig, base: BaseMotion = "fixed") -> Array:
    """What a rig's own base parameters, Coulomb and viscous friction are."""
    return np.concatenate(
        [given_beta(rig, reduce_parameters(rig, base=base)), rig.friction.ravel()]
    )
