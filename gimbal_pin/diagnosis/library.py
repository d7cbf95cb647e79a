"""Every candidate's whitened columns; those that read the model's torque are built anew where it changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.diagnosis.candidates import (
    LARGEST_RIPPLE,
    Candidate,
    compute_columns,
    count_columns,
)
from gimbal_pin.diagnosis.problem import Columns, Problem, Whitening
from gimbal_pin.diagnosis.score import Pack, pack_columns
from gimbal_pin.log.log import Array

STALE_TORQUE = 1e-3
"""Change of a joint's predicted torque, as a share of it, rms, from which columns that read it are built anew: a tenth
of the torque that matters."""


@dataclass(frozen=True, eq=False)
class Shelf:
    """Candidates at one joint with equally many columns, which all read the model's torque or all do not.

    Attributes:
        candidates: The candidates.
        joint: The joint.
        pack: Their whitened columns.
        torque: The joint's torque that they were built from, along all stretches.
    """

    candidates: tuple[Candidate, ...]
    joint: int
    pack: Pack
    torque: Array


def project_candidates(
    problem: Problem, candidates: Sequence[Candidate], joint: int, torque: Sequence[Array]
) -> Array:
    """Return the rows of candidates at a joint, (N, all k); columns that do not read the torque are kept.

    Args:
        problem: The rows.
        candidates: The candidates.
        joint: The joint.
        torque: The model's own torque along each stretch, N m, (m, n).
    """
    known = problem.projected
    missing = [one for one in candidates if one.reads_torque or one.cause not in known]
    widths = [count_columns(one) for one in missing]
    parts = [
        part.project(compute_columns(missing, problem.sample(s, joint, torque[s]), part.dt), joint)
        for s, part in enumerate(problem.rows.stretches)
    ]
    each = np.split(np.concatenate(parts), np.cumsum(widths)[:-1], axis=1)
    own = known | {one.cause: x for one, x in zip(missing, each)}
    known.update((one.cause, own[one.cause]) for one in missing if not one.reads_torque)
    return np.hstack([own[one.cause] for one in candidates])


def build_joint_columns(problem: Problem, candidate: Candidate, torque: Sequence[Array]) -> Columns:
    """Return the columns of one candidate at its joint.

    Harmonics whose periods a short travel does not resolve would take opposite values of any size without a prior.
    """
    joint = candidate.joint
    assert joint is not None
    torques = tuple(
        np.stack([*compute_columns([candidate], problem.sample(s, joint, own), part.dt)], axis=1)
        for s, (own, part) in enumerate(zip(torque, problem.rows.stretches))
    )
    precision = 0.0
    if candidate.is_harmonic:
        is_share = candidate.name == "torque-ripple"
        precision = (LARGEST_RIPPLE if is_share else float(problem.torque_rms[joint])) ** -2
    return Columns(torques, {joint: problem.rows.project(torques, joint)}, joint, (), precision)


def build_shelves(
    problem: Problem,
    whitening: Whitening,
    candidates: Sequence[Candidate],
    joint: int,
    torque: Sequence[Array],
) -> list[Shelf]:
    """Return candidates at a joint with their columns beside a model with some torque, N m, (m, n) per stretch."""
    groups = dict[tuple[bool, int], list[Candidate]]()
    for candidate in candidates:
        key = candidate.reads_torque, count_columns(candidate)
        groups.setdefault(key, []).append(candidate)
    rows = problem.rows
    level = np.concatenate([x[:, joint] for x in torque])
    shelves = list[Shelf]()
    for (_, width), group in groups.items():
        columns = project_candidates(problem, group, joint, torque)
        white = whitening.apply(rows, columns, joint)
        shelves.append(
            Shelf(tuple(group), joint, pack_columns({joint: white}, rows.folds, width), level)
        )
    return shelves


def renew_shelves(
    problem: Problem, whitening: Whitening, shelves: Sequence[Shelf], torque: Sequence[Array]
) -> list[Shelf]:
    """Return shelves whose columns are built from a model's torque, where that changed materially."""
    renewed = list[Shelf]()
    for shelf in shelves:
        level = np.concatenate([x[:, shelf.joint] for x in torque])
        change = float(np.linalg.norm(level - shelf.torque))
        is_stale = change > STALE_TORQUE * float(np.linalg.norm(level))
        if is_stale and shelf.candidates[0].reads_torque:
            renewed += build_shelves(problem, whitening, shelf.candidates, shelf.joint, torque)
        else:
            renewed.append(shelf)
    return renewed
