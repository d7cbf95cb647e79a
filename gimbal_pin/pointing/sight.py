"""Kinematics of the camera on a base that moves: attitude, Jacobian, the motion that holds it, singular poses."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from gimbal_pin.control.laws.uncertainty import home
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.rig import Rig

# Looked up once, as they run several times a sample.
LOCAL = pin.LOCAL
joint_jacobians = pin.computeJointJacobians
frame_jacobian = pin.getFrameJacobian
moved = pin.forwardKinematics
placed = pin.updateFramePlacement
frame_velocity = pin.getFrameVelocity
frame_acceleration = pin.getFrameAcceleration
STEEP = 4.0
"""Largest entry of the Jacobian's inverse that is believed: beyond it (roll past 75° with three axes) it is damped."""
DAMPING = 1 / (2 * STEEP)
"""λ of the damped inverse: no singular value then gives more than 1/(2 λ), which is `STEEP`."""
ITERATIONS, STRIDE = 40, 0.3
REACHED = 1e-13
"""Newton steps to the angles of an attitude, and the longest of them, rad: longer ones may end a turn away."""


class View(NamedTuple):
    """The camera at some angles.

    Attributes:
        R: Its attitude in the base link, (3, 3).
        J: Jacobian of its rate in its own frame, the rows that the rig can command, (m, n).
        inverse: J's inverse, damped where J is near singular, with nothing for a row that J lacks, (n, 3).
        against: Its negative: rates of the joints that undo a turn of the camera, (n, 3).
        steep: Whether it was damped.
    """

    R: Array
    J: Array
    inverse: Array
    against: Array
    steep: bool


