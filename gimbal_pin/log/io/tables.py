"""Named columns of numbers, whatever file they are from: one table, or several joined at the times of one of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log.io.recognise import find_time_unit
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import check_size, split_words

DEEPEST_NESTING = 8
"""Deepest nesting of groups that are read; a Simulink log has four."""
WIDEST_ARRAY = 64
"""Most numbers of one array in a sample that each get a column: a pose's covariance has 36, an image far more."""
_TIMES = frozenset((
    "t", "time", "timestamp", "timestamps", "stamp", "tout", "times", "seconds", "sec", "zeit", "uhrzeit", "clock",
    "elapsed", "datetime", "millis", "micros",
))  # fmt: skip
"""Words of which one stands in the name of a column of times."""
_DATES = {"date", "datum"}
"""Words in the name of a column of times where no name holds one of `_TIMES`: a date alone is none."""


class ColumnTable(Protocol):
    """A file's named columns of numbers, read on demand."""

    @property
    def name(self) -> str:
        """The file, as errors name it."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The names in the file's header; '' where one is missing."""

    @property
    def notes(self) -> Sequence[str]:
        """Sentences on what was left out or changed; those of `read` are complete once it has returned."""

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns, (N,) each, N > 0, nan where a value is missing; `LogError` at what is no number."""

    def place(self, row: int, column: str) -> str:
        """Return where a value stands: file, line or row, and column."""


def quote_names(names: Sequence[str], most: int = 24) -> str:
    """Return the names in quotes, of a long list the first so many."""
    text = ", ".join(f"'{name}'" for name in names[:most])
    return text if len(names) <= most else f"{text}, … {len(names)} in all"


def _find_time_name(names: Iterable[str]) -> str | None:
    """Return the name of the times: of those with one of `_TIMES` the first with the fewest other words, or None."""
    split = [(split_words(name), k, name) for k, name in enumerate(names)]
    for known in (_TIMES, _DATES):
        if found := [(len(words), k, name) for words, k, name in split if known & {*words}]:
            return min(found)[2]
    return None


def find_time(table: ColumnTable) -> str:
    """Return the column of a table's times, by its name, or else the first column if it increases."""
    if (name := _find_time_name(table.columns)) is not None:
        return name
    first = table.columns[0]
    values = table.read([first])[first]
    if (values[1:] > values[:-1]).all():
        return first
    mend = "name the column of its times t in the header"
    raise UsageError(
        table.name, "has no column that is called time, and its first does not increase", mend
    )


def decode_register(values: Array) -> tuple[Array, int]:
    """Return the signed values of a register that was logged without its sign, and its bits; 0 bits of another column.

    Whole numbers that jump by over half of 2^16 or 2^32 are such a register if they make no such jump when those from
    half on are less by the whole: ``65535, 0, 3`` are -1, 0, 3.
    """
    seen = values[~np.isnan(values)]
    if not seen.size or seen.min() < 0 or seen.max() >= 2.0**32 or (seen != np.round(seen)).any():
        return values, 0
    bits = 16 if seen.max() < 2.0**16 else 32
    half = 2.0 ** (bits - 1)
    signed = np.where(values >= half, values - 2 * half, values)
    jumps = [(np.abs(np.diff(x)) > half).any() for x in (seen, signed[~np.isnan(values)])]
    return (signed, bits) if jumps == [True, False] and np.unique(seen).size > 2 else (values, 0)


_LEAST_STAMPS = 50
"""Fewest rows of which the interval is estimated from rounded stamps."""
_STAMP_SPAN = 1.1
"""Span of the distances of rounded stamps from even times, over the rounding: one, and a tenth for the clock's jitter.
Doubling it takes rows that come in pairs for even ones."""


