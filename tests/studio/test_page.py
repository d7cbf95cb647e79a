"""The studio's page in a real browser, and its server: this machine alone, and there only who has the address."""

from __future__ import annotations

import asyncio
import http.client
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from gimbal_pin import write_log
from gimbal_pin.control import bench_run, read_controller, tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import get_payload
from gimbal_pin.report.view import browser
from tests.browsing import Step, audit, needs_browser, until, visit, wide
from tests.command_line import Run, heard, refused
from tests.report.test_live import listening, on_linux
from tests.rigs import bundled

pytest.importorskip("nicegui")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log of the turret."""
    place = tmp_path_factory.mktemp("studio")
    log = bench_run(nominal(bundled("turret")), rng=np.random.default_rng(0), seconds=12.0)
    write_log(log, place / "log.csv")
    return place


@pytest.fixture(scope="module")
def studio(folder: Path) -> Iterator[tuple[int, str]]:
    """A studio of that log: its process and its address. It complains in one line at most."""
    call = [sys.executable, "-m", "gimbal_pin.cli", "studio", "turret", "log.csv", "-o", "out"]
    pipes: Any = dict(
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder, preexec_fn=heard
    )
    with subprocess.Popen([*call, "--no-browser"], **pipes) as process:
        try:
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found, process.stderr.read()
            yield process.pid, found[0]
            process.send_signal(signal.SIGINT)
            process.wait(20)
            said = process.stderr.read()
            assert said.count("\n") <= 1, said
        finally:
            process.kill()


def press(element: str, share: float = 0.5) -> Step:
    """Press the mouse on an element, so far along its width, and let it go."""
    find = f"(() => {{ const e = {element}; e.scrollIntoView({{block: 'center'}}); return e; }})()"

    async def pressed(tab: Any) -> None:
        box = await browser.evaluate(tab, f"{find}.getBoundingClientRect().toJSON()")
        place = {"x": box["left"] + share * box["width"], "y": box["top"] + box["height"] / 2}
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            event = {"type": kind, **place, "button": "left", "clickCount": 1}
            await tab.send_command("Input.dispatchMouseEvent", event)
            await asyncio.sleep(0.1)

    return pressed


def act(name: str) -> list[Step]:
    """Press a button, once it can be."""
    button = f"document.querySelector('[data-act={name}]')"
    return [until(f"!{button}.disabled"), press(button)]


SAID = "document.querySelector('.said').textContent"
TITLE = "document.querySelector('h1').textContent"
BANDWIDTH = "document.querySelector('.table td')?.textContent"
SETTLED = f"document.querySelector('[data-figure=jitter]')?.textContent && {SAID} === ''"
NUMBER = "document.querySelector('[data-number={}]')"
SLIDER = "document.querySelector('[data-slider={}]')"
TRACK = f"{SLIDER}.querySelector('.q-slider__track-container')"
MASS = f"Number({NUMBER.format('mass')}.value)"
OTHER = "document.querySelector('[data-figure=other-camera]').textContent"


def answer(url: str, path: str, **headers: str) -> int:
    """Return the status of what the server says to a request."""
    at = urlsplit(url)
    with closing(http.client.HTTPConnection(at.hostname or "", at.port, timeout=20)) as connection:
        connection.request("GET", path, headers=headers)
        return connection.getresponse().status


@on_linux
def test_only_this_machine_and_only_who_has_the_address(studio: tuple[int, str]) -> None:
    pid, url = studio
    own = urlsplit(url).path
    inner = f"{own}_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    upgrade = {"Connection": "Upgrade", "Upgrade": "websocket"}
    upgrade |= {"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg=="}
    evil = {"Origin": "http://evil.example"}
    assert answer(url, own) == 200
    for path in ("/", f"{own[:-2]}/", f"/x{own}", "/docs", inner.replace(own, "/x/")):
        assert answer(url, path) == 403
    assert answer(url, own, Host="evil.example") == 403
    assert answer(url, own, **evil) == 403
    assert answer(url, inner, **upgrade, **evil) == 403
    for payload in ("nonsense", "..%2F..%2Fetc%2Fpasswd", "%00"):
        assert answer(url, f"{own}scene?payload={payload}") == 404
    assert answer(url, f"{own}scene?payload=cinema") == 200
    assert listening(pid) == {"0100007F"}


@needs_browser
def test_a_person_tunes_swaps_goes_back_and_saves(studio: tuple[int, str], folder: Path) -> None:
    """Nothing but this machine is asked, and axe has nothing against the page.

    Another camera has its own mass and ends of the slider; a malformed event is one line.
    """
    stated = float(get_payload(bundled("turret", "cinema"))[1].mass)
    hertz = SLIDER.format("bandwidth_hz")
    malformed = f"(getElement(Number({hertz}.id.slice(1))).$emit('change', {{}}), 0)"
    camera = (
        "[...document.querySelectorAll('button.camera')].find(x => x.innerText.trim() === 'cinema')"
    )
    swap = [until(f"{camera}?.getBoundingClientRect().width > 50"), press(camera)]
    found = list[Any]()
    moved = f"[{BANDWIDTH}, {NUMBER.format('bandwidth_hz')}.value, {hertz}.ariaValueNow]"
    mounted = f"[{MASS}, Number({SLIDER.format('mass')}.ariaValueMax), {OTHER}]"
    steps = [until(SETTLED), malformed, BANDWIDTH, TITLE, audit(found), mounted]
    steps += [*act("save-controller"), until(f"{SAID}.startsWith('saved')")]
    steps += [press(TRACK.format("bandwidth_hz"))]
    steps += [until(f"{BANDWIDTH} !== '8.00 Hz' && {SAID} === ''"), moved]
    steps += [*act("undo"), until(f"{BANDWIDTH} === '8.00 Hz' && {SAID} === ''")]
    steps += [*act("swap-camera"), *swap]
    steps += [until(f"{TITLE} === 'turret with cinema' && {SETTLED}"), mounted]
    steps += [*act("undo"), until(f"{TITLE} === 'turret with infrared'")]
    steps += [*act("redo"), until(f"{TITLE} === 'turret with cinema' && {SAID} === ''")]
    seen = visit(studio[1], wide(1280), *steps)
    _, first, title, given, (shown, number, spoken), mine = seen.values
    assert given[2] == ""
    np.testing.assert_allclose(mine[:2], [stated, 3 * stated], rtol=1e-3)
    assert "infrared" in mine[2]
    assert "cinema" in mine[2]
    assert (first, title) == ("8.00 Hz", "turret with infrared")
    assert float(shown.split()[0]) == pytest.approx(float(number), rel=0.01)
    assert float(spoken) == float(number) > 15
    assert (seen.complaints, found) == ([], [])
    assert {urlsplit(one).hostname for one in seen.requests} == {"127.0.0.1"}
    assert read_controller(folder / "out" / "controller.yaml", bundled("turret")).model


def test_without_a_page_it_tells_the_gains_and_what_is_missing(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, _ = run("studio", "turret", "--check")
    assert code == 0
    assert f"pan: kp {tune(nominal(bundled('turret'))).gains[0].kp:.4g}," in out
    (tmp_path / "controller.yaml").touch()
    refused(run("studio", "turret", "-o", tmp_path, "--check"), 2, "holds controller.yaml")
    monkeypatch.setattr("gimbal_pin.studio.server.find_spec", lambda name: None)
    refused(run("studio", "turret"), 2, "pip install 'gimbal-pin[studio]'")
