"""When each joint's torque acts: what a log tells of it, and what it leaves open in the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.identification import Identified, identify
from gimbal_pin.log import Array, Log
from gimbal_pin.regression import (
    LAG_DEVIATION,
    LAG_SPREAD,
    Filtering,
    add_lag_spread,
    align_rows,
    compute_blocks,
    fit_lags,
    fit_weighted,
)
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed, rows_of, true_theta

RIGS = pytest.mark.parametrize("rig", ["turret", "thesis"])


def logged(rig: str, late: Array | float = 0.0, noise: float = 0.01) -> Log:
    """A motion whose torque is stamped half a sample and `late`, s, earlier than it acts."""
    log = prescribed(nominal(Rig.load(rig)), torque_noise=noise, dt=2e-3)
    late = np.broadcast_to(late, len(log.joints)) + log.dt / 2
    assert log.tau is not None
    return replace(
        log, tau=np.stack([np.interp(log.t + d, log.t, x) for d, x in zip(late, log.tau.T)], axis=1)
    )


def fitted(rig: str, log: Log, alignment: float | None = None) -> Identified:
    return identify(Rig.load(rig), [log], holdout="none", filtering=Filtering(alignment=alignment))


def deviations(rig: str, found: Identified) -> Array:
    return (found.estimate.theta - true_theta(Rig.load(rig))) / found.estimate.std


@RIGS
def test_each_joints_lag_is_found_and_takes_nothing_for_friction(rig: str) -> None:
    """Left out, the same lags put a parameter off by several of the deviations that it has with them."""
    late = np.array([6e-3, -3e-3, 4e-3])[: Rig.load(rig).n]
    log = logged(rig, late)
    found = fitted(rig, log)
    blind = fitted(rig, log, log.dt / 2)
    known = found.model.estimated
    assert known is not None and np.all(
        np.abs(np.array(known.lags) - late) < 4 * np.array(known.lag_std)
    )
    assert np.all(np.array(known.lag_std) < 5e-4)
    assert np.sqrt(np.mean(deviations(rig, found) ** 2)) < 2.0
    assert (
        np.abs((blind.estimate.theta - true_theta(Rig.load(rig))) / found.estimate.std).max() > 4.0
    )


@RIGS
def test_a_later_stamp_is_a_shorter_lag_and_nothing_else(rig: str) -> None:
    some = fitted(rig, logged(rig, 1e-3, 0.0))
    more = fitted(rig, logged(rig, 3e-3, 0.0))
    np.testing.assert_allclose(
        np.subtract(more.filtering.lags, some.filtering.lags), 2e-3, atol=2e-5
    )
    moved = np.abs(more.estimate.theta - some.estimate.theta)
    assert np.all(moved < 0.02 * np.abs(true_theta(Rig.load(rig))).max())


@RIGS
def test_a_stated_alignment_is_known(rig: str) -> None:
    """No lag is fitted, and the deviations hold none."""
    log = logged(rig)
    found = fitted(rig, log, log.dt / 2)
    blocks = compute_blocks(rows_of(Rig.load(rig), log, found.filtering))
    assert found.filtering.lags == ()
    (known,), spread = align_rows([blocks])
    assert known is blocks and not spread.any()
    assert add_lag_spread(blocks, found.estimate, spread).covariance == pytest.approx(
        found.estimate.covariance
    )


@RIGS
def test_a_torque_that_never_changes_does_not_say_when_it_acts(rig: str) -> None:
    """The lag then has the deviation that it had beforehand, and adds none to the parameters."""
    log = logged(rig)
    blocks = compute_blocks(rows_of(Rig.load(rig), log, Filtering()))
    still = [block._replace(slope=0 * block.slope) for block in blocks]
    alone = fit_weighted(blocks)
    spread = fit_lags(still, np.zeros(len(log.joints)))[1]
    estimate = add_lag_spread(still, alone, spread)
    np.testing.assert_allclose(
        np.sqrt(np.diag(spread)), np.hypot(LAG_DEVIATION, LAG_SPREAD), rtol=1e-6
    )
    np.testing.assert_allclose(estimate.covariance, alone.covariance)


@RIGS
def test_a_joint_that_does_not_say_is_as_late_as_the_others(rig: str) -> None:
    """Its lag is theirs, shrunk by what one drive may differ; it is known less well, and better than beforehand."""
    log = logged(rig, 4e-3)
    silent = 1.0 * (np.arange(Rig.load(rig).n) > 0)
    (blocks,), _ = align_rows([compute_blocks(rows_of(Rig.load(rig), log, Filtering()))])
    still = [block._replace(slope=block.slope * silent) for block in blocks]
    lags, spread = fit_lags(still, np.array(blocks.design.filtering.lags))
    std = np.sqrt(np.diag(spread))
    assert 3.2e-3 < lags[0] < lags[1] and lags[1] == pytest.approx(4e-3, rel=0.05)
    assert std[1:].max() < LAG_SPREAD < std[0] < LAG_DEVIATION


@RIGS
def test_what_a_lag_leaves_open_widens_friction_and_never_narrows(rig: str) -> None:
    log = logged(rig)
    blocks = compute_blocks(rows_of(Rig.load(rig), log, Filtering()))
    alone = fit_weighted(blocks)
    wide = add_lag_spread(blocks, alone, fit_lags(blocks, np.zeros(len(log.joints)))[1])
    assert np.linalg.eigvalsh(wide.covariance - alone.covariance).min() > -1e-12 * np.trace(
        alone.covariance
    )
    assert np.all(wide.std >= alone.std) and np.any(wide.std > alone.std)
