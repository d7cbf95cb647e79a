"""A call of the command line in this process, with all that it writes: also what C++ puts on the descriptors."""

from __future__ import annotations

import ctypes
import faulthandler
import hashlib
import os
import resource
import shutil
import signal
import socket
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fuzzing.case import PORT, Case

MEMORY = 4 << 30
"""Address space a call may take beyond what is loaded, B: half of what CI's machine has."""
DIES_WITH_PARENT = 1
"""`PR_SET_PDEATHSIG` of Linux's prctl: a signal when the parent ends, however that was."""
FILE = 256 << 20
"""Largest file, B: forty times the largest page that a valid input leads to."""


@dataclass(frozen=True)
class Ran:
    """What came of a call.

    Attributes:
        code: Exit code; None where an exception came out.
        out: Standard output.
        err: Standard error.
        seconds: How long it took, s of this process.
        trace: The exception that came out, with its traceback, as lines.
        changed: Inputs that are no longer what they were.
        left: Name → content of every file that was not there before, or is another now.
        error: Type of the exception.
        frame: Innermost place of the package in it.
        memory: What this process took at its most beyond what it had, B.
    """

    code: int | None
    out: bytes
    err: bytes
    seconds: float
    trace: str
    changed: tuple[str, ...]
    left: Mapping[str, bytes]
    error: str = ""
    frame: str = ""
    memory: int = 0


def ran(main: Callable[[Sequence[str]], None], case: Case, folder: Path) -> Ran:
    """Run a case in an empty folder, which holds its files afterwards."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    case.write(folder)
    before = digests(folder)
    home = Path.cwd()
    os.chdir(folder)
    code: int | None = 0
    trace = error = frame = ""
    start, had = time.perf_counter(), peak()
    try:
        with (
            captured(folder.parent) as streams,
            piped(case.piped),
            written(folder, case.pipes),
            answering(case.datagrams) as port,
            warnings.catch_warnings(),
        ):
            try:
                main([word.replace(PORT, PORT.replace("PORT", str(port))) for word in case.words])
            except SystemExit as stop:
                code = stop.code if isinstance(stop.code, int) else 0 if stop.code is None else 1
            except BaseException as wrong:  # noqa: BLE001  # that nothing comes out is what is tested
                code, error, frame, trace = None, type(wrong).__name__, place(wrong), told(wrong)
            seconds = time.perf_counter() - start
    finally:
        os.chdir(home)
    taken = peak() - had
    after = digests(folder)
    changed = tuple(name for name in case.inputs if after.get(name) != before[name])
    new = [name for name in after if name not in case.inputs and after[name] != before.get(name)]
    left = {name: (folder / name).read_bytes() for name in new}
    left |= {name: b"" for name in case.old if name not in after}
    return Ran(code, streams["out"], streams["err"], seconds, trace, changed, left, error, frame, taken)


def digests(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file below a folder; a folder that is empty counts, too."""
    paths = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def peak() -> int:
    """Return the most memory that this process had since this was asked last, B."""
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


def place(error: BaseException) -> str:
    """Return ``file:function`` of the innermost frame that is the package's."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/gimbal_pin/" in frame.filename]
    return f"{own[-1].filename.rpartition('/gimbal_pin/')[2]}:{own[-1].name}" if own else "?"


def told(error: BaseException) -> str:
    """Return the traceback, shortened where it repeats itself."""
    return "".join(traceback.format_exception(error, limit=-30))[-8000:]


@contextmanager
def captured(folder: Path) -> Iterator[dict[str, bytes]]:
    """Send descriptors 1 and 2, and Python's streams, to files; these fill what is yielded when the block ends."""
    streams: dict[str, bytes] = {}
    flush()
    usual = sys.stdout, sys.stderr
    kept = {number: os.dup(number) for number in (1, 2)}
    names = {1: "out", 2: "err"}
    try:
        for number, name in names.items():
            file = os.open(folder / f".{name}{os.getpid()}", os.O_CREAT | os.O_TRUNC | os.O_RDWR | os.O_APPEND)
            os.dup2(file, number)
            os.close(file)
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", 1, encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
        yield streams
    finally:
        flush()
        sys.stdout, sys.stderr = usual
        for number, name in names.items():
            os.dup2(kept[number], number)
            os.close(kept[number])
            path = folder / f".{name}{os.getpid()}"
            with path.open("rb") as stream:
                streams[name] = stream.read(4 << 20)
            path.unlink()


