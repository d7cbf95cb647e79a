"""When each joint's torque acts: fitted with the parameters, and what that leaves open in them.

A torque that acts later by a lag l than it was taken to obeys ``b_j = A_j θ + l_j db_j/dt``: milliseconds of it look
like viscous friction, which leads the angle by a quarter of a period as the torque's derivative does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.regression.design import Block
from gimbal_pin.regression.discrepancy import add_misfit
from gimbal_pin.regression.samples import Filtering
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
"""Step, s, under which they are found: at 12 Hz it leaves four thousandths of the torque."""


def hedge_misfit(blocks: Sequence[Block], estimate: Estimate) -> Estimate:
    """Return the estimate with deviations that hold what the model is found to miss, see `add_misfit`."""
    return add_misfit(blocks, estimate)[0]


def _append_slopes(blocks: Sequence[Block], joints: int) -> list[Block]:
    """Return blocks with one more column per joint, its torque's derivative; several cameras' share theirs."""
    own = np.arange(blocks[0].b.shape[1])[:, None] % joints == np.arange(joints)
    return [block._replace(A=np.concatenate([block.A, block.slope[:, :, None] * own], axis=2)) for block in blocks]


def fit_lags(
    blocks: Sequence[Block], taken: Array, hedge: Callable[[Sequence[Block], Estimate], Estimate] = hedge_misfit
) -> tuple[Array, Array]:
    """Return each joint's lag, s, (n,), and their covariance, s², (n, n).

    ``min Σ_j ‖b_j - A_j θ - (l_j - taken_j) db_j/dt‖²/σ_j²`` gives l to a covariance C, what the model misses included;
    with the covariance P beforehand it is ``K l`` to ``P - K P``, ``K = P (P + C)⁻¹``.

    Args:
        blocks: Rows with the torque as it acts at the lags that were taken.
        taken: These, s, (n,).
        hedge: What adds to an estimate's deviations what the model misses.
    """
    n, wide = len(taken), _append_slopes(blocks, len(taken))
    prior = np.full((n, n), LAG_DEVIATION**2) + LAG_SPREAD**2 * np.eye(n)
    alone = hedge(wide, fit_weighted(wide))
    late, spread = taken + alone.theta[-n:], alone.covariance[-n:, -n:]
    seen = np.isfinite(np.diag(spread))
    K = prior[:, seen] @ np.linalg.inv((prior + spread)[np.ix_(seen, seen)])
    return K @ late[seen], prior - K @ prior[seen]


def align_rows(
    build: Callable[[Filtering], Sequence[Block]], filtering: Filtering, joints: int
) -> tuple[Filtering, Array]:
    """Return the filter with the lags at which the model leaves least, and these' covariance, s², (n, n).

    A filter that knows them stays. Its rows are the filter's own: faster ones say better when a torque acts, but where
    encoders are coarse they hold more noise of the acceleration than motion, which is taken for milliseconds.

    Args:
        build: Filter → rows.
        filtering: The filter.
        joints: Number of joints.
    """
    if filtering.alignment is not None or filtering.lags:
        return filtering, np.zeros((joints, joints))
    now = replace(filtering, lags=(0.0,) * joints)
    for _ in range(LAG_ROUNDS):
        late, spread = fit_lags(build(now), np.array(now.lags))
        before, late = now.lags, np.clip(late, -LARGEST_LAG, LARGEST_LAG)
        now = replace(now, lags=tuple(late.tolist()))
        if np.max(np.abs(late - before)) < LAGS_WITHIN:
            break
    return replace(filtering, lags=now.lags), spread


def add_lag_spread(blocks: Sequence[Block], estimate: Estimate, spread: Array) -> Estimate:
    """Return the estimate with deviations that hold what the lags leave open: ``Σ + T C Tᵀ``, ``T = G AᵀW db/dt``.

    Args:
        blocks: Rows, aligned.
        estimate: What was estimated from them.
        spread: C, covariance of the lags, s², (n, n).
    """
    (gain, scale), through = compute_gain(blocks, estimate), np.zeros((len(estimate.theta), len(spread)))
    for block in blocks:
        each = np.einsum("mjk,mj->kj", block.A, block.slope * scale**2)
        through += each.reshape(len(through), -1, len(spread)).sum(axis=1)
    moved = gain @ through
    return replace(estimate, covariance=estimate.covariance + moved @ spread @ moved.T)
