"""Rows of logs: the equation stays exact whatever is masked, cut, decimated or left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gimbal_pin.dynamics import build_friction_effects, nominal, reduce_parameters
from gimbal_pin.log import Log, signals
from gimbal_pin.regression import (
    Design,
    Filtering,
    Samples,
    Segment,
    build_mask,
    compute_blocks,
    compute_direction,
    fit_weighted,
)
from gimbal_pin.rig import Rig, bundled_rigs
from tests.bench_logs import EXACT, fourier, prescribed, rows_of, true_theta


@pytest.fixture(scope="module")
def turret() -> Rig:
    return Rig.load("turret")


@pytest.fixture(scope="module")
def clean(turret: Rig) -> Log:
    return prescribed(nominal(turret), seconds=20.0)


def test_effects_on_joints_that_stick_are_masked_and_the_equation_stays_exact(turret: Rig) -> None:
    """Any mask before the filter keeps A θ = b: with the true state the planted parameters leave no residual."""
    model = nominal(turret)
    motion = fourier(turret, 3, 10.0)
    tau = model.inverse(motion.q, motion.v, motion.a)
    smooth = signals.zero_phase(tau, signals.lowpass(EXACT.cutoff * EXACT.smoothing, 1000.0))
    channels = Samples(
        motion.t, motion.q, motion.v, motion.a, smooth, motion.v, np.full(turret.n, 0.02)
    )
    rows = Design(
        turret, reduce_parameters(turret), build_friction_effects(turret.joints), (), EXACT
    )
    made = rows.build_block(channels, slice(350, -350, 50), 1000.0)
    assert made.share.min() < 0.5 < made.share.max()
    assert np.abs(made.A @ true_theta(turret) - made.b).max() < 1e-8


@given(st.integers(1, 60), st.integers(2, 80))
def test_the_mask_is_zero_at_standstill_and_one_far_away(width: int, taper: int) -> None:
    still = np.zeros((1000, 1), bool)
    still[500 : 500 + width] = True
    weight = build_mask(still, taper)[:, 0]
    assert np.all(weight[still[:, 0]] == 0)
    assert (
        np.all(weight[: 500 - 3 * taper - 3] == 1) and np.all(weight >= 0) and np.all(weight <= 1)
    )


def test_trajectories_are_never_joined(turret: Rig) -> None:
    """Rows of two logs are the rows of each, whatever the jump between them."""
    logs = tuple(prescribed(nominal(turret), seed=seed, seconds=6.0) for seed in (1, 2))
    make = Design(
        turret, reduce_parameters(turret), build_friction_effects(turret.joints), logs, EXACT
    )
    both = compute_blocks(make)
    apart = [part for log in logs for part in compute_blocks(replace(make, logs=(log,)))]
    assert len(both) == len(apart)
    assert all(np.array_equal(x.A, y.A) and np.array_equal(x.b, y.b) for x, y in zip(both, apart))


def test_chunks_do_not_show(turret: Rig, clean: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    make = Design(
        turret, reduce_parameters(turret), build_friction_effects(turret.joints), (clean,), EXACT
    )
    whole = np.concatenate([part.A for part in compute_blocks(make)])
    monkeypatch.setattr("gimbal_pin.regression.design.CHUNK_SAMPLES", 1777)
    cut = np.concatenate([part.A for part in compute_blocks(make)])
    assert whole.shape == cut.shape
    assert (
        np.abs(whole - cut).max() < 1e-4 * np.abs(whole).max()
    )  # what `signals.compute_lowpass_settling` promises


@pytest.mark.parametrize("name", bundled_rigs())
def test_decimation_does_not_show(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters of a noisy log move by less than a twentieth of their deviations."""
    rig = Rig.load(name)
    log = prescribed(nominal(rig), 1, 12.0, torque_noise=0.02)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(log.q.shape)
    rows = Design(
        rig,
        reduce_parameters(rig),
        build_friction_effects(rig.joints),
        (replace(log, q=log.q + noise),),
        Filtering(),
    )
    thin = list(rows)
    monkeypatch.setattr("gimbal_pin.regression.design.compute_decimation", lambda *_: 1)
    full = list(rows)
    assert np.array_equal(*(np.concatenate([block.t for block in some]) for some in (thin, full)))
    few = fit_weighted(thin)
    all_ = fit_weighted(full)
    assert 0 < np.max(np.abs(few.theta - all_.theta) / all_.std) < 0.05


@given(v=st.floats(-1.0, 1.0), a=st.floats(-5.0, 5.0), step=st.floats(0.01, 0.5))
def test_the_direction_is_the_mean_sign_of_a_straight_rate(v: float, a: float, step: float) -> None:
    assume(v == 0.0 or abs(v) > 1e-9)  # slower is still
    around = (np.arange(20_000) + 0.5) / 20_000 * step - step / 2
    assert compute_direction(np.array(v), np.array(a), step) == pytest.approx(
        np.mean(np.sign(v + a * around)), abs=2e-4
    )


def test_a_compact_filter_keeps_the_equation_and_more_of_a_short_log(turret: Rig) -> None:
    log = prescribed(nominal(turret), 1, 5.0)
    usual, compact = (
        rows_of(turret, log, replace(EXACT, compact=short)) for short in (False, True)
    )
    rows = [np.concatenate([block.t for block in design]) for design in (usual, compact)]
    assert len(rows[1]) > 1.3 * len(rows[0])
    for block in compact:
        assert np.abs(block.A @ true_theta(turret) - block.b).max() < 1e-3 * np.abs(block.b).max()


def test_the_slow_direction_tells_the_sign_of_a_noisy_rate(turret: Rig) -> None:
    """White noise on the angles masks most of a log, of its slow motion it does not."""
    log = prescribed(nominal(turret), 1, 8.0)
    noisy = replace(
        log, v=None, q=log.q + 2e-2 * np.random.default_rng(0).standard_normal(log.q.shape)
    )
    designs = (rows_of(turret, noisy, replace(EXACT, direction=band)) for band in (None, 2.5))
    fast, slow = (np.mean(np.concatenate([block.share for block in design])) for design in designs)
    assert slow > 0.5 > 2 * fast


def test_columns_of_another_reading_keep_the_torque_and_the_mask(turret: Rig, clean: Log) -> None:
    design = rows_of(turret, clean)
    for own, other in zip(design, design.iterate_blocks(lambda segment: segment)):
        assert np.array_equal(own.A, other.A)
    for own, other in zip(design, design.iterate_blocks(backwards)):
        assert np.array_equal(own.b, other.b) and np.array_equal(own.share, other.share)
        assert not np.allclose(own.A, other.A)


def backwards(segment: Segment) -> Segment:
    """A segment whose joints move the other way."""
    log = segment.log
    return segment._replace(log=replace(log, q=-log.q, v=-np.asarray(log.v)))
