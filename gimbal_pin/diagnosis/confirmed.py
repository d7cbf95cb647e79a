"""What the held-out part denies is not named: the torque there, and the rollout, with a cause and without it."""

from __future__ import annotations

import numpy as np

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.heldout import CONFIRMED, Figures, measured
from gimbal_pin.diagnosis.searched import Searched, left_over
from gimbal_pin.diagnosis.state import solved, without
from gimbal_pin.effects import Cause

STRAYED = 1.1
"""Error of the rollout with a cause over that without it, from which it makes the simulation worse."""


def confirmed(found: Searched, held: Evidence, rng: np.random.Generator) -> Searched:
    """Drop what the held-out part denies, the weakest first.

    Without it the torque there is predicted as well, or the simulation follows the measured angles better. Nothing is
    ever added or fitted there. What is left is judged again with all else that was found.
    """
    final, denied = found.final, list[Cause]()
    while True:
        best = measured(held, extended(final))
        lacking = [measured(held, extended(without(final, cause))) for cause in final.causes]
        rows = [(confirmation(best, one, held, cause), i) for i, (one, cause) in enumerate(zip(lacking, final.causes))]
        ratio, weakest = min(rows, default=(np.inf, 0))
        if ratio > CONFIRMED:
            break
        denied.append(final.causes[weakest])
        final = solved(final.problem, [c for i, c in enumerate(final.causes) if i != weakest], final)
    found = found._replace(final=final, denied=tuple(denied), best=best, lacking=tuple(lacking))
    if not denied:
        return found
    rest = solved(found.state.problem, [c for c in found.state.causes if c not in denied], found.state)
    return found._replace(residual=left_over(rest, found.doubtful, rng))


def confirmation(best: Figures, lacking: Figures, held: Evidence, cause: Cause) -> float:
    """Torque error without a cause over that with it, where that is most; zero where with it the rollout is worse."""
    own = [cause.place] if cause.of_joint else list(held.rig.joints)
    strayed, without_ = (np.linalg.norm([one["rollout_rmse"][joint] for joint in own]) for one in (best, lacking))
    if strayed > STRAYED * without_:
        return 0.0
    return max(lacking["torque_rmse"][joint] / best["torque_rmse"][joint] for joint in own)
