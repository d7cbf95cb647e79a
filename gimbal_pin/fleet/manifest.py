"""Logs of a fleet: a manifest in YAML, CSV or Parquet beside them, or the folder's logs by themselves."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timezone
from math import isfinite
from pathlib import Path
from typing import Any

from gimbal_pin.errors import UsageError
from gimbal_pin.log.io.readers import FORMATS, files_of
from gimbal_pin.log.mapping import read_mapping
from gimbal_pin.rig.files import YAML_SUFFIXES, bundled_payloads, bundled_rigs
from gimbal_pin.rig.reading import check_size, parse_decimal, read_yaml
from gimbal_pin.rig.records import bounded_field, read_record

MANIFESTS = ("manifest.yaml", "manifest.yml", "manifest.parquet", "manifest.csv")
COMMON = ("rig", "payload", "cutoff")
"""Columns of a table whose one value holds for all logs."""


@dataclass(frozen=True)
class FleetLog:
    """One log of a fleet.

    Attributes:
        path: Absolute path.
        unit: Serial number of its rig, without blanks at its ends.
        time: Time of the recording: of a date s since 1970, else a number of the manifest or the place in its list.
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
    """Logs of a fleet and their rig.

    Attributes:
        place: The manifest's path, or the folder's.
        logs: The logs.
        rig: Bundled name or absolute path; None: not stated.
        payload: Bundled name or absolute path; None: the rig's own.
        cutoff: Cutoff of the identification's filter, Hz; None: the default.
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
    """Statement on one log."""

    log: str
    unit: str | None = None
    time: Any = None
    map: Any = None


@dataclass(frozen=True)
class _Statement:
    """Content of a manifest."""

    logs: tuple[_Entry, ...]
    rig: str | None = None
    payload: str | None = None
    map: Any = None
    cutoff: float | None = bounded_field(None, 0.1, 1000)


def read_manifest(folder: str | Path) -> Manifest:
    """Read a folder's `MANIFESTS`; a folder without one holds a log of each unit.

    Paths are relative to the manifest. Names of units are compared without blanks at their ends; two that differ by
    letter case alone are refused, as some file systems and people take them for one.

    Raises:
        UsageError: The folder or the manifest cannot be used; it names the entry.
    """
    base = Path(folder).resolve()
    if not base.is_dir():
        raise UsageError(
            str(base), "is no folder", "give the one that holds the logs and their manifest"
        )
    names = sorted(path.name for path in base.iterdir())
    manifests = [name for name in MANIFESTS if name in names]
    if len(manifests) > 1:
        raise UsageError(str(base), f"holds {' and '.join(manifests)}", "leave one of them")
    place = str(base.joinpath(*manifests))
    # Most JSON files are results and settings; a manifest names those that are logs.
    suffixes = FORMATS.keys() - {".json"}
    stated = _Statement(
        tuple(_Entry(name) for name in names if Path(name).suffix.lower() in suffixes)
    )
    if manifests:
        content = read_yaml(place) if Path(place).suffix in YAML_SUFFIXES else read_table(place)
        stated = read_record(_Statement, content, place, UsageError)
    if not stated.logs:
        raise UsageError(place, "names no logs", f"put logs there, or list them in {MANIFESTS[0]}")
    common = read_map(stated.map, base, f"{place}: map")
    logs = list[FleetLog]()
    kinds = dict[str, int]()
    paths = dict[str, int]()
    spellings = dict[str, str]()
    for k, entry in enumerate(stated.logs):
        own = f"{place}: logs[{k}]"
        path = find_file(entry.log, base, own)
        time, kind = read_time(entry.time, k, f"{own}.time")
        kinds.setdefault(kind, k)
        if len(kinds) > 1:
            what = f"has {kind} where logs[0] has {next(iter(kinds))}"
            raise UsageError(own, what, "give all logs a date, all a number, or none a time")
        if paths.setdefault(path, k) != k:
            raise UsageError(
                own, f"is {entry.log}, which is logs[{paths[path]}], too", "list it once"
            )
        unit = (entry.unit or "").strip() or Path(entry.log).stem.strip()
        if (known := spellings.setdefault(unit.casefold(), unit)) != unit:
            what = f"is of unit '{unit}', which differs from '{known}' by letter case alone"
            raise UsageError(
                own, what, "write the name of one unit one way, or name two units apart"
            )
        taken = Path(entry.log).name if entry.time is None else str(entry.time)
        logs.append(
            FleetLog(path, unit, time, taken, {**common, **read_map(entry.map, base, f"{own}.map")})
        )
    rig = stated.rig and find_file(stated.rig, base, f"{place}: rig", bundled_rigs())
    payload = stated.payload and find_file(
        stated.payload, base, f"{place}: payload", bundled_payloads()
    )
    return Manifest(place, tuple(logs), rig, payload, stated.cutoff, "a date" in kinds)


def read_table(place: str) -> dict[str, Any]:
    """Return the content of a manifest in CSV, whose values are texts, or in Parquet, as YAML has it."""
    import pandas as pd

    try:
        check_size(place, os.path.getsize(place), UsageError)
        table = pd.read_csv(place, dtype=str) if place.endswith(".csv") else pd.read_parquet(place)
    except (OSError, ValueError, ImportError) as error:
        raise UsageError(
            place, f"cannot be read ({error})", "write it as CSV in UTF-8, or as Parquet"
        ) from error
    content = dict[str, Any]()
    for name in [name for name in COMMON if name in table]:
        values = table.pop(name).dropna().unique().tolist()
        if len(values) > 1:
            what = f"states the {name} {values[0]} and {values[1]}"
            raise UsageError(place, what, "give each a folder of its own: they are not one fleet")
        if values:
            content[name] = values[0]
    rows = [row.dropna().to_dict() for _, row in table.astype(object).iterrows()]
    return {
        **content,
        "logs": [
            {key: x.isoformat() if isinstance(x, date) else x for key, x in row.items()}
            for row in rows
        ],
    }


def find_file(name: str, base: Path, place: str, bundled: Sequence[str] = ()) -> str:
    """Return the absolute path of a file that a manifest in `base` names, or a `bundled` name as it is.

    Raises:
        UsageError: It does not exist.
    """
    if name in bundled:
        return name
    path = str(base / name)
    if missing := [file for file in files_of(path) if not os.path.exists(file)]:
        mend = "give a path relative to the manifest" + (
            f", or one of {', '.join(bundled)}" if bundled else ""
        )
        raise UsageError(place, f"is {missing[0]}, which does not exist", mend)
    return path


def read_map(stated: Any, base: Path, place: str) -> dict[str, str]:
    """Return a mapping, target → expression, from a table or from the path of a YAML file."""
    if isinstance(stated, str):
        stated = read_yaml(find_file(stated, base, place))
    if not isinstance(stated, dict | None):
        mend = "write a table of 'q_yaw: pos1*pi/180', or the path of such a YAML file"
        raise UsageError(place, f"is {stated!r}", mend)
    read_mapping(stated or {})
    return stated or {}


def read_time(stated: Any, count: int, place: str) -> tuple[float, str]:
    """Return a time and its kind: a number, a date in s since 1970, UTC unless stated, or none: the log's place."""
    if stated is None:
        return float(count), "no time"
    number = parse_decimal(stated) if isinstance(stated, str) else stated
    if isinstance(number, (int, float)) and not isinstance(number, bool) and isfinite(number):
        return float(number), "a number"
    try:
        when = datetime.fromisoformat(stated.replace("Z", "+00:00"))
        return (when if when.tzinfo else when.replace(tzinfo=timezone.utc)).timestamp(), "a date"
    except (ValueError, AttributeError, OverflowError) as error:
        raise UsageError(
            place, f"is {stated!r}", "write a date such as 2026-11-24, or a number"
        ) from error
