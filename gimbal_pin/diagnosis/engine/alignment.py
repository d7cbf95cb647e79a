"""When the measured torque acts: estimated with the model, since a torque that is off by milliseconds looks like much.

Channels of drives come some milliseconds apart. A shift a of the torque leaves ``(a* - a) dτ/dt``, which friction, lags
and springs take for theirs; it is the log's, and no finding.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.fit import project
from gimbal_pin.diagnosis.score import Beside
from gimbal_pin.diagnosis.state import State
from gimbal_pin.log import Array

FARTHEST = 5e-3
"""Largest shift that is the log's, s: buses of 200 Hz, and a smoothed angle; what is later is a drive's delay."""
ROUNDS = 3
"""Steps: each is nearly exact, as the band's highest frequency times what is left is small."""
SETTLED = 5e-5
"""Step, s, under which it is found: at 12 Hz it leaves four thousandths of the torque."""


def late(state: State) -> float:
    """Return ``Σ r·D/Σ D·D``, s: by how much later the torque acts, D what the rest of the model leaves of dτ/dt."""
    evidence = state.problem.evidence
    slopes: list[Array] = [
        np.gradient(x - left, part.dt, axis=0) for part, x, left in zip(evidence.parts, state.acting, state.unexplained)
    ]
    column = evidence.whiten_all(slopes)[:, :, None]
    rest = project(state.fit, Beside(None, column))[:, 0]
    return float(rest @ state.fit.residual / max(float(rest @ rest), 1e-300))


def aligned(
    gathered: Callable[[float], Evidence], start: float, modelled: Callable[[Evidence], State]
) -> tuple[float, State]:
    """Return the alignment, s, at which a model leaves least, and the model there.

    Args:
        gathered: Alignment, s → the logs.
        start: Where to begin, s.
        modelled: Logs → the model, refitted.
    """
    alignment, state = start, modelled(gathered(start))
    for _ in range(ROUNDS):
        to = float(np.clip(alignment + late(state), start - FARTHEST, start + FARTHEST))
        if abs(to - alignment) < SETTLED:
            break
        alignment, state = to, modelled(gathered(to))
    return alignment, state
