"""Parquet: the same columns as in a CSV, in binary; needs pyarrow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log.io.files import replacing, told
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import read_bytes


@dataclass(frozen=True, eq=False)
class ParquetTable:
    """A Parquet file of which the schema is known.

    Attributes:
        name: The file's path.
        columns: Names in the schema.
        file: The open `pyarrow.parquet.ParquetFile`.
    """

    notes: ClassVar[Sequence[str]] = ()
    name: str
    columns: tuple[str, ...]
    file: Any

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns, (N,) each; `LogError` names the row and column of the first flaw."""
        if self.file.metadata.num_rows == 0:
            raise LogError(self.name, "has no rows", "give a file with samples")
        import pyarrow

        try:
            data = self.file.read(columns=list(columns))
        except (pyarrow.ArrowException, OSError) as error:
            raise LogError(self.name, f"is a damaged Parquet file ({error})", "write it again") from error
        return {column: self.numbers(data.column(column), column) for column in columns}

    def numbers(self, data: Any, column: str) -> Array:
        """Return an Arrow column as float64, nan where a value is missing; `LogError` if it holds something else."""
        import pyarrow

        kind = data.type
        if not (pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind) or pyarrow.types.is_decimal(kind)):
            raise LogError(f"{self.name} column '{column}'", f"holds {kind}, not numbers", "write it as float64")
        values = np.array(data.cast(pyarrow.float64(), safe=False).to_numpy(), dtype=np.float64)
        if (wrong := np.isinf(values)).any():
            row = int(np.argmax(wrong))
            raise LogError(self.place(row, column), f"is {values[row]}", "repair the value, or delete the row")
        return values

    def place(self, row: int, column: str) -> str:
        """Return ``file row R column 'name'`` of a sample, rows counted from 1."""
        return f"{self.name} row {row + 1} column '{column}'"


def open_parquet(path: Path) -> ParquetTable:
    """Open a Parquet file and read its schema; `LogError` if it is missing or is none."""
    parquet = pyarrow_parquet(str(path))
    import pyarrow

    try:
        file = parquet.ParquetFile(pyarrow.BufferReader(read_bytes(path, LogError)))
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(str(path), f"is not Parquet ({error})", "give it the suffix of its format") from error
    return ParquetTable(str(path), tuple(file.schema_arrow.names), file)


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
