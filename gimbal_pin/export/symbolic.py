"""A model's equations in casadi's symbols: rigid body on a moving base, the camera's kinematics, the terms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Sample
from gimbal_pin.errors import ModelError
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.sight import gyros_between
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    import casadi

Symbols = Any
"""casadi's SX: a scalar, or a matrix of them."""

ROUNDING = 1e-15
"""Entries of a placement below this are what a cosine of 90° leaves in double precision: they count as zero."""
PINOCCHIO_TOLERANCE = 1e-12
"""Largest difference from Pinocchio, N m (and rad/s, rad/s²), times the size of the value where that is over one."""
STATES = 100
"""Random states at which both are compared."""


@dataclass(frozen=True)
class RecursionJoint:
    """One joint as the recursion needs it.

    Attributes:
        parent: Index of the joint before it; -1 for the base.
        rotation: Attitude of its frame in the parent's at angle zero, (3, 3).
        place: Its origin in the parent's frame, m, (3,).
        axis: Unit axis in its own frame, (3,).
        mass: Mass of its body, kg.
        lever: Centre of mass in its own frame, m, (3,).
        inertia: About the centre of mass, kg m², (3, 3).
    """

    parent: int
    rotation: Array
    place: Array
    axis: Array
    mass: float
    lever: Array
    inertia: Array


def list_recursion_joints(model: pin.Model) -> list[RecursionJoint]:
    """Return the joints of a floating model (see `build_floating_model`), the free-flyer left out."""
    out = []
    q = pin.neutral(model)
    for j in range(2, model.njoints):
        data = model.joints[j].createData()
        model.joints[j].calc(data, q)
        place = model.jointPlacements[j]
        body = model.inertias[j]
        axis = np.asarray(data.S).ravel()[3:]
        out.append(
            RecursionJoint(
                int(model.parents[j]) - 2,
                drop_rounding(place.rotation),
                drop_rounding(place.translation),
                drop_rounding(axis),
                float(body.mass),
                np.asarray(body.lever),
                np.asarray(body.inertia),
            )
        )
    return out


def lumped(joints: Sequence[RecursionJoint]) -> tuple[list[Array], list[Array]]:
    """Return every body's first moment, kg m, (3,), and inertia, kg m², (3, 3), about its own origin.

    What is beyond a joint of the body counts as a mass in that joint.
    """
    beyond = [joint.mass for joint in joints]
    firsts = [joint.mass * joint.lever for joint in joints]
    inertias = [joint.inertia + joint.mass * spread(joint.lever) for joint in joints]
    for j, joint in reversed(list(enumerate(joints))):
        if joint.parent >= 0:
            beyond[joint.parent] += beyond[j]
            firsts[joint.parent] = firsts[joint.parent] + beyond[j] * joint.place
            inertias[joint.parent] = inertias[joint.parent] + beyond[j] * spread(joint.place)
    return firsts, inertias


def spread(r: Array) -> Array:
    """Inertia of one kilogram at r about the origin: ``|r|² I - r rᵀ``."""
    return float(r @ r) * np.eye(3) - np.outer(r, r)


def drop_rounding(x: Array) -> Array:
    """Return an array with entries of `ROUNDING` set to zero."""
    return np.where(np.abs(x) < ROUNDING, 0.0, x)


