"""Cases over processes that may die: one that hangs, or asks for all the memory, is replaced."""

from __future__ import annotations

import gc
import multiprocessing
import os
import re
import shutil
import signal
import sys
import traceback
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from fuzzing.case import Case, Place
from fuzzing.laws import SECONDS, WAITING, Failure, failures
from fuzzing.running import bounded, ran, watched

Draw = Callable[[Place], Case]
Main = Callable[[Sequence[str]], None]
FORK = multiprocessing.get_context("fork")
"""A process that is replaced has all that is imported at once."""


@dataclass(frozen=True)
class Result:
    """What came of one case."""

    place: Place
    code: int | None
    seconds: float
    failures: tuple[Failure, ...]

    def to_dict(self) -> dict[str, Any]:
        """As one line of the record."""
        return {
            "case": str(self.place),
            "code": self.code,
            "seconds": round(self.seconds, 4),
            "failures": [failure.to_dict() for failure in self.failures],
        }

    @staticmethod
    def read(line: dict[str, Any], seed: int) -> Result:
        """Return it from a line of the record."""
        reader, _, number = line["case"].partition(":")
        found = tuple(Failure(**failure) for failure in line["failures"])
        return Result(Place(seed, reader, int(number)), line["code"], line["seconds"], found)


@dataclass(eq=False)
class Worker:
    """A process, what it works on, and where."""

    process: Any
    pipe: Connection
    folder: Path
    at: Place | None = None

    @staticmethod
    def start(draw: Draw, main: Main, folder: Path) -> Worker:
        """Fork one."""
        folder.mkdir(parents=True, exist_ok=True)
        here, there = FORK.Pipe()
        process = FORK.Process(target=serve, args=(there, draw, main, folder), daemon=False)
        process.start()
        there.close()
        return Worker(process, here, folder)

    def ask(self, place: Place | None) -> None:
        """Give it a case; None ends it."""
        self.at = place
        self.pipe.send(place)

    def answer(self) -> Result:
        """Return its result; if it has died, why."""
        assert self.at is not None
        try:
            return self.pipe.recv()
        except (EOFError, ConnectionResetError):
            self.process.join()
            return Result(self.at, None, SECONDS, (self.death(),))

    def death(self) -> Failure:
        """Say what it died of."""
        file = self.folder / ".trace"
        trace = file.read_text(encoding="utf-8", errors="replace") if file.exists() else ""
        place = re.search(r'/gimbal_pin/([^"]*)".* in (.*)', trace)  # the innermost stands first
        frame = ":".join(place.groups()) if place is not None else "?"
        code = self.process.exitcode
        if code in (-signal.SIGPROF, 1) and ("Timeout" in trace or code == -signal.SIGPROF):
            return Failure("slow", f"over {SECONDS:g} s in {frame}", trace)
        return Failure("died", f"signal or exit {code} in {frame}", trace)


def serve(pipe: Connection, draw: Draw, main: Main, folder: Path) -> None:
    """Work on cases until the parent says it is enough."""
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    gc.freeze()
    bounded()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while (place := pipe.recv()) is not None:
        pipe.send(judged(draw, main, place, folder))
    shutil.rmtree(folder, ignore_errors=True)


def judged(draw: Draw, main: Main, place: Place, folder: Path) -> Result:
    """Run one case in a folder, and the plain one it is like, and hold it against the laws."""
    case, home, runs = draw(place), folder / str(place).replace(":", "-"), []
    for one in (case, case.plain) if case.plain is not None else (case,):
        with watched(SECONDS, WAITING, folder / ".trace"):
            runs.append(ran(main, one, home))
        shutil.rmtree(home, ignore_errors=True)
    return Result(place, runs[0].code, sum(run.seconds for run in runs), tuple(failures(runs[0], case.code, *runs[1:])))


def results(places: Iterator[Place], draw: Draw, main: Main, workers: int, folder: Path) -> Iterator[Result]:
    """Yield what comes of each case, in the order in which they end."""
    pool: list[Worker] = []
    try:
        for number in range(workers):
            place = next(places, None)
            if place is not None:
                pool.append(Worker.start(draw, main, folder / f"worker{number}"))
                pool[-1].ask(place)
        while busy := [worker for worker in pool if worker.at is not None]:
            ready = wait([worker.pipe for worker in busy])
            for worker in (worker for worker in busy if worker.pipe in ready):
                yield worker.answer()
                if not worker.process.is_alive():
                    pool[pool.index(worker)] = worker = Worker.start(draw, main, worker.folder)
                place = next(places, None)
                worker.at = None
                worker.ask(place)
    finally:
        for worker in pool:
            if worker.at is not None:
                worker.process.kill()
            worker.process.join()


def shared(places: Iterable[Place], spent: Mapping[str, float]) -> Iterator[Place]:
    """Yield cases, always one of the reader that has had the least time; `spent`, s, grows while they are run."""
    left, given = defaultdict[str, deque[Place]](deque), Counter[str]()
    for place in places:
        left[place.reader].append(place)
    while left:
        reader = min(left, key=lambda name: (spent[name], given[name]))
        given[reader] += 1
        place = left[reader].popleft()
        if not left[reader]:
            del left[reader]
        yield place


def alone(work: Callable[[], None]) -> None:
    """Run something in a process of its own; RuntimeError if it fails."""

    def guarded() -> None:
        try:
            work()
        except Exception:  # noqa: BLE001  # a forked process must not go on with what its parent does
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(1)

    process = FORK.Process(target=guarded)
    process.start()
    process.join()
    if process.exitcode != 0:
        raise RuntimeError(f"{work!r} ended with {process.exitcode}")
