"""Torque that a model leaves at each joint, and how much of it is predictable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimbal_pin.diagnosis.search import Search, Solution
from gimbal_pin.diagnosis.structure import (
    Bursts,
    Structure,
    build_motion_rows,
    find_bursts,
    find_structure,
)


@dataclass(frozen=True)
class Rest:
    """Torque that is left at a joint.

    Attributes:
        left: Held-out error, N m.
        predictable: Part of it that the flexible model predicts, N m; 0 where its gain is not clear.
        suspected: The same where its gain is positive, clear or not: it counts against a name.
        is_unknown: Whether that is too much to be called noise.
        groups: What it depends on, the strongest group of functions first.
        bursts: Part that stands in few moments.
    """

    left: float
    predictable: float
    suspected: float
    is_unknown: bool
    groups: tuple[str, ...]
    bursts: Bursts


def describe_rest(search: Search, solution: Solution) -> list[Rest]:
    """Return what a model leaves at each joint."""
    problem = search.problem
    settings = problem.settings
    motion = build_motion_rows(problem, search.whitening, solution.torque)
    out = list[Rest]()
    for j in problem.joints:
        left = solution.left[:, j]
        structure = find_structure(
            problem, search.whitening, solution.fit, solution.torque, motion, j, left
        )
        bursts = find_bursts(problem, solution.torque, j, left)
        error = float(solution.errors[j])
        predictable = error * float(np.sqrt(max(1 - structure.left**2, 0.0)))
        torque = float(problem.torque_rms[j])
        is_clear = is_gain_clear(search, structure)
        is_large = predictable > max(
            settings.material_share * torque, settings.unknown_share * error
        )
        is_burst = (
            bursts.size > settings.material_share * torque and bursts.share > settings.burst_share
        )
        is_open = problem.rows.used[j] > 0 and error > settings.open_share * torque
        out.append(
            Rest(
                error,
                predictable if is_clear else 0.0,
                predictable if structure.gain >= settings.gain_nats else 0.0,
                (is_clear and is_large) or is_burst or is_open,
                structure.groups,
                bursts,
            )
        )
    return out


def is_gain_clear(search: Search, structure: Structure) -> bool:
    """Return whether the flexible model's gain is more than its search finds by chance."""
    nats = search.problem.settings.gain_nats
    deviations = search.count_deviations(1) * structure.standard_error
    return structure.gain >= nats and structure.gain >= deviations