class Sight:
    """The camera of one rig: x of its frame is the line of sight."""

    def __init__(self, rig: Rig) -> None:
        """Take the rig's floating model; a rig of two axes commands the line of sight alone, not the roll about it."""
        self.rig = rig
        self.model = rig.floating
        n = rig.n
        self.home = home(rig)
        self.data = self.model.createData()
        self.fixed = rig.model
        self.own = rig.model.createData()
        self.frame, self.there = (
            m.getFrameId(rig.camera_frame, pin.FrameType.BODY) for m in (self.model, self.fixed)
        )
        links = gyros_between(rig)
        self.moved, self.betweens = (
            [m.getFrameId(link) for link in links] for m in (self.model, self.fixed)
        )
        self.rows, self.commanded = (
            (slice(0, 3), slice(3, 6)) if n > 2 else (slice(1, 3), slice(4, 6))
        )
        self.q = np.zeros(7 + n)
        self.v = np.zeros(6 + n)
        self.a = np.zeros(6 + n)
        self.q[6] = 1.0
        # Views of what changes in them: to fill these costs less than to make new arrays.
        self.angles = self.q[7:]
        self.joints = self.v[6:]
        self.turning = self.v[3:6]
        self.swing = self.a[3:6]

    def view(self, q: Array) -> View:
        """Return the camera at the angles q, rad, (n,)."""
        joint_jacobians(self.fixed, self.own, q)
        R = placed(self.fixed, self.own, self.there).rotation.copy()
        J = frame_jacobian(self.fixed, self.own, self.there, LOCAL).reshape(6, -1)[
            self.commanded
        ]  # n = 1: (6,)
        inverse, steep = inverted(J)
        if self.rows.start:
            inverse, own = np.zeros((len(inverse), 3)), inverse
            inverse[:, self.rows] = own
        return View(R, J, inverse, -inverse, steep)

    def attitude(self, q: Array) -> Array:
        """Return the camera's attitude in the base link, (3, 3)."""
        moved(self.fixed, self.own, q)
        R: Array = placed(self.fixed, self.own, self.there).rotation.copy()
        return R

    def between(self, q: Array) -> tuple[Array, ...]:
        """Return the camera's attitude in the base link, and in every link between that has a gyro, (3, 3) each."""
        camera = self.attitude(q)
        return (
            camera,
            *[
                placed(self.fixed, self.own, frame).rotation.T.dot(camera)
                for frame in self.betweens
            ],
        )

    def rates(self, q: Array, v: Array, w: Array) -> Array:
        """Rates of the camera and of every link between that has a gyro, each in its frame, rad/s, (3 + 3 L,)."""
        camera = self.rate(q, v, w)
        told = [frame_velocity(self.model, self.data, frame, LOCAL).angular for frame in self.moved]
        return np.concatenate([camera, *told]) if told else camera

    def drift(
        self, q: Array, v: Array, w: Sequence[float] | Array, dw: Sequence[float] | Array
    ) -> Array:
        """Camera's angular acceleration in its own frame while the joints do not accelerate, rad/s², (3,)."""
        self.angles[:], self.joints[:], self.turning[:], self.swing[:] = q, v, w, dw
        moved(self.model, self.data, self.q, self.v, self.a)
        found: Array = frame_acceleration(self.model, self.data, self.frame, LOCAL).angular
        return found

    def rate(self, q: Array, v: Array, w: Sequence[float] | Array) -> Array:
        """Camera's angular rate in its own frame, rad/s, (3,): what a gyro beside it reports."""
        self.angles[:], self.joints[:], self.turning[:] = q, v, w
        moved(self.model, self.data, self.q, self.v)
        return np.array(frame_velocity(self.model, self.data, self.frame, LOCAL).angular)

    def error(self, actual: Array, wanted: Array) -> Array:
        """``log(Rᵀ R_d)``: the turn that is left, in the camera's frame, rad, as far as the rig commands it, (m,)."""
        return np.asarray(pin.log3(actual.T.dot(wanted))[self.rows])

    def reached(self, base: Array, wanted: Array, start: Array) -> Array:
        """Angles at which the camera looks as wanted from a base of attitude `base`, by Newton from `start`, rad."""
        q = start
        for _ in range(ITERATIONS):
            view = self.view(q)
            left = self.error(base @ view.R, wanted)
            if float(np.abs(left).max()) < REACHED:
                break
            step = view.inverse[:, self.rows] @ left
            q = q + step * min(1.0, STRIDE / max(float(np.abs(step).max()), 1e-12))
        return q

    def obstacle(self, q: Array, base: Array, wanted: Array) -> str | None:
        """Return what keeps the camera from looking as wanted, (3, 3), at the angles that `reached` found, or None."""
        view = self.view(q)
        camera = self.rig.camera_frame
        if np.abs(self.error(base @ view.R, wanted)).max() > 1e-6:
            return f"its joints cannot turn {camera} to where it should look"
        if view.steep:
            return "it is near a singular pose where the camera looks as wanted"
        for joint, limit, angle in zip(self.rig.joints, self.rig.limits, q.tolist()):
            if not limit.lower <= angle <= limit.upper:
                return f"{joint} reaches its limit before the camera looks as wanted"
        return None

    @cached_property
    def centre(self) -> Array:
        """The point in the base link that is nearest to all axes at home, m, (3,): where they meet, if they do."""
        across, places = self.axes
        right = sum(P @ place for P, place in zip(across, places))
        return np.asarray(np.linalg.lstsq(sum(across), right, rcond=1e-9)[0])

    @cached_property
    def apart(self) -> float:
        """Largest distance of an axis from that point, m."""
        return max(float(np.linalg.norm(P @ (place - self.centre))) for P, place in zip(*self.axes))

    @cached_property
    def axes(self) -> tuple[list[Array], list[Array]]:
        """Per axis at home, the projection across it, (3, 3), and a point on it in the base link, m, (3,)."""
        self.view(self.home)
        joints = range(1, self.fixed.njoints)
        world = pin.LOCAL_WORLD_ALIGNED
        ways = [
            pin.getJointJacobian(self.fixed, self.own, j, world).reshape(6, -1)[3:, j - 1]
            for j in joints
        ]
        return [np.eye(3) - np.outer(way, way) for way in ways], [
            self.own.oMi[j].translation.copy() for j in joints
        ]


def gyros_between(rig: Rig) -> tuple[str, ...]:
    """Links with an IMU, by the rig's YAML, that are neither the base nor move with the camera."""
    camera = rig.model.frames[
        rig.model.getFrameId(rig.camera_frame, pin.FrameType.BODY)
    ].parentJoint
    at = {
        link: rig.model.frames[rig.model.getFrameId(link, pin.FrameType.BODY)].parentJoint
        for link in rig.config.imus
    }
    return tuple(link for link, joint in at.items() if joint not in (0, camera))


