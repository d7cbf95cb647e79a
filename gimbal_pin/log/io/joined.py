"""Several tables as one: columns of the others at the first's times, clocks that differ brought together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log.clocks import offset_between
from gimbal_pin.log.io.base import Table, readable
from gimbal_pin.log.log import Array
from gimbal_pin.log.recognise import measured_motion, time_unit
from gimbal_pin.rig.naming import words

TIMES = ("t", "time", "timestamp", "timestamps", "stamp", "tout", "times", "seconds", "sec", "zeit")
"""Words of which one stands in the name of a column of times."""
TORN = 10.0
"""Median intervals of a table from which on there is nothing between two of its samples: what a line would invent."""


def time_in(names: Iterable[str]) -> str | None:
    """Return the name that is a time's: the first of those that hold one of `TIMES` and the fewest other words."""
    found = [(len(split), k, name) for k, name in enumerate(names) if set(split := words(name)) & set(TIMES)]
    return min(found)[2] if found else None


def time_of(table: Table) -> str:
    """Return the column of a table's times, by its name, or else the first column if that increases."""
    if (name := time_in(table.columns)) is not None:
        return name
    first = table.columns[0]
    if (np.diff(table.read([first])[first]) > 0).all():
        return first
    mend = "name the column of its times t in the header"
    raise UsageError(table.name, "has no column that is called time, and its first does not increase", mend)


@dataclass(frozen=True, eq=False)
class JoinedTable:
    """Tables of one motion.

    Attributes:
        name: What errors call it.
        parts: The tables.
        times: Name of the column of each one's times.
        shared: Whether one clock gave all times; ``t`` is then the time of whatever else is read first.
        notes: What was done to join them, as `read` did it.
    """

    name: str
    parts: Sequence[Table]
    times: Sequence[str]
    shared: bool = False
    notes: list[str] = field(default_factory=list)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of all tables, each once."""
        names = [column for part in self.parts for column in part.columns]
        return tuple(dict.fromkeys(["t", *names] if self.shared else names))

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns, (N,) each, at the times of the first table of them that another's samples surround.

        That is the table of the first column of times among them, or with ``t`` that of the first other column.
        """
        owner = {column: next(k for k, part in enumerate(self.parts) if column in part.columns)
                 for column in columns if not self.virtual(column)}  # fmt: skip
        first = next((owner[column] for column in owner if column in self.times), next(iter(owner.values()), 0))
        asked = {k: [c for c in owner if owner[c] == k] for k in dict.fromkeys([first, *owner.values()])}
        read = {k: self.parts[k].read(list(dict.fromkeys([self.times[k], *of]))) for k, of in asked.items()}
        t = read[first][self.times[first]]
        joined = {column: read[first][column] for column in asked[first]}
        kept = np.ones(len(t), dtype=bool)
        for k in list(asked)[1:]:
            scale, shift = self.clock(first, k)
            own, at = np.unique(read[k][self.times[k]] * scale + shift, return_index=True)
            at = at[np.isfinite(own)]
            joined |= {column: on_line(t, own[: len(at)], read[k][column][at]) for column in asked[k]}
            kept &= between(t, own[: len(at)])
        if not kept.any():
            raise LogError(self.name, "have no time in common", "give files of one recording, times in the same unit")
        if not kept.all():
            self.notes.append(f"{self.name}: {np.sum(~kept)} of {len(t)} samples are left out: not all files have them")
        return {column: joined.get(column, t)[kept] for column in columns}

    def virtual(self, column: str) -> bool:
        """Tell whether a column is the time of whatever is read, and of no table."""
        return self.shared and column == "t" and not any("t" in part.columns for part in self.parts)

    def clock(self, first: int, other: int) -> tuple[float, float]:
        """Return factor and offset that turn another table's times into the first's; tell the offset in `notes`.

        Of tables whose times are of one clock only what is measured of the motion counts: what was asked for comes
        before it, and a torque's lag is the drive's.
        """
        pair = [(self.parts[k], self.times[k]) for k in (first, other)]
        data = [readable(part)[0] for part, _ in pair]
        if any(name not in one for one, (_, name) in zip(data, pair)):
            return 1.0, 0.0  # a table without times has none in common
        times = [one.pop(name) for one, (_, name) in zip(data, pair)]
        scale, its = (1.0, 1.0) if self.shared else (time_unit(name, t)[1] for t, (_, name) in zip(times, pair))
        factor = 1.0 if its == scale else its / scale
        if self.shared:
            data = [{name: x for name, x in one.items() if measured_motion(name, x)} for one in data]
        found = offset_between(times[0] * scale, data[0], times[1] * its, data[1])
        if found.seconds or not self.shared:
            self.notes.append(f"{pair[1][1] if self.shared else pair[1][0].name}: {found.sentence}")
        return factor, found.seconds / scale

    def place(self, row: int, column: str) -> str:
        """Return ``files sample S column 'name'``, joined samples counted from 1."""
        return f"{self.name} sample {row + 1} column '{column}'"


def on_line(t: Array, own: Array, values: Array) -> Array:
    """Return the values at the times `t`; nan where one beside them is."""
    if not len(own):
        return np.full(len(t), np.nan)
    return np.where(np.interp(t, own, np.isnan(values)) > 0, np.nan, np.interp(t, own, np.nan_to_num(values)))


def between(t: Array, own: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Tell which of the times `t` lie between two of the increasing times `own` that no hole parts, or on one."""
    after = np.clip(np.searchsorted(own, t), 1, max(len(own) - 1, 1))
    if len(own) < 2:
        return np.isin(t, own)
    width = own[after] - own[after - 1]
    near = (width <= TORN * np.median(np.diff(own))) | np.isin(t, own)
    return near & (t >= own[0]) & (t <= own[-1])
