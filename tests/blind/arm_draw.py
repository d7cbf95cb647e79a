"""Serial arms drawn at random: one to seven joints, tubes between them, on a floor, a wall or under a ceiling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .draws import draw_sign
from .rig_draw import WINDINGS, frame_of, strong_enough, tilted
from .rigs import EYE, Inertia, Link, Motor, Payload, Rig, rotation_about

X, Y, Z = EYE
PATTERNS = {
    1: ("P",), 2: ("PP", "ZP"), 3: ("ZPP", "PPP"), 4: ("ZPPP", "ZPZP"), 5: ("ZPPPZ", "ZPPZP"),
    6: ("ZPPPZP", "ZPPZPZ"), 7: ("ZPZPZPZ", "ZPZPZPP"),
}  # fmt: skip
"""Joints from base to tip: Z turns about the link before it, P bends across it."""
TRAVEL = {"Z": (-2.8, 2.8), "P": (-0.5, 2.0)}
MOUNTS = (EYE, EYE, rotation_about(X, np.pi), rotation_about(Y, 0.5 * np.pi))
ROLLING = 0.2
"""Motor of a joint that turns about the link before it, against one that bends across."""
NAMES = ("joint{}", "arm_joint_{}", "j{}", "axis_{}_joint")


def _tube(rng, mass, length):
    """A tube along z with its motor somewhere on it, a little bent: mass kg, length m."""
    radius = rng.uniform(0.12, 0.22) * length + 0.02
    across = mass / 12.0 * (3.0 * radius**2 + length**2)
    along = 0.5 * mass * radius**2
    turn = tilted(rng, 12.0)
    com = np.array([*(0.25 * radius * rng.uniform(-1.0, 1.0, 2)), length * rng.uniform(0.35, 0.6)])
    return Inertia(mass, com, turn @ np.diag([across, across, along]) @ turn.T)


def _motor(rng, tau_max):
    slots, poles = WINDINGS[rng.integers(len(WINDINGS))]
    friction = tau_max * rng.uniform(0.008, 0.03), tau_max * rng.uniform(0.004, 0.015)
    return Motor(rng.uniform(0.1, 2.0), round(tau_max, 3), slots, poles, 16, *friction, 60.0)


def _links(rng, pattern, lengths, masses):
    """The chain; frames either stay parallel or have their own z along the axis."""
    name = str(rng.choice(NAMES))
    own = rng.random() < 0.5
    world = EYE
    links = []
    mount = MOUNTS[rng.integers(len(MOUNTS))]
    for i, kind in enumerate(pattern):
        sign = draw_sign(rng)
        direction = sign * (Z if kind == "Z" else Y)
        frame = frame_of(direction, rng) if own else EYE
        low, high = sorted(sign * end for end in TRAVEL[kind])
        body = _tube(rng, masses[i], lengths[i])
        inertia = Inertia(body.mass, frame.T @ body.com, frame.T @ body.tensor @ frame)
        step = Z * (lengths[i - 1] if i else 0.1) + 0.02 * rng.uniform(-1.0, 1.0, 3)
        fixed = world.T @ frame
        place = world.T @ step
        if i == 0:
            fixed = mount @ fixed
            place = mount @ place
        axis = frame.T @ direction
        links.append(
            Link(f"link_{i + 1}", name.format(i + 1), fixed, place, axis, inertia, low, high)
        )
        world = frame
    return links


def draw_arm(rng, axes):
    """An arm of `axes` joints, 0.3–1.2 m long, with a camera at its tip."""
    pattern = str(rng.choice(PATTERNS[axes]))
    reach = float(rng.uniform(0.2, 0.35) + rng.uniform(0.02, 0.12) * axes)
    lengths = rng.uniform(0.7, 1.3, axes)
    lengths *= reach / lengths.sum()
    masses = 12.0 * reach**2 / axes * 0.85 ** np.arange(axes) * rng.uniform(0.7, 1.3, axes) + 0.1
    links = _links(rng, pattern, lengths, masses)
    camera = float(rng.uniform(0.15, 0.4) * masses.mean())
    edge = float((camera / 700.0) ** (1.0 / 3.0))
    box = Inertia(
        camera,
        0.3 * edge * rng.normal(size=3),
        camera * edge**2 / 6.0 * np.diag(rng.uniform(0.8, 1.2, 3)),
    )
    outward = np.cumsum(masses[::-1])[::-1] + camera
    beyond = np.cumsum(lengths[::-1])[::-1]
    tip = Payload("camera", "camera_mount", tilted(rng, 10.0), links[-1].inertia.com * 2.0, box)
    work = np.array([ROLLING if kind == "Z" and i else 1.0 for i, kind in enumerate(pattern)])
    motors = tuple(
        _motor(rng, float(x)) for x in 4.0 * work * outward * beyond * rng.uniform(0.7, 1.2, axes)
    )
    speed = rng.uniform(2.0, 4.5)
    rig = Rig(f"arm_{pattern}", "base", tuple(links), motors, tip, (0.0,) * axes, speed)
    return strong_enough(rng, rig)


def locked(rig, joint):
    """The rig with one joint bolted at zero: its link grows into the one before it, or into the base."""
    gone = rig.links[joint]
    links = [*rig.links[:joint], *rig.links[joint + 1 :], rig.payload]
    if joint > 0:
        before = links[joint - 1]
        carried = gone.inertia.seen_from(gone.rotation, gone.position)
        links[joint - 1] = replace(before, inertia=before.inertia.plus(carried))
    after = links[joint]
    turned = gone.rotation @ after.rotation
    moved = gone.rotation @ after.position + gone.position
    links[joint] = replace(after, rotation=turned, position=moved)
    motors = rig.motors[:joint] + rig.motors[joint + 1 :]
    parts = {"links": tuple(links[:-1]), "payload": links[-1], "motors": motors}
    return replace(rig, **parts, armature=rig.armature[:-1])
