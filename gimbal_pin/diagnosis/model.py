"""The extended model: rig, friction, causes and drives of a solution as one `Model`, with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.problem import SHIFT, Problem
from gimbal_pin.diagnosis.result import Finding
from gimbal_pin.diagnosis.search import Solution
from gimbal_pin.dynamics.model import Estimated, Model, build_friction_effects
from gimbal_pin.dynamics.reduction import list_units
from gimbal_pin.effects import Effect, RigEffect, Signal, Term
from gimbal_pin.log.log import Array
from gimbal_pin.regression import find_base_columns
from gimbal_pin.rig.rig import Rig


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
    rig = refit_rig(problem, solution.fit.theta)
    changes = [one.physical for one in findings if isinstance(one.physical, RigEffect)]
    for change in changes:
        rig = change.apply(rig)
    effects = build_friction_effects(problem.rig.joints)
    friction = zip(effects, solution.fit.theta[_list_friction_places(problem)].tolist())
    terms = [Term(effect, (value,)) for effect, value in friction]
    terms += [one.physical for one in findings if isinstance(one.physical, Term)]
    drive = [one.physical for one in findings if isinstance(one.physical, Signal)]
    estimated = _collect_estimates(problem, solution, covariance)
    return Model(rig, tuple(terms), estimated, tuple(drive), tuple(changes))


def refit_rig(problem: Problem, theta: Array) -> Rig:
    """Return the rig with a fit's base parameters."""
    phi = problem.rig.phi.copy()
    phi[find_base_columns(problem.rig, problem.reduction)] += theta[: problem.base_count]
    return problem.rig.with_phi(phi)


def _list_friction_places(problem: Problem) -> Array:
    """Return the places of dry and viscous friction of every joint in θ."""
    firsts = [problem.get_own_columns(j).start for j in problem.joints]
    return np.array([first + k for first in firsts for k in range(SHIFT)])


def _collect_estimates(problem: Problem, solution: Solution, covariance: Array) -> Estimated:
    """Return what the fit knows of base parameters, friction and the coefficients of torque effects."""
    rig = problem.rig
    reduction = problem.reduction
    symbols = [reduction.names[k].rsplit(".", 1)[1] for k in reduction.independent]
    pairs = [
        (effect, parameter)
        for effect in build_friction_effects(rig.joints)
        for parameter in effect.coefficients
    ]
    places = [*range(problem.base_count), *_list_friction_places(problem).tolist()]
    for candidate in solution.accepted:
        if isinstance(candidate.cause, Effect):
            own = solution.get_places(candidate, problem)
            places += range(own.start, own.stop)
            pairs += [(candidate.cause, parameter) for parameter in candidate.cause.coefficients]
    theta = solution.fit.theta.copy()
    theta[: problem.base_count] += problem.urdf
    shifts = [problem.get_own_columns(j).start + SHIFT for j in problem.joints]
    part = problem.rows.stretches[0]
    return Estimated(
        names=(
            *reduction.base_names,
            *(f"{effect.joint}.{effect.name}.{p.name}" for effect, p in pairs),
        ),
        units=(
            *list_units(symbols),
            *(rig.in_units(effect.joint, p.unit) for effect, p in pairs),
        ),
        theta=theta[places],
        covariance=covariance[np.ix_(places, places)],
        dt=part.dt / part.logged.step,
        lags=tuple(theta[shifts].tolist()),
        lag_std=tuple(np.sqrt(np.diag(covariance)[shifts]).tolist()),
    )
