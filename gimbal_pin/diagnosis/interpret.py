"""From a finding's coefficients to its physical parameters and to what the extended model holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import nan, sqrt
from typing import Any

import numpy as np

from gimbal_pin.diagnosis.candidates import Candidate
from gimbal_pin.diagnosis.problem import Problem
from gimbal_pin.diagnosis.search import Solution
from gimbal_pin.effects import (
    BaseTilt,
    Cause,
    Effect,
    EncoderOffset,
    JointFlexibility,
    OffDiagonalInertia,
    PayloadMass,
    PayloadShift,
    Term,
)
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig

LARGEST_SHARE = 0.98
"""Largest share behind a spring that the model holds: a rotor without inertia has no resonance."""


@dataclass(frozen=True, eq=False)
class Sized:
    """A finding with its size.

    Attributes:
        physical: What the extended model holds: a term of a torque effect, or a cause with its size.
        parameters: Its parameters with standard deviations.
    """

    physical: Term | Cause
    parameters: tuple[Parameter, ...]


def size_finding(
    problem: Problem, solution: Solution, own: Sequence[Candidate], covariance: Array
) -> Sized:
    """Return the physical parameters of a finding.

    Args:
        problem: The rows.
        solution: The model.
        own: Candidates of the finding: several harmonics of one cause.
        covariance: Covariance of the model's coefficients.
    """
    places = np.concatenate(
        [np.arange(x.start, x.stop) for x in (solution.get_places(one, problem) for one in own)]
    )
    values = solution.fit.theta[places]
    covariance = covariance[np.ix_(places, places)]
    cause: Any = own[0].cause
    if isinstance(cause, Effect):
        return _size_effect(own, values, covariance)
    std = np.sqrt(np.diag(covariance)).tolist()
    physical: Any = build_physical(cause, values.tolist(), problem.rig)
    known = dict(_name_deviations(physical, std))
    return Sized(
        physical,
        tuple(replace(p, std=known.get(p.name, nan)) for p in physical.shown()),
    )


def build_physical(cause: Any, values: list[float], rig: Rig) -> Term | Cause:
    """Return a term of a torque effect, or a cause with its size, of a fit's coefficients."""
    if isinstance(cause, Effect):
        return Term(cause, tuple(values))
    if cause.name == "payload-mass":
        return _build_mass(cause, values, rig)
    sized: Cause = _BUILDERS[cause.name](cause, values)
    return sized


def _size_effect(own: Sequence[Candidate], values: Array, covariance: Array) -> Sized:
    """Return a torque effect with its coefficients; harmonics are joined in the order of their numbers."""
    order = sorted(range(len(own)), key=lambda k: getattr(own[k].cause, "harmonic", (0.0,))[0])
    if len(own) > 1:
        places = np.concatenate([[2 * k, 2 * k + 1] for k in order])
        values = values[places]
        covariance = covariance[np.ix_(places, places)]
    effect: Any = reduce(lambda a, b: a.joined(b), (own[k].cause for k in order))
    numbers = tuple(values.tolist())
    return Sized(Term(effect, numbers), effect.shown(numbers, covariance))


def _build_flexibility(cause: JointFlexibility, values: list[float]) -> Cause:
    rotor_share = 1.0 - min(values[0], LARGEST_SHARE)
    return cause.altered(frequency=cause.frequency / sqrt(rotor_share), rotor_share=rotor_share)


def _build_offset(cause: EncoderOffset, values: list[float]) -> Cause:
    # The torque was differentiated by the joint's own angle, which is what is read less the offset.
    return cause.altered(offset=-values[0])


def _build_tilt(cause: BaseTilt, values: list[float]) -> Cause:
    # A base that turns by r sees its specific force turned by -r.
    return cause.altered(roll=-values[0], pitch=-values[1])


def _build_shift(cause: PayloadShift, values: list[float]) -> Cause:
    return cause.altered(**dict(zip("xyz", values)))


def _build_mass(cause: PayloadMass, values: list[float], rig: Rig) -> Cause:
    """Return an extra mass: spread, or at the centroid of the weights at the corners of a tetrahedron."""
    if len(values) == 1:
        return cause.altered(extra=values[0])
    corners = [form for form in PayloadMass.forms(rig) if len(form) > 1]
    extra = sum(values)
    place = {
        axis: sum(x * corner[axis] for x, corner in zip(values, corners)) / (extra or 1.0)
        for axis in "xyz"
    }
    return cause.altered(extra=extra, **place)


def _build_products(cause: OffDiagonalInertia, values: list[float]) -> Cause:
    return cause.altered(**dict(zip(("Ixy", "Ixz", "Iyz"), values)))


_BUILDERS: dict[str, Any] = {
    "joint-flexibility": _build_flexibility,
    "encoder-offset": _build_offset,
    "base-tilt": _build_tilt,
    "payload-shift": _build_shift,
    "off-diagonal-inertia": _build_products,
}
"""Name of a cause that is no torque effect → how its coefficients become its shape parameters."""

_SIZES = {
    "encoder-offset": ("offset",),
    "base-tilt": ("roll", "pitch"),
    "payload-shift": ("x", "y", "z"),
    "payload-mass": ("extra",),
    "off-diagonal-inertia": ("Ixy", "Ixz", "Iyz"),
}
"""Parameters of these that a deviation is known of, in the order of the coefficients."""


def _name_deviations(cause: Cause, std: list[float]) -> list[tuple[str, float]]:
    """Return parameter and deviation."""
    return list(zip(_SIZES.get(cause.name, ()), std))