def flush() -> None:
    """Empty Python's and C's buffers."""
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)


@contextmanager
def piped(content: bytes | None) -> Iterator[None]:
    """Put a pipe with this content, or nothing, on descriptor 0."""
    kept, writer, usual = os.dup(0), None, sys.stdin
    if content is None:
        source = os.open(os.devnull, os.O_RDONLY)
    else:
        source, sink = os.pipe()
        writer = threading.Thread(target=fed, args=(sink, content), daemon=True)
    os.dup2(source, 0)
    os.close(source)
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    if writer is not None:
        writer.start()
    try:
        yield
    finally:
        sys.stdin = usual
        os.dup2(kept, 0)  # closes the pipe's last reading end: a writer that waits ends with an error
        os.close(kept)
        if writer is not None:
            writer.join()


def fed(sink: int, content: bytes) -> None:
    """Write all of it into a pipe, unless nobody reads any longer."""
    try:
        with os.fdopen(sink, "wb") as file:
            file.write(content)
    except BrokenPipeError:
        pass


@contextmanager
def written(folder: Path, pipes: Mapping[str, bytes | None]) -> Iterator[None]:
    """Write into named pipes, a tenth of the content at a time, until nobody reads any longer."""
    done = threading.Event()

    def fill(path: Path, content: bytes) -> None:
        pipe = os.open(path, os.O_RDWR | os.O_NONBLOCK)  # one that only writes would wait for a reader
        try:
            step = len(content) // 10 + 1
            while content and not done.wait(0.01):
                with suppress(BlockingIOError):
                    content = content[os.write(pipe, content[:step]) :]
        finally:
            os.close(pipe)

    waiting = [(folder / name, content) for name, content in pipes.items() if content is not None]
    with background(done, *(partial(fill, *one) for one in waiting)):
        yield


@contextmanager
def answering(datagrams: Sequence[bytes]) -> Iterator[int]:
    """Send datagrams to the first that greets a port, which is yielded; 0 where there are none."""
    if not datagrams:
        yield 0
        return
    done = threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gimbal:
        gimbal.bind(("127.0.0.1", 0))
        gimbal.settimeout(0.05)

        def serve() -> None:
            host = None
            while host is None and not done.is_set():
                with suppress(TimeoutError):
                    host = gimbal.recvfrom(65536)[1]
            for datagram in datagrams:
                if done.wait(0.002):
                    break
                gimbal.sendto(datagram, host)

        with background(done, serve):
            yield int(gimbal.getsockname()[1])


@contextmanager
def background(done: threading.Event, *works: Callable[[], None]) -> Iterator[None]:
    """Do works in threads until they, or the block, end."""
    threads = [threading.Thread(target=work, daemon=True) for work in works]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        done.set()
        for thread in threads:
            thread.join()


def bounded() -> None:
    """Bound memory and files of this process, so that a case that asks for all of them harms nobody, and its life."""
    ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
    with open("/proc/self/statm", encoding="ascii") as file:
        loaded = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (loaded + MEMORY, loaded + MEMORY))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE, FILE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


@contextmanager
def watched(seconds: float, waiting: float, trace: Path) -> Iterator[None]:
    """End this process after so many seconds of work, or of waiting; where it stood then is written to `trace`.

    Both work inside C++, where no handler of Python would be called.
    """
    with trace.open("w", encoding="utf-8") as file:
        faulthandler.enable(file, all_threads=False)
        faulthandler.register(signal.SIGPROF, file, all_threads=False, chain=True)
        faulthandler.dump_traceback_later(waiting, exit=True, file=file)
        signal.setitimer(signal.ITIMER_PROF, seconds)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            faulthandler.cancel_dump_traceback_later()
            faulthandler.unregister(signal.SIGPROF)
            faulthandler.disable()
