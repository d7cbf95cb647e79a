"""The text of a CSV file, line by line and field by field: what is in it, and what is wrong with it."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import count

import numpy as np

DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")


def as_utf8(data: bytes) -> bytes:
    """Return text without its byte order mark, UTF-16 turned to UTF-8, lone carriage returns to line feeds."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16", errors="replace").encode()
    data = data.removeprefix(b"\xef\xbb\xbf")
    return data if b"\n" in data else data.replace(b"\r", b"\n")


def lines(data: bytes) -> Iterator[tuple[int, int, int, str]]:
    """Yield (number from 1, start, end, text) of each line."""
    start = 0
    for number in count(1):
        if start >= len(data):
            return
        end = data.find(b"\n", start) + 1 or len(data)
        yield number, start, end, decoded(data[start:end]).rstrip("\r\n")
        start = end


def decoded(line: bytes) -> str:
    """Return a header's text: UTF-8, or Latin-1 where it is not."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def split(line: str, separator: str) -> list[str]:
    """Return the trimmed fields of one line; quotes around them go."""
    try:
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        return [line]
    return [field.strip() for field in fields]


def uneven(body: bytes, separator: str, width: int) -> bool:
    """Tell whether any line that is not blank has another number of separators than ``width - 1`` (quotes ignored)."""
    characters = np.frombuffer(body.rstrip(b"\n"), np.uint8)
    ends = np.append(np.flatnonzero(characters == ord("\n")), len(characters))
    separators = np.flatnonzero(characters == ord(separator))
    counts = np.diff(np.searchsorted(separators, ends), prepend=0)
    lengths = np.diff(ends, prepend=-1) - 1
    returns = (lengths == 1) & (np.append(characters, 0)[ends - 1] == ord("\r"))
    return bool(np.any((counts != width - 1) & (lengths > 0) & ~returns))


def uneven_mend(found: int, width: int, separator: str) -> str:
    """Return what to do about a row of another width than the header."""
    if found < width:
        return "complete the row, or delete it (a recording that was cut off ends so)"
    return "quote or delete the surplus" + ("; decimal commas must be points" if separator == "," else "")


def sound(fields: Sequence[str], places: Iterable[int]) -> bool:
    """Tell whether the fields at `places` are finite numbers, at less cost than asking each for its `flaw`."""
    texts = [fields[place] for place in places]
    try:
        return all(map(math.isfinite, map(float, texts))) and "_" not in (text := "".join(texts)) and text.isascii()
    except ValueError:
        return False


def flaw(field: str) -> tuple[str, str] | None:
    """Return what is wrong with a number's text and the mend, or None; nothing where a value is missing."""
    value = number_in(field)
    if not field or (value is not None and not math.isinf(value)):
        return None
    if value is not None:
        return f"is {field}", "repair the value, or delete the row"
    if DECIMAL_COMMA.fullmatch(field):
        return f"has a decimal comma ({field})", "write decimal points"
    return f"holds the text '{field[:40]}'", "write a number, or leave the row out"


def number_in(field: str) -> float | None:
    """Return the number that a field spells, or None; ``1_000`` and digits of other scripts are none."""
    try:
        return None if "_" in field or not field.isascii() else float(field)
    except ValueError:
        return None
