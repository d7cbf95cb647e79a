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
    factor_rows,
    find_camera_body,
    solve,
    weigh_and_solve,
)

FALSE_CHANGE = 1e-3
"""Chance of a score beyond the limit on two halves of one rig."""
SQUARES = 12.0
"""From how many squares the noise of a half is taken to be known: heavy tails for what its covariance leaves out."""
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
    left, values, _ = np.linalg.svd(own, full_matrices=False)
    out = np.zeros((len(rows.names), int(np.sum(values > 1e-9 * values[0]))))
    out[: len(own)] = left[:, : out.shape[1]]
    return out


def compare_halves(blocks: Sequence[Block], rows: Design) -> float:
    """``dᵀP⁻¹D (DᵀP⁻¹D)⁻¹ DᵀP⁻¹d / r`` over the limit for it: above one, the halves are of two rigs (Chow 1960).

    d is the difference of the two halves' parameters and P the sum of their covariances under coloured residuals; of it
    only what lies along D counts, what a payload can move: friction that warms up is no other rig. Zero where a half
    has too few rows.

    `rows`: what the blocks are of.
    """
    parts = split_halves(blocks)
    if any(count_effective_rows(part).sum() < TELLING * len(rows.names) for part in parts if part) or not all(parts):
        return 0.0
    count = count_effective_rows(blocks)
    factors = factor_rows(blocks)
    *_, scale = weigh_and_solve(factors, lambda theta: compute_residual_power(factors, theta, count))
    each = [solve(part, scale=scale) for part in parts]
    return score_halves([(one.theta, one.covariance) for one in each], payload_directions(rows))


def score_halves(parts: Sequence[tuple[Array, Array]], directions: Array) -> float:
    """Return what `compare_halves` does, of parameters (k,) and covariance (k, k) of two halves."""
    (first, one), (second, two) = parts
    P = one + two
    seen = np.isfinite(np.diag(P)) & (np.diag(P) > 0)
    if not seen[np.any(directions != 0, axis=1)].all():
        return 0.0
    unit = np.sqrt(np.diag(P)[seen])
    values, vectors = np.linalg.eigh(P[np.ix_(seen, seen)] / np.outer(unit, unit))
    white = vectors.T / np.sqrt(np.maximum(values, 1e-9 * values[-1]))[:, None] / unit
    basis, _ = np.linalg.qr(white @ directions[seen])
    found = float(np.sum((basis.T @ white @ (first - second)[seen]) ** 2)) / basis.shape[1]
    return found / float(fdtri(basis.shape[1], SQUARES, 1 - FALSE_CHANGE))


def describe_two_rigs(logs: int) -> str:
    """Say that the halves are of two rigs, and what to do."""
    where = "the log" if logs == 1 else "the logs"
    return (
        f"the first and the second half of {where} are of two rigs, as if the payload had been swapped: the parameters "
        "are of neither; identify with --follow, which announces a swap, or split the data there"
    )
