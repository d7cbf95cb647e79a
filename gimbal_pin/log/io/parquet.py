"""Parquet: the same columns as in a CSV, in binary; needs pyarrow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log.io.files import replacing, told
from gimbal_pin.log.io.tables import ArrayTable
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import check_size, read_bytes


@dataclass(frozen=True, eq=False)
class Columns(Mapping[str, Array]):
    """The columns of an open `pyarrow.parquet.ParquetFile`, (N,) each, read one at a time when they are asked for."""

    name: str
    file: Any
    names: tuple[str, ...]

    def __len__(self) -> int:
        """Number of columns."""
        return len(self.names)

    def __iter__(self) -> Iterator[str]:
        """Names as in the schema."""
        return iter(self.names)

    def __getitem__(self, column: str) -> Array:
        """Return a column as float64, nan where a value is missing; `LogError` if it is damaged or no numbers."""
        import pyarrow

        try:
            data = self.file.read(columns=[column]).column(column)
        except (pyarrow.ArrowException, OSError) as error:
            raise LogError(self.name, f"is a damaged Parquet file ({error})", "write it again") from error
        kind = data.type
        if not (pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind) or pyarrow.types.is_decimal(kind)):
            raise LogError(f"{self.name} column '{column}'", f"holds {kind}, not numbers", "write it as float64")
        return np.array(data.cast(pyarrow.float64(), safe=False).to_numpy(), dtype=np.float64)


def open_parquet(path: Path) -> ArrayTable:
    """Open a Parquet file and read its schema; `LogError` if it is missing or is none."""
    parquet = pyarrow_parquet(str(path))
    import pyarrow

    try:
        file = parquet.ParquetFile(pyarrow.BufferReader(read_bytes(path, LogError)))
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(str(path), f"is not Parquet ({error})", "give it the suffix of its format") from error
    groups = [file.metadata.row_group(k) for k in range(file.num_row_groups)]
    check_size(path, sum(group.total_byte_size for group in groups), LogError)
    check_size(path, 8 * sum(group.num_rows for group in groups), LogError)
    return ArrayTable(str(path), Columns(str(path), file, tuple(file.schema_arrow.names)), row="row")


def write_parquet(columns: Mapping[str, Array], path: Path) -> None:
    """Write columns of equal length as float64; whole or not at all."""
    parquet = pyarrow_parquet(str(path))
    import pyarrow

    table = pyarrow.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    with replacing(path) as temporary, told(path):
        parquet.write_table(table, temporary)


def pyarrow_parquet(place: str) -> Any:
    """Return pyarrow's Parquet module; `UsageError` says how to install it."""
    try:
        import pyarrow.parquet
    except ImportError as error:
        mend = "install it (pip install 'gimbal_pin[parquet]'), or use CSV"
        raise UsageError(place, "is Parquet, which needs the package pyarrow", mend) from error
    return pyarrow.parquet
