"""Numbers, texts, curves: what is written and drawn is what was given.

- a number keeps its significant digits, an interval its second digit;
- any text comes out of a page as it went in, and terminal and page have the same cells;
- a chart carries the data, and however long it is the extremes and gaps of each curve;
- drawing is repeatable and leaves Matplotlib as it was.
"""

from __future__ import annotations

from datetime import datetime, timezone
from math import inf, nan
from typing import Any

import lxml.html
import matplotlib
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from markupsafe import Markup

from gimbal_pin.report import (
    Chart,
    Charts,
    Document,
    Origin,
    Section,
    Table,
    Trace,
    elements,
    figures,
    plots,
)
from gimbal_pin.report import format as numbers
from tests.browsing import unpacked
from tests.report.records import EVIL

TEXTS = st.text(
    st.characters(min_codepoint=32, blacklist_categories=("Cs", "Cc", "Co", "Cn")),
    min_size=1,
    max_size=40,
)
COUNTS = st.integers(1, 6)


# -- numbers -----------------------------------------------------------------------------------------------------------


def value_of(text: str) -> float:
    """Return what a written number says."""
    mantissa, _, power = text.replace("−", "-").replace("± ", "").partition("·10")
    plain = (power or "0").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    return float(mantissa) * 10.0 ** int(plain)


@given(st.floats(-1e12, 1e12, allow_subnormal=False), COUNTS)
@example(9.996e-5, 3)
@example(0.09999, 2)
@example(999999.6, 3)
def test_figures_keep_their_significant_digits(value: float, count: int) -> None:
    text = figures(value, count)
    assert abs(value_of(text) - value) <= 0.5000001 * 10.0 ** (1 - count) * abs(value)
    assert not text.startswith("−0") or value_of(text) != 0


@given(st.floats(-1e3, 1e3, allow_subnormal=False), st.floats(-7, 3))
@example(0.0, -8.5)
@example(1.0, -1.0017)
@example(99.96, 0.9998)
def test_an_interval_is_written_to_its_second_digit(value: float, power: float) -> None:
    half = 10.0**power
    centre, width = numbers.interval(value, half)
    assert abs(value_of(width) - half) <= 0.051 * half
    assert abs(value_of(centre) - value) <= 0.051 * half + 1e-15 * abs(value)


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        (figures(-inf), "−∞"),
        (numbers.interval(1.0, inf)[1], "± ∞"),
        (numbers.percent(99.97), "> 99.9 %"),
        (numbers.format_range([nan, 2.0, 1.0]), "1.0 to 2.0"),
        (numbers.torque_text(2e-4), "0.20 mN m"),
        (numbers.torque_text(2e-4, 0.5), "0.00020 N m"),
        (numbers.torque_text(0.4, 2e-4), "0.40 N m"),
    ],
)
def test_a_number_is_written_so(said: str, wanted: str) -> None:
    assert said == wanted


# -- parts of a page ---------------------------------------------------------------------------------------------------


def parsed(text: str) -> Any:
    """Return a page, or a part of one, as a tree."""
    return lxml.html.fromstring(text)


def page_of(text: str) -> Any:
    """Return a page of every kind of part, each with this text."""
    time = datetime(2026, 1, 2, 3, 4, tzinfo=timezone.utc)
    parts = [
        elements.paragraph(text),
        Table([text, "b"], [[text, elements.toned(text, "good")]], caption=text),
        elements.cards([elements.Card(text, text, text)]),
        elements.bullets([text]),
        elements.figure(Markup("<svg></svg>"), text),
        elements.bar(0.5, text),
        elements.folded(text, elements.notice(text, elements.paragraph(text))),
    ]
    origin = Origin(time, text, [(text, 64 * "a")], {text: "model.yaml"})
    return parsed(Document(text, text, [Section(text, parts, text)], origin).to_html())


@given(TEXTS)
@example(EVIL)
def test_any_text_comes_out_of_the_page_as_it_went_in(text: str) -> None:
    tree = page_of(text)
    plain = page_of("plain")
    assert [one.tag for one in tree.iter()] == [one.tag for one in plain.iter()]
    assert [one.keys() for one in tree.iter()] == [one.keys() for one in plain.iter()]
    for path in ("h1", "h2", "caption", "td/span", "figcaption", "aside/strong", "summary/code"):
        (found,) = tree.xpath(f"//{path}")
        assert found.text_content().split() == text.split()


@given(st.lists(st.lists(TEXTS, min_size=3, max_size=3), max_size=5))
def test_terminal_and_page_show_the_same_cells(rows: list[list[str]]) -> None:
    body = [[elements.toned(first, "good"), *rest] for first, *rest in rows]
    table = Table(["a", "b", "c"], body, texts=2)
    cells = parsed(f"<div>{Markup(table)}</div>").xpath("//tbody/tr/*")
    head, *lines = str(table).splitlines()
    assert head.split() == ["a", "b", "c"]
    assert " ".join(lines).split() == [word for one in cells for word in one.text_content().split()]


# -- curves ------------------------------------------------------------------------------------------------------------


@given(st.integers(2, 9000), st.integers(0, 1000))
def test_a_chart_carries_the_data_and_loses_no_spike_and_no_gap(count: int, seed: int) -> None:
    t = 1.7e9 + 0.02 * np.arange(count)
    first, second = np.random.default_rng(seed).standard_normal((2, count))
    first[count // 2] = np.nan
    half = 0.1 + np.abs(second)
    curves = [Trace("a", first, plots.PLAIN), Trace("b", second, "#1a75f2", half=half)]
    chart = Chart("pan", "#1a75f2", "torque, N m", t, curves, {"angle, °": np.cos(t)})
    ((table,),) = unpacked(str(Charts("run", [[chart]]).__html__()))
    rows = np.round(table[0] / 0.02).astype(int)
    assert len(rows) <= 3000
    assert np.all(np.diff(rows) > 0)
    columns = [t - t[0], np.cos(t), first, second, second - half, second + half]
    np.testing.assert_array_equal(table, np.stack(columns)[:, rows].astype("f4"))
    for kept, curve in zip(table[2:4], (first, second)):
        assert np.isnan(kept).any() == np.isnan(curve).any()
        for pick in (np.nanmin, np.nanmax):
            assert pick(kept) == pick(curve).astype("f4")


def test_drawing_is_repeatable_and_leaves_matplotlib_as_it_was() -> None:
    def draw() -> Any:
        figure, axes = plots.panels(1, 2, 2.0)
        plots.curve(axes[0, 0], np.arange(5.0), 0.0025 * np.array([0, 1.0, np.nan, 1.0, 0.5]))
        axes[0, 0].set_yticks([0.0, 0.0005, 0.0025])
        axes[0, 1].set(xscale="log", yscale="log", xlim=(1, 1000), ylim=(0.11, 0.9))
        plots.put_legend(axes[0, 0], [("_hidden $x$", "red"), (EVIL, "blue")])
        return figure

    before = dict(matplotlib.rcParams)
    first = plots.drawn(draw, EVIL)
    assert plots.drawn(draw, EVIL) == first
    assert dict(matplotlib.rcParams) == before
    texts = {text.text_content() for text in parsed(first).iter("text")}
    assert {"_hidden $x$", EVIL, "1000", "0.0005"} <= texts
