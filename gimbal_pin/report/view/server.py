"""One page for browsers on this machine alone, and news for the windows that show it."""

from __future__ import annotations

import json
import secrets
import threading
from collections.abc import Sequence
from contextlib import suppress
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer

from gimbal_pin.errors import UsageError

HOME = "127.0.0.1"
BEAT = 1.0
"""Longest silence towards a window, s: writing is how it is seen that one was closed."""


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
        with suppress(ConnectionError, TimeoutError):
            super().handle()

    def do_GET(self) -> None:
        """Send the page or the news."""
        host, token = self.headers.get("Host", ""), self.server.token
        ours = host.partition(":")[0] in (HOME, "localhost")  # any port: it may be forwarded from another machine
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
        for name, value in (("Content-Type", kind), ("Cache-Control", "no-store"), ("Referrer-Policy", "no-referrer")):
            self.send_header(name, value)
        self.end_headers()

    def report(self) -> None:
        """Send the latest news whenever there are any, until the window or the server is closed."""
        server, told = self.server, ""
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
