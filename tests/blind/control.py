"""The loop around the plant: sampled PD with an imperfect feed-forward, on what the sensors show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rigs import Array
from .rnea import inverse_dynamics


@dataclass(frozen=True)
class Gains:
    """kp (N m/rad), kd (N m s/rad), each (n,); `trust` of the model's torque that is fed forward."""

    kp: Array
    kd: Array
    trust: float


def mass_matrix(rig, q):
    """M(q), kg m², at one pose (n, n)."""
    zero = np.zeros((1, len(q)))
    weight = inverse_dynamics(rig, q[None], zero, zero)[0]
    rows = [inverse_dynamics(rig, q[None], zero, unit[None])[0] - weight for unit in np.eye(len(q))]
    return np.array(rows)


def joint_inertia(rig, q):
    """Diagonal of M(q), kg m², at one pose (n,)."""
    return np.diag(mass_matrix(rig, q))


def _draw(rng, inertia, damped, held=()):
    """A loop of 1.5–3.5 Hz around these inertias; joints that are held are held twice as fast."""
    omega = 2.0 * np.pi * rng.uniform(1.5, 3.5, len(inertia))
    omega[list(held)] *= 2.0
    damping = 2.0 * rng.uniform(0.6, damped, len(inertia))
    return Gains(inertia * omega**2, damping * inertia * omega, rng.uniform(0.6, 1.0))


def draw_soft_gains(rng, rig, reference, held):
    """A loop for chains whose axes act on each other: inertia as felt with the other joints free,
    1 / (M⁻¹)ᵢᵢ, the least along the motion."""
    poses = reference.q[:: max(1, len(reference.q) // 12)]
    inertia = np.min([1.0 / np.diag(np.linalg.inv(mass_matrix(rig, q))) for q in poses], axis=0)
    return _draw(rng, inertia, 1.0, held)


def draw_gains(rng, rig, reference):
    """A loop a little under or over damped."""
    return _draw(rng, joint_inertia(rig, reference.q.mean(axis=0)), 1.1)


def feed_forward(model, reference, gains):
    """trust · RNEA of the (wrong) model along the reference, and the dither: (N, n)."""
    torque = inverse_dynamics(model, reference.q, reference.dq, reference.ddq)
    return reference.dither + gains.trust * torque


def closed_loop(world, reference, gains, forward, seen):
    """u = kp (q_ref - q) + kd (dq_ref - dq) + forward, clipped at the motors' limits, of measured q and dq."""
    limits = [motor.tau_max for motor in world.rig.motors]
    loop = list(zip(gains.kp.tolist(), gains.kd.tolist(), limits, strict=True))
    q_ref = reference.q.tolist()
    dq_ref = reference.dq.tolist()
    ahead = forward.tolist()

    def controller(k, q, v):
        measured_q, measured_v = seen(k, q, v)
        rows = zip(loop, q_ref[k], measured_q, dq_ref[k], measured_v, ahead[k], strict=True)
        command = [kp * (r - x) + kd * (dr - dx) + u for (kp, kd, _), r, x, dr, dx, u in rows]
        return (
            measured_q,
            measured_v,
            [min(max(u, -top), top) for u, (_, _, top) in zip(command, loop, strict=True)],
        )

    return controller
