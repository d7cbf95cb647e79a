"""The studio's server: this machine alone, and there only who has the address."""

from __future__ import annotations

import contextlib
import logging
import secrets
import socket
from collections.abc import Callable
from html import escape
from importlib.util import find_spec
from typing import Any

from gimbal_pin.errors import GimbalPinError, UsageError, message
from gimbal_pin.report.view.live import HOME
from gimbal_pin.studio.desk import Desk


class Gate:
    """An ASGI application before another: only requests below the token, addressed to this machine, come through.

    A name that another's DNS gives this machine (rebinding) is refused, and so are WebSockets of other pages.

    Attributes:
        app: The application behind it.
        token: First part of every path.
    """

    def __init__(self, app: Any, token: str) -> None:
        """Guard `app`."""
        self.app, self.token = app, token

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass a request on, or answer 403."""
        if scope["type"] == "lifespan" or self._is_ours(scope):
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send(
                {"type": "websocket.close", "code": 1008}
            )  # before it was accepted: HTTP 403
        else:
            await send(
                {
                    "type": "http.response.start",
                    "status": 403,
                    "headers": [(b"content-type", b"text/plain")],
                }
            )
            await send(
                {
                    "type": "http.response.body",
                    "body": b"403: open the address that gimbal-pin studio printed",
                }
            )

    def _is_ours(self, scope: Any) -> bool:
        """Whether a request knows the token and comes from this machine's own page."""
        headers = dict(scope["headers"])
        host = headers.get(b"host", b"").decode("latin-1")
        origin = headers.get(b"origin", f"http://{host}".encode()).decode("latin-1")
        first = scope["path"].split("/")[1]
        knows = secrets.compare_digest(first.encode(), self.token.encode())
        return (
            knows and host.partition(":")[0] in (HOME, "localhost") and origin == f"http://{host}"
        )


class OneLineFormatter(logging.Formatter):
    """Format of a server's records as one line: an event that a page never sends needs no traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        error = record.exc_info[1] if record.exc_info else None
        what = record.getMessage() if error is None else f"{type(error).__name__}: {error}"
        return f"gimbal-pin: studio: {message([what], [])}"


def log_in_one_line() -> None:
    """Let the server's libraries write each of their records to standard error as one line."""
    handler = logging.StreamHandler()
    handler.setFormatter(OneLineFormatter())
    for name in ("nicegui", "asyncio", "socketio", "engineio"):
        logger = logging.getLogger(name)
        logger.handlers = [handler]
        logger.propagate = False


def check_nicegui() -> None:
    """Raise `UsageError` where NiceGUI, which the page is made with, is missing."""
    if find_spec("nicegui") is None:
        raise UsageError("studio", "NiceGUI is not installed", "pip install 'gimbal-pin[studio]'")


def serve_desk(desk: Desk, announce: Callable[[str], object]) -> None:
    """Serve the page of a desk until the process is told to end.

    Args:
        desk: What the page shows.
        announce: Is told the address before the first request is answered.

    Raises:
        UsageError: NiceGUI is missing, or no port can be had.
    """
    check_nicegui()
    import uvicorn
    from fastapi import FastAPI
    from fastapi.responses import HTMLResponse
    from nicegui import ui

    from gimbal_pin.studio.page import open_window

    token = secrets.token_urlsafe()
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    def draw_scene(payload: str | None = None) -> HTMLResponse:
        """Answer with the scene, or 404 for a payload that cannot be mounted."""
        try:
            return HTMLResponse(desk.draw_scene(payload))
        except GimbalPinError as error:
            return HTMLResponse(escape(str(error)), status_code=404)

    app.get(f"/{token}/scene", response_class=HTMLResponse)(draw_scene)
    ui.run_with(
        app,
        root=lambda: open_window(desk),
        title=f"{desk.source.rig.name} – gimbal-pin studio",
        mount_path=f"/{token}",
        language="en-US",
        dark=None,
        tailwind=False,
        reconnect_timeout=30.0,
        show_welcome_message=False,
    )
    log_in_one_line()
    try:
        door = socket.create_server((HOME, 0))
    except OSError as error:
        raise UsageError(
            "studio", f"no port on {HOME} ({error.strerror})", "end a program that holds ports"
        ) from error
    config = uvicorn.Config(
        Gate(app, token), log_level="error", timeout_graceful_shutdown=1, server_header=False
    )
    with door, contextlib.suppress(KeyboardInterrupt):
        announce(f"http://{HOME}:{door.getsockname()[1]}/{token}/")
        uvicorn.Server(config).run(sockets=[door])
