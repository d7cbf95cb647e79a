"""Which logs make up a fleet: a manifest in YAML, Parquet or CSV beside them, or the folder's logs by themselves."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import date, datetime, timezone
from math import isfinite
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.fleet.engine import check_installed, open_folder
from gimbal_pin.log.io.readers import FORMATS, files_of
from gimbal_pin.log.mapping import read_mapping
from gimbal_pin.rig.files import YAML_SUFFIXES, bundled_payloads, bundled_rigs
from gimbal_pin.rig.reading import check_size, parse_decimal, read_bytes, read_yaml
from gimbal_pin.rig.records import bounded_field, read_record

MANIFESTS = ("manifest.yaml", "manifest.yml", "manifest.parquet", "manifest.csv")


@dataclass(frozen=True)
class FleetLog:
    """One log of a fleet.

    Attributes:
        path: Absolute path or URL.
        unit: Serial number of its rig, without blanks at its ends.
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

    Paths are relative to the manifest. One that lies behind a URL names nothing outside its own folder. Names of units
    are compared without blanks at their ends; two that differ by letter case alone are refused, as some file systems
    and people take them for one.

    Raises:
        UsageError: The folder or the manifest cannot be used; it names the entry.
    """
    check_installed("fleet", "pyarrow", "fsspec")
    base = str(folder).rstrip("/") if "://" in str(folder) else str(Path(folder).resolve())
    names = _list_names(base)
    found = [name for name in MANIFESTS if name in names]
    if len(found) > 1:
        raise UsageError(base, f"holds {' and '.join(found)}", "leave one of them")
    place = "/".join([base, *found])
    # Of JSON files results and settings are far more usual than logs: a manifest names those.
    suffixes = FORMATS.keys() - {".json"}
    stated = _Statement(tuple(_Entry(name) for name in names if PurePosixPath(name).suffix.lower() in suffixes))
    if found:
        with local_copy(place) as copy:
            stated = read_record(_Statement, _read_tables(copy, place), place, UsageError)
    if not stated.logs:
        raise UsageError(place, "names no logs", f"put logs there, or list them in {MANIFESTS[0]}")
    common, logs, places, usual = _read_map(stated.map, base, f"{place}: map"), [], dict[str, int](), ""
    spellings: dict[str, str] = {}
    for k, entry in enumerate(stated.logs):
        own, name = f"{place}: logs[{k}]", PurePosixPath(entry.log)
        path = _locate_file(entry.log, base, own)
        time, kind = _read_time(entry.time, k, f"{own}.time")
        usual = usual or kind
        if kind != usual:
            mend = "give all logs a date, all a number, or none a time"
            raise UsageError(own, f"has {kind} where logs[0] has {usual}", mend)
        if (before := places.setdefault(path, k)) != k:
            raise UsageError(own, f"is {entry.log}, which is logs[{before}], too", "list it once")
        taken = name.name if entry.time is None else str(entry.time)
        mapping = {**common, **_read_map(entry.map, base, f"{own}.map")}
        unit = (entry.unit or "").strip() or name.stem.strip() or name.stem
        if (known := spellings.setdefault(unit.casefold(), unit)) != unit:
            what = f"is of unit '{unit}', which differs from '{known}' by letter case alone"
            raise UsageError(own, what, "write the name of one unit one way, or name two units apart")
        logs.append(FleetLog(path, unit, time, taken, mapping))
    rig, payload = (
        name if name is None or name in known else _locate_file(name, base, f"{place}: {key}", known)
        for key, name, known in (("rig", stated.rig, bundled_rigs()), ("payload", stated.payload, bundled_payloads()))
    )
    return Manifest(place, tuple(logs), rig, payload, stated.cutoff, usual == "a date")


def _list_names(base: str) -> list[str]:
    """Names of a folder's files."""
    files = open_folder(base)
    try:
        if files.isdir(""):
            return sorted(PurePosixPath(path).name for path in files.ls("", detail=False))
    except (OSError, ValueError) as error:
        raise UsageError(base, f"cannot be listed ({error})", "give a folder with logs") from error
    raise UsageError(base, "is no folder", "give the one that holds the logs and their manifest")