class Chain:
    """The bodies of a rig at symbolic angles.

    Attributes:
        ca: The module casadi, which is loaded where a controller is exported and nowhere else.
        joints: The joints.
        q: Angles, rad, (n).
    """

    def __init__(self, rig: Rig) -> None:
        """Lay out the rotations of all joints."""
        self.ca = loaded()
        self.rig = rig
        self.model = rig.floating
        self.joints = list_recursion_joints(rig.floating)
        self.n = len(self.joints)
        self.q = self.ca.SX.sym("q", self.n)
        self.turns = [self.turn(joint, self.q[j]) for j, joint in enumerate(self.joints)]

    def turn(self, joint: RecursionJoint, angle: Symbols) -> Symbols:
        """Attitude of a joint's frame in its parent's: ``R (I + sin q [s] + (1 - cos q) [s]²)``, (3, 3)."""
        skew = pin.skew(joint.axis)
        rodrigues = (
            self.ca.SX(np.eye(3) + skew @ skew)
            + self.ca.sin(angle) * skew
            - self.ca.cos(angle) * (skew @ skew)
        )
        return self.ca.mtimes(self.ca.SX(joint.rotation), self.cleaned(rodrigues))

    def cleaned(self, x: Symbols) -> Symbols:
        """Return a matrix of symbols without entries that are zero whatever the angle."""
        return self.ca.sparsify(self.ca.simplify(x))

    def torque(self) -> casadi.Function:
        """``tau = D(q) a + C(q, v) v + G`` on a base of specific force f, rate w and angular acceleration dw.

        Newton and Euler's recursion about every joint's own origin: what is beyond a joint counts as a mass in it
        (first moment ``h``, inertia ``I``), and the origin's whole acceleration acts on ``h`` alone. No weight runs
        out to the tip and back, to cancel there but for the rounding of its parts.
        """
        ca = self.ca
        v = ca.SX.sym("v", self.n)
        a = ca.SX.sym("a", self.n)
        f, w, dw = (ca.SX.sym(name, 3) for name in ("f", "w", "dw"))
        rates = list[Symbols]()
        swings = list[Symbols]()
        origins = list[Symbols]()
        offsets = list[Symbols]()
        for j, joint in enumerate(self.joints):
            rate, swing, origin = (
                x[joint.parent] if joint.parent >= 0 else y
                for x, y in zip((rates, swings, origins), (w, dw, f))
            )
            place = ca.SX(joint.place)
            axis = ca.SX(joint.axis)
            back = self.turns[j].T
            offsets.append(ca.cross(swing, place) + ca.cross(rate, ca.cross(rate, place)))
            origins.append(ca.mtimes(back, origin + offsets[j]))
            own = axis * v[j]
            carried = ca.mtimes(back, rate)
            rates.append(carried + own)
            swings.append(ca.mtimes(back, swing) + axis * a[j] + ca.cross(carried, own))
        firsts, inertias = lumped(self.joints)
        h = [ca.SX(x) for x in firsts]
        tau = [ca.SX(0)] * self.n
        pushes = [ca.SX(3, 1)] * self.n
        moments = [ca.SX(3, 1)] * self.n
        rotors = self.rig.armature
        for j in reversed(range(self.n)):
            joint = self.joints[j]
            rate = rates[j]
            swing = swings[j]
            first = ca.SX(firsts[j])
            inertia = ca.SX(inertias[j])
            push = pushes[j] + ca.cross(swing, first) + ca.cross(rate, ca.cross(rate, first))
            moment = (
                moments[j] + ca.mtimes(inertia, swing) + ca.cross(rate, ca.mtimes(inertia, rate))
            )
            tau[j] = (
                ca.dot(ca.SX(joint.axis), moment + ca.cross(h[j], origins[j]))
                + float(rotors[j]) * a[j]
            )
            if joint.parent >= 0:
                k = joint.parent
                place = ca.SX(joint.place)
                beyond, through, turned = (
                    ca.mtimes(self.turns[j], x) for x in (h[j], push, moment)
                )
                h[k] += beyond
                pushes[k] += through
                moments[k] += turned + ca.cross(beyond, offsets[j]) + ca.cross(place, through)
        return self.function(
            "rigid_torque", dict(q=self.q, v=v, a=a, f=f, w=w, dw=dw), dict(tau=ca.vertcat(*tau))
        )

    def camera(self) -> casadi.Function:
        """Attitude R of the camera in the base link, row by row, and J: ``ω_c = Rᵀ ω + J q̇`` in the camera's frame."""
        frame = self.frame(self.rig.camera_frame)
        R = self.attitude(frame)
        columns = [self.ca.SX(3, 1)] * self.n
        at = int(frame.parentJoint) - 2
        onward = self.ca.SX(drop_rounding(frame.placement.rotation)).T
        while at >= 0:
            columns[at] = self.ca.mtimes(onward, self.ca.SX(self.joints[at].axis))
            onward = self.ca.mtimes(onward, self.turns[at].T)
            at = self.joints[at].parent
        J = self.ca.horzcat(*columns)
        return self.function("camera", dict(q=self.q), dict(R=self.rows(R), J=self.rows(J)))

    def drift(self) -> casadi.Function:
        """Camera's angular acceleration in its own frame while the joints do not accelerate, rad/s², (3)."""
        ca = self.ca
        frame = self.frame(self.rig.camera_frame)
        v = ca.SX.sym("v", self.n)
        w = ca.SX.sym("w", 3)
        dw = ca.SX.sym("dw", 3)
        rates = list[Symbols]()
        swings = list[Symbols]()
        for j, joint in enumerate(self.joints):
            rate, swing = (
                (w, dw) if joint.parent < 0 else (rates[joint.parent], swings[joint.parent])
            )
            carried = ca.mtimes(self.turns[j].T, rate)
            own = ca.SX(joint.axis) * v[j]
            rates.append(carried + own)
            swings.append(ca.mtimes(self.turns[j].T, swing) + ca.cross(carried, own))
        swing = ca.mtimes(
            ca.SX(drop_rounding(frame.placement.rotation)).T, swings[int(frame.parentJoint) - 2]
        )
        return self.function("camera_drift", dict(q=self.q, v=v, w=w, dw=dw), dict(drift=swing))

    def between(self) -> casadi.Function:
        """Attitude of the camera in the base link and in each link between with a gyro, as quaternions."""
        camera = self.orientation(self.rig.camera_frame)
        links = [self.inverse(self.orientation(link)) for link in gyros_between(self.rig)]
        found = [camera, *[self.product(link, camera) for link in links]]
        return self.function("camera_between", dict(q=self.q), dict(to=self.ca.vertcat(*found)))

    def orientation(self, link: str) -> Symbols:
        """Attitude of a link's frame in the base link, a quaternion (w, x, y, z)."""
        ca = self.ca
        frame = self.frame(link)
        path = list[int]()
        at = int(frame.parentJoint) - 2
        while at >= 0:
            path.append(at)
            at = self.joints[at].parent
        out = ca.SX([1, 0, 0, 0])
        for j in reversed(path):
            half = self.q[j] / 2
            joint = self.joints[j]
            turn = ca.vertcat(ca.cos(half), ca.sin(half) * ca.SX(joint.axis))
            out = self.product(self.product(out, self.constant(joint.rotation)), turn)
        return self.product(out, self.constant(frame.placement.rotation))

    def constant(self, rotation: Array) -> Symbols:
        """Quaternion of a rotation matrix of numbers."""
        x, y, z, w = drop_rounding(pin.Quaternion(np.asarray(rotation)).coeffs())
        return self.ca.SX([w, x, y, z])

    def product(self, a: Symbols, b: Symbols) -> Symbols:
        """Product of two quaternions."""
        ca = self.ca
        u = a[1:]
        v = b[1:]
        return ca.vertcat(a[0] * b[0] - ca.dot(u, v), a[0] * v + b[0] * u + ca.cross(u, v))

    def inverse(self, a: Symbols) -> Symbols:
        """Inverse of a unit quaternion."""
        return self.ca.vertcat(a[0], -a[1:])

    def log(self, a: Symbols) -> Symbols:
        """The shorter of the two turns that an attitude is, rad, (3,)."""
        ca = self.ca
        size = self.ca.norm_2(a[1:])
        return 2 * ca.copysign(ca.atan2(size, ca.fabs(a[0])), a[0]) / ca.fmax(size, 1e-18) * a[1:]

    def frame(self, link: str) -> pin.Frame:
        """Return a link's frame."""
        return self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]

    def attitude(self, frame: pin.Frame) -> Symbols:
        """Attitude of a frame in the base link, (3, 3)."""
        R = self.ca.SX(drop_rounding(frame.placement.rotation))
        at = int(frame.parentJoint) - 2
        while at >= 0:
            R = self.ca.mtimes(self.turns[at], R)
            at = self.joints[at].parent
        return R

    def rows(self, matrix: Symbols) -> Symbols:
        """Entries of a matrix row by row, as C stores them."""
        return self.ca.vec(matrix.T)

    def function(
        self, name: str, inputs: dict[str, Symbols], outputs: dict[str, Symbols]
    ) -> casadi.Function:
        """Return a function of named vectors, what its formulas share worked out but once."""
        dense = [self.ca.densify(x) for x in self.ca.cse(list(outputs.values()))]
        return self.ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs))


