"""Charts: what a page carries is the data, and in a real browser it is read, zoomed and switched off by hand."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.log import Log
from gimbal_pin.report import (
    Chart,
    Charts,
    Document,
    Section,
    Trace,
    list_shown_joints,
    pages,
    picture_log,
    plots,
)
from gimbal_pin.report.view import record
from gimbal_pin.rig import Rig
from tests.browsing import WIDER, Step, media, needs_browser, pause, unpacked, visit, wide

JOINTS = ("pan", "tilt")


def chart(
    seed: int, count: int = 400, name: str = "pan", colour: str = "#1a75f2", start: float = 5.0
) -> Chart:
    """Return a chart of two curves, one with a gap, over time, angle and rate."""
    rng = np.random.default_rng(seed)
    t = start + 0.02 * np.arange(count)
    first = np.sin(t + seed)
    second = np.sin(t + seed) + 0.1 * rng.standard_normal(count)
    second[count // 3 : count // 3 + 5] = np.nan
    curves = [
        Trace("measured", first, plots.PLAIN, 4.0),
        Trace("model", second, colour, 2.0, half=0.1 + np.abs(first)),
    ]
    return Chart(
        name,
        colour,
        "torque, N m",
        t,
        curves,
        {"angle, °": 50 * np.cos(t), "rate, °/s": 30 * np.sin(2 * t)},
    )


def test_the_library_is_the_one_that_was_recorded() -> None:
    folder = files("gimbal_pin.report").joinpath("uplot")
    listed = [line.split() for line in folder.joinpath("SHA256SUMS").read_text().splitlines()]
    assert {name for _, name in listed} == {"LICENSE", "uPlot.iife.min.js", "uPlot.min.css"}
    for digest, name in listed:
        assert hashlib.sha256(folder.joinpath(name).read_bytes()).hexdigest() == digest
    assert "MIT License" in folder.joinpath("LICENSE").read_text()


@given(st.integers(1, 9000), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1.7e9]))
def test_what_a_page_carries_is_the_data_and_no_spike_is_lost(
    count: int, seed: int, start: float
) -> None:
    """Each row is an instant of the data in 32 bits; lowest and highest of each curve are among them.

    A band's edges come after the curves.
    """
    whole = chart(seed, max(count, 2), start=start)
    ((table,),) = unpacked(str(Charts("run", [[whole]]).__html__()))
    assert table.shape[1] <= max(3000, 2) and np.all(np.diff(table[0]) > 0)
    rows = np.searchsorted(whole.t - start, table[0].astype(float) - 0.01)
    columns = [
        whole.t - whole.t[0],
        *whole.abscissae.values(),
        *(curve.values for curve in whole.curves),
    ]
    model = whole.curves[1]
    columns += [model.values - model.half, model.values + model.half]
    for kept, column in zip(table, columns, strict=True):
        assert np.array_equal(kept, column[rows].astype("f4"), equal_nan=True)
    for kept, curve in zip(table[-4:], whole.curves):
        for pick in (np.nanmin, np.nanmax) if not np.isnan(curve.values).all() else ():
            assert pick(kept) == pick(curve.values).astype("f4")


# -- a real browser ----------------------------------------------------------------------------------------------------


def draw() -> plots.Figure:
    """Draw the picture that paper has."""
    figure, panels = plots.panels(1, 1, 2.0)
    panels[0, 0].plot([0, 1], [0, 1])
    return figure


def figure_of(clock: str, rows: Sequence[Sequence[Chart]]) -> plots.Drawing:
    """Return a figure with charts."""
    return plots.Drawing(draw, "alt", "caption", charts=lambda: Charts(clock, rows))


@pytest.fixture(scope="module")
def grid() -> list[list[Chart]]:
    """Two charts of each joint."""
    colours = ("#1a75f2", "#14a05a")
    return [
        [chart(2 * j + k, name=name, colour=colours[j]) for k in range(2)]
        for j, name in enumerate(JOINTS)
    ]


@pytest.fixture(scope="module")
def address(grid: list[list[Chart]], tmp_path_factory: pytest.TempPathFactory) -> str:
    """Where a page lies with charts of one run in two figures, and of another in a third."""
    parts = [
        figure_of("run", grid),
        figure_of("run", [[chart(7)]]),
        figure_of("other", [[chart(8)]]),
    ]
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(Document("page", "", [Section("Charts", parts)]).to_html(), encoding="utf-8")
    return path.as_uri()


PLACE = """(() => {{ const over = document.querySelectorAll('.u-over')[{}];
  over.scrollIntoView({{ block: "center", behavior: "instant" }}); const box = over.getBoundingClientRect();
  return [box.left, box.width, box.top + box.height / 2]; }})()"""
"""Left edge, width and middle of a chart, pixels."""


def mouse(kind: str, chart: int, share: float, **more: Any) -> Step:
    """Move, press or release the mouse within a chart, at a share of its width."""

    async def done(tab: Any) -> None:
        from gimbal_pin.report.view import browser

        left, width, y = await browser.evaluate(tab, PLACE.format(chart))
        event = {
            "type": f"mouse{kind}",
            "x": left + share * width,
            "y": y,
            "button": "none",
            **more,
        }
        await tab.send_command("Input.dispatchMouseEvent", event)

    return done


def press(key: str) -> Step:
    """Press a key."""

    async def done(tab: Any) -> None:
        for kind in ("keyDown", "keyUp"):
            await tab.send_command("Input.dispatchKeyEvent", {"type": kind, "key": key})

    return done


def click(chart: int, share: float) -> list[Step]:
    """Click a place in a chart."""
    held: dict[str, Any] = {"button": "left", "clickCount": 1}
    return [
        mouse("Moved", chart, share),
        mouse("Pressed", chart, share, **held),
        mouse("Released", chart, share, **held),
    ]


TIMES = "Object.values(Run.named).flatMap(run => run.charts.map(one => one.row === null ? null : one.t[one.row]))"
"""Time at each chart's cursor, s."""

