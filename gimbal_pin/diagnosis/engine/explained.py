"""What explains some logs: causes with their rivals, and how much of what was there is still unexplained."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from gimbal_pin.diagnosis.engine.alignment import aligned
from gimbal_pin.diagnosis.engine.discrepancy import Lack, lack_of_fit
from gimbal_pin.diagnosis.engine.noise import coloured, modelled
from gimbal_pin.diagnosis.engine.rivals import Rival, rivals
from gimbal_pin.diagnosis.engine.selection import Search, fitted, polished, pruned, selected
from gimbal_pin.diagnosis.engine.whitening import flat, rewhitened_problem
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.library import library
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.effects import Cause
from gimbal_pin.reduction import Reduction
from gimbal_pin.threads import one_thread

PASSES = 2
"""Searches: the second begins with what the first has found, and with the noise that is left beside it."""


@dataclass(frozen=True)
class Explained:
    """A model of some logs.

    Attributes:
        alignment: By how much later than its stamp the torque acts, s.
        search: The candidates, and from what gain one is a cause.
        first: The refitted rigid model with Coulomb and viscous friction, without any cause.
        state: The same with the causes.
        rivals: Of each cause, what else explains it.
        before: Lack of fit of `first` at each joint.
        after: The same of `state`.
    """

    alignment: float
    search: Search
    first: State
    state: State
    rivals: tuple[tuple[Rival, ...], ...]
    before: tuple[Lack, ...]
    after: tuple[Lack, ...]

    def left(self, joint: int) -> float:
        """Structured power that is left at a joint over what there was before: one, where nothing was explained."""
        was, now = self.before[joint].power, self.after[joint].power
        return now / was if was > 0 else float(now > 0)


@one_thread()
def explain(
    gathered: Callable[[float], Evidence], alignment: float, reduction: Reduction, causes: Mapping[str, type[Cause]]
) -> Explained:
    """Find which causes explain some logs.

    Alignment and the noise's spectrum are estimated before the search, and again with what it has found; then the
    search goes on.

    Args:
        gathered: Alignment of the torque, s → the logs.
        alignment: Where to begin, s.
        reduction: Base parameters that their motion shows.
        causes: The causes to look for.
    """
    found: tuple[Cause, ...] = ()
    start = alignment
    for _ in range(PASSES):
        alignment, plain = aligned(gathered, start, partial(refitted, reduction=reduction, causes=found))
        search = listened(plain, library(plain.problem, causes))
        state = selected(fitted(search.problem, found, plain), search)
        if not state.causes:
            break
        found = state.causes
    state = pruned(polished(state, search), search)
    first = fitted(search.problem, (), state)
    others = tuple(rivals(state, cause, search) for cause in state.causes)
    joints = range(first.problem.evidence.rig.n)
    before, after = (tuple(lack_of_fit(one, j) for j in joints) for one in (first, state))
    return Explained(alignment, search, first, state, others, before, after)


def refitted(evidence: Evidence, reduction: Reduction, causes: Sequence[Cause]) -> State:
    """Fit the rigid model with causes to logs; what reads the model's torque reads that of the rigid one first."""
    problem = Problem.of(evidence, reduction)
    return fitted(problem, causes, solved(problem, ()))


def listened(state: State, candidates: Sequence[Cause]) -> Search:
    """Return the search among candidates, on the logs of a model whitened by the noise's spectrum."""
    problem = rewhitened_problem(state.problem, flat(state.problem.evidence))
    plain = solved(problem, state.causes, state)
    return Search.of(coloured(problem, plain, [modelled(plain, cause) for cause in candidates]), candidates)
