"""When each joint's torque acts: what a log shows of it, and what it leaves open."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.identification import identify
from gimbal_pin.log import Log
from gimbal_pin.regression import (
    LAG_DEVIATION,
    LAG_SPREAD,
    DesignBlocks,
    Filtering,
    add_lag_spread,
    align_rows,
    compute_blocks,
    fit_lags,
    fit_weighted,
)
from tests.bench_logs import prescribed, rows_of, true_theta
from tests.rigs import bundled


@cache
def record(rig: str, *late: float) -> Log:
    """Return a log whose torques are stamped half a sample and so much earlier than they act."""
    log = prescribed(nominal(bundled(rig)), seconds=12.0, torque_noise=0.01, dt=2e-3)
    columns = [
        np.interp(log.t + d + log.dt / 2, log.t, x) for d, x in zip(late, np.transpose(log.tau))
    ]
    return replace(log, tau=np.stack(columns, axis=1))


@cache
def compute_rows(late: float) -> DesignBlocks:
    """Return rows of the turret with torques of one lag, of which none is known."""
    return compute_blocks(rows_of(bundled("turret"), record("turret", late, late), Filtering()))


def test_lag_of_each_joint_is_found_and_takes_nothing_for_friction() -> None:
    """Left out, the lags put a parameter off by several of the deviations that it has with them."""
    late = (6e-3, -3e-3, 4e-3)
    log = record("thesis", *late)
    found, blind = (
        identify(bundled("thesis"), [log], holdout="none", filtering=Filtering(alignment=one))
        for one in (None, log.dt / 2)
    )
    known = found.model.estimated
    assert known is not None
    assert np.all(np.abs(np.subtract(known.lags, late)) < 4 * np.array(known.lag_std))
    assert np.all(np.array(known.lag_std) < 5e-4)
    z, blind_z = (
        (one.estimate.theta - true_theta(bundled("thesis"))) / found.estimate.std
        for one in (found, blind)
    )
    assert np.sqrt(np.mean(z**2)) < 2.0
    assert np.abs(blind_z).max() > 4.0


def test_joint_that_shows_no_lag_takes_that_of_the_others() -> None:
    """Shrunk by what one drive may differ, and known less well, but better than beforehand."""
    (blocks,), _ = align_rows([compute_rows(4e-3)])
    still = [block._replace(slope=block.slope * [0.0, 1.0]) for block in blocks]
    lags, spread = fit_lags(still, np.array(blocks.design.filtering.lags))
    std = np.sqrt(np.diag(spread))
    assert 3.2e-3 < lags[0] < lags[1]
    assert lags[1] == pytest.approx(4e-3, rel=0.05)
    assert std[1] < LAG_SPREAD < std[0] < LAG_DEVIATION


def test_what_a_lag_leaves_open_is_the_change_of_the_estimate_with_it() -> None:
    """``T`` of ``Σ + T C Tᵀ`` by fits to torques that act a little later at one joint.

    The weights of the joints, which change with the torques, move it by a few per cent.
    """
    blocks = compute_rows(0.0)
    alone = fit_weighted(blocks)
    _, spread = fit_lags(blocks, np.zeros(2))
    step = 1e-6
    later = [
        [block._replace(b=block.b + step * block.slope * own) for block in blocks]
        for own in np.eye(2)
    ]
    T = np.stack([(fit_weighted(one).theta - alone.theta) / step for one in later], axis=1)
    wide = add_lag_spread(blocks, alone, spread)
    np.testing.assert_allclose(
        np.diag(wide.covariance - alone.covariance), np.diag(T @ spread @ T.T), rtol=0.1
    )
