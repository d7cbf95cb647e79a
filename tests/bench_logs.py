"""Logs for tests: a prescribed motion with the torque that it takes, and closed loops with their noise-free truth."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np

from gimbal_pin.control import repeated, tune
from gimbal_pin.dynamics import (
    Model,
    Plant,
    Sensors,
    State,
    build_friction_effects,
    nominal,
    reduce_parameters,
    simulate,
)
from gimbal_pin.excitation import excite
from gimbal_pin.identification import Identified, given_beta, identify
from gimbal_pin.log import Array, BaseMotion, Log, Motion
from gimbal_pin.regression import Design, Filtering, Samples, Segment
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
    tau = model.inverse(motion.q, motion.v, motion.a)
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


def truth(plant: Model, log: Log, tau: Array) -> Motion:
    """The plant's state in the middle of every held torque, replayed from the torques that acted."""
    system = Plant(plant)
    half = log.dt / 2
    state = State(np.array(log.q_ref[0]), np.zeros(plant.rig.n))  # type: ignore[index]
    q, v, a = (np.empty((len(log), plant.rig.n)) for _ in range(3))
    for k, t in enumerate(log.t.tolist()):
        state = system.step(t, state, tau[k], half)
        q[k], v[k] = state.q, state.v
        a[k] = system.acceleration(t, state, tau[k])
        state = system.step(t, state, tau[k], half)
    return Motion(log.t, q, v, a)


def oracle(rig: Rig, log: Log, tau: Array) -> Identified:
    """The same fit with the true, noise-free q, v and a; a joint is at standstill only where it truly is."""
    true = truth(nominal(rig), log, tau)
    measured = np.asarray(log.tau)

    def channels(
        stretch: Segment, _: Filtering, first: int, last: int, carrier: str | None
    ) -> Samples:
        assert carrier is None
        begin = round((stretch.start - log.t[0]) / log.dt) + first
        part = slice(begin, begin + last - first)
        t, q, v, a, tau = (x[part] for x in (true.t, true.q, true.v, true.a, measured))
        return Samples(t, q, v, a, tau, v, np.zeros(rig.n))

    with (
        patch("gimbal_pin.regression.design.smooth_samples", channels),
        patch(
            "gimbal_pin.regression.design.find_standstill",
            lambda channels, _: np.abs(channels.v) < 1e-12,
        ),
    ):
        return identify(rig, [log])


def closed_loop(
    rig: Rig, seed: int, seconds: float, torque_noise: float = 0.01, bits: float = 16
) -> tuple[Log, Array]:
    """A simulated excitation under computed torque, and the torque that acted without the sensor's noise."""
    rng = np.random.default_rng(seed)
    plant = nominal(rig)
    reference = repeated(excite(rig, starts=1, rng=rng).motion, seconds, 1e-3)
    sensors = replace(Sensors.of(rig, 1e-3), encoder_step=np.full(rig.n, 2 * np.pi / 2**bits))
    log = simulate(plant, tune(plant).controller, reference, rng=rng, sensors=sensors)
    tau = np.array(log.tau)
    noise = torque_noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    return replace(log, tau=tau + noise), tau
