"""What a file format has to offer, and how its columns become channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.io.mapping import Source
from gimbal_pin.log import Array, Log

JOINT_COLUMNS = {"q": "q", "v": "dq", "tau": "tau", "q_ref": "q_ref", "temperature": "temp"}
"""Attribute of `Log` → prefix of its columns, in the CONTRACT's order."""

IMU_COLUMNS = {"gyro": "xyz", "accel": "xyz", "quat": "wxyz"}
"""Attribute of `Imu` (and prefix of its columns) → its axes."""


MOST = 24
"""Names in a list of an error."""


class Table(Protocol):
    """A file's named columns of numbers, read on demand."""

    @property
    def name(self) -> str:
        """The file, as errors name it."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The names in the file's header; '' where one is missing."""

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns, (N,) each, N > 0, finite; `LogError` names the first place that is no number."""

    def place(self, row: int, column: str) -> str:
        """Return where a value stands: file, line or row, and column."""


@dataclass(frozen=True)
class Format:
    """One file format.

    Attributes:
        open: Reads what is needed to know a file's columns.
        write: Writes columns to a file, whole or not at all; None for formats that are only read.
    """

    open: Callable[[Path], Table]
    write: Callable[[Mapping[str, Array], Path], None] | None = None


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


def read_groups(table: Table, groups: Mapping[str, Group], sources: Mapping[str, Source]) -> dict[str, Array]:
    """Return key → (N, k) array of each group that the table holds, scaled to SI; ``t`` among them increases.

    Raises:
        LogError: A column is missing or there twice, a value is no number, or time does not increase.
    """
    known = {**{column: Source(column) for column in table.columns}, **sources}
    present = {c: known[c] for group in groups.values() for c in group.columns if c in known}
    check_header(table, groups, present)
    raw = table.read(list(dict.fromkeys(source.column for source in present.values())))
    arrays = {}
    for key, group in groups.items():
        if group.columns[0] in present:
            named = [present[column] for column in group.columns]
            arrays[key] = np.column_stack([raw[source.column] * source.factor for source in named])
    check_time(arrays["t"][:, 0], table, present["t"].column)
    return arrays


def check_header(table: Table, groups: Mapping[str, Group], present: Mapping[str, Source]) -> None:
    """Raise `LogError` unless the header can serve: sources exist once, required groups are there, none is in part."""
    for source in present.values():
        check_source(table, source)
    missing = [c for group in groups.values() if group.required for c in group.columns if c not in present]
    if missing:
        what = f"has no column {listed(missing)} (its columns: {listed(table.columns)})"
        raise LogError(table.name, what, f"name the columns so, or map them: --map {missing[0]}=COLUMN[*FACTOR]")
    for group in groups.values():
        absent = [column for column in group.columns if column not in present]
        if absent and len(absent) < len(group.columns):
            there = next(column for column in group.columns if column in present)
            mend = "give the whole group or none of it: rename, delete or --map a column"
            raise LogError(table.name, f"has column '{there}' but not {listed(absent)}", mend)


def check_source(table: Table, source: Source) -> None:
    """Raise `LogError` unless the table has the source's column exactly once."""
    count = table.columns.count(source.column)
    if count == 0:
        what = f"has no column '{source.column}', which {source.place} names (its columns: {listed(table.columns)})"
        raise LogError(table.name, what, "map from a column that is there")
    if count > 1:
        raise LogError(table.name, f"has {count} columns '{source.column}'", "rename all but one in the header")


def check_time(t: Array, table: Table, column: str) -> None:
    """Raise `LogError` at the first sample whose time is not later than the one before."""
    late = np.diff(t) <= 0
    if late.any():
        row = int(np.argmax(late)) + 1
        before, now = float(t[row - 1]), float(t[row])
        parts = (f"time goes back from {before!r} to {now!r} s", "sort the rows, or split the file there")
        if now == before:
            parts = (f"time {now!r} s repeats the row before", "delete one of the two rows, or write more digits")
        raise LogError(table.place(row, column), *parts)


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
