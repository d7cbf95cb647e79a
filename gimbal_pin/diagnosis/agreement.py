"""Do several logs speak of one rig? Each log's own base parameters against those that all share.

Logs of different cameras, or of a rig that somebody has touched in between, fit one model badly and some cause's name
well: this comes before any name.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Sequence

import numpy as np

from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.state import Problem, State, solve_causes
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import DataError, digits
from gimbal_pin.identification import MATERIAL_SHARE
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering, project_rows
from gimbal_pin.rig.rig import Rig

_EXCESS = 2.0
"""Torque that a log's own parameters move, over what its own fit leaves, from which it is of another rig: less could be
a misfit that the logs' motions bring out differently."""
_EXPLAINED_EXCESS = 0.5
"""The same where logs differed before any cause was found: causes must explain it, not only make it smaller."""


def find_disagreement(
    rig: Rig, logs: Sequence[Log], filtering: Filtering, causes: Sequence[Cause]
) -> Fault | None:
    """Compare the logs' parameters: each on its own is as good as its sensors, together they are not.

    Args:
        rig: The rig.
        logs: Its logs, held-out ones among them; those that are long enough for a fit of their own are compared.
        filtering: The band.
        causes: What has been found, which is put in every fit.

    Returns:
        The fault; None: the logs agree, or cannot tell.
    """
    reduction = reduce_parameters(rig)
    states = dict[str, State]()
    for number, log in enumerate(logs if len(logs) > 1 else ()):
        with contextlib.suppress(DataError):
            evidence = gather(rig, [log], filtering)
            states[f"{number + 1}: {log.name}"] = solve_causes(Problem.of(evidence, reduction), ())
    if len(states) < 2:
        return None
    excess, share, _ = _compare_logs(states.values())
    limit = np.where(
        np.any((excess > _EXCESS) & (share > MATERIAL_SHARE), axis=0), _EXPLAINED_EXCESS, _EXCESS
    )
    excess, share, torque = _compare_logs(
        [solve_causes(one.problem, causes, one) for one in states.values()]
    )
    excess = np.where((excess > limit) & (share > MATERIAL_SHARE), excess, 0.0)
    k, j = (int(x) for x in np.unravel_index(np.argmax(excess), excess.shape))
    if not excess[k, j] > 0:
        return None
    figures = tuple(
        Parameter(f"log {name}", float(moved), "N m") for name, moved in zip(states, torque[:, j])
    )
    sentence = (
        f"the logs are not of one rig: what fits each of them apart differs by {digits(torque[k, j], 2)} N m rms at "
        f"{rig.joints[j]} in log {[*states][k]}, {digits(excess[k, j], 2)} times what the fits leave"
    )
    mend = "diagnose them one at a time; 'identify' takes several payloads together: LOG@PAYLOAD"
    return Fault(
        "logs-disagree", rig.joints[j], sentence, figures, float(excess[k, j]), True, mend
    ).in_units(rig)


def _compare_logs(states: Collection[State]) -> tuple[Array, Array, Array]:
    """Compare each log's parameters with those that all share, ``(Σ H_i)⁻¹ Σ H_i β_i``.

    H_i is the information that a log has of the base parameters and of what the causes add, which one rig has the same
    in every log; friction, which changes with temperature, is left open.

    Returns:
        Torque that the difference moves on each log, friction refitted, whitened, rms: over what the log's own fit
        leaves, over all of the log's torque, and that share of its rms, N m, (L, n) each.
    """
    columns = []
    fitted = []
    for state in states:
        fit = state.fit
        width = len(state.problem.reduction.independent)
        rubbing = slice(width, width + len(state.problem.friction))
        columns.append(project_rows(np.delete(fit.stack, rubbing, axis=1), fit.stack[:, rubbing]))
        fitted.append(columns[-1] @ np.delete(fit.theta, rubbing))
    common = np.linalg.lstsq(np.vstack(columns), np.concatenate(fitted), rcond=1e-10)[0]
    rows = []
    for state, X, y in zip(states, columns, fitted):
        fit = state.fit
        n = len(state.fit.scale)
        powers = (
            np.mean((x.reshape(-1, n) / fit.scale) ** 2, axis=0)
            for x in (y - X @ common, fit.residual, fit.target)
        )
        moved, left, whole = (np.maximum(np.sqrt(power), 1e-300) for power in powers)
        level = np.sqrt(np.mean(np.concatenate(state.problem.evidence.torque) ** 2, axis=0))
        rows.append((moved / left, moved / whole, moved / whole * level))
    excess, share, torque = np.array(rows).swapaxes(0, 1)
    return excess, share, torque
