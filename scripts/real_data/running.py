"""A verb in a process of its own with a time limit, its outcome kept as JSON."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Outcome:
    """How a verb ended.

    Attributes:
        exit: Exit code; None: it was killed at the time limit.
        seconds: Wall time.
        error: What it wrote on standard error.
        text: What it wrote on standard output.
        result: Its ``--json``, or None.
        cpu: Processor time of it and its workers, s, which a busy machine does not lengthen; None: not known.
    """

    exit: int | None
    seconds: float
    error: str
    text: str
    result: dict[str, Any] | None
    cpu: float | None = None

    @property
    def sound(self) -> bool:
        """Whether it ended as the contract says: exit code 0, or 2 or 3 with one error; notes may stand before."""
        errors = [
            line for line in self.error.splitlines() if not line.startswith("gimbal-pin: note: ")
        ]
        refused = self.exit in (2, 3) and len(errors) == 1
        return (self.exit == 0 or refused) and "Traceback" not in self.error

    @property
    def said(self) -> str:
        """Exit code and the last line of standard error, files without their folders."""
        line = re.sub(
            r"[/…][^\s:]*/", "", (self.error.strip().splitlines() or [""])[-1]
        ).removeprefix("gimbal-pin: ")
        return "over the time limit" if self.exit is None else f"exit {self.exit} {line}".strip()


def run(arguments: Sequence[str], out: Path, limit: float) -> Outcome:
    """Run a verb; files go to `out`, its JSON is read from ``out/told/run.json``; after `limit`, s, it is killed."""
    (out / "told").mkdir(parents=True, exist_ok=True)
    told = out / "told" / "run.json"
    told.unlink(missing_ok=True)
    began = time.perf_counter()
    spent = processor_time()
    process = subprocess.Popen(
        [sys.executable, "-m", "gimbal_pin.cli", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    code: int | None = None
    try:
        text, error = process.communicate(timeout=limit)
        code = process.returncode
    except subprocess.TimeoutExpired:
        pass
    finally:
        # In a group of its own, it and its workers do not see Ctrl-C either.
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    if code is None:
        text, error = process.communicate()
    seconds = time.perf_counter() - began
    result = json.loads(told.read_text(encoding="utf-8")) if code == 0 and told.is_file() else None
    told.unlink(missing_ok=True)
    return Outcome(code, seconds, error, text, result, processor_time() - spent)


def processor_time() -> float:
    """Processor time of all processes that this one started and that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def keep(outcome: Outcome, path: Path) -> None:
    """Write an outcome, whole or not at all."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(asdict(outcome), indent=1), encoding="utf-8")
    os.replace(part, path)


def kept(folder: Path) -> dict[tuple[str, str], Outcome]:
    """Return what a folder of results holds: case and run → outcome."""
    paths = sorted(folder.glob("*/*.json"))
    return {
        (p.parent.name, p.stem): Outcome(**json.loads(p.read_text(encoding="utf-8"))) for p in paths
    }
