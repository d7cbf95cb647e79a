"""The rig live in a browser on this machine: one page for it alone, and news for the windows that show it."""

from __future__ import annotations

import contextlib
import json
import secrets
import threading
import webbrowser
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.report.view import figure
from gimbal_pin.report.view.motion import Frames, motion, poses
from gimbal_pin.report.view.scene import GHOST_ROOT, RIG_ROOT, packed, render_scene, scene
from gimbal_pin.rig.rig import Rig

HOME = "127.0.0.1"
BEAT = 1.0
"""Longest silence towards a window, s: writing is how it is seen that one was closed."""


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
                at = poses(
                    self.rig.model, np.reshape(np.asarray(values, dtype=float), (1, self.rig.n))
                )
                self._posed |= {
                    c["path"]: packed(c) for c in figure.pose_commands(self.rig, at, root)
                }
        self._server.tell(list(self._posed.values()))

    def play(self, log: Log, *, fps: float = 30, speed: float = 1.0, ghost: bool = True) -> float:
        """Hand a log to the browser, which plays it in real time, over and over; return the seconds of one pass.

        Arguments and errors as for `record`. Returns at once; a browser that is opened later plays from the start.
        """
        shown = motion(self.rig, log, fps, speed, ghost)
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
                "live view",
                f"no browser opened {self.url} within {timeout:g} s",
                "write -o out.html instead",
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
    waits = isinstance(found, webbrowser.GenericBrowser) and not isinstance(
        found, webbrowser.BackgroundBrowser
    )
    return not waits and found.open(url, new=2)


# -- its server --------------------------------------------------------------------------------------------------------


class Server(ThreadingTCPServer):
    """Serves ``url`` from daemon threads of this process: no child, so that nothing is left when it ends, however.

    Heard are only requests that know the token in the address, are addressed to this machine by a name that no
    other's DNS can give it (rebinding), and come from no other page (``Origin``). News are Server-Sent Events: unlike
    WebSockets, browsers keep them from pages of other origins.

    Raises:
        UsageError: No port can be had on 127.0.0.1.
    """

    daemon_threads = True

    def __init__(self) -> None:
        self.changed = threading.Condition()  # with the lock that may be taken twice by one thread
        self.page, self.number, self.news, self.windows, self.running = "", 0, "", 0, True
        try:
            super().__init__((HOME, 0), Handler)
        except OSError as error:
            raise UsageError(
                "live view", f"no port on {HOME} ({error.strerror})", "write -o out.html instead"
            ) from error
        self.token = secrets.token_urlsafe()
        self.url = f"http://{HOME}:{self.server_address[1]}/{self.token}/"
        threading.Thread(target=self.serve_forever, args=(0.1,), daemon=True).start()

    def show(self, page: str) -> None:
        """Replace the page, in open windows, too; it must know its number, one more than `number` was."""
        with self.changed:
            self.page, self.number = page, self.number + 1
            self.tell([])

    def tell(self, commands: Sequence[str]) -> None:
        """Send what has changed since the page was made to all windows, and to each that is opened later."""
        with self.changed:
            self.news = json.dumps({"page": self.number, "commands": commands})
            self.changed.notify_all()

    def end(self) -> None:
        """Close the port and the connections."""
        with self.changed:
            self.running = False
            self.changed.notify_all()
        self.shutdown()
        self.server_close()


class Handler(BaseHTTPRequestHandler):
    """Answers one window."""

    server: Server
    timeout = 10.0
    """Longest wait for a request or for a window to take what it is sent, s."""

    def handle(self) -> None:
        """Answer; a window that goes away is no error."""
        with contextlib.suppress(ConnectionError, TimeoutError):
            super().handle()

    def do_GET(self) -> None:
        """Send the page or the news."""
        host = self.headers.get("Host", "")
        token = self.server.token
        ours = host.partition(":")[0] in (
            HOME,
            "localhost",
        )  # any port: it may be forwarded from another machine
        if not ours or self.headers.get("Origin", f"http://{host}") != f"http://{host}":
            self.send_error(403)
        elif self.path == f"/{token}/":
            self.begin("text/html; charset=utf-8")
            self.wfile.write(self.server.page.encode())
        elif self.path == f"/{token}/news":
            self.begin("text/event-stream")
            self.report()
        else:
            self.send_error(404)

    def begin(self, kind: str) -> None:
        """Send the headers; the address, which is the key, is passed on to no one."""
        self.send_response(200)
        for name, value in (
            ("Content-Type", kind),
            ("Cache-Control", "no-store"),
            ("Referrer-Policy", "no-referrer"),
        ):
            self.send_header(name, value)
        self.end_headers()

    def report(self) -> None:
        """Send the latest news whenever there are any, until the window or the server is closed."""
        server = self.server
        told = ""
        with server.changed:
            server.windows += 1
            server.changed.notify_all()
        try:
            while server.running:
                news = server.news
                self.wfile.write(b":\n\n" if news is told else f"data: {news}\n\n".encode())
                with server.changed:
                    told = news
                    if server.running and server.news is told:
                        server.changed.wait(BEAT)
        finally:
            with server.changed:
                server.windows -= 1

    def log_message(self, *_: object) -> None:
        """Keep requests off the terminal."""
