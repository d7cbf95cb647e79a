"""From what was found to what is told: findings with their gain, what is left, and logs that tell nothing."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence

import numpy as np

from gimbal_pin.checks import CheckedLog, collect_alterations
from gimbal_pin.diagnosis.background import add_tables
from gimbal_pin.diagnosis.engine.criterion import criterion, fitted, matters, rows
from gimbal_pin.diagnosis.engine.discrepancy import place
from gimbal_pin.diagnosis.engine.explained import Explained
from gimbal_pin.diagnosis.engine.selection import better, promising, together
from gimbal_pin.diagnosis.evidence import Evidence, gather
from gimbal_pin.diagnosis.extended import Extended, extended
from gimbal_pin.diagnosis.findings import confirm_causes, findings, untestable
from gimbal_pin.diagnosis.gain import Figures, followed, measured
from gimbal_pin.diagnosis.likeness import likeness
from gimbal_pin.diagnosis.result import Curve, Diagnosis, Residual, Slight, overall
from gimbal_pin.diagnosis.shapes import same
from gimbal_pin.diagnosis.state import State
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.errors import DataError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig


def reported(
    found: Explained, held: Evidence, checked: Sequence[CheckedLog], hold: float, rng: np.random.Generator
) -> Diagnosis:
    """Measure the gain on the reporting part, which drops nothing and moves nothing, and put it all together.

    Args:
        found: The model of the training part.
        held: The reporting part, its torques at the same time.
        checked: The logs.
        hold: By how much later than its stamp the torque was taken to act, s.
        rng: For simulated sensors.
    """
    before = extended(found.first)
    model = confirm_causes(found, held)
    found, each = model.found, findings(model, held)
    state, best, curves = add_tables(found, held, model.baseline, model.figures)
    after, residual = extended(state), residuals(found, curves)
    return Diagnosis(
        rig=held.rig.name,
        logs=tuple(one.log.name for one in checked),
        faults=tuple(fault for one in checked for fault in one.faults),
        notes=(*model.denied, *(note for one in checked for note in one.notes)),
        altered=collect_alterations(checked),
        verdict=overall([one.status for one in each], tuple(residual.values())),
        findings=each,
        residual=residual,
        immaterial=immaterial(found),
        untestable=untestable(found.first, found.search.shelf, each),
        detection_limit=dict(zip(held.rig.joints, limits(found).tolist())),
        alignment=hold + float(np.mean(found.alignment)),
        baseline=model.baseline,
        extended=best,
        before=before,
        after=after,
        held=held,
        state=found.final,
        tracking=followed(before, after, rng) if each or curves else {},
        likeness=tuple(likeness(found, cause) for cause in found.final.causes),
        instead=tuple(rival.cause for cause in found.final.causes for rival in found.rivals_of(cause)),
    )


def residuals(found: Explained, curves: Mapping[str, Curve]) -> dict[str, Residual]:
    """Return what is left at each joint; `curves`: joint → the table that the extended model carries."""
    evidence, power = found.final.problem.evidence, found.final.fit.dispersion
    rows = zip(evidence.rig.joints, found.structured)
    return {
        joint: Residual(
            "structured" if structured else "noise",
            evidence.noise_floor(j),
            float(power[j]),
            found.left(j),
            place(found.final, j) if structured else "",
            curves.get(joint),
        )
        for j, (joint, structured) in enumerate(rows)
    }


def limits(found: Explained) -> Array:
    """Return the torque that a cause with one coefficient would need to be found, N m rms, (n,): the threshold's."""
    state, n = found.final, len(found.final.fit.scale)
    evidence, count = state.problem.evidence, rows(found.final)
    share = np.expm1((found.search.threshold + np.log(count.max())) / np.maximum(count, 1.0))
    floors = np.array([evidence.noise_floor(j) for j in range(n)])
    return np.asarray(floors * np.sqrt(state.fit.dispersion * share))


def immaterial(found: Explained) -> tuple[Slight, ...]:
    """Return what else is significant, and less than an error of the model's form would be."""
    state, search = found.state, found.search
    torque = level(state)
    small = []
    for cause in promising(state, search):
        if any(same(cause, one) for one in state.causes):  # another harmonic of what was found
            continue
        new = fitted(search.problem, together(state.causes, cause), state)
        clear = criterion(state) - criterion(new) > search.threshold
        if clear and not matters(new, state) and not better(new, state, search):
            size = np.sqrt(np.maximum(unexplained(state) - unexplained(new), 0.0) / np.maximum(torque, 1e-300))
            small.append(Slight(cause.name, cause.place if cause.of_joint else None, float(size.max())))
    return tuple(small)


def unexplained(state: State) -> Array:
    """Return the power of what is left of each joint's torque, whitened, (n,)."""
    return np.asarray(np.sum((state.fit.residual.reshape(-1, len(state.fit.scale)) / state.fit.scale) ** 2, axis=0))


def level(state: State) -> Array:
    """Return the power of each joint's torque, whitened, (n,)."""
    return np.asarray(np.sum(state.problem.evidence.whiten_all(state.torque) ** 2, axis=0))


def spoilt(rig: Rig, logs: Sequence[Log], checked: Sequence[CheckedLog], filtering: Filtering) -> Diagnosis:
    """The verdict *data*: the logs say nothing about physics that could be relied on."""
    given = Extended(nominal(rig))
    figures: Figures = {}
    with contextlib.suppress(DataError):  # too short for the band: then there is no figure either
        figures = measured(gather(rig, logs, filtering), given)
    return Diagnosis(
        rig=rig.name,
        logs=tuple(one.log.name for one in checked),
        faults=tuple(fault for one in checked for fault in one.faults),
        notes=tuple(note for one in checked for note in one.notes),
        altered=collect_alterations(checked),
        verdict="data",
        findings=(),
        residual={},
        immaterial=(),
        untestable=(),
        detection_limit={},
        alignment=hold(checked[0].log, filtering),
        baseline=figures,
        extended=figures,
        before=given,
        after=given,
    )


def hold(log: Log, filtering: Filtering) -> float:
    """Return by how much later than its stamp a torque is taken to act before that is estimated, s."""
    return log.dt / 2 if filtering.alignment is None else filtering.alignment
