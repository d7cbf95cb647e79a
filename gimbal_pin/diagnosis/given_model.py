"""The given model against the refitted one: inertias, friction and the payload."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.prepare import PreparedLogs
from gimbal_pin.diagnosis.result import Diagnosis
from gimbal_pin.diagnosis.uncertainty import compute_covariance
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import CAUSES
from gimbal_pin.errors import GimbalPinError
from gimbal_pin.identification import (
    BaseDifference,
    PayloadStatement,
    apply_changes,
    compare_payload,
    given_beta,
    identify,
    refittable_effects,
    state_payload,
)
from gimbal_pin.identification.given_model import describe_friction, describe_inertia
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Filtering, subsample_log
from gimbal_pin.rig.rig import Rig


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
        covariance=compute_covariance(search, explanation.found.final)[own],
        weighting=explanation.found.final.fit.white_covariance[own],
    )


def compare_given_model(diagnosis: Diagnosis, prepared: PreparedLogs) -> Diagnosis:
    """Add notes on what sets the given model apart from the refitted one."""
    if diagnosis.explanation is None:
        return diagnosis
    notes = [
        *_describe_inertias(diagnosis, diagnosis.explanation, prepared),
        describe_friction(diagnosis.before, diagnosis.unexplained),
    ]
    return replace(diagnosis, notes=(*diagnosis.notes, *(note for note in notes if note)))


def _describe_inertias(
    diagnosis: Diagnosis, explanation: Explanation, prepared: PreparedLogs
) -> Iterator[str | None]:
    """Yield what is said of ``mean over poses of M_jj`` at each joint whose torque is explained."""
    difference = compute_base_difference(explanation, diagnosis.after)
    problem = explanation.search.problem
    rotors = problem.rig.armature.tolist()
    for joint, row, rotor in zip(problem.rig.joints, problem.inertia, rotors):
        if joint in diagnosis.unexplained or prepared.hides_inertia(joint):
            continue
        imitators = [
            one.cause
            for one in diagnosis.untestable
            if one.joint == joint and CAUSES[one.cause].like_inertia
        ]
        yield describe_inertia(
            joint,
            given=float(row @ problem.urdf) + rotor,
            change=float(row @ difference.change),
            std=float(np.sqrt(row @ difference.covariance @ row)),
            imitators=imitators,
        )


def state_payload_with_causes(
    diagnosis: Diagnosis,
    rig: Rig,
    logs: Sequence[Log],
    holdout: str | None,
    filtering: Filtering | None,
    mass: float | None,
) -> PayloadStatement:
    """State what `identify` says of the payload with the found causes in its equations; nothing of spoilt logs.

    Where these cannot hold a cause, as of the drive or of a friction that reads the torque, or refuse the logs, the
    diagnosis's own fit says it.

    Args:
        diagnosis: The diagnosis.
        rig: The rig.
        logs: Its logs.
        holdout: As for `identify`.
        filtering: As for `identify`.
        mass: Of the payload, kg, where it was weighed.
    """
    if diagnosis.explanation is None:
        return PayloadStatement()
    model = diagnosis.after
    if not (model.drive or any(term.effect.loaded for term in model.terms)):
        with suppress(GimbalPinError):
            found = identify(
                apply_changes(rig, model.changes),
                [subsample_log(log).log for log in logs],
                refittable_effects(model),
                holdout=holdout,
                filtering=filtering,
                examined="never",
            )
            return compare_payload(found, mass)
    difference = compute_base_difference(diagnosis.explanation, model)
    before, after = (given_beta(x, difference.reduction) for x in (difference.rig, model.rig))
    return state_payload(replace(difference, change=after - before), mass)
