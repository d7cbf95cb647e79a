"""The given model against the refitted one: inertias, friction and the payload."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import CAUSES
from gimbal_pin.identification import (
    BaseDifference,
    PayloadStatement,
    given_beta,
    state_payload,
)
from gimbal_pin.identification.given_model import describe_friction, describe_inertia

if TYPE_CHECKING:
    from gimbal_pin.diagnosis.prepare import PreparedLogs
    from gimbal_pin.diagnosis.result import Diagnosis


def compute_base_difference(explanation: Explanation, model: Model) -> BaseDifference:
    """Return a model's base parameters less the URDF's, changes of its bodies that are findings left out.

    Their covariance is that beside all accepted causes, those that the model lacks included.
    """
    search = explanation.search
    problem = search.problem
    own = np.s_[: problem.base_count, : problem.base_count]
    assert model.estimated is not None
    return BaseDifference(
        rig=problem.rig,
        reduction=problem.reduction,
        change=model.estimated.theta[: problem.base_count] - problem.urdf,
        covariance=explanation.covariance[own],
        weighting=explanation.found.final.fit.white_covariance[own],
    )


def compare_given_model(
    diagnosis: Diagnosis, explanation: Explanation, prepared: PreparedLogs
) -> Iterator[str]:
    """Yield notes on what sets the given model apart from the refitted one.

    Of inertias it is ``mean over poses of M_jj`` at each joint whose torque is explained.
    """
    difference = compute_base_difference(explanation, diagnosis.after)
    problem = explanation.search.problem
    rotors = problem.rig.armature.tolist()
    for joint, row, rotor in zip(problem.rig.joints, problem.inertia, rotors):
        if joint in diagnosis.unexplained or prepared.hides_inertia(joint):
            continue
        given = float(row @ problem.urdf) + rotor
        change = float(row @ difference.change)
        std = float(np.sqrt(row @ difference.covariance @ row))
        if describe_inertia(joint, given, change, std) is None:
            continue
        imitators = [
            one.cause
            for one in diagnosis.untestable
            if one.joint == joint and CAUSES[one.cause].like_inertia
        ]
        yield describe_inertia(joint, given, change, std, imitators) or ""
    friction = describe_friction(diagnosis.before, diagnosis.unexplained)
    if friction is not None:
        yield friction


def state_payload_with_causes(
    explanation: Explanation, model: Model, mass: float | None
) -> PayloadStatement:
    """State place, mass and balance of the payload beside the found causes.

    `identify`, whose equations lack the causes that read the torque, states them of its own fit.

    Args:
        explanation: The models.
        model: The extended model.
        mass: Mass of the payload where it was weighed, kg.
    """
    difference = compute_base_difference(explanation, model)
    before, after = (given_beta(rig, difference.reduction) for rig in (difference.rig, model.rig))
    return state_payload(replace(difference, change=after - before), mass)
