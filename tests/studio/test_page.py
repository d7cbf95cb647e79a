"""The studio's page in a real browser, and its server: this machine alone, and there only who has the address."""

from __future__ import annotations

import asyncio
import http.client
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
import yaml

from gimbal_pin import write_log
from gimbal_pin.control import bench_run
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects.rig_effect import get_payload
from gimbal_pin.report.view import browser
from gimbal_pin.rig import Rig
from tests.browsing import Step, audit, media, needs_browser, pause, visit, wide
from tests.command_line import Run, heard, refused
from tests.report.test_live import listening, on_linux
from tests.rigs import bundled

pytest.importorskip("nicegui")


@contextmanager
def served(
    *words: str, folder: Path, lines: int = 0
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A studio of these words in a folder: its process and its address. It complains in so many `lines`."""
    call = [sys.executable, "-m", "gimbal_pin.cli", "studio", *words, "--no-browser"]
    pipes: Any = dict(
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder, preexec_fn=heard
    )
    with subprocess.Popen(call, **pipes) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found, process.stderr.read()
            yield process, found[0]
            process.send_signal(signal.SIGINT)
            process.wait(20)
            said = process.stderr.read()
            assert said.count("\n") == lines and "Traceback" not in said, said
        finally:
            process.kill()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log of the turret."""
    place = tmp_path_factory.mktemp("studio")
    write_log(
        bench_run(nominal(bundled("turret")), rng=np.random.default_rng(0), seconds=20.0),
        place / "log.csv",
    )
    return place


def until(condition: str, seconds: float = 180.0) -> Step:
    """Wait until a script's value is true."""

    async def waited(tab: Any) -> None:
        for _ in range(round(seconds / 0.1)):
            if await browser.evaluate(tab, condition):
                return
            await asyncio.sleep(0.1)
        raise AssertionError(f"never: {condition}: {await browser.evaluate(tab, SAID)}")

    return waited


def press(element: str, share: float = 0.5, to: float | None = None) -> Step:
    """Press the mouse on an element, so far along its width, and let it go there or at another share."""

    async def pressed(tab: Any) -> None:
        find = (
            f"(() => {{ const e = {element}; e.scrollIntoView({{block: 'center'}}); return e; }})()"
        )
        box = await browser.evaluate(tab, f"(({find}).getBoundingClientRect().toJSON())")
        ends = [box["left"] + x * box["width"] for x in (share, share if to is None else to)]
        moves = [
            ("mouseMoved", ends[0]),
            ("mousePressed", ends[0]),
            ("mouseMoved", ends[1]),
            ("mouseReleased", ends[1]),
        ]
        for kind, x in moves:
            place = {"x": x, "y": box["top"] + box["height"] / 2, "button": "left", "clickCount": 1}
            await tab.send_command("Input.dispatchMouseEvent", {"type": kind, **place})
            await asyncio.sleep(0.1)

    return pressed


def enter(element: str, text: str) -> Step:
    """Type a text into a field, over what it holds, and press Enter."""

    async def entered(tab: Any) -> None:
        await browser.evaluate(tab, f"(e => {{ e.focus(); e.select(); }})({element})")
        await tab.send_command("Input.insertText", {"text": text})
        await push("Enter")(tab)  # type: ignore[operator]

    return entered


def push(key: str) -> Step:
    """Push a key and let it go."""

    async def pushed(tab: Any) -> None:
        codes = {"Enter": 13, "ArrowRight": 39}
        for kind in ("keyDown", "keyUp"):
            key_event = {"type": kind, "key": key, "code": key, "windowsVirtualKeyCode": codes[key]}
            await tab.send_command("Input.dispatchKeyEvent", key_event)

    return pushed


SAID = "document.querySelector('.said').textContent"
TITLE = "document.querySelector('h1').textContent"
BANDWIDTH = "document.querySelector('.table td')?.textContent"
JITTER = "document.querySelector('[data-figure=jitter]')?.textContent"
SETTLED = f"{JITTER} && {SAID} === ''"
CLOCK = "document.querySelector('iframe')?.contentDocument?.getElementById('clock')?.value"
"""What the scene's clock shows: before, its frame is another page."""
JUDGED = "document.querySelector('.judged .side').textContent"
NOTE = "document.querySelector('[data-note=bandwidth_hz]').textContent"
NUMBERS = "[...document.querySelectorAll('[data-number]')].map(one => one.value)"
POSITIONS = "[...document.querySelectorAll('[data-slider]')].map(one => one.ariaValueNow)"


FITS = "document.documentElement.scrollWidth <= innerWidth"


def act(name: str) -> Step:
    """Press a button, once it can be."""
    button = f"document.querySelector('[data-act={name}]')"

    async def acted(tab: Any) -> None:
        await until(f"!{button}.disabled")(tab)  # type: ignore[operator]
        await press(button)(tab)  # type: ignore[operator]

    return acted


@needs_browser
def test_a_person_tunes_swaps_goes_back_and_saves(folder: Path, run: Run) -> None:
    slider = "document.querySelector('[data-slider=bandwidth_hz] .q-slider__track-container')"
    camera = "[...document.querySelectorAll('button.camera')].find(one => one.innerText.trim() === 'cinema')"
    swap = [
        act("swap-camera"),
        until(f"{camera} && {camera}.getBoundingClientRect().width > 50"),
        press(camera),
    ]
    with served("turret", "log.csv", "-o", "out", folder=folder) as (_, url):
        seen = visit(
            url, wide(1280), until(SETTLED), BANDWIDTH, TITLE, "document.querySelectorAll('canvas').length", JUDGED,
            act("save-controller"), until(f"{SAID}.startsWith('saved')"),
            press(slider, 0.5), until(f"{BANDWIDTH} !== '8.00 Hz' && {SAID} === ''"), BANDWIDTH,
            "document.querySelector('[data-number=bandwidth_hz]').value",
            "document.querySelector('[data-slider=bandwidth_hz]').ariaValueNow",
            act("undo"), until(f"{BANDWIDTH} === '8.00 Hz'"),
            *swap, until(f"{TITLE} === 'turret with cinema' && {SAID} === ''"),
            act("undo"), until(f"{TITLE} === 'turret with infrared'"),
            act("redo"), until(f"{TITLE} === 'turret with cinema'"),
            act("undo"), until(f"{TITLE} === 'turret with infrared' && {SAID} === ''"),
            press("document.querySelector('canvas')", 0.3, 0.6), until(f"!{JUDGED}.startsWith('13.3 to')"),
            JUDGED, until(SETTLED),
            FITS,
            act("save-report"), until(f"{SAID}.startsWith('saved')", 300),
        )  # fmt: skip
    first, title, canvases, judged, moved, number, spoken, marked, fits = seen.values
    assert (first, title, canvases, fits) == ("8.00 Hz", "turret with infrared", 5, True)
    assert float(moved.split()[0]) == pytest.approx(float(number), rel=0.01) and float(number) > 15
    assert float(spoken) == float(number)
    assert judged.startswith("13.3 to 20.0 s") and float(marked.split()[0]) < 13
    assert seen.complaints == []
    assert {urlsplit(one).hostname for one in seen.requests} == {"127.0.0.1"}
    own = folder / "tuned.yaml"
    assert run("tune", "turret", folder / "log.csv", "-o", own, "--plants", "1")[0] == 0
    assert (folder / "out" / "controller.yaml").read_bytes() == own.read_bytes()
    assert (
        "<h2" in (folder / "out" / "report.html").read_text()
        and (folder / "out" / "run.json").is_file()
    )


@needs_browser
def test_a_rig_without_a_payload_has_no_sliders_for_one(folder: Path) -> None:
    number = "document.querySelector('[data-number=mass]')"
    with served("turret", "--payload", "none", folder=folder) as (_, url):
        seen = visit(url, wide(800), until(SETTLED), f"{number} === null", BANDWIDTH, FITS)
    assert seen.values == [True, "8.00 Hz", True] and seen.complaints == []


@needs_browser
def test_figures_sliders_and_files_belong_to_the_camera_that_is_mounted(folder: Path) -> None:
    """Another camera has its own ends of the slider, place and mass, and the file of its controller names it."""
    mass, x = (f"document.querySelector('[data-number={name}]')" for name in ("mass", "x"))
    end = "Number(document.querySelector('[data-slider=mass]').ariaValueMax)"
    shown = f"[Number({mass}.value), {end}, Number({x}.value), document.querySelector('.table').innerText]"
    other = "document.querySelector('[data-figure=other-camera]').textContent"
    camera = "[...document.querySelectorAll('button.camera')].find(one => one.innerText.trim() === 'cinema')"
    swap = [
        act("swap-camera"),
        until(f"{camera} && {camera}.getBoundingClientRect().width > 50"),
        press(camera),
    ]
    with served("turret", "log.csv", "-o", "swapped", folder=folder) as (_, url):
        seen = visit(
            url, wide(1280), until(SETTLED), other, enter(mass, "5"), until(f"{mass}.value === '5' && {SETTLED}"),
            enter(x, "3"), until(f"{x}.value === '3' && {SETTLED}"), *swap,
            until(f"{TITLE} === 'turret with cinema' && {SETTLED}"), shown, other,
            act("save-controller"), until(f"{SAID}.startsWith('saved')"),
        )  # fmt: skip
    own, (weighs, most, moved, table), marked = seen.values
    rig = Rig.load("turret", "cinema")
    stated = float(get_payload(rig)[1].mass)
    assert own == "" and "infrared" in marked and "cinema" in marked and seen.complaints == []
    assert (
        weighs == pytest.approx(stated, rel=1e-3)
        and most == pytest.approx(3 * stated, rel=1e-3)
        and moved == 0
    )
    saved = yaml.safe_load((folder / "swapped" / "controller.yaml").read_text())
    assert saved["payload"] == "cinema"
    for joint, gains in saved["joints"].items():
        assert f"{gains['bandwidth_hz']:.3g}" in next(
            line for line in table.splitlines() if line.startswith(joint)
        )


@needs_browser
def test_malformed_events_are_one_line_and_the_page_stays_usable(folder: Path) -> None:
    slider = "document.querySelector('[data-slider=bandwidth_hz]')"
    emit = f"getElement(Number({slider}.id.slice(1))).$emit('change', {{}})"
    number = "document.querySelector('[data-number=bandwidth_hz]')"
    with served("turret", folder=folder, lines=1) as (_, url):
        at = url.removesuffix("/")
        assert [answer(url, urlsplit(f"{at}/scene?payload={name}").path + f"?payload={name}") for name in
                ("nonsense", "..%2F..%2Fetc%2Fpasswd", "%00", "cinema")] == [404, 404, 404, 200]  # fmt: skip
        seen = visit(
            url, wide(1280), until(SETTLED), f"({emit}, 0)", pause(0.5),
            enter(number, "6"), until(f"{BANDWIDTH} === '6.00 Hz'"),
        )  # fmt: skip
    assert seen.complaints == []


def load_without_connection() -> Step:
    """Load the page again, and let it never hear of its server."""

    async def loaded(tab: Any) -> None:
        source = {"source": "window.WebSocket = function () {};"}
        await tab.send_command("Page.addScriptToEvaluateOnNewDocument", source)
        loaded = tab.get_session().subscribe_once("Page.loadEventFired")
        await tab.send_command("Page.reload")
        await asyncio.wait_for(loaded, 60)

    return loaded


@needs_browser
def test_the_page_is_served_with_the_values_that_hold(folder: Path) -> None:
    number, mass = (
        f"document.querySelector('[data-number={name}]')" for name in ("bandwidth_hz", "mass")
    )
    with served("turret", "log.csv", folder=folder) as (_, url):
        seen = visit(
            url, wide(1280), until(SETTLED), enter(number, "6.5"), until(f"{BANDWIDTH} === '6.50 Hz' && {SETTLED}"),
            NUMBERS, POSITIONS, load_without_connection(), until(f"{mass}?.value"), NUMBERS, POSITIONS, BANDWIDTH,
        )  # fmt: skip
    numbers, positions, first_numbers, first_positions, bandwidth = seen.values
    assert numbers[0] == "6.5" and bandwidth == "6.50 Hz" and seen.complaints == []
    assert (first_numbers, first_positions) == (numbers, positions)


@needs_browser
def test_a_wish_that_cannot_be_is_put_back_and_the_reason_stands_beside_it(folder: Path) -> None:
    """One that is refused leaves no trace; of one that is lowered the field says what was granted."""
    hertz, disk = (
        f"document.querySelector('[data-number={name}]')"
        for name in ("bandwidth_hz", "disk_margin")
    )
    said = "document.querySelector('[data-note=disk_margin]').textContent"
    slider = "document.querySelector('[data-slider=bandwidth_hz]').ariaValueNow"
    with served("turret", folder=folder) as (_, url):
        seen = visit(
            url, wide(1280), until(SETTLED),
            enter(disk, "1.9"), until(f"{said} && {SETTLED}"), said, NUMBERS, BANDWIDTH,
            "document.querySelector('[data-act=undo]').disabled",
            enter(hertz, ""), until(f"{hertz}.value === '8'"),
            enter(hertz, "90"), until(f"{NOTE} && {SETTLED}"), NOTE, f"{hertz}.value", slider, BANDWIDTH, said,
            enter(hertz, "90"), until(f"{hertz}.value !== '90'"), f"{hertz}.value",
            enter(hertz, "5"), until(f"{BANDWIDTH} === '5.00 Hz'"), NOTE,
        )  # fmt: skip
    why, numbers, kept, is_first, lowered, shown, position, granted, gone, again, quiet = (
        seen.values
    )
    assert why.startswith("disk_margin: is 1.9, and the most that any bandwidth keeps")
    assert numbers[:2] == ["8", "0.5"] and kept == "8.00 Hz" and is_first and seen.complaints == []
    assert granted == f"{granted.split()[0]} of 90.0 Hz"
    assert lowered.startswith(
        f"pan, tilt: bandwidth lowered to {granted.split()[0]} Hz, as 90 Hz would leave"
    )
    assert (
        float(shown) == pytest.approx(float(granted.split()[0]), rel=0.01)
        and float(position) == float(shown) < 40
    )
    assert again == shown and gone == quiet == ""


@needs_browser
def test_the_page_is_accessible(folder: Path) -> None:
    """By axe-core, light and dark, on a phone, too, with a line that refuses a number, and with the list of cameras."""
    found: list[Any] = []
    dialog, number = (
        "document.querySelector('.q-dialog .camera')",
        "document.querySelector('[data-number=bandwidth_hz]')",
    )
    with served("turret", "log.csv", folder=folder) as (_, url):
        light, dark = ([media("screen", scheme), audit(found)] for scheme in ("light", "dark"))
        seen = visit(
            url, wide(1280), until(SETTLED), until(CLOCK), *light, *dark, wide(390), *light, enter(number, "500"),
            until(f"{NOTE} === 'bandwidth: is 500; give 0.1 to 100 Hz'"), f"{number}.value", *dark, *light,
            act("swap-camera"), until(f"{dialog} && {dialog}.getBoundingClientRect().width > 50"), pause(0.5),
            *light, *dark,
        )  # fmt: skip
    assert found == [] and seen.values == ["8"] and seen.complaints == []


@needs_browser
def test_the_scene_stands_until_it_is_played(folder: Path) -> None:
    """And the line of its angles is above the rig, not over it."""
    page = "document.querySelector('iframe').contentDocument"
    is_above = f"{page}.getElementById('about').getBoundingClientRect().bottom < 60"
    with served("turret", "log.csv", folder=folder) as (_, url):
        seen = visit(
            url, wide(1280), until(SETTLED), until(CLOCK), pause(1.0), CLOCK, pause(0.5), CLOCK, is_above,
            f"{page}.defaultView.addEventListener('message', () => {{ window.heard = true; }})",
            pause(0.5), "Boolean(window.heard)",
            f"{page}.getElementById('play').click()", until(f"!{CLOCK}.startsWith('0.00')"),
        )  # fmt: skip
    assert seen.values[:3] == ["0.00 / 20.00 s", "0.00 / 20.00 s", True] and seen.complaints == []
    assert seen.values[4] is False  # meshcat's window answers each message with another, for ever


TIMED = """(() => {
  const charts = [...document.querySelectorAll('.chart')];
  const slider = document.querySelector('[data-slider=bandwidth_hz]');
  let begun = 0;
  window.spent = [];
  slider.addEventListener('keydown', event => { begun = event.timeStamp; }, true);
  getElement(Number(charts.at(-1).id.slice(1))).chart.on('finished', () => requestAnimationFrame(() => {
    if (begun) spent.push(performance.now() - begun);
    begun = 0;
  }));
  slider.querySelector('.q-slider__track-container').focus();
})()"""
"""Notes the time from a key that moves the slider to the frame after the last of the charts is drawn again, ms."""


@needs_browser
def test_time_from_a_slider_to_its_figures(folder: Path, record_testsuite_property: Any) -> None:
    """Reports, in the suite's XML, and asserts nothing, of seconds."""
    moves = [
        each
        for k in range(20)
        for each in (push("ArrowRight"), until(f"spent.length === {k + 1}"), pause(0.1))
    ]
    with served("turret", "log.csv", folder=folder) as (_, url):
        seen = visit(url, wide(1280), until(SETTLED), pause(3.0), TIMED, *moves, "spent", BANDWIDTH)
    _, spent, moved = seen.values
    assert float(moved.split()[0]) == pytest.approx(10.0) and seen.complaints == []
    record_testsuite_property(
        "slider_to_figures_ms", f"median {np.median(spent):.0f}, worst {max(spent):.0f}"
    )


def answer(url: str, path: str, **headers: str) -> int:
    """Return the status of what the server says to a request."""
    at = urlsplit(url)
    with closing(http.client.HTTPConnection(at.hostname or "", at.port, timeout=20)) as connection:
        connection.request(
            "GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()}
        )
        return connection.getresponse().status


@on_linux
def test_only_this_machine_and_only_who_has_the_address(folder: Path) -> None:
    with served("turret", folder=folder) as (process, url):
        own = urlsplit(url).path
        assert answer(url, own) == 200
        inner = f"{own}_nicegui_ws/socket.io/?EIO=4&transport=websocket"
        upgrade = {"Connection": "Upgrade", "Upgrade": "websocket"}
        upgrade |= {"Sec_WebSocket_Version": "13", "Sec_WebSocket_Key": "MDEyMzQ1Njc4OWFiY2RlZg=="}
        for path in ("/", "/x/", f"{own[:-2]}/", f"/x{own}", "/docs", inner.replace(own, "/x/")):
            assert answer(url, path) == 403
        assert (
            answer(url, own, Host="evil.example")
            == answer(url, own, Origin="http://evil.example")
            == 403
        )
        assert answer(url, inner, **upgrade, Origin="http://evil.example") == 403
        assert answer(url, inner.replace(own, "/x/"), **upgrade) == 403
        assert listening(process.pid) == {"0100007F"}


def test_without_a_page_it_says_what_it_would_show(run: Run, folder: Path, tmp_path: Path) -> None:
    own = tmp_path / "tuned.yaml"
    assert run("tune", "turret", folder / "log.csv", "-o", own, "--plants", "1")[0] == 0
    code, out, _ = run("studio", "turret", folder / "log.csv", "--check")
    assert code == 0 and out.startswith("computed-torque for turret\npan: kp ")
    kp = yaml.safe_load(own.read_text())["joints"]["pan"]["kp"]
    assert f"pan: kp {kp:.4g}," in out


def test_what_is_missing_is_named(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "controller.yaml").write_text("mine")
    refused(
        run("studio", "turret", "-o", tmp_path, "--check"),
        2,
        "holds controller.yaml",
        "name another folder",
    )
    monkeypatch.setattr("gimbal_pin.studio.server.find_spec", lambda name: None)
    refused(
        run("studio", "turret"), 2, "NiceGUI is not installed; pip install 'gimbal-pin[studio]'"
    )
