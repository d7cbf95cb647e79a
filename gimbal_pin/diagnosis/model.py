"""The extended model: rig, friction, causes and drives of a solution as one `Model`, with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.problem import SHIFT, Problem
from gimbal_pin.diagnosis.result import Finding
from gimbal_pin.diagnosis.search import Solution
from gimbal_pin.dynamics.model import Estimated, Model, build_friction_effects, is_parameter
from gimbal_pin.dynamics.reduction import list_units
from gimbal_pin.effects import Effect, RigEffect, Signal, Term
from gimbal_pin.log.log import Array
from gimbal_pin.regression import find_base_columns


def build_model(
    problem: Problem, solution: Solution, findings: Sequence[Finding], covariance: Array
) -> Model:
    """Return the model of a solution.

    Args:
        problem: The rows.
        solution: The fit.
        findings: What it holds beside bodies and friction: terms, causes of the rig, drives.
        covariance: Covariance of its coefficients.
    """
    rig = problem.rig
    reduction = problem.reduction
    theta = solution.fit.theta
    phi = rig.phi.copy()
    phi[find_base_columns(rig, reduction)] += theta[: problem.base_count]
    refitted = rig.with_phi(phi)
    physical = [one.physical for one in findings]
    changes = tuple(one for one in physical if isinstance(one, RigEffect))
    for change in changes:
        refitted = change.apply(refitted)
    firsts = np.array([problem.get_own_columns(j).start for j in problem.joints])
    friction = [first + k for first in firsts.tolist() for k in range(SHIFT)]
    effects = build_friction_effects(rig.joints)
    terms = [Term(effect, (value,)) for effect, value in zip(effects, theta[friction].tolist())]
    terms += [one for one in physical if isinstance(one, Term)]
    held = [term.effect for term in terms]
    drive = tuple(one for one in physical if isinstance(one, Signal))

    pairs = [(effect, p) for effect in effects for p in effect.coefficients]
    places = [*range(problem.base_count), *friction]
    for candidate in solution.accepted:
        if isinstance(candidate.cause, Effect):
            own = solution.get_places(candidate, problem)
            places += range(own.start, own.stop)
            if is_parameter(rig, candidate.cause) and candidate.cause not in held:
                terms.append(Term(candidate.cause, tuple(theta[own].tolist())))
            pairs += [(candidate.cause, p) for p in candidate.cause.coefficients]
    values = theta.copy()
    values[: problem.base_count] += problem.urdf
    symbols = [reduction.names[k].rsplit(".", 1)[1] for k in reduction.independent]
    part = problem.rows.stretches[0]
    shifts = firsts + SHIFT
    estimated = Estimated(
        names=(*reduction.base_names, *(f"{x.joint}.{x.name}.{p.name}" for x, p in pairs)),
        units=(*list_units(symbols), *(rig.in_units(x.joint, p.unit) for x, p in pairs)),
        theta=values[places],
        covariance=covariance[np.ix_(places, places)],
        dt=part.dt / part.logged.step,
        lags=tuple(theta[shifts].tolist()),
        lag_std=tuple(np.sqrt(np.diag(covariance)[shifts]).tolist()),
    )
    return Model(refitted, tuple(terms), estimated, drive, changes)