READ = """[...document.querySelectorAll('.chart')].map(one => [...one.querySelectorAll('button span')]
  .map(value => value.textContent))"""
"""What stands beside each curve's name."""

CURSORS = """[...document.querySelectorAll('.u-cursor-x')]
  .map(one => new DOMMatrix(getComputedStyle(one).transform).e)"""
"""Place of each chart's cursor, pixels."""

RANGES = (
    "Object.values(Run.named).flatMap(run => run.charts.map(one => "
    "[one.plot.scales.x.min, one.plot.scales.x.max]))"
)
"""What each chart shows of its abscissa."""

INK = """[...document.querySelectorAll('.chart canvas')].map(canvas => {
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height), seen = {};
  for (let k = 0; k < data.length; k += 4) if (data[k + 3] > 250) {
    const key = [data[k], data[k + 1], data[k + 2]].join(); seen[key] = (seen[key] ?? 0) + 1; }
  return seen; })"""
"""How many pixels of each chart have which colour."""

BANDED = INK.replace("data[k + 3] > 250", "data[k + 3] > 55 && data[k + 3] < 70")
"""How many pixels of each chart have which colour of a band."""

SHOWN = "['.plot', '.charts'].map(one => [...document.querySelectorAll(one)].filter(x => x.checkVisibility()).length)"
"""How many pictures, and how many figures of charts, are to be seen."""


def switch(chart: int, curve: int) -> str:
    """Return the script that presses a curve's button."""
    return (
        f"document.querySelectorAll('.chart')[{chart}].querySelectorAll('button')[{curve}].click()"
    )


def number(text: str) -> float:
    """Return what a written number says, nan for a dash."""
    return float("nan") if text == "–" else float(text.replace("−", "-"))


