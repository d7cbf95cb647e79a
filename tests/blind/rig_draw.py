"""Rigs drawn at random: gimbals of one to three axes, handheld to heavy, and serial arms of one to seven joints."""

from dataclasses import replace

import numpy as np

from .draws import draw_sign, log_uniform
from .rigs import EYE, Inertia, Link, Motor, Payload, Rig, cube_edge, rotation_about
from .rnea import inverse_dynamics

X, Y, Z = EYE
WINDINGS = ((12, 14), (24, 22), (24, 28), (36, 42), (18, 16))
"""Slots and poles."""

# gimbals
ORDERS = {
    1: ("tilt", "roll", "pan", "swing"),
    2: ("pan_tilt", "roll_tilt", "pan_roll"),
    3: ("pan_roll_tilt", "pan_roll_tilt", "pan_tilt_roll", "roll_pan_tilt"),
}
AXES = {"pan": Z, "roll": X, "tilt": Y, "swing": Y}
JOINT_NAMES = (
    ("yaw", "roll", "tilt", "tilt"),
    ("pan", "roll", "pitch", "pitch"),
    ("azimuth_joint", "bank_joint", "elevation_joint", "swing_joint"),
    ("j_z", "j_x", "j_y", "j_y"),
)
LINK_NAMES = (
    ("head", "spine", "fork", "cradle", "camera"),
    ("base", "arm_1", "arm_2", "arm_3", "payload"),
    ("platform", "outer_ring", "middle_ring", "inner_ring", "lens"),
    ("mount", "link1", "link2", "link3", "sensor_head"),
)

# arms
PATTERNS = {
    1: ("P",), 2: ("PP", "ZP"), 3: ("ZPP", "PPP"), 4: ("ZPPP", "ZPZP"), 5: ("ZPPPZ", "ZPPZP"),
    6: ("ZPPPZP", "ZPPZPZ"), 7: ("ZPZPZPZ", "ZPZPZPP"),
}  # fmt: skip
"""Joints from base to tip: Z turns about the link before it, P bends across it."""
TRAVEL = {"Z": (-2.8, 2.8), "P": (-0.5, 2.0)}
MOUNTS = (EYE, EYE, rotation_about(X, np.pi), rotation_about(Y, 0.5 * np.pi))
ROLLING = 0.2
"""Motor of a joint that turns about the link before it, against one that bends across."""
ARM_JOINT_NAMES = ("joint{}", "arm_joint_{}", "j{}", "axis_{}_joint")


def _tilt(rng, degrees):
    """A rotation about a random axis, by up to so many degrees."""
    axis = rng.normal(size=3)
    return rotation_about(axis / np.linalg.norm(axis), np.radians(degrees) * rng.uniform(-1.0, 1.0))


def _frame_of(direction, rng):
    """A rotation whose third column is `direction`."""
    helper = X if abs(direction[0]) < 0.5 else Y
    first = np.cross(helper, direction)
    frame = np.column_stack([first, np.cross(direction, first), direction])
    return frame @ rotation_about(Z, rng.uniform(-np.pi, np.pi))


def _box(rng, mass, edge, offset):
    """A box of about `edge` m, turned a little, its centre `offset` m away in some direction."""
    squares = (edge * rng.uniform(0.6, 1.4, 3)) ** 2
    turn = _tilt(rng, 25.0)
    tensor = turn @ np.diag(mass / 12.0 * (squares.sum() - squares)) @ turn.T
    direction = rng.normal(size=3)
    return Inertia(mass, offset * direction / np.linalg.norm(direction), tensor)


def _gimbal_motor(rng, tau_max):
    return Motor(
        *WINDINGS[rng.integers(len(WINDINGS))],
        torque_constant=rng.uniform(0.05, 0.4),
        tau_max=round(tau_max, 3),
        coulomb=tau_max * rng.uniform(0.004, 0.025),
        viscous=tau_max * rng.uniform(0.002, 0.01),
        warm_up=rng.uniform(8.0, 30.0),
    )


