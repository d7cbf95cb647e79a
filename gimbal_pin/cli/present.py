"""What a verb says: text for a person, JSON for a program."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from gimbal_pin.errors import UsageError, message, visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gimbal_pin.log.log import Log
    from gimbal_pin.rig.rig import Rig


def present(told: str, result: Mapping[str, Any], json: Path | None) -> None:
    """Print what a person reads, or write what a program reads; with ``--json -`` only the latter is printed."""
    from gimbal_pin.log.io.files import to_json, write_json

    if json is not None and str(json) == "-":
        say(to_json(result)[:-1])
        return
    say(told)
    if json is not None:
        write_json(result, json)


def say(text: str, to: TextIO | None = None) -> None:
    """Print lines at once: what a terminal would obey instead of showing, or cannot show, is written out."""
    stream = sys.stdout if to is None else to
    if stream is None:
        raise UsageError("standard output", "is closed", "open it, or send it elsewhere")
    code = getattr(stream, "encoding", None) or "utf-8"
    try:
        print(visible(text).encode(code, "backslashreplace").decode(code), file=stream, flush=True)
    except OSError as error:
        sink = os.open(
            os.devnull, os.O_WRONLY
        )  # what is still in the buffer must not fail again when Python ends
        os.dup2(sink, stream.fileno())
        os.close(sink)
        if isinstance(error, BrokenPipeError):
            raise
        raise UsageError(
            "standard output", f"cannot be written ({error.strerror})", "send it elsewhere"
        ) from error


def complain(what: str) -> None:
    """Print one short line on standard error."""
    if sys.stderr is not None:
        say(f"gimbal-pin: {message([what], [])}", sys.stderr)


def tell(notes: Sequence[str]) -> None:
    """Tell what is to be known of an input or a result, on standard error."""
    for note in notes:
        complain(f"note: {note}")


def write_figure(chart: Callable[[], Figure], output: Path | None) -> None:
    """Write a figure, if a file is named."""
    from gimbal_pin.log.io.files import open_replacement

    if output is not None:
        with open_replacement(output) as temporary:
            chart().savefig(temporary)


def check_shown(output: Path | None, live: bool) -> None:
    """Raise `UsageError` if a result would be neither written nor shown."""
    if output is None and not live:
        raise UsageError(
            "-o",
            "names no file",
            "say where to write with -o FILE, or --live to see it in a browser",
        )


def play(rig: Rig, log: Log) -> None:
    """Show a log live until the user ends it."""
    from gimbal_pin.report import view

    with view.show(rig, log) as live:
        say(f"playing at {live.url} (Ctrl-C ends it)")
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()