@needs_browser
def test_the_cursors_of_a_run_move_together_and_read_the_data(
    address: str, grid: list[list[Chart]]
) -> None:
    seen = visit(address, wide(1280), pause(0.5), mouse("Moved", 1, 0.4), TIMES, READ, CURSORS)
    assert seen.complaints == [] and seen.requests == [address]
    times, values, cursors = seen.values
    assert (
        len(times) == len(values) == len(cursors) == 6
    )  # joints × charts, one more of that run, one of another
    assert len(set(times[:5])) == 1 and np.ptp(cursors[:4]) < 1e-6 and cursors[0] > 50
    assert times[5] is None and values[5] == ["", ""]  # an untouched chart's legend has names alone
    assert times[0] == pytest.approx(5.0 + 0.4 * 0.02 * 399, abs=0.03)
    row = int(np.argmin(np.abs(grid[0][0].t - times[0])))
    for one, texts in zip([*grid[0], *grid[1]], values):
        assert [number(text) for text in texts] == pytest.approx(
            [c.values[row] for c in one.curves], rel=1e-4, nan_ok=True
        )


PLAYED = "[...document.querySelectorAll('iframe')].map(one => one.contentDocument.getElementById('clock').value)"
"""What the clock of each scene says."""


@needs_browser
def test_a_click_moves_the_scene_and_the_scene_moves_the_cursors(tmp_path: Path) -> None:
    """Two scenes of one run show one time, that of the charts."""
    rig = Rig.load("turret")
    t = 3.0 + 0.02 * np.arange(200)
    log = Log(
        "run",
        rig.joints,
        t,
        0.3 * np.sin(t[:, None] + np.arange(rig.n)),
        tau=np.cos(t[:, None] * np.ones(rig.n)),
    )
    drawn = picture_log(list_shown_joints(rig), log, "caption")
    every = [
        pages.show_animation(partial(record, rig, log), "lead", "run", part)
        for part in (drawn, figure_of("other", [[chart(1)]]))
    ]
    path = tmp_path / "page.html"
    path.write_text(Document("page", "", every).to_html(), encoding="utf-8")
    slide = """(() => { const bar = document.querySelectorAll('iframe')[1].contentDocument.getElementById('time');
      bar.value = 1.23; bar.dispatchEvent(new Event('input')); })()"""
    away = mouse("Moved", 2, 0.5)
    steps = (
        pause(1.0),
        *click(0, 0.25),
        pause(0.5),
        TIMES,
        PLAYED,
        away,
        slide,
        pause(0.5),
        TIMES,
        PLAYED,
    )
    seen = visit(path.as_uri(), wide(1280), *steps)
    clicked, played, _, after, again = seen.values
    assert clicked[:2] == [pytest.approx(3.0 + 0.25 * 3.98, abs=0.03)] * 2
    assert played == [f"{clicked[0]:.2f} / 6.98 s"] * 2
    assert after[:2] == [pytest.approx(4.23, abs=0.011)] * 2 and after[2] != pytest.approx(
        4.23, abs=0.02
    )
    assert again == ["4.23 / 6.98 s"] * 2 and seen.complaints == []


@needs_browser
def test_a_curve_that_is_switched_off_is_not_drawn_nor_its_band(address: str) -> None:
    blues = [f"26,{green},242" for green in (116, 117, 118)]  # under its band
    looks = (INK, BANDED)
    seen = visit(
        address,
        wide(1280),
        pause(0.5),
        *looks,
        switch(0, 1),
        pause(0.3),
        *looks,
        switch(0, 1),
        pause(0.3),
        INK,
    )
    before, banded, _, without, bare, _, again = seen.values
    assert sum(banded[0].values()) > 1000 and sum(bare[0].values()) < 100 and bare[1:] == banded[1:]
    assert sum(before[0].get(blue, 0) for blue in blues) > 100 and without[0].keys().isdisjoint(
        blues
    )
    assert again == before
    assert without[1:] == before[1:] and seen.complaints == []