def _gimbal_links(rng, kinds, mass, edge, reach):
    """The chain; frames are either all parallel or have their own z along the axis, as URDFs in the wild do."""
    joints = dict(zip(AXES, JOINT_NAMES[rng.integers(len(JOINT_NAMES))]))
    names = LINK_NAMES[rng.integers(len(LINK_NAMES))]
    own_frames = rng.random() < 0.5
    world = EYE
    links = []
    for i, kind in enumerate(kinds):
        direction = AXES[kind] * draw_sign(rng)
        frame = _frame_of(direction, rng) if own_frames else EYE
        weight = mass * rng.uniform(0.2, 0.5)
        size = edge * rng.uniform(1.0, 1.6)
        inertia = _box(rng, weight, size, edge * rng.uniform(0.02, 0.12))
        position = Z * edge if i == 0 else reach * rng.uniform(-1.0, 1.0, 3)
        span = rng.uniform(2.0, 3.1) if kind == "pan" else rng.uniform(0.7, 1.5)
        endless = kind == "pan" and i == 0 and rng.random() < 0.3
        place = (world.T @ frame, world.T @ position, frame.T @ direction)
        links.append(Link(names[i + 1], joints[kind], *place, inertia, -span, span, endless))
        world = frame
    return names, links


def draw_rig(rng, axes):
    """A gimbal with `axes` axes: torque limit 1–5 N m, masses and sizes that fit it."""
    order = ORDERS[axes][rng.integers(len(ORDERS[axes]))]
    kinds = order.split("_")
    tau_max = log_uniform(rng, 1.0, 5.0)
    mass = tau_max * rng.uniform(0.9, 1.6)
    edge = cube_edge(mass)
    concentric = rng.random() < 0.5
    reach = 0.0 if concentric else edge * rng.uniform(0.1, 0.35)
    names, links = _gimbal_links(rng, kinds, mass, edge, reach)
    arm = rng.uniform(0.6, 1.2) * edge if kinds[-1] == "swing" else rng.uniform(0.002, 0.012)
    camera = names[-1]
    turn = _tilt(rng, 10.0)
    payload = Payload(camera, f"{camera}_mount", turn, np.zeros(3), _box(rng, mass, edge, arm))
    rig = Rig(
        name=f"{order}_{tau_max:.1f}".replace(".", "p"),
        base=names[0],
        links=tuple(links),
        motors=tuple(_gimbal_motor(rng, tau_max * rng.uniform(0.7, 1.0)) for _ in kinds),
        payload=payload,
        armature=(0.0,) * axes,
        velocity_limit=rng.uniform(4.0, 9.0),
    )
    return _strengthen(rng, rig)


def _tube(rng, mass, length):
    """A tube along z with its motor somewhere on it, a little bent: mass kg, length m."""
    radius = rng.uniform(0.12, 0.22) * length + 0.02
    across = mass / 12.0 * (3.0 * radius**2 + length**2)
    along = 0.5 * mass * radius**2
    turn = _tilt(rng, 12.0)
    com = np.array([*(0.25 * radius * rng.uniform(-1.0, 1.0, 2)), length * rng.uniform(0.35, 0.6)])
    return Inertia(mass, com, turn @ np.diag([across, across, along]) @ turn.T)


def _arm_motor(rng, tau_max):
    winding = WINDINGS[rng.integers(len(WINDINGS))]
    coulomb = tau_max * rng.uniform(0.008, 0.03)
    viscous = tau_max * rng.uniform(0.004, 0.015)
    return Motor(*winding, rng.uniform(0.1, 2.0), round(tau_max, 3), coulomb, viscous, 60.0)


def _arm_links(rng, pattern, lengths, masses):
    """The chain; frames either stay parallel or have their own z along the axis."""
    name = str(rng.choice(ARM_JOINT_NAMES))
    own_frames = rng.random() < 0.5
    world = MOUNTS[rng.integers(len(MOUNTS))].T
    links = []
    for i, kind in enumerate(pattern):
        sign = draw_sign(rng)
        direction = sign * (Z if kind == "Z" else Y)
        frame = _frame_of(direction, rng) if own_frames else EYE
        travel = sorted(sign * end for end in TRAVEL[kind])
        body = _tube(rng, masses[i], lengths[i])
        inertia = body.seen_from(frame.T, np.zeros(3))
        step = Z * (lengths[i - 1] if i else 0.1) + 0.02 * rng.uniform(-1.0, 1.0, 3)
        place = (world.T @ frame, world.T @ step, frame.T @ direction)
        links.append(Link(f"link_{i + 1}", name.format(i + 1), *place, inertia, *travel))
        world = frame
    return links


