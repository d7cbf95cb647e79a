"""What identified base parameters mean for bodies: mass, centre of mass and inertia, each with its deviation.

Joint torques show combinations of these alone. What they show, the log says; the rest is the URDF's, with the
deviation that the trust in it leaves: every body may be the URDF's, stretched and sheared at random by that much
(`compute_deformation_root`). The bodies are the most likely ones (`find_likeliest_bodies`), their covariance is that
of β and G together, ``(G⁻¹ + Kᵀ P⁻¹ K)⁻¹``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gimbal_pin.errors import NORMAL_95
from gimbal_pin.log.log import Array
from gimbal_pin.regression import TRUST
from gimbal_pin.regression.consistency import compute_deformation_root
from gimbal_pin.regression.linalg import triangularise, whiten
from gimbal_pin.rig.inertia import is_physical

SHOWN_SHARE = 0.5
"""A figure is shown by the log if that leaves less than this share of the deviation that the trust gives it."""
DRAWN_BODIES, INTERVAL = 400, 0.95
"""Bodies that are drawn to see how far the intervals are from what slopes say, and the share that lies in them."""
COMPLEX = 1e-30
"""Step into the complex plane: derivatives without rounding."""
FIGURE_NAMES = ("mass", "x", "y", "z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
UNITS = ("kg", *("m",) * 3, *("kg m^2",) * 6)


@dataclass(frozen=True)
class Figure:
    """One figure of a body.

    Attributes:
        value: Value, SI units.
        std: Standard deviation.
        shown: Whether the log says so, or the URDF.
        unit: Its unit.
    """

    value: float
    std: float
    shown: bool
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds, with the 95 % interval."""
        half = NORMAL_95 * self.std
        interval = [self.value - half, self.value + half]
        return {
            "value": self.value,
            "std": self.std,
            "interval": interval,
            "unit": self.unit,
            "shown": self.shown,
        }


@dataclass(frozen=True)
class Body:
    """A body: everything that moves with one joint, in the frame of its link.

    Attributes:
        link: The link that the joint moves.
        mass: Mass.
        com: Centre of mass: x, y, z.
        inertia: About the centre of mass: Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    """

    link: str
    mass: Figure
    com: tuple[Figure, ...]
    inertia: tuple[Figure, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        com = {name: figure.to_dict() for name, figure in zip(FIGURE_NAMES[1:4], self.com)}
        inertia = {name: figure.to_dict() for name, figure in zip(FIGURE_NAMES[4:], self.inertia)}
        return {"link": self.link, "mass": self.mass.to_dict(), "com": com, "inertia": inertia}


def estimate_bodies(
    links: Sequence[str],
    given: Array,
    phi: Array,
    mixing: Array,
    beta: Array,
    covariance: Array,
    trust: float = TRUST,
) -> tuple[Body, ...]:
    """Return the figures of a rig's bodies with their deviations.

    Args:
        links: Names of the links that the joints move (n).
        given: The URDF's bodies: what the trust is in, (10 n,).
        phi: The bodies, physical, (10 n,).
        mixing: K: base parameters per entry of phi, (b, 10 n).
        beta: Estimated base parameters, (b,).
        covariance: Their covariance, (b, b).
        trust: Relative standard deviation of the URDF's masses; lengths to half of that.
    """
    before = trust * compute_deformation_root(given)
    middle, after = update_bodies(given, mixing, beta, covariance, trust)
    draws = after @ np.random.default_rng(0).standard_normal((len(phi), DRAWN_BODIES))
    found = []
    for k, own in enumerate(np.reshape(phi, (-1, 10))):
        at = slice(10 * k, 10 * k + 10)
        slope = compute_figure_slopes(own)
        std, prior = (np.linalg.norm(slope @ root[at], axis=1) for root in (after, before))
        shown = std < SHOWN_SHARE * prior
        std = std * _compare_widths(own, middle[at] - own, slope, draws[at])
        values = zip(compute_figures(own).tolist(), std.tolist(), shown.tolist(), UNITS)
        mass, *rest = (Figure(*each) for each in values)
        found.append(Body(links[k], mass, tuple(rest[:3]), tuple(rest[3:])))
    return tuple(found)


def update_bodies(
    given: Array, mixing: Array, beta: Array, covariance: Array, trust: float
) -> tuple[Array, Array]:
    """The mean of bodies' parameters, (10 n,), and a root of their covariance, ``(G⁻¹ + Kᵀ P⁻¹ K)⁻¹``, (10 n, 10 n).

    G = B Bᵀ is the trust's, so that is ``B (1 + BᵀKᵀP⁻¹KB)⁻¹ Bᵀ``: orthogonal factors, as variances span ten orders of
    magnitude. Arguments as for `estimate_bodies`.
    """
    root = trust * compute_deformation_root(given)
    count = len(given)
    rows = whiten(covariance) @ np.column_stack([mixing @ root, beta - mixing @ given])
    R = triangularise(np.vstack([rows, np.eye(count, count + 1)]))
    own = np.asarray(np.linalg.solve(R[:count, :count].T, root.T).T)
    return given + own @ R[:count, -1], own


def _compare_widths(phi: Array, apart: Array, slope: Array, draws: Array) -> Array:
    """How many times as wide as their slopes say the figures' 95 % intervals are, (10,).

    A centre of mass is a quotient and an inertia about it a product: where the mass is uncertain by a third, their
    deviations are no more in proportion to it.

    Args:
        phi: One body's parameters, (10,).
        apart: Mean of its parameters less these, (10,).
        slope: Of the figures, see `compute_figure_slopes`.
        draws: Changes of the parameters as likely as their covariance says, (10, N).
    """
    each = [phi + apart + draw for draw in draws.T]
    curved = np.array(
        [compute_figures(one) - compute_figures(phi) for one in each if is_physical(one)]
    )
    if not len(curved):
        return np.ones(10)
    wide, narrow = (np.quantile(np.abs(x), INTERVAL, axis=0) for x in (curved, (slope @ draws).T))
    return np.asarray(np.where(narrow > 0, wide / np.maximum(narrow, 1e-300), 1.0))


def compute_figures(phi: Array) -> Array:
    """Mass, centre of mass, and inertia about it, of one body's ten parameters, (10,); complex ones, too."""
    m = phi[0]
    h = phi[1:4]
    turned = (h @ h * np.eye(3) - np.outer(h, h)) / m
    return np.array([m, *(h / m), *(phi[4:] - turned[np.tril_indices(3)])])


def compute_figure_slopes(phi: Array) -> Array:
    """Change of `compute_figures` per parameter, (10, 10)."""
    steps = phi + COMPLEX * 1j * np.eye(10)
    return np.stack([compute_figures(step).imag / COMPLEX for step in steps], axis=1)
