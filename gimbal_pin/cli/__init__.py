"""``gimbal-pin VERB``: every verb is one library call, printed for a person or written as JSON."""

from __future__ import annotations

import contextlib
import errno
import functools
import io
import os
import re
import resource
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

LEAST_OPEN_FILES = 20
"""Open files that POSIX grants every process (``_POSIX_OPEN_MAX``). Event loops and pipes of workers take up to ten;
twice as many would refuse shells that POSIX allows."""
LEAST_ADDRESS_SPACE = 1 << 30
"""Address space of `identify` on a bundled rig, B, as measured on two cores. With half of it imports fail and OpenBLAS
waits for memory without end; twice as much would refuse small machines that can do the work."""
NO_MEMORY = ("failed to map segment", "cannot allocate memory", "can't start new thread")
"""Messages of the dynamic loader and of Python's threads where no memory is left."""
VERBS: Mapping[str, Callable[..., None]] = {
    name.replace("_", "-"): getattr(import_module(f"gimbal_pin.cli.{name}"), name)
    for name in (
        *(
            "inspect",
            "rigs",
            "new_rig",
            "check",
            "base",
            "excite",
            "simulate",
            "rehearse",
            "identify",
            "diagnose",
        ),
        *("tune", "track", "export", "animate", "auto", "studio", "montecarlo", "fleet", "demo"),
    )
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the verb that the arguments name, and leave with its exit code."""
    os.environ["MPLBACKEND"] = (
        "agg"  # no verb opens a window of Matplotlib's, whatever a notebook or shell asks for
    )
    try:
        check_limits()
        with exit_on_signals():
            parse_arguments(sys.argv[1:] if arguments is None else arguments)()
    except GimbalPinError as error:
        complain(str(error))
        raise SystemExit(error.exit_code) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except BrokenPipeError:
        raise SystemExit(0) from None
    except (OSError, MemoryError, ImportError, AttributeError, RuntimeError) as error:
        if (said := describe_exhaustion(error)) is None:
            raise
        complain(said)
        raise SystemExit(2) from None


def check_limits() -> None:
    """Raise `UsageError` where a limit of this process is below what the libraries need."""
    for kind, command, least, unit in (
        (resource.RLIMIT_NOFILE, "ulimit -n", LEAST_OPEN_FILES, "open files"),
        (resource.RLIMIT_AS, "ulimit -v", LEAST_ADDRESS_SPACE, "bytes of address space"),
    ):
        limit, _ = resource.getrlimit(kind)
        if limit != resource.RLIM_INFINITY and limit < least:
            raise UsageError(command, f"allows {limit} {unit}", f"allow at least {least}")


def describe_exhaustion(error: Exception) -> str | None:
    """Return a line on what the system lacks or refuses, or None for a defect of this package."""
    cause: BaseException | None = error
    while cause is not None:
        number = getattr(cause, "errno", None)
        said = str(cause).lower()
        if number in (errno.EMFILE, errno.ENFILE):
            return "open files: as many as the limit allows are open; raise it (ulimit -n)"
        if (
            isinstance(cause, MemoryError)
            or number == errno.ENOMEM
            or any(words in said for words in NO_MEMORY)
        ):
            return "memory: is used up; free some, raise the limit (ulimit -v), or ask for less"
        cause = cause.__cause__ or cause.__context__
    if isinstance(error, FileNotFoundError) and not is_in_folder():
        return "working folder: does not exist any longer; change to another folder"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: cannot be used ({error.strerror}); give another path"
    return None


def is_in_folder() -> bool:
    """Tell whether the working folder exists."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


@contextlib.contextmanager
def exit_on_signals() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into `SystemExit` with status 128 + signal, so that temporary files are removed.

    A signal that is ignored (``nohup``) stays so, and only the main thread may set handlers.
    """

    def leave(number: int, frame: object) -> None:
        raise SystemExit(128 + number)

    is_main = threading.current_thread() is threading.main_thread()
    signals = (signal.SIGTERM, signal.SIGHUP) if is_main else ()
    ours = [number for number in signals if signal.getsignal(number) is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, leave)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def parse_arguments(arguments: Sequence[str]) -> Callable[[], None]:
    """Return the call that the arguments spell; a usage error is one line on standard error and exit code 2."""
    if not arguments or arguments[0] in ("-h", "--help"):
        return functools.partial(say, list_verbs())
    if any(
        "\0" in word for word in arguments
    ):  # no shell passes one on, and no system call takes it
        raise UsageError("arguments", "hold a NUL character", "leave it out")
    name, *rest = arguments
    if name not in VERBS:
        raise UsageError(name, "no such verb", f"the verbs are {', '.join(VERBS)}")
    told = io.StringIO()
    wrong = io.StringIO()
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
    return "\n".join(
        [(__doc__ or "").replace("``", ""), "", "usage: gimbal-pin VERB [-h]", "", *lines]
    )


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
    lines = [
        line
        for line in (
            re.sub(r"[─-]{4,}|[─│╭╮╰╯]", "", line).strip() for line in message.splitlines()
        )
        if line
    ]
    return "; ".join(lines[1:] or lines).replace(":; ", ": ")
