"""Which logs make up a fleet: a manifest in YAML, Parquet or CSV beside them, or the folder's logs by themselves."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.fleet.engine import check_installed, file_system
from gimbal_pin.log.io.readers import FORMATS, files_of
from gimbal_pin.log.mapping import read_mapping
from gimbal_pin.rig.files import bundled_payloads, bundled_rigs
from gimbal_pin.rig.reading import LARGEST_TEXT, check_size, parse_decimal, read_bytes, read_yaml
from gimbal_pin.rig.records import bounded_field, read_record

MANIFESTS = ("manifest.yaml", "manifest.yml", "manifest.parquet", "manifest.csv")
WHOLE = ("rig", "payload", "cutoff")
"""What a table states in columns though it holds for all of its logs."""


@dataclass(frozen=True)
class FleetLog:
    """One log of a fleet.

    Attributes:
        path: Absolute path or URL.
        unit: Serial number of the rig that it is of.
        time: When it was taken, s since 1970 or whatever the manifest counts in; its place where that says nothing.
        taken: The same as the manifest states it, or the log's name.
        mapping: Its columns: target → expression, as in `read_log`.
    """

    path: str
    unit: str
    time: float
    taken: str
    mapping: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest:
    """A fleet's logs and their rig.

    Attributes:
        place: Folder or URL.
        logs: The logs.
        rig: Bundled name or absolute path; None: not stated.
        payload: Bundled name or absolute path; None: the rig's own.
        cutoff: Of the identification's filter, Hz; None: the usual one.
        is_dated: Whether the logs' times are dates.
    """

    place: str
    logs: tuple[FleetLog, ...]
    rig: str | None = None
    payload: str | None = None
    cutoff: float | None = None
    is_dated: bool = False


@dataclass(frozen=True)
class _Entry:
    """What a manifest states of one log."""

    log: str
    unit: str | None = None
    time: Any = None
    map: Any = None


@dataclass(frozen=True)
class _Statement:
    """What a manifest states."""

    logs: tuple[_Entry, ...]
    rig: str | None = None
    payload: str | None = None
    map: Any = None
    cutoff: float | None = bounded_field(None, 0.1, 1000)


def read_manifest(folder: str | Path) -> Manifest:
    """Read a folder's `MANIFESTS`; a folder without one holds a log of each unit.

    Paths are relative to the manifest. One that lies behind a URL names nothing outside its own folder.

    Raises:
        UsageError: The folder or the manifest cannot be used; it names the entry.
    """
    check_installed("fleet", "pyarrow", "fsspec")
    files, root = file_system(str(folder))
    is_remote = "://" in str(folder)
    try:
        names = sorted(PurePosixPath(path).name for path in files.ls(root, detail=False)) if files.isdir(root) else None
    except (OSError, ValueError) as error:
        raise UsageError(str(folder), f"cannot be listed ({error})", "give a folder with logs") from error
    if names is None:
        raise UsageError(str(folder), "is no folder", "give the one that holds the logs and their manifest")
    found = [name for name in MANIFESTS if name in names]
    if len(found) > 1:
        raise UsageError(str(folder), f"holds {' and '.join(found)}", "leave one of them")
    base = str(folder).rstrip("/") if is_remote else str(Path(folder).resolve())
    if found:
        place = f"{base}/{found[0]}"
        with local_copy(place) as copy:
            stated = read_record(_Statement, _read_statement(copy, place), place, UsageError)
    else:
        place = base
        stated = _Statement(tuple(_Entry(name) for name in names if PurePosixPath(name).suffix.lower() in FORMATS))
    if not stated.logs:
        raise UsageError(place, "names no logs", f"put logs there, or list them in {MANIFESTS[0]}")
    common = _read_map(stated.map, base, f"{place}: map", is_remote)
    times = [_read_time(entry.time, f"{place}: logs[{k}].time") for k, entry in enumerate(stated.logs)]
    kinds = [None if time is None else time[1] for time in times]
    if len(set(kinds)) > 1:
        odd = next(k for k, kind in enumerate(kinds) if kind != kinds[0])
        words = {None: "no time", True: "a date", False: "a number"}
        what = f"has {words[kinds[odd]]} where logs[0] has {words[kinds[0]]}"
        raise UsageError(f"{place}: logs[{odd}]", what, "give all logs a date, all a number, or none a time")
    logs = tuple(
        _read_entry(entry, float(k) if time is None else time[0], base, f"{place}: logs[{k}]", common, is_remote)
        for k, (entry, time) in enumerate(zip(stated.logs, times))
    )
    seen: dict[str, int] = {}
    for k, log in enumerate(logs):
        if (first := seen.setdefault(log.path, k)) != k:
            raise UsageError(
                f"{place}: logs[{k}]", f"is {stated.logs[k].log}, which is logs[{first}], too", "list it once"
            )
    rig, payload = (
        name if name is None or name in known else _locate(name, base, f"{place}: {key}", is_remote, known)
        for key, name, known in (("rig", stated.rig, bundled_rigs()), ("payload", stated.payload, bundled_payloads()))
    )
    return Manifest(place, logs, rig, payload, stated.cutoff, kinds[0] is True)


@contextmanager
def local_copy(path: str) -> Iterator[Path]:
    """A file as a path of this machine: what lies behind a URL is copied, and the copy removed in the end.

    Raises:
        LogError: It cannot be copied.
    """
    if "://" not in path:
        yield Path(path)
        return
    files, place = file_system(path)
    with TemporaryDirectory(prefix="gimbal-pin-") as folder:
        copy = Path(folder) / PurePosixPath(place).name
        try:
            check_size(path, files.size(place) or 0, LogError)
            files.get_file(place, str(copy))
        except (OSError, ValueError) as error:
            raise LogError(path, f"cannot be read ({error})", "give the URL of a file") from error
        yield copy


def _read_statement(path: Path, place: str) -> Any:
    """The tables of a manifest as YAML would have them."""
    if path.suffix in (".yaml", ".yml"):
        return read_yaml(path)
    rows = _read_csv(path, place) if path.suffix == ".csv" else _read_parquet(path, place)
    rows = [{key: x for key, x in row.items() if x is not None and x != ""} for row in rows]
    whole: dict[str, Any] = {}
    for k, row in enumerate(rows):
        for key in WHOLE:
            if key in row and whole.setdefault(key, x := row.pop(key)) != x:
                what = f"states the {key} {x}, and another log states {whole[key]}"
                raise UsageError(f"{place}: logs[{k}]", what, "give each a folder of its own: they are no siblings")
    return {**whole, "logs": rows}


def _read_csv(path: Path, place: str) -> list[dict[str, Any]]:
    """Rows of a CSV, all texts: a serial number keeps its zeros."""
    try:
        text = read_bytes(path, UsageError, LARGEST_TEXT).decode("utf-8-sig")
        return list(csv.DictReader(io.StringIO(text), restkey="?"))
    except (UnicodeDecodeError, csv.Error) as error:
        raise UsageError(place, f"is not CSV in UTF-8 ({error})", "write it again") from error


def _read_parquet(path: Path, place: str) -> list[dict[str, Any]]:
    """Rows of a Parquet file; dates as texts."""
    import pyarrow
    import pyarrow.parquet

    try:
        rows = pyarrow.parquet.read_table(pyarrow.BufferReader(read_bytes(path, UsageError))).to_pylist()
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise UsageError(place, f"is not Parquet ({error})", "write it again") from error
    return [{key: x.isoformat() if hasattr(x, "isoformat") else x for key, x in row.items()} for row in rows]


def _read_entry(
    entry: _Entry, time: float, base: str, place: str, common: Mapping[str, str], is_remote: bool
) -> FleetLog:
    """The log of an entry."""
    path, name = _locate(entry.log, base, place, is_remote), PurePosixPath(entry.log)
    mapping = {**common, **_read_map(entry.map, base, f"{place}.map", is_remote)}
    return FleetLog(path, entry.unit or name.stem, time, name.name if entry.time is None else str(entry.time), mapping)


def _locate(name: str, base: str, place: str, is_remote: bool, bundled: Sequence[str] = ()) -> str:
    """Absolute path, or URL, of what a manifest names; `bundled`: the names that it could have been instead.

    Raises:
        UsageError: It is not there, or lies outside of a folder behind a URL.
    """
    if is_remote:
        if "://" in name or name.startswith("/") or ".." in PurePosixPath(name).parts:
            raise UsageError(place, f"is {name}, outside of {base}", "give a path inside that folder")
        return f"{base}/{name}"
    if "://" in name:
        return name
    path = str(Path(base) / name)
    if missing := [file for file in files_of(path) if not os.path.exists(file)]:
        mend = "give a path relative to the manifest" + (f", or one of {', '.join(bundled)}" if bundled else "")
        raise UsageError(place, f"is {missing[0]}, which does not exist", mend)
    return path


def _read_map(stated: Any, base: str, place: str, is_remote: bool) -> dict[str, str]:
    """A mapping, target → expression, stated as a table or as the path of a YAML file."""
    if stated is None:
        return {}
    if isinstance(stated, str):
        with local_copy(_locate(stated, base, place, is_remote)) as copy:
            stated = read_yaml(copy)
    if not isinstance(stated, dict):
        raise UsageError(
            place, f"is {stated!r}", "write a table of 'q_yaw: pos1*pi/180', or the path of such a YAML file"
        )
    read_mapping(stated)
    return stated


def _read_time(stated: Any, place: str) -> tuple[float, bool] | None:
    """A time and whether it is a date, then in s since 1970, UTC unless it says otherwise."""
    if stated is None:
        return None
    number = parse_decimal(stated) if isinstance(stated, str) else stated
    if isinstance(number, (int, float)) and not isinstance(number, bool) and abs(number) < float("inf"):
        return float(number), False
    try:
        date = datetime.fromisoformat(stated.replace("Z", "+00:00"))
        return (date if date.tzinfo else date.replace(tzinfo=timezone.utc)).timestamp(), True
    except (ValueError, AttributeError, OverflowError) as error:
        raise UsageError(place, f"is {stated!r}", "write a date such as 2026-11-24, or a number") from error
