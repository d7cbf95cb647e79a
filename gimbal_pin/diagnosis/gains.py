"""Which motor gives another torque than it reports? One at g is all others at 1/g, and every body g times as heavy.

A log alone tells such sets apart by nothing: the fewest motors are told, and of as many those that leave the bodies
nearest to the given ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from gimbal_pin.diagnosis.columns import plain_columns
from gimbal_pin.diagnosis.difference import Difference
from gimbal_pin.diagnosis.shapes import TOLD, measure
from gimbal_pin.diagnosis.state import State, consistent, solved, without
from gimbal_pin.effects import Cause, Effect
from gimbal_pin.log import Array


def attributed(state: State) -> State:
    """Put the torque gains at the motors to which they belong."""
    own = gains(state)
    if not own:
        return state
    rest = tuple(cause for cause in state.causes if cause not in own)
    others = [consistent(solved(state.problem, (*rest, *one), state)) for one in otherwise(state, own)]
    found = [state, *(one for one in others if shows(one))]
    left = [unexplained(one) for one in found]
    alike = [one for one, x in zip(found, left) if x < min(left) + TOLD]
    return min(alike, key=lambda one: (len(one.causes), apart(one)))


def gains(state: State) -> tuple[Effect, ...]:
    """The torque gains that were found."""
    return tuple(cause for cause in state.causes if isinstance(cause, Effect) and cause.proportional)


def shows(state: State) -> bool:
    """Whether each torque gain shows: where nearly all torque has one sign, one of that sign is but a heavier body."""
    return all(measure(without(state, gain), gain).gain > 0 for gain in gains(state))


def otherwise(state: State, own: Sequence[Effect]) -> list[tuple[Cause, ...]]:
    """Other sets of as many torque gains or fewer: at any joints; of one that is off in one direction, in the other."""
    if any(gain.mirrored() != gain for gain in own):
        return [(own[0].mirrored(),)] if len(own) == 1 else []
    joints = state.problem.evidence.rig.joints
    places = [at for many in range(1, len(own) + 1) for at in combinations(joints, many)]
    sets = [tuple(replace(own[0], joint=joint) for joint in at) for at in places]
    return [one for one in sets if set(one) != set(own) and len(one) < len(joints)]


def unexplained(state: State) -> float:
    """``rows Σ_j log |τ_j - total_j / (1 - missing_j)|²``, whitened: what is left in units of the reported torque.

    A gain reads the model's torque, which at frequencies where the model knows less is the measured one: the fit's own
    residual is then as many times smaller as the gain is.
    """
    evidence = state.problem.evidence
    total: list[Array] = [acting - rest for acting, rest in zip(state.acting, state.unexplained)]
    for gain in gains(state):
        j, missing = evidence.rig.joint_index(gain.joint), state.coefficients(gain)
        for x, columns, at in zip(total, plain_columns(evidence, gain, state.load), evidence.samples[j]):
            x[:, j] -= columns @ missing
            acts = np.not_equal(gain.basis(at._replace(tau=x[:, j]))[0], 0.0)
            x[:, j] /= np.where(acts, 1 - missing[0], 1.0)
    left = evidence.whiten_all([acting - x for acting, x in zip(state.acting, total)])
    return float(np.sum(evidence.rows * evidence.used() * np.log(np.sum(left**2, axis=0))))


def apart(state: State) -> float:
    """How far the fitted bodies are from the given ones, in squared standard deviations of the fit."""
    difference = Difference.of_fit(state.problem.evidence.rig, state.problem.reduction, state.fit)
    return float(np.sum((difference.whitener @ difference.change) ** 2))
