"""The rig live in a browser, through meshcat's server."""

from __future__ import annotations

import contextlib
import io
import webbrowser
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array, Log
from gimbal_pin.rig import Rig
from gimbal_pin.view import figure, three
from gimbal_pin.view.motion import Frames, motion, poses
from gimbal_pin.view.scene import GHOST, MOTION, RIG, Scene, scene

if TYPE_CHECKING:
    from meshcat.visualizer import ViewerWindow

PATIENCE = 5.0
"""Longest wait for an answer of the server on this machine, s."""


class Live(contextlib.AbstractContextManager["Live"]):
    """A rig in a browser's window: open `url`, then `pose` it instant by instant or `play` a log.

    The server is a process of its own on this machine and ends with `close`, with the ``with`` block, or with Python.
    Nothing here waits for a browser but `wait`, and that not for ever.
    """

    def __init__(self, rig: Rig, *, ghost: bool = False) -> None:
        """Start the server and draw the rig at q = 0, with a ghost if asked.

        Raises:
            UsageError: The server does not start.
        """
        self.rig = rig
        self._window = start()
        zero = np.zeros((1, rig.n))
        self._draw(scene(rig, Frames(np.zeros(1), zero, zero if ghost else None), room=1.5))

    @property
    def url(self) -> str:
        """Address to open in a browser on this machine."""
        return str(self._window.web_url)

    def pose(self, q: Array, q_ref: Array | None = None) -> None:
        """Show the joint positions q, rad or m, (n,), and those of the ghost if given."""
        for values, root in ((q, RIG), (q_ref, GHOST)):
            if values is not None:
                at = poses(self.rig.model, np.reshape(np.asarray(values, dtype=float), (1, self.rig.n)))
                for command in figure.pose_commands(self.rig, at, root):
                    self._send(command)

    def play(
        self, log: Log, *, fps: float = 30, speed: float = 1.0, ghost: bool = True, colour: Array | None = None
    ) -> float:
        """Hand a log to the browser, which plays it in real time, over and over; return the seconds of one pass.

        Arguments and errors as for `record`. Returns at once; a browser that is opened later plays from the start.
        """
        shown = motion(self.rig, log, fps, speed, ghost, colour)
        self._draw(scene(self.rig, shown))
        return float(shown.clock[-1])

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until a browser shows the scene.

        Raises:
            UsageError: None did within `timeout` seconds; the server is closed then.
        """
        self._window.zmq_socket.send(b"wait")
        if not self._window.zmq_socket.poll(1000 * timeout):
            url = self.url
            self.close()
            raise UsageError("live view", f"no browser opened {url} within {timeout:g} s", "write -o out.html instead")
        self._window.zmq_socket.recv()
        self._window.zmq_socket.close(0)
        self._window.connect_zmq()  # after an answer of this kind meshcat's server hears only a new connection

    def close(self) -> None:
        """End the server."""
        self._window.zmq_socket.close(0)
        self._window.server_proc.kill()
        self._window.server_proc.communicate()

    def __exit__(self, *_: object) -> None:
        """End the server."""
        self.close()

    def _draw(self, drawn: Scene) -> None:
        """Replace what is shown."""
        for path in ("/meshcat", MOTION):
            self._send({"type": "delete", "path": path})
        for command in drawn.commands if drawn.animation is None else (*drawn.commands, drawn.animation):
            self._send(command)

    def _send(self, command: three.Json) -> None:
        """Send one command and take the server's receipt."""
        import umsgpack

        socket = self._window.zmq_socket
        socket.send_multipart([command["type"].encode(), command["path"].encode(), umsgpack.packb(command)])
        if not socket.poll(1000 * PATIENCE):
            raise UsageError("live view", "the server does not answer any more", "start it again, or write -o out.html")
        socket.recv()


def start() -> ViewerWindow:
    """Return a connection to a new server; what meshcat prints about it is kept back."""
    from meshcat.visualizer import ViewerWindow

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said):
            return ViewerWindow(zmq_url=None, start_server=True, server_args=[])
    except RuntimeError as error:
        raise UsageError("live view", f"{error} ({said.getvalue().strip()})", "write -o out.html instead") from error


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
