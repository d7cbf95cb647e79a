"""What a file format has to offer, and how its columns become channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.mapping import Source
from gimbal_pin.log.log import REACH, SOONEST, Array, Log, implausible, untimely
from gimbal_pin.rig.naming import ROW

Rows: TypeAlias = NDArray[np.integer[Any]]
JOINT_COLUMNS = {"q": "q", "v": "dq", "tau": "tau", "q_ref": "q_ref", "temperature": "temp"}
"""Attribute of `Log` → prefix of its columns, in the CONTRACT's order."""

IMU_COLUMNS = {"gyro": "xyz", "accel": "xyz", "quat": "wxyz"}
"""Attribute of `Imu` (and prefix of its columns) → its axes."""


MOST = 24
"""Names in a list of an error."""
LOST = 0.1
"""Share of the rows that may be left out: of a column of another rate every second value or more is missing, of what a
recorder loses, or repeats before it begins, far less."""


class Table(Protocol):
    """A file's named columns of numbers, read on demand."""

    @property
    def name(self) -> str:
        """The file, as errors name it."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The names in the file's header; '' where one is missing."""

    @property
    def notes(self) -> Sequence[str]:
        """Sentences on what was left out or changed to make the columns; those of `read` once it is done."""

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns, (N,) each, N > 0, nan where one is missing; `LogError` names what is no number."""

    def place(self, row: int, column: str) -> str:
        """Return where a value stands: file, line or row, and column."""


@dataclass(frozen=True)
class Format:
    """One file format.

    Attributes:
        open: Reads what is needed to know a file's columns.
        write: Writes columns to a file, whole or not at all; None for formats that are only read.
        magic: How its files begin, where that tells them from all others.
    """

    open: Callable[[Path], Table]
    write: Callable[[Mapping[str, Array], Path], None] | None = None
    magic: tuple[bytes, ...] = ()


@dataclass(frozen=True)
class Group:
    """Columns that stand together: a file has all of them or none.

    Attributes:
        columns: Names as in the CONTRACT.
        required: Whether a file without them is refused.
    """

    columns: tuple[str, ...]
    required: bool = False


def joint_group(prefix: str, joints: Sequence[str], required: bool = False) -> Group:
    """Return the group of one quantity over all joints."""
    return Group(tuple(f"{prefix}_{joint}" for joint in joints), required)


def imu_groups(link: str) -> dict[str, Group]:
    """Return ``<attribute>_<link>`` → group of an IMU fixed to `link`."""
    axes = IMU_COLUMNS.items()
    return {f"{kind}_{link}": Group(tuple(f"{kind}_{link}_{axis}" for axis in names)) for kind, names in axes}


def log_groups(joints: Sequence[str], links: Sequence[str], need_tau: bool) -> dict[str, Group]:
    """Return key → group of everything that a log of these joints and links may hold."""
    required = ("q", "tau") if need_tau else ("q",)
    groups = {"t": Group(("t",), True)}
    groups |= {key: joint_group(prefix, joints, key in required) for key, prefix in JOINT_COLUMNS.items()}
    for link in links:
        groups |= imu_groups(link)
    return groups


def columns_of(groups: Mapping[str, Group], place: str) -> tuple[str, ...]:
    """Return all groups' columns; `LogError` if two channels claim one name (joints `a` and `ref_a`: `q_ref_a`)."""
    names = [column for group in groups.values() for column in group.columns]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise LogError(place, f"two of its channels would be called '{twice[0]}'", "rename the joint in the URDF")
    return tuple(names)


def read_groups(
    table: Table, groups: Mapping[str, Group], sources: Mapping[str, Source], notes: list[str] | None = None
) -> dict[str, Array]:
    """Return key → (N, k) array of each group that the table holds, scaled to SI; ``t`` among them increases.

    Args:
        table: What is read.
        groups: Key → columns.
        sources: Target → column that a mapping names.
        notes: Takes what is told of the rows that are left out, see `whole`; None: none is.

    Raises:
        LogError: A column is missing or there twice, a value is no number or no machine's, or time does not increase.
    """
    known = {**{column: Source(column) for column in table.columns}, **sources}
    present = {c: known[c] for group in groups.values() for c in group.columns if c in known}
    check_header(table, groups, present)
    wanted = [c for c in dict.fromkeys(source.column for source in present.values()) if c in table.columns]
    raw = table.read(wanted or table.columns[:1])
    raw.setdefault(ROW, np.arange(len(next(iter(raw.values()))), dtype=np.float64))
    for group in groups.values():
        if notes is not None and not group.required and group.columns[0] in present:
            sparse = [c for c in group.columns if np.isnan(raw[present[c].column]).mean() > LOST]
            if sparse:
                notes.append(f"{table.name}: {listed(sparse)} are mostly empty or nan: left out")
                present = {c: source for c, source in present.items() if c not in group.columns}
    kept = whole(table, {source.column: raw[source.column] for source in present.values()}, present["t"], notes)
    arrays = {}
    for key, group in groups.items():
        if group.columns[0] in present:
            named = [present[column] for column in group.columns]
            with np.errstate(over="ignore"):  # what overflows is told beneath
                arrays[key] = np.column_stack([raw[source.column][kept] * source.factor for source in named])
            check_values(key, arrays[key], table, named, kept)
    if (late := untimely(arrays["t"][:, 0])) is not None:
        raise LogError(table.place(int(kept[late[0]]), present["t"].column), *late[1:])
    return arrays


