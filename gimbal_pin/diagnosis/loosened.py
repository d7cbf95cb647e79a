"""Looking for a gap with flanks that give, where much is left of a joint: too dear to try at every step of a search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.search import polished
from gimbal_pin.diagnosis.shapes import worth
from gimbal_pin.diagnosis.state import State, left, solved
from gimbal_pin.effects.backlash import Backlash
from gimbal_pin.regressor import inertia

GAPS = (3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
"""Gaps that are tried, rad."""
FLANKS = (15.0, 50.0)
"""Frequencies of their flanks, Hz."""
SHARES = (0.1, 0.3)
"""The rotor's shares of the joint's inertia."""
DAMPING = 0.7
"""Damping on the flanks that is tried: a link that lands on a gear bounces little."""
PROMISING = 0.25
"""Share of what is left of the joint that the best of these must explain to be refined: they are far apart."""


def loosened(state: State, joint: str) -> State | None:
    """The state that leaves least with a gap at a joint, in place of all there or beside it; None: no gap promises."""
    others = tuple(cause for cause in state.causes if cause.place != joint or not cause.of_joint)
    beside = tuple(c for c in state.causes if not (isinstance(c, Backlash) and c.joint == joint))
    bases = [solved(state.problem, causes, state) for causes in dict.fromkeys((others, beside))]
    found = [one for base in bases if (one := with_gap(base, joint)) is not None]
    return min(found, key=left, default=None)


def with_gap(base: State, joint: str) -> State | None:
    """A state with the gap at a joint that gains most, its shape refined; None where none gains much."""
    rows = [(worth(base, gap), k, gap) for k, gap in enumerate(tried(base, joint))]
    gain, _, best = max(rows, default=(0.0, 0, None))
    j, n = base.problem.evidence.rig.joint_index(joint), base.problem.evidence.rig.n
    if best is None or gain < PROMISING * float(np.sum(base.fit.residual[j::n] ** 2)):
        return None
    state = polished(solved(base.problem, (*base.causes, best), base), only=best)
    gap = next(c for c in state.causes if isinstance(c, Backlash) and c.joint == joint)
    told = replace(gap, rotor_share=share(state, gap))
    return solved(state.problem, tuple(told if c is gap else c for c in state.causes), state)


def tried(state: State, joint: str) -> list[Backlash]:
    """Gaps with flanks that give, of rotors light and heavy."""
    own = mean_inertia(state, joint)
    rotors = [(share * own, share) for share in SHARES if own > 0]
    return [Backlash(joint, gap, J, r, flank, DAMPING) for gap in GAPS for J, r in rotors for flank in FLANKS]


def share(state: State, gap: Backlash) -> float:
    """The rotor's share of the joint's inertia, within what it may be."""
    shape = next(s for s in gap.shapes if s.name == "rotor_share")
    return float(np.clip(gap.inertia / mean_inertia(state, gap.joint), 1e-3, shape.upper))


def mean_inertia(state: State, joint: str) -> float:
    """The joint's own inertia, mean over the logs, kg m²."""
    j = state.problem.evidence.rig.joint_index(joint)
    q = np.concatenate([part.channels.q for part in state.problem.evidence.parts])
    return float(np.mean(inertia(state.rig, q, j)[:, j]))
