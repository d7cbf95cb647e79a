"""Logs and trajectories in files; `readers` has the table of formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log.angles import check_within_stops, unwrap_angles
from gimbal_pin.log.io.columns import (
    IMU_COLUMNS,
    Group,
    MissingColumnsError,
    list_links,
    log_columns,
    make_imu_groups,
    make_joint_group,
    make_log_groups,
    read_groups,
    resolve_mapping,
)
from gimbal_pin.log.io.readers import format_of, is_log, open_table
from gimbal_pin.log.io.tables import ColumnTable
from gimbal_pin.log.io.units import check_units, describe_torques
from gimbal_pin.log.log import Array, Imu, Log, Motion
from gimbal_pin.log.mapping import Entries, Source
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.rig import Rig


@check_arguments
def read_log(path: str | Path, rig: Rig, mapping: Entries = (), *, need_tau: bool = True) -> Log:
    """Read one trajectory with the columns of a log, ``value = factor * column`` where a mapping says so.

    Args:
        path: File, or several joined by + (`readers.open_table`), with the mounted payload behind an @ if there is one
            (``log.csv@cinema``).
        rig: Whose joints and links the columns are named after; other columns are ignored.
        mapping: ``target=column[*factor]`` or the path of a YAML file with such a table, one or several; or the table,
            target → ``column[*factor]``.
        need_tau: Refuse a file without torques.

    Returns:
        The log in SI units; `q` (N, n) in the rig's order of joints, what the file lacks None.

    Raises:
        LogError: The file, a column, a line or a value cannot be used.
        UsageError: A mapping cannot be used, or no reader is known for the suffix.
    """
    file, payload = split_payload(path)
    return log_in(open_table(file), rig, mapping, payload, need_tau)


def log_in(
    table: ColumnTable,
    rig: Rig,
    mapping: Entries = (),
    payload: str | None = None,
    need_tau: bool = True,
) -> Log:
    """Return the log in a file that is open, see `read_log`."""
    links = list_links(rig)
    notes = list[str]()
    groups = make_log_groups(rig.joints, links, need_tau)
    sources = resolve_mapping(rig, groups, mapping)
    try:
        data = read_groups(table, groups, sources, notes)
    except MissingColumnsError as error:
        from gimbal_pin.log.io.inspection import propose_entries

        raise LogError(
            error.place, error.what, propose_entries(table, rig, error.missing) or error.mend
        ) from error
    name = table.name
    notes = [*table.notes, *notes]
    del table  # its text is as large as the log
    return to_log(data, name, rig, links, payload, sources, notes)


def to_log(
    data: Mapping[str, Array],
    name: str,
    rig: Rig,
    links: Sequence[str],
    payload: str | None,
    sources: Mapping[str, Source],
    notes: Sequence[str] = (),
) -> Log:
    """Return the log of the groups that were read; `LogError` where they can be in no SI units."""
    t = data["t"][:, 0]
    q, q_ref, turned = unwrap_angles(name, rig, t, data["q"], data.get("q_ref"), sources)
    turned += check_units(name, rig, t, q, data.get("v"), q_ref, sources)
    return Log(
        name=name,
        joints=rig.joints,
        t=t,
        q=q,
        v=data.get("v"),
        tau=data.get("tau"),
        q_ref=q_ref,
        temperature=data.get("temperature"),
        imus={link: imu for link in links if (imu := to_imu(data, link)) is not None},
        payload=payload,
        events=(
            *notes,
            *turned,
            *check_within_stops(name, rig, q, sources),
            *describe_torques(rig, data.get("tau")),
        ),
        sources=sources,
    )


def to_imu(data: Mapping[str, Array], link: str) -> Imu | None:
    """Return the IMU of a link out of the groups that were read, or None."""
    parts = {kind: data[f"{kind}_{link}"] for kind in IMU_COLUMNS if f"{kind}_{link}" in data}
    return Imu(**parts) if parts else None


def read_imu(path: str | Path, rig: Rig, link: str, mapping: Entries = ()) -> tuple[Array, Imu]:
    """Read what the IMU fixed to `link` reported, without any joint: on the base, the platform's motion.

    Returns:
        Time, s, (N,), and the IMU's samples.

    Raises:
        LogError: As `read_log`, and where the file holds nothing of that IMU.
    """
    groups = {"t": Group(("t",), True), **make_imu_groups(link)}
    data = read_groups(open_table(Path(path)), groups, resolve_mapping(rig, groups, mapping))
    imu = to_imu(data, link)
    if imu is None:
        mend = f"map them: --map gyro_{link}_x=COLUMN[*FACTOR] and so on"
        raise LogError(
            str(path), f"has no column gyro_{link}_x, accel_{link}_x or quat_{link}_w", mend
        )
    return data["t"][:, 0], imu


def read_motion(path: str | Path, rig: Rig, mapping: Entries = ()) -> Motion:
    """Read a trajectory ``t, q_<joint>, dq_<joint>, ddq_<joint>``.

    Where rates or accelerations are missing they are the derivatives of the cubic spline (not-a-knot) through the next
    lower order that is there.

    Raises:
        LogError, UsageError: As `read_log`.
    """
    groups = {"t": Group(("t",), True), "q": make_joint_group("q", rig.joints, True)}
    groups |= {"v": make_joint_group("dq", rig.joints), "a": make_joint_group("ddq", rig.joints)}
    data = read_groups(open_table(Path(path)), groups, resolve_mapping(rig, groups, mapping))
    t = data["t"][:, 0]
    q = data["q"]
    v = data.get("v")
    a = data.get("a")
    if len(t) < 2 and (v is None or a is None):
        raise LogError(
            str(path), "has one row and no rates", "give two rows, or the columns dq_ and ddq_"
        )
    if v is None or a is None:
        from scipy.interpolate import CubicSpline

        a = (
            a
            if a is not None
            else CubicSpline(t, q)(t, 2)
            if v is None
            else CubicSpline(t, v)(t, 1)
        )
        v = v if v is not None else CubicSpline(t, q)(t, 1)
    return Motion(t, q, np.asarray(v), np.asarray(a))


@check_arguments
def write_log(log: Log, path: str | Path) -> None:
    """Write a log so that `read_log` returns the same numbers, in the format of the suffix; whole or not at all.

    Angles are written as their encoders read them, see `Motor.encoder_zero`.

    Name, payload and events have no column and are not written.

    Raises:
        UsageError: The suffix is of no format that is written, or the file cannot be.
    """
    zeros = {name: source.zero for name, source in log.sources.items() if source.zero}
    write_columns(
        {name: x + zeros[name] if name in zeros else x for name, x in log_columns(log).items()},
        path,
    )


def write_motion(motion: Motion, joints: Sequence[str], path: str | Path) -> None:
    """Write a trajectory so that `read_motion` returns the same numbers; `UsageError` as `write_log`."""
    columns = {"t": motion.t}
    for prefix, values in (("q", motion.q), ("dq", motion.v), ("ddq", motion.a)):
        columns |= zip(make_joint_group(prefix, joints).columns, values.T, strict=True)
    write_columns(columns, path)


def write_columns(columns: Mapping[str, Array], path: str | Path) -> None:
    """Write columns in the format of the suffix."""
    write = format_of(Path(path)).write
    if write is None:
        raise UsageError(
            str(path),
            f"{Path(path).suffix} is a format that is only read",
            "write .csv or .parquet",
        )
    write(columns, Path(path))


def split_payload(path: str | Path) -> tuple[Path, str | None]:
    """Return (file, payload) of ``log.csv@cinema``; a file that really bears that name is not split."""
    head, at, payload = str(path).rpartition("@")
    if not at or Path(path).exists() or not is_log(Path(head)):
        return Path(path), None
    if not payload:
        raise UsageError(
            str(path), "names no payload behind the @", "write log.csv@PAYLOAD, or leave the @ out"
        )
    return Path(head), payload
