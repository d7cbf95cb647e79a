"""Looking for a gap with flanks that give, or a spring whose link swings far, where much is left of a joint.

A link's motion is too dear to work out at every step of a search, and at the encoder's angle such a spring may show no
more than by luck.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.contenders import ranked
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.search import polished
from gimbal_pin.diagnosis.shapes import worth
from gimbal_pin.diagnosis.state import State, left, solved
from gimbal_pin.effects.geared import Geared
from gimbal_pin.effects.loose import Loose
from gimbal_pin.effects.sprung import Sprung
from gimbal_pin.regressor import inertia

PROMISING = 0.25
"""Share of what is left of the joint that the best of these must explain to be refined: they are far apart."""


def loosened(state: State, joint: str, shelf: Library) -> list[State]:
    """States with a gap or a spring at a joint, in place of all there or beside it, what leaves least first."""
    others = tuple(cause for cause in state.causes if cause.place != joint or not cause.of_joint)
    beside = tuple(c for c in state.causes if not (isinstance(c, Geared) and c.joint == joint))
    bases = [solved(state.problem, causes, state) for causes in dict.fromkeys((others, beside))]
    kinds = dict.fromkeys(type(cause) for cause in shelf.causes if isinstance(cause, Loose))
    found = [with_gap(base, joint, kind) for base in bases for kind in kinds]
    found += [with_spring(base, joint, shelf) for base in bases]
    return sorted((one for one in found if one is not None), key=left)


def with_spring(base: State, joint: str, shelf: Library) -> State | None:
    """A state with the spring at a joint that gains most at the encoder's angle, its link where it swings."""
    springs = [c for c in shelf.causes if isinstance(c, Sprung) and c.springy and c.joint == joint]
    rows = ranked(base, shelf.all_of(springs, base))
    if not rows:
        return None
    best = rows[0][1].cause
    return polished(solved(base.problem, (*base.causes, best), base), only=best)


def with_gap(base: State, joint: str, kind: type[Loose]) -> State | None:
    """A state with the gap at a joint that gains most, its shape refined; None where none gains much."""
    rows = [(worth(base, gap), k, gap) for k, gap in enumerate(kind.giving(joint, mean_inertia(base, joint)))]
    gain, _, best = max(rows, default=(0.0, 0, None))
    j, n = base.problem.evidence.rig.joint_index(joint), base.problem.evidence.rig.n
    if best is None or gain < PROMISING * float(np.sum(base.fit.residual[j::n] ** 2)):
        return None
    state = polished(solved(base.problem, (*base.causes, best), base), only=best)
    gap = next(c for c in state.causes if isinstance(c, Loose) and c.joint == joint)
    told = replace(gap, rotor_share=share(state, gap))
    return solved(state.problem, tuple(told if c is gap else c for c in state.causes), state)


def share(state: State, gap: Loose) -> float:
    """The rotor's share of the joint's inertia, within what it may be."""
    shape = next(s for s in gap.shapes if s.name == "rotor_share")
    return float(np.clip(gap.inertia / mean_inertia(state, gap.joint), 1e-3, shape.upper))


def mean_inertia(state: State, joint: str) -> float:
    """The joint's own inertia, mean over the logs, kg m²."""
    j = state.problem.evidence.rig.joint_index(joint)
    q = np.concatenate([part.channels.q for part in state.problem.evidence.parts])
    return float(np.mean(inertia(state.rig, q, j)[:, j]))
