"""Logs read in a process of its own (`bounded`): their libraries are not made for untrusted files."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gimbal_pin.errors import GimbalPinError, LogError, UsageError
from gimbal_pin.log.io.tables import Stream, Table, table_of
from gimbal_pin.rig.bounded import Stopped, run
from gimbal_pin.rig.reading import LARGEST, check_size, readable

MEMORY = 2**30 + 2 * LARGEST
"""Address space of the reading, bytes: that of the libraries, and columns are held twice at most."""
SECONDS = 20.0
"""Processor time of the reading, s, of the smallest file."""
RATE = 5e5
"""Bytes beyond that for which it may take another second: bags of JointState and Imu messages pass at 6 MB/s, MATLAB
files at 4 MB/s (2.5 GHz, start of the process included), and machines are busy with other work."""


def open_isolated(path: Path, reader: str, kind: str, module: str, extra: str, *, streamed: bool = False) -> Table:
    """Return the table that ``streams(path)`` of the module `reader` beside this one reads.

    Args:
        path: The file or folder.
        reader: Name of the module.
        kind: What the format is called.
        module: Package that it needs.
        extra: The package's extra that brings it.
        streamed: Whether a file may be larger than memory, because its reader keeps only little of it.

    Raises:
        LogError: The file is missing or damaged, or reading it takes more time or memory than it may.
        UsageError: The package is not installed.
    """
    if find_spec(module) is None:
        mend = f"install it (pip install 'gimbal_pin[{extra}]'), or write CSV"
        raise UsageError(str(path), f"is {kind}, which needs the package {module}", mend)
    with readable(path, LogError):
        parts = list(path.iterdir()) if path.is_dir() else [path]
        size = sum(file.stat().st_size for file in parts)
    if not all(file.is_file() or file.is_dir() for file in parts):
        raise LogError(str(path), f"is {kind} that is no file", "give the path of a file: it is not read from a pipe")
    if not streamed:
        check_size(path, size, LogError)
    bounds: dict[str, Any] = {"memory": MEMORY + size * streamed, "seconds": SECONDS + size / RATE}
    with TemporaryDirectory() as folder:
        try:
            found = run(__name__, reader, str(path.resolve()), folder, **bounds)
        except Stopped as error:
            mend = "write it again, or give a shorter file"
            raise LogError(str(path), f"is {kind} that cannot be read ({error})", mend) from error
        if "wrong" in found:
            raise LogError(str(path), *found["wrong"])
        streams = [
            Stream(time, dict(zip(names, np.load(Path(folder, f"{k}.npy"), allow_pickle=False))))
            for k, (time, names) in enumerate(found["streams"])
        ]
    return table_of(str(path), streams, found["notes"])


def main(reader: str, path: str, folder: str) -> dict[str, Any]:
    """Write the streams that a module reads into a folder, ``k.npy``, a row per column; return names and notes.

    An error of the package's own is returned in words.
    """
    try:
        streams, notes = import_module(f"gimbal_pin.log.io.{reader}").streams(Path(path))
        values = [column for _, columns in streams for column in columns.values()]
        check_size(path, 8 * sum(map(len, values)), LogError)
    except GimbalPinError as error:
        return {"wrong": [error.what, error.mend]}
    for k, (_, columns) in enumerate(streams):
        np.save(Path(folder, f"{k}.npy"), np.array(list(columns.values()), dtype=np.float64), allow_pickle=False)
    return {"streams": [[time, list(columns)] for time, columns in streams], "notes": list(notes)}
