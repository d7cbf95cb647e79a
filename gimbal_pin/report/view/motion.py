"""A log as the viewer needs it: joint angles at the frames' times, and the poses that pinocchio makes of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class Frames:
    """What is shown, frame by frame.

    Attributes:
        t: Time of the log at each frame, s, shape (F,).
        q: Joint positions, rad or m, shape (F, n).
        q_ref: Reference, shape (F, n), or None: no ghost.
        base: Attitude of the base in the world, (x, y, z, w), shape (F, 4), or None: it stands still.
        speed: Seconds of the log per second of playing.
        pivot: Point of the base that stays where it is while the base turns, m in the base's frame, (3,).
        wanted: Attitude that the camera should keep, (3, 3), or None: there is no target.
        ghost_name: What stands at `q_ref`.
    """

    t: Array
    q: Array
    q_ref: Array | None
    base: Array | None = None
    speed: float = 1.0
    pivot: Array = field(default_factory=lambda: np.zeros(3))
    wanted: Array | None = None
    ghost_name: str = "reference"

    def first(self, count: int) -> Frames:
        """Return the first `count` frames."""
        rows = {name: getattr(self, name) for name in ("t", "q", "q_ref", "base")}
        return replace(self, **{name: x[:count] for name, x in rows.items() if x is not None})

    @property
    def clock(self) -> Array:
        """Time since the start of playing, s, (F,)."""
        return np.asarray((self.t - self.t[0]) / self.speed)


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the base and of the n joint frames over F frames; index 0 is the base.

    Attributes:
        local: In the parent joint's frame, the base's in the world, (F, n + 1, 4, 4).
        world: In the world, (F, n + 1, 4, 4).
    """

    local: Array
    world: Array


def motion(rig: Rig, log: Log, fps: float, speed: float, ghost: bool) -> Frames:
    """Interpolate a log at the times t₀ + k speed / fps.

    Raises:
        UsageError: `fps` or `speed` cannot be used.
        LogError: The log is empty or lacks a joint of the rig.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0):
            raise UsageError(name, f"is {value}", "give a positive number")
    if not len(log):
        raise LogError(log.name, "has no samples", "give a log with at least one row")
    order = log.columns(rig)
    times = frame_times(log.t, speed / fps)
    reference = log.q_ref if ghost else None
    return Frames(
        t=times,
        q=interpolate(times, log.t, log.q[:, order]),
        q_ref=None if reference is None else interpolate(times, log.t, reference[:, order]),
        base=base_attitude(rig, log, times),
        speed=speed,
    )


def magnify(rig: Rig, left: Frames, right: Frames) -> tuple[Frames, Frames]:
    """Return two runs whose ghosts are k times as far from the rig as their references are, k the same for both.

    k is the largest of 1, 2, 5, …, 1000 at which no ghost's joint is over 0.25 rad away. Where a run has no reference
    the first run is the ghost of the second one.
    """
    runs = (left, right)
    both = left.q_ref is not None and right.q_ref is not None
    aims = (left.q_ref, right.q_ref) if both else (None, left.q)
    away = [None if aim is None else aim - run.q for run, aim in zip(runs, aims, strict=True)]
    turning = [not slides for slides in rig.slides]
    most = max(float(np.abs(one[:, turning]).max(initial=0.0)) for one in away if one is not None)
    factor = max(
        k for k in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if k == 1 or k * most <= 0.25
    )
    name = f"{'reference, error' if both else 'first run, difference'} × {factor}"
    first, second = (
        replace(run, q_ref=None if one is None else run.q + factor * one, ghost_name=name)
        for run, one in zip(runs, away, strict=True)
    )
    return first, second


def frame_times(t: Array, step: float) -> Array:
    """Return times from the first to the last sample, `step` seconds apart, both ends included."""
    count = int(np.floor((t[-1] - t[0]) / step + 1e-9)) + 1
    times = t[0] + step * np.arange(count)
    return times if t[-1] - times[-1] < 0.01 * step else np.append(times, t[-1])


def interpolate(times: Array, t: Array, values: Array) -> Array:
    """Interpolate each column linearly over its finite samples; a column without any stands at zero."""
    result = np.zeros((len(times), values.shape[1]))
    for column, samples in enumerate(values.T):
        finite = np.isfinite(samples)
        if finite.any():
            result[:, column] = np.interp(times, t[finite], samples[finite])
    return result


def base_attitude(rig: Rig, log: Log, times: Array) -> Array | None:
    """Return the attitude (x, y, z, w) that the base's IMU reports at the given times, (F, 4), or None."""
    imu = log.imus.get(rig.base)
    if imu is None or imu.quat is None:
        return None
    turns = np.where(
        np.sum(imu.quat[1:] * imu.quat[:-1], axis=1) < 0, -1.0, 1.0
    )  # q and -q are one attitude
    steady = imu.quat * np.cumprod(np.append(1.0, turns))[:, None]
    found = interpolate(times, log.t, steady)[:, [1, 2, 3, 0]]
    length = np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(
        length > 0, found / np.where(length > 0, length, 1.0), np.array([0.0, 0.0, 0.0, 1.0])
    )


def poses(
    model: pin.Model, q: Array, base: Array | None = None, pivot: Array | None = None
) -> Poses:
    """Forward kinematics of the joint positions q, (F, n), on a base with the attitude (x, y, z, w), (F, 4).

    The base turns about its point `pivot`, m, (3,), or about its origin. All frames at one go, as a log of hours has a
    million.
    """
    local = np.tile(np.eye(4), (len(q), model.njoints, 1, 1))
    if base is not None:
        local[:, 0, :3, :3] = Rotation.from_quat(base).as_matrix()
        local[:, 0, :3, 3] = 0.0 if pivot is None else pivot - local[:, 0, :3, :3] @ pivot
    world = local.copy()
    for i, joint in enumerate(list(model.createData().joints)[1:], start=1):
        start = model.jointPlacements[i]
        value = q[:, i - 1, None]
        slide, axis = np.split(np.ravel(joint.S), 2)
        turn = Rotation.from_matrix(start.rotation) * Rotation.from_rotvec(value * axis)
        local[:, i, :3, :3] = turn.as_matrix()
        local[:, i, :3, 3] = start.translation + value * (start.rotation @ slide)
        world[:, i] = world[:, model.parents[i]] @ local[:, i]
    return Poses(local, world)