def whole(table: Table, raw: Mapping[str, Array], time: Source, notes: list[str] | None) -> Rows:
    """Return the rows that hold every value, from where time goes on without repeating itself or going back.

    Told in `notes`; `LogError` at the first missing value where these are more than `LOST` of the rows, or may not be.
    """
    count = len(raw[time.column])
    missing = {column: np.isnan(values) for column, values in raw.items()}
    full = np.flatnonzero(~np.any(list(missing.values()), axis=0))
    most = LOST * count if notes is not None else 0
    if len(full) < count:
        column, row = min(((c, int(np.argmax(x))) for c, x in missing.items() if x.any()), key=lambda one: one[1])
        place = table.place(row, column)
        if count - len(full) > most:
            what = f"is empty or nan, and {count - len(full)} of {count} rows lack a value"
            raise LogError(place, what, "fill it in or delete the row; put columns of another rate into a.csv+b.csv")
        assert notes is not None
        notes.append(f"{place}: is empty or nan: {count - len(full)} of {count} rows lack a value and are left out")
    stays = np.flatnonzero(np.diff(raw[time.column][full]) * time.factor < SOONEST)
    begin = int(stays[-1]) + 1 if len(stays) else 0
    if 0 < begin <= most:
        assert notes is not None
        place = table.place(int(full[begin]), time.column)
        notes.append(f"{place}: time goes on from here; what stands before, {begin} of {count} rows, is left out")
        full = full[begin:]
    return full


def readable(table: Table) -> tuple[dict[str, Array], list[str]]:
    """Return the columns of a table that hold numbers, (N,) each, and why the others do not; holes lie on a line.

    Raises:
        LogError: None does.
    """
    names = [name for name in dict.fromkeys(table.columns) if table.columns.count(name) == 1]
    data, flaws, last = dict[str, Array](), list[str](), None
    try:
        data = table.read(names)
    except LogError as error:
        last = error
    for name in names if last is not None else ():
        try:
            data |= table.read([name])
        except LogError as error:
            flaws.append(str(error))
    for name, values in [*data.items()]:
        if (missing := np.isnan(values)).any():
            place, rows = table.place(int(np.argmax(missing)), name), np.arange(len(values))
            flaws.append(f"{place}: {missing.sum()} of {len(values)} values are empty or nan")
            if missing.all():
                del data[name]
            else:
                data[name] = np.interp(rows, rows[~missing], values[~missing])
    if not data:
        raise last or LogError(table.name, "holds no numbers", "give a file with samples")
    return data, flaws


def check_values(key: str, values: Array, table: Table, sources: Sequence[Source], rows: Rows) -> None:
    """Raise `LogError` at the first value, (N, k) at the table's `rows`, that this channel has on no machine."""
    channel = key if key in REACH else key.split("_")[0]
    if (wrong := implausible(channel, values)) is not None:
        row, column, what, mend = wrong
        raise LogError(table.place(int(rows[row]), sources[column].column), what, mend)


def check_header(table: Table, groups: Mapping[str, Group], present: Mapping[str, Source]) -> None:
    """Raise `LogError` unless the header can serve: sources exist once, required groups are there, none is in part."""
    for source in present.values():
        check_source(table, source)
    missing = [c for group in groups.values() if group.required for c in group.columns if c not in present]
    if missing:
        what = f"has no column {listed(missing)} (its columns: {listed(table.columns)})"
        mend = f"name the columns so, or map them: --map {missing[0]}=COLUMN[*FACTOR]"
        raise LogError(table.name, what, mend + f" or t={ROW}*SECONDS" * (missing[0] == "t"))
    for group in groups.values():
        absent = [column for column in group.columns if column not in present]
        if absent and len(absent) < len(group.columns):
            there = next(column for column in group.columns if column in present)
            mend = "give the whole group or none of it: rename, delete or --map a column"
            raise LogError(table.name, f"has column '{there}' but not {listed(absent)}", mend)


def check_source(table: Table, source: Source) -> None:
    """Raise `LogError` unless the table has the source's column exactly once."""
    count = table.columns.count(source.column)
    if count == 0 and source.column != ROW:
        what = f"has no column '{source.column}', which {source.place} names (its columns: {listed(table.columns)})"
        raise LogError(table.name, what, "map from a column that is there")
    if count > 1:
        raise LogError(table.name, f"has {count} columns '{source.column}'", "rename all but one in the header")


def listed(names: Sequence[str]) -> str:
    """Return the names between quotes, of a long list the first `MOST`."""
    text = ", ".join(f"'{name}'" for name in names[:MOST])
    return text if len(names) <= MOST else f"{text}, … {len(names)} in all"


def log_columns(log: Log) -> dict[str, Array]:
    """Return column → (N,) values of everything in a log, in the CONTRACT's order."""
    columns = {"t": log.t}
    for attribute, prefix in JOINT_COLUMNS.items():
        if (values := getattr(log, attribute)) is not None:
            columns |= zip(joint_group(prefix, log.joints).columns, values.T)
    for link, imu in log.imus.items():
        groups = imu_groups(link)
        for name, values in imu.channels.items():
            columns |= zip(groups[f"{name}_{link}"].columns, values.T)
    return columns