def inverted(J: Array) -> tuple[Array, bool]:
    """``J⁻¹``, ``Jᵀ(J Jᵀ)⁻¹`` for more axes, and ``Jᵀ(J Jᵀ + λ²)⁻¹`` where that is steep, as near roll ±90°."""
    m, n = J.shape
    if m == n == 3:
        exact = cofactors(J.tolist())
    elif m == 2:
        exact = invert_two_rows(*J.tolist())
    else:
        own = J @ J.T
        exact = J.T @ np.linalg.inv(own) if np.linalg.det(own) > STEEP ** (-2 * m) else None
        exact = None if exact is None or np.abs(exact).max() >= STEEP else exact
    if exact is not None:
        return exact, False
    return J.T @ np.linalg.inv(J @ J.T + DAMPING**2 * np.eye(m)), True


def cofactors(J: list[list[float]]) -> Array | None:
    """Inverse of a 3 by 3 matrix, on floats as that is faster; None where there is none, or a `STEEP` one."""
    (a, b, c), (d, e, f), (g, h, i) = J
    x = e * i - f * h
    y = f * g - d * i
    z = d * h - e * g
    size = a * x + b * y + c * z
    flat = [
        x,
        c * h - b * i,
        b * f - c * e,
        y,
        a * i - c * g,
        c * d - a * f,
        z,
        b * g - a * h,
        a * e - b * d,
    ]
    if max(max(flat), -min(flat)) >= STEEP * abs(size) or abs(size) < 1e-9:
        return None
    return np.array([entry / size for entry in flat]).reshape(3, 3)


def invert_two_rows(x: list[float], y: list[float]) -> Array | None:
    """``Jᵀ(J Jᵀ)⁻¹`` of J with the rows x and y, on floats as that is faster; None where it is a `STEEP` one."""
    a = sum([p * p for p in x])
    b = sum([p * q for p, q in zip(x, y)])
    d = sum([q * q for q in y])
    size = a * d - b * b
    if size <= STEEP**-4:
        return None
    exact = [[(d * p - b * q) / size, (a * q - b * p) / size] for p, q in zip(x, y)]
    return np.array(exact) if max([abs(entry) for row in exact for entry in row]) < STEEP else None


def unable(rig: Rig, wanted: Array) -> str | None:
    """Return why a rig cannot keep its camera's attitude on a platform that moves, or None if it can.

    Args:
        rig: The rig.
        wanted: R_d, the attitude in the world; of two axes the line of sight alone is asked for, (3, 3).
    """
    if not np.isfinite(rig.tau_max).all():
        return "its torque limits are not stated"
    sight = Sight(rig)
    return sight.obstacle(sight.reached(np.eye(3), wanted, sight.home), np.eye(3), wanted)


AXES = ("x, its line of sight", "y", "z")
"""Of the camera's frame."""
TAKES_PART = 0.3
"""Share of the joints' motion from which on a joint is named."""


def lost_turn(sight: Sight, q: Array) -> str:
    """Say what ``σ u = J v``, σ the least singular value of the Jacobian, means: 1/σ of motion along v to turn about u.

    A motor that cannot accelerate its joint 1/σ times as fast as the platform turns the camera does not hold it,
    whoever controls it.

    Args:
        sight: The camera's kinematics.
        q: Angles, rad, (n,).
    """
    left, values, right = np.linalg.svd(sight.view(q).J, full_matrices=False)
    named = AXES if len(left) == 3 else AXES[1:]
    axis = named[int(np.argmax(np.abs(left[:, -1])))]
    joints = [
        joint for joint, part in zip(sight.rig.joints, np.abs(right[-1])) if part > TAKES_PART
    ]
    times = f"{digits(1 / values[-1], 2)} times as fast" if values[-1] > 1e-3 else "without end"
    who = " and ".join(joints)
    return f"to turn the camera about {axis}, {who} would have to turn {times}, so nobody holds it there"


def holding(sight: Sight, wanted: Array, platform: Platform) -> Motion:
    """Return the joints' motion that keeps the camera's attitude, exactly, sample by sample."""
    if platform.quat is None:
        return holding(sight, wanted, Platform.still(platform.t))
    q = sight.home
    rows = []
    for R, w, dw in zip(
        Rotation.from_quat(np.asarray(platform.quat), scalar_first=True).as_matrix(),
        platform.w,
        platform.dw,
    ):
        q = sight.reached(R, wanted, q)
        view = sight.view(q)
        v = view.against @ (view.R.T @ w)
        rows.append((q, v, view.against @ sight.drift(q, v, w, dw)))
    return Motion(platform.t, *(np.array(x) for x in zip(*rows)))
