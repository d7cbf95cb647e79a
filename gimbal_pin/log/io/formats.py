"""Every format of a log: a file beside this one, and a line here; known by how a file begins, or by its suffix."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from gimbal_pin.errors import UsageError
from gimbal_pin.log.io.bag import SUFFIXES, open_bag
from gimbal_pin.log.io.base import Format, Table
from gimbal_pin.log.io.candump import MAGIC as CANDUMP
from gimbal_pin.log.io.candump import open_candump
from gimbal_pin.log.io.csv import GZIP, open_csv, write_csv
from gimbal_pin.log.io.joined import JoinedTable, time_of
from gimbal_pin.log.io.mat import HDF5, open_mat
from gimbal_pin.log.io.npy import MAGIC as NPY
from gimbal_pin.log.io.npy import open_npy, open_npz
from gimbal_pin.log.io.parquet import open_parquet, write_parquet
from gimbal_pin.log.io.ulog import MAGIC as ULOG
from gimbal_pin.log.io.ulog import open_ulog

BAGS = {suffix: Format(open_bag, magic=(magic,)) for magic, suffix in SUFFIXES.items()}
FORMATS: Mapping[str, Format] = {
    ".csv": Format(open_csv, write_csv),
    ".tsv": Format(open_csv, partial(write_csv, separator="\t")),
    ".txt": Format(open_csv, write_csv),
    ".parquet": Format(open_parquet, write_parquet, (b"PAR1",)),
    ".gz": Format(open_csv, magic=(GZIP,)),
    ".log": Format(open_csv),
    ".candump": Format(open_candump, magic=CANDUMP),
    ".npy": Format(open_npy, magic=(NPY,)),
    ".npz": Format(open_npz, magic=(b"PK\3\4",)),
    ".mat": Format(open_mat, magic=(b"MATLAB 5.0", b"MATLAB 7.3", HDF5)),
    ".h5": Format(open_mat),
    ".hdf5": Format(open_mat),
    **BAGS,
    ".ulg": Format(open_ulog, magic=(ULOG,)),
}
"""Suffix → format."""
TEXT = tuple(suffix for suffix, form in FORMATS.items() if form.open is open_csv and form.write is not None)


def open_table(path: Path) -> Table:
    """Return what a log's file holds, or several files: ``a.csv+b.csv``.

    Raises:
        LogError: A file is missing or cannot be read.
        UsageError: No format is known that begins so, nor one of the suffix; or a file to be joined has no times.
    """
    files = files_of(path)
    tables = [open_file(file) for file in files]
    return tables[0] if len(tables) == 1 else JoinedTable(str(path), tables, [time_of(table) for table in tables])


def files_of(path: str | Path) -> list[Path]:
    """Return the files that a log's name means: itself, or what stands between its +, which formats' names end."""
    parts = [Path(part) for part in str(path).split("+")]
    several = len(parts) > 1 and not Path(path).exists() and all(is_log(part) for part in parts)
    return parts if several else [Path(path)]


def is_log(path: Path) -> bool:
    """Tell whether a path is a log's, by its suffix or because it is there."""
    return path.suffix.lower() in FORMATS or path.exists()


def open_file(path: Path) -> Table:
    """Return what one file holds, or a bag's folder."""
    if (path / "metadata.yaml").is_file():
        return open_bag(path)
    head = b""
    if path.is_file():
        try:
            with path.open("rb") as file:
                head = file.read(16)
        except OSError:  # told by its reader
            head = b""
    begun = next((form for form in FORMATS.values() if form.magic and head.startswith(form.magic)), None)
    return (begun or format_of(path)).open(path)


def format_of(path: Path) -> Format:
    """Return the format of a path's suffix; `UsageError` lists the known ones."""
    if (suffix := path.suffix.lower()) not in FORMATS:
        what = f"has the suffix '{suffix}', of no known format" if suffix else "has no suffix to tell its format by"
        raise UsageError(str(path), what, f"use one of {', '.join(FORMATS)}")
    return FORMATS[suffix]
