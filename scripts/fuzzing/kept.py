"""The record of a run, from which it goes on, and every kind of failure with its files and how to repeat it."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from fuzzing.case import Case, Place
from fuzzing.workers import Draw, Result

EACH = 3
"""Cases that are kept of the same failure of the same reader; the others are in the record, and repeated by number."""


class Kept:
    """A folder: `results.jsonl`, one line per case, and `failures/READER-NUMBER/`."""

    def __init__(self, folder: Path, seed: int, draw: Draw, resume: bool) -> None:
        """Take up what is there, or begin anew."""
        self.file, self.failures, self.seed, self.draw = folder / "results.jsonl", folder / "failures", seed, draw
        self.count: Counter[tuple[str, str, str]] = Counter()
        self.done: dict[Place, Result] = {}
        if not resume:
            self.file.unlink(missing_ok=True)
        for result in self.read():
            self.done[result.place] = result
            self.counted(result)

    def read(self) -> Iterator[Result]:
        """Yield what whole lines say of this seed."""
        if self.file.is_file():
            for line in self.file.read_text(encoding="utf-8").splitlines():
                if line.endswith("}") and (entry := json.loads(line)).get("seed") == self.seed:
                    yield Result.read(entry, self.seed)

    def add(self, result: Result) -> None:
        """Note a result, and keep its files if it failed in a way that is new."""
        self.done[result.place] = result
        with self.file.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"seed": self.seed, **result.to_dict()}) + "\n")
        if self.counted(result):
            self.keep(result)

    def counted(self, result: Result) -> bool:
        """Count the kinds of failure, and tell whether one of them is among the first."""
        keys = [(result.place.reader, failure.kind, failure.signature) for failure in result.failures]
        self.count.update(keys)
        return any(self.count[key] <= EACH for key in keys)

    def keep(self, result: Result) -> None:
        """Write the inputs, the command and what was wrong."""
        folder = self.failures / str(result.place).replace(":", "-")
        folder.mkdir(parents=True, exist_ok=True)
        case = self.draw(result.place)
        with suppress(OSError):  # a name that this file system does not take: the command still says it
            case.write(folder)
        wrong = "\n\n".join(f"{failure.kind}: {failure.signature}\n{failure.detail}" for failure in result.failures)
        text = f"{command(case)}\n{repeated(result.place)}\n\n{wrong}\n"
        (folder / "failure.txt").write_text(text, encoding="utf-8", errors="backslashreplace")


def command(case: Case) -> str:
    """Return what is typed in a case's folder."""
    return f"gimbal-pin {shlex.join(case.words)}" + (" < piped" if case.piped is not None else "")


def repeated(place: Place) -> str:
    """Return what repeats a case."""
    return f"scripts/fuzz --only {place} --seed {place.seed}"
