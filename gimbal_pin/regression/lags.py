"""When each joint's torque acts: fitted with the parameters, and what that leaves open in them.

A torque that acts later by a lag l than it was taken to obeys ``b_j = A_j θ + l_j db_j/dt``: milliseconds of it look
like viscous friction, which leads the angle by a quarter of a period as the torque's derivative does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.regression.design import Block, DesignBlocks, compute_blocks
from gimbal_pin.regression.discrepancy import add_misfit
from gimbal_pin.regression.solve import Estimate, compute_gain, fit_weighted

LAG_DEVIATION = 2.5e-3
"""Deviation of lags beforehand, s: where a torque hardly says when it acts, it acts when it was stamped."""
LAG_SPREAD = 1e-3
"""The same of one joint's lag beside those of the others, whose drives are alike."""
LARGEST_LAG = 2e-2
"""Largest, s, to either side: currents are reported late, through filters of 10 Hz and above; drives act late."""
LAG_ROUNDS = 3
"""Steps: each is nearly exact, as the band's highest frequency times what is left is small."""
LAGS_WITHIN = 5e-5
"""Error, s, at which they are found: at 12 Hz it leaves four thousandths of the torque."""


def get_only(each: Sequence[DesignBlocks]) -> Sequence[Block]:
    """Return the rows of one camera."""
    return each[0]


def hedge_misfit(blocks: Sequence[Block], estimate: Estimate) -> Estimate:
    """Return the estimate with deviations that hold what the model is found to miss, see `add_misfit`."""
    return add_misfit(blocks, estimate)[0]


def _append_slopes(blocks: Sequence[Block], joints: int) -> list[Block]:
    """Return blocks with one more column per joint, its torque's derivative; several cameras' share theirs."""
    own = np.arange(blocks[0].b.shape[1])[:, None] % joints == np.arange(joints)
    return [
        block._replace(A=np.concatenate([block.A, block.slope[:, :, None] * own], axis=2))
        for block in blocks
    ]


def fit_lags(
    blocks: Sequence[Block],
    taken: Array,
    hedge: Callable[[Sequence[Block], Estimate], Estimate] = hedge_misfit,
) -> tuple[Array, Array]:
    """Return each joint's lag, s, (n,), and their covariance, s², (n, n).

    ``min Σ_j ‖b_j - A_j θ - (l_j - taken_j) db_j/dt‖²/σ_j²`` gives l to a covariance C, what the model misses included;
    with the covariance P beforehand it is ``K l`` to ``P - K P``, ``K = P (P + C)⁻¹``.

    Args:
        blocks: Rows with the torque as it acts at the lags that were taken.
        taken: These, s, (n,).
        hedge: What adds to an estimate's deviations what the model misses.
    """
    n = len(taken)
    wide = _append_slopes(blocks, len(taken))
    prior = np.full((n, n), LAG_DEVIATION**2) + LAG_SPREAD**2 * np.eye(n)
    alone = hedge(wide, fit_weighted(wide))
    late = taken + alone.theta[-n:]
    spread = alone.covariance[-n:, -n:]
    seen = np.isfinite(np.diag(spread))
    K = prior[:, seen] @ np.linalg.inv((prior + spread)[np.ix_(seen, seen)])
    return K @ late[seen], prior - K @ prior[seen]


def align_rows(
    each: Sequence[DesignBlocks],
    join: Callable[[Sequence[DesignBlocks]], Sequence[Block]] = get_only,
) -> tuple[list[DesignBlocks], Array]:
    """Return rows with the lags at which the model leaves least, and these' covariance, s², (n, n).

    A filter that knows them stays. Its rows are the filter's own: faster ones say better when a torque acts, but where
    encoders are coarse they hold more noise of the acceleration than motion, which is taken for milliseconds. After a
    small step the lags are not fitted again.

    Args:
        each: Rows of one rig's drives, with several cameras.
        join: What makes of them one regression.
    """
    each, filtering, n = list(each), each[0].design.filtering, each[0].design.rig.n
    if filtering.alignment is not None or filtering.lags:
        return each, np.zeros((n, n))
    taken: Array = np.zeros(n)
    for _ in range(LAG_ROUNDS):
        late, spread = fit_lags(join(each), taken)
        late = np.clip(late, -LARGEST_LAG, LARGEST_LAG)
        step = late - taken
        taken = late
        filtering = replace(filtering, lags=tuple(taken.tolist()))
        each = [compute_blocks(replace(blocks.design, filtering=filtering)) for blocks in each]
        # A step that db/dt stands for leaves (2 π f step)²/2 of the torque, one that is off by dl leaves 2 π f dl.
        if np.pi * filtering.cutoff * np.max(step**2) < LAGS_WITHIN:
            break
    return each, spread


def add_lag_spread(blocks: Sequence[Block], estimate: Estimate, spread: Array) -> Estimate:
    """Return the estimate with deviations that hold what the lags leave open: ``Σ + T C Tᵀ``, ``T = G AᵀW db/dt``.

    Args:
        blocks: Rows, aligned.
        estimate: What was estimated from them.
        spread: C, covariance of the lags, s², (n, n).
    """
    (gain, scale) = compute_gain(blocks, estimate)
    through = np.zeros((len(estimate.theta), len(spread)))
    for block in blocks:
        each = np.einsum("mjk,mj->kj", block.A, block.slope * scale**2)
        through += each.reshape(len(through), -1, len(spread)).sum(axis=1)
    moved = gain @ through
    return replace(estimate, covariance=estimate.covariance + moved @ spread @ moved.T)
