"""The rig as the plant knows it: a chain of links, a payload, and motors with their friction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EYE = np.eye(3)


def put(items, place, item):
    """Return a tuple with another item at one place."""
    changed = list(items)
    changed[place] = item
    return tuple(changed)


def spread_of(mass, com):
    """Return m (cᵀc 1 - c cᵀ), what a mass adds to the inertia about a point that it is away from, (3, 3)."""
    return mass * (com @ com * EYE - np.outer(com, com))


@dataclass(frozen=True)
class Inertia:
    """Mass (kg), centre of mass (3, m) and inertia tensor about it (3x3, kg m²), all in one frame."""

    mass: float
    com: Array
    tensor: Array

    def seen_from(self, rotation, position):
        """The same body in the frame in which its present frame stands at `position`, turned by `rotation`."""
        return Inertia(
            self.mass, rotation @ self.com + position, rotation @ self.tensor @ rotation.T
        )

    def times(self, share):
        """A body of the same shape and another mass."""
        return Inertia(share * self.mass, self.com, share * self.tensor)

    def about_origin(self):
        """Inertia about the frame's origin, kg m², (3, 3)."""
        return self.tensor + spread_of(self.mass, self.com)

    def plus(self, other):
        """Both bodies as one rigid body."""
        mass = self.mass + other.mass
        com = (self.mass * self.com + other.mass * other.com) / mass
        return Inertia(mass, com, self.about_origin() + other.about_origin() - spread_of(mass, com))

    def vector(self):
        """(m, m c, Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the origin): what torque is linear in, (10,)."""
        upper = self.about_origin()[np.triu_indices(3)]
        return np.concatenate([[self.mass], self.mass * self.com, upper])


@dataclass(frozen=True)
class Link:
    """A body and the revolute joint that carries it; the joint frame stands at `position`, turned by `rotation`. A
    `fixed` one is so in the URDF only: the plant has such a joint no more."""

    name: str
    joint: str
    rotation: Array
    position: Array
    axis: Array
    inertia: Inertia
    lower: float
    upper: float
    continuous: bool = False
    fixed: bool = False


@dataclass(frozen=True)
class Payload:
    """What the last link carries, bolted on by a fixed joint."""

    name: str
    joint: str
    rotation: Array
    position: Array
    inertia: Inertia


@dataclass(frozen=True)
class Motor:
    """One joint's motor and bearing; dry friction (N m) and viscous friction (N m s/rad) are the plant's secret."""

    slots: int
    poles: int
    torque_constant: float
    tau_max: float
    coulomb: float
    viscous: float
    warm_up: float


@dataclass(frozen=True)
class Rig:
    """Base link, a serial chain of links, one motor for each, and a payload on the last."""

    name: str
    base: str
    links: tuple[Link, ...]
    motors: tuple[Motor, ...]
    payload: Payload
    armature: tuple[float, ...]
    velocity_limit: float

    @property
    def joints(self):
        """Joint names, base to tip."""
        return tuple(link.joint for link in self.links)

    @property
    def bodies(self):
        """One rigid body for each joint, the payload merged into the last."""
        payload = self.payload
        carried = payload.inertia.seen_from(payload.rotation, payload.position)
        return [link.inertia for link in self.with_body(-1, carried).links]

    def of_motors(self, kind):
        """One property of every motor, (n,)."""
        return np.array([getattr(motor, kind) for motor in self.motors])

    @property
    def coulomb(self):
        """Dry friction of each joint, N m, (n,)."""
        return self.of_motors("coulomb")

    @property
    def viscous(self):
        """Viscous friction of each joint, N m s/rad, (n,)."""
        return self.of_motors("viscous")

    @property
    def tau_max(self):
        """Torque limit of each joint, N m, (n,)."""
        return self.of_motors("tau_max")

    def with_motor(self, joint, **least):
        """A rig with a motor on `joint` that has at least this much `tau_max`, `coulomb` or `viscous`."""
        motor = self.motors[joint]
        more = {kind: max(getattr(motor, kind), value) for kind, value in least.items()}
        return replace(self, motors=put(self.motors, joint, replace(motor, **more)))

    def with_link(self, link, **changed):
        """A rig with another link."""
        return replace(self, links=put(self.links, link, replace(self.links[link], **changed)))

    def with_body(self, link, extra):
        """A rig with `extra` (in the link's frame) frozen to a link."""
        return self.with_link(link, inertia=self.links[link].inertia.plus(extra))

    def with_inertias(self, change):
        """A rig with every inertia changed, the links' and then the payload's."""
        links = tuple(replace(link, inertia=change(link.inertia)) for link in self.links)
        return replace(self, links=links).with_payload(change(self.payload.inertia))

    def with_payload(self, inertia):
        """A rig whose payload has another inertia (in the payload's own frame)."""
        return replace(self, payload=replace(self.payload, inertia=inertia))


def cube_edge(mass):
    """Return the edge of a cube of this mass, as dense as cameras are, m."""
    return float((mass / 700.0) ** (1.0 / 3.0))


def point_mass(mass, position):
    """A mass without size at `position`."""
    return Inertia(mass, position, np.zeros((3, 3)))


def rotation_about(axis, angle):
    """Rodrigues: R = 1 + sin θ K + (1 - cos θ) K², with `axis` a unit vector; of one angle or many, (..., 3, 3)."""
    k = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    s = np.sin(angle)[..., None, None]
    c = np.cos(angle)[..., None, None]
    return EYE + s * k + (1.0 - c) * (k @ k)
