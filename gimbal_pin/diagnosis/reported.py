"""From what was found to what is told: findings with their gain, what is left, and logs that tell nothing."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.checks import CheckedLog, collect_alterations
from gimbal_pin.diagnosis.background import add_tables
from gimbal_pin.diagnosis.engine.criterion import criterion, fitted, matters, rows
from gimbal_pin.diagnosis.engine.discrepancy import place
from gimbal_pin.diagnosis.engine.explained import Explained
from gimbal_pin.diagnosis.engine.selection import better, promising, together
from gimbal_pin.diagnosis.evidence import Evidence, gather
from gimbal_pin.diagnosis.extended import build_extended_model
from gimbal_pin.diagnosis.findings import compare_likeness, confirm_causes, describe_findings, list_untestable
from gimbal_pin.diagnosis.gain import measure_errors, simulate_tracking
from gimbal_pin.diagnosis.result import Curve, Diagnosis, Residual, Slight, get_joint
from gimbal_pin.diagnosis.shapes import same
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.errors import DataError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig


def report_findings(
    found: Explained, held: Evidence, checked: Sequence[CheckedLog], filtering: Filtering, rng: np.random.Generator
) -> Diagnosis:
    """Measure the gain on the reporting part, which drops nothing and moves nothing, and put it all together.

    Args:
        found: The model of the training part.
        held: The reporting part, its torques at the same time.
        checked: The logs.
        filtering: The band.
        rng: For simulated sensors.
    """
    said, before = _report_logs(held.rig, checked, filtering), build_extended_model(found.first)
    model = confirm_causes(found, held)
    found, findings = model.found, describe_findings(model, held)
    state, best, curves = add_tables(found, held, model.baseline, model.figures)
    after = build_extended_model(state)
    return replace(
        said,
        notes=(*model.denied, *said.notes),
        findings=findings,
        residual=_list_residuals(found, curves),
        immaterial=_list_immaterial(found),
        untestable=list_untestable(found, findings),
        detection_limit=dict(zip(held.rig.joints, _compute_limits(found).tolist())),
        alignment=said.alignment + float(np.mean(found.alignment)),
        baseline=model.baseline,
        extended=best,
        before=before,
        after=after,
        held=held,
        state=found.final,
        tracking=simulate_tracking(before, after, rng) if findings or curves else {},
        likeness=tuple(compare_likeness(found, cause) for cause in found.final.causes),
        instead=tuple(rival.cause for cause in found.final.causes for rival in found.rivals_of(cause)),
    )


def report_unusable_logs(
    rig: Rig, logs: Sequence[Log], checked: Sequence[CheckedLog], filtering: Filtering
) -> Diagnosis:
    """The verdict *data*: the logs say nothing about physics that could be relied on."""
    said = _report_logs(rig, checked, filtering)
    with contextlib.suppress(DataError):  # too short for the band: then there is no figure either
        figures = measure_errors(gather(rig, logs, filtering), said.before)
        return replace(said, baseline=figures, extended=figures)
    return said


def _report_logs(rig: Rig, checked: Sequence[CheckedLog], filtering: Filtering) -> Diagnosis:
    """What the checks say of the logs, and by how much later than its stamp a torque is taken to act at first."""
    given = nominal(rig)
    return Diagnosis(
        rig=rig.name,
        logs=tuple(one.log.name for one in checked),
        faults=tuple(fault for one in checked for fault in one.faults),
        notes=tuple(note for one in checked for note in one.notes),
        altered=collect_alterations(checked),
        alignment=checked[0].log.dt / 2 if filtering.alignment is None else filtering.alignment,
        before=given,
        after=given,
    )


def _list_residuals(found: Explained, curves: Mapping[str, Curve]) -> dict[str, Residual]:
    """Return what is left at each joint; `curves`: joint → the table that the extended model carries."""
    evidence, power = found.final.problem.evidence, found.final.fit.dispersion.tolist()
    return {
        joint: Residual(
            "structured" if structured else "noise",
            evidence.noise_floor(j),
            power[j],
            found.left(j),
            place(found.final, j) if structured else "",
            curves.get(joint),
        )
        for j, (joint, structured) in enumerate(zip(evidence.rig.joints, found.structured))
    }


def _compute_limits(found: Explained) -> Array:
    """Return the torque that a cause with one coefficient would need to be found, N m rms, (n,): the threshold's."""
    state = found.final
    evidence, count = state.problem.evidence, rows(state)
    share = np.expm1((found.search.threshold + np.log(count.max())) / np.maximum(count, 1.0))
    floors = np.array([evidence.noise_floor(j) for j in range(evidence.rig.n)])
    return np.asarray(floors * np.sqrt(state.fit.dispersion * share))


def _list_immaterial(found: Explained) -> tuple[Slight, ...]:
    """Return what else is significant, and less than an error of the model's form would be."""
    state, search, small = found.state, found.search, list[Slight]()
    n, torque = len(state.fit.scale), np.sum(state.problem.evidence.whiten_all(state.torque) ** 2, axis=0)
    for cause in promising(state, search):
        if any(same(cause, one) for one in state.causes):  # another harmonic of what was found
            continue
        new = fitted(search.problem, together(state.causes, cause), state)
        clear = criterion(state) - criterion(new) > search.threshold
        if clear and not matters(new, state) and not better(new, state, search):
            fits = state.fit, new.fit
            left, less = (np.sum((fit.residual.reshape(-1, n) / fit.scale) ** 2, axis=0) for fit in fits)
            size = np.sqrt(np.maximum(left - less, 0.0) / np.maximum(torque, 1e-300))
            small.append(Slight(cause.name, get_joint(cause), float(size.max())))
    return tuple(small)
