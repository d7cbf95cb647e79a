"""Derivatives along a motion: of the joint-torque regressor, of RNEA, and of what works sample by sample.

The regressor's go backwards through the tree, over all samples at once: Pinocchio's derivatives of RNEA, one motion
for each of a criterion's 5-10 pairs of factors, take 8-16 times as long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array, Motion


def _build_cross_tensor() -> Array:
    """T with ``(m x)_ab = sum_k T_abk m_k`` for motions, linear part first, (6, 6, 6)."""
    spin = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(2, 1, 0)  # spin_abk: [e_k x]_ab
    out = np.zeros((6, 6, 6))
    out[:3, :3, 3:] = out[3:, 3:, 3:] = out[:3, 3:, :3] = spin
    return out


def _build_inertia_tensor() -> Array:
    """T with the inertia matrix ``I_ab = sum_p T_abp phi_p`` of a body's ten parameters (`rig.PHI`), (6, 6, 10)."""
    unit = np.eye(10)[0]  # Pinocchio's inertias divide by the mass, which must not be nothing
    mass = pin.Inertia.FromDynamicParameters(unit).matrix()
    rest = [pin.Inertia.FromDynamicParameters(unit + row).matrix() - mass for row in np.eye(10)[1:]]
    return np.stack([mass, *rest], axis=2)


_CROSS = _build_cross_tensor()
_INERTIA = _build_inertia_tensor()


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


def _compute_waves(tree: tuple[Link, ...], q: Array) -> Array:
    """1, s and c of every joint at angles or travels q (n, N), (n, 1, 3, N)."""
    turns = np.array([link.turns for link in tree])[:, None]
    return np.stack(
        [np.ones_like(q), np.where(turns, np.sin(q), q), np.where(turns, 1 - np.cos(q), 0.0)],
        axis=1,
    )[:, None]


def build_links(model: pin.Model) -> tuple[Link, ...]:
    """The tree of a fixed-base model whose joints have one angle or travel each, base to tips."""
    data = model.createData()
    out = []
    for i, joint in enumerate(list(model.joints)[1:], start=1):
        joint.calc(data.joints[i], np.zeros(model.nq))
        axis = np.array(data.joints[i].S, dtype=np.float64).ravel()
        cross = _CROSS @ axis
        first = model.jointPlacements[i].inverse().action
        parts = np.stack([first, -cross @ first, cross @ cross @ first], axis=2)
        out.append(Link(model.parents[i] - 1, bool(np.any(axis[3:])), axis, cross, parts))
    return tuple(out)


@dataclass(frozen=True, eq=False)
class BodyMotions:
    """Motions in the frames of all bodies, as columns: A less gravity, V, and J of each joint that moves the body.

    Attributes:
        columns: (n, 6, 2 + n, N).
        arrived: The parent's columns as they arrive in each frame, (n, 6, 2 + n, N).
        passages: X, (n, 6, 6, N).
    """

    columns: Array
    arrived: Array
    passages: Array

    @staticmethod
    def of(tree: tuple[Link, ...], gravity: Array, motion: Motion) -> BodyMotions:
        """``V = X V' + S v``, ``A = X A' + S a + V x S v``, ``J = X J'`` from base to tips; gravity (3,), m/s²."""
        n = len(tree)
        count = len(motion)
        v = motion.v.T
        a = motion.a.T
        passages = np.stack([link.parts for link in tree]) @ _compute_waves(tree, motion.q.T)
        columns, arrived = np.zeros((2, n, 6, 2 + n, count))
        base = np.zeros((6, 2 + n, count))
        base[:3, 0] = -gravity[:, None]
        for i, link in enumerate(tree):
            before = (columns[link.parent] if link.parent >= 0 else base)[:, : 2 + i]
            np.einsum("abt,bkt->akt", passages[i], before, out=arrived[i, :, : 2 + i])
            own = columns[i]
            along = link.axis[:, None]
            own[:, : 2 + i] = arrived[i, :, : 2 + i]
            own[:, 1] += along * v[i]
            own[:, 0] += along * a[i] - link.cross @ own[:, 1] * v[i]
            own[:, 2 + i] = along
        return BodyMotions(columns, arrived, passages)

    def compute_adjoints(self, weights: Array) -> Array:
        """Adjoints of the columns in ``sum_ij J_j' (I_ij A + V x* I_ij V)``, I_ij of the parameters (n, 10, n, N)."""
        n, _, _, count = self.columns.shape
        inertia = (_INERTIA.reshape(36, 10) @ weights.reshape(n, 10, -1)).reshape(n, 6, 6, n, count)
        A = self.columns[:, :, 0]
        V = np.ascontiguousarray(self.columns[:, :, 1])
        J = self.columns[:, :, 2:]
        turning = (_CROSS.reshape(36, 6) @ V).reshape(n, 6, 6, count)
        momenta = np.einsum("iabjt,ibt->iajt", inertia, V)
        turned = np.einsum("iabt,ibjt->iajt", turning, J)
        products = np.einsum("iajt,ibjt->iabt", momenta, J).reshape(n, 36, count)
        bars = np.empty_like(self.columns)
        bars[:, :, 0] = np.einsum("iabjt,ibjt->iat", inertia, J)
        bars[:, :, 1] = -_CROSS.reshape(36, 6).T @ products - np.einsum(
            "iabjt,ibjt->iat", inertia, turned
        )
        bars[:, :, 2:] = np.einsum("iabjt,ibt->iajt", inertia, A) - np.einsum(
            "iabt,iajt->ibjt", turning, momenta
        )
        return bars


