"""Is a named cause what its formula says, or its nearest relative outside the library?

A relative has one parameter more, which the formula says is zero. Where the log shows that it is not, the formula fits
for want of a better one, and its name deserves no trust.
"""

from __future__ import annotations

import numpy as np

from gimbal_pin.diagnosis.columns import plain_columns
from gimbal_pin.diagnosis.contenders import PENALTY
from gimbal_pin.diagnosis.fit import refit
from gimbal_pin.diagnosis.leftover import MUCH
from gimbal_pin.diagnosis.shapes import free
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.effects import Cause, Effect, Signal

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
    """Whether a cable and friction at its joint are one stop, or a guide, that pushes back and is rubbed against.

    ``tau = p(q) + mu |p(q)| slide``, p what the cable's formula says and mu Coulomb's: a cable pulls without friction,
    and friction of a bearing knows nothing of where a cable comes taut. They are one where mu alone gains as much as
    all that the friction's formula has free.
    """
    here = [c for c in state.causes if isinstance(c, Effect) and c.place == cause.place]
    cables = [c for c in here if c.restoring]
    pairs = [(cable, other) for cable in cables for other in here if other.dry and cause in (cable, other)]
    return any(rubbed(state, *pair) for pair in pairs)


def rubbed(state: State, cable: Effect, friction: Effect) -> bool:
    """Whether friction in proportion to a cable's pull stands for one that was found beside it."""
    base, evidence = without(state, friction), state.problem.evidence
    j = evidence.rig.joint_index(cable.joint)
    pulls = [x @ base.coefficients(cable) for x in plain_columns(evidence, cable, base.load)]
    columns = [np.abs(pull) * part.slide[:, j] for pull, part in zip(pulls, evidence.parts)]
    after = refit(base.fit, evidence.whiten(columns, j)[:, None], j, evidence.used())
    return bool(after.theta[-1] > 0) and after.cost + PENALTY < state.fit.cost + PENALTY * free(friction)
