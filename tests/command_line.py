"""What tests say of a call of the command line (the fixture `run`)."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

Run = Callable[..., tuple[int, str, str]]
SCHEMAS = {"diagnose": 2}
"""Verb → schema of its JSON, where it is not the first."""


def result(run: Run, *arguments: object) -> dict[str, Any]:
    """The verb's JSON; it went well."""
    code, out, err = run(*arguments, "--json", "-")
    assert code == 0, err
    found: dict[str, Any] = json.loads(out)
    assert found["schema"] == SCHEMAS.get(str(arguments[0]), 1)
    return found


def refused(said: tuple[int, str, str], code: int, *words: str) -> None:
    """One line on standard error with these words, nothing else."""
    assert said[0] == code and said[1] == ""
    assert said[2].count("\n") == 1 and "Traceback" not in said[2]
    for word in words:
        assert word in said[2]


def whole(folder: Path) -> None:
    """What `auto` says it left is there."""
    files = json.loads((folder / "results.json").read_text())["files"]
    assert {"model", "urdf", "controller", "motion", "animation", "report", "results"} <= set(files)
    assert all(Path(path).stat().st_size > 500 for path in files.values())


def heard() -> None:
    """Let a process that is about to begin hear signals: a suite in a shell's background hands on that it does not."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
