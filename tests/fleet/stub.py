"""Work and an executor for the engine's tests; workers import the work by its name."""

from __future__ import annotations

import os
import signal
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path


class LastFirst(ThreadPoolExecutor):
    """Runs what was submitted last first."""

    def __init__(self) -> None:
        super().__init__(1)
        self.waiting: list = []

    def submit(self, function, /, *args):  # type: ignore[no-untyped-def, override]
        future: Future = Future()
        self.waiting.append(lambda: future.set_result(function(*args)))
        super().submit(lambda: self.waiting.pop()())
        return future


def square(unit: tuple[int, str]) -> dict[str, float]:
    """The square of the unit's number; leaves a line in a file, so that it is seen what was computed how often."""
    number, log = unit
    if log:
        with open(log, "a") as file:
            file.write(f"{number}\n")
    if number % 10 == 7:
        raise ValueError(f"{number} ends with a seven")
    return {"square": float(number) ** 2}


def sometimes(unit: tuple[int, str]) -> dict[str, float | int | None]:
    """Columns that not every unit has, and numbers that are whole only in some."""
    number = unit[0]
    return {"whole": number if number % 3 else None, "share": number / 2 if number % 2 else 1, f"own_{number % 4}": 1}


def slow_square(unit: tuple[int, str]) -> dict[str, float]:
    time.sleep(0.05)
    return square(unit)


def fatal(unit: tuple[int, str]) -> dict[str, float]:
    """Unit 5 always kills its worker; unit 3 does so once."""
    number, log = unit
    once = Path(f"{log}.once")
    if number == 5 or (number == 3 and not once.exists()):
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return square((number, ""))
