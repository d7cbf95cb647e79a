"""What makes an experiment good: numbers to minimise, each with its derivative to the columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array


class Criterion(Protocol):
    """A function of the columns in unit torque A (rows, p), to be minimised."""

    @property
    def name(self) -> str:
        """Name in results."""

    def value(self, a: Array) -> float:
        """Return the criterion."""

    def factors(self, a: Array) -> tuple[Array, Array]:
        """Return left (rows, r) and right (r, p) with ``d value = sum_r left_r' dA right_r``."""


@dataclass(frozen=True)
class Condition:
    """``log cond(A)``: how much worse the worst seen combination of parameters is than the best (Gautier, Khalil 1992)."""

    name: str = "condition"

    def value(self, a: Array) -> float:
        """``log sigma_1 - log sigma_p``."""
        sigma = np.linalg.svd(a, compute_uv=False)
        return float(np.log(sigma[0]) - np.log(max(sigma[-1], np.finfo(float).tiny)))

    def factors(self, a: Array) -> tuple[Array, Array]:
        """``d sigma_k = u_k' dA v_k``: two pairs."""
        u, sigma, vt = np.linalg.svd(a, full_matrices=False)
        ends = [0, -1]
        return u[:, ends] * np.array([1.0, -1.0]) / sigma[ends], vt[ends]


@dataclass(frozen=True, eq=False)
class Determinant:
    """``-1/2 log det(P + A'A)``: minus the expected gain of information, nats, up to a constant (D-optimal).

    Attributes:
        prior: P, the information that there is before, per column in unit torque and in units of the torque noise's
            variance: ``A'A`` of an earlier log for a sequential design. A number stands for that multiple of the
            identity; the default says that torque noise is a tenth of what a parameter's prior deviation makes.
    """

    prior: float | Array = 0.01
    name: str = "determinant"

    def information(self, a: Array) -> Array:
        """``P + A'A``, (p, p)."""
        return (self.prior * np.eye(a.shape[1]) if np.ndim(self.prior) == 0 else np.asarray(self.prior)) + a.T @ a

    def value(self, a: Array) -> float:
        """``-1/2 log det(P + A'A)``."""
        return -0.5 * float(np.linalg.slogdet(self.information(a))[1])

    def factors(self, a: Array) -> tuple[Array, Array]:
        """``d value = -tr((P + A'A)^-1 A' dA)``: one pair per column."""
        return -np.linalg.solve(self.information(a), a.T).T, np.eye(a.shape[1])


def named(criterion: str | Criterion) -> Criterion:
    """Return the criterion of a name, or the one given; `UsageError` lists the names."""
    if not isinstance(criterion, str):
        return criterion
    known: dict[str, Criterion] = {"condition": Condition(), "determinant": Determinant()}
    if criterion not in known:
        raise UsageError("criterion", f"'{criterion}' is not known", f"give one of {', '.join(known)}")
    return known[criterion]
