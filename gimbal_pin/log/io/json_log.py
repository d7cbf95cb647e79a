"""Logs in JSON: a list of records, lists of values by column, or a record a line."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.joint_states import JOINT_STATE_FIELDS, list_joint_values
from gimbal_pin.log.io.stamps import is_stamp, parse_stamps
from gimbal_pin.log.io.tables import (
    DEEPEST_NESTING,
    WIDEST_ARRAY,
    ColumnTable,
    Stream,
    group_streams,
    make_table,
)
from gimbal_pin.rig.reading import read_bytes

_LARGEST_JSON = 2**28
"""Largest JSON file, bytes: its values take ten times as much memory while it is read."""
_SECONDS_AND_NANOSECONDS = (("sec", "nanosec"), ("secs", "nsecs"))
"""Keys of a time of ROS."""


def open_json(path: Path) -> ColumnTable:
    """Read the columns of a JSON file; those of a structure as ``structure.name``, unless it is the only one.

    Dates and times of day become seconds, joint states of ROS columns by their names; other texts are left out.

    Raises:
        LogError: It is no JSON, too large, nested too deep, or holds no columns of numbers.
    """
    try:
        value, notes = _parse(read_bytes(path, LogError, _LARGEST_JSON).decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise LogError(str(path), "is no JSON in UTF-8", "write it again") from error
    except json.JSONDecodeError as error:
        raise LogError(
            f"{path}:{error.lineno}", f"is not JSON ({error.msg})", "write it again, or correct it"
        ) from error
    except RecursionError as error:
        raise LogError(
            str(path), "is nested too deep", "give a list of records, or of values by column"
        ) from error
    columns = _to_columns(value)
    streams, left = group_streams(columns if isinstance(columns, dict) else {"": columns})
    return make_table(str(path), _strip_container(streams), [*notes, *left])


def _parse(text: str) -> tuple[Any, list[str]]:
    """Return a JSON text's value and notes: of a value a line the list of them, without a last one that was cut off."""
    try:
        return json.loads(text), []
    except json.JSONDecodeError as error:
        if error.lineno == 1 or error.msg != "Extra data":
            raise
    lines = text.splitlines()
    values = []
    for number, line in enumerate(lines, start=1):
        try:
            values += [json.loads(line)] if line.strip() else []
        except json.JSONDecodeError as error:
            if number == len(lines):
                return values, [f"line {number} is cut off and left out"]
            raise json.JSONDecodeError(
                f"line {number}: {error.msg}", text, text.find(line)
            ) from error
    return values, []


def _to_columns(value: Any, depth: int = 0) -> Any:
    """Return nested tables of columns, (N,), in a JSON value; None where it holds no numbers."""
    if depth > DEEPEST_NESTING:
        return None
    if isinstance(value, dict):
        inner = {key: _to_columns(each, depth + 1) for key, each in value.items()}
        return {key: each for key, each in inner.items() if each is not None}
    if not isinstance(value, list) or not value:
        return None
    if isinstance(value[0], dict):
        return _stack_records([record for record in value if isinstance(record, dict)])
    return _to_array(value)


def _stack_records(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return column → values, (N,), of records, nan where one lacks a value."""
    import pandas

    table = pandas.DataFrame([dict(_flatten(record)) for record in records], dtype=object)
    arrays = {name: _to_array(table[name].tolist()) for name in table}
    return {
        name: array
        for name, array in arrays.items()
        if array is not None and not np.isnan(array).all()
    }


def _flatten(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield ``key.key`` and ``key[k]`` of the numbers and texts in a record."""
    if isinstance(value, dict) and depth < DEEPEST_NESTING:
        for whole, fraction in _SECONDS_AND_NANOSECONDS:
            if {whole, fraction} == value.keys() and all(
                isinstance(x, (int, float)) for x in value.values()
            ):
                yield name or "t", value[whole] + 1e-9 * value[fraction]
                return
        lists = {
            field: value[field]
            for field in ("name", *JOINT_STATE_FIELDS)
            if isinstance(value.get(field), list)
        }
        is_state = bool(lists.get("name")) and "position" in lists
        if is_state:
            yield from list_joint_values(lists["name"], lists)
        for key, inner in value.items():
            if not (is_state and key in lists):
                yield from _flatten(inner, f"{name}.{key}" if name else key, depth + 1)
    elif isinstance(value, list) and len(value) <= WIDEST_ARRAY and depth < DEEPEST_NESTING:
        for k, inner in enumerate(value):
            yield from _flatten(inner, f"{name}[{k}]", depth + 1)
    elif isinstance(value, (int, float, str)) and name:
        yield name, value


def _to_array(values: Sequence[Any]) -> np.ndarray[Any, Any] | None:
    """Return numbers, nan for null, or times of day and dates in seconds, (N,); None of anything else."""
    present = [value for value in values if value is not None and value == value]
    kinds = set(map(type, present))
    if kinds == {str} and all(map(is_stamp, present)):
        return parse_stamps(values)
    if kinds <= {bool, int, float}:
        with suppress(OverflowError):
            return np.array(values, dtype=np.float64)
    return None


def _strip_container(streams: Sequence[Stream]) -> list[Stream]:
    """Return streams without the name of the structure that all columns stand in, such as ``entries.``."""
    heads = {
        name.partition(".")[0] if "." in name else ""
        for stream in streams
        for name in stream.columns
    }
    if len(heads) != 1 or heads == {""}:
        return list(streams)
    size = len(heads.pop()) + 1
    return [
        Stream(s.time[size:], {name[size:]: x for name, x in s.columns.items()}) for s in streams
    ]
