"""Measured or simulated trajectories as frozen arrays with units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.errors import LogError

Array = NDArray[np.floating[Any]]

PAUSE = 10.0
"""Time between two samples from which nobody was recording, s: no clock loses so many samples and then goes on."""


def frozen(array: object, shape: tuple[int | None, ...], name: str) -> Array:
    """Return a read-only float64 copy; `LogError` if its shape is not `shape` (None: any length).

    What nobody can write to is not copied: a part of a long log costs no memory.
    """
    copy = np.array(array, dtype=np.float64, copy=None if immutable(array) else True)
    if copy.ndim != len(shape) or any(want is not None and want != have for want, have in zip(shape, copy.shape)):
        raise LogError(
            name, f"has shape {copy.shape}, expected {shape}", "give one row per sample, one column per joint"
        )
    copy.flags.writeable = False
    return copy


def immutable(array: object) -> bool:
    """Whether an array is read-only, and so is whatever it is a view of."""
    while isinstance(array, np.ndarray) and not array.flags.writeable:
        if array.base is None:
            return True
        array = array.base
    return False


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

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
        samples, joints = np.shape(self.q)
        object.__setattr__(self, "t", frozen(self.t, (samples,), "t"))
        for name in ("q", "v", "a"):
            object.__setattr__(self, name, frozen(getattr(self, name), (samples, joints), name))

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.t)

    def until(self, seconds: float) -> Motion:
        """Return the samples of the first so many seconds."""
        rows = slice(0, int(np.searchsorted(self.t, self.t[0] + seconds, side="right")))
        return Motion(self.t[rows], self.q[rows], self.v[rows], self.a[rows])


@dataclass(frozen=True, eq=False)
class Imu:
    """What an IMU fixed to a link reports, in the link's frame.

    Attributes:
        gyro: Angular rate, rad/s, shape (N, 3), or None.
        accel: Specific force, m/s² (+9.81 up at rest), shape (N, 3), or None.
        quat: Attitude of the link in the world, (w, x, y, z), shape (N, 4), or None.
    """

    gyro: Array | None = None
    accel: Array | None = None
    quat: Array | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
        for name, width in (("gyro", 3), ("accel", 3), ("quat", 4)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen(value, (None, width), name))

    @property
    def channels(self) -> dict[str, Array]:
        """What it reports, by name."""
        return {name: x for name in ("gyro", "accel", "quat") if (x := getattr(self, name)) is not None}

    def part(self, rows: slice | NDArray[np.integer[Any]]) -> Imu:
        """Return the samples in `rows`."""
        return Imu(**{name: x[rows] for name, x in self.channels.items()})


@dataclass(frozen=True, eq=False)
class Log:
    """One trajectory as it was recorded or simulated (CONTRACT.md, "A log").

    Attributes:
        name: Where it came from; errors and reports speak of it by this name.
        joints: Joint names, in the order of the arrays' columns.
        t: Time, s, strictly increasing, shape (N,).
        q: Measured joint angle, rad, shape (N, n).
        v: Measured joint rate, rad/s, shape (N, n), or None where q must be differentiated.
        tau: Motor torque, N m, shape (N, n): `tau[k]` is held from `t[k]` to `t[k+1]`. None for a bare trajectory.
        q_ref: Reference angle, rad, shape (N, n), or None.
        temperature: Motor temperature, °C, shape (N, n), or None.
        imus: Link name → what the IMU fixed to it reported.
        payload: Name of the payload that was mounted, or None if not stated.
        events: Sentences about what happened while recording (limits hit, fallbacks).
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

    def __post_init__(self) -> None:
        """Freeze the arrays, check their shapes and that time increases."""
        shape = (len(np.atleast_1d(self.t)), len(self.joints))
        object.__setattr__(self, "t", frozen(self.t, shape[:1], f"{self.name}: t"))
        object.__setattr__(self, "q", frozen(self.q, shape, f"{self.name}: q"))
        for name in ("v", "tau", "q_ref", "temperature"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen(value, shape, f"{self.name}: {name}"))
        object.__setattr__(self, "imus", MappingProxyType(dict(self.imus)))
        if len(self.t) > 1 and not np.all(np.diff(self.t) > 0):
            row = int(np.argmin(np.diff(self.t) > 0)) + 1
            raise LogError(
                self.name, f"time does not increase at sample {row}", "sort the rows or split the file there"
            )

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.t)

    def __repr__(self) -> str:
        """One line: name, joints, length and channels."""
        held = [name for name in ("q", "v", "tau", "q_ref", "temperature") if getattr(self, name) is not None]
        held += [f"IMU of {link}" for link in self.imus]
        span = f"{len(self)} samples, {self.t[-1] - self.t[0]:.4g} s" if len(self) else "no samples"
        return f"log {self.name}: {span} of {', '.join(self.joints)} ({', '.join(held)})"

    @property
    def dt(self) -> float:
        """Median sampling interval, s."""
        return float(np.median(np.diff(self.t)))

    def part(self, rows: slice | NDArray[np.integer[Any]]) -> Log:
        """Return the samples in `rows` as a log of its own."""
        names = ("t", "q", "v", "tau", "q_ref", "temperature")
        cut = {name: x[rows] for name in names if (x := getattr(self, name)) is not None}
        return replace(self, **cut, imus={link: imu.part(rows) for link, imu in self.imus.items()})
