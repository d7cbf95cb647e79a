"""Which columns a log has, and how a table's columns become channels in SI units."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.errors import DataError, LogError
from gimbal_pin.log import signals
from gimbal_pin.log.io.tables import (
    ColumnTable,
    decode_columns,
    find_repeated_rows,
    quote_names,
)
from gimbal_pin.log.log import (
    LEAST_INTERVAL,
    PLAUSIBLE_RANGES,
    Array,
    Log,
    find_implausible,
    find_untimely,
)
from gimbal_pin.log.mapping import (
    ROW_COLUMN,
    Entries,
    Source,
    check_targets,
    list_encoder_sources,
    read_mapping,
)
from gimbal_pin.rig import urdf
from gimbal_pin.rig.rig import Rig


class MissingColumnsError(LogError):
    """A log without columns that it needs.

    Attributes:
        missing: Their names.
    """

    missing: tuple[str, ...] = ()


_JOINT_COLUMNS = {"q": "q", "v": "dq", "tau": "tau", "q_ref": "q_ref", "temperature": "temp"}
"""Attribute of `Log` → prefix of its columns, in the order of files."""
IMU_COLUMNS = {"gyro": "xyz", "accel": "xyz", "quat": "wxyz"}
"""Attribute of `Imu` (and prefix of its columns) → its axes."""
_LOST = 0.1
"""Share of the rows that may be left out: of a column of another rate every second value or more is missing, of what a
recorder loses, or repeats before it begins, far less."""

LEAST_TRAVEL = 0.02
"""Least travel of a joint that can be judged, rad or m."""
NOISE_RATIO = 2.0
"""Ratio of a rate's deviation to its noise, below which the rate is noise; of joints that move it is ten and more."""
MIN_REST_SECONDS = 2.0
"""Length of a log, s, from which a joint without motion counts as at rest; no verdict is possible on a shorter one."""


@dataclass(frozen=True)
class Group:
    """Columns that stand together: a file has all of them or none.

    Attributes:
        columns: Names as in files.
        required: Whether a file without them is refused.
    """

    columns: tuple[str, ...]
    required: bool = False


def make_joint_group(prefix: str, joints: Sequence[str], required: bool = False) -> Group:
    """Return the group of one quantity over all joints."""
    return Group(tuple(f"{prefix}_{joint}" for joint in joints), required)


def make_imu_groups(link: str) -> dict[str, Group]:
    """Return ``<attribute>_<link>`` → group of an IMU fixed to `link`."""
    axes = IMU_COLUMNS.items()
    return {
        f"{kind}_{link}": Group(tuple(f"{kind}_{link}_{axis}" for axis in names))
        for kind, names in axes
    }


def make_log_groups(
    joints: Sequence[str], links: Sequence[str], need_tau: bool
) -> dict[str, Group]:
    """Return key → group of everything that a log of these joints and links may hold."""
    required = ("q", "tau") if need_tau else ("q",)
    groups = {"t": Group(("t",), True)}
    groups |= {
        key: make_joint_group(prefix, joints, key in required)
        for key, prefix in _JOINT_COLUMNS.items()
    }
    for link in links:
        groups |= make_imu_groups(link)
    return groups


def log_columns(log: Log) -> dict[str, Array]:
    """Return column → (N,) values of everything in a log, in the order of files."""
    columns = {"t": log.t}
    for attribute, prefix in _JOINT_COLUMNS.items():
        if (values := getattr(log, attribute)) is not None:
            columns |= zip(make_joint_group(prefix, log.joints).columns, values.T)
    for link, imu in log.imus.items():
        groups = make_imu_groups(link)
        for name, values in imu.channels.items():
            columns |= zip(groups[f"{name}_{link}"].columns, values.T)
    return columns


def list_links(rig: Rig) -> list[str]:
    """Return the names of all links of a rig, which an IMU may be fixed to."""
    return urdf.list_element_names(urdf.parse_robot(rig.urdf, str(rig.path)), "link")


def find_unrecorded_joints(
    rig: Rig, tables: Iterable[ColumnTable], mapping: Entries
) -> dict[str, float]:
    """Return each joint of which no table holds anything → the angle, rad, or place, m, nearest to zero it can have.

    Empty where they hold no joint at all: then it is their names that are not the rig's.
    """
    known = {column for table in tables for column in table.columns} | read_mapping(mapping).keys()
    columns = {
        joint: {f"{prefix}_{joint}" for prefix in _JOINT_COLUMNS.values()} for joint in rig.joints
    }
    absent = {joint: float(min(max(0.0, low), high)) for joint, low, high in zip(rig.joints, *rig.stops)
              if not columns[joint] & known}  # fmt: skip
    return absent if len(absent) < rig.n else {}