def compute_regressor_gradient(
    tree: tuple[Link, ...], gravity: Array, motion: Motion, weights: Array
) -> Array:
    """Gradient of ``sum weights * Y(q, v, a)`` to q, v, a, exact, (3, N, n).

    The sum is ``sum_ij J_j' (I_ij A_i + V_i x* I_ij V_i)`` over the bodies i and the joints j that move them, I_ij the
    inertia matrix of row j's weights on body i: adjoints of A, V and J pass from the tips to the base (Featherstone's
    recursion, backwards), once for all parameters.

    Args:
        tree: `build_links` of the model.
        gravity: Acceleration of gravity in the base frame, m/s², (3,).
        motion: The motion, N samples.
        weights: One per entry of Y, by body, its parameter, row and sample, (n, 10, n, N).
    """
    frames = BodyMotions.of(tree, gravity, motion)
    bars = frames.compute_adjoints(weights)
    out = np.empty((3, len(tree), len(motion)))
    for i, link in reversed(list(enumerate(tree))):
        bar, v = (
            bars[i, :, : 2 + i],
            motion.v[:, i],
        )  # the own axis is fixed, and later ones do not move this body
        turned = link.cross.T @ bar[:, 0]
        out[1, i] = -np.einsum("at,at->t", turned, frames.columns[i, :, 1])
        bar[:, 1] -= turned * v
        out[1, i] += link.axis @ bar[:, 1]
        out[2, i] = link.axis @ bar[:, 0]
        moved = link.cross @ frames.arrived[i, :, : 2 + i].reshape(6, -1)
        out[0, i] = -np.einsum("akt,akt->t", bar, moved.reshape(bar.shape))
        if link.parent >= 0:
            bars[link.parent, :, : 2 + i] += np.einsum("abt,akt->bkt", frames.passages[i], bar)
    return np.swapaxes(out, 1, 2)


def differentiate_rnea(model: pin.Model, motion: Motion) -> Array:
    """``d tau_j / d(q, v, a)_i`` of RNEA along a motion, (3, N, n, n); any inertial parameters, physical or not.

    Carpentier and Mansard 2018 (`pin.computeRNEADerivatives`).
    """
    data = model.createData()
    n = motion.q.shape[1]
    out = np.empty((3, len(motion), n, n))
    for dq, dv, da, q, v, a in zip(*out, motion.q, motion.v, motion.a):
        dq[...], dv[...], da[...] = pin.computeRNEADerivatives(model, data, q, v, a)
    upper = np.triu(out[2])
    out[2] = upper + np.swapaxes(np.triu(upper, 1), -1, -2)
    return out


def differentiate_samples(
    function: Callable[..., Array], arguments: Sequence[Array], step: float = 1e-5
) -> list[Array]:
    """Central differences of a function that works sample by sample, one array per argument, each of its shape.

    With half a width of `step` exact to rounding for what is linear (friction), to 1e-10 for what is smooth.
    """
    out: list[Array] = []
    for k in range(len(arguments)):
        ahead = list(arguments)
        behind = list(arguments)
        ahead[k], behind[k] = arguments[k] + step, arguments[k] - step
        out.append((function(*ahead) - function(*behind)) / (2 * step))
    return out