@contextmanager
def local_copy(path: str) -> Iterator[Path]:
    """A file as a path of this machine: what lies behind a URL is copied, and the copy removed in the end.

    Raises:
        LogError: It cannot be copied.
    """
    if "://" not in path:
        yield Path(path)
        return
    place, _, name = path.rpartition("/")
    files = open_folder(place)
    with TemporaryDirectory(prefix="gimbal-pin-") as folder:
        copy = Path(folder) / name
        try:
            check_size(path, files.size(name) or 0, LogError)
            files.get_file(name, str(copy))
        except (OSError, ValueError) as error:
            raise LogError(path, f"cannot be read ({error})", "give the URL of a file") from error
        yield copy


def _read_tables(path: Path, place: str) -> Any:
    """The tables of a manifest as YAML would have them; of a CSV all are texts: a serial number keeps its zeros."""
    import pyarrow
    import pyarrow.parquet

    if path.suffix in YAML_SUFFIXES:
        return read_yaml(path)
    content, kind = read_bytes(path, UsageError), "CSV in UTF-8" if path.suffix == ".csv" else "Parquet"
    try:
        if path.suffix == ".csv":
            rows = list(csv.DictReader(io.StringIO(content.decode("utf-8-sig")), restkey="?"))
        else:
            rows = pyarrow.parquet.read_table(pyarrow.BufferReader(content)).to_pylist()
    except (csv.Error, pyarrow.ArrowException, OSError, ValueError) as error:
        raise UsageError(place, f"is not {kind} ({error})", "write it again") from error
    whole, logs = dict[str, Any](), list[dict[str, Any]]()
    for k, row in enumerate(rows):
        log = {key: x.isoformat() if isinstance(x, date) else x for key, x in row.items() if x not in (None, "")}
        for key in {*log} & {"rig", "payload", "cutoff"}:  # a table states in a column what holds for all of its logs
            if whole.setdefault(key, value := log.pop(key)) != value:
                what = f"states the {key} {value}, and another log states {whole[key]}"
                raise UsageError(f"{place}: logs[{k}]", what, "give each a folder of its own: they are no siblings")
        logs.append(log)
    return {**whole, "logs": logs}


def _locate_file(name: str, base: str, place: str, bundled: Sequence[str] = ()) -> str:
    """Absolute path, or URL, of what a manifest in `base` names; `bundled`: names that it could have been instead.

    Raises:
        UsageError: It is not there, or lies outside of a folder behind a URL.
    """
    if "://" in base:
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


def _read_map(stated: Any, base: str, place: str) -> dict[str, str]:
    """A mapping, target → expression, stated as a table or as the path of a YAML file."""
    if isinstance(stated, str):
        with local_copy(_locate_file(stated, base, place)) as copy:
            stated = read_yaml(copy)
    if not isinstance(stated, dict | None):
        mend = "write a table of 'q_yaw: pos1*pi/180', or the path of such a YAML file"
        raise UsageError(place, f"is {stated!r}", mend)
    read_mapping(stated or {})
    return stated or {}


def _read_time(stated: Any, count: int, place: str) -> tuple[float, str]:
    """A time and its kind: a number, a date in s since 1970, UTC unless it says otherwise, or none: the log's place."""
    if stated is None:
        return float(count), "no time"
    number = parse_decimal(stated) if isinstance(stated, str) else stated
    if isinstance(number, (int, float)) and not isinstance(number, bool) and isfinite(number):
        return float(number), "a number"
    try:
        when = datetime.fromisoformat(stated.replace("Z", "+00:00"))
        return (when if when.tzinfo else when.replace(tzinfo=timezone.utc)).timestamp(), "a date"
    except (ValueError, AttributeError, OverflowError) as error:
        raise UsageError(place, f"is {stated!r}", "write a date such as 2026-11-24, or a number") from error
