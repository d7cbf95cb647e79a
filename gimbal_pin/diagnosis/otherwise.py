"""The same causes, fitted to the logs as they would be without something that was taken into account."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.diagnosis.engine.alignment import retimed, shifts
from gimbal_pin.diagnosis.evidence import Evidence, gather, judged
from gimbal_pin.diagnosis.finding import Finding
from gimbal_pin.diagnosis.heldout import Figures
from gimbal_pin.diagnosis.state import Problem, State, consistent, solved
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.platform import BaseMotion
from gimbal_pin.reduction import reduce
from gimbal_pin.rows import Filtering


class Otherwise(NamedTuple):
    """What the fit would have been.

    Attributes:
        plain: Without any cause.
        state: With the causes that were found.
        held: The held-out part.
    """

    plain: State
    state: State
    held: Evidence


def otherwise(
    found: State, held: Evidence, train: Sequence[Log], test: Sequence[Log], filtering: Filtering, base: BaseMotion
) -> Otherwise:
    """Fit the causes of a state to other logs; without held-out ones these stand for them too."""
    rig = found.problem.evidence.rig
    origins = {log.name: float(log.t[0]) for log in (*test, *train)}  # a log began where its first part did
    evidence = alike(gather(rig, train, filtering, origins), found.problem.evidence)
    problem = replace(Problem.of(evidence, reduce(rig, base=base)), luck=found.problem.luck)
    plain = solved(problem, (), solved(problem, ()))
    state = consistent(solved(problem, found.causes, plain)) if found.causes else plain
    other = judged(rig, test, filtering, origins) if test else gather(rig, train, filtering, origins)
    held = alike(other, held)
    return Otherwise(plain, state, held)


def alike(evidence: Evidence, known: Evidence) -> Evidence:
    """Return the same stretches of logs, gated, timed and whitened as they are known."""
    pairs = zip(evidence.parts, known.parts, strict=True)
    parts = [part._replace(gate=as_.gate, whitener=as_.whitener, trust=as_.trust) for part, as_ in pairs]
    return retimed(replace(evidence, parts=tuple(parts)), shifts(known))


def clarity(before: State, after: State, joint: int) -> float:
    """Fall of one joint's sum of squares over its scatter by blocks, in standard deviations."""
    falls = squares(before, joint) - squares(after, joint)
    return float(np.sum(falls) / max(float(np.std(falls) * np.sqrt(len(falls))), 1e-300))


def squares(state: State, joint: int) -> Array:
    """One joint's squared residual in units of the noise floor, summed over each block, (blocks,)."""
    rows = state.fit.residual.reshape(-1, len(state.fit.scale)) / state.fit.scale
    own = np.zeros_like(rows)
    own[:, joint] = rows[:, joint] ** 2
    return state.fit.by_block(own.reshape(-1, 1))[:, 0]


def known(
    cause: str,
    joint: str | None,
    worst: str,
    figures: tuple[Figures, Figures],
    whole: float,
    clear: float,
    parameters: tuple[Parameter, ...],
    said: str,
) -> Finding:
    """Describe what sensors of its own tell, and what it is worth to take it into account.

    Args:
        cause: Its name.
        joint: Where it sits; None: in the whole rig.
        worst: The joint whose torque is missed most without it.
        figures: Held-out figures without it and with it.
        whole: Torque error of `worst` that the explained share is of, N m rms.
        clear: By how many standard deviations the fit gains, see `clarity`.
        parameters: What is told of it.
        said: The sentence; the gain is added.
    """
    torque, rolled = ([one[name][worst] for one in figures] for name in ("torque_rmse", "rollout_rmse"))
    change = 100 * (torque[1] / max(torque[0], 1e-300) - 1)
    return Finding(
        cause=cause,
        joint=joint,
        status="named",
        alike=(cause,),
        parameters=parameters,
        gain={
            "torque_rmse_before": torque[0],
            "torque_rmse_after": torque[1],
            "rollout_rmse_before": rolled[0],
            "rollout_rmse_after": rolled[1],
        },
        p_value=float(norm.sf(clear)),
        selection_frequency=1.0,
        explained_share=(torque[0] ** 2 - torque[1] ** 2) / max(whole, 1e-300) ** 2,
        visible_fraction=1.0,
        rivals=(),
        sentence=f"{said}; "
        f"held-out torque error of {worst} {torque[0]:.3g} → {torque[1]:.3g} N m ({change:+.0f} %) by it",
        next_experiment=None,
    )
