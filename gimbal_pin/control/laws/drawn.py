"""How far the loop's gain may be off: parameter sets drawn from the model's covariance."""

from __future__ import annotations

import numpy as np

from gimbal_pin.control.laws.uncertainty import POSES, VARIED, base_columns, home, inertia, poses, pushes
from gimbal_pin.dynamics.model import Model
from gimbal_pin.log.log import Array

DRAWS = 200
LARGEST = 1e3
"""Largest gain looked at: an inertia a thousand times smaller than believed, or one that no body has."""

Ratios = tuple[tuple[float, ...], ...]
"""Per joint: lowest gain of the plant over what the law believes, one, and the highest."""


def drawn(model: Model, kind: str, rng: np.random.Generator) -> Ratios | None:
    """Return each joint's ``D̂_jj/D_jj``: lowest, one and highest over `DRAWS` drawn parameter sets and all poses.

    D_jj is the inertia that the joint turns while the others hold still, its rotor's included; D̂ that of the model, at
    the same pose for computed torque and at home for a PID. A loop's margins fall off on both sides of its best gain,
    so the two ends have the worst of all draws. What else a set changes (gravity, friction) acts far below the
    crossover. A set that no body has (D_jj ≤ 0) counts as `LARGEST`.

    None where the model has no covariance, or one of another rig's parameters.

    Args:
        model: The model, as identified.
        kind: "computed-torque" or "pid".
        rng: Source of the draws; the same one gives deviations in proportion to the model's.
    """
    known = model.estimated
    places = None if known is None else base_columns(model, known)
    if known is None or places is None:
        return None
    q, _ = poses(model.rig, VARIED if kind == "pid" else POSES)
    believed = diagonals(inertia(model, q))
    zero = np.zeros(len(known.covariance))
    sets = rng.multivariate_normal(zero, known.covariance, DRAWS, method="eigh", check_valid="ignore")
    change = np.moveaxis(np.diagonal(pushes(model, places, q, np.zeros_like(q)), axis1=1, axis2=2), 1, 2)  # (N, n, k)
    true = believed + np.einsum("ijk,sk->sij", change, sets)
    nominal = diagonals(inertia(model, home(model.rig)[None])) if kind == "pid" else believed
    ratios = nominal / np.maximum(true, nominal / LARGEST)
    return tuple((min(low, 1.0), 1.0, max(high, 1.0)) for low, high in ends(ratios.reshape(-1, model.rig.n)))


def widened(believed: Ratios, over: Ratios | None) -> Ratios:
    """Return the lowest and highest of both, and one, per joint; the first alone where there is no second."""
    if over is None:
        return believed
    both = (tuple(sorted({*a, *b})) for a, b in zip(believed, over))
    return tuple(tuple(sorted({every[0], 1.0, every[-1]})) for every in both)


def diagonals(matrices: Array) -> Array:
    """Diagonals, (N, n, n) → (N, n)."""
    return np.asarray(np.diagonal(matrices, axis1=1, axis2=2))


def ends(ratios: Array) -> list[tuple[float, float]]:
    """Lowest and highest of each column."""
    return list(zip(ratios.min(axis=0).tolist(), ratios.max(axis=0).tolist()))
