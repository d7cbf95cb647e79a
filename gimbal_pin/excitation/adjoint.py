"""Derivative of the joint-torque regressor along a motion, backwards through the tree and over all samples at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from gimbal_pin.log import Array, Motion


def cross_tensor() -> Array:
    """T with ``(m x)_ab = sum_k T_abk m_k`` for motions, linear part first, (6, 6, 6)."""
    spin = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(2, 1, 0)  # spin_abk: [e_k x]_ab
    out = np.zeros((6, 6, 6))
    out[:3, :3, 3:] = out[3:, 3:, 3:] = out[:3, 3:, :3] = spin
    return out


def inertia_tensor() -> Array:
    """T with the inertia matrix ``I_ab = sum_p T_abp phi_p`` of a body's ten parameters (`rig.PHI`), (6, 6, 10)."""
    unit = np.eye(10)[0]  # Pinocchio's inertias divide by the mass, which must not be nothing
    mass = pin.Inertia.FromDynamicParameters(unit).matrix()
    rest = [pin.Inertia.FromDynamicParameters(unit + row).matrix() - mass for row in np.eye(10)[1:]]
    return np.stack([mass, *rest], axis=2)


CROSS, INERTIA = cross_tensor(), inertia_tensor()


@dataclass(frozen=True, eq=False)
class Link:
    """One joint and the body it moves, as constants: ``X(q) = C0 + s C1 + c C2`` takes motions from the parent's frame.

    ``X = exp(-q ad S) X0`` with ``s = sin q, c = 1 - cos q`` for a hinge, and ``s = q, c = 0`` for a slide.

    Attributes:
        parent: Index of the body before it, -1 at the base.
        turns: Whether it is a hinge.
        axis: S, the joint's motion in its own frame, (6,).
        cross: ``S x``, (6, 6).
        parts: C0, C1, C2, (6, 6, 3).
    """

    parent: int
    turns: bool
    axis: Array
    cross: Array
    parts: Array


def waves(tree: tuple[Link, ...], q: Array) -> Array:
    """1, s and c of every joint at angles or travels q (n, N), (n, 1, 3, N)."""
    turns = np.array([link.turns for link in tree])[:, None]
    return np.stack([np.ones_like(q), np.where(turns, np.sin(q), q), np.where(turns, 1 - np.cos(q), 0.0)], axis=1)[:, None]


def links(model: pin.Model) -> tuple[Link, ...]:
    """The tree of a fixed-base model whose joints have one angle or travel each, base to tips."""
    data, out = model.createData(), []
    for i, joint in enumerate(list(model.joints)[1:], start=1):
        joint.calc(data.joints[i], np.zeros(model.nq))
        axis = np.array(data.joints[i].S, dtype=np.float64).ravel()
        cross, first = CROSS @ axis, model.jointPlacements[i].inverse().action
        parts = np.stack([first, -cross @ first, cross @ cross @ first], axis=2)
        out.append(Link(model.parents[i] - 1, bool(np.any(axis[3:])), axis, cross, parts))
    return tuple(out)


