"""``gimbal-pin VERB``: every verb is one library call, printed for a person or written as JSON."""

from __future__ import annotations

import contextlib
import functools
import io
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from inspect import getdoc, signature
from typing import Any

import tyro

from gimbal_pin.cli import paths
from gimbal_pin.cli.present import complain, say
from gimbal_pin.errors import GimbalPinError, UsageError

AGAIN = 0.2
"""Time after which a signal is heard that a library has swallowed, s."""
VERBS: Mapping[str, Callable[..., None]] = {
    name.replace("_", "-"): getattr(import_module(f"gimbal_pin.cli.{name}"), name)
    for name in (
        *("inspect", "rigs", "new_rig", "check", "base", "excite", "simulate", "rehearse", "identify", "diagnose"),
        *("tune", "track", "export", "animate", "auto", "studio", "montecarlo", "fleet", "demo"),
    )
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the verb that the arguments name, and leave with its exit code."""
    os.environ["MPLBACKEND"] = "agg"  # no verb opens a window of Matplotlib's, whatever a notebook or shell asks for
    try:
        with ending_orderly():
            parse_arguments(sys.argv[1:] if arguments is None else arguments)()
    except GimbalPinError as error:
        complain(str(error))
        raise SystemExit(error.exit_code) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except BrokenPipeError:
        raise SystemExit(0) from None
    except OSError as error:  # a path that the system refuses to look up: its name is too long, or links in a circle
        if error.filename is None:
            raise
        complain(f"{error.filename}: cannot be used ({error.strerror}); give another path")
        raise SystemExit(2) from None


@contextlib.contextmanager
def ending_orderly() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end the program as an error does: temporary files go, servers end; status 128 + signal.

    A signal that is ignored (``nohup``) stays so. Other threads than the first may not say what a signal does.
    Libraries that are being loaded catch whatever is raised in them, and raise what they like: so it is raised again
    every `AGAIN` until it is on its way, and however the program ends then, the signal has ended it.
    """
    told: list[int] = []

    def leave(number: int, frame: object) -> None:
        told.append(number)
        signal.signal(signal.SIGALRM, lambda *_: leave(number, frame))
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        if not isinstance(sys.exc_info()[1], SystemExit):
            raise SystemExit(128 + number)

    first = threading.current_thread() is threading.main_thread()
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP) if first}
    before = {number: handler for number, handler in before.items() if handler is signal.SIG_DFL}
    for number in before:
        signal.signal(number, leave)
    try:
        yield
    except BaseException:
        if told:
            raise SystemExit(128 + told[0]) from None
        raise
    finally:
        if told:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


def parse_arguments(arguments: Sequence[str]) -> Callable[[], None]:
    """Return the call that the arguments spell; a usage error is one line on standard error and exit code 2."""
    if not arguments or arguments[0] in ("-h", "--help"):
        return functools.partial(say, list_verbs())
    if any("\0" in word for word in arguments):  # no shell passes one on, and no system call takes it
        raise UsageError("arguments", "hold a NUL character", "leave it out")
    name, *rest = arguments
    if name not in VERBS:
        raise UsageError(name, "no such verb", f"the verbs are {', '.join(VERBS)}")
    told, wrong = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(wrong):
            return tyro.cli(deferred(VERBS[name]), prog=f"gimbal-pin {name}", args=rest)
    except SystemExit as stop:
        if stop.code == 2:
            complain(one_line(wrong.getvalue()))
        else:
            say(told.getvalue().rstrip())
        raise


def list_verbs() -> str:
    """Name every verb with the first sentence of its docstring: quick, since no verb's arguments are looked at."""
    lines = [f"  {name:<11}{(getdoc(verb) or '').splitlines()[0]}" for name, verb in VERBS.items()]
    return "\n".join([(__doc__ or "").replace("``", ""), "", "usage: gimbal-pin VERB [-h]", "", *lines])


def deferred(verb: Callable[..., None]) -> Callable[..., Callable[[], None]]:
    """Return the verb as a function that keeps its arguments for later: parsing ends before the work begins.

    In between it is checked that no file is read and written at once.
    """

    @functools.wraps(verb)
    def keep(*args: Any, **kwargs: Any) -> Callable[[], None]:
        paths.check_outputs(verb, signature(verb).bind(*args, **kwargs).arguments)
        return functools.partial(verb, *args, **kwargs)

    return keep


def one_line(message: str) -> str:
    """Fold the parser's message, a heading over what says the same and more, into one line."""
    lines = [line for line in (re.sub(r"[─-]{4,}|[─│╭╮╰╯]", "", line).strip() for line in message.splitlines()) if line]
    return "; ".join(lines[1:] or lines).replace(":; ", ": ")
