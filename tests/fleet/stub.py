"""Work for the engine's tests; workers import it by its name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def square(unit: tuple[int, str]) -> dict[str, float]:
    """The square of the unit's number; leaves a line in a file, so that it is seen what was computed how often."""
    number, log = unit
    if log:
        with open(log, "a") as file:
            file.write(f"{number}\n")
    if number % 10 == 7:
        raise ValueError(f"{number} ends with a seven")
    return {"square": float(number) ** 2}


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
