"""One case: a call of the command line in a folder of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from zlib import crc32

import numpy as np


@dataclass(frozen=True)
class Case:
    """A call of ``gimbal-pin`` on files.

    Attributes:
        words: What is typed behind ``gimbal-pin``; paths are relative to the case's folder.
        inputs: Name → content of the files that the call may read and must not change.
        old: Name → content of results of an earlier run, which the call may replace by whole ones only.
        piped: What stands on standard input; None: nothing.
    """

    words: tuple[str, ...]
    inputs: Mapping[str, bytes]
    old: Mapping[str, bytes] = field(default_factory=dict)
    piped: bytes | None = None

    def write(self, folder: Path) -> None:
        """Put the files into a folder, and what is piped beside them."""
        for name, content in {**self.inputs, **self.old}.items():
            (folder / name).write_bytes(content)


@dataclass(frozen=True, order=True)
class Place:
    """What a case is drawn from, and is repeated by: ``READER:NUMBER`` of a seed."""

    seed: int
    reader: str
    number: int

    def rng(self) -> np.random.Generator:
        """Return the source of everything random in that case."""
        return np.random.default_rng((self.seed, crc32(self.reader.encode()), self.number))

    def __str__(self) -> str:
        """As `--only` takes it."""
        return f"{self.reader}:{self.number}"
