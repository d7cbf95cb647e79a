"""What makes an experiment good: numbers to minimise, each with its derivative to the columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array


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
    """``log ||sigma||_m ||1/sigma||_m``: the log of the condition number of A from above, within ``2 log(p)/m``.

    Good experiments make the smallest singular values equal, where the condition number itself has a kink that stops
    a gradient method; the m-norms have none.

    Attributes:
        sharpness: m.
    """

    sharpness: float = 64.0
    name: str = "condition"

    def value(self, a: Array) -> float:
        """``log sigma_1/sigma_p + 1/m log sum (sigma/sigma_1)^m + 1/m log sum (sigma_p/sigma)^m``."""
        sigma = bound_from_zero(compute_spectrum(a)[0])
        sums = [norm.sum() for norm in self.norms(sigma)]
        return float(np.log(sigma[0] / sigma[-1]) + np.log(sums).sum() / self.sharpness)

    def factors(self, a: Array) -> tuple[Array, Array]:
        """``d sigma_k = u_k' dA v_k``, weighted; few pairs, those at either end."""
        sigma, vt = compute_spectrum(a)
        sigma = bound_from_zero(sigma)
        largest, smallest = (norm / norm.sum() for norm in self.norms(sigma))
        share = largest - smallest
        kept = np.abs(share) > 1e-7  # of a derivative whose shares add up to two
        return a @ vt[kept].T * (share / sigma**2)[kept], vt[kept]

    def norms(self, sigma: Array) -> tuple[Array, Array]:
        """The terms of both norms, the largest of each one."""
        return (sigma / sigma[0]) ** self.sharpness, (sigma[-1] / sigma) ** self.sharpness


def compute_spectrum(a: Array) -> tuple[Array, Array]:
    """Singular values, falling, and right singular vectors as rows, (p,) and (p, p).

    By the eigenvalues of ``A'A``, three times as fast, where their ratio leaves them exact to 1e-11.
    """
    values, vectors = np.linalg.eigh(a.T @ a)
    if values[0] > 1e-4 * values[-1]:
        return np.sqrt(values[::-1]), vectors[:, ::-1].T
    _, sigma, vt = np.linalg.svd(a, full_matrices=False)
    return sigma, vt


def bound_from_zero(sigma: Array) -> Array:
    """Singular values kept off zero, so that a combination that is not seen at all costs much instead of infinity."""
    return np.maximum(sigma, np.finfo(float).eps * max(sigma[0], np.finfo(float).tiny))


@dataclass(frozen=True, eq=False)
class Determinant:
    """``-1/2 log det(P + w A'A)``: minus the expected gain of information, nats, up to a constant (D-optimal).

    Attributes:
        prior: P, the information that there is before, per column in unit torque and in units of the torque noise's
            variance. A number stands for that multiple of the identity; the default says that torque noise is a tenth
            of what a parameter's prior deviation makes.
        seconds: Time that all rows of A stand for together, ``w = seconds / rows``, and P is in torque squared over
            time, s: logs and designs count alike whatever their sampling. None: w = 1.
        name: Name in results.
    """

    prior: float | Array = 0.01
    seconds: float | None = None
    name: str = "determinant"

    def weight(self, a: Array) -> float:
        """Return w of the formula."""
        return 1.0 if self.seconds is None else self.seconds / max(len(a), 1)

    def information(self, a: Array) -> Array:
        """``P + w A'A``, (p, p)."""
        prior = (
            self.prior * np.eye(a.shape[1]) if np.ndim(self.prior) == 0 else np.asarray(self.prior)
        )
        return prior + self.weight(a) * a.T @ a

    def value(self, a: Array) -> float:
        """``-1/2 log det(P + w A'A)``."""
        return -0.5 * float(np.linalg.slogdet(self.information(a))[1])

    def factors(self, a: Array) -> tuple[Array, Array]:
        """``d value = -w tr((P + w A'A)^-1 A' dA)``: one pair per column."""
        return -self.weight(a) * np.linalg.solve(self.information(a), a.T).T, np.eye(a.shape[1])


def find_criterion(criterion: str | Criterion) -> Criterion:
    """Return the criterion of a name, or the one given; `UsageError` lists the names."""
    if not isinstance(criterion, str):
        return criterion
    named: dict[str, Criterion] = {"condition": Condition(), "determinant": Determinant()}
    if criterion not in named:
        raise UsageError(
            "criterion", f"'{criterion}' is not known", f"give one of {', '.join(named)}"
        )
    return named[criterion]
