"""Is what a delay leaves its own wandering: ``x(t - d - w(t)) ≈ x(t - d) - w(t) x'(t - d)``, w slow?

A queue, or two clocks that drift past each other, swing a drive's delay over seconds. What a delay that stands still
leaves of that is as large as what causes outside the library leave, and yet the name is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import log
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from gimbal_pin.diagnosis.evidence import Part
from gimbal_pin.diagnosis.fit import norms, refit
from gimbal_pin.diagnosis.leftover import MUCH, NEARLY_ALL, Residual
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.shapes import TOLD, refined, worth
from gimbal_pin.diagnosis.state import State, solved, without
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.log import Array

STEP = 0.5
"""Time between the corners of w(t), s: a swing of some seconds is followed, the torque's own swings are not."""


class Wander(NamedTuple):
    """What a signal's time is once it may change slowly.

    Attributes:
        rms: Of the change, s, over the time in which the torque changes.
        left: Dispersion at its joint with the change fitted, too.
        rows: Rows there that tell, less what is fitted.
    """

    rms: float
    left: float
    rows: float


def wandering(state: State, cause: Cause) -> Wander | None:
    """How a chosen delay wanders; None: it does not, or that is not what is left.

    No torque comes before its command: what would have to wander by more than the delay itself is none.
    """
    if not (isinstance(cause, Signal) and cause.wanders and unrest(state, cause)):
        return None
    found, before = loosened(state, cause), state.fit.dispersion[place(state, cause)]
    late = cause.late(state.problem.evidence.parts[0].dt)
    return found if found.rms < late and found.left - 1 < (1 - NEARLY_ALL) * (before - 1) else None


def place(state: State, cause: Cause) -> int:
    """Which joint a cause sits at."""
    return state.problem.evidence.rig.joint_index(cause.place)


def unrest(state: State, cause: Cause) -> bool:
    """Whether much is left at its joint."""
    return bool(state.fit.dispersion[place(state, cause)] > MUCH)


def loosened(state: State, signal: Signal) -> Wander:
    """Fit everything beside a signal whose time may change slowly, the joints weighted as before."""
    evidence, now = state.problem.evidence, state.fit
    j, n = place(state, signal), evidence.rig.n
    slopes = [np.gradient(x[:, j], part.dt) for part, x in zip(evidence.parts, state.acting)]
    late = evidence.whiten(slowly(evidence.parts, slopes), j)
    late = late[:, norms(late) > 1e-6 * np.max(norms(late))]  # no corner where the joint stands
    after = refit(now, late, j, evidence.used())
    rows = max(evidence.rows * float(evidence.used()[j]) - late.shape[1] - len(now.theta) / n, 1.0)
    change = np.linalg.norm(late @ after.theta[len(now.theta) :]) / np.linalg.norm(np.sum(late, axis=1))
    return Wander(float(change), float(np.sum(after.residual[j::n] ** 2) / now.scale[j] ** 2 / rows), rows)


def slowly(parts: Sequence[Part], values: Sequence[Array]) -> list[Array]:
    """Values, (m,) per part, times hats over the time of each part, (m, corners of all parts) per part."""
    each = []
    for part, x in zip(parts, values):
        corners = np.linspace(part.time[0], part.time[-1], round(np.ptp(part.time) / STEP) + 2)
        each.append(np.stack([x * np.interp(part.time, corners, hat) for hat in np.eye(len(corners))], axis=1))
    whole = block_diag(*each)
    return np.split(whole, np.cumsum([len(x) for x in each])[:-1])


def steady(state: State) -> Array:
    """Dispersion, (n,), less what delays leave by wandering."""
    out = state.fit.dispersion.copy()
    for cause in state.causes:
        if (found := wandering(state, cause)) is not None:
            out[place(state, cause)] = found.left
    return out


def calmed(state: State, residual: Sequence[Residual]) -> tuple[Residual, ...]:
    """What is left at each joint: noise where a delay's wandering is all that is more."""
    rows = zip(residual, state.fit.dispersion.tolist(), steady(state).tolist(), strict=True)
    return tuple(
        Residual("noise", one.noise_floor, left, "") if left < min(before, MUCH) else one for one, before, left in rows
    )


def hides(state: State, cause: Cause) -> bool:
    """Whether a cause at a wandering delay's joint is larger than what is left of that joint beside the wandering."""
    late = [one for one in state.causes if one.place == cause.place and one is not cause]
    found = [(one, now) for one in late if (now := wandering(state, one)) is not None]
    base = without(state, cause) if found else state
    return any(loosened(base, one).left > 2 * now.left for one, now in found if isinstance(one, Signal))


def reconsidered(state: State, shelf: Library) -> State:
    """Put a delay that wanders where a lag was chosen that leaves more even if its time may change as slowly."""
    for lag in state.causes:
        if not (isinstance(lag, Signal) and lag.linear and not lag.wanders and unrest(state, lag)):
            continue
        delays = [c for c in shelf.causes if isinstance(c, Signal) and c.wanders and c.place == lag.place]
        if not delays:  # they were not asked for
            continue
        base = without(state, lag)
        delay = refined(base, max(delays, key=partial(worth, base)))
        other = solved(state.problem, [delay if one is lag else one for one in state.causes], state)
        found = wandering(other, delay)
        if found is not None and found.rows * log(loosened(state, lag).left / found.left) > TOLD:
            return reconsidered(other, shelf)
    return state
