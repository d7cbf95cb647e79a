"""Inverse dynamics of a chain for a whole log at once, in NumPy: a second opinion on MuJoCo, and the regressor."""

import numpy as np

from .rigs import rotation_about

GRAVITY = np.array([0.0, 0.0, -9.81])
CHUNK = 4096


def _carry(linear, angular, rate, lever):
    """Return what a frame's acceleration is at a lever: a + α × r + ω × (ω × r), (T, 3)."""
    return linear + np.cross(angular, lever) + np.cross(rate, np.cross(rate, lever))


def _rotate(rotation, x):
    """Return R x of every sample, (T, 3)."""
    return np.einsum("tij,tj->ti", rotation, x)


def motion(rig, q, v, a):
    """Outward pass on a fixed base: q v a (T, n) in rad → each link's motion in its own frame: turn against its parent
    (T, 3, 3), rate, its derivative, acceleration of the origin less gravity (T, 3)."""
    rate = angular = np.zeros((len(q), 3))
    linear = np.broadcast_to(-GRAVITY, (len(q), 3))
    chain = []
    for i, link in enumerate(rig.links):
        turn = link.rotation @ rotation_about(link.axis, q[:, i])
        carried = _carry(linear, angular, rate, link.position)
        inward = turn.transpose(0, 2, 1)
        rate, angular, linear = (_rotate(inward, x) for x in (rate, angular, carried))
        spin = v[:, i, None] * link.axis
        angular = angular + a[:, i, None] * link.axis + np.cross(rate, spin)
        rate = rate + spin
        chain.append((turn, rate, angular, linear))
    return chain


def _wrench(rate, angular, linear, theta):
    """Newton and Euler about the link's origin: f = m a + α × mc + ω × (ω × mc), n = I α + ω × I ω + mc × a."""
    lever = theta[1:4]
    upper = np.zeros((3, 3))
    upper[np.triu_indices(3)] = theta[4:]
    tensor = upper + np.triu(upper, 1).T
    moment = angular @ tensor + np.cross(rate, rate @ tensor) + np.cross(lever, linear)
    return _carry(theta[0] * linear, angular, rate, lever), moment


def torque(rig, chain, thetas):
    """Inward pass: joint torques (T, n), N m, linear in `thetas` (n, 10)."""
    force = moment = 0.0
    tau = []
    for link, (turn, *moving), theta in reversed(list(zip(rig.links, chain, thetas))):
        own_force, own_moment = _wrench(*moving, theta)
        force = force + own_force
        moment = moment + own_moment
        tau.append(moment @ link.axis)
        force = _rotate(turn, force)
        moment = _rotate(turn, moment) + np.cross(link.position, force)
    return np.stack(tau[::-1], axis=1)


def inverse_dynamics(rig, q, v, a):
    """τ = M(q) a + C(q, v) v + g(q), rigid bodies only: (T, n), N m."""
    thetas = np.array([body.vector() for body in rig.bodies])
    pieces = [slice(k, k + CHUNK) for k in range(0, len(q), CHUNK)]
    return np.concatenate([torque(rig, motion(rig, q[p], v[p], a[p]), thetas) for p in pieces])


def regressor(rig, q, v, a):
    """Y with τ = Y θ, θ the bodies' parameters one after the other: (T, n, 10 n)."""
    chain = motion(rig, q, v, a)
    n = len(rig.links)
    return np.stack([torque(rig, chain, unit.reshape(n, 10)) for unit in np.eye(10 * n)], axis=2)
