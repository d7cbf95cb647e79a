"""A page in a real headless Chromium: what its scripts say, what it complains of, what it asks the network for."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import tarfile
import tempfile
import zlib
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import pytest

from gimbal_pin.report.view import browser

Step = str | Callable[[Any], Awaitable[object]]
"""A script whose value is wanted, or what to do with the tab between two of these."""


def browser_missing() -> str:
    """Return why no browser can be tested here, or nothing."""
    try:
        from choreographer.browsers.chromium import Chromium
    except ImportError:
        return "choreographer is not installed (gimbal-pin[video])"
    return "" if Chromium.find_browser(skip_local=False) else "no Chromium is installed"


INFLATING = """[...document.querySelectorAll('iframe[data-deflated]')].some(frame =>
  frame.contentDocument.URL !== 'about:srcdoc' || frame.contentDocument.readyState !== 'complete')"""
"""Whether a page in the page is not yet there."""

LOADING = """[...document.querySelectorAll('iframe')].some(frame => frame.checkVisibility()
  && (frame.contentDocument?.readyState !== 'complete' || frame.contentDocument.URL === 'about:blank'))"""
"""Script: true while a visible frame still shows the empty document that precedes its page."""

needs_browser = pytest.mark.skipif(
    bool(browser_missing()), reason=browser_missing() or "there is one"
)


@dataclass
class Visit:
    """What a page said: the scripts' values, its complaints, the addresses it asked for, itself included."""

    values: list[Any] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    async def complain(self, message: Any) -> None:
        said = message["params"]
        if (
            said.get("type", "error") == "error"
            and said.get("entry", {}).get("level", "error") == "error"
        ):
            self.complaints.append(json.dumps(said))

    async def ask(self, message: Any) -> None:
        if not (wanted := message["params"]["request"]["url"]).startswith(
            "data:"
        ):  # part of the page itself
            self.requests.append(wanted)

    async def run(self, url: str, steps: Sequence[Step]) -> None:
        """Open an address, a file without a network, and take the steps."""
        async with browser.opened("") as tab:
            session = tab.get_session()
            for event in ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"):
                session.subscribe(event, self.complain)
            session.subscribe("Network.requestWillBeSent", self.ask)
            for domain in ("Runtime", "Log", "Network", "Page"):
                await tab.send_command(f"{domain}.enable")
            if not url.startswith("http:"):
                speeds = dict.fromkeys(("downloadThroughput", "uploadThroughput"), -1)
                cut = {"offline": True, "latency": 0, **speeds}
                await tab.send_command("Network.emulateNetworkConditions", cut)
            for step in (go(url), *steps):
                if isinstance(step, str):
                    self.values.append(await browser.evaluate(tab, step))
                else:
                    await step(tab)


def go(url: str) -> Step:
    """Open an address, and wait until the pages in its page are there."""

    async def done(tab: Any) -> None:
        loaded = tab.get_session().subscribe_once("Page.loadEventFired")
        await tab.send_command("Page.navigate", {"url": url})
        await asyncio.wait_for(loaded, 240)
        await until(f"!({INFLATING})")(tab)
        await settle(tab)

    return done


def embedded(frame: Any) -> str:
    """Return the page that lies compressed in a frame of another, a parsed one."""
    return zlib.decompress(base64.b64decode(frame.get("data-deflated"))).decode()


def unpacked(page: str) -> list[list[np.ndarray]]:
    """Return the tables of every chart of every figure of a page, (columns, rows)."""
    found = []
    for home in lxml.html.fromstring(page).xpath("//div[@class='charts']"):
        values = np.frombuffer(zlib.decompress(base64.b64decode(home.get("data-deflated"))), "<f4")
        charts = json.loads(home.get("data-charts"))
        curves = [
            len(one["curves"]) + 2 * sum(curve["is_banded"] for curve in one["curves"])
            for one in charts
        ]
        shapes = [
            (len(one["abscissae"]) + count, one["rows"]) for one, count in zip(charts, curves)
        ]
        ends = np.cumsum([columns * rows for columns, rows in shapes])
        found.append(
            [part.reshape(shape) for part, shape in zip(np.split(values, ends[:-1]), shapes)]
        )
        assert ends[-1] == len(values)
    return found


