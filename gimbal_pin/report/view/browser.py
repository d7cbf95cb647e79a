"""Pictures of a recorded page, taken by headless Chromium at exact instants."""

from __future__ import annotations

import asyncio
import base64
import sys
from collections.abc import AsyncIterator, Callable, MutableMapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from threading import Event
from typing import TYPE_CHECKING, Any

from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from choreographer import Tab

PATIENCE = 60.0
"""Longest wait for one answer of the browser, s."""


def take_pictures(
    page: str, times: Sequence[float], size: tuple[int, int], take: Callable[[bytes], object]
) -> None:
    """Hand the PNG of each instant of a recorded page to `take`, in order.

    `times`: seconds since the start of playing; `size`: width and height, pixels.

    Raises:
        UsageError: No Chromium, no choreographer, or a browser that does not draw.
    """
    ended = Event()
    with ThreadPoolExecutor(1) as pool:
        try:
            pool.submit(asyncio.run, shoot(page, times, size, take, ended)).result()
        finally:
            ended.set()


async def shoot(
    page: str,
    times: Sequence[float],
    size: tuple[int, int],
    take: Callable[[bytes], object],
    ended: Event,
) -> None:
    """Open the page and hand over its pictures, until `ended` is set; a progress bar counts them.

    This runs in a thread of its own: where an event loop is running already (a notebook), and because choreographer,
    if a signal breaks in, waits for ever for a browser that it no longer listens to. So the signal goes to the main
    thread, and the browser is closed in peace, with its children and its profile.
    """
    from tqdm import tqdm

    # Two million pixels to a message: while one lot is handed over, the next one is drawn.
    count = max(1, round(2e6 / (size[0] * size[1])))
    with tqdm(
        total=len(times), desc="frames", unit="frame", disable=None if len(times) > 30 else True
    ) as bar:

        async def draw(batch: Sequence[float]) -> list[str]:
            return (
                await evaluate(tab, f"pictures({list(batch)}, {size[0]}, {size[1]})")
                if batch
                else []
            )

        async def hand_over(uris: list[str]) -> None:
            for uri in uris:
                if not ended.is_set():
                    await asyncio.to_thread(take, base64.b64decode(uri.partition(",")[2]))
                    bar.update()

        async with opened(page) as tab:
            uris: list[str] = []
            for first in range(0, len(times) + count, count):
                uris, _ = await asyncio.gather(draw(times[first : first + count]), hand_over(uris))
                if ended.is_set():
                    return


@asynccontextmanager
async def opened(page: str) -> AsyncIterator[Tab]:
    """Yield a tab of a headless Chromium that shows the page."""
    try:
        from choreographer import Browser
        from choreographer.browsers import BrowserFailedError
        from choreographer.browsers.chromium import ChromeNotFoundError, Chromium
    except ImportError as error:
        raise UsageError(
            "video", "choreographer is not installed", "pip install 'gimbal-pin[video]'"
        ) from error

    class Tidy(Chromium):
        """Chromium that keeps its scratch files in its profile, which is removed however it ends."""

        def get_env(self) -> MutableMapping[str, str]:
            return {**super().get_env(), "TMPDIR": str(self.tmp_dir.path)}

    mend = "apt install chromium (or Chrome), or write .html, which needs no browser"
    try:
        # elsewhere a temporary folder's path leaves no room for a socket's, 104 letters with the scratch folder in it
        browser = Browser(browser_cls=Tidy if sys.platform == "linux" else Chromium, headless=True)
    except ChromeNotFoundError as error:
        raise UsageError("chromium", "is not installed", mend) from error
    try:
        async with browser:
            tab = await browser.create_tab("about:blank")
            tree = await tab.send_command("Page.getFrameTree")
            frame = tree["result"]["frameTree"]["frame"]["id"]
            await tab.send_command("Page.setDocumentContent", {"frameId": frame, "html": page})
            yield tab
    except BrowserFailedError as error:
        raise UsageError("chromium", f"did not start ({error.args[0]})", mend) from error


async def evaluate(tab: Tab, expression: str) -> Any:
    """Return the value of a script expression in the page."""
    asked = tab.send_command("Runtime.evaluate", {"expression": expression, "returnByValue": True})
    try:
        answer = (await asyncio.wait_for(asked, PATIENCE)).get("result", {})
    except asyncio.TimeoutError as error:
        raise UsageError(
            "chromium", f"gave no answer for {PATIENCE:.0f} s", "try a smaller picture, or .html"
        ) from error
    if "exceptionDetails" in answer:
        reason = (
            answer["exceptionDetails"]
            .get("exception", {})
            .get("description", "an error without a text")
        )
        raise UsageError(
            "chromium",
            f"cannot draw the scene: {reason.splitlines()[0]}",
            "enable WebGL, or write .html",
        )
    return answer["result"].get("value")
