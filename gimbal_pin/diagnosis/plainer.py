"""Of two forms that a log does not tell apart the plainer one: a limit of which one side was reached is one of both."""

from __future__ import annotations

from gimbal_pin.diagnosis.shapes import FINE, TOLD, refined, worth
from gimbal_pin.diagnosis.state import State, solved, without


def plainer(state: State) -> State:
    """Put every cause's plain form in its place, where that gains as much but for less than `TOLD`."""
    for cause in state.causes:
        if cause.plain() == cause:
            continue
        base = without(state, cause)
        plain = refined(base, cause.plain(), FINE)
        if worth(base, plain) > worth(base, cause) - TOLD:
            state = solved(state.problem, tuple(plain if c is cause else c for c in state.causes), state)
    return state