def visit(url: str, *steps: Step) -> Visit:
    """Open an address and take the steps."""
    seen = Visit()
    asyncio.run(seen.run(url, steps))
    return seen


@cache
def load_axe() -> str:
    """Return axe-core's script as npm has it; the test is skipped where that cannot be asked."""
    if not (npm := shutil.which("npm")):
        pytest.skip("npm is not installed")
    with tempfile.TemporaryDirectory() as folder:
        got = subprocess.run(
            [npm, "pack", "--silent", "axe-core@4.14.1"],
            cwd=folder,
            capture_output=True,
            timeout=120,
        )
        if got.returncode:
            pytest.skip("npm does not answer")
        with tarfile.open(next(Path(folder).glob("*.tgz"))) as packed:
            script = packed.extractfile("package/axe.min.js")
            assert script is not None
            return script.read().decode()


def audit(found: list[Any], *rules: str) -> Step:
    """Append what axe-core finds against the page and its frames, by these rules or by all, to a list.

    Page, rule, element and reason.
    """
    options = {"iframes": False, **({"runOnly": rules} if rules else {})}
    given = f"var axeSource = {json.dumps(load_axe())}, axeOptions = {json.dumps(options)}; 0"

    async def done(tab: Any) -> None:
        await settle(tab)
        await browser.evaluate(tab, given)
        asked = {"expression": AUDIT, "awaitPromise": True, "returnByValue": True}
        # In a frame that is left for another page it never ends.
        answer = await asyncio.wait_for(tab.send_command("Runtime.evaluate", asked), 240)
        found.extend(answer["result"]["result"]["value"])

    return done


AUDIT = """Promise.all([window, ...[...document.querySelectorAll('iframe')].filter(one => one.checkVisibility()).map(
  one => one.contentWindow)].map(shown => { shown.axe ?? shown.eval(axeSource);
    return shown.axe.run(shown.document, axeOptions).then(found => found.violations.flatMap(rule =>
      rule.nodes.map(node => [shown.document.title, rule.id, node.target.join(' '), node.failureSummary]))); }))
  .then(every => every.flat())"""

OPEN = "document.querySelectorAll('details').forEach(one => { one.open = true; })"
"""Opens all that is folded."""


def until(condition: str, seconds: float = 180.0) -> Step:
    """Wait until a script's value is true."""

    async def waited(tab: Any) -> None:
        for _ in range(round(seconds / 0.05)):
            if await browser.evaluate(tab, condition):
                return
            await asyncio.sleep(0.05)
        raise AssertionError(f"never: {condition}")

    return waited


def pause(seconds: float) -> Step:
    """Let the page draw."""

    async def waited(_: Any) -> None:
        await asyncio.sleep(seconds)

    return waited


async def settle(tab: Any) -> None:
    """Wait until the visible frames are there and what was asked of the page is drawn."""
    await until(f"!({LOADING})")(tab)
    asked = {"expression": TWO_FRAMES, "awaitPromise": True}
    await asyncio.wait_for(tab.send_command("Runtime.evaluate", asked), 60)


TWO_FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


def wide(pixels: int) -> Step:
    """Give the window a width."""

    async def sized(tab: Any) -> None:
        size = {"width": pixels, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        await tab.send_command("Emulation.setDeviceMetricsOverride", size)
        await settle(tab)

    return sized


def media(kind: str = "screen", **wishes: str) -> Step:
    """Show the page on a screen or on paper, as the reader prefers: `color_scheme="dark"`."""
    features = [
        {"name": f"prefers-{name.replace('_', '-')}", "value": wish}
        for name, wish in wishes.items()
    ]

    async def done(tab: Any) -> None:
        await tab.send_command("Emulation.setEmulatedMedia", {"media": kind, "features": features})
        await settle(tab)

    return done


def meanwhile(act: Callable[[], object]) -> Step:
    """Do something outside the page while it stays open."""

    async def done(_: Any) -> None:
        await asyncio.to_thread(act)

    return done
