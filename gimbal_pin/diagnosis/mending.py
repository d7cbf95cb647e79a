"""Findings that only mend the form of another: no causes of their own.

A library has few forms of a cause, and nature more. What the nearest of them leaves over is taken up by the next best
cause at the joint that runs the same way. Were the first one free to be any mixture of its forms, nothing would be
left for the second.

A drive's limit or gap is a characteristic ``y = f(x)``. What scales the torque beside it, and gains nothing any more
where f may be any function, is a part of that characteristic. So is a ripple a part of friction over the angle, where
friction makes up the torque.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.contenders import PENALTY
from gimbal_pin.diagnosis.fit import Fit, fit, norms, project, refit
from gimbal_pin.diagnosis.leftover import hats
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.score import gained
from gimbal_pin.diagnosis.shapes import free, same, worth
from gimbal_pin.diagnosis.state import State, solved, without
from gimbal_pin.effects import Cause, Effect
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.signal import Static
from gimbal_pin.log import Array

PART = 0.05
"""Gain over that of another cause, up to which a cause may be what the other's form lacks: a fifth of its size."""
KEPT = 0.03
"""Share of its gain that a cause of its own keeps beside any mixture of the other's forms, which are few and smooth."""


def mended(state: State, shelf: Library) -> dict[Cause, Cause]:
    """Chosen causes that only mend another's form → that other.

    Args:
        state: All that was found.
        shelf: The library, for the forms.
    """
    formed = [cause for cause in state.causes if shaped(cause)]
    gain = {id(cause): worth(without(state, cause), cause) for cause in formed}
    out: dict[Cause, Cause] = {}
    for less in formed:
        above = (c for c in formed if c.place == less.place and gain[id(less)] < PART * gain[id(c)])
        other = next((c for c in above if keeps(state, less, c, shelf) < KEPT), None)
        if other is not None:
            out[less] = other
    return {**out, **bent(state), **spotted(state)}


def bent(state: State) -> dict[Cause, Cause]:
    """Chosen causes that scale the torque of a drive with a limit or a gap, as a part of that → the limit or gap."""
    drives = {cause.place: cause for cause in state.causes if isinstance(cause, Static)}
    scaling = [c for c in state.causes if isinstance(c, Effect) and c.loaded and c.place in drives]
    return {c: drives[c.place] for c in scaling if within(state, c, drives[c.place])}


def within(state: State, cause: Cause, drive: Cause) -> bool:
    """Whether a cause gains less than a drive's limit or gap, and nothing beside any function of the torque.

    Of the torque without the cause: all of it less the rigid model's would be the cause itself.
    """
    base, evidence = without(state, cause), state.problem.evidence
    alone, j = worth(base, cause), evidence.rig.joint_index(cause.place)
    if alone > worth(without(state, drive), drive):
        return False
    any_ = np.stack([evidence.whiten(one, j) for one in hats([torque[:, j] for torque in base.torque])], axis=1)
    return gained(refit(base.fit, any_, j, evidence.used()), base.columns(cause), False).gain < KEPT * alone


def spotted(state: State) -> dict[Cause, Cause]:
    """Ripples that are a part of friction over the angle → that friction."""
    rough = {c.place: c for c in state.causes if isinstance(c, Harmonic) and c.dry}
    ripples = [c for c in state.causes if isinstance(c, Harmonic) and c.loaded and c.place in rough]
    return {c: rough[c.place] for c in ripples if drawn(state, c, rough[c.place])}


def drawn(state: State, ripple: Cause, friction: Harmonic) -> bool:
    """Whether a ripple gains less than friction over the angle, and beside all harmonics of such friction but luck."""
    alone = worth(without(state, ripple), ripple)
    if alone > worth(without(state, friction), friction):
        return False
    every = type(friction)(friction.joint, tuple(map(float, range(1, friction.highest + 1))))
    rest = [every if c is friction else c for c in state.causes if c is not ripple]
    return worth(solved(state.problem, rest, state, keep=True), ripple) < PENALTY * free(ripple)


def shaped(cause: Cause) -> bool:
    """Whether a cause is a torque with a form; harmonics together are any function of the angle, and no form."""
    return isinstance(cause, Effect) and not isinstance(cause, Harmonic)


def keeps(state: State, cause: Cause, other: Cause, shelf: Library) -> float:
    """Share of its gain that a cause keeps beside a mixture of another's forms, each within its bounds."""
    rest = [c for c in state.causes if c is not cause and c is not other]
    base = solved(state.problem, rest, state, keep=True)
    forms = [base.columns(other), *(shelf.of(c, base) for c in shelf.causes if same(c, other))]
    alone = gained(solved(state.problem, [*rest, other], state, keep=True).fit, base.columns(cause), False).gain
    beside = gained(extended(base, mixed(base.fit, forms)), base.columns(cause), False).gain
    return beside / max(alone, 1e-300)


def mixed(now: Fit, forms: Sequence[Columns]) -> Array:
    """The columns that take part in the best mixture of some forms, whitened, (rows, n, c)."""
    from scipy.optimize import lsq_linear

    rest = np.hstack([project(now, columns) for columns in forms])
    unit = np.maximum(norms(rest), 1e-300)
    bounds = tuple(np.concatenate([getattr(columns, side) for columns in forms]) * unit for side in ("lower", "upper"))
    found = lsq_linear(rest / unit, now.residual, bounds, method="bvls")
    return np.concatenate([columns.values for columns in forms], axis=2)[:, :, found.active_mask == 0]


def extended(base: State, values: Array) -> Fit:
    """Fit some columns, (rows, n, c), beside all that a state has, the joints weighted as before."""
    now, n = base.fit, len(base.fit.scale)
    stack, target = (x.reshape(len(x) // n, n, -1) / now.scale[:, None] for x in (now.stack, now.target))
    A = np.concatenate([stack, values], axis=2)
    return fit(A, target[:, :, 0], base.problem.evidence.used(), now.block[::n], now.scale)