def loaded() -> Any:
    """Return casadi, its arithmetic open to numpy's functions, which the causes' formulas are written with.

    Raises:
        ModelError: It is not installed.
    """
    try:
        import casadi
    except ImportError:
        mend = "install it with: pip install 'gimbal-pin[export]'"
        raise ModelError("export", "needs casadi, which is not installed", mend) from None
    casadi.GlobalOptions.setNumpyMode(1)
    return casadi


def terms(model: Model) -> tuple[casadi.Function, list[float]]:
    """Return the torque of all terms that are not affine, and their coefficients: the causes' own lines, on symbols.

    An affine term (``c0 + c1 slide + c2 v``) is three numbers a joint, see `Resistance`.
    """
    ca = loaded()
    n = model.rig.n
    names = ("q", "v", "a", "slide", "tau", "weight")
    own = {name: ca.SX.sym(name, n) for name in names}
    t = ca.SX.sym("t")
    out = [ca.SX(0)] * n
    values = list[float]()
    count = sum(
        len(term.values) for terms in model.by_joint for term in terms if not term.effect.affine
    )
    coefficients = ca.SX.sym("c", max(count, 1))
    for j, terms_here in enumerate(model.by_joint):
        at = {name: x[j] for name, x in own.items()}
        sample = Sample(t=t, **at)
        for term in terms_here:
            if not term.effect.affine:
                for value, basis in zip(term.values, term.effect.basis(sample)):
                    out[j] = out[j] + coefficients[len(values)] * basis
                    values.append(float(value))
    found = [ca.densify(ca.cse(ca.vertcat(*out)))]
    return ca.Function(
        "terms", [coefficients, t, *own.values()], found, ["c", "t", *names], ["added"]
    ), values


