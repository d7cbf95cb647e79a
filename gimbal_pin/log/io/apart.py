"""Logs read in a process of its own (`bounded`): their libraries are not made for strangers' files."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gimbal_pin.errors import GimbalPinError, LogError, UsageError
from gimbal_pin.log.io.arrays import Stream, table_of
from gimbal_pin.log.io.base import Table
from gimbal_pin.rig.bounded import Stopped, run
from gimbal_pin.rig.reading import largest, readable

MEMORY = 4 * 2**30
"""Address space of the reading, bytes, beside twice the file's size: columns are held twice at most."""
SECONDS = 20.0
"""Processor time of the reading, s, of the smallest file."""
RATE = 5e5
"""Bytes beyond that for which it may take another second: bags of JointState and Imu messages pass at 6 MB/s, MATLAB
files at 4 MB/s (2.5 GHz, start of the process included), and machines are busy with other work."""


def open_apart(path: Path, reader: str, kind: str, module: str, extra: str, *, streamed: bool = False) -> Table:
    """Return the table that ``streams(path)`` of the module `reader` beside this one reads.

    Args:
        path: The file or folder.
        reader: Name of the module.
        kind: What the format is called.
        module: Package that it needs.
        extra: The package's extra that brings it.
        streamed: Whether a file may be larger than memory, as its reader keeps a little of it only.

    Raises:
        LogError: The file is missing or damaged, or reading it takes more than it may.
        UsageError: The package is not installed.
    """
    if find_spec(module) is None:
        mend = f"install it (pip install 'gimbal_pin[{extra}]'), or write CSV"
        raise UsageError(str(path), f"is {kind}, which needs the package {module}", mend)
    with readable(path, LogError):
        size = sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else [path]))
    if size > largest() and not streamed:
        raise LogError(str(path), f"is larger than {largest() / 1e6:.0f} MB", "give a smaller file")
    seconds = SECONDS + size / RATE
    with TemporaryDirectory() as folder:
        try:
            told = run(__name__, reader, str(path.resolve()), folder, memory=MEMORY + 2 * size, seconds=seconds)
        except Stopped as error:
            mend = "write it again, or give a shorter file"
            raise LogError(str(path), f"is {kind} that cannot be read ({error})", mend) from error
        if "wrong" in told:
            raise LogError(str(path), *told["wrong"])
        arrays = [np.load(Path(folder, f"{k}.npy"), allow_pickle=False) for k in range(len(told["streams"]))]
    streams = [Stream(one["time"], dict(zip(one["columns"], data))) for one, data in zip(told["streams"], arrays)]
    return table_of(str(path), streams, told["notes"])


def main(reader: str, path: str, folder: str) -> dict[str, Any]:
    """Write the streams that a module reads into a folder, ``k.npy``, a row per column; return their names.

    Or the words of an error of the package's own.
    """
    try:
        streams, notes = import_module(f"gimbal_pin.log.io.{reader}").streams(Path(path))
    except GimbalPinError as error:
        return {"wrong": [error.what, error.mend]}
    for k, (_, columns) in enumerate(streams):
        np.save(Path(folder, f"{k}.npy"), np.array(list(columns.values()), dtype=np.float64), allow_pickle=False)
    named = [{"time": time, "columns": list(columns)} for time, columns in streams]
    return {"streams": named, "notes": list(notes)}
