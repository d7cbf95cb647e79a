"""Logs of perturbed rigs: a prescribed motion through the rig's sensors, and coloured noise on the torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from gimbal_pin.control.experiment import perturbed
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.simulation import Sensors
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.files import bundled_payloads, bundled_rigs
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import prescribed


def drawn(seed: int, spread: float = 0.2) -> tuple[Rig, Model, np.random.Generator]:
    """Return a bundled rig with a payload, and a plant whose bodies differ from its URDF."""
    rng = np.random.default_rng(seed)
    rigs = bundled_rigs()
    payloads = bundled_payloads()
    rig = Rig.load(rigs[seed % len(rigs)], payloads[int(rng.integers(len(payloads)))])
    return rig, perturbed(rig, spread, rng), rng


def coloured(rng: np.random.Generator, shape: tuple[int, int], corner: float, dt: float) -> Array:
    """Noise of unit variance, white through a first-order low-pass at `corner` Hz."""
    pole = float(np.exp(-2 * np.pi * corner * dt))
    start = rng.standard_normal(shape[1])[None]
    white = np.sqrt(1 - pole**2) * rng.standard_normal(shape)
    return np.asarray(lfilter([1.0], [1.0, -pole], white, axis=0, zi=pole * start)[0])


def noisy(
    plant: Model, rng: np.random.Generator, seconds: float, share: float, corner: float
) -> tuple[Log, Log]:
    """Return a log with coloured torque noise of so large a share of each joint's rms, and one without any noise."""
    clean = prescribed(plant, int(rng.integers(2**31)), seconds)
    sensors = Sensors.of(plant.rig, clean.dt)
    tau = np.asarray(clean.tau)
    step = np.where(sensors.encoder_step > 0, sensors.encoder_step, 1e-15)
    q = np.round(clean.q / step) * step
    v = np.asarray(clean.v) + sensors.rate_std * rng.standard_normal(tau.shape)
    noise = (
        share
        * np.sqrt(np.mean(tau**2, axis=0))
        * coloured(rng, (len(tau), tau.shape[1]), corner, clean.dt)
    )
    return replace(clean, q=q, v=v, tau=tau + noise), clean
