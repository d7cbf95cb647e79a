"""Damage below every format: bits, bytes and blocks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fuzzing.junk import one

Mutation = Callable[[np.random.Generator, bytes], bytes]

BAD = (b"\x00", b"\xff", b"\xc3\x28", b"\xed\xa0\x80", b"\xf4\x90\x80\x80", b"\x1b[2J", b"\r", b"\x1a", b"\xef\xbb\xbf")
"""NUL, bytes that are no UTF-8, escapes, a lone carriage return, the end of a file once, a byte order mark."""
MARKS = (b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff", b"\xff\xfe\x00\x00", b"\x1f\x8b", b"PK\x03\x04", b"PAR1", b"#!")
"""What a file may begin with that is another one."""


def cut(rng: np.random.Generator, data: bytes, most: int = 4096) -> tuple[int, int]:
    """Return the begin and end of a block."""
    start = int(rng.integers(len(data) + 1))
    return start, min(len(data), start + int(rng.integers(1, most)))


def flipped(rng: np.random.Generator, data: bytes) -> bytes:
    """Some bits are others."""
    out = bytearray(data)
    for at in rng.integers(len(out), size=int(rng.integers(1, 20))) if out else ():
        out[at] ^= 1 << int(rng.integers(8))
    return bytes(out)


def inserted(rng: np.random.Generator, data: bytes) -> bytes:
    """Bytes that do not belong there."""
    start, _ = cut(rng, data)
    return data[:start] + one(rng, BAD) * int(rng.integers(1, 4)) + data[start:]


def deleted(rng: np.random.Generator, data: bytes) -> bytes:
    """A block is gone."""
    start, end = cut(rng, data)
    return data[:start] + data[end:]


def duplicated(rng: np.random.Generator, data: bytes) -> bytes:
    """A block stands twice."""
    start, end = cut(rng, data)
    return data[:end] + data[start:]


def truncated(rng: np.random.Generator, data: bytes) -> bytes:
    """The end is missing, down to nothing at all."""
    return data[: int(rng.integers(len(data) + 1) * rng.choice([0.001, 0.1, 1]))]


def spliced(rng: np.random.Generator, data: bytes) -> bytes:
    """A block lies on another one."""
    start, end = cut(rng, data)
    there = int(rng.integers(len(data) + 1))
    return data[:there] + data[start:end] + data[there + end - start :]


def swapped(rng: np.random.Generator, data: bytes) -> bytes:
    """Two halves of a block have changed places."""
    start, end = cut(rng, data)
    middle = (start + end) // 2
    return data[:start] + data[middle:end] + data[start:middle] + data[end:]


def marked(rng: np.random.Generator, data: bytes) -> bytes:
    """It begins like another kind of file."""
    return one(rng, MARKS) + data


def stretched(rng: np.random.Generator, data: bytes) -> bytes:
    """One line is very long."""
    start, _ = cut(rng, data)
    return (
        data[:start]
        + one(rng, (b"9", b"a", b" ", b",", b"[", b"<a>", b"\t")) * int(rng.integers(1, 300_000))
        + data[start:]
    )


def recoded(rng: np.random.Generator, data: bytes) -> bytes:
    """Another encoding, other line ends."""
    text = data.decode("utf-8", errors="replace")
    return one(
        rng, (text.encode("utf-16"), text.encode("utf-32"), data.replace(b"\n", b"\r\n"), data.replace(b"\n", b"\r"))
    )


MUTATIONS: tuple[Mutation, ...] = (
    flipped, inserted, deleted, duplicated, truncated, spliced, swapped, marked, stretched, recoded,
)  # fmt: skip


def damaged(rng: np.random.Generator, data: bytes) -> bytes:
    """Return the data with one or two kinds of damage."""
    for _ in range(int(rng.integers(1, 3))):
        data = one(rng, MUTATIONS)(rng, data)
    return data