def draw_arm(rng, axes):
    """An arm of `axes` joints, 0.3–1.2 m long, with a camera at its tip, on a floor, a wall or under a ceiling."""
    pattern = str(rng.choice(PATTERNS[axes]))
    reach = float(rng.uniform(0.2, 0.35) + rng.uniform(0.02, 0.12) * axes)
    lengths = rng.uniform(0.7, 1.3, axes)
    lengths *= reach / lengths.sum()
    masses = 12.0 * reach**2 / axes * 0.85 ** np.arange(axes) * rng.uniform(0.7, 1.3, axes) + 0.1
    links = _arm_links(rng, pattern, lengths, masses)
    camera = float(rng.uniform(0.15, 0.4) * masses.mean())
    edge = cube_edge(camera)
    com = 0.3 * edge * rng.normal(size=3)
    box = Inertia(camera, com, camera * edge**2 / 6.0 * np.diag(rng.uniform(0.8, 1.2, 3)))
    outward = np.cumsum(masses[::-1])[::-1] + camera
    beyond = np.cumsum(lengths[::-1])[::-1]
    tip = Payload("camera", "camera_mount", _tilt(rng, 10.0), links[-1].inertia.com * 2.0, box)
    work = np.array([ROLLING if kind == "Z" and i else 1.0 for i, kind in enumerate(pattern)])
    limits = 4.0 * work * outward * beyond * rng.uniform(0.7, 1.2, axes)
    motors = tuple(_arm_motor(rng, limit) for limit in limits.tolist())
    speed = rng.uniform(2.0, 4.5)
    rig = Rig(f"arm_{pattern}", "base", tuple(links), motors, tip, (0.0,) * axes, speed)
    return _strengthen(rng, rig)


def _strengthen(rng, rig):
    """Motors of at least 3.5 times the gravity that they meet; a rig that cannot move shows nothing."""
    spans = np.array([link.upper for link in rig.links])
    q = spans * rng.uniform(-1.0, 1.0, (200, len(spans)))
    gravity = np.abs(inverse_dynamics(rig, q, 0.0 * q, 0.0 * q)).max(axis=0)
    for joint, load in enumerate(gravity.tolist()):
        rig = rig.with_motor(joint, tau_max=round(3.5 * load, 3))
    return rig


def locked(rig, joint):
    """The rig with one joint bolted at zero: its link grows into the one before it, or into the base."""
    gone = rig.links[joint]
    if joint > 0:
        rig = rig.with_body(joint - 1, gone.inertia.seen_from(gone.rotation, gone.position))
    parts = [*rig.links, rig.payload]
    after = parts[joint + 1]
    turned = gone.rotation @ after.rotation
    moved = gone.rotation @ after.position + gone.position
    parts[joint : joint + 2] = [replace(after, rotation=turned, position=moved)]
    *links, payload = parts
    return replace(
        rig,
        links=tuple(links),
        payload=payload,
        motors=rig.motors[:joint] + rig.motors[joint + 1 :],
        armature=rig.armature[1:],
    )


def _perturb(rng, inertia, spread):
    """Other rigid parameters within `spread`, still a real body: Σ = tr(I)/2 - I turns into A Σ Aᵀ."""
    stretch = EYE + 0.5 * spread * rng.uniform(-1.0, 1.0, (3, 3))
    second = 0.5 * np.trace(inertia.tensor) * EYE - inertia.tensor
    second = stretch @ second @ stretch.T
    com = inertia.com * (1.0 + spread * rng.uniform(-1.0, 1.0, 3))
    com += 0.01 * spread * rng.normal(size=3)
    mass = inertia.mass * (1.0 + spread * rng.uniform(-1.0, 1.0))
    return Inertia(mass, com, np.trace(second) * EYE - second)


def nominal(rng, rig, spread):
    """The rig as its URDF has it: geometry right, rigid parameters off by up to `spread` (0–0.2)."""
    return rig.with_inertias(lambda inertia: _perturb(rng, inertia, spread))
