"""Laws of numbers as text: nothing is lost but what was to be rounded, and nobody has to count powers of ten."""

from __future__ import annotations

from math import log10

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.errors import digits
from gimbal_pin.report import figures

EVERYDAY = st.floats(-4, 6.9).flatmap(lambda power: st.sampled_from([10**power, -(10**power)]))
COUNTS = st.integers(1, 5)


@given(EVERYDAY, COUNTS)
def test_what_is_read_is_what_was_said(value: float, count: int) -> None:
    text = digits(value, count)
    assert "e" not in text
    assert float(text) == pytest.approx(value, rel=0.51 * 10.0 ** (1 - count))
    assert abs(value) < 10**count or abs(float(text) - value) <= 0.5


@given(EVERYDAY, COUNTS)
def test_tables_and_sentences_say_the_same_number(value: float, count: int) -> None:
    table = float(figures(value, count).replace("−", "-"))
    assert table == pytest.approx(float(digits(value, count)), rel=1e-12)


@given(st.floats(1e-300, 1e300))
def test_powers_of_ten_stand_where_zeros_would_have_to_be_counted(value: float) -> None:
    assert ("e" in digits(value)) == (not -4 <= log10(float(f"{value:.2e}")) < 7)


def test_whole_numbers_stay_whole() -> None:
    assert [digits(x, 2) for x in (213.0, 11.0, 99.6, 0.0)] == ["213", "11", "100", "0"]
