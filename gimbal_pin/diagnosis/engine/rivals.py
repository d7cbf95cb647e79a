"""Which causes a log does not part from one that was found: the same model with another in its place."""

from __future__ import annotations

from dataclasses import dataclass

from gimbal_pin.diagnosis.engine.criterion import by_block, criterion, vuong
from gimbal_pin.diagnosis.engine.selection import MOST, Search, promising, together
from gimbal_pin.diagnosis.engine.support import fitted, unsupported, without
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects import Cause
from gimbal_pin.log.log import Array

APART = 1.96
"""Deviations from which two models are told apart (Vuong, Econometrica 57, 1989; 95 %)."""


@dataclass(frozen=True)
class Rival:
    """A cause in a finding's place.

    Attributes:
        cause: It, refined.
        state: The model with it.
        worse: How much higher the criterion is with it.
        blocks: How much less of each block's log likelihood it explains, (blocks,).
    """

    cause: Cause
    state: State
    worse: float
    blocks: Array

    @property
    def z(self) -> float:
        """Vuong's ratio: difference of the log likelihoods over its deviation by blocks."""
        return vuong(self.blocks)

    def parted(self, threshold: float) -> bool:
        """Whether the log tells it from the finding: by more than chance, and in more than a few blocks."""
        return self.worse > threshold and self.z > APART


def rivals(state: State, cause: Cause, search: Search) -> tuple[Rival, ...]:
    """Return what else explains what a chosen cause explains, the best first."""
    less = without(state, cause)
    found = []
    for other in promising(less, search):
        if (other.name, other.place) != (cause.name, cause.place):
            new = fitted(less.problem, together(less.causes, other), less)
            if not unsupported(new):
                found.append(Rival(new.causes[-1], new, criterion(new) - criterion(state), by_block(state, new)))
    return tuple(sorted(found, key=lambda one: one.worse))


def contested(state: State, search: Search) -> tuple[State, tuple[tuple[Rival, ...], ...]]:
    """Return a model in which no cause has a better rival, and the rivals of each of its causes.

    What was found first was found beside less: a cause from which another is told since gives way to it.
    """
    for swaps in range(MOST + 1):
        others = tuple(rivals(state, cause, search) for cause in state.causes)
        best = min((rival for each in others for rival in each), key=lambda one: one.worse, default=None)
        if best is None or best.worse > -search.threshold or swaps == MOST:
            break
        state = best.state
    return state, others
