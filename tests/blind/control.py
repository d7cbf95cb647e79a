"""The loop around the plant: sampled PD with an imperfect feed-forward, on what the sensors show."""

import numpy as np

from .rnea import inverse_dynamics


def mass_matrix(rig, q):
    """M(q), kg m², at one pose (n, n)."""
    zero = np.zeros((1, len(q)))
    weight, *rows = (
        inverse_dynamics(rig, q[None], zero, a[None])[0] for a in (*zero, *np.eye(len(q)))
    )
    return np.array(rows) - weight


def _draw(rng, inertia, damped, held=()):
    """A loop of 1.5–3.5 Hz around these inertias: kp (N m/rad), kd (N m s/rad), each (n,), and how much of the model's
    torque is fed forward; joints that are held are held twice as fast."""
    omega = 2.0 * np.pi * rng.uniform(1.5, 3.5, len(inertia))
    omega[list(held)] *= 2.0
    damping = 2.0 * rng.uniform(0.6, damped, len(inertia))
    return inertia * omega**2, damping * inertia * omega, rng.uniform(0.6, 1.0)


def draw_soft_gains(rng, rig, reference, held):
    """A loop for chains whose axes act on each other: inertia as felt with the other joints free,
    1 / (M⁻¹)ᵢᵢ, the least along the motion."""
    poses = reference.q[:: max(1, len(reference.q) // 12)]
    inertia = np.min([1.0 / np.diag(np.linalg.inv(mass_matrix(rig, q))) for q in poses], axis=0)
    return _draw(rng, inertia, 1.0, held)


def draw_gains(rng, rig, reference):
    """A loop a little under or over damped."""
    return _draw(rng, np.diag(mass_matrix(rig, reference.q.mean(axis=0))), 1.1)


def feed_forward(model, reference, trust):
    """trust · RNEA of the (wrong) model along the reference, and the dither: (N, n)."""
    torque = inverse_dynamics(model, reference.q, reference.dq, reference.ddq)
    return reference.dither + trust * torque


def closed_loop(rig, reference, kp, kd, forward, seen):
    """u = kp (q_ref - q) + kd (dq_ref - dq) + forward, clipped at the motors' limits, of measured q and dq."""
    loop = list(zip(kp.tolist(), kd.tolist(), rig.tau_max.tolist()))
    wanted = list(zip(reference.q.tolist(), reference.dq.tolist(), forward.tolist()))

    def controller(k, q, v):
        measured = seen(k, q, v)
        command = []
        for (p, d, limit), x_ref, dx_ref, ahead, x, dx in zip(loop, *wanted[k], *measured):
            u = p * (x_ref - x) + d * (dx_ref - dx) + ahead
            command.append(min(max(u, -limit), limit))
        return (*measured, command)

    return controller
