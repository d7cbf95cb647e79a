"""Measured or simulated trajectories as frozen arrays with units."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.errors import LogError
from gimbal_pin.log.mapping import Source, format_remapping
from gimbal_pin.rig.arguments import check_type
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.types import Array

if TYPE_CHECKING:
    from gimbal_pin.rig.rig import Rig

PAUSE = 10.0
"""Interval between two samples, s, from which the recording was paused: no clock loses so many samples."""
GAP_SAMPLES = 4.5
"""A longer interval than so many samples is a gap: a clock may lose three in a row, and jitter."""


class PlausibleRange(NamedTuple):
    """The range of a channel on any machine, in its unit."""

    lower: float
    upper: float
    unit: str


PLAUSIBLE_RANGES: Mapping[str, PlausibleRange] = MappingProxyType(
    {
        # Three thousand years; since 1970 it is 1.8e9 s, and 1.8e12 ms.
        "t": PlausibleRange(-1e11, 1e11, "s"),
        # Three hours at 1e4 rad/s, 95 000 turns a minute.
        "q": PlausibleRange(-1e8, 1e8, "rad"),
        # The fastest electric drives make a million turns a minute, 1.05e5 rad/s (Zwyssig et al., IEEE TIE 56, 2009).
        "v": PlausibleRange(-2e5, 2e5, "rad/s"),
        # From standstill to that within a tenth of a millisecond.
        "a": PlausibleRange(-2e9, 2e9, "rad/s²"),
        # The shaft of a wind turbine of 15 MW at 7.6 turns a minute passes on 1.9e7 N m.
        "tau": PlausibleRange(-1e8, 1e8, "N m"),
        "q_ref": PlausibleRange(-1e8, 1e8, "rad"),
        # No magnet holds and no winding insulates anywhere near the melting point of copper, 1085 °C.
        "temperature": PlausibleRange(-273.15, 1085.0, "°C"),
        # The fastest of rate tables turn at some 200 rad/s.
        "gyro": PlausibleRange(-1e4, 1e4, "rad/s"),
        # Shock sensors end at 1e5 g.
        "accel": PlausibleRange(-1e6, 1e6, "m/s²"),
        # Parts of a unit quaternion, rounded.
        "quat": PlausibleRange(-1.1, 1.1, "1"),
    }
)
"""Channel → its range; beyond that is another unit or a fault. Fourth powers of these do not overflow."""
_JOINT_CHANNELS = ("q", "v", "tau", "q_ref", "temperature")
SMALLEST_VALUE = 1e-40
"""What is smaller, in any unit, is zero: no length is less than 1.6e-35 m, and fourth powers do not underflow."""
LEAST_INTERVAL = 1e-9
"""Samples closer than this, s, are one: a thousandth of the interval of the fastest of drives."""


def find_implausible(channel: str, values: Array) -> tuple[int, int, str, str] | None:
    """Return row, column, what and mend of the first value outside a channel's range; None where there is none.

    Args:
        channel: One of `PLAUSIBLE_RANGES`.
        values: Its values, (N,) or (N, k); nan is outside.
    """
    lower, upper, unit = PLAUSIBLE_RANGES[channel]
    if not values.size or (values.min() >= lower and values.max() <= upper):
        return None
    rows = values.reshape(len(values), -1)
    row, column = divmod(int(np.argmin((rows >= lower) & (rows <= upper))), rows.shape[1])
    of = "" if unit == "1" else f" {unit}"
    what = f"is {float(rows[row, column])!r}{of}, and on any machine within {lower:g} to {upper:g}"
    return (
        row,
        column,
        what,
        "repair the value, or map the column with the factor of its unit: --map TARGET=COLUMN*FACTOR",
    )


def find_untimely(t: Array) -> tuple[int, str, str] | None:
    """Return row, what and mend of the first of the times, s, (N,), that cannot follow the one before; else None."""
    steps = np.diff(t)
    if not steps.size:
        return None
    if (steps < LEAST_INTERVAL).any():
        row = int(np.argmax(steps < LEAST_INTERVAL)) + 1
        before = float(t[row - 1])
        now = float(t[row])
        if now < before:
            return (
                row,
                f"time goes back from {before!r} to {now!r} s",
                "sort the rows, or split the file there",
            )
        what = f"time {now!r} s {'repeats' if now == before else 'is less than a nanosecond after'} the row before"
        return row, what, "delete one of the two rows, or write more digits"
    if t[-1] - t[0] > 1e6:  # eleven days
        row = int(np.argmax(steps)) + 1
        what = (
            f"time steps from {t[row - 1]:.6g} to {t[row]:.6g} s in a log of {t[-1] - t[0]:.3g} s"
        )
        return row, what, "split the file there, or map t if it is not in s: --map t=COLUMN*FACTOR"
    return None


def freeze(array: object, shape: tuple[int | None, ...], name: str) -> Array:
    """Return a read-only float64 copy; `LogError` if its shape is not `shape` (None: any length), or for no numbers.

    A read-only array that owns its data, or a view of one, is not copied: a part of a long log costs no memory.
    """
    if array is None or np.ma.is_masked(array):
        what = "is None" if array is None else "has masked samples"
        raise LogError(
            name,
            what,
            "give every sample; leave the rows out that have none, or split the log there",
        )
    try:
        copy = np.array(array, dtype=np.float64, copy=None if _is_immutable(array) else True)
    except (TypeError, ValueError) as error:
        raise LogError(
            name, f"is no array of numbers ({error})", "give lists or arrays of numbers"
        ) from error
    if copy.ndim != len(shape) or any(
        want is not None and want != have for want, have in zip(shape, copy.shape)
    ):
        raise LogError(
            name,
            f"has shape {copy.shape}, expected {shape}",
            "give one row per sample, one column per joint",
        )
    copy.flags.writeable = False
    return copy


def _check_channel(array: object, shape: tuple[int | None, ...], kind: str, name: str) -> Array:
    """Return `freeze`, the smallest values as zero; `LogError` at the first value outside the range of its kind."""
    kept = freeze(array, shape, name)
    if (wrong := find_implausible(kind, kept)) is not None:
        row, column, what, mend = wrong
        raise LogError(f"{name}, sample {row}, column {column}", what, mend)
    if ((faint := np.abs(kept) < SMALLEST_VALUE) & (kept != 0.0)).any():
        return freeze(np.where(faint, 0.0, kept), shape, name)
    return kept


def _is_immutable(array: object) -> bool:
    """Whether an array is read-only, and so is whatever it is a view of."""
    while isinstance(array, np.ndarray) and not array.flags.writeable:
        if array.base is None:
            return True
        array = array.base
    return False


def drop_repeated_logs(logs: Sequence[Log]) -> tuple[list[Log], list[str]]:
    """Return logs without those whose samples another one holds, and a note on each that was left out.

    Parts of one log share its digest; their first and last times tell them apart.
    """
    keys = [(log.digest, float(log.t[0]), float(log.t[-1])) for log in logs]
    kept: list[Log] = []
    notes = []
    for k, log in enumerate(logs):
        first = keys.index(keys[k])
        if first == k:
            kept.append(log)
        else:
            notes.append(f"{log.name} repeats {logs[first].name}, and counts once")
    return kept, notes


@dataclass(frozen=True, eq=False)
class Motion:
    """A joint trajectory ``q(t), v = dq/dt, a = dv/dt``.

    Attributes:
        t: Time, s, shape (N,).
        q: Joint angle, rad (m for prismatic joints), shape (N, n).
        v: Joint rate, rad/s, shape (N, n).
        a: Joint acceleration, rad/s², shape (N, n).
    """

    t: Array
    q: Array
    v: Array
    a: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
        object.__setattr__(self, "t", freeze(self.t, (None,), "t"))
        object.__setattr__(self, "q", freeze(self.q, (len(self.t), None), "q"))
        for name in ("v", "a"):
            object.__setattr__(self, name, freeze(getattr(self, name), self.q.shape, name))

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.t)

    def until(self, seconds: float) -> Motion:
        """Return the samples of the first so many seconds."""
        rows = slice(0, int(np.searchsorted(self.t, self.t[0] + seconds, side="right")))
        return Motion(self.t[rows], self.q[rows], self.v[rows], self.a[rows])


@dataclass(frozen=True, eq=False)
class Imu:
    """The readings of an IMU fixed to a link, in the link's frame.

    Attributes:
        gyro: Angular rate, rad/s, shape (N, 3), or None.
        accel: Specific force, m/s² (+9.81 up at rest), shape (N, 3), or None.
        quat: Attitude of the link in the world, (w, x, y, z), shape (N, 4), or None.
    """

    gyro: Array | None = None
    accel: Array | None = None
    quat: Array | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
        for name, width in (("gyro", 3), ("accel", 3), ("quat", 4)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _check_channel(value, (None, width), name, name))

    @property
    def channels(self) -> dict[str, Array]:
        """The readings that there are, by name."""
        return {
            name: x for name in ("gyro", "accel", "quat") if (x := getattr(self, name)) is not None
        }

    def part(self, rows: slice | NDArray[np.integer[Any]]) -> Imu:
        """Return the samples in `rows`."""
        return Imu(**{name: x[rows] for name, x in self.channels.items()})


@dataclass(frozen=True, eq=False)
class Log(Record):
    """One trajectory as it was recorded or simulated.

    Lists and arrays are copied. What takes a rig and a log finds the log's columns by the names of the rig's joints.

    Attributes:
        name: The file or simulation that it is from, as errors and reports name it.
        joints: Joint names, in the order of the arrays' columns.
        t: Time, s, strictly increasing, shape (N,).
        q: Measured joint angle, rad, shape (N, n).
        v: Measured joint rate, rad/s, shape (N, n), or None where q must be differentiated.
        tau: Motor torque, N m, shape (N, n): `tau[k]` is held from `t[k]` to `t[k+1]`. None for a bare trajectory.
        q_ref: Reference angle, rad, shape (N, n), or None.
        temperature: Motor temperature, °C, shape (N, n), or None.
        imus: Link name → readings of the IMU fixed to it.
        payload: Name of the payload that was mounted, or None if not stated.
        events: Sentences about what happened while recording (limits hit, fallbacks).
        seed: What repeats a simulated log as `rng`; None of others, and where a generator was given.
        sources: Column → what of its file it was read from, where a mapping says so.
        digest: SHA-256 of times, angles and torques as they were first read; parts and altered copies keep it.
    """

    name: str
    joints: tuple[str, ...]
    t: Array
    q: Array
    v: Array | None = None
    tau: Array | None = None
    q_ref: Array | None = None
    temperature: Array | None = None
    imus: Mapping[str, Imu] = field(default_factory=dict)
    payload: str | None = None
    events: tuple[str, ...] = ()
    seed: int | None = None
    sources: Mapping[str, Source] = field(default_factory=dict)
    digest: str = ""

    ROWS: ClassVar[str] = "samples"
    __repr__ = brief

    def __post_init__(self) -> None:
        """Freeze the arrays, check the joints' names, shapes, values, and that time increases."""
        check_type(f"{self.name}: joints", self.joints, Sequence[str] | None)
        check_type(f"{self.name}: imus", self.imus, Mapping[str, Imu] | None)
        joints = (self.joints,) if isinstance(self.joints, str) else tuple(self.joints or ())
        if len(set(joints)) < len(joints):
            raise LogError(
                f"{self.name}: joints",
                f"are {', '.join(joints)}",
                "give each column a name of its own",
            )
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "t", _check_channel(self.t, (None,), "t", f"{self.name}: t"))
        for name in _JOINT_CHANNELS:
            if (value := getattr(self, name)) is not None or name == "q":
                kept = _check_channel(
                    value, (len(self.t), len(joints)), name, f"{self.name}: {name}"
                )
                object.__setattr__(self, name, kept)
        object.__setattr__(self, "imus", MappingProxyType(dict(self.imus or {})))
        object.__setattr__(self, "sources", MappingProxyType(dict(self.sources)))
        for link, imu in self.imus.items():
            for name, value in imu.channels.items():
                freeze(value, (len(self.t), value.shape[1]), f"{self.name}: {name} of {link}")
        if (late := find_untimely(self.t)) is not None:
            raise LogError(f"{self.name}: sample {late[0]}", *late[1:])
        if not self.digest:
            recorded = (self.t, self.q) if self.tau is None else (self.t, self.q, self.tau)
            digest = hashlib.sha256()
            for values in recorded:
                digest.update(np.ascontiguousarray(values).data)
            object.__setattr__(self, "digest", digest.hexdigest())

    def __reduce__(self) -> tuple[type[Log], tuple[Any, ...]]:
        """Make it pass between processes, which read-only views of dictionaries do not."""
        return type(self), tuple(
            dict(x) if isinstance(x, MappingProxyType) else x for x in vars(self).values()
        )

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.t)

    def __str__(self) -> str:
        """One line: name, joints, length and channels."""
        held = [*self.channels, *(f"IMU of {link}" for link in self.imus)]
        span = f"{len(self)} samples, {self.t[-1] - self.t[0]:.4g} s" if len(self) else "no samples"
        return f"log {self.name}: {span} of {', '.join(self.joints)} ({', '.join(held)})"

    def to_dict(self) -> dict[str, Any]:
        """Return what it is of, and the samples as a row of columns each, named as in files."""
        from gimbal_pin.log.io.columns import log_columns

        columns = log_columns(self)
        rows = np.column_stack(list(columns.values())).tolist()
        facts = {
            "name": self.name,
            "payload": self.payload,
            "joints": list(self.joints),
            "events": list(self.events),
        }
        return {"schema": 1, **facts, "samples": [dict(zip(columns, row)) for row in rows]}

    @property
    def channels(self) -> dict[str, Array]:
        """The joints' quantities that there are, by name, (N, n) each."""
        return {name: x for name in _JOINT_CHANNELS if (x := getattr(self, name)) is not None}

    @property
    def dt(self) -> float:
        """Median sampling interval, s."""
        return float(np.median(np.diff(self.t)))

    def remapped(self, changes: Mapping[str, tuple[str, float | str]]) -> str:
        """Return the ``--map`` entries that mend the log, in its file's own columns; see `format_remapping`."""
        return format_remapping(self.sources, changes)

    def columns(self, rig: Rig) -> list[int]:
        """Return the column of each joint of a rig, found by name; `LogError` where a joint has none."""
        for joint in rig.joints:
            if joint not in self.joints:
                have = f"it has {', '.join(self.joints)}"
                mend = f"{have}: name its joints as the rig does, or load the rig that it is of"
                raise LogError(self.name, f"has no joint '{joint}' of rig {rig.name}", mend)
        return [self.joints.index(joint) for joint in rig.joints]

    def ordered(self, rig: Rig) -> Log:
        """Return the log with its columns in a rig's order of joints; others are left out, as when a file is read."""
        if self.joints == rig.joints:
            return self
        columns = self.columns(rig)
        turned: dict[str, Any] = {name: x[:, columns] for name, x in self.channels.items()}
        return replace(self, joints=rig.joints, **turned)

    def part(self, rows: slice | NDArray[np.integer[Any]]) -> Log:
        """Return the samples in `rows` as a log of its own."""
        cut: dict[str, Any] = {name: x[rows] for name, x in self.channels.items()}
        return replace(
            self,
            t=self.t[rows],
            **cut,
            imus={link: imu.part(rows) for link, imu in self.imus.items()},
        )


def find_interval(intervals: Iterable[float]) -> float | None:
    """Return the longest of some logs' sampling intervals, s, its rate to four digits: clocks jitter."""
    longest = max(intervals, default=None)
    return None if longest is None else 1 / float(f"{1 / longest:.4g}")