@needs_browser
def test_a_drag_zooms_all_of_a_run_and_a_double_click_ends_it(address: str) -> None:
    held = {"button": "left", "clickCount": 1}
    drag = [
        mouse("Moved", 0, 0.25),
        mouse("Pressed", 0, 0.25, **held),
        mouse("Moved", 0, 0.5, buttons=1, **held),
    ]
    twice = [
        mouse(kind, 1, 0.5, button="left", clickCount=k)
        for k in (1, 2)
        for kind in ("Pressed", "Released")
    ]
    released = mouse("Released", 0, 0.5, **held)
    seen = visit(
        address,
        wide(1280),
        pause(0.5),
        *drag,
        released,
        pause(0.2),
        RANGES,
        *twice,
        pause(0.2),
        RANGES,
    )
    zoomed, whole = (np.array(x) for x in seen.values)
    full = np.array([5.0, 5.0 + 0.02 * 399])
    assert whole == pytest.approx(np.tile(full, (6, 1)), abs=1e-3)
    assert zoomed[:5] == pytest.approx(
        np.tile(full[0] + [0.25 * np.ptp(full), 0.5 * np.ptp(full)], (5, 1)), abs=0.05
    )
    assert zoomed[5] == pytest.approx(full, abs=1e-3) and seen.complaints == []


def touch(kind: str, chart: int, *shares: float) -> Step:
    """Put fingers on a chart at shares of its width, move them, or lift them."""

    async def done(tab: Any) -> None:
        from gimbal_pin.report.view import browser

        left, width, y = await browser.evaluate(tab, PLACE.format(chart))
        points = [{"x": left + share * width, "y": y} for share in shares]
        await tab.send_command(
            "Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points}
        )

    return done


@needs_browser
def test_two_fingers_zoom_all_of_a_run_and_one_moves_the_cursor(address: str) -> None:
    """What is under a finger stays under it."""
    pinch = [touch("Start", 0, 0.4, 0.6), touch("Move", 0, 0.3, 0.7), touch("Move", 0, 0.2, 0.8)]
    lifted = (touch("End", 0), pause(0.2))
    apart = [touch("Start", 1, 0.2, 0.8), touch("Move", 1, 0.4, 0.6), touch("Move", 1, 0.49, 0.51)]
    one = [touch("Start", 0, 0.1), touch("Move", 0, 0.5), touch("Move", 0, 0.75)]
    steps = (*pinch, *lifted, RANGES, *one, *lifted, TIMES, *apart, *lifted, RANGES, WIDER)
    seen = visit(address, wide(390), pause(0.5), *steps)
    zoomed, times, whole, wider = seen.values
    full = np.array([5.0, 5.0 + 0.02 * 399])
    length = 0.02 * 399
    assert zoomed[:5] == pytest.approx(
        np.tile(5.0 + length * np.array([1, 2]) / 3, (5, 1)), abs=0.05
    )
    assert zoomed[5] == pytest.approx(full, abs=1e-3)
    assert (
        times[:5] == pytest.approx([5.0 + length * (1 + 0.75) / 3] * 5, abs=0.05)
        and times[5] is None
    )
    assert (
        whole == pytest.approx(np.tile(full, (6, 1)), abs=1e-3)
        and wider == 0
        and seen.complaints == []
    )


@needs_browser
def test_keys_move_the_cursor_and_zoom(address: str) -> None:
    focus = "document.querySelectorAll('.frame-of-curves')[0].focus()"
    said = "document.activeElement.getAttribute('aria-valuetext')"
    keys = (press("Home"), press("ArrowRight"), press("ArrowRight"), press("ArrowLeft"))
    seen = visit(
        address,
        wide(1280),
        pause(0.5),
        focus,
        *keys,
        TIMES,
        said,
        press("+"),
        pause(0.2),
        RANGES,
        press("End"),
        TIMES,
    )
    _, second, text, ranges, last = seen.values
    assert second[:5] == pytest.approx([5.02] * 5) and last[0] == pytest.approx(5.0 + 0.02 * 399)
    assert re.fullmatch(r"5\.02: measured [−\d.]+, model [−\d.]+", text)
    assert ranges[0][1] - ranges[0][0] == pytest.approx(0.5 * 0.02 * 399, abs=0.01)


