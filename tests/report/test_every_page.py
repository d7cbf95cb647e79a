"""Every kind of page that is written: in a real browser, on a desktop and on a telephone, without a network."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import gimbal_pin
from gimbal_pin import Rig, compare_fleet, monte_carlo, write_log
from gimbal_pin.log import inspect
from gimbal_pin.pointing import WANTED
from gimbal_pin.report import describe_record, outlook
from gimbal_pin.report.view import gaze
from tests.browsing import OPEN, WIDER, needs_browser, unpacked, visit, wide
from tests.pointing.test_gaze import verified
from tests.report.test_records import RECORDS, log_of
from tests.report.test_report import walked, whole


def compared(rig: Rig, folder: Path) -> str:
    for k in range(3):
        write_log(log_of(rig), folder / f"{k}.csv")
    (folder / "manifest.yaml").write_text(
        f"rig: turret\nlogs: [{', '.join(f'{{log: {k}.csv}}' for k in range(3))}]"
    )
    return describe_record(
        compare_fleet(folder, quick=True, executor=ThreadPoolExecutor(1))
    ).to_html()


def simulated(rig: Rig) -> str:
    return describe_record(
        monte_carlo(rig, count=3, seconds=0.65, executor=ThreadPoolExecutor(1))
    ).to_html()


def inspected(rig: Rig, folder: Path) -> str:
    write_log(log_of(rig), folder / "log.csv")
    return describe_record(inspect(folder / "log.csv", rig)).to_html()


PAGES: dict[str, Callable[[Rig, Path], str]] = {
    "auto": lambda rig, _: whole(walked(rig)),
    "animate": lambda rig, _: gimbal_pin.animate(rig, log_of(rig)).page,
    "animate --beside": lambda rig, _: (
        gimbal_pin.animate(rig, log_of(rig), beside=log_of(rig)).page
    ),
    "camera": lambda *_: gaze.render_gaze(outlook(verified(), WANTED), WANTED),
    "track --animation": lambda *_: verified().animate().page,
    "track --report": lambda *_: describe_record(verified()).to_html(),
    "montecarlo": lambda rig, _: simulated(rig),
    "fleet": compared,
    "inspect": inspected,
    **{
        name: lambda rig, _, name=name: describe_record(RECORDS[name](rig)).to_html()
        for name in RECORDS
    },
}
"""What is written → how, of a rig and in a folder."""

EMPTY = """[...document.querySelectorAll('svg')].filter(svg => svg.checkVisibility()).filter(svg => {
  const box = svg.getBoundingClientRect();
  const shown = [...svg.querySelectorAll('path')].filter(p => p.getBoundingClientRect().width > 50);
  return box.width < 300 || box.height < 100 || shown.length < 3;
}).map(svg => svg.getAttribute('aria-label'))"""
"""Figures in which nothing is to be seen."""

OUTSIDE = """[...document.querySelectorAll('svg')].filter(svg => svg.checkVisibility()).flatMap(svg => {
  const box = svg.getBoundingClientRect();
  return [...svg.querySelectorAll('text')].filter(text => { const t = text.getBoundingClientRect();
    return t.left < box.left - 1 || t.right > box.right + 1 || t.top < box.top - 1 || t.bottom > box.bottom + 1;
  }).map(text => text.textContent); })"""
"""Labels that are cut off at a figure's edge."""

PLAYING = """[...document.querySelectorAll('iframe')].map(one => one.contentDocument)
  .concat(document.getElementById('clock') ? document : []).map(one =>
    /^\\d+\\.\\d\\d \\/ \\d+\\.\\d\\d s$/.test(one.getElementById('clock').value)
      && one.querySelector('canvas').width > 100
      && one.documentElement.scrollWidth <= one.documentElement.clientWidth)"""
"""Whether each scene draws, tells its time and keeps to its frame."""

CLEAR = """[window, ...[...document.querySelectorAll('iframe')].map(one => one.contentWindow)]
  .filter(one => one.document.getElementById('about')).map(one => one.eval(`(() => {
    const box = id => at(id).getBoundingClientRect(), middle = innerHeight / 2;
    const half = 0.44 * innerWidth / recorded.aspect;
    return box("about").bottom < middle - half && box("bar").top > middle + half; })()`))"""
"""Whether words and bar of each scene lie above and below what its views hold, in a window higher than wide."""


@needs_browser
@pytest.mark.parametrize("name", PAGES)
def test_a_browser_shows_every_page_without_complaint_or_network(name: str, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    page = PAGES[name](Rig.load("turret"), tmp_path)
    path.write_text(page, encoding="utf-8")
    looks = (EMPTY, OUTSIDE, WIDER, "document.querySelectorAll('.chart canvas').length", PLAYING)
    seen = visit(
        path.as_uri(),
        "document.querySelector('h1').textContent.trim()",
        OPEN,
        wide(1380),
        *looks,
        wide(390),
        *looks,
        CLEAR,
    )
    heading, _, *values, clear = seen.values
    assert (seen.complaints, seen.requests) == ([], [path.as_uri()]) and heading and all(clear)
    charts = sum(map(len, unpacked(page)))
    for empty, outside, wider, drawn, playing in (values[:5], values[5:]):
        assert (empty, outside, wider, drawn) == ([], [], 0, charts) and all(playing)
