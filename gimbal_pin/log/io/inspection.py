"""What a log's file holds: its streams, their rates and flaws, what each column is, and a mapping to edit."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import yaml

from gimbal_pin.errors import LogError, UsageError, digits
from gimbal_pin.log.io.readers import open_table
from gimbal_pin.log.io.recognise import (
    Channel,
    Recognised,
    assign_columns,
    is_complete,
    recognise,
    required_columns,
)
from gimbal_pin.log.io.tables import (
    ColumnTable,
    JoinedTable,
    decode_columns,
    find_time,
    quote_names,
    read_numeric_columns,
)
from gimbal_pin.log.log import GAP_SAMPLES, SMALLEST_VALUE, Array
from gimbal_pin.log.mapping import ROW_COLUMN, format_expression
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig

_LONGEST_ENTRIES = 200
"""Most characters of a correction that an error prints: a message of 280 has room for the file and what it lacks."""


@dataclass(frozen=True, eq=False)
class InspectedStream:
    """Columns sampled together.

    Attributes:
        time: Name of the column of times.
        t: Times, s, (N,).
        data: Column → values, (N,) each.
        channels: What each column is.
    """

    time: str
    t: Array
    data: Mapping[str, Array]
    channels: tuple[Channel, ...]

    @property
    def facts(self) -> dict[str, Any]:
        """Samples, seconds, rate, gaps (intervals over 4.5 usual ones), repeated rows, times that do not increase."""
        steps = np.diff(self.t)
        rising = steps[steps > 0]
        usual = float(np.median(rising)) if len(rising) else 0.0
        rows = (
            np.column_stack(list(self.data.values())) if self.data else np.empty((len(self.t), 0))
        )
        same = (
            np.all(rows[1:] == rows[:-1], axis=1)
            if rows.shape[1]
            else np.zeros(len(steps), dtype=bool)
        )
        return {
            "samples": len(self.t),
            "seconds": float(np.ptp(self.t)) if len(self.t) else 0.0,
            "rate_hz": 1 / usual if usual else None,
            "gaps": int(np.sum(steps > GAP_SAMPLES * usual)) if usual else 0,
            "longest_interval_s": float(steps.max()) if len(steps) else None,
            "repeated_rows": int(same.sum()),
            "times_not_increasing": int(np.sum(steps <= 0)),
            "first_time_not_increasing": int(np.argmax(steps <= 0)) + 2
            if (steps <= 0).any()
            else None,
        }


@dataclass(frozen=True, eq=False)
class Inspected(Record):
    """A file, or several joined.

    Attributes:
        name: The file.
        rig: Name of the rig that the mapping is for, or None.
        streams: What was sampled together.
        mapping: Target → (column, factor, remark).
        missing: Targets that the rig's log needs and that were not found, or not with all of their factor.
        open: Target → (column, factor, remark) of the columns whose factor has to be filled in, in capitals.
        notes: What else is to be known.
    """

    name: str
    rig: str | None
    streams: tuple[InspectedStream, ...]
    mapping: Mapping[str, tuple[str, str, str]]
    missing: tuple[str, ...]
    open: Mapping[str, tuple[str, str, str]]
    notes: tuple[str, ...]

    ROWS: ClassVar[str] = "streams"
    __repr__ = brief

    @property
    def yaml(self) -> str:
        """The mapping as a file for ``--map``, each line with its reason; what is missing stands in comments."""
        lines = [
            f"# {self.name}: columns of a log of {self.rig}; look through, edit, and give with --map"
        ]
        entries = (
            (_format_entry(target, format_expression(*of[:2])), of[2])
            for target, of in self.mapping.items()
        )
        lines += [f"{entry}  # {remark}" for entry, remark in entries]
        by_row = f"; or, where samples are evenly spaced, {ROW_COLUMN}*SECONDS"
        lines += [
            f"# {_format_entry(t, format_expression(*of[:2]))}  # {of[2]}"
            for t, of in self.open.items()
        ]
        unknown = [target for target in self.missing if target not in self.open]
        lines += [
            f"# {target}: COLUMN*FACTOR  # not found{by_row if target == 't' else ''}"
            for target in unknown
        ]
        return "\n".join(" ".join(line.split("\n")) for line in lines) + "\n"

    def to_dict(self) -> dict[str, Any]:
        """Return what ``--json`` writes of a file."""
        return {
            "file": self.name,
            "streams": [
                {
                    "time": s.time,
                    **s.facts,
                    "channels": [channel.to_dict() for channel in s.channels],
                }
                for s in self.streams
            ],
            "mapping": {
                target: format_expression(*source[:2]) for target, source in self.mapping.items()
            },
            "missing": list(self.missing),
            "open": {
                target: format_expression(*source[:2]) for target, source in self.open.items()
            },
            "notes": list(self.notes),
        }


def inspect(path: Path, rig: Rig | None = None) -> Inspected:
    """Return what a file holds, and a mapping of its columns to a rig's if one is given.

    Raises:
        LogError, UsageError: The file cannot be read at all.
    """
    return inspect_table(open_table(path), rig)


def inspect_table(table: ColumnTable, rig: Rig | None = None) -> Inspected:
    """Return what an open file holds, see `inspect`."""
    notes: list[str] = list(table.notes)
    parts = list(table.parts) if isinstance(table, JoinedTable) else [table]
    pairs = [_inspect_stream(part, rig, notes) for part in parts]
    # The stream with the most joints' angles, or channels, gives the times; the others' channels are joined to it.
    pairs.sort(
        key=lambda pair: (
            -sum(name.startswith("q_") for name in pair[1].mapping),
            -len(pair[1].mapping),
        )
    )
    first = pairs[0][1]
    proposed = dict(pairs[0][1].mapping)
    if rig is not None and len(pairs) > 1:
        every = {
            channel.column: channel
            for _, found in reversed(pairs)
            for channel in found.channels[1:]
        }
        proposed = {target: first.mapping[target] for target in ("t",) if target in first.mapping}
        proposed |= assign_columns(every, rig)
    mapping = {target: of for target, of in proposed.items() if is_complete(of[1])}
    missing = (
        ()
        if rig is None
        else tuple(name for name in required_columns(rig, proposed) if name not in mapping)
    )
    if rig is not None and (
        absent := [j for j in rig.joints if not any(x.endswith(f"_{j}") for x in proposed)]
    ):
        notes += [
            f"no column of {quote_names(absent)}: held where the rig's angle is nearest to zero"
        ] * (len(absent) < rig.n)
    unfilled = {target: of for target, of in proposed.items() if target not in mapping}
    streams = tuple(stream for stream, _ in pairs)
    return Inspected(
        table.name,
        None if rig is None else rig.name,
        streams,
        mapping,
        missing,
        unfilled,
        tuple(notes),
    )


def propose_entries(table: ColumnTable, rig: Rig, missing: Sequence[str]) -> str:
    """Return the correction of a log without some columns: the ``--map`` entries that add them, or how to get them.

    Of a column that is not found, or of a factor that no log holds, a part in capitals is left to fill in. Empty where
    the file tells nothing.
    """
    try:
        found = inspect_table(table, rig)
    except (LogError, UsageError):
        return ""
    proposed = {**found.open, **found.mapping}
    wanted = [target for target in missing if target in required_columns(rig, proposed)] or list(
        missing
    )
    if not any(target in proposed for target in wanted):
        return ""
    by_row = {"t": (ROW_COLUMN, "SECONDS", "")}
    sources = (
        (target, proposed.get(target, by_row.get(target, ("COLUMN", "FACTOR", ""))))
        for target in wanted
    )
    entries = [
        shlex.quote(f"{target}={format_expression(*source[:2])}") for target, source in sources
    ]
    text = "add " + " ".join(f"--map {entry}" for entry in entries)
    if len(text) <= _LONGEST_ENTRIES:
        return text
    return (
        "write a mapping with gimbal-pin inspect LOG --rig RIG --yaml map.yaml, look "
        "through it, and add --map map.yaml"
    )


def _inspect_stream(
    table: ColumnTable, rig: Rig | None, notes: list[str]
) -> tuple[InspectedStream, Recognised]:
    """Return a table's columns and what they are; `notes` takes a sentence on each flaw."""
    data, flaws = read_numeric_columns(table)
    notes += flaws
    # What no column holds must not overflow: since 1970 there are 2e18 ns, in a day at 1e5 rad/s 2e14 counts.
    bounded = {name: np.clip(values, -1e30, 1e30) for name, values in data.items()}
    data = {
        name: np.where(np.abs(values) < SMALLEST_VALUE, 0.0, values)
        for name, values in bounded.items()
    }
    if odd := [name for name in data if "'" in name and '"' in name]:
        notes.append(f"{table.name}: no mapping can name {quote_names(odd)}; rename them")
        data = {name: values for name, values in data.items() if name not in odd}
    try:
        time = find_time(table)
    except UsageError as error:
        notes.append(str(error))
        time = ROW_COLUMN
    if time not in data:
        time = ROW_COLUMN
        data[ROW_COLUMN] = np.arange(len(next(iter(data.values()))), dtype=np.float64)
    data = decode_columns(table.name, time, data, notes)
    found = recognise(time, data, rig)
    return InspectedStream(
        time, data.pop(time) * found.scale, data, found.channels[time == ROW_COLUMN :]
    ), found


def _format_entry(target: str, text: str) -> str:
    """Return one line of YAML."""
    return str(yaml.safe_dump({target: text}, width=10**9, allow_unicode=True)).rstrip("\n")


def summarize_stream(stream: InspectedStream) -> Sequence[str]:
    """Return sentences on a stream's samples."""
    facts = stream.facts
    rate = "" if facts["rate_hz"] is None else f", {digits(facts['rate_hz'], 4)} Hz"
    said = [
        f"{facts['samples']} samples in {digits(facts['seconds'], 4)} s by '{stream.time}'{rate}"
    ]
    if facts["gaps"]:
        said.append(
            f"gaps: {facts['gaps']}, the longest interval {digits(facts['longest_interval_s'], 3)} s"
        )
    if facts["times_not_increasing"]:
        where = facts["first_time_not_increasing"]
        count = facts["times_not_increasing"]
        said.append(f"times that do not increase: {count}, the first at sample {where}")
    if facts["repeated_rows"]:
        said.append(
            f"rows that repeat the one before in all but their time: {facts['repeated_rows']}"
        )
    return said
