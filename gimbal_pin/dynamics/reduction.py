"""Base parameters: which combinations of inertial parameters the joint torques can show (thesis 4.20-4.27)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.dynamics.regressor import compute_regressor, name_columns
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import BaseMotion, Platform
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

RANDOM_STATES = 200
TOLERANCE = 1e-8
"""A column whose part outside the span of those before it is under this share of itself is dependent."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """``Y phi = Y[:, independent] beta`` with ``beta = mixing phi``.

    Attributes:
        names: All columns' names (p).
        independent: Columns that stay, increasing (b).
        zero: Columns that are zero at every pose and motion: unidentifiable, whatever the data.
        mixing: beta per phi, (b, p): the identity on the independent columns, the regrouping on the others.
        base: What the base does for all of them to show.
        rotors: Joints whose stated rotor is a parameter of its own: no body's parameters have its torque.
        grouped: Per base parameter, rotors of unstated inertia that it sums, ``joint.Ia``, and their factors.
    """

    names: tuple[str, ...]
    independent: tuple[int, ...]
    zero: tuple[int, ...]
    mixing: Array
    base: BaseMotion = "fixed"
    rotors: tuple[str, ...] = ()
    grouped: tuple[Mapping[str, float], ...] = ()

    __repr__ = brief

    @property
    def terms(self) -> tuple[dict[str, float], ...]:
        """Per base parameter, the parameters that it sums and their factors."""
        bodies = tuple(
            {self.names[j]: float(row[j]) for j in np.flatnonzero(row)} for row in self.mixing
        )
        if not self.grouped:
            return bodies
        return tuple({**one, **rotors} for one, rotors in zip(bodies, self.grouped, strict=True))

    @property
    def base_names(self) -> tuple[str, ...]:
        """Per base parameter, its regrouping written as a sum, e.g. ``fork.Ixx - fork.Izz + cradle.Izz``."""
        return tuple(format_sum(terms) for terms in self.terms)

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Names of the zero columns."""
        return tuple(self.names[j] for j in self.zero)


def list_units(symbols: Sequence[str]) -> tuple[str, ...]:
    """SI units of inertial parameters by their symbols."""
    return tuple(
        {"I": "kg m^2", "m": "kg m"}[symbol[0]] if symbol != "m" else "kg" for symbol in symbols
    )


def format_sum(terms: Mapping[str, float]) -> str:
    """Return ``{"a": 1, "b": -1, "c": 0.12}`` as ``a - b + 0.12*c``."""
    text = ""
    for name, factor in terms.items():
        size = name if abs(abs(factor) - 1) < 1e-9 else f"{abs(factor):.6g}*{name}"
        sign = " - " if factor < 0 else " + "
        text += sign + size if text else ("-" if factor < 0 else "") + size
    return text


def scan_columns(matrix: Array, names: tuple[str, ...]) -> Reduction:
    """Reduce a stacked regressor by a rank-revealing QR that scans left to right: the first independent column stays.

    Every column is orthogonalised (twice) against those kept before it; what is left over decides. A largest-pivot
    QR would keep other columns, and which ones would depend on the samples.

    `matrix`: stacked regressor, (rows, p), rows well above p.
    """
    basis = np.empty((len(matrix), 0))
    independent = []
    zero = []
    largest = np.linalg.norm(matrix, axis=0).max(initial=0.0)
    for j, column in enumerate(matrix.T):
        if (size := np.linalg.norm(column)) <= TOLERANCE * largest:
            zero.append(j)
            continue
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        if (left := np.linalg.norm(rest)) > TOLERANCE * size:
            independent.append(j)
            basis = np.column_stack([basis, rest / left])
    return Reduction(names, tuple(independent), tuple(zero), regroup_columns(matrix, independent))


def regroup_columns(matrix: Array, independent: list[int]) -> Array:
    """``beta = R_i^-1 R_d`` (thesis 4.27) as a (b, p) mixing; entries that are zero to rounding are set to zero."""
    mixing = np.linalg.lstsq(matrix[:, independent], matrix, rcond=None)[0]
    mixing = np.round(mixing, 12)  # what is left of the sums' own rounding
    mixing[:, independent] = np.eye(len(independent))
    return mixing


