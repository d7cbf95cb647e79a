"""Are two halves of the data of one rig? A payload swapped in the middle of a log leaves a fit of neither."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtri

from gimbal_pin.log.log import Array
from gimbal_pin.regression import (
    Block,
    Design,
    compute_residual_power,
    count_effective_rows,
    decompose,
    factor_rows,
    find_camera_body,
    solve,
    weigh_and_solve,
    whiten,
)

FALSE_CHANGE = 1e-3
"""Chance of a score beyond the limit on two halves of one rig."""
SQUARES = 12.0
"""From how many squares the noise of a half is taken to be known: heavy tails for what its covariance leaves out."""
MATERIAL_CHANGE = 0.05
"""Change of the predicted torque, as a share of a joint's rms, below which two halves are of one rig for any use.

Noise of drives that is slow and smoothed makes up to 2.2 % on 500 clean logs of all bundled rigs and payloads
(``scripts/false-alarms``), where its covariance is known from seconds; exchanged cameras make 67 to 97 %. Twice as much
leaves a camera unnoticed that is heavier by a tenth of what the joint carries.
"""
TELLING = 3.0
"""Rows per parameter that each half must have."""


def split_halves(blocks: Sequence[Block]) -> tuple[list[Block], list[Block]]:
    """Return the first and the second half of the rows, in the order in which they stand."""
    parts: tuple[list[Block], list[Block]] = ([], [])
    left = sum(len(block.t) for block in blocks) // 2
    for block in blocks:
        for part, rows in zip(parts, (slice(0, max(left, 0)), slice(max(left, 0), None))):
            some = Block(*(x[rows] for x in block))
            if len(some.t):
                part.append(some)
        left -= len(block.t)
    return parts


def payload_directions(rows: Design) -> Array:
    """How the parameters of the camera's body, as far as they show, move all parameters, orthonormal, (k, r)."""
    body = find_camera_body(rows.rig)
    own = rows.mixing[:, 10 * body : 10 * body + 10]
    U = decompose(own).U
    return np.vstack([U, np.zeros((len(rows.names) - len(own), U.shape[1]))])


def compare_halves(blocks: Sequence[Block], rows: Design) -> float:
    """Return significance or size of the halves' difference, each over its limit, whichever is less.

    ``dᵀP⁻¹D (DᵀP⁻¹D)⁻¹ DᵀP⁻¹d / r`` is the significance (Chow 1960): d is the difference of the two halves' parameters
    and P the sum of their covariances under coloured residuals; of it only what lies along D counts, what a payload can
    move: friction that warms up is no other rig. The size is what that difference changes in the torque of the rows, as
    a share of its rms, at the joint that feels it most. Above one, the halves are of two rigs; zero where a half has
    too few rows.

    `rows`: what the blocks are of.
    """
    parts = split_halves(blocks)
    if any(
        count_effective_rows(part).sum() < TELLING * len(rows.names) for part in parts if part
    ) or not all(parts):
        return 0.0
    count = count_effective_rows(blocks)
    factors = factor_rows(blocks)
    *_, scale = weigh_and_solve(
        factors, lambda theta: compute_residual_power(factors, theta, count)
    )
    each = [solve(part, scale=scale) for part in parts]
    significance, change = score_halves(
        [(one.theta, one.covariance) for one in each], payload_directions(rows)
    )
    torque = np.concatenate([block.b for block in blocks])
    moved = np.concatenate([block.A @ change for block in blocks])
    power = np.mean(torque**2, axis=0)
    felt = np.where(power > 1e-6 * power.max(), power, np.inf)
    size = float(np.sqrt(np.max(np.mean(moved**2, axis=0) / felt)))
    return min(significance, size / MATERIAL_CHANGE)


def score_halves(parts: Sequence[tuple[Array, Array]], directions: Array) -> tuple[float, Array]:
    """Return the significance of the difference of two halves over its limit, and what it moves along `directions`.

    Args:
        parts: Parameters, (k,), and covariance, (k, k), of each half.
        directions: How a payload moves the parameters, (k, r).

    Returns:
        As `compare_halves`, and the most likely difference along the directions, (k,).
    """
    (first, one), (second, two) = parts
    P = one + two
    seen = np.isfinite(np.diag(P)) & (np.diag(P) > 0)
    if not seen[np.any(directions != 0, axis=1)].all():
        return 0.0, np.zeros(len(first))
    white = whiten(P[np.ix_(seen, seen)])
    columns = white @ directions[seen]
    difference = white @ (first - second)[seen]
    moves = decompose(columns).inverse @ difference
    found = float(np.sum((columns @ moves) ** 2)) / columns.shape[1]
    return found / float(fdtri(columns.shape[1], SQUARES, 1 - FALSE_CHANGE)), directions @ moves


def describe_two_rigs(logs: int) -> str:
    """Say that the halves are of two rigs, and what to do."""
    where = "the log" if logs == 1 else "the logs"
    return (
        f"the first and the second half of {where} are of two rigs, as if the payload had been swapped: the parameters "
        "are of neither; split the data there, and identify each part"
    )
