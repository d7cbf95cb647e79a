"""Rigs drawn at random: one to three axes, concentric or with offset arms, handheld to heavy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .draws import log_uniform
from .rigs import EYE, Inertia, Link, Motor, Payload, Rig, rotation_about
from .rnea import inverse_dynamics

X, Y, Z = EYE
ORDERS = {
    1: (("tilt",), ("roll",), ("pan",), ("swing",)),
    2: (("pan", "tilt"), ("roll", "tilt"), ("pan", "roll")),
    3: (
        ("pan", "roll", "tilt"),
        ("pan", "roll", "tilt"),
        ("pan", "tilt", "roll"),
        ("roll", "pan", "tilt"),
    ),
}
AXES = {"pan": Z, "roll": X, "tilt": Y, "swing": Y}
JOINT_NAMES = (
    {"pan": "yaw", "roll": "roll", "tilt": "tilt", "swing": "tilt"},
    {"pan": "pan", "roll": "roll", "tilt": "pitch", "swing": "pitch"},
    {
        "pan": "azimuth_joint",
        "roll": "bank_joint",
        "tilt": "elevation_joint",
        "swing": "swing_joint",
    },
    {"pan": "j_z", "roll": "j_x", "tilt": "j_y", "swing": "j_y"},
)
LINK_NAMES = (
    ("head", "spine", "fork", "cradle", "camera"),
    ("base", "arm_1", "arm_2", "arm_3", "payload"),
    ("platform", "outer_ring", "middle_ring", "inner_ring", "lens"),
    ("mount", "link1", "link2", "link3", "sensor_head"),
)
WINDINGS = ((12, 14), (24, 22), (24, 28), (36, 42), (18, 16))


def tilted(rng, degrees):
    axis = rng.normal(size=3)
    return rotation_about(axis / np.linalg.norm(axis), np.radians(degrees) * rng.uniform(-1.0, 1.0))


def _box(rng, mass, edge, offset):
    """A box of about `edge` m, turned a little, its centre `offset` m away in some direction."""
    squares = (edge * rng.uniform(0.6, 1.4, 3)) ** 2
    turn = tilted(rng, 25.0)
    tensor = turn @ np.diag(mass / 12.0 * (squares.sum() - squares)) @ turn.T
    direction = rng.normal(size=3)
    return Inertia(mass, offset * direction / np.linalg.norm(direction), tensor)


def _motor(rng, tau_max):
    slots, poles = WINDINGS[rng.integers(len(WINDINGS))]
    return Motor(
        torque_constant=rng.uniform(0.05, 0.4),
        tau_max=round(tau_max, 3),
        slots=slots,
        poles=poles,
        encoder_bits=16,
        coulomb=tau_max * rng.uniform(0.004, 0.025),
        viscous=tau_max * rng.uniform(0.002, 0.01),
        warm_up=rng.uniform(8.0, 30.0),
    )


def _links(rng, kinds, mass, edge, reach):
    """The chain; frames are either all parallel or have their own z along the axis, as URDFs in the wild do."""
    joints = JOINT_NAMES[rng.integers(len(JOINT_NAMES))]
    names = LINK_NAMES[rng.integers(len(LINK_NAMES))]
    own_frames = rng.random() < 0.5
    world = EYE
    links = []
    for i, kind in enumerate(kinds):
        direction = AXES[kind] * rng.choice([-1.0, 1.0])
        frame = frame_of(direction, rng) if own_frames else EYE
        inertia = _box(
            rng,
            mass * rng.uniform(0.2, 0.5),
            edge * rng.uniform(1.0, 1.6),
            edge * rng.uniform(0.02, 0.12),
        )
        position = Z * edge if i == 0 else reach * rng.uniform(-1.0, 1.0, 3)
        span = rng.uniform(2.0, 3.1) if kind == "pan" else rng.uniform(0.7, 1.5)
        endless = kind == "pan" and i == 0 and rng.random() < 0.3
        axis = frame.T @ direction
        links.append(
            Link(
                names[i + 1],
                joints[kind],
                world.T @ frame,
                world.T @ position,
                axis,
                inertia,
                -span,
                span,
                endless,
            )
        )
        world = frame
    return links


def frame_of(direction, rng):
    """A rotation whose third column is `direction`."""
    helper = X if abs(direction[0]) < 0.5 else Y
    first = np.cross(helper, direction)
    frame = np.column_stack([first, np.cross(direction, first), direction])
    return frame @ rotation_about(Z, rng.uniform(-np.pi, np.pi))


def draw_rig(rng, axes):
    """A rig with `axes` axes: torque limit 1–5 N m, masses and sizes that fit it."""
    kinds = ORDERS[axes][rng.integers(len(ORDERS[axes]))]
    tau_max = log_uniform(rng, 1.0, 5.0)
    mass = tau_max * rng.uniform(0.9, 1.6)
    edge = float((mass / 700.0) ** (1.0 / 3.0))
    concentric = rng.random() < 0.5
    links = _links(rng, kinds, mass, edge, 0.0 if concentric else edge * rng.uniform(0.1, 0.35))
    arm = rng.uniform(0.6, 1.2) * edge if kinds[-1] == "swing" else rng.uniform(0.002, 0.012)
    names = next(row for row in LINK_NAMES if row[1] == links[0].name)
    payload = Payload(
        names[-1], f"{names[-1]}_mount", tilted(rng, 10.0), np.zeros(3), _box(rng, mass, edge, arm)
    )
    rig = Rig(
        name=f"{'_'.join(kinds)}_{tau_max:.1f}".replace(".", "p"),
        base=names[0],
        links=tuple(links),
        motors=tuple(_motor(rng, tau_max * rng.uniform(0.7, 1.0)) for _ in kinds),
        payload=payload,
        armature=(0.0,) * axes,
        velocity_limit=rng.uniform(4.0, 9.0),
    )
    return strong_enough(rng, rig)


def strong_enough(rng, rig):
    """Motors of at least 3.5 times the gravity that they meet; a rig that cannot move shows nothing."""
    spans = np.array([link.upper for link in rig.links])
    q = spans * rng.uniform(-1.0, 1.0, (200, len(spans)))
    gravity = np.abs(inverse_dynamics(rig, q, 0.0 * q, 0.0 * q)).max(axis=0)
    for joint, (motor, load) in enumerate(zip(rig.motors, gravity, strict=True)):
        rig = rig.with_motor(
            joint, replace(motor, tau_max=round(max(motor.tau_max, 3.5 * float(load)), 3))
        )
    return rig


def _perturbed(rng, inertia, spread):
    """Other rigid parameters within `spread`, still a real body: Σ = tr(I)/2 - I turns into A Σ Aᵀ."""
    stretch = EYE + 0.5 * spread * rng.uniform(-1.0, 1.0, (3, 3))
    second = 0.5 * np.trace(inertia.tensor) * EYE - inertia.tensor
    second = stretch @ second @ stretch.T
    com = inertia.com * (1.0 + spread * rng.uniform(-1.0, 1.0, 3)) + 0.01 * spread * rng.normal(
        size=3
    )
    mass = inertia.mass * (1.0 + spread * rng.uniform(-1.0, 1.0))
    return Inertia(mass, com, np.trace(second) * EYE - second)


def nominal(rng, rig, spread):
    """The rig as its URDF has it: geometry right, rigid parameters off by up to `spread` (0–0.2)."""
    return rig.with_inertias(lambda inertia: _perturbed(rng, inertia, spread))
