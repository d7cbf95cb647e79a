"""Pages in a real browser: every kind of page is shown without complaint or network, charts and scenes go together."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gimbal_pin
from gimbal_pin import Log
from gimbal_pin.report import Document, list_shown_joints, pages, picture_log
from gimbal_pin.report.view import browser, record
from tests.browsing import OPEN, Step, audit, go, media, needs_browser, unpacked, until, visit, wide
from tests.report.records import RECORDS, RIGS, log_of, page_of

CHARTS = "document.querySelectorAll('.chart canvas').length"
PLAYING = """[...document.querySelectorAll('iframe')].map(one => one.contentDocument)
  .concat(document.getElementById('clock') ? document : []).every(one =>
    /^\\d+\\.\\d\\d \\/ \\d+\\.\\d\\d s$/.test(one.getElementById('clock')?.value)
      && one.querySelector('canvas')?.width > 100)"""
"""Whether each scene draws and tells its time."""


@needs_browser
def test_a_browser_shows_every_page_without_complaint_or_network(tmp_path: Path) -> None:
    """On a telephone; charts are as many as the page carries, every scene plays."""
    every = [page_of(*one) for one in RECORDS if one[0] == "turret" or one[1] == "Auto"]
    log = log_of("turret").part(slice(0, 1000))
    every.append(gimbal_pin.animate(log, RIGS["turret"], beside=log).page)
    steps = [wide(390)]
    for k, page in enumerate(every):
        path = tmp_path / f"{k}.html"
        path.write_text(page, encoding="utf-8")
        carried = sum(map(len, unpacked(page)))
        steps += [go(path.as_uri()), OPEN, until(f"{CHARTS} === {carried} && {PLAYING}", 30)]
    seen = visit("about:blank", *steps)
    assert seen.complaints == []
    assert {*seen.requests} <= {path.as_uri() for path in tmp_path.iterdir()} | {"about:blank"}


@needs_browser
def test_axe_has_nothing_against_the_report_light_or_dark(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(page_of("slider", "Auto"), encoding="utf-8")
    found = list[Any]()
    dark = media(color_scheme="dark")
    visit(path.as_uri(), OPEN, wide(1280), audit(found), dark, audit(found, "color-contrast"))
    assert found == []


PLACE = """(() => {{ const over = document.querySelectorAll('.u-over')[{}];
  over.scrollIntoView({{ block: "center", behavior: "instant" }});
  const box = over.getBoundingClientRect();
  return [box.left, box.width, box.top + box.height / 2]; }})()"""
"""Left edge, width and middle of a chart, pixels."""


def mouse(kind: str, chart: int, share: float, button: str = "none") -> Step:
    """Move, press or release the mouse within a chart, at a share of its width."""

    async def done(tab: Any) -> None:
        left, width, y = await browser.evaluate(tab, PLACE.format(chart))
        event = {"type": f"mouse{kind}", "x": left + share * width, "y": y, "button": button}
        await tab.send_command("Input.dispatchMouseEvent", {**event, "clickCount": 1})

    return done


TIMES = """Object.values(Run.named).flatMap(run =>
  run.charts.map(one => one.row === null ? null : one.t[one.row]))"""
"""Time at each chart's cursor, s."""
READ = """[...document.querySelectorAll('.chart')].map(one =>
  [...one.querySelectorAll('button span')].map(value => value.textContent))"""
"""What stands beside each curve's name."""
CLOCK = "document.querySelector('iframe').contentDocument.getElementById('clock').value"
SLIDE = """(() => { const bar = document.querySelector('iframe').contentDocument.getElementById('time');
  bar.value = 1.23; bar.dispatchEvent(new Event('input')); })()"""


@needs_browser
def test_charts_and_scene_of_a_run_show_one_time_and_the_data(tmp_path: Path) -> None:
    """By the mouse over a chart, by a click, by the scene's bar."""
    rig = RIGS["turret"]
    t = 3.0 + 0.02 * np.arange(200)
    q = 0.3 * np.sin(t[:, None] + np.arange(rig.n))
    log = Log("run", rig.joints, t, q, tau=np.cos(t[:, None] + np.arange(rig.n)))
    drawn = picture_log(list_shown_joints(rig), log, "caption")
    shown = pages.show_animation(partial(record, rig, log), "lead", "run", drawn)
    path = tmp_path / "page.html"
    path.write_text(Document("page", "", [shown]).to_html(), encoding="utf-8")
    steps = [wide(1280), until(PLAYING), mouse("Moved", 1, 0.4), TIMES, READ]
    steps += [mouse("Moved", 0, 0.25), mouse("Pressed", 0, 0.25, "left")]
    steps += [mouse("Released", 0, 0.25, "left"), until(f"{TIMES}[0] < 4.1"), TIMES, CLOCK]
    steps += [mouse("Moved", 0, -0.2), SLIDE, until(f"{TIMES}[0] > 4.1"), TIMES, CLOCK]
    seen = visit(path.as_uri(), *steps)
    times, texts, clicked, played, _, after, again = seen.values
    assert seen.complaints == []
    assert times == pytest.approx([3.0 + 0.4 * 3.98] * 2, abs=0.03)
    row = int(np.argmin(np.abs(t - times[0])))
    read = [[float(text.replace("−", "-")) for text in one] for one in texts]
    wanted = [np.degrees(q[row]), np.asarray(log.tau)[row]]
    np.testing.assert_allclose(read, wanted, rtol=1e-4)
    assert clicked == pytest.approx([3.0 + 0.25 * 3.98] * 2, abs=0.03)
    assert played == f"{clicked[0]:.2f} / 6.98 s"
    assert after == pytest.approx([4.23] * 2, abs=0.011)
    assert again == "4.23 / 6.98 s"