def find_held_joints(logs: Sequence[Log]) -> dict[str, float]:
    """Return each joint that rests in all logs → its angle, rad, or place, m.

    Empty where all rest: then nothing moves. A joint that rests though its reference or its logged rate moves is not
    held: its encoder is dead or its drive is off.
    """
    if not logs:
        return {}
    asked_to_move = {*range(len(logs[0].joints))} - {*find_joints_asked_to_rest(logs)}
    has_references = all(log.q_ref is not None for log in logs)
    still = [
        j
        for j in range(len(logs[0].joints))
        if all(_is_at_rest(log, j) for log in logs) and not (has_references and j in asked_to_move)
    ]
    if not still or len(still) == len(logs[0].joints):
        return {}
    at = np.median(np.concatenate([log.q for log in logs]), axis=0)
    return {logs[0].joints[j]: float(at[j]) for j in still}


def _is_at_rest(log: Log, joint: int) -> bool:
    """Return whether neither a joint's angle nor the integral of its logged rate travels, but for the rate's noise."""
    if len(log) * log.dt < MIN_REST_SECONDS or np.ptp(log.q[:, joint]) >= LEAST_TRAVEL:
        return False
    if log.v is None:
        return True
    rate = log.v[:, joint] - np.median(log.v[:, joint])
    # Differences of an angle that flickers between two steps: their sum wanders with every sample that is lost.
    if np.std(rate) < NOISE_RATIO * float(signals.noise_std(log.v[:, [joint]])[0]):
        return True
    return float(np.ptp(np.cumsum(rate)) * log.dt) < LEAST_TRAVEL


def find_joints_asked_to_rest(logs: Sequence[Log]) -> list[int]:
    """Return the joints whose references ask for no motion that could be judged, in any log."""
    if not logs or any(log.q_ref is None for log in logs):
        return []
    travel = np.ptp(np.concatenate([np.asarray(log.q_ref) for log in logs]), axis=0)
    return np.flatnonzero(travel < LEAST_TRAVEL).tolist()


def resolve_mapping(rig: Rig, groups: Mapping[str, Group], mapping: Entries) -> dict[str, Source]:
    """Return target → source of a mapping to these groups; `UsageError` or `LogError` if it cannot be one.

    Two channels that claim one name are refused: of joints `a` and `ref_a`, ``q_ref_a``.
    """
    names = [column for group in groups.values() for column in group.columns]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        mend = "rename the joint in the URDF"
        raise LogError(f"rig {rig.name}", f"two of its channels would be called '{twice[0]}'", mend)
    sources = read_mapping(mapping)
    check_targets(sources, names, rig.joints)
    return sources | {
        name: source for name, source in list_encoder_sources(rig, sources).items() if name in names
    }


def read_groups(
    table: ColumnTable,
    groups: Mapping[str, Group],
    sources: Mapping[str, Source],
    notes: list[str] | None = None,
) -> dict[str, Array]:
    """Return key → (N, k) array of each group that the table holds, scaled to SI; ``t`` among them increases.

    Args:
        table: What is read.
        groups: Key → columns.
        sources: Target → column that a mapping names.
        notes: Takes a sentence on each row or group that is left out; None: none may be.

    Raises:
        LogError: A column is missing or there twice, a value is no number or no machine's, or time does not increase.
    """
    columns = dict.fromkeys(table.columns)
    known = {**{column: Source(column) for column in columns}, **sources}
    there = {c: source for c, source in known.items() if source.place or source.column in columns}
    present = {c: there[c] for group in groups.values() for c in group.columns if c in there}
    _check_header(table, groups, present)
    wanted = [
        c for c in dict.fromkeys(source.column for source in present.values()) if c in columns
    ]
    raw = table.read(wanted or table.columns[:1])
    raw.setdefault(ROW_COLUMN, np.arange(len(next(iter(raw.values()))), dtype=np.float64))
    if notes is not None:
        read = {source.column: raw[source.column] for source in present.values()}
        raw |= decode_columns(table.name, present["t"].column, read, notes)
    for group in groups.values():
        if notes is not None and not group.required and group.columns[0] in present:
            sparse = [c for c in group.columns if np.isnan(raw[present[c].column]).mean() > _LOST]
            if sparse:
                notes.append(
                    f"{table.name}: {quote_names(sparse)} are mostly empty or nan: left out"
                )
                present = {c: source for c, source in present.items() if c not in group.columns}
    read = {source.column: raw[source.column] for source in present.values()}
    kept = _select_whole_rows(table, read, present["t"], notes)
    del read
    groups = {key: group for key, group in groups.items() if group.columns[0] in present}
    uses = Counter(present[c].column for group in groups.values() for c in group.columns)
    arrays = {}
    for key, group in groups.items():
        named = [present[column] for column in group.columns]
        with np.errstate(over="ignore"):  # refused below
            arrays[key] = np.column_stack(
                [source.convert(raw[source.column][kept]) for source in named]
            )
        uses.subtract(source.column for source in named)
        raw = {column: x for column, x in raw.items() if uses[column] > 0}
        channel = key if key in PLAUSIBLE_RANGES else key.split("_")[0]
        if (wrong := find_implausible(channel, arrays[key])) is not None:
            row, column, what, mend = wrong
            raise LogError(table.place(int(kept[row]), named[column].column), what, mend)
    if (late := find_untimely(arrays["t"][:, 0])) is not None:
        row, what, mend = late
        t = arrays["t"][:, 0]
        if notes is not None and t[row] == t[row - 1]:
            interval = (t[-1] - t[0]) / max(len(t) - 1, 1)
            mend = (
                f"write more digits, or, of evenly spaced rows: --map t={ROW_COLUMN}*{interval:.6g}"
            )
        raise LogError(table.place(int(kept[row]), present["t"].column), what, mend)
    return arrays


