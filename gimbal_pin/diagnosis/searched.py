"""What the search over the training part ends with: named, doubted, dropped, and what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis import leftover, verdict
from gimbal_pin.diagnosis.contenders import untaken
from gimbal_pin.diagnosis.finding import Slight
from gimbal_pin.diagnosis.flips import flipped
from gimbal_pin.diagnosis.gains import attributed
from gimbal_pin.diagnosis.heldout import Figures
from gimbal_pin.diagnosis.library import Library, library
from gimbal_pin.diagnosis.plainer import plainer
from gimbal_pin.diagnosis.relatives import related
from gimbal_pin.diagnosis.restart import composed
from gimbal_pin.diagnosis.search import needed, polished, pruned, regrown
from gimbal_pin.diagnosis.shapes import FINE
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.diagnosis.wandering import calmed, reconsidered
from gimbal_pin.effects import Cause
from gimbal_pin.effects.sprung import Sprung
from gimbal_pin.errors import DataError
from gimbal_pin.log import Array

ERROR_RATE = 0.003
"""Chance that a log with nothing in it has anything named, over the whole library."""
FLIPS = 999
DRIVEN = 5.0
"""Least F by which the rigid model and friction must explain a joint's torque."""


class Searched(NamedTuple):
    """What the search over the training part ended with.

    Attributes:
        shelf: The library.
        first: The refitted model without any cause.
        state: All that the search found.
        final: What of it deserves a name.
        residual: What is left at each joint.
        slight: What is too small to matter.
        null: Smallest p over the library on flipped residuals, sorted, (flips,).
        doubtful: What fits and deserves no trust.
        denied: What the held-out part did not confirm.
        best: Held-out figures of the model with all that deserves a name.
        lacking: The same without each of its causes.
    """

    shelf: Library
    first: State
    state: State
    final: State
    residual: tuple[leftover.Residual, ...]
    slight: tuple[Slight, ...]
    null: Array
    doubtful: tuple[Cause, ...] = ()
    denied: tuple[Cause, ...] = ()
    best: Figures = MappingProxyType({})
    lacking: tuple[Figures, ...] = ()

    @property
    def limit(self) -> float:
        """Chance from which nothing is named."""
        return float(np.quantile(self.null, ERROR_RATE))


def searched(problem: Problem, causes: Mapping[str, type[Cause]], rng: np.random.Generator) -> Searched:
    """Compose causes, prune them, and keep those that deserve a name."""
    first = solved(problem, (), solved(problem, ()))
    check_driven(first)
    shelf = Library(problem, library(problem, comparable(causes)))
    state = needed(polished(composed(first, shelf)))
    null = flipped(state.fit, untaken(state, shelf.columns(state)), rng, FLIPS)
    limit = float(np.quantile(null, ERROR_RATE))
    left, small = pruned(state, limit, verdict.material)
    state = regrown(state, left, shelf, limit, verdict.material)
    state = attributed(plainer(reconsidered(polished(state, step=FINE), shelf)))
    final = believed(first, state)
    if swings(state, final):
        final = believed(first, solved(problem, [c for c in final.causes if not springy(c)], final))
    judged = calmed(state, leftover.judge(state, rng))
    shaped = {joint for joint, one in zip(problem.evidence.rig.joints, judged) if one.state == "structured"}
    rung = {joint for joint, one in zip(problem.evidence.rig.joints, judged) if one.rings}
    if others := [*outlines(first, state, final, shaped), *shaken(final, shaped), *echoes(final, rung)]:
        final = believed(first, solved(problem, [c for c in final.causes if c not in others], final))
    lost = [cause for cause in state.causes if cause not in final.causes]
    doubtful = tuple(c for c in lost if untrusted(first, state, c) or not verdict.minor(state, c))
    residual = marked(state, judged, doubtful)
    return Searched(shelf, first, state, final, residual, verdict.slight(final, small), null, doubtful)


def believed(first: State, state: State) -> State:
    """Leave out what deserves no trust, and then what deserves none without it, until all that is told does."""
    trusted = [c for c in state.causes if not (untrusted(first, state, c) or verdict.minor(state, c))]
    if len(trusted) == len(state.causes):
        return state
    return believed(first, solved(state.problem, trusted, state))