@needs_browser
def test_curves_are_dots_over_an_angle_and_each_keeps_its_time(
    address: str, grid: list[list[Chart]]
) -> None:
    over = """(() => { const one = document.querySelector('.tools select'); one.selectedIndex = 1;
      one.dispatchEvent(new Event('change')); return [...one.options].map(x => x.textContent); })()"""
    seen = visit(
        address,
        wide(1280),
        pause(0.5),
        over,
        pause(0.3),
        mouse("Moved", 0, 0.7),
        RANGES,
        TIMES,
        READ,
    )
    options, ranges, times, values = seen.values
    assert options == ["time", "angle", "rate"] and seen.complaints == []
    q = grid[0][0].abscissae["angle, °"]
    assert (
        ranges[:4] == pytest.approx(np.tile([q.min(), q.max()], (4, 1)), abs=1e-3)
        and ranges[4][0] == 5.0
    )
    assert len(set(times[:5])) == 1
    row = int(np.argmin(np.abs(grid[0][0].t - times[0])))
    assert q[row] == pytest.approx(q.min() + 0.7 * np.ptp(q), abs=0.3 * np.ptp(q))
    assert number(values[0][0]) == pytest.approx(grid[0][0].curves[0].values[row], rel=1e-4)


@needs_browser
def test_paper_has_the_picture_and_a_screen_the_charts_in_the_page_s_colours(address: str) -> None:
    shows = (
        SHOWN,
        media("print"),
        SHOWN,
        media("screen"),
        pause(0.2),
        INK,
        media("screen", "dark"),
        pause(0.3),
        INK,
    )
    seen = visit(address, wide(1280), pause(0.5), *shows)
    assert seen.values[:2] == [[0, 3], [3, 0]]
    light, dark = (set(one[0]) for one in seen.values[2:])
    assert {"221,227,234", "93,106,122"} & light and {
        "49,60,74",
        "154,167,182",
    } & dark  # lines and labels
    assert "221,227,234" not in dark


@needs_browser
def test_a_spectrum_has_a_cursor_of_its_own_and_logarithmic_axes(
    grid: list[list[Chart]], tmp_path: Path
) -> None:
    """A run's charts over time and over frequency stand in one figure, each with the cursors of its own kind."""
    f = np.geomspace(0.1, 100.0, 200)
    curves = [
        Trace("before", 1 / f, plots.PLAIN),
        Trace("after", np.where(f < 1, np.nan, 0.1 / f), "#1a75f2"),
    ]
    spectrum = Chart("pan", "#1a75f2", "amplitude, N m/√Hz", f, curves, {}, "frequency, Hz", "xy")
    path = tmp_path / "page.html"
    parts = [figure_of("run", [[grid[0][0], spectrum]]), figure_of("run", [[spectrum]])]
    path.write_text(Document("page", "", [Section("Charts", parts)]).to_html(), encoding="utf-8")
    drawn = Charts("run", [[grid[0][0], spectrum]]).draw().axes
    assert [axes.get_xscale() for axes in drawn] == ["linear", "log"] and drawn[
        1
    ].get_xlabel() == "frequency, Hz"
    middle = mouse("Moved", 1, 0.5)
    zoom = (press("+"), pause(0.2))
    focus = "document.querySelectorAll('.frame-of-curves')[1].focus()"
    seen = visit(path.as_uri(), wide(1280), pause(0.5), middle, TIMES, READ, focus, *zoom, RANGES)
    times, values, _, ranges = seen.values
    assert seen.complaints == [] and times[0] is None
    assert times[1:] == pytest.approx([10**0.5] * 2, rel=0.04)  # halfway on a logarithmic axis
    assert [number(x) for x in values[1]] == pytest.approx([1 / times[1], 0.1 / times[1]], rel=1e-4)
    assert ranges[0] == pytest.approx([5.0, 5.0 + 0.02 * 399], abs=1e-3)
    assert ranges[1] == ranges[2] and ranges[1][1] < 60.0
