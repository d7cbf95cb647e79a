"""One case: a call of the command line in a folder of its own."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from zlib import crc32

import numpy as np

PORT = "udp://127.0.0.1:PORT"
"""What is typed for the address of the gimbal that answers; the system chooses its port."""


@dataclass(frozen=True)
class Case:
    """A call of ``gimbal-pin`` on files.

    Attributes:
        words: What is typed behind ``gimbal-pin``; paths are relative to the case's folder.
        inputs: Name → content of the files that the call may read and must not change.
        old: Name → content of results of an earlier run, which the call may replace by whole ones only.
        piped: What stands on standard input; None: nothing.
        pipes: Name → what is written, slowly, into a named pipe of that name; None: nobody writes.
        links: Name → where a link of that name leads: a device, or nowhere.
        datagrams: What a gimbal at `PORT` sends to who greets it.
        code: Exit code that must come out; None: any of the package's own.
        plain: The same with names without a mark: its pages have the same elements.
    """

    words: tuple[str, ...]
    inputs: Mapping[str, bytes]
    old: Mapping[str, bytes] = field(default_factory=dict)
    piped: bytes | None = None
    pipes: Mapping[str, bytes | None] = field(default_factory=dict)
    links: Mapping[str, str] = field(default_factory=dict)
    datagrams: tuple[bytes, ...] = ()
    code: int | None = None
    plain: Case | None = None

    def write(self, folder: Path) -> None:
        """Put the files into a folder, and what is piped beside them."""
        for name, content in {**self.inputs, **self.old}.items():
            (folder / name).write_bytes(content)
        for name in self.pipes:
            os.mkfifo(folder / name)
        for name, target in self.links.items():
            (folder / name).symlink_to(target)


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
