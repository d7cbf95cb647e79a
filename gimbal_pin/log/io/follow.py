"""A log that is still being written: a growing CSV file, or a pipe."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import BinaryIO

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log.io import split_payload, to_log
from gimbal_pin.log.io.columns import (
    Group,
    list_links,
    make_log_groups,
    read_groups,
    resolve_mapping,
)
from gimbal_pin.log.io.csv import (
    BLOCK,
    COMMENT_LINE,
    LONGEST_LINE,
    CsvTable,
    decode_utf8,
    read_header,
)
from gimbal_pin.log.io.link import follow_link, is_link
from gimbal_pin.log.io.readers import FORMATS, GROWING
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.mapping import ROW_COLUMN, Entries, Source
from gimbal_pin.rig.reading import open_without_waiting, wrap_read_errors
from gimbal_pin.rig.rig import Rig


def follow(path: str, rig: Rig, mapping: Entries = (), *, idle: float = inf) -> Iterator[Log]:
    """Yield a CSV log's samples as they come, until the pipe ends or the file has not grown for `idle` seconds.

    A last line without its end is left out, as it may be incomplete.

    Args:
        path: The file, "-" for standard input, LOG@PAYLOAD, or a running gimbal: udp://HOST:PORT, serial:DEVICE@BAUD.
        rig: Whose joints the columns are named after.
        mapping: As for `read_log`.
        idle: As above, s; a pipe is waited for without end.

    Raises:
        LogError, UsageError: As `read_log`, once the samples before that are yielded; and where a file becomes shorter.
    """
    file, payload = (Path(path), None) if path == "-" or is_link(path) else split_payload(path)
    name = "standard input" if path == "-" else path if is_link(path) else str(file)
    links = list_links(rig)
    groups = make_log_groups(rig.joints, links, True)
    sources = resolve_mapping(rig, groups, mapping)
    parts = follow_link(path, rig.joints, idle) if is_link(path) else _read_growing(file, idle)
    for table in _parse_parts(name, join_whole_lines(parts)):
        if ROW_COLUMN in {source.column for source in sources.values()} - set(table.columns):
            what = f"is mapped by the '{ROW_COLUMN}', which a growing log is not read by"
            raise UsageError(name, what, "write its times")
        data, error = _read_usable(table, groups, sources)
        if data is not None:
            said = (
                [line.decode()[1:].strip() for line in COMMENT_LINE.findall(table.body)]
                if is_link(path)
                else []
            )
            yield to_log(data, table.name, rig, links, payload, sources, said)
        if error is not None:
            raise error


def _read_usable(
    table: CsvTable, groups: Mapping[str, Group], sources: Mapping[str, Source]
) -> tuple[dict[str, Array] | None, LogError | None]:
    """Return what a table holds up to the first line that cannot be used, and its error, if any.

    A flaw stays one whatever follows it, so the lines before it are found by bisection.
    """
    try:
        return read_groups(table, groups, sources), None
    except LogError as error:
        rows = table.body.splitlines(keepends=True)
        found = None
        flaw = error
    fine = 0
    end = len(rows)
    while end - fine > 1:
        middle = (fine + end) // 2
        try:
            found = read_groups(
                replace(table, text=b"".join(rows[:middle]), begin=0), groups, sources
            )
            fine = middle
        except LogError:
            end = middle
    return found, flaw


def _parse_parts(name: str, parts: Iterator[bytes]) -> Iterator[CsvTable]:
    """Yield the rows of each part under the header that came first.

    Raises:
        LogError: Nothing came, or no row.
    """
    head, before, line = None, b"", 1
    for part in parts:
        if head is None:
            before = decode_utf8(before + part)
            head = found = read_header(name, before)
        else:
            found = replace(head, text=part, first=line, begin=0)
        if found is not None:
            line = found.first + found.body.count(b"\n")
            if COMMENT_LINE.sub(b"", found.body).strip():
                yield found
    if head is None:
        raise LogError(name, "is empty", "write a header and one row per sample")


def join_whole_lines(parts: Iterator[bytes]) -> Iterator[bytes]:
    """Yield whole lines, several together, from byte strings that were cut anywhere.

    A line that is longer than any row is handed on without its end, to be refused: some files have no end of a line.
    """
    rest = b""
    for part in parts:
        lines, end, rest = (rest + part).rpartition(b"\n")
        if end:
            yield lines + end
        elif len(rest) > LONGEST_LINE:
            yield rest
            rest = b""


def _read_growing(path: Path, idle: float) -> Iterator[bytes]:
    """Yield what is in a file or pipe, and what is written to it, until it ends or does not grow for `idle` seconds."""
    with _open_growing(path, idle) as file:
        grows = path.is_file()
        waited = 0.0
        unwritten = idle < inf and path.is_fifo()  # nobody may have opened it to write yet
        while True:
            part = os.read(file.fileno(), BLOCK)
            if part:
                waited, unwritten = 0.0, False
                yield part
            elif waited >= idle or not (grows or unwritten):
                return
            if (
                grows
                and file.seekable()
                and os.fstat(file.fileno()).st_size < os.lseek(file.fileno(), 0, os.SEEK_CUR)
            ):
                raise LogError(
                    str(path), "became shorter while it was followed", "follow the new file"
                )
            if len(part) < BLOCK:
                time.sleep(0.05)  # to read row by row would cost more than to identify from it
                waited += 0.05


@contextmanager
def _open_growing(path: Path, idle: float) -> Iterator[BinaryIO]:
    """Open a file, or standard input, which stays open; a pipe's writer is awaited only where idle time has no end."""
    if str(path) == "-":
        if sys.stdin is None:
            raise LogError("standard input", "is closed", "pipe a log into it")
        yield sys.stdin.buffer
        return
    if (suffix := path.suffix.lower()) in FORMATS and suffix not in GROWING:
        raise UsageError(str(path), f"is {suffix}, which is written whole", "follow a CSV file")
    with (
        wrap_read_errors(path, LogError),
        open(path, "rb", buffering=0, opener=open_without_waiting if idle < inf else None) as file,
    ):
        yield file
