"""What makes an experiment good: numbers to minimise, each with its derivative to the columns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
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


WELL = 1e-4
"""Ratio of the eigenvalues of A'A above which they are exact to 1e-11."""

NEGLIGIBLE = 1e-7
"""Share of the derivative under which a pair of singular vectors is left out."""


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
        sigma = regular(spectrum(a)[0])
        sums = [norm.sum() for norm in self.norms(sigma)]
        return float(np.log(sigma[0] / sigma[-1]) + np.log(sums).sum() / self.sharpness)

    def factors(self, a: Array) -> tuple[Array, Array]:
        """``d sigma_k = u_k' dA v_k``, weighted; few pairs, those at either end."""
        sigma, vt = spectrum(a)
        sigma = regular(sigma)
        largest, smallest = (norm / norm.sum() for norm in self.norms(sigma))
        share = largest - smallest
        heard = np.abs(share) > NEGLIGIBLE
        return a @ vt[heard].T * (share / sigma**2)[heard], vt[heard]

    def norms(self, sigma: Array) -> tuple[Array, Array]:
        """The terms of both norms, the largest of each one."""
        return (sigma / sigma[0]) ** self.sharpness, (sigma[-1] / sigma) ** self.sharpness


def spectrum(a: Array) -> tuple[Array, Array]:
    """Singular values, falling, and right singular vectors as rows, (p,) and (p, p).

    By the eigenvalues of ``A'A``, three times as fast, where rounding costs them nothing that matters.
    """
    values, vectors = np.linalg.eigh(a.T @ a)
    if values[0] > WELL * values[-1]:
        return np.sqrt(values[::-1]), vectors[:, ::-1].T
    _, sigma, vt = np.linalg.svd(a, full_matrices=False)
    return sigma, vt


def regular(sigma: Array) -> Array:
    """Singular values kept off zero, so that a combination that is not seen at all costs much instead of infinity."""
    return np.maximum(sigma, np.finfo(float).eps * max(sigma[0], np.finfo(float).tiny))


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


@dataclass(frozen=True, eq=False)
class Sequential:
    """``-1/2 log det(r I + K + T/N A'A)``: D-optimal after what earlier logs have shown already.

    Information is torque squared over time, so that logs and designs count alike whatever their sampling.

    Attributes:
        known: K, ``integral of W'W dt`` over the earlier logs, W the columns in unit torque, s, (p, p).
        seconds: T, length of the motion, s.
        joints: Rows of A per sample: N of the formula is the number of samples.
        prior: r, what is known of every parameter before any log, s.
    """

    known: Array
    seconds: float
    joints: int
    prior: float = 1e-4
    name: str = "sequential"

    def weight(self, a: Array) -> float:
        """``T/N``, the time that each sample stands for, s."""
        return self.seconds * self.joints / len(a)

    @cached_property
    def determinant(self) -> Determinant:
        """The determinant of rows that stand for their time, the earlier logs its prior."""
        return Determinant(self.known + self.prior * np.eye(len(self.known)), self.name)

    def value(self, a: Array) -> float:
        """``-1/2 log det`` of the information."""
        return self.determinant.value(np.sqrt(self.weight(a)) * a)

    def factors(self, a: Array) -> tuple[Array, Array]:
        """Those of the determinant, per unit of A."""
        root = np.sqrt(self.weight(a))
        left, right = self.determinant.factors(root * a)
        return root * left, right

    def narrowed(self, a: Array) -> Array:
        """Standard deviations of the columns' coefficients after the motion over those before it, (p,)."""
        before = self.determinant.information(np.zeros((0, len(self.known))))
        after = self.determinant.information(np.sqrt(self.weight(a)) * a)
        return np.sqrt(np.diag(np.linalg.inv(after)) / np.diag(np.linalg.inv(before)))


def named(criterion: str | Criterion) -> Criterion:
    """Return the criterion of a name, or the one given; `UsageError` lists the names."""
    if not isinstance(criterion, str):
        return criterion
    known: dict[str, Criterion] = {"condition": Condition(), "determinant": Determinant()}
    if criterion not in known:
        raise UsageError("criterion", f"'{criterion}' is not known", f"give one of {', '.join(known)}")
    return known[criterion]
