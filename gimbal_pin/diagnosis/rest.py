"""Torque that a model leaves at each joint, and how much of it is predictable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimbal_pin.diagnosis.search import Search, Solution
from gimbal_pin.diagnosis.structure import NO_BURSTS, Bursts, find_bursts, find_structure


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
    predictable: float = 0.0
    suspected: float = 0.0
    is_unknown: bool = False
    groups: tuple[str, ...] = ()
    bursts: Bursts = NO_BURSTS

    def compute_share(self, before: float, after: float) -> float:
        """``(e_0² - e_1²)/(e_0² - e_min²)``: share of the predictable error power that a cause explains.

        Args:
            before: Held-out error without the cause, N m.
            after: The same with it.
        """
        least = self.left**2 - self.suspected**2
        explained = max(before**2 - after**2, 0.0)
        return explained / max(before**2 - min(least, after**2), 1e-300)


def describe_rest(search: Search, solution: Solution) -> list[Rest]:
    """Return what a model leaves at each joint."""
    return [_describe_joint(search, solution, j) for j in search.problem.joints]


def _describe_joint(search: Search, solution: Solution, joint: int) -> Rest:
    """Return what a model leaves at a joint; what is immaterial beside no cause is not looked into."""
    problem = search.problem
    settings = problem.settings
    torque = float(problem.torque_rms[joint])
    material = settings.material_share * torque
    error = float(solution.errors[joint])
    has_causes = any(cause.joint in (joint, None) for cause in solution.accepted)
    if error <= material and not has_causes:
        return Rest(error)
    structure = find_structure(search, solution, joint)
    bursts = find_bursts(search, solution, joint)
    predictable = error * float(np.sqrt(max(1 - structure.remaining**2, 0.0)))
    is_suspected = structure.gain >= settings.gain_nats
    deviations = search.count_deviations(1) * structure.standard_error
    is_clear = is_suspected and structure.gain >= deviations
    is_large = predictable > max(material, settings.main_share * error)
    is_burst = bursts.size > material and bursts.share > settings.burst_share
    is_open = problem.rows.used[joint] > 0 and error > settings.main_share * torque
    return Rest(
        left=error,
        predictable=predictable * is_clear,
        suspected=predictable * is_suspected,
        is_unknown=(is_clear and is_large) or is_burst or is_open,
        groups=structure.groups,
        bursts=bursts,
    )
