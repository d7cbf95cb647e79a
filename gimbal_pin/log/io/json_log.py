"""Logs in JSON: a list of records, lists of values by column, or a record a line."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.joint_states import JOINT_STATE_FIELDS, list_joint_values
from gimbal_pin.log.io.stamps import is_stamp, parse_stamps
from gimbal_pin.log.io.tables import DEEPEST_NESTING, WIDEST_ARRAY, ColumnTable, Stream, group_streams, make_table
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
        raise LogError(str(path), "is nested too deep", "give a list of records, or of values by column") from error
    columns = _to_columns(value)
    streams, left = group_streams(columns if isinstance(columns, dict) else {"": columns})
    return make_table(str(path), _strip_container(streams), [*notes, *left])


def _parse(text: str) -> tuple[Any, list[str]]:
    """Return a JSON text's value and notes: of a value a line the list of them, without a last one that was cut off."""
    try:
        return json.loads(text), []
    except json.JSONDecodeError as error:
        lines = text.splitlines()
        whole = error.lineno > 1 and error.msg == "Extra data" and error.lineno <= len(lines)
        if not whole:
            raise
    values = []
    for number, line in enumerate(lines, start=1):
        try:
            values += [json.loads(line)] if line.strip() else []
        except json.JSONDecodeError as error:
            if number == len(lines):
                return values, [f"line {number} is cut off and left out"]
            raise json.JSONDecodeError(f"line {number}: {error.msg}", text, text.find(line)) from error
    return values, []


def _to_columns(value: Any, depth: int = 0) -> Any:
    """Return nested tables of arrays, (N,) or (N, k), in a JSON value; None where it holds no numbers."""
    if depth > DEEPEST_NESTING:
        return None
    if isinstance(value, dict):
        if isinstance(value.get("columns"), list) and isinstance(value.get("data"), list):  # pandas' "split"
            return _to_columns([dict(zip(map(str, value["columns"]), row)) for row in value["data"]], depth + 1)
        if value and all(key.isdecimal() for key in value):  # pandas' default: value by row, of a column or a record
            return _to_columns(list(value.values()), depth + 1)
        inner = {key: _to_columns(each, depth + 1) for key, each in value.items()}
        return {key: each for key, each in inner.items() if each is not None}
    if not isinstance(value, list) or not value:
        return None
    if isinstance(value[0], dict):
        return _stack_records([record for record in value if isinstance(record, dict)])
    if isinstance(value[0], list):
        rows = [row for row in value if isinstance(row, list) and len(row) == len(value[0]) <= WIDEST_ARRAY]
        return _stack_records([{f"c{k}": x for k, x in enumerate(row)} for row in rows])
    return _to_array(value)


def _stack_records(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return column → values, (N,), of records, nan where one lacks a value."""
    columns: dict[str, list[Any]] = {}
    for row, record in enumerate(records):
        for name, value in _flatten(record):
            values = columns.setdefault(name, [])
            values += [None] * (row - len(values)) + [value]
    full = {name: [*values, *[None] * (len(records) - len(values))] for name, values in columns.items()}
    arrays = {name: _to_array(values) for name, values in full.items()}
    return {name: array for name, array in arrays.items() if array is not None and not np.isnan(array).all()}


def _flatten(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield ``key.key`` and ``key[k]`` of the numbers and texts in a record."""
    if isinstance(value, dict) and depth < DEEPEST_NESTING:
        for whole, fraction in _SECONDS_AND_NANOSECONDS:
            if {whole, fraction} == value.keys() and all(isinstance(x, (int, float)) for x in value.values()):
                yield name or "t", value[whole] + 1e-9 * value[fraction]
                return
        joints = names if isinstance(names := value.get("name"), list) else []
        is_state = bool(joints) and isinstance(value.get("position"), list)
        if is_state:
            fields = {field: value.get(field) or () for field in JOINT_STATE_FIELDS}
            yield from list_joint_values(joints, {field: [_or_nan(x) for x in each] for field, each in fields.items()})
        for key, inner in value.items():
            if not (is_state and key in ("name", *JOINT_STATE_FIELDS)):
                yield from _flatten(inner, f"{name}.{key}" if name else key, depth + 1)
    elif isinstance(value, list) and len(value) <= WIDEST_ARRAY and depth < DEEPEST_NESTING:
        for k, inner in enumerate(value):
            yield from _flatten(inner, f"{name}[{k}]", depth + 1)
    elif isinstance(value, (int, float, str)) and name:
        yield name, value


def _or_nan(value: Any) -> float:
    """Return a number, nan for anything else."""
    return float(value) if isinstance(value, (int, float)) else np.nan


def _to_array(values: Sequence[Any]) -> np.ndarray[Any, Any] | None:
    """Return numbers, nan for null, or times of day and dates in seconds, (N,); None of anything else."""
    texts = [value for value in values if isinstance(value, str)]
    if texts:
        if not all(isinstance(value, str) or value is None for value in values) or not all(map(is_stamp, texts)):
            return None
        return parse_stamps([value or "" for value in values])
    if not all(value is None or isinstance(value, (int, float)) for value in values):
        return None
    try:
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    except OverflowError:
        return None


def _strip_container(streams: Sequence[Stream]) -> list[Stream]:
    """Return streams without the name of the structure that all columns stand in, such as ``entries.``."""
    heads = {name.partition(".")[0] if "." in name else "" for stream in streams for name in stream.columns}
    if len(heads) != 1 or heads == {""}:
        return list(streams)
    size = len(heads.pop()) + 1
    return [Stream(s.time[size:], {name[size:]: x for name, x in s.columns.items()}) for s in streams]
