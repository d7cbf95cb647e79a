"""Every cause at every joint on the coarse grid of its shape parameters, with its columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.diagnosis.columns import Columns, get_magnitude, part_from_friction
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.score import batches
from gimbal_pin.diagnosis.state import State, is_near, resize
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig

TRIAL = 1e-3
"""Size of a rig's change in the library, rad."""
STALE_CHANGE = 0.05
"""Change of a torque, as a share, up to which a column of the coarse search is kept."""


def list_candidates(evidence: Evidence, kinds: Mapping[str, type[Cause]]) -> list[Cause]:
    """Every cause at every joint, on the coarse grid of its shape parameters, but those that the rig states."""
    rig = evidence.rig
    seen = evidence.seen
    found: list[Cause] = []
    for kind in kinds.values():
        for joint, ranges in (
            zip(rig.joints, seen) if kind.of_joint else ((rig.joints[0], seen[0]),)
        ):
            if not kind.is_stated(joint, rig):
                found += kind.tried(joint, ranges)
    return found


def kept(cause: Cause) -> Cause:
    """A cause as the library holds it: a change of the rig by its trial, however large the fit has made it."""
    return resize(cause, TRIAL) if isinstance(cause, RigEffect) else cause


class ColumnLibrary:
    """Columns of the whole library, built once; those that read a torque again where it has changed by much.

    Attributes:
        rig: The rig.
        causes: The candidates.
        of_model: Whether a drive's signal acts on the model's torque instead of the measured one.
        built: What was built, and from what.
    """

    def __init__(self, rig: Rig, causes: Sequence[Cause], of_model: bool = False) -> None:
        """Remember what to build."""
        self.rig, self.causes, self.of_model = rig, causes, of_model
        self.built: dict[Cause, tuple[Read, Columns]] = {}

    def whitened(self, old: Evidence, new: Evidence) -> ColumnLibrary:
        """Return a library of columns that `old` has whitened, as `new` whitens them."""
        found = ColumnLibrary(self.rig, self.causes, self.of_model)
        every = list(self.built.items())
        for batch in batches([columns for _, (_, columns) in every]):
            some = [every[i] for i in batch]
            together = np.concatenate([columns.own.T for _, (_, columns) in some]).T
            rows = np.split(new.rewhiten(together, old, some[0][1][1].joint), len(batch), axis=-1)
            for (cause, (read, columns)), own in zip(some, rows):
                found.built[cause] = read, part_from_friction(new, replace(columns, own=own))
        return found

    def columns(self, state: State, place: str | None = None) -> list[Columns]:
        """Columns at this state, of all causes or only of those at a joint and of the whole rig.

        What was found to repeat with the angle is looked for at its overtones, too.
        """
        above = [
            one for cause in state.causes if isinstance(cause, Harmonic) for one in cause.above()
        ]
        every = dict.fromkeys([*self.causes, *above])
        here = [c for c in every if place is None or c.place == place or not c.of_joint]
        taken = {kept(cause) for cause in state.causes}
        return self.all_of([cause for cause in here if kept(cause) not in taken], state)

    def of(self, cause: Cause, state: State) -> Columns:
        """Columns of one cause."""
        return self.all_of([cause], state)[0]

    def all_of(self, causes: Sequence[Cause], state: State) -> list[Columns]:
        """Columns of causes: as they were, if what they were built from is nearly as it was."""
        reads: dict[tuple[str, str], Read] = {}
        still: dict[tuple[Read, Read], bool] = {}
        found = []
        for cause in causes:
            key = name_source(cause)
            now = reads[key] if key in reads else reads.setdefault(key, self.read(key, state))
            before, columns = self.built.get(cause, (now, None))
            if (now, before) not in still:
                still[now, before] = all(
                    is_near(new, old, STALE_CHANGE) for new, old in zip(now.arrays, before.arrays)
                )
            if columns is None or not still[now, before]:
                columns = state.columns(cause, state.torque if self.of_model else None)
                self.built[cause] = now, columns
            found.append(columns)
        return found

    def turns(self, state: State) -> Array:
        """How far the rig is turned in the state by each of the library's changes of it, 0 where it is not by much."""
        changes = {kept(change): get_magnitude(change) for change in state.stand.changes}
        return np.array(
            [changes.get(cause, 0.0) for cause in self.causes if isinstance(cause, RigEffect)]
        )

    def read(self, key: tuple[str, str], state: State) -> Read:
        """What some causes' columns depend on besides the log; see `name_source`."""
        what, place = key
        if what in ("inertias", ""):
            return Read([state.stand.rig.phi, self.turns(state)] if what else [])
        j = self.rig.joint_index(place)
        if what == "acting":
            return Read([x[:, j] for x in (state.torque if self.of_model else state.acting)])
        if what == "weight":
            return Read([x[:, j] for x in (*state.load.borne, *state.load.weight)])
        return Read([x[:, j] for x in state.torque])


@dataclass(frozen=True, eq=False)
class Read:
    """What columns were built from besides the log, compared but once for all causes that read it."""

    arrays: list[Array]


def name_source(cause: Cause) -> tuple[str, str]:
    """What a cause's columns depend on besides the log, and where: a torque at its joint, the inertias, or nothing."""
    if isinstance(cause, Effect) and cause.weighed:
        return "weight", cause.place
    if isinstance(cause, RigEffect):
        return "inertias", ""
    if isinstance(cause, Effect) and not cause.loaded:
        return "", ""
    return "acting" if isinstance(cause, Signal) else "torque", cause.place
