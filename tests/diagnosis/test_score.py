"""Laws of how columns are judged beside a fit: by the blocks in which they act, whatever their size and joint."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from gimbal_pin.diagnosis import Columns, Fit, fit, gained
from gimbal_pin.effects import Coulomb
from gimbal_pin.log import Array

NIL = 1e-24

ROWS, BLOCKS = 1200, 40
RNG = np.random.default_rng


def coloured(rng: np.random.Generator, keep: float) -> Array:
    """First-order noise of unit size, (ROWS,)."""
    return np.asarray(
        lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=ROWS + 200))[200:]
    )


def fitted(residual: Array) -> Fit:
    """A constant fitted at one joint, blocks of equal length."""
    block = np.arange(ROWS) * BLOCKS // ROWS
    return fit(np.ones((ROWS, 1, 1)), residual[:, None], np.ones(1), block)


def column(values: Array, joint: int | None = 0, shared: Array | None = None) -> Columns:
    """Columns without bounds, (rows, c) at a joint, or (rows, n, c) at all, of some cause."""
    wide = np.full(values.shape[-1], np.inf)
    count = 1 if joint is not None else values.shape[1]
    return Columns(Coulomb("any"), count, joint, values, -wide, wide, shared=shared)


@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.floats(-320.0, 5.0))
def test_a_columns_size_is_nothing_to_its_gain(seed: int, width: int, power: float) -> None:
    """Down to where it is none, and never with a warning: friction that dies away with speed leaves any size."""
    rng = RNG(seed)
    now = fitted(coloured(rng, 0.5))
    values = rng.normal(size=(ROWS, width))
    size = 10.0**power
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        scaled = gained(now, column(size * values), False)
    if size**2 * ROWS < 0.5 * NIL:
        assert scaled.gain == 0.0 and scaled.visible == 0.0
    elif size**2 * ROWS > 2 * NIL:
        whole = gained(now, column(values), False)
        assert scaled.gain == pytest.approx(whole.gain, rel=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(0, 1))
def test_a_column_at_one_joint_is_one_that_is_zero_at_the_others(
    seed: int, width: int, joint: int
) -> None:
    rng = RNG(seed)
    base = rng.normal(size=(ROWS, 2, 3))
    own = rng.normal(size=(ROWS, width))
    now = fit(
        base, rng.normal(size=(ROWS, 2)) * [1.0, 3.0], np.ones(2), np.arange(ROWS) * BLOCKS // ROWS
    )
    everywhere = np.zeros((ROWS, 2, width))
    everywhere[:, joint] = own
    here, all_over = (
        gained(now, columns, False) for columns in (column(own, joint), column(everywhere, None))
    )
    assert here.gain == pytest.approx(all_over.gain)
    assert here.visible == pytest.approx(all_over.visible)
    np.testing.assert_allclose(here.beta, all_over.beta)