def checked(
    rig: Rig, functions: Sequence[casadi.Function], sight: Any, rng: np.random.Generator
) -> float:
    """Return the largest difference between the symbols and Pinocchio, in double precision, relative over one.

    Raises:
        ModelError: It is larger than `PINOCCHIO_TOLERANCE`: the rig has something that the recursion does not know.
    """
    torque, camera, drift, between = functions
    worst = 0.0
    n = rig.n
    data = sight.data
    for _ in range(STATES):
        q = rng.uniform(-np.pi, np.pi, n)
        v = rng.normal(0, 3, n)
        a = rng.normal(0, 30, n)
        f = rng.normal(0, 10, 3)
        w = rng.normal(0, 3, 3)
        dw = rng.normal(0, 30, 3)
        state = np.concatenate([np.zeros(6), [1.0], q])
        expected = pin.rnea(
            sight.model,
            data,
            state,
            np.concatenate([np.zeros(3), w, v]),
            np.concatenate([f, dw, a]),
        )[6:]
        turned = sight.between(q)
        quaternions = np.array(between(q)).reshape(-1, 4).tolist()
        pairs = [
            (torque(q, v, a, f, w, dw), expected),
            (camera(q)[0], turned[0].ravel()),
            (turned[0].T @ w + np.array(camera(q)[1]).reshape(3, n) @ v, sight.rate(q, v, w)),
            (drift(q, v, w, dw), sight.drift(q, v, w, dw)),
            ([pin.Quaternion(*to).matrix() for to in quaternions], np.ravel(turned)),
        ]
        for found, right in pairs:
            gap = np.abs(np.array(found).ravel() - right)
            worst = max(worst, float((gap / np.maximum(1.0, np.abs(right).max())).max()))
    if not worst <= PINOCCHIO_TOLERANCE:
        what = f"moves otherwise than Pinocchio says, by {worst:.2g}"
        raise ModelError(f"rig {rig.name}", what, "export a rig of revolute joints alone")
    return worst


def table(command: Callable[[float], float], limit: float) -> list[tuple[float, float]]:
    """Return torques, N m, and what to command for them: points between which a straight line is close enough.

    Empty where a drive takes the torque itself.

    Args:
        command: What to command, N m, so that a torque acts.
        limit: Largest torque of the motor, N m; beyond twice of it a command is cut anyway.
    """
    sizes = [4 * limit / 2**k for k in range(CURVE_HALVINGS)]
    ends = [*(-size for size in sizes), 0.0, *reversed(sizes)]
    points = [(ends[0], command(ends[0]))]
    for low, high in pairwise(ends):
        points += refined(command, limit, (low, command(low)), (high, command(high)), DEPTH)
    return [] if all(abs(x - y) <= COMMAND_TOLERANCE * limit for x, y in points) else points


COMMAND_TOLERANCE = 1e-6
"""Error of a table of commands, in torque limits: a tenth of what the exported controller is compared to."""
CURVE_HALVINGS = 14
"""Halvings of the largest torque between which a curve is looked at: a dead zone may be a thousandth of the limit."""
DEPTH = 24
"""Halvings of an interval of such a table: then it is a jump."""


def refined(
    command: Callable[[float], float],
    limit: float,
    low: tuple[float, float],
    high: tuple[float, float],
    depth: int,
) -> list[tuple[float, float]]:
    """Return the points after `low` up to `high`."""
    thirds = [low[0] + share * (high[0] - low[0]) for share in (0.25, 0.5, 0.75)]
    middle = [(x, command(x)) for x in thirds]
    gap = max(
        abs(y - (low[1] + (high[1] - low[1]) * (x - low[0]) / (high[0] - low[0])))
        for x, y in middle
    )
    beyond = max(0.0, min(abs(low[1]), abs(high[1])) - 2 * limit)
    if depth == 0 or gap <= COMMAND_TOLERANCE * limit + beyond:
        return [high]
    return [
        *refined(command, limit, low, middle[1], depth - 1),
        *refined(command, limit, middle[1], high, depth - 1),
    ]
