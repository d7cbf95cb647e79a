"""What explains some logs: causes with their rivals, and how much of what was there is still unexplained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gimbal_pin.diagnosis.engine.discrepancy import Lack, lack_of_fit
from gimbal_pin.diagnosis.engine.noise import coloured, modelled
from gimbal_pin.diagnosis.engine.rivals import Rival, rivals
from gimbal_pin.diagnosis.engine.selection import Search, fitted, polished, pruned, selected
from gimbal_pin.diagnosis.engine.whitening import flat
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.library import library
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.effects import Cause
from gimbal_pin.reduction import Reduction
from gimbal_pin.threads import one_thread


@dataclass(frozen=True)
class Explained:
    """A model of some logs.

    Attributes:
        search: The candidates, and from what gain one is a cause.
        first: The refitted rigid model with Coulomb and viscous friction, without any cause.
        state: The same with the causes.
        rivals: Of each cause, what else explains it.
        before: Lack of fit of `first` at each joint.
        after: The same of `state`.
    """

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
def explain(evidence: Evidence, reduction: Reduction, causes: Mapping[str, type[Cause]]) -> Explained:
    """Find which causes explain some logs.

    The noise's spectrum is estimated before the search, and again with what it has found, then the search goes on.

    Args:
        evidence: The logs.
        reduction: Base parameters that their motion shows.
        causes: The causes to look for.
    """
    plain = Problem.of(flat(evidence), reduction)
    candidates = library(plain, causes)
    rigid = solved(plain, (), solved(plain, ()))
    columns = [modelled(rigid, cause) for cause in candidates]
    search = Search.of(coloured(plain, rigid, columns), candidates)
    state = selected(fitted(search.problem, (), rigid), search)
    if state.causes:
        search = Search.of(coloured(plain, state, columns), candidates)
        state = selected(fitted(search.problem, state.causes, state), search)
        state = pruned(polished(state, search), search)
    first = fitted(search.problem, (), rigid)
    others = tuple(rivals(state, cause, search) for cause in state.causes)
    joints = range(evidence.rig.n)
    before, after = (tuple(lack_of_fit(one, j) for j in joints) for one in (first, state))
    return Explained(search, first, state, others, before, after)
