"""Where a model is worth less than its uncertainty, a PID is safer: which joints to leave to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.control.laws.uncertainty import base_columns, columns
from gimbal_pin.dynamics.model import Model
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.seen import rotations
from gimbal_pin.pointing.sight import Sight

SAMPLES = 200
"""Moments at which the model is judged."""


def trusted(model: Model, wanted: Array, platform: Platform) -> tuple[bool, ...]:
    """Return, per joint, whether the estimated torque says more than its deviation: ``rms(Y P Yᵀ) < var(Y θ)``.

    Both along the motion that holds the camera on the given platform. What a PID's integral finds by itself, the mean
    of the torque, counts for nothing. A model that was never identified is believed.

    Args:
        model: The model, with its covariance.
        wanted: The camera's attitude in the world, (3, 3).
        platform: A motion of the platform with its attitude.
    """
    known = model.estimated
    places = None if known is None else base_columns(model, known)
    if known is None or places is None:
        return (True,) * model.rig.n
    part, held, Y = along(model, places, wanted, platform)
    variance = np.einsum("njk,kl,njl->nj", Y, known.covariance, Y)
    torque = model.inverse(held.q, held.v, held.a, platform=part)
    return tuple((variance.mean(axis=0) < torque.var(axis=0)).tolist())


def along(model: Model, places: Array, wanted: Array, platform: Platform) -> tuple[Platform, Motion, Array]:
    """Return moments of a platform's motion, what holds the camera there, and torque per unit parameter, (N, n, k)."""
    part = platform.part(slice(None, None, max(1, len(platform) // SAMPLES)))
    held = holding(Sight(model.rig), wanted, part)
    return part, held, columns(model, places, held.q, held.v, held.a, part)


def doubtful(model: Model, wanted: Array, platform: Platform) -> Array | None:
    """Return the change of parameters, one standard deviation long, that changes the torque most along a motion.

    ``P = L Lᵀ``: L times the eigenvector of ``Lᵀ mean(Yᵀ Y) L`` with the largest eigenvalue. None without covariance.
    """
    known = model.estimated
    places = None if known is None else base_columns(model, known)
    if known is None or places is None:
        return None
    Y = along(model, places, wanted, platform)[2]
    power, size = np.linalg.eigh(known.covariance)
    L = size * np.sqrt(np.maximum(power, 0.0))
    seen = L.T @ np.einsum("njk,njl->kl", Y, Y) @ L / len(Y)
    return np.asarray(L @ np.linalg.eigh(seen)[1][:, -1])


def drawn(model: Model, rng: np.random.Generator) -> Model:
    """Return a model whose parameters are drawn from the covariance of another one's; the same where it has none."""
    known = model.estimated
    places = None if known is None else base_columns(model, known)
    if known is None or places is None:
        return replace(model, estimated=None)
    return changed(model, rng.multivariate_normal(np.zeros(len(known.theta)), known.covariance, method="eigh"))


def changed(model: Model, change: Array) -> Model:
    """Return a model with its estimated parameters changed, (k,): base parameters, then the terms'."""
    places = None if model.estimated is None else base_columns(model, model.estimated)
    if places is None:
        return replace(model, estimated=None)
    phi, at, terms = model.rig.phi.copy(), len(places), []
    phi[places] += change[:at]
    for term in model.terms:
        size = len(term.values)
        terms.append(replace(term, values=tuple((np.array(term.values) + change[at : at + size]).tolist())))
        at += size
    return replace(model, rig=model.rig.with_phi(phi), terms=tuple(terms), estimated=None)


def holding(sight: Sight, wanted: Array, platform: Platform) -> Motion:
    """Return the joints' motion that keeps the camera's attitude, exactly, sample by sample."""
    if platform.quat is None:
        return holding(sight, wanted, Platform.still(platform.t))
    q, rows = sight.home, []
    for R, w, dw in zip(rotations(np.asarray(platform.quat)), platform.w, platform.dw):
        q = sight.reached(R, wanted, q)
        view = sight.view(q)
        v = view.against @ (view.R.T @ w)
        rows.append((q, v, view.against @ sight.drift(q, v, w, dw)))
    return Motion(platform.t, *(np.array(x) for x in zip(*rows)))
