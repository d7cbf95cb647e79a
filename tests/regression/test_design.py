"""Laws of a log's rows: ``A θ = b`` stays exact whatever is masked, cut, decimated or left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.log import signals
from gimbal_pin.regression import (
    Filtering,
    compute_blocks,
    compute_direction,
    fit_weighted,
    smooth_samples,
    split_segments,
)
from tests.bench_logs import EXACT, prescribed, rows_of, true_theta
from tests.rigs import bundled

TURRET = bundled("turret")
LOG = prescribed(nominal(TURRET), 1, 8.0)


def test_compact_filter_keeps_the_equation_and_more_of_a_short_log() -> None:
    short = LOG.part(slice(0, 5000))
    usual = compute_blocks(rows_of(TURRET, short))
    compact = compute_blocks(rows_of(TURRET, short, replace(EXACT, compact=True)))
    assert sum(len(block.t) for block in compact) > 1.3 * sum(len(block.t) for block in usual)
    for block in compact:
        scale = np.abs(block.b).max()
        np.testing.assert_allclose(block.A @ true_theta(TURRET), block.b, atol=1e-3 * scale)


def test_chunks_do_not_change_the_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    design = rows_of(TURRET, LOG)
    whole = np.concatenate([block.A for block in design])
    monkeypatch.setattr("gimbal_pin.regression.design.CHUNK_SAMPLES", 1777)
    pieces = np.concatenate([block.A for block in design])
    np.testing.assert_allclose(pieces, whole, atol=1e-4 * np.abs(whole).max())


def test_decimation_moves_no_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters of a noisy log move by less than a twentieth of their deviations."""
    rig = bundled("thesis")
    log = prescribed(nominal(rig), 1, 12.0, torque_noise=0.02)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(log.q.shape)
    rows = rows_of(rig, replace(log, q=log.q + noise), Filtering())
    thin = fit_weighted(list(rows))
    monkeypatch.setattr("gimbal_pin.regression.design.compute_decimation", lambda *_: 1)
    full = fit_weighted(list(rows))
    assert thin.rows == full.rows
    assert 0 < np.max(np.abs(thin.theta - full.theta) / full.std) < 0.05


def test_direction_is_the_mean_sign_of_a_straight_rate() -> None:
    v, a = np.random.default_rng(0).uniform(-1, 1, (2, 50))
    around = np.linspace(-0.2, 0.2, 20_001)[:, None]
    expected = np.mean(np.sign(v + around * 5 * a), axis=0)
    np.testing.assert_allclose(compute_direction(v, 5 * a, 0.4), expected, atol=2e-4)


def test_slow_direction_shows_the_sign_of_a_noisy_rate() -> None:
    """White noise on the angles masks most of a log, but not of its slow motion."""
    noise = 2e-2 * np.random.default_rng(0).standard_normal(LOG.q.shape)
    noisy = replace(LOG, v=None, q=LOG.q + noise)
    fast, slow = (
        np.mean(np.concatenate([block.share for block in rows_of(TURRET, noisy, one)]))
        for one in (EXACT, replace(EXACT, direction=2.5))
    )
    assert slow > 0.5 > 2 * fast


def test_rate_fuses_angle_and_gyro() -> None:
    """Both together are better than either alone, and the bias of a gyro does not get through."""
    rng = np.random.default_rng(0)
    q = LOG.q + 3e-5 * rng.standard_normal(LOG.q.shape)
    v = np.asarray(LOG.v) + 2e-3 * rng.standard_normal(LOG.q.shape) + 0.01
    errors = []
    for rate in (v, None):
        segment = next(split_segments(replace(LOG, q=q, v=rate), 4.0))
        smooth = smooth_samples(segment, EXACT, 0, segment.length)
        errors.append(np.sqrt(np.mean((smooth.v - LOG.v)[1000:-1000] ** 2)))
    rate_alone = 2e-3 * signals.compute_noise_gain(signals.lowpass(32.0, 1000.0), 1000.0, 0)
    assert errors[0] < 0.7 * errors[1]
    assert errors[0] < 0.9 * rate_alone
