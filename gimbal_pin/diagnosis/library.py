"""Every candidate's whitened columns; those that read the model's torque are built anew where it changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.diagnosis.candidates import (
    LARGEST_RIPPLE,
    Candidate,
    compute_columns,
    count_columns,
    list_candidates,
)
from gimbal_pin.diagnosis.problem import Columns, Problem, Whitening
from gimbal_pin.diagnosis.score import Pack, pack_columns
from gimbal_pin.log.log import Array


@dataclass(frozen=True, eq=False)
class Shelf:
    """Candidates at one joint and their columns.

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
    """Return the rows of candidates at a joint, (N, all k); `torque`: the model's own, N m, (m, n) per stretch."""
    stretches = problem.rows.stretches
    signals = [
        compute_columns(candidates, problem.sample(s, joint, torque[s]), part.dt)
        for s, part in enumerate(stretches)
    ]
    return problem.rows.project(signals, joint)


def build_joint_columns(problem: Problem, candidate: Candidate, torque: Sequence[Array]) -> Columns:
    """Return the columns of one candidate at its joint."""
    joint = candidate.joint
    assert joint is not None
    torques = tuple(
        compute_columns([candidate], problem.sample(s, joint, torque[s]), part.dt)
        for s, part in enumerate(problem.rows.stretches)
    )
    rows = {joint: problem.rows.project(torques, joint)}
    return Columns(torques, rows, joint, precision=get_precision(problem, candidate))


def get_precision(problem: Problem, candidate: Candidate) -> float:
    """Return the prior precision of a candidate's coefficients.

    Harmonics whose periods a short travel does not resolve would else take opposite values of any size.
    """
    if not candidate.is_harmonic or candidate.joint is None:
        return 0.0
    is_share = candidate.name == "torque-ripple"
    size = LARGEST_RIPPLE if is_share else float(problem.torque_rms[candidate.joint])
    return 1.0 / size**2


def pack_candidates(
    problem: Problem,
    whitening: Whitening,
    target: Array,
    candidates: Sequence[Candidate],
    joint: int,
    torque: Sequence[Array],
) -> Pack:
    """Return the whitened columns of candidates at a joint; `target`: inner whitened torque, (N, n)."""
    rows = project_candidates(problem, candidates, joint, torque)
    white = whitening.apply(problem.rows, rows, joint)
    widths = [count_columns(candidate) for candidate in candidates]
    return pack_columns({joint: white}, widths, target, problem.rows.folds)


def build_shelves(
    problem: Problem, whitening: Whitening, target: Array, torque: Sequence[Array]
) -> list[Shelf]:
    """Return two shelves per joint: candidates that read the motion alone, and those that read the torque."""
    shelves = list[Shelf]()
    for j in problem.joints:
        every = list_candidates(problem.rig, j, problem.ranges[j])
        level = np.concatenate([x[:, j] for x in torque])
        for reads in (False, True):
            own = tuple(one for one in every if one.reads_torque is reads)
            if own:
                pack = pack_candidates(problem, whitening, target, own, j, torque)
                shelves.append(Shelf(own, j, pack, level))
    return shelves


def renew_shelves(
    problem: Problem,
    whitening: Whitening,
    target: Array,
    shelves: Sequence[Shelf],
    torque: Sequence[Array],
) -> list[Shelf]:
    """Return shelves whose columns are built from a model's torque, where that changed materially."""
    renewed = list[Shelf]()
    for shelf in shelves:
        j = shelf.joint
        level = np.concatenate([x[:, j] for x in torque])
        change = float(np.linalg.norm(level - shelf.torque))
        stale = problem.settings.stale_torque * float(np.linalg.norm(level))
        if shelf.candidates[0].reads_torque and change > stale:
            pack = pack_candidates(problem, whitening, target, shelf.candidates, j, torque)
            shelf = replace(shelf, pack=pack, torque=level)
        renewed.append(shelf)
    return renewed