@dataclass(frozen=True, eq=False)
class Frames:
    """Motions of all bodies in their own frames, as columns: A less gravity, V, and W_r of every set of joint rates.

    Attributes:
        columns: (n, 6, 2 + r, N).
        arrived: The parent's columns as they arrive in each frame, (n, 6, 2 + r, N).
        passages: X, (n, 6, 6, N).
    """

    columns: Array
    arrived: Array
    passages: Array

    @staticmethod
    def of(tree: tuple[Link, ...], gravity: Array, motion: Motion, left: Array) -> Frames:
        """``V = X V' + S v``, ``W = X W' + S w``, ``A = X A' + S a + V x S v`` from base to tips; w is (n, r, N)."""
        n, sets, count = left.shape
        rates = np.concatenate([motion.v.T[:, None], left], axis=1)
        passages = np.stack([link.parts for link in tree]) @ waves(tree, motion.q.T)
        columns, arrived = np.empty((2, n, 6, 2 + sets, count))
        base = np.zeros((6, 2 + sets, count))
        base[:3, 0] = -gravity[:, None]
        for i, link in enumerate(tree):
            np.einsum("abt,bkt->akt", passages[i], columns[link.parent] if link.parent >= 0 else base, out=arrived[i])
            own, along = columns[i], link.axis[:, None]
            own[:, 1:] = arrived[i][:, 1:] + along[:, None] * rates[i]
            own[:, 0] = arrived[i][:, 0] + along * motion.a[:, i] - link.cross @ own[:, 1] * motion.v[:, i]
        return Frames(columns, arrived, passages)

    def bars(self, right: Array) -> Array:
        """Adjoints of the columns in ``sum_ir W_r' (I_r A + V x* I_r V)``, I_r of the parameters right (r, n, 10)."""
        n, _, both, count = self.columns.shape
        inertia = np.moveaxis(right @ INERTIA.reshape(36, 10).T, 0, 1).reshape(n, both - 2, 6, 6)
        A, V, W = self.columns[:, :, 0], self.columns[:, :, 1], self.columns[:, :, 2:]
        tall, wide = inertia.reshape(n, -1, 6), np.moveaxis(inertia, 1, 2).reshape(n, 6, -1)
        turning = (CROSS.reshape(36, 6) @ V).reshape(n, 6, 6, count)
        momenta = (tall @ V).reshape(n, both - 2, 6, count)
        bars = np.empty_like(self.columns)
        forces = (tall @ A).reshape(momenta.shape) - np.einsum("iabt,irat->irbt", turning, momenta)
        bars[:, :, 2:] = np.swapaxes(forces, 1, 2)
        virtual = np.ascontiguousarray(np.swapaxes(W, 1, 2))
        bars[:, :, 0] = wide @ virtual.reshape(n, -1, count)
        turned = np.einsum("iabt,irbt->irat", turning, virtual)
        products = np.einsum("irat,irbt->iabt", momenta, virtual)
        bars[:, :, 1] = -CROSS.reshape(36, 6).T @ products.reshape(n, 36, count) - wide @ turned.reshape(n, -1, count)
        return bars


def power_gradient(tree: tuple[Link, ...], gravity: Array, motion: Motion, left: Array, right: Array) -> Array:
    """Gradient of ``sum_r w_r' Y(q, v, a) phi_r`` to q, v, a, exact, (3, N, n).

    It is the power of the torques with parameters phi_r at joint rates w_r, ``sum_i W_i' (I_i A_i + V_i x* I_i V_i)``
    over the bodies: adjoints of A, V and W pass from the tips to the base (Featherstone's recursion, backwards).

    Args:
        tree: `links` of the model.
        gravity: Acceleration of gravity in the base frame, m/s², (3,).
        motion: The motion, N samples.
        left: w_r, (n, r, N).
        right: phi_r by body, (r, n, 10).
    """
    frames = Frames.of(tree, gravity, motion, left)
    bars = frames.bars(right)
    out = np.empty((3, len(tree), len(motion)))
    for i, link in reversed(list(enumerate(tree))):
        bar, v = bars[i], motion.v[:, i]
        turned = link.cross.T @ bar[:, 0]
        out[1, i] = -np.einsum("at,at->t", turned, frames.columns[i, :, 1])
        bar[:, 1] -= turned * v
        out[1, i] += link.axis @ bar[:, 1]
        out[2, i] = link.axis @ bar[:, 0]
        moved = link.cross @ frames.arrived[i].reshape(6, -1)
        out[0, i] = -np.einsum("akt,akt->t", bar, moved.reshape(bar.shape))
        if link.parent >= 0:
            bars[link.parent] += np.einsum("abt,akt->bkt", frames.passages[i], bar)
    return np.swapaxes(out, 1, 2)
