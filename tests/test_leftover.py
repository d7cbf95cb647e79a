"""Laws of what is left: noise of any colour is noise, and what no sensor makes is seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import lfilter

from gimbal_pin.diagnosis.fit import Fit, fit, project
from gimbal_pin.diagnosis.flips import flipped, flipped_wald
from gimbal_pin.diagnosis.learned import bent, explained
from gimbal_pin.diagnosis.leftover import Pattern
from gimbal_pin.diagnosis.noiselike import peaked, rare, shared
from gimbal_pin.diagnosis.score import NIL, chance, effective, grams, score
from gimbal_pin.log import Array

ROWS, BLOCKS = 1200, 40
RNG = np.random.default_rng


def coloured(rng: np.random.Generator, keep: float) -> Array:
    """First-order noise of unit size, (ROWS,)."""
    return np.asarray(lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=ROWS + 200))[200:])


def fitted(residual: Array) -> Fit:
    """A constant fitted at one joint, blocks of equal length."""
    block = np.arange(ROWS) * BLOCKS // ROWS
    return fit(np.ones((ROWS, 1, 1)), residual[:, None], np.ones(1), block)


def column(values: Array, joint: int | None = 0) -> Pattern:
    """Columns without bounds, (ROWS, c) at a joint, or (ROWS, n, c) at all."""
    wide = np.full(values.shape[-1], np.inf)
    return Pattern("", joint, values, -wide, wide)


def bump(centre: float, width: float) -> Array:
    """A hat over time: it acts in a few blocks only."""
    return np.asarray(np.maximum(1 - np.abs(np.linspace(0, 1, ROWS) - centre) / width, 0.0))


def judged(rng: np.random.Generator, values: Array) -> float:
    """p of a column, (ROWS,), in noise."""
    return score(fitted(coloured(rng, 0.6)), column(values[:, None]), False).p


@pytest.mark.parametrize("width", [0.05, 0.2, 1.0])
def test_a_column_that_acts_in_few_blocks_is_not_found_in_noise_too_often(width: float) -> None:
    """Without counting the blocks in which it acts, one in five would pass at one in a hundred."""
    rng = RNG(1)
    p = [judged(rng, bump(rng.uniform(0.2, 0.8), width)) for _ in range(200)]
    assert np.mean(np.array(p) < 0.01) < 0.03
    assert np.mean(np.array(p) < 0.5) > 0.3


def test_blocks_are_counted_by_leverage() -> None:
    now = fitted(RNG(0).normal(size=ROWS))
    everywhere, once = (project(now, column(x[:, None])) for x in (RNG(1).normal(size=ROWS), bump(0.5, 0.01)))
    assert effective(now, everywhere) == pytest.approx(BLOCKS, rel=0.15)
    assert effective(now, once) < 3


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_signs_that_change_nothing_give_the_scores_own_wald(seed: int, width: int) -> None:
    """The flipped statistic of the unflipped residual is the statistic itself."""
    rng = RNG(seed)
    now = fitted(coloured(rng, 0.5))
    columns = column(rng.normal(size=(ROWS, width)))
    rest = project(now, columns)
    scatter, gram = now.by_block(rest * now.residual[:, None]), grams(now, rest, width)
    wald = flipped_wald(np.ones((1, BLOCKS)), scatter.T[None], gram)[0]
    assert wald[0] == pytest.approx(score(now, columns, False).wald, rel=1e-6)
    assert chance(wald[0], width, effective(now, rest)) == pytest.approx(score(now, columns, False).p)


@pytest.mark.parametrize("width", [1, 2])
def test_what_has_no_scatter_is_nothing_and_no_warning(width: int) -> None:
    """A column of one block alone, which its coefficient explains whole: nothing tells it from luck."""
    gram = np.zeros((1, width, width, BLOCKS))
    gram[0, :, :, 3] = np.eye(width)
    scatter = np.zeros((1, width, BLOCKS))
    scatter[0, :, 3] = 2.0
    with np.errstate(invalid="raise", divide="raise"):
        assert np.all(flipped_wald(RNG(0).choice([-1.0, 1.0], (20, BLOCKS)), scatter, gram) == 0.0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.floats(-320.0, 5.0))
def test_a_columns_size_is_nothing_to_its_chance(seed: int, width: int, power: float) -> None:
    """Down to where it is none, and never with a warning: friction that dies away with speed leaves any size."""
    rng = RNG(seed)
    now, values = fitted(coloured(rng, 0.5)), rng.normal(size=(ROWS, width))
    size = 10.0**power
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        scaled = score(now, column(size * values), False)
        flips = flipped(now, [column(size * values)], RNG(0), 50)
    if size**2 * ROWS < 0.5 * NIL:
        assert scaled.gain == 0.0 and scaled.visible == 0.0 and np.all(flips == 1.0)
    elif size**2 * ROWS > 2 * NIL:
        whole = score(now, column(values), False)
        assert scaled.gain == pytest.approx(whole.gain, rel=1e-6) and scaled.p == pytest.approx(whole.p, rel=1e-6)
        np.testing.assert_allclose(flips, flipped(now, [column(values)], RNG(0), 50), rtol=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(0, 1))
def test_a_column_at_one_joint_is_one_that_is_zero_at_the_others(seed: int, width: int, joint: int) -> None:
    rng = RNG(seed)
    base, own = rng.normal(size=(ROWS, 2, 3)), rng.normal(size=(ROWS, width))
    now = fit(base, rng.normal(size=(ROWS, 2)) * [1.0, 3.0], np.ones(2), np.arange(ROWS) * BLOCKS // ROWS)
    everywhere = np.zeros((ROWS, 2, width))
    everywhere[:, joint] = own
    here, all_over = (score(now, columns, False) for columns in (column(own, joint), column(everywhere, None)))
    assert here.gain == pytest.approx(all_over.gain)
    assert here.p == pytest.approx(all_over.p, rel=1e-6)
    assert here.visible == pytest.approx(all_over.visible)
    np.testing.assert_allclose(here.beta, all_over.beta)


@pytest.mark.parametrize("keep", [0.0, 0.8, 0.97])
def test_noise_of_any_colour_is_like_noise(keep: float) -> None:
    for seed in range(100):
        rng = RNG(seed)
        own, other = [coloured(rng, keep)], [coloured(rng, keep)]
        assert not rare(own)
        assert not peaked(own)
        assert not shared(own, other)


def test_what_no_sensor_makes_is_seen() -> None:
    rng, t = RNG(3), np.arange(ROWS) / 24.0
    noise, other = coloured(rng, 0.8), coloured(rng, 0.8)
    knocks = np.zeros(ROWS)
    knocks[rng.integers(ROWS, size=8)] = 15.0
    assert rare([noise + knocks])
    assert peaked([noise + sum(2.0 * np.sin(2 * np.pi * f * t) for f in (1.1, 2.3, 3.7, 5.2))])
    assert shared([noise + 0.5 * other], [noise - 0.5 * other])


@given(arrays(float, 40, elements=st.floats(-3, 3)), st.floats(0.01, 2.0))
def test_play_stays_within_and_does_not_ask_how_fast(q: Array, stroke: float) -> None:
    z = bent(q, stroke)
    assert np.all(np.abs(z) <= 1)
    slow = bent(np.repeat(q, 3), stroke)
    np.testing.assert_allclose(slow[::3], z, atol=1e-12)


def test_only_what_follows_from_the_motion_is_learnt() -> None:
    rng = RNG(5)
    angle = coloured(rng, 0.95)
    white = np.cos(np.outer(angle, rng.normal(size=40)) + rng.uniform(0, 6, 40))
    share, null = explained(fitted(np.abs(angle) + coloured(rng, 0.8)), white, 0, rng)
    assert share > 0.1
    assert share > np.max(null)
    above = [x > np.max(y) for x, y in (explained(fitted(coloured(rng, 0.8)), white, 0, rng) for _ in range(25))]
    assert sum(above) <= 2
