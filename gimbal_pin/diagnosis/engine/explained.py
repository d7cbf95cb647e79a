"""What explains some logs: causes with their rivals, and how much of what was there is still unexplained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from gimbal_pin.diagnosis.engine.alignment import aligned, shifts
from gimbal_pin.diagnosis.engine.discrepancy import Lack, lack_of_fit
from gimbal_pin.diagnosis.engine.noise import coloured, modelled
from gimbal_pin.diagnosis.engine.rivals import Rival, contested
from gimbal_pin.diagnosis.engine.selection import MOST, Search, fitted, polished, pruned, selected
from gimbal_pin.diagnosis.engine.whitening import flat, modelled_torque, rewhitened_problem
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.library import library
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.effects import Cause
from gimbal_pin.log import Array
from gimbal_pin.reduction import Reduction
from gimbal_pin.threads import one_thread

STRUCTURED = 0.1
"""Share of what is left from which it has a structure: δ predicts less of noise, see `lack_of_fit`."""
PASSES = 2
"""Searches: the second begins with what the first has found, and with the noise that is left beside it."""


@dataclass(frozen=True)
class Explained:
    """A model of some logs.

    Attributes:
        alignment: By how much later than it was gathered each joint's torque acts, s, (n,).
        search: The candidates, and from what gain one is a cause.
        first: The refitted rigid model with Coulomb and viscous friction, without any cause.
        state: The same with the causes.
        rivals: Of each cause, what else explains it.
        before: Lack of fit of `first` at each joint.
        after: The same of `state`.
    """

    alignment: Array
    search: Search
    first: State
    state: State
    rivals: tuple[tuple[Rival, ...], ...]
    before: tuple[Lack, ...]
    after: tuple[Lack, ...]

    @property
    def structured(self) -> frozenset[str]:
        """Joints at which δ still predicts what the causes do not explain."""
        joints = self.first.problem.evidence.rig.joints
        return frozenset(joint for joint, lack in zip(joints, self.after) if lack.share > STRUCTURED)

    @property
    def named(self) -> tuple[Cause, ...]:
        """Causes that deserve a name: none beside a structure, where one may stand for what nobody knows.

        A search that was stopped, not ended, has sketched something with what it had.
        """
        if len(self.state.causes) >= MOST:
            return ()
        left = self.structured
        return tuple(one for one in self.state.causes if (one.place not in left if one.of_joint else not left))

    def left(self, joint: int) -> float:
        """Structured power that is left at a joint over what there was before: one, where nothing was explained."""
        was, now = self.before[joint].power, self.after[joint].power
        return now / was if was > 0 else float(now > 0)


@one_thread()
def explain(evidence: Evidence, reduction: Reduction, causes: Mapping[str, type[Cause]]) -> Explained:
    """Find which causes explain some logs.

    The torques' time and the noise's spectrum are estimated before the search, and again with what it has found; then
    the search goes on.

    Args:
        evidence: The logs.
        reduction: Base parameters that their motion shows.
        causes: The causes to look for.
    """
    evidence = modelled_torque(evidence)
    given = replace(Problem.of(evidence, reduction), luck=1e-9)  # the noise is the data's own: no fit beats it by luck
    found: tuple[Cause, ...] = ()
    for _ in range(PASSES):
        plain = aligned(evidence, found, partial(refitted, given, found))
        search = listened(plain, library(plain.problem, causes))
        state = selected(polished(fitted(search.problem, found, plain), search), search)
        if not state.causes:
            break
        found = state.causes
    state, others = contested(pruned(polished(state, search), search), search)
    first = fitted(search.problem, (), state)
    joints = range(first.problem.evidence.rig.n)
    before, after = (tuple(lack_of_fit(one, j) for j in joints) for one in (first, state))
    return Explained(shifts(first.problem.evidence), search, first, state, others, before, after)


def refitted(given: Problem, causes: Sequence[Cause], evidence: Evidence) -> State:
    """Fit the rigid model with causes to retimed logs; what reads the model's torque reads the rigid one's first."""
    problem = replace(given, evidence=evidence)
    return fitted(problem, causes, solved(problem, ()))


def listened(state: State, candidates: Sequence[Cause]) -> Search:
    """Return the search among candidates, on the logs of a model whitened by the noise's spectrum."""
    problem = rewhitened_problem(state.problem, flat(state.problem.evidence))
    plain = solved(problem, state.causes, state)
    return Search.of(coloured(problem, plain, [modelled(plain, cause) for cause in candidates]), candidates)