def find_repeated_rows(columns: Mapping[str, Array]) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return which rows hold what the row before holds, in every column, (N,)."""
    return np.asarray(
        np.all([np.diff(values, prepend=np.nan) == 0 for values in columns.values()], axis=0)
    )


def even_stamps(time: str, columns: Mapping[str, Array]) -> tuple[Array, float]:
    """Return the times of evenly spaced rows whose stamps are rounded to more than their interval, and the rounding.

    The line through stamps by row, where all are as near to it as rounded stamps of even times: 0.00, 0.00, 0.01, 0.02,
    0.02 are 0.005 apart. Other stamps are returned as they are, with a rounding of 0: also those that repeat only in
    rows that were written twice.
    """
    t = columns[time]
    steps = np.diff(t)
    if len(t) < _LEAST_STAMPS or not (steps >= 0).all() or not steps.any():
        return t, 0.0
    if not (np.diff(t[~find_repeated_rows(columns)]) == 0).any():
        return t, 0.0
    rounding = float(steps[steps > 0].min())
    rows = np.arange(len(t)) - (len(t) - 1) / 2
    line = t.mean() + rows * float(rows @ (t - t.mean()) / (rows @ rows))
    return (line, rounding) if np.ptp(t - line) <= _STAMP_SPAN * rounding else (t, 0.0)


def decode_columns(
    name: str, time: str, columns: Mapping[str, Array], notes: list[str]
) -> dict[str, Array]:
    """Return the columns with `even_stamps` for times and `decode_register` for all others.

    Args:
        name: The file.
        time: Name of the column of times.
        columns: Name → values, (N,) each.
        notes: Takes a sentence on each column that changes.
    """
    t, rounding = even_stamps(time, columns)
    if rounding:
        interval = (t[-1] - t[0]) / (len(t) - 1)
        evenly = f"its rows are taken as evenly spaced, {interval:.6g} apart"
        notes.append(f"{name}: '{time}': stamps are rounded to {rounding:.3g}: {evenly}")
    decoded = {**columns, time: t}
    for column in [column for column in columns if column != time]:
        decoded[column], bits = decode_register(columns[column])
        if bits:
            meaning = f"signed registers of {bits} bits: {2**bits - 1} is read as -1"
            notes.append(f"{name}: '{column}' holds {meaning}")
    return decoded


def read_numeric_columns(table: ColumnTable) -> tuple[dict[str, Array], list[str]]:
    """Return the columns of numbers, (N,) each, missing values interpolated, and a sentence on each flaw.

    Raises:
        LogError: No column holds numbers.
    """
    names = [name for name, count in Counter(table.columns).items() if count == 1]
    data = dict[str, Array]()
    flaws = list[str]()
    refusal = LogError(table.name, "holds no numbers", "give a file with samples")
    try:
        data = table.read(names)
    except LogError as error:
        refusal = error
        for name in names:
            try:
                data |= table.read([name])
            except LogError as one:
                flaws.append(str(one))
    for name, values in [*data.items()]:
        if (missing := np.isnan(values)).any():
            place = table.place(int(np.argmax(missing)), name)
            rows = np.arange(len(values))
            flaws.append(f"{place}: {missing.sum()} of {len(values)} values are empty or nan")
            if missing.all():
                del data[name]
            else:
                data[name] = np.interp(rows, rows[~missing], values[~missing])
    if not data:
        raise refusal
    return data, flaws


@dataclass(frozen=True, eq=False)
class ArrayTable:
    """Columns of one length.

    Attributes:
        name: The file's path.
        data: Name → values, (N,) each.
        notes: What was left out.
        row: What the format calls a sample.
    """

    name: str
    data: Mapping[str, np.ndarray[Any, Any]]
    notes: Sequence[str] = ()
    row: str = "sample"

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns' names."""
        return tuple(self.data)

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns as float64, (N,) each; `LogError` names the first value that is infinite."""
        check_size(
            self.name,
            8 * len(columns) * sum(len(self.data[column]) for column in columns[:1]),
            LogError,
        )
        read: dict[str, Array] = {
            column: self.data[column].astype(np.float64, copy=False) for column in columns
        }
        for column, values in read.items():
            if not values.size:
                raise LogError(self.name, f"has no {self.row}s", "give a file with samples")
            if (wrong := np.isinf(values)).any():
                row = int(np.argmax(wrong))
                raise LogError(
                    self.place(row, column),
                    f"is {values[row]}",
                    "repair the value, or delete the row",
                )
        return read

    def place(self, row: int, column: str) -> str:
        """Return ``file sample S column 'name'``, samples counted from 1."""
        return f"{self.name} {self.row} {row + 1} column '{column}'"


class Stream(NamedTuple):
    """Columns sampled together.

    Attributes:
        time: Name of the column of their times, s; empty where that is unknown.
        columns: Name → values, (N,) each.
    """

    time: str
    columns: Mapping[str, np.ndarray[Any, Any]]


def make_table(name: str, streams: Sequence[Stream], notes: Sequence[str]) -> ColumnTable:
    """Return the table of a file of one or several streams, all by one clock; `LogError` if it holds nothing."""
    if not streams:
        raise LogError(
            name,
            "holds no columns of numbers",
            "give a file with one array per channel, a value a sample",
        )
    said = [f"{name}: {note}" for note in notes]
    if len(streams) == 1:
        return ArrayTable(name, streams[0].columns, said)
    parts = [ArrayTable(name, stream.columns) for stream in streams]
    return JoinedTable(name, parts, [stream.time for stream in streams], shared=True, notes=said)


def group_streams(arrays: Mapping[str, Any]) -> tuple[list[Stream], list[str]]:
    """Return the streams in nested named arrays, and what was left out.

    Samples lie along the dimension as long as an array of times, or else the longest. Arrays of another length are a
    stream of their own if one of them holds their times; so are those of a structure with its own times.
    """
    flat = {
        key: values for key, array in arrays.items() for key, values in _flatten_arrays(key, array)
    }
    flat = {
        key: values
        for key, values in flat.items()
        if values.ndim in (1, 2) and max(values.shape) > 1
    }
    times = {
        key: values
        for key, values in flat.items()
        if values.ndim == 1 and _find_time_name([key.rpartition(".")[2]])
    }
    groups: dict[tuple[int, bytes], dict[str, np.ndarray[Any, Any]]] = {}
    for key, values in flat.items():
        size = max(values.shape, key=lambda one: (one in map(len, times.values()), one))
        # Its times are those in its own structure, or in the nearest one around it.
        around = {name.rpartition(".")[0]: own for name, own in times.items() if len(own) == size}
        near = max(
            (place for place in around if not place or key.startswith(f"{place}.")),
            key=len,
            default=None,
        )
        clock = around[near] if near is not None else next(iter(around.values()), np.empty(0))
        group = groups.setdefault((size, clock.tobytes()), {})
        rows = values if values.shape[0] == size else values.T
        if rows.ndim == 1:
            group[key] = rows
        elif rows.shape[1] <= WIDEST_ARRAY:
            group |= {f"{key}[{k}]": rows[:, k] for k in range(rows.shape[1])}
    found = [
        Stream(_find_time_name(group) or "", group)
        for group in sorted(groups.values(), key=len, reverse=True)
    ]
    streams = [stream for stream in found if stream is found[0] or (stream.time and found[0].time)]
    lost = [key for stream in found if stream not in streams for key in stream.columns]
    return streams, [
        f"{quote_names(lost)} have other lengths than the rest and no times: left out"
    ] if lost else []


def _flatten_arrays(
    key: str, value: Any, depth: int = 0
) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield name and values of the arrays of real numbers in an array, a record array, a table or a list of them."""
    if depth > DEEPEST_NESTING:
        return
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flatten_arrays(f"{key}.{name}" if key else str(name), inner, depth + 1)
    elif (
        isinstance(value, list)
        and len(value) <= WIDEST_ARRAY
        and any(isinstance(inner, Mapping) for inner in value)
    ):
        for k, inner in enumerate(value):
            yield from _flatten_arrays(f"{key}[{k}]", inner, depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.names:
        for name in value.dtype.names:
            yield from _flatten_arrays(f"{key}.{name}" if key else name, value[name], depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        yield key, value.squeeze()


@dataclass(frozen=True, eq=False)
class JoinedTable:
    """Tables of one motion whose times are by one clock, interpolated at the times of one of them.

    Attributes:
        name: What errors call it.
        parts: The tables.
        times: Name of the column of each one's times.
        shared: Whether the tables are of one file, all times in s: ``t`` is then the time of whatever else is read
            first. The times of several files may be in several units.
        notes: What `read` left out to join them.
    """

    name: str
    parts: Sequence[ColumnTable]
    times: Sequence[str]
    shared: bool = False
    notes: list[str] = field(default_factory=list)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of all tables, each once, and ``t`` first where they are of one file."""
        names = [column for part in self.parts for column in part.columns]
        return tuple(dict.fromkeys(["t", *names] if self.shared else names))

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns, (N,) each, at those times of one table that the others' samples surround.

        That is the table of the first column of times among them, or with ``t`` that of the first other column.
        """
        virtual = self.shared and not any("t" in part.columns for part in self.parts)
        owner = {column: next(k for k, part in enumerate(self.parts) if column in part.columns)
                 for column in columns if not (virtual and column == "t")}  # fmt: skip
        first = next(
            (owner[column] for column in owner if column in self.times),
            next(iter(owner.values()), 0),
        )
        wanted = {
            k: [c for c in owner if owner[c] == k] for k in dict.fromkeys([first, *owner.values()])
        }
        read = {
            k: self.parts[k].read(list(dict.fromkeys([self.times[k], *of])))
            for k, of in wanted.items()
        }
        t = read[first][self.times[first]]
        joined = {column: read[first][column] for column in wanted[first]}
        kept = np.ones(len(t), dtype=bool)
        for k in list(wanted)[1:]:
            own = read[k][self.times[k]]
            scale = self._seconds(k, own) / self._seconds(first, t)
            own, at = np.unique(own if scale == 1.0 else own * scale, return_index=True)
            at = at[np.isfinite(own)]
            own = own[: len(at)]
            for column in wanted[k]:
                values = read[k][column][at]
                joined[column] = (
                    np.interp(t, own, np.nan_to_num(values))
                    if len(own)
                    else np.full(len(t), np.nan)
                )
                if np.isnan(values).any():
                    joined[column][np.interp(t, own, np.isnan(values)) > 0] = np.nan
            kept &= _is_surrounded(t, own)
        if not kept.any():
            raise LogError(
                self.name,
                "have no time in common",
                "give files whose times are by one clock, or join them first",
            )
        if not kept.all():
            self.notes.append(
                f"{self.name}: {np.sum(~kept)} of {len(t)} samples are left out: not all files have them"
            )
        return {column: joined.get(column, t)[kept] for column in columns}

    def _seconds(self, part: int, times: Array) -> float:
        """Return the seconds in one unit of a table's times, which may differ between files."""
        return 1.0 if self.shared else find_time_unit(self.times[part], times)[1]

    def place(self, row: int, column: str) -> str:
        """Return ``files sample S column 'name'``, joined samples counted from 1."""
        return f"{self.name} sample {row + 1} column '{column}'"


def _is_surrounded(t: Array, own: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Whether each of `t` is one of the increasing times `own`, or between two not over 10 median intervals apart."""
    same = np.isin(t, own)
    if len(own) < 2:
        return same
    after = np.clip(np.searchsorted(own, t), 1, len(own) - 1)
    near = own[after] - own[after - 1] <= 10.0 * np.median(np.diff(own))
    return same | (near & (t >= own[0]) & (t <= own[-1]))
