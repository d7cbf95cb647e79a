"""Visibility of causes in logs: the gain that a hidden one is expected to have, and what is too small or too alike.

A model's columns leave the whitened power p of a further torque in n rows. Its cause is expected to gain

    E[D] = n/2 log(1 + p/n),   std(D) = √(2 E[D])

nats, as the log ratio of two normal densities whose means are δ deviations apart has mean δ²/2 and deviation δ.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from gimbal_pin.diagnosis.candidates import DRIVES, Candidate, count_columns, list_candidates
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.library import Shelf
from gimbal_pin.diagnosis.score import BlockFit, Pack
from gimbal_pin.diagnosis.search import Search
from gimbal_pin.effects import CAUSES, Cause, Effect, RigEffect
from gimbal_pin.log.log import Array

NINETEEN_OF_TWENTY = 1.645
"""Deviations below the mean above which a normal variable is in 19 of 20 cases."""

Group = tuple[Sequence[Candidate], Pack]
"""Candidates with their whitened columns."""


Forms = dict[tuple[str, str], list[tuple[Candidate, float]]]
"""Name and place of a cause → its forms, each with the share of its power that the model without causes leaves."""


@dataclass(frozen=True)
class Untestable:
    """A cause that these logs cannot show.

    Attributes:
        cause: Its name.
        joint: Its joint; None: the whole rig.
        why: The reason, as a clause.
    """

    cause: str
    joint: str | None
    why: str


def get_joint(place: str) -> str | None:
    """Return the joint of a place; None: the whole rig."""
    return None if place == "rig" else place


def compute_expected_gain(power: float, rows: float) -> float:
    """``E[D] = n/2 log(1 + p/n)``, nats, of a whitened power p in n effective rows."""
    return float(0.5 * rows * np.log1p(max(power, 0.0) / rows))


def compute_size(gain: float, power: float, rows: float) -> float:
    """Return the size at which a torque of whitened power p at size 1 is expected to have a gain, nats."""
    return float(np.sqrt(rows * np.expm1(2 * gain / rows) / max(power, 1e-300)))


def compute_sure_gain(nats: float, deviations: float) -> float:
    """Return the expected gain at which 19 of 20 logs reach a gain, nats, and a number of standard errors."""
    root = NINETEEN_OF_TWENTY / sqrt(2)
    gain = (root + sqrt(root**2 + max(nats, 0.0))) ** 2
    return max(gain, 2 * (deviations + NINETEEN_OF_TWENTY) ** 2)


def compute_detection_limits(explanation: Explanation) -> dict[str, float]:
    """Return joint → torque of a further cause with one coefficient that would have been found, N m rms.

    It is what the model leaves of the cause's torque, with the spectrum of the joint's own torque, in 19 of 20 logs.
    """
    search = explanation.search
    problem = search.problem
    settings = problem.settings
    fit = explanation.found.final.fit
    limits = dict[str, float]()
    for j, joint in enumerate(problem.rig.joints):
        count = len(list_candidates(problem.rig, j, problem.ranges[j]))
        gain = compute_sure_gain(settings.gain_nats + log(count), search.least_deviations)
        white = search.whitening.apply(problem.rows, problem.scale[:, [j]], j)
        power = float(fit.weight[j] * np.sum(white**2))
        share = compute_size(gain, power, max(float(fit.rows[:, j].sum()), 1.0))
        limits[joint] = max(settings.material_share, share) * float(problem.torque_rms[j])
    return limits


def list_groups(search: Search, shelves: Iterable[Shelf], theta: Array) -> list[Group]:
    """Return all candidates with their whitened columns, by joint and of the whole rig.

    Args:
        search: The search.
        shelves: Those at every joint.
        theta: Coefficients of the model that causes of the whole rig change.
    """
    groups: list[Group] = [(shelf.candidates, shelf.pack) for shelf in shelves]
    for change in search.changes:
        pack = search.pack_rows(change.build_columns(search.problem, theta).rows)
        groups.append(([change.candidate], pack))
    return groups


def list_forms(fit: BlockFit, groups: Sequence[Group]) -> Forms:
    """Return the forms of every cause at every place; `fit`: of the model without causes."""
    forms: Forms = {}
    for candidates, pack in groups:
        for candidate, share in zip(candidates, fit.measure(pack).remaining.tolist()):
            forms.setdefault((candidate.name, candidate.place), []).append((candidate, share))
    return forms


def shows_in_motion(kind: type[Cause]) -> bool:
    """Return whether the motion alone tells what a cause adds; else it acts on the command."""
    return issubclass(kind, Effect | RigEffect) or kind.name in DRIVES


def list_untestable(
    explanation: Explanation, found: Sequence[tuple[str, str | None]]
) -> tuple[Untestable, ...]:
    """Return the causes of which the model without causes explains all, whatever their shape.

    Args:
        explanation: The models.
        found: Causes and joints of the findings, which are shown.
    """
    rig = explanation.search.problem.rig
    least = explanation.search.problem.settings.min_left_share
    first = explanation.found.first.fit
    groups = list_groups(explanation.search, explanation.found.shelves, first.theta)
    forms = list_forms(first, groups)
    hidden = list[Untestable]()
    for kind in CAUSES.values():
        if kind.of_given_model or not shows_in_motion(kind):
            continue
        for place in rig.joints if kind.of_joint else ("rig",):
            joint = get_joint(place)
            tried = forms.get((kind.name, place), [])
            # A gain is hidden if that of both directions is, whatever shows of one direction.
            coupled = [form for form in tried if form[0].cause.coupled]
            is_shown = any(share >= least for _, share in coupled or tried)
            if not (is_shown or (kind.name, joint) in found or kind.is_stated(place, rig)):
                hidden.append(Untestable(kind.name, joint, kind.hidden))
    return tuple(hidden)


def whiten_torque(search: Search, rows: Mapping[int, Array]) -> Array:
    """Return joint → rows (N,) of a torque as inner whitened rows, (N, n)."""
    white = np.zeros((np.count_nonzero(search.problem.rows.inner), search.problem.rig.n))
    for j, torque in rows.items():
        white[:, j] = search.whitening.apply(search.problem.rows, torque[:, None], j)[:, 0]
    return white


def measure_rivals(
    search: Search, fit: BlockFit, groups: Sequence[Group], planted: Candidate, size: float
) -> dict[tuple[str, str], tuple[float, float]]:
    """Return name and place of each rival of a planted cause → power that its best form leaves, and its log prior.

    Args:
        search: The search.
        fit: The model beside it, fitted to its torque alone.
        groups: All candidates.
        planted: The cause.
        size: What the torque is to be multiplied by where coefficients are judged.
    """
    least = search.problem.settings.min_left_share
    rivals = dict[tuple[str, str], tuple[float, float]]()
    for candidates, pack in groups:
        if (
            None not in (planted.joint, candidates[0].joint)
            and planted.joint != candidates[0].joint
        ):
            continue
        gains = fit.measure(pack)
        power = np.sum(gains.errors * fit.weight, axis=(1, 2))
        for k in np.argsort(-power).tolist():  # of each rival the form that leaves least comes last
            rival = candidates[k]
            values = size * gains.coefficients[k, : count_columns(rival)]
            is_left_out = gains.remaining[k] < least or rival.kind == planted.kind
            if not is_left_out and rival.is_admissible(values, np.zeros(0)):
                rivals[rival.name, rival.place] = float(power[k]), rival.log_prior
    blurred = planted.cause.blurred(search.problem.ranges[planted.joint or 0])
    return rivals | {(name, planted.place): (0.0, 0.0) for name in blurred}
