"""Do several logs speak of one rig? Each log's own base parameters against those that all share.

Logs of different cameras, or of a rig that somebody has touched in between, fit one model badly and some cause's name
well: this comes before any name.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import DataError, digits
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering, Flags, project_rows
from gimbal_pin.rig.rig import Rig

NAME = "logs-disagree"
MATERIAL = 0.01
"""Torque that the disagreement moves, as a share of the joint's rms, under which it does not matter."""
BEYOND = 2.0
"""The same over what each log's own fit leaves: less could be a misfit that the logs' motions bring out differently."""


SETTLED = 0.5
"""The same where the logs stood apart before any cause was found: causes must settle it, not only make it smaller."""
SOUND = 4.0
"""Dispersion under which nothing that could set a log apart is left of it."""

Alone = Mapping[str, Problem]
"""Each log by its number and name."""


class Apart(NamedTuple):
    """How far a log is from what all logs share.

    Attributes:
        log: Its name.
        torque: Torque that the difference of parameters moves on it, friction refitted, N m rms, (n,): its share of
            the whitened torque, times the torque's rms.
        excess: The same over what the log's own fit leaves, (n,).
        share: The same over the log's torque, (n,).
    """

    log: str
    torque: Array
    excess: Array
    share: Array

    def serious(self, limit: Array | float = BEYOND) -> Flags:
        """Joints at which it stands out by more than a limit and matters, (n,)."""
        return np.asarray((self.excess > limit) & (self.share > MATERIAL))


def alone(rig: Rig, logs: Sequence[Log], filtering: Filtering) -> Alone:
    """Return every log that is long enough to tell on its own; held-out logs are among them."""
    reduction, found = reduce_parameters(rig), {}
    for k, log in enumerate(logs if len(logs) > 1 else ()):
        with contextlib.suppress(DataError):
            evidence = gather(rig, [log], filtering, {log.name: float(log.t[0])})
            found[f"{k + 1}: {log.name}"] = Problem.of(evidence, reduction)
    return found


def outright(rig: Rig, problems: Alone) -> Fault | None:
    """Compare the logs before anything is looked for: each on its own is as good as its sensors, together they are not.

    Where something is left of a log on its own, that may be what sets it apart: then `agreement` tells, once causes
    have been found.
    """
    states = {name: solved(problem, ()) for name, problem in problems.items()}
    sound = np.all([state.fit.dispersion < SOUND for state in states.values()], axis=0)
    return disagreement(rig, apart(states), np.where(sound, BEYOND, np.inf))


def agreement(rig: Rig, problems: Alone, causes: Sequence[Cause]) -> Fault | None:
    """Fit each log on its own, with all that has been found in the fit, and compare.

    Args:
        rig: The rig.
        problems: The logs.
        causes: What has been found.

    Returns:
        The fault, or None: the logs agree, or there is only one that is long enough to tell.
    """
    plain = {name: solved(problem, ()) for name, problem in problems.items()}
    stood = np.any([row.serious() for row in apart(plain)] or [np.zeros(rig.n, bool)], axis=0)
    states = {name: solved(problem, causes, plain[name]) for name, problem in problems.items()}
    return disagreement(rig, apart(states), np.where(stood, SETTLED, BEYOND))


def disagreement(rig: Rig, rows: Sequence[Apart], limit: Array) -> Fault | None:
    """Return the fault if a log stands out by more than the limit of a joint, (n,)."""
    return told(rig, rows, limit) if any(row.serious(limit).any() for row in rows) else None


def apart(states: Mapping[str, State]) -> list[Apart]:
    """Compare each log's parameters with those that all share, ``(Σ H_i)⁻¹ Σ H_i β_i``; none where one is alone.

    H_i is the information that a log has of the base parameters and of what the causes add, which one rig has the same
    in every log; friction, which changes with temperature, is left open.
    """
    if len(states) < 2:
        return []
    parts = {name: free(state) for name, state in states.items()}
    both = np.vstack([columns for columns, _ in parts.values()])
    shared = np.linalg.lstsq(both, np.concatenate([target for _, target in parts.values()]), rcond=1e-10)[0]
    return [compared(name, state, *parts[name], shared) for name, state in states.items()]


def free(state: State) -> tuple[Array, Array]:
    """Weighted columns of base parameters and causes without what friction can take up, and the torque they fit.

    (rows n, shared) and (rows n,).
    """
    fit, width = state.fit, len(state.problem.reduction.independent)
    rubbing = slice(width, width + len(state.problem.friction))
    columns = project_rows(
        np.delete(fit.stack, rubbing, axis=1), fit.stack[:, rubbing], np.empty((len(fit.stack), 0)), 0.0
    )
    return columns, columns @ np.delete(fit.theta, rubbing)


def compared(name: str, state: State, columns: Array, fitted: Array, shared: Array) -> Apart:
    """Describe one log from what `free` says of it and the parameters that all logs share."""
    evidence, fit = state.problem.evidence, state.fit
    n = evidence.rig.n
    own = fit.residual.reshape(-1, n) / fit.scale
    apart_by = (fitted - columns @ shared).reshape(-1, n) / fit.scale
    whole = fit.target.reshape(-1, n) / fit.scale
    left, size, all_of_it = (np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-300) for x in (own, apart_by, whole))
    level = np.sqrt(np.mean(np.concatenate(evidence.torque) ** 2, axis=0))
    return Apart(name, size / all_of_it * level, size / left, size / all_of_it)


def told(rig: Rig, rows: Sequence[Apart], limit: Array) -> Fault:
    """Return the fault, described by the joint and the log where the logs are furthest apart."""
    worst = max(rows, key=lambda row: float(np.max(row.excess * row.serious(limit))))
    j = int(np.argmax(worst.excess * worst.serious(limit)))
    figures = tuple(Parameter(f"log {row.log}", float(row.torque[j]), "N m") for row in rows)
    sentence = (
        f"the logs are not of one rig: what fits each of them apart differs by {digits(worst.torque[j], 2)} N m rms at "
        f"{rig.joints[j]} in log {worst.log}, {digits(worst.excess[j], 2)} times what the fits leave"
    )
    mend = "diagnose them one at a time; 'identify' takes several payloads together: LOG@PAYLOAD"
    return Fault(NAME, rig.joints[j], sentence, figures, float(worst.excess[j]), True, mend).in_units(rig)
