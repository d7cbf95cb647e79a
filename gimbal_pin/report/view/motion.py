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
        colour: Colour of each moved link, 0 its own to 1 red, shape (F, n), or None.
        scale: What the colour means.
        speed: Seconds of the log per second of playing.
        pivot: Point of the base that stays where it is while the base turns, m in the base's frame, (3,).
        wanted: Attitude that the camera should keep, (3, 3), or None: there is no target.
    """

    t: Array
    q: Array
    q_ref: Array | None
    base: Array | None = None
    colour: Array | None = None
    scale: str = "0 to 1"
    speed: float = 1.0
    pivot: Array = field(default_factory=lambda: np.zeros(3))
    wanted: Array | None = None

    def first(self, count: int) -> Frames:
        """Return the first `count` frames."""
        cut = {
            name: value[:count]
            for name in ("t", "q", "q_ref", "base", "colour")
            if (value := getattr(self, name)) is not None
        }
        return replace(self, **cut)

    @property
    def clock(self) -> Array:
        """Time since the start of playing, s, (F,)."""
        return np.asarray((self.t - self.t[0]) / self.speed)


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the n joint frames over F frames.

    Attributes:
        position: Origin in the parent joint's frame, m, shape (F, n, 3).
        quaternion: Attitude in the parent joint's frame, (x, y, z, w), shape (F, n, 4).
        base: Attitude of the base in the world, (x, y, z, w), shape (F, 4).
        place: Where the base's origin is in the world, m, shape (F, 3).
        world: Pose in the world; index 0 is the base's, shape (F, n + 1, 4, 4).
    """

    position: Array
    quaternion: Array
    base: Array
    place: Array
    world: Array


def motion(rig: Rig, log: Log, fps: float, speed: float, ghost: bool, colour: Array | None) -> Frames:
    """Interpolate a log at the times t₀ + k speed / fps.

    Raises:
        UsageError: `fps`, `speed` or the shape of `colour` cannot be used.
        LogError: The log is empty or lacks a joint of the rig.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0):
            raise UsageError(name, f"is {value}", "give a positive number")
    if not len(log):
        raise LogError(log.name, "has no samples", "give a log with at least one row")
    if colour is not None and np.shape(colour) != log.q.shape:
        raise UsageError(
            "colour", f"has shape {np.shape(colour)}", f"give one value per sample and joint {log.q.shape}"
        )
    order = log.columns(rig)
    times = frame_times(log.t, speed / fps)
    reference = log.q_ref if ghost else None
    return Frames(
        t=times,
        q=interpolate(times, log.t, log.q[:, order]),
        q_ref=None if reference is None else interpolate(times, log.t, reference[:, order]),
        base=base_attitude(rig, log, times),
        colour=None if colour is None else np.clip(interpolate(times, log.t, np.asarray(colour)[:, order]), 0.0, 1.0),
        speed=speed,
    )


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
    turns = np.where(np.sum(imu.quat[1:] * imu.quat[:-1], axis=1) < 0, -1.0, 1.0)  # q and -q are one attitude
    steady = imu.quat * np.cumprod(np.append(1.0, turns))[:, None]
    found = interpolate(times, log.t, steady)[:, [1, 2, 3, 0]]
    length = np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(length > 0, found / np.where(length > 0, length, 1.0), np.array([0.0, 0.0, 0.0, 1.0]))


def poses(model: pin.Model, q: Array, base: Array | None = None, pivot: Array | None = None) -> Poses:
    """Forward kinematics of the joint positions q, (F, n), on a base with the attitude (x, y, z, w), (F, 4).

    The base turns about its point `pivot`, m, (3,), or about its origin.
    """
    frames, joints = len(q), model.njoints - 1
    position, quaternion = np.empty((frames, joints, 3)), np.empty((frames, joints, 4))
    world = np.tile(np.eye(4), (frames, joints + 1, 1, 1))
    for i in range(1, joints + 1):
        local, quaternion[:, i - 1] = pose_joint(model, i, q[:, i - 1])
        position[:, i - 1] = local[:, :3, 3]
        world[:, i] = world[:, model.parents[i]] @ local
    if base is None:
        return Poses(position, quaternion, np.tile([0.0, 0.0, 0.0, 1.0], (frames, 1)), np.zeros((frames, 3)), world)
    turn = np.tile(np.eye(4), (frames, 1, 1, 1))
    turn[:, 0, :3, :3] = Rotation.from_quat(base).as_matrix()
    if pivot is not None:
        turn[:, 0, :3, 3] = pivot - turn[:, 0, :3, :3] @ pivot
    return Poses(position, quaternion, base, turn[:, 0, :3, 3], turn @ world)


def pose_joint(model: pin.Model, i: int, q: Array) -> tuple[Array, Array]:
    """Return the pose of joint `i` in its parent's frame at its positions q, (F,): (F, 4, 4), and (x, y, z, w), (F, 4).

    All frames at one go, as a log of hours has a million.
    """
    start = model.jointPlacements[i]
    slide, axis = np.split(np.ravel(model.createData().joints[i].S), 2)
    turn = Rotation.from_matrix(start.rotation) * Rotation.from_rotvec(q[:, None] * axis)
    local = np.tile(np.eye(4), (len(q), 1, 1))
    local[:, :3, :3] = turn.as_matrix()
    local[:, :3, 3] = start.translation + q[:, None] * (start.rotation @ slide)
    return local, turn.as_quat()
