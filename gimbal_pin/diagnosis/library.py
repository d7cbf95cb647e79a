"""Every cause at every joint on the coarse grid of its shape parameters, with its columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.state import Problem, State, near, sized
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal
from gimbal_pin.log import Array

TRIAL = 1e-3
"""Size of a rig's change in the library, rad."""
STALE = 0.05
"""Change of a torque, as a share, up to which a column of the coarse search is kept."""


def library(problem: Problem, kinds: Mapping[str, type[Cause]]) -> list[Cause]:
    """Every cause at every joint, on the coarse grid of its shape parameters."""
    rig, seen = problem.evidence.rig, problem.evidence.seen
    found: list[Cause] = []
    for kind in kinds.values():
        for joint, ranges in zip(rig.joints, seen) if kind.of_joint else ((rig.joints[0], seen[0]),):
            found += kind.tried(joint, ranges)
    return found


def kept(cause: Cause) -> Cause:
    """A cause as the library holds it: a change of the rig by its trial, however large the fit has made it."""
    return sized(cause, TRIAL) if isinstance(cause, RigEffect) else cause


class Library:
    """Columns of the whole library, built once; those that read a torque again where it has changed by much."""

    def __init__(self, problem: Problem, causes: Sequence[Cause]) -> None:
        """Remember what to build."""
        self.problem, self.causes = problem, causes
        self.built: dict[Cause, tuple[list[Array], Columns]] = {}

    def columns(self, state: State, place: str | None = None) -> list[Columns]:
        """Columns at this state, of all causes or only of those at a joint and of the whole rig."""
        here = [c for c in self.causes if place is None or c.place == place or not c.of_joint]
        taken = {kept(cause) for cause in state.causes}
        return [self.of(cause, state) for cause in here if kept(cause) not in taken]

    def of(self, cause: Cause, state: State) -> Columns:
        """Columns of one cause: as they were, if what they were built from is nearly as it was."""
        read = self.read(cause, state)
        known = self.built.get(cause)
        if known is None or not all(near(new, old, STALE) for new, old in zip(read, known[0])):
            known = read, state.columns(cause)
            self.built[cause] = known
        return known[1]

    def read(self, cause: Cause, state: State) -> list[Array]:
        """What a cause's columns depend on besides the log: the torque at its joint, the rig's inertias, or nothing."""
        if isinstance(cause, RigEffect):
            return [state.rig.phi]
        if isinstance(cause, Effect) and not cause.loaded:
            return []
        j = self.problem.evidence.rig.joint_index(cause.place)
        return [x[:, j] for x in (state.acting if isinstance(cause, Signal) else state.torque)]
