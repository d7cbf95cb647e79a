"""Tables of arrays in memory, which is what most binary formats are once their library has read them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.base import Table, listed
from gimbal_pin.log.io.joined import JoinedTable, time_in
from gimbal_pin.log.log import Array

DEEPEST = 8
"""Groups within groups that are looked into; a Simulink log has four."""
WIDEST = 64
"""Most numbers of one array in a sample that each get a column: a pose's covariance has 36, an image far more."""


class Stream(NamedTuple):
    """Columns sampled together.

    Attributes:
        time: Name of the column of their times, s; empty where nothing says which it is.
        columns: Name → values, (N,) each.
    """

    time: str
    columns: Mapping[str, np.ndarray[Any, Any]]


@dataclass(frozen=True, eq=False)
class ArrayTable:
    """Columns of one length.

    Attributes:
        name: The file's path.
        data: Name → values, (N,) each.
        notes: What was left out.
    """

    name: str
    data: Mapping[str, np.ndarray[Any, Any]]
    notes: Sequence[str] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns' names."""
        return tuple(self.data)

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns as float64, (N,) each; `LogError` names the first value that is infinite."""
        read: dict[str, Array] = {column: self.data[column].astype(np.float64) for column in columns}
        for column, values in read.items():
            if not values.size:
                raise LogError(self.name, "has no samples", "give a file with samples")
            if (wrong := np.isinf(values)).any():
                row = int(np.argmax(wrong))
                raise LogError(self.place(row, column), f"is {values[row]}", "repair the value, or leave the row out")
        return read

    def place(self, row: int, column: str) -> str:
        """Return ``file sample S column 'name'``, samples counted from 1."""
        return f"{self.name} sample {row + 1} column '{column}'"


def table_of(name: str, streams: Sequence[Stream], notes: Sequence[str]) -> Table:
    """Return what a file of one or several streams, all by one clock, holds; `LogError` if it holds nothing."""
    if not streams:
        raise LogError(name, "holds no columns of numbers", "give a file with one array per channel, a value a sample")
    said = [f"{name}: {note}" for note in notes]
    parts = [ArrayTable(name, stream.columns) for stream in streams]
    if len(parts) == 1:
        return ArrayTable(name, parts[0].data, said)
    return JoinedTable(name, parts, [stream.time for stream in streams], shared=True, notes=said)


def streams_of(arrays: Mapping[str, Any]) -> tuple[list[Stream], list[str]]:
    """Return the streams in named arrays, and what was left out: samples along the dimension of times, or the longest.

    Arrays of another length are a stream of their own where one of them holds its times, and left out elsewhere; of one
    length those of a structure with times of its own.
    """
    flat = {key: values for key, array in arrays.items() for key, values in numeric(key, array)}
    flat = {key: values for key, values in flat.items() if values.ndim in (1, 2) and max(values.shape) > 1}
    times = {key: values for key, values in flat.items() if values.ndim == 1 and time_in([key.rpartition(".")[2]])}
    groups: dict[tuple[int, bytes], dict[str, np.ndarray[Any, Any]]] = {}
    for key, values in flat.items():
        size = max(values.shape, key=lambda one: (one in map(len, times.values()), one))
        group = groups.setdefault((size, clock(key, size, times)), {})
        rows = values if values.shape[0] == size else values.T
        if rows.ndim == 1:
            group[key] = rows
        elif rows.shape[1] <= WIDEST:
            group |= {f"{key}[{k}]": rows[:, k] for k in range(rows.shape[1])}
    found = [Stream(time_in(group) or "", group) for group in sorted(groups.values(), key=len, reverse=True)]
    streams = [stream for stream in found if stream is found[0] or (stream.time and found[0].time)]
    lost = [key for stream in found if stream not in streams for key in stream.columns]
    return streams, [f"{listed(lost)} have other lengths than the rest and no times: left out"] if lost else []


def clock(key: str, size: int, times: Mapping[str, np.ndarray[Any, Any]]) -> bytes:
    """Return the times of so many samples that lie nearest to a key: in its own structure, or one around it."""
    around = {name.rpartition(".")[0]: values for name, values in times.items() if len(values) == size}
    near = max((place for place in around if not place or key.startswith(f"{place}.")), key=len, default=None)
    return (around[near] if near is not None else next(iter(around.values()), np.empty(0))).tobytes()


def numeric(key: str, value: Any, depth: int = 0) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield name and values of the arrays of real numbers in an array, a record array, a table or a list of them."""
    if depth > DEEPEST:
        return
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from numeric(f"{key}.{name}" if key else str(name), inner, depth + 1)
    elif isinstance(value, list) and len(value) <= WIDEST and any(isinstance(inner, Mapping) for inner in value):
        for k, inner in enumerate(value):
            yield from numeric(f"{key}[{k}]", inner, depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.names:
        for name in value.dtype.names:
            yield from numeric(f"{key}.{name}" if key else name, value[name], depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        yield key, value.squeeze()
