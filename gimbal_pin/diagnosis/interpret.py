"""From a finding's coefficients to its physical parameters and to what the extended model holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import nan, sqrt
from typing import Any

import numpy as np

from gimbal_pin.diagnosis.candidates import REFINEMENTS, Candidate
from gimbal_pin.diagnosis.search import Search, Solution
from gimbal_pin.diagnosis.uncertainty import compute_shape_covariance
from gimbal_pin.effects import Cause, Effect, JointFlexibility, PayloadMass, Term
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig

LARGEST_SHARE = 0.98
"""Largest share behind a spring that the model holds: a rotor without inertia has no resonance. It changes the
extended model and no verdict."""


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
    search: Search, solution: Solution, own: Sequence[Candidate], covariance: Array
) -> Sized:
    """Return the physical parameters of a finding.

    Args:
        search: The search.
        solution: The model.
        own: Candidates of the finding: several harmonics of one cause.
        covariance: Covariance of the model's coefficients.
    """
    problem = search.problem
    own = sorted(own, key=lambda x: getattr(x.cause, "harmonic", (0.0,))[0])
    slices = [solution.get_places(x, problem) for x in own]
    places = np.concatenate([np.arange(x.start, x.stop) for x in slices])
    values = solution.fit.theta[places].tolist()
    covariance = covariance[np.ix_(places, places)]
    cause: Any = reduce(lambda a, b: a.joined(b), (x.cause for x in own))
    physical = build_physical(cause, values, problem.rig)
    if isinstance(physical, Term):
        shaped = None
        if len(own) == 1:
            shaped = compute_shape_covariance(search, solution, own[0], covariance)
        if shaped is None:
            return Sized(physical, cause.shown(tuple(values), covariance))
        name = REFINEMENTS[cause.name][0]
        std = float(np.sqrt(shaped[-1, -1]))
        shown = cause.shown(tuple(values), shaped[:-1, :-1])
        return Sized(physical, tuple(replace(p, std=std) if p.name == name else p for p in shown))
    known = dict(zip(SIZES.get(cause.name, ()), np.sqrt(np.diag(covariance)).tolist()))
    parameters = (replace(p, std=known.get(p.name, nan)) for p in physical.shown())
    return Sized(physical, tuple(parameters))


SIZES = {
    "encoder-offset": ("offset",),
    "base-tilt": ("roll", "pitch"),
    "payload-shift": ("x", "y", "z"),
    "payload-mass": ("extra",),
    "off-diagonal-inertia": ("Ixy", "Ixz", "Iyz"),
}
"""Name of a cause of the rig → the sizes that its coefficients stand for, in their order."""
TURNED = ("encoder-offset", "base-tilt")
"""Causes whose coefficients are turned round: an angle that is read is the joint's own and its offset, and a base that
turns sees its specific force turn back."""


def build_physical(cause: Any, values: list[float], rig: Rig) -> Term | Cause:
    """Return a term of a torque effect, or a cause with its size, of a fit's coefficients."""
    if isinstance(cause, Effect):
        return Term(cause, tuple(values))
    physical: Cause
    if isinstance(cause, JointFlexibility):
        rotor_share = 1.0 - min(values[0], LARGEST_SHARE)
        resonance = cause.frequency / sqrt(rotor_share)
        physical = cause.altered(frequency=resonance, rotor_share=rotor_share)
    elif len(values) > len(SIZES[cause.name]):
        physical = _build_mass(cause, values, rig)
    else:
        sign = -1.0 if cause.name in TURNED else 1.0
        sizes = dict(zip(SIZES[cause.name], (sign * x for x in values)))
        physical = cause.altered(**sizes)
    return physical


def _build_mass(cause: PayloadMass, values: list[float], rig: Rig) -> PayloadMass:
    """Return an extra mass at the centroid of the weights at the corners of a tetrahedron."""
    corners = [form for form in PayloadMass.forms(rig) if len(form) > 1]
    extra = sum(values)
    place = {
        axis: sum(x * corner[axis] for x, corner in zip(values, corners)) / (extra or 1.0)
        for axis in "xyz"
    }
    return cause.altered(extra=extra, **place)
