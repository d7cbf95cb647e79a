"""Do several logs speak of one rig? Each log's own base parameters against those that all share.

Logs of different cameras, or of a rig that somebody has touched in between, fit one model badly and some cause's name
well: this comes before any name.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.dynamics.model import build_friction_effects
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import DataError, digits
from gimbal_pin.identification import MATERIAL_SHARE, assess_agreement, greatest_base_motion
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Design, Filtering, project_rows
from gimbal_pin.rig.rig import Rig

_EXCESS = 2.0
"""The same over what each log's own fit leaves: less could be a misfit that the logs' motions bring out differently."""
_EXPLAINED_EXCESS = 0.5
"""The same where logs differed before any cause was found: causes must explain it, not only make it smaller."""
_SOUND_DISPERSION = 4.0
"""Dispersion under which nothing that could set a log apart is left of it."""


class LogDisagreement(NamedTuple):
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

    def compute_material_excess(self, limit: Array | float) -> Array:
        """Its excess at joints where that is beyond a limit and matters, (n,); zero elsewhere."""
        return np.where((self.excess > limit) & (self.share > MATERIAL_SHARE), self.excess, 0.0)


def fit_each_log(rig: Rig, logs: Sequence[Log], filtering: Filtering) -> dict[str, State]:
    """Fit the rigid model to every log that is long enough for it, by number and name; held-out ones are among them."""
    reduction, states = reduce_parameters(rig), dict[str, State]()
    for k, log in enumerate(logs if len(logs) > 1 else ()):
        with contextlib.suppress(DataError):
            evidence = gather(rig, [log], filtering)
            states[f"{k + 1}: {log.name}"] = solved(Problem.of(evidence, reduction), ())
    return states


def add_reason(fault: Fault, rig: Rig, logs: Sequence[Log]) -> Fault:
    """Return the fault of logs that disagree with the likeliest reason, see `assess_agreement`."""
    reduction = reduce_parameters(rig, base=greatest_base_motion(rig, logs))
    found = assess_agreement(Design(rig, reduction, build_friction_effects(rig.joints), tuple(logs), Filtering()))
    return fault if found is None or found.reason is None else replace(fault, sentence=f"{fault.sentence}; {found.why}")


def test_log_consistency(rig: Rig, states: Mapping[str, State], causes: Sequence[Cause] | None = None) -> Fault | None:
    """Compare the logs' parameters: each on its own is as good as its sensors, together they are not.

    Args:
        rig: The rig.
        states: Fits of the rigid model to each log.
        causes: What has been found, which is put in every fit; None: nothing was looked for yet. Then a joint at which
            something is left of a log on its own is not judged, as that may be what sets the log apart.

    Returns:
        The fault, or None: the logs agree, or there is only one that is long enough to tell.
    """
    if len(states) < 2:
        return None
    rows = _compare_logs(states)
    if causes is None:
        is_sound = np.all([state.fit.dispersion < _SOUND_DISPERSION for state in states.values()], axis=0)
        limit = np.where(is_sound, _EXCESS, np.inf)
    else:
        differed = np.any([row.compute_material_excess(_EXCESS) > 0 for row in rows], axis=0)
        limit = np.where(differed, _EXPLAINED_EXCESS, _EXCESS)
        rows = _compare_logs({name: solved(state.problem, causes, state) for name, state in states.items()})
    worst = max(rows, key=lambda row: float(np.max(row.compute_material_excess(limit))))
    excess = worst.compute_material_excess(limit)
    j = int(np.argmax(excess))
    if not excess[j] > 0:
        return None
    figures = tuple(Parameter(f"log {row.log}", float(row.torque[j]), "N m") for row in rows)
    sentence = (
        f"the logs are not of one rig: what fits each of them apart differs by {digits(worst.torque[j], 2)} N m rms at "
        f"{rig.joints[j]} in log {worst.log}, {digits(worst.excess[j], 2)} times what the fits leave"
    )
    mend = "diagnose them one at a time; 'identify' takes several payloads together: LOG@PAYLOAD"
    return Fault("logs-disagree", rig.joints[j], sentence, figures, float(excess[j]), True, mend).in_units(rig)


def _compare_logs(states: Mapping[str, State]) -> list[LogDisagreement]:
    """Compare each log's parameters with those that all share, ``(Σ H_i)⁻¹ Σ H_i β_i``.

    H_i is the information that a log has of the base parameters and of what the causes add, which one rig has the same
    in every log; friction, which changes with temperature, is left open.
    """
    columns, fitted = [], []
    for state in states.values():
        fit, width = state.fit, len(state.problem.reduction.independent)
        rubbing = slice(width, width + len(state.problem.friction))
        shared = np.delete(fit.stack, rubbing, axis=1)
        columns.append(project_rows(shared, fit.stack[:, rubbing]))
        fitted.append(columns[-1] @ np.delete(fit.theta, rubbing))
    common = np.linalg.lstsq(np.vstack(columns), np.concatenate(fitted), rcond=1e-10)[0]
    rows = []
    for (name, state), X, y in zip(states.items(), columns, fitted):
        evidence, fit = state.problem.evidence, state.fit
        whitened = (x.reshape(-1, evidence.rig.n) / fit.scale for x in (fit.residual, y - X @ common, fit.target))
        left, size, whole = (np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-300) for x in whitened)
        level = np.sqrt(np.mean(np.concatenate(evidence.torque) ** 2, axis=0))
        rows.append(LogDisagreement(name, size / whole * level, size / left, size / whole))
    return rows
