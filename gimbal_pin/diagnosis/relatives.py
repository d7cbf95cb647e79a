"""Is a named cause what its formula says, or its nearest relative outside the library?

A relative has one parameter more, which the formula says is zero. Where the log shows that it is not, the formula fits
for want of a better one, and its name deserves no trust.
"""

from __future__ import annotations

import numpy as np

from gimbal_pin.diagnosis.columns import plain_columns
from gimbal_pin.diagnosis.contenders import PENALTY
from gimbal_pin.diagnosis.fit import Fit, refit
from gimbal_pin.diagnosis.leftover import MUCH
from gimbal_pin.diagnosis.shapes import free
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.effects import Cause, Effect, Signal
from gimbal_pin.log import Array

ASIDE = 0.15
"""Share of a joint's dry friction that may be none of its bristles': they are the friction of its bearing, and what
bends beside friction that does not, as a cable does, is another thing."""
SLID = 20.0
"""Power of bristles over that of what sets them apart from Coulomb friction, from which they slide nearly all the time:
of bristles of many lengths the shortest are then Coulomb friction to such a log."""
TAKEN = 0.25
"""Share of what is left at a joint that a relative's parameter explains, from which the relative it is."""


def related(state: State, cause: Cause) -> bool:
    """Whether a chosen cause stands for a relative of its own."""
    return stands_aside(state, cause) or sags(state, cause) or rubs(state, cause)


def stands_aside(state: State, cause: Cause) -> bool:
    """Whether bristles that bend for long do so beside dry friction that does not."""
    if not isinstance(cause, Effect) or not cause.bristly:
        return False
    at = len(state.problem.reduction.independent)
    here = [at + k for k, one in enumerate(state.problem.friction) if one.joint == cause.joint and one.dry]
    rest, bent = float(np.sum(state.fit.theta[here])), float(state.coefficients(cause)[0])
    return rest > ASIDE * (rest + bent) and state.columns(cause).bulk < SLID


def sags(state: State, cause: Cause) -> bool:
    """Whether what a drive's limit leaves goes away once the limit may depend on the rate, as a supply's voltage."""
    if not isinstance(cause, Signal):
        return False
    evidence, now = state.problem.evidence, state.fit
    j, n = evidence.rig.joint_index(cause.place), evidence.rig.n
    if now.dispersion[j] < MUCH:
        return False
    rows = [(part.channels.tau[:, j], part.channels.v[:, j]) for part in evidence.parts]
    columns = [cause.sagging(tau, rate) for tau, rate in rows]
    if not any(np.any(column) for column in columns):
        return False
    after = refit(now, evidence.whiten(columns, j)[:, None], j, evidence.used()).residual[j::n]
    return float(after @ after) < (1 - TAKEN) * float(np.sum(now.residual[j::n] ** 2))


def rubs(state: State, cause: Cause) -> bool:
    """Whether a cable is a stop, or a guide, that pushes back and is rubbed against.

    ``tau = p(q) + mu |p(q)| slide``, p what the cable's formula says and mu Coulomb's: a cable pulls without friction.
    Such friction shows in what is left, or the friction that was found beside the cable stands for it: of a bearing,
    it knows nothing of where a cable comes taut.
    """
    here = [c for c in state.causes if isinstance(c, Effect) and c.place == cause.place]
    cables, frictions = [c for c in here if c.restoring], [c for c in here if c.dry]
    pairs = [(cable, other) for cable in cables for other in frictions if cause in (cable, other)]
    if cause in cables or pairs:
        return any(rubbing_left(state, cable) for cable in cables) or any(rubbed(state, *pair) for pair in pairs)
    return False


def rubbing_left(state: State, cable: Effect) -> bool:
    """Whether friction in proportion to a cable's pull explains what is left with all that was found."""
    j, n, now = state.problem.evidence.rig.joint_index(cable.joint), len(state.fit.scale), state.fit
    after = rubbing(state, cable, state.coefficients(cable))
    rest, before = (float(np.sum(x.residual[j::n] ** 2)) for x in (after, now))
    return bool(after.theta[-1] > 0) and rest < (1 - TAKEN) * before


def rubbed(state: State, cable: Effect, friction: Effect) -> bool:
    """Whether friction in proportion to a cable's pull gains as much as one that was found beside it."""
    base = without(state, friction)
    after = rubbing(base, cable, base.coefficients(cable))
    return bool(after.theta[-1] > 0) and after.cost + PENALTY < state.fit.cost + PENALTY * free(friction)


def rubbing(state: State, cable: Effect, values: Array) -> Fit:
    """Fit ``|p| slide`` beside a state; its coefficient comes last."""
    evidence = state.problem.evidence
    j = evidence.rig.joint_index(cable.joint)
    pulls = [x @ values for x in plain_columns(evidence, cable, state.load)]
    columns = [np.abs(pull) * part.slide[:, j] for pull, part in zip(pulls, evidence.parts)]
    return refit(state.fit, evidence.whiten(columns, j)[:, None], j, evidence.used())
