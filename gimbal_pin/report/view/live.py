"""The rig live in a browser on this machine."""

from __future__ import annotations

import contextlib
import webbrowser

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.report.view import figure
from gimbal_pin.report.view.motion import Frames, motion, poses
from gimbal_pin.report.view.page import packed, render_scene
from gimbal_pin.report.view.scene import GHOST_ROOT, RIG_ROOT, scene
from gimbal_pin.report.view.server import Server
from gimbal_pin.rig.rig import Rig


class Live(contextlib.AbstractContextManager["Live"]):
    """A rig in a browser's window: open `url`, then `pose` it instant by instant or `play` a log.

    Only this machine is served, and there only who knows the address. The server ends with `close`, with the ``with``
    block, or with Python. Nothing here waits for a browser but `wait`, and that not for ever.
    """

    def __init__(self, rig: Rig, *, ghost: bool = False) -> None:
        """Start the server and draw the rig at q = 0, with a ghost if asked.

        Raises:
            UsageError: The server does not start.
        """
        self.rig = rig
        self._server = Server()
        zero = np.zeros((1, rig.n))
        self._show("live", Frames(np.zeros(1), zero, zero if ghost else None), room=1.5)

    @property
    def url(self) -> str:
        """Address to open in a browser on this machine; whoever has it sees the rig."""
        return self._server.url

    def pose(self, q: Array, q_ref: Array | None = None) -> None:
        """Show the joint positions q, rad or m, (n,), and those of the ghost if given."""
        for values, root in ((q, RIG_ROOT), (q_ref, GHOST_ROOT)):
            if values is not None:
                at = poses(self.rig.model, np.reshape(np.asarray(values, dtype=float), (1, self.rig.n)))
                self._posed |= {c["path"]: packed(c) for c in figure.pose_commands(self.rig, at, root)}
        self._server.tell(list(self._posed.values()))

    def play(
        self, log: Log, *, fps: float = 30, speed: float = 1.0, ghost: bool = True, colour: Array | None = None
    ) -> float:
        """Hand a log to the browser, which plays it in real time, over and over; return the seconds of one pass.

        Arguments and errors as for `record`. Returns at once; a browser that is opened later plays from the start.
        """
        shown = motion(self.rig, log, fps, speed, ghost, colour)
        self._show(log.name, shown)
        return float(shown.clock[-1])

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until a browser shows the scene.

        Raises:
            UsageError: None did within `timeout` seconds; the server is closed then.
        """
        with self._server.changed:
            seen = self._server.changed.wait_for(lambda: self._server.windows, timeout)
        if not seen:
            self.close()
            raise UsageError(
                "live view", f"no browser opened {self.url} within {timeout:g} s", "write -o out.html instead"
            )

    def close(self) -> None:
        """End the server."""
        self._server.end()

    def __exit__(self, *_: object) -> None:
        """End the server."""
        self.close()

    def _show(self, name: str, shown: Frames, room: float = 1.0) -> None:
        """Replace what is shown."""
        self._posed: dict[str, str] = {}
        drawn = scene(self.rig, shown, room)
        self._server.show(render_scene(self.rig, name, shown, drawn, live=self._server.number + 1))


def show(rig: Rig, log: Log | None = None, *, speed: float = 1.0, browser: bool = True) -> Live:
    """Show the rig live, playing the log if given, and open a browser's window on it where there is one.

    Returns at once; the window lives as long as the `Live` that is returned.

    Raises:
        UsageError: The server does not start.
        LogError: The log is empty or lacks a joint of the rig.
    """
    live = Live(rig)
    if log is not None:
        live.play(log, speed=speed)
    if browser:
        open_window(live.url)
    return live


def open_window(url: str) -> bool:
    """Open a window of the user's browser; False where there is none. Text browsers would take over the terminal."""
    try:
        found = webbrowser.get()
    except webbrowser.Error:
        return False
    waits = isinstance(found, webbrowser.GenericBrowser) and not isinstance(found, webbrowser.BackgroundBrowser)
    return not waits and found.open(url, new=2)
