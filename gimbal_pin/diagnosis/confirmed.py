"""What the held-out part denies is not named: the torque there, and the rollout, with a cause and without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.contenders import resists
from gimbal_pin.diagnosis.evidence import Evidence, Part
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.heldout import CONFIRMED, Figures, measured
from gimbal_pin.diagnosis.searched import Searched, left_over
from gimbal_pin.diagnosis.shapes import measure, worth
from gimbal_pin.diagnosis.state import State, solved, without
from gimbal_pin.effects import Cause, Effect, Signal
from gimbal_pin.rows import Flags

STRAYED = 1.1
"""Error of the rollout with a cause over that without it, from which it makes the simulation worse."""
STRANGE = 0.1
"""Share of a joint's held-out samples at angles that the training part never saw, from which they are left out."""
CLEAR = 1.1
"""Gain at the other angles from which it does not count that a cause loses by all of them."""
ENOUGH = 0.2
"""Share of them that must be left to judge by."""
LENT = 2**0.5
"""Held-out error without a cause over that with it, from which one of several is believed where structure is left: if
it explains less of the error's power than is left, it may be what the others' forms and the unknown lend to it."""


def confirmed(found: Searched, held: Evidence, rng: np.random.Generator) -> Searched:
    """Drop what the held-out part denies, what the torque there misses least first, and judge the others again.

    Without it the torque there is predicted as well, or the simulation follows the measured angles better: one cause
    that is none may lead the simulation astray in another's name. Nothing is ever added or fitted there. What is left
    is judged again with all else that was found.
    """
    final, denied, known = found.final, list[Cause](), familiar(held, found.final.problem.evidence)
    while True:
        best, lacking = figures(held, final)
        ratios = confirmations(best, lacking, held, final)
        if known is not held:
            inside = confirmations(*figures(known, final), held, final)
            ratios = [own if own > CLEAR or all_ >= 1.0 else 0.0 for own, all_ in zip(inside, ratios)]
        over = [i for i, (x, least) in enumerate(zip(ratios, asked(found, final, ratios))) if x <= least]
        if not over:
            break
        weakest = min(over, key=lambda i: missed(best, lacking[i], held, final.causes[i]))
        denied.append(final.causes[weakest])
        final = solved(final.problem, [c for i, c in enumerate(final.causes) if i != weakest], final)
    found = found._replace(final=final, denied=tuple(denied), best=best, lacking=tuple(lacking))
    if not denied:
        return found
    rest = solved(found.state.problem, [c for c in found.state.causes if c not in denied], found.state)
    return found._replace(residual=left_over(rest, found.doubtful, rng))


def asked(found: Searched, final: State, ratios: Sequence[float]) -> list[float]:
    """Least `confirmation` of each cause: more of all but the strongest, where structure is left at its joint.

    What is left at another joint lends to it, too: the rigid model, which the joints share, takes up what it can there,
    and asks for it here. Friction shares nothing. What is no clearer any more than the error rate asks, now that all
    else is told closely, must gain as much.
    """
    joints = final.problem.evidence.rig.joints
    left = {joint for joint, one in zip(joints, found.residual) if one.state == "structured"}
    most = max(ratios, default=0.0)

    def lent(cause: Cause, ratio: float) -> bool:
        base = without(final, cause)
        if measure(base, cause).p > found.limit:
            return True
        if cause.place in left:
            return ratio < most
        return bool(left) and cause.of_joint and not (isinstance(cause, Effect) and resists(cause))

    return [LENT if lent(cause, x) else CONFIRMED for cause, x in zip(final.causes, ratios)]


def figures(held: Evidence, state: State) -> tuple[Figures, list[Figures]]:
    """Held-out figures of a state's model, and without each of its causes."""
    return measured(held, extended(state)), [measured(held, extended(without(state, cause))) for cause in state.causes]


def familiar(held: Evidence, train: Evidence) -> Evidence:
    """The held-out part less what lies at angles that the training part never saw, where that is much.

    A spring that was fitted to one half of the range says nothing of the other half, and is not denied by it.
    """
    q = np.concatenate([part.channels.q for part in train.parts])
    strange = [(part.channels.q < q.min(axis=0)) | (part.channels.q > q.max(axis=0)) for part in held.parts]
    share = np.mean(np.concatenate(strange), axis=0)
    apart = (share > STRANGE) & (share < 1.0 - ENOUGH)
    if not np.any(apart):
        return held
    return replace(held, parts=tuple(spared(part, out & apart) for part, out in zip(held.parts, strange)))


def spared(part: Part, strange: Flags) -> Part:
    """A part without the samples flagged (m, n), and without rollouts over them."""
    lost = np.any(strange, axis=1) | (False if part.channels.lost is None else part.channels.lost)
    return part._replace(gate=part.gate * ~strange, channels=part.channels._replace(lost=lost))


def confirmations(best: Figures, lacking: Sequence[Figures], held: Evidence, state: State) -> list[float]:
    """Return `confirmation` for each cause of a state; zero for one that gains no more, now that others are out."""
    rows = zip(lacking, state.causes, strict=True)
    return [confirmation(best, one, held, c) if worth(without(state, c), c) > 0 else 0.0 for one, c in rows]


def confirmation(best: Figures, lacking: Figures, held: Evidence, cause: Cause) -> float:
    """Torque error without a cause over that with it, where that is most; zero where with it the rollout is worse.

    The masses are fitted to what a drive passes on: with one that passes on next to nothing they are none, no rollout
    is possible any more, and that is worse than any.
    """
    own = [cause.place] if cause.of_joint else list(held.rig.joints)
    strayed, without_ = (np.linalg.norm([one["rollout_rmse"][joint] for joint in own]) for one in (best, lacking))
    if isinstance(cause, Signal):
        strayed = np.nan_to_num(strayed, nan=np.inf)
    return 0.0 if strayed > STRAYED * without_ else missed(best, lacking, held, cause)


def missed(best: Figures, lacking: Figures, held: Evidence, cause: Cause) -> float:
    """Torque error without a cause over that with it, where that is most."""
    own = [cause.place] if cause.of_joint else list(held.rig.joints)
    return max(lacking["torque_rmse"][joint] / best["torque_rmse"][joint] for joint in own)
