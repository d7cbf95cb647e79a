"""``tau = Y(q, v, a) phi``: Pinocchio's joint-torque regressor, and RNEA, over whole trajectories on any base."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.rig import PHI, Rig

SCAN = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "mx", "my", "mz", "m")
"""A body's inertial parameters in the order in which the reduction scans them (thesis, base parameters)."""

DIAGONAL = ("Ixx", "Iyy", "Izz", "mx", "my", "mz")
"""The parameters of a body whose inertia is assumed diagonal, as in the thesis; concentric axes never show its mass."""

_CHUNK = 128
"""Samples whose columns are picked at once: few enough to stay in the cache, where they were just written."""


def name_columns(rig: Rig, diagonal: bool = False) -> tuple[tuple[str, ...], Array]:
    """Return the scanned parameters' names, ``link.symbol``, base to tip, and their places in `Rig.phi`, (p,)."""
    symbols = DIAGONAL if diagonal else SCAN
    names = tuple(f"{link}.{symbol}" for link in rig.links for symbol in symbols)
    places = [10 * body + PHI.index(symbol) for body in range(rig.n) for symbol in symbols]
    return names, np.array(places)


def compute_regressor(
    rig: Rig,
    q: Array,
    v: Array,
    a: Array,
    platform: Platform | None = None,
    places: Array | None = None,
) -> Array:
    """``Y`` with ``rnea(q, v, a) = Y phi + I_a a``, every sample in full; I_a is `Rig.armature`.

    Call it chunk by chunk on long trajectories.

    Args:
        rig: The rig (its inertial parameters do not matter).
        q: Angles, rad, (N, n).
        v: Rates, rad/s, (N, n).
        a: Accelerations, rad/s², (N, n).
        platform: Motion of the base at the same N samples; None: it stands upright.
        places: Entries of `Rig.phi` whose columns are wanted, (p,); None: all.

    Returns:
        Torque per unit of each entry of `Rig.phi`, (N, n, 10 n), or of those in `places`, (N, n, p).
    """
    model, states = convert_states(rig, q, v, a, platform)
    data = model.createData()
    base = model.nv - rig.n
    compute = pin.computeJointTorqueRegressor
    chosen = np.arange(10 * rig.n) if places is None else places.astype(np.intp)
    width = 10 * (model.njoints - 1)
    entries = (width * np.arange(base, model.nv)[:, None] + width - 10 * rig.n + chosen).ravel()
    out = np.empty((len(q), len(entries)))
    for begin in range(0, len(q), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        # Writing bytes is the cheapest way to keep a sample's matrix: an assignment to an array takes twice as long.
        rows = BytesIO()
        for sample in zip(*(x[part] for x in states)):
            rows.write(compute(model, data, *sample))
        np.frombuffer(rows.getbuffer()).reshape(-1, model.nv * width).take(
            entries, axis=1, out=out[part], mode="clip"
        )
    return out.reshape(len(q), rig.n, len(chosen))


def compute_gravity(rig: Rig, q: Array, platform: Platform | None = None) -> Array:
    """``G(q)``: `compute_rnea` at rest, N m, (N, n); on a moving platform with what that asks of joints at rest."""
    still = np.zeros_like(q)
    return compute_rnea(rig, q, still, still, platform)


def compute_inertia_column(rig: Rig, q: Array, joint: int) -> Array:
    """``M_j(q)``: torque at every joint for a unit acceleration of one, kg m², (N, n); angles (N, n)."""
    return compute_rnea(rig.weightless, q, np.zeros_like(q), _build_unit_acceleration(q, joint))


def compute_inertia_regressor(rig: Rig, q: Array, joint: int, places: Array | None = None) -> Array:
    """Columns of `compute_inertia_column` without its rotor: torque per unit of each entry of `Rig.phi`, or of some.

    Shape (N, n, 10 n).
    """
    return compute_regressor(
        rig.weightless, q, np.zeros_like(q), _build_unit_acceleration(q, joint), places=places
    )


def _build_unit_acceleration(q: Array, joint: int) -> Array:
    """One in a joint's column, zero elsewhere, of the shape of q, (N, n)."""
    unit = np.zeros_like(q)
    unit[:, joint] = 1.0
    return unit


def compute_coupling(mass: Array, joint: int, rotor: float = 0.0) -> Array:
    """``M_j / (M_jj + rotor)``: what 1 N m that speeds a joint up asks of every joint, (..., n), of its M_j, (..., n).

    Nothing where M_jj is of no body's; `rotor`: armature beside it, kg m².
    """
    own = mass[..., [joint]] + rotor
    return np.asarray(mass / own) if np.all(own > 0) else np.zeros_like(mass)


def compute_rnea(rig: Rig, q: Array, v: Array, a: Array, platform: Platform | None = None) -> Array:
    """``D(q) a + C(q, v) v + G(q)`` of the rigid rig (thesis 3.70 without F), N m, for q, v, a of shape (N, n).

    D includes the stated rotors, `Rig.armature`. On a platform that moves, G and C v hold what its specific force and
    its turning ask of the joints.
    """
    model, states = convert_states(rig, q, v, a, platform)
    torque = np.empty((len(q), model.nv))
    # Pinocchio's own loop takes a third of the time of one in Python; it wants a sample a column.
    samples = (np.ascontiguousarray(x, dtype=float).T for x in states)
    pin.rneaInParallel(1, pin.ModelPool(model, 1), *samples, torque.T)
    return torque[:, model.nv - rig.n :]


def convert_states(
    rig: Rig, q: Array, v: Array, a: Array, platform: Platform | None
) -> tuple[pin.Model, tuple[Array, Array, Array]]:
    """Return the Pinocchio model for a base that stands or moves, and its configurations, rates and accelerations."""
    if platform is None:
        return rig.model, (q, v, a)
    still = np.zeros((len(q), 3))
    upright = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(q), 1))
    parts = ((upright, q), (still, platform.w, v), (platform.f, platform.dw, a))
    configurations, rates, accelerations = (np.concatenate(part, axis=1) for part in parts)
    return rig.floating, (configurations, rates, accelerations)