def swings(state: State, final: State) -> bool:
    """Whether one of several springs is none, and leaves more than any sensor's noise: then none of them is one.

    A mount, or a load that is not rigid, rings at all joints, and each of them looks as if it gave.
    """
    joints = state.problem.evidence.rig.joints
    lost = [joints.index(c.place) for c in state.causes if springy(c) and c not in final.causes]
    return any(map(springy, final.causes)) and bool(np.any(final.fit.dispersion[lost] > leftover.NOISY))


def springy(cause: Cause) -> bool:
    """Whether a cause is a joint that gives."""
    return isinstance(cause, Sprung) and cause.springy


def outlines(first: State, state: State, final: State, shaped: Set[str]) -> list[Cause]:
    """Functions of the angle that but sketch something else: what they leave of their joint's torque has a structure.

    `state` is all that was found, `final` what of it is told, `shaped` the joints at which a structure is left.
    """
    return [cause for cause in final.causes if cause.place in shaped and verdict.sketches(first, state, cause)]


def shaken(final: State, shaped: Set[str]) -> list[Cause]:
    """Springs, where a structure is left at another joint of which nothing is told: none of them is one.

    What a joint that gives asks of the others is in the model. What is left there is a mount's, or a swinging load's.
    """
    free = set(shaped) - {cause.place for cause in final.causes}
    return [cause for cause in final.causes if springy(cause) and free]


def echoes(final: State, rung: Set[str]) -> list[Cause]:
    """Springs that leave more than any sensor's noise, most of it where the drive's torque goes through a resonator.

    A joint that gives is that resonator, and leaves nothing of its kind: what does is a torque that swells and fades by
    itself, as under a supply's hum, and looks like a spring wherever the encoder sits. `rung` are the joints at which
    such is left.
    """
    left = dict(zip(final.problem.evidence.rig.joints, final.fit.dispersion.tolist()))
    springs = [cause for cause in final.causes if isinstance(cause, Sprung) and cause.place in rung]
    return [cause for cause in springs if left[cause.place] > leftover.NOISY]


def untrusted(first: State, state: State, cause: Cause) -> bool:
    """Whether too much is left for a name, or the name is that of a relative."""
    return verdict.doubtful(first, state, cause) or related(state, cause)


def left_over(state: State, doubtful: Sequence[Cause], rng: np.random.Generator) -> tuple[leftover.Residual, ...]:
    """What is left at each joint: never noise where something was found that deserves no trust."""
    return marked(state, calmed(state, leftover.judge(state, rng)), doubtful)


def marked(
    state: State, judged: Sequence[leftover.Residual], doubtful: Sequence[Cause]
) -> tuple[leftover.Residual, ...]:
    """Call every joint structured where something was found that deserves no trust."""
    joints = state.problem.evidence.rig.joints
    return tuple(doubted(left, joint, doubtful) for left, joint in zip(judged, joints))


def comparable(causes: Mapping[str, type[Cause]]) -> dict[str, type[Cause]]:
    """Leave out what compares the given model with the data: the refitted one has taken that up."""
    return {name: kind for name, kind in causes.items() if not kind.of_given_model}


def check_driven(state: State) -> None:
    """Raise `DataError` if a joint's torque has no more to do with its motion than noise has.

    ``F = (explained / parameters) / (left / rows)``: noise gives one, any rig hundreds.
    """
    n = len(state.fit.scale)
    whole, left = (np.sum(x.reshape(-1, n) ** 2, axis=0) for x in (state.fit.target, state.fit.residual))
    parameters = np.array([np.sum(np.any(state.fit.stack[j::n] != 0, axis=0)) for j in range(n)])
    rows = state.problem.evidence.rows * state.problem.evidence.used()
    F = (whole - left) / np.maximum(parameters, 1) / np.maximum(left / np.maximum(rows, 1.0), 1e-300)
    dumb = tuple(joint for joint, x in zip(state.problem.evidence.rig.joints, F) if x < DRIVEN)
    if dumb:
        what, mend = "their torque has nothing to do with the motion of", "check the torque's column, sign and time"
        raise DataError("the logs", what, mend, dumb)


def doubted(left: leftover.Residual, joint: str, causes: Sequence[Cause]) -> leftover.Residual:
    """A joint whose findings deserve no trust is structured."""
    if not any(cause.place == joint or not cause.of_joint for cause in causes):
        return left
    return leftover.Residual("structured", left.noise_floor, left.dispersion, left.where or "over its angle")
