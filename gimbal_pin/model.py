"""A rig with inertial parameters and effects: the one model that fit, simulation and control share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gimbal_pin.effects import Coulomb, Effect, Sample, Term, Viscous
from gimbal_pin.log import Array
from gimbal_pin.regressor import rnea
from gimbal_pin.rig import Rig


@dataclass(frozen=True, eq=False)
class Estimated:
    """What identification knows of the parameters, for those who want the uncertainty.

    Attributes:
        names: Names of the base parameters and effect coefficients (k).
        units: Their SI units (k).
        theta: Their values (k).
        covariance: Their covariance (k, k).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    theta: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """Standard deviations (k)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class Model:
    """``tau = rnea(q, v, a; phi) + sum of terms`` (THESIS 3.70).

    Attributes:
        rig: The rig; its Pinocchio model carries the inertial parameters in force.
        terms: Effects with their coefficients; friction is among them.
        estimated: Where the parameters were identified, with what uncertainty; None for a nominal model.
    """

    rig: Rig
    terms: tuple[Term, ...]
    estimated: Estimated | None = None

    @cached_property
    def by_joint(self) -> tuple[tuple[Term, ...], ...]:
        """The terms that act on each joint, (n)."""
        return tuple(tuple(term for term in self.terms if term.effect.joint == joint) for joint in self.rig.joints)

    def inverse(self, q: Array, v: Array, a: Array, slide: Array | None = None, t: Array | None = None) -> Array:
        """Torque that moves the rig as given, N m.

        Args:
            q: Angles, rad, (N, n).
            v: Rates, rad/s, (N, n).
            a: Accelerations, rad/s², (N, n).
            slide: Direction of sliding in [-1, 1], (N, n); sign(v) if None.
            t: Time, s, (N,); zero if None.
        """
        rigid = rnea(self.rig, q, v, a)
        return rigid + self.passive(q, v, a, np.sign(v) if slide is None else slide, rigid, t)

    def passive(self, q: Array, v: Array, a: Array, slide: Array, tau: Array, t: Array | None = None) -> Array:
        """Torque of all terms, N m, (N, n); `tau` is the total that load-dependent terms see."""
        out = np.zeros_like(q)
        times = np.zeros(len(q)) if t is None else t
        for j, terms in enumerate(self.by_joint):
            at = Sample(times, q[:, j], v[:, j], a[:, j], slide[:, j], tau[:, j])
            for term in terms:
                out[:, j] += term.torque(at)
        return out

    def level(self, q: Array, v: Array, a: Array, tau: Array, t: Array | None = None) -> Array:
        """Total dry friction that each joint could bear, N m, (N, n): the dry terms at slide = 1."""
        dry = Model(self.rig, tuple(term for term in self.terms if term.effect.dry))
        return dry.passive(q, v, a, np.ones_like(q), tau, t)


def friction_effects(joints: Sequence[str]) -> tuple[Effect, ...]:
    """Coulomb and viscous friction of every joint: always part of the model (THESIS 3.61)."""
    return tuple(kind(joint) for joint in joints for kind in (Coulomb, Viscous))


def nominal(rig: Rig) -> Model:
    """Return the model as the rig's URDF states it, friction from ``<dynamics>``."""
    terms = []
    for joint, (dry, viscous) in zip(rig.joints, rig.friction):
        terms += [Term(Coulomb(joint), (float(dry),)), Term(Viscous(joint), (float(viscous),))]
    return Model(rig, tuple(terms))
