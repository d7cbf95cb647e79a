"""NumPy's own files: one array (.npy), a record array or plain columns c0, c1, …; or several with names (.npz)."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.tables import Stream, Table, streams_of, table_of
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import check_size, read_bytes

MAGIC = b"\x93NUMPY"
DAMAGED = (ValueError, TypeError, SyntaxError, TokenError, MemoryError, RecursionError, OverflowError, LookupError)
"""What NumPy raises of a header that is none: it reads one as Python's text."""


def open_npy(path: Path) -> Table:
    """Read an array; `LogError` unless it is one of numbers, a row per sample."""
    values = array(read_bytes(path, LogError), str(path))
    if values.dtype.names:
        return table_of(str(path), *streams_of({"": values}))
    if values.ndim != 2:
        shape = f"has {values.ndim} dimension{'' if values.ndim == 1 else 's'}"
        raise LogError(str(path), shape, "save a table of a row per sample, a record array, or an .npz of names")
    return table_of(str(path), [Stream("", {f"c{k}": column for k, column in enumerate(values.T)})], [])


def open_npz(path: Path) -> Table:
    """Read an archive of named arrays; `LogError` if it is none, or unfolds to more than memory allows."""
    packed, arrays, size = read_bytes(path, LogError), dict[str, Any](), 0
    try:
        with zipfile.ZipFile(io.BytesIO(packed)) as archive:
            for entry in archive.infolist():
                check_size(path, size := size + entry.file_size, LogError)
                with archive.open(entry) as file:  # so many bytes: to its end it may be more than it states
                    content = file.read(entry.file_size)
                arrays[entry.filename.removesuffix(".npy")] = array(content, f"{path}: {entry.filename}")
    except (*DAMAGED, zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, RuntimeError) as error:
        raise LogError(str(path), f"is a damaged .npz ({error})", "write it again, with numpy.savez") from error
    return table_of(str(path), *streams_of(arrays))


def array(content: bytes, place: str) -> Array:
    """Return the array of an .npy file's bytes, never a pickle; `LogError` if it is none, or of objects."""
    stream = io.BytesIO(content)
    try:
        version = np.lib.format.read_magic(stream)
        reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, by_columns, kind = reader(stream)
        if kind.hasobject:
            raise LogError(place, "holds Python objects", "save numbers: a float64 array, or a record array of them")
        count = int(np.prod([int(size) for size in shape], dtype=object)) if shape else 1
        if min(shape, default=0) < 0 or count * kind.itemsize != len(content) - stream.tell():
            raise ValueError(f"{len(content) - stream.tell()} bytes for the shape {shape}")
        values = np.frombuffer(content, kind, count, stream.tell()) if count else np.empty(0, kind)
        return values.reshape(shape, order="F" if by_columns else "C")
    except DAMAGED as error:
        raise LogError(place, f"is a damaged .npy ({error})", "write it again, with numpy.save") from error
