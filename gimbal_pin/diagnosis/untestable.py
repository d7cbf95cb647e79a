"""Which causes some logs cannot show: the rigid model and friction explain all that they would add."""

from __future__ import annotations

from collections.abc import Sequence

from gimbal_pin.diagnosis.finding import Finding, Untestable
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.score import HIDDEN, visibility
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects import Cause


def untestable(state: State, shelf: Library, findings: Sequence[Finding]) -> tuple[Untestable, ...]:
    """List causes of which a log shows less than `HIDDEN` at their own joint, but for those that were found.

    Args:
        state: The refitted model without any cause.
        shelf: The candidates.
        findings: What was found: one motor's gain shows by what it spares all others.
    """
    found = {(one.cause, one.joint) for one in findings}
    why = {cause.name: cause.hidden for cause in shelf.causes}
    rows = (at for at, seen in shown(state, shelf.causes, shelf).items() if seen < HIDDEN and at not in found)
    return tuple(Untestable(name, joint, why[name]) for name, joint in rows)


def shown(state: State, causes: Sequence[Cause], shelf: Library) -> dict[tuple[str, str | None], float]:
    """Return name and joint → the largest share of a column's power that the rigid model and friction leave."""
    visible: dict[tuple[str, str | None], float] = {}
    columns = [shelf.of(cause, state) for cause in causes]
    for cause, seen in zip(causes, visibility(state.fit, columns).tolist()):
        key = (cause.name, cause.place if cause.of_joint else None)
        visible[key] = max(visible.get(key, 0.0), seen)
    return visible
