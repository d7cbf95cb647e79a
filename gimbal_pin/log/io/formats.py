"""Every format of a log: a file beside this one, and a line here; known by how a file begins, or by its suffix."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gimbal_pin.errors import UsageError
from gimbal_pin.log.io import bag, candump, csv, mat, npy, parquet, ulog
from gimbal_pin.log.io.tables import JoinedTable, Table, time_of
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import beginning


@dataclass(frozen=True)
class Format:
    """One file format.

    Attributes:
        open: Reads what is needed to know a file's columns.
        write: Writes columns to a file, whole or not at all; None for formats that are only read.
        magic: How its files begin, where that distinguishes them from all others.
    """

    open: Callable[[Path], Table]
    write: Callable[[Mapping[str, Array], Path], None] | None = None
    magic: tuple[bytes, ...] = ()


FORMATS: Mapping[str, Format] = {
    ".csv": Format(csv.open_csv, csv.write_csv),
    ".tsv": Format(csv.open_csv, partial(csv.write_csv, separator="\t")),
    ".txt": Format(csv.open_csv, csv.write_csv),
    ".parquet": Format(parquet.open_parquet, parquet.write_parquet, (b"PAR1",)),
    ".gz": Format(csv.open_csv, magic=(csv.GZIP,)),
    ".log": Format(csv.open_csv),
    ".candump": Format(candump.open_candump, magic=candump.MAGIC),
    ".npy": Format(npy.open_npy, magic=(npy.MAGIC,)),
    ".npz": Format(npy.open_npz, magic=(b"PK\3\4",)),
    ".mat": Format(mat.open_mat, magic=(b"MATLAB 5.0", b"MATLAB 7.3", mat.HDF5)),
    ".h5": Format(mat.open_mat),
    ".hdf5": Format(mat.open_mat),
    **{suffix: Format(bag.open_bag, magic=(magic,)) for magic, suffix in bag.SUFFIXES.items()},
    ".ulg": Format(ulog.open_ulog, magic=(ulog.MAGIC,)),
}
"""Suffix → format."""
TEXT = tuple(suffix for suffix, form in FORMATS.items() if form.open is csv.open_csv and form.write is not None)


def open_table(path: Path) -> Table:
    """Return what a log's file holds, or several files: ``a.csv+b.csv``.

    Raises:
        LogError: A file is missing or cannot be read.
        UsageError: No format is known that begins so, nor one of the suffix; or a file to be joined has no times.
    """
    tables = [open_file(file) for file in files_of(path)]
    return tables[0] if len(tables) == 1 else JoinedTable(str(path), tables, [time_of(table) for table in tables])


def files_of(path: str | Path) -> list[Path]:
    """Return the files that a log's name means: itself, or the logs between its +."""
    parts = [Path(part) for part in str(path).split("+")]
    several = len(parts) > 1 and not Path(path).exists() and all(is_log(part) for part in parts)
    return parts if several else [Path(path)]


def is_log(path: Path) -> bool:
    """Whether a path is a log's, by its suffix or because it is there."""
    return path.suffix.lower() in FORMATS or path.exists()


def open_file(path: Path) -> Table:
    """Return what one file holds, or a bag's folder."""
    if (path / "metadata.yaml").is_file():
        return bag.open_bag(path)
    head = beginning(path, 16)  # of what cannot be read its reader says why
    begun = next((form for form in FORMATS.values() if form.magic and head.startswith(form.magic)), None)
    return (begun or format_of(path)).open(path)


def format_of(path: Path) -> Format:
    """Return the format of a path's suffix; `UsageError` lists the known ones."""
    if (suffix := path.suffix.lower()) not in FORMATS:
        what = f"has the suffix '{suffix}', of no known format" if suffix else "has no suffix to tell its format by"
        raise UsageError(str(path), what, f"use one of {', '.join(FORMATS)}")
    return FORMATS[suffix]
