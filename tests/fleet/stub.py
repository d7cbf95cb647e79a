"""Work for the executor's tests, which workers import by its name."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def square(unit: tuple[int, str]) -> dict[str, float]:
    """The square of a number, and a line in a file that tells that it was computed; no square of 7, 17, …"""
    number, log = unit
    if log:
        with open(log, "a") as file:
            file.write(f"{number}\n")
    if number % 10 == 7:
        raise ValueError(f"{number} ends with a seven")
    return {"square": float(number) ** 2, **({"third": number} if number % 3 == 0 else {})}


def kill_once(unit: tuple[int, str]) -> dict[str, float]:
    """The square; unit 3 kills its worker the first time."""
    number, log = unit
    once = Path(f"{log}.once")
    if number == 3 and not once.exists():
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return square((number, ""))