def spread_states(rig: Rig, count: int = RANDOM_STATES) -> tuple[Array, Array, Array]:
    """Poses and motions that fill the rig's state space evenly and always alike, (count, n) each.

    A Kronecker sequence (multiples of square roots of primes) instead of random numbers: the choice of columns
    then depends on the rig alone.
    """
    q, v, a = np.split(compute_kronecker_sequence(count, 3 * rig.n), 3, axis=1)
    return 2 * np.pi * q, 10.0 * v, 50.0 * a


def compute_kronecker_sequence(count: int, width: int, skip: int = 0) -> Array:
    """Multiples of the square roots of so many primes, without their integer part, in ±1/2, (count, width)."""
    primes = [k for k in range(2, 600) if all(k % d for d in range(2, int(k**0.5) + 1))][
        skip : skip + width
    ]
    return np.outer(np.arange(1, count + 1), np.sqrt(primes)) % 1.0 - 0.5


def _spread_base_motions(rig: Rig, base: BaseMotion) -> Platform | None:
    """Motions of a platform beside `spread_states`, of one kind; None: it stands upright."""
    if base == "fixed":
        return None
    f, w, dw = np.split(compute_kronecker_sequence(RANDOM_STATES, 9, 3 * rig.n), 3, axis=1)
    turns = 0.0 if base == "tilted" else 1.0
    return Platform(np.arange(float(RANDOM_STATES)), 20.0 * f, turns * 10.0 * w, turns * 50.0 * dw)


def stack_regressors(
    rig: Rig, diagonal: bool = False, base: BaseMotion = "fixed"
) -> tuple[Array, tuple[str, ...]]:
    """Return the regressor at `spread_states`, stacked, (SAMPLES n, p), and its columns' names."""
    names, places = name_columns(rig, diagonal)
    matrix = compute_regressor(rig, *spread_states(rig), _spread_base_motions(rig, base))[
        :, :, places
    ]
    return matrix.reshape(-1, len(places)), names


def reduce_parameters(rig: Rig, diagonal: bool = False, base: BaseMotion = "fixed") -> Reduction:
    """Return the base parameters of a rig: of full inertias, or of diagonal ones as the thesis assumes.

    `base` says what the base does: a lean shows some first moments and masses, turning shows inertias besides. Columns
    that a lesser motion keeps, a greater one keeps, too.
    """
    matrix, names = stack_regressors(rig, diagonal, base)
    found = replace(scan_columns(matrix, names), base=base)
    rows = zip(rig.joints, rig.motors)
    joints = [joint for joint, motor in rows if motor.states_rotor or joint in rig.coupling]
    return _add_rotors(rig, found, matrix, joints) if joints else found


def _add_rotors(rig: Rig, bodies: Reduction, matrix: Array, joints: Sequence[str]) -> Reduction:
    """Return a reduction with the rotors of some joints, scanned after the bodies; `matrix`: the stacked regressor.

    One without a column of its own is a sum's where the rig states its gear alone. Where the rig states its inertia,
    too, it counts as known, and the sum has the bodies alone.
    """
    numbers = [rig.joint_index(joint) for joint in joints]
    a = spread_states(rig)[2]
    G = np.array([rig.build_motor_row(joint) for joint in joints])
    columns = (a @ G.T)[:, None, :] * G.T
    kept = matrix[:, bodies.independent]
    names = tuple(f"{joint}.Ia" for joint in joints)
    whole = scan_columns(
        np.column_stack([kept, columns.reshape(len(kept), -1)]),
        (*(bodies.names[j] for j in bodies.independent), *names),
    )
    count = len(bodies.independent)
    free = [joint for k, joint in enumerate(joints) if count + k in whole.independent]
    unknown = [
        k for k, j in enumerate(numbers) if joints[k] not in free and not rig.motors[j].armature
    ]
    grouped = tuple(
        {names[k]: float(row[count + k]) for k in unknown if row[count + k]}
        for row in whole.mixing[:count]
    )
    return replace(bodies, rotors=tuple(free), grouped=grouped)
