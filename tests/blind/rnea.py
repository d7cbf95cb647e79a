"""Inverse dynamics of a chain for a whole log at once, in NumPy: a second opinion on MuJoCo, and the regressor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rigs import EYE, Array

GRAVITY = np.array([0.0, 0.0, -9.81])
CHUNK = 4096


@dataclass(frozen=True)
class LinkMotion:
    """A link over T samples, in its own frame: turn against its parent (T,3,3), rate, its derivative, acceleration
    of the origin less gravity (T,3)."""

    turn: Array
    rate: Array
    angular: Array
    linear: Array


def _turns(axis, fixed, q):
    """R(q) = fixed · Rodrigues(axis, q), (T, 3, 3)."""
    k = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    s = np.sin(q)[:, None, None]
    c = np.cos(q)[:, None, None]
    return fixed @ (EYE + s * k + (1.0 - c) * (k @ k))


def motion(rig, q, v, a):
    """Outward pass on a fixed base: q v a (T, n) in rad → each link's motion."""
    rate = angular = np.zeros((len(q), 3))
    linear = np.broadcast_to(-GRAVITY, (len(q), 3))
    chain = []
    for i, link in enumerate(rig.links):
        turn = _turns(link.axis, link.rotation, q[:, i])
        carried = (
            linear
            + np.cross(angular, link.position)
            + np.cross(rate, np.cross(rate, link.position))
        )
        inward = turn.transpose(0, 2, 1)
        rate, angular, linear = (
            np.einsum("tij,tj->ti", inward, x) for x in (rate, angular, carried)
        )
        spin = v[:, i, None] * link.axis
        angular = angular + a[:, i, None] * link.axis + np.cross(rate, spin)
        rate = rate + spin
        chain.append(LinkMotion(turn, rate, angular, linear))
    return chain


def _wrench(body, theta):
    """Newton and Euler about the link's origin: f = m a + α × mc + ω × (ω × mc), n = I α + ω × I ω + mc × a."""
    mass = theta[0]
    lever = theta[1:4]
    tensor = np.zeros((3, 3))
    tensor[np.triu_indices(3)] = theta[4:]
    tensor = tensor + np.triu(tensor, 1).T
    force = (
        mass * body.linear
        + np.cross(body.angular, lever)
        + np.cross(body.rate, np.cross(body.rate, lever))
    )
    moment = (
        body.angular @ tensor
        + np.cross(body.rate, body.rate @ tensor)
        + np.cross(lever, body.linear)
    )
    return force, moment


def torque(rig, chain, thetas):
    """Inward pass: joint torques (T, n), N m, linear in `thetas` (n, 10)."""
    force = moment = np.zeros_like(chain[0].rate)
    tau = np.empty((len(force), len(rig.links)))
    for i in reversed(range(len(rig.links))):
        link = rig.links[i]
        body = chain[i]
        own_force, own_moment = _wrench(body, thetas[i])
        force = force + own_force
        moment = moment + own_moment
        tau[:, i] = moment @ link.axis
        force = np.einsum("tij,tj->ti", body.turn, force)
        moment = np.einsum("tij,tj->ti", body.turn, moment) + np.cross(link.position, force)
    return tau


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