def _select_whole_rows(
    table: ColumnTable, raw: Mapping[str, Array], time: Source, notes: list[str] | None
) -> NDArray[np.integer[Any]]:
    """Return the rows that hold every value, from where time goes on without repeating itself or going back.

    `notes` as for `read_groups`; `LogError` at the first missing value if more than `_LOST` of the rows lack one.
    """
    count = len(raw[time.column])
    missing = {column: np.isnan(values) for column, values in raw.items()}
    full = np.flatnonzero(~np.any(list(missing.values()), axis=0))
    most = 0 if notes is None else _LOST * count
    said = [] if notes is None else notes
    if len(full) < count:
        column, row = min(
            ((c, int(np.argmax(x))) for c, x in missing.items() if x.any()), key=lambda one: one[1]
        )
        place = table.place(row, column)
        lack = f"{count - len(full)} of {count} rows lack a value"
        if count - len(full) > most:
            mend = "fill it in or delete the row; put columns of another rate into a.csv+b.csv"
            raise LogError(place, f"is empty or nan, and {lack}", mend)
        said.append(f"{place}: is empty or nan: {lack} and are left out")
    if len(full) < count:
        twice = find_repeated_rows({column: values[full] for column, values in raw.items()})
    else:  # a copy of all rows would be large
        twice = find_repeated_rows(raw)
    if 0 < np.sum(twice) <= most:
        place = table.place(int(full[twice][0]), time.column)
        said.append(
            f"{place}: {np.sum(twice)} of {count} rows repeat the row before, its time too, and are left out"
        )
        full = full[~twice]
    stays = np.flatnonzero(np.diff(raw[time.column][full]) * time.factor < LEAST_INTERVAL)
    begin = int(stays[-1]) + 1 if len(stays) else 0
    if 0 < begin <= most:
        place = table.place(int(full[begin]), time.column)
        said.append(
            f"{place}: time goes on from here; what stands before, {begin} of {count} rows, is left out"
        )
        full = full[begin:]
    return full


def _check_header(
    table: ColumnTable, groups: Mapping[str, Group], present: Mapping[str, Source]
) -> None:
    """Raise `LogError` unless sources exist once, required groups are there, and no group is there in part.

    `DataError` where torques alone are missing, and every column is something else.
    """
    for source in present.values():
        count = table.columns.count(source.column)
        if count == 0 and source.column != ROW_COLUMN:
            have = quote_names(table.columns)
            what = (
                f"has no column '{source.column}', which {source.place} names (its columns: {have})"
            )
            raise LogError(table.name, what, "map from a column that is there")
        if count > 1:
            raise LogError(
                table.name,
                f"has {count} columns '{source.column}'",
                "rename all but one in the header",
            )
    missing = [
        c for group in groups.values() if group.required for c in group.columns if c not in present
    ]
    left = set(table.columns) - {source.column for source in present.values()}
    if missing and not left and all(group.columns[0].startswith("tau_") for group in groups.values()
                                    if group.required and set(group.columns) & {*missing}):  # fmt: skip
        mend = "record the torque or current that the drives report"
        raise DataError(
            table.name, "holds how the joints move, and no torque that moves them", mend
        )
    if missing:
        what = f"has no column {quote_names(missing)} (its columns: {quote_names(table.columns)})"
        mend = f"name the columns so, or map them: --map {missing[0]}=COLUMN[*FACTOR]"
        error = MissingColumnsError(
            table.name, what, mend + f" or t={ROW_COLUMN}*SECONDS" * (missing[0] == "t")
        )
        error.missing = tuple(missing)
        raise error
    for group in groups.values():
        absent = [column for column in group.columns if column not in present]
        if absent and len(absent) < len(group.columns):
            there = next(column for column in group.columns if column in present)
            mend = "give the whole group or none of it: rename, delete or --map a column"
            raise LogError(table.name, f"has column '{there}' but not {quote_names(absent)}", mend)
