"""What sensors of their own tell, and what it is worth: the same causes fitted to the logs as they would be without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.diagnosis.engine.alignment import retimed, shifts
from gimbal_pin.diagnosis.engine.criterion import vuong
from gimbal_pin.diagnosis.engine.rivals import APART
from gimbal_pin.diagnosis.evidence import Evidence, gather, judged
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.finding import Finding
from gimbal_pin.diagnosis.heldout import CONFIRMED, Figures, measured
from gimbal_pin.diagnosis.state import Problem, State, consistent, solved
from gimbal_pin.dynamics.reduction import reduce
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.estimation.rows import Filtering
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import BaseMotion


class Counterfactual(NamedTuple):
    """A fit to logs without something, against the fit with it.

    Attributes:
        plain: Figures on the reporting part without it and without any cause.
        before: Figures without it.
        after: Figures with it.
        joint: The joint whose torque is missed most without it.
        z: By how many standard deviations the fit there gains (Vuong).
    """

    plain: Figures
    before: Figures
    after: Figures
    joint: str
    z: float

    def finding(
        self, cause: str, joint: str | None, whole: Figures, parameters: tuple[Parameter, ...], said: str
    ) -> Finding:
        """Describe it.

        Args:
            cause: Its name.
            joint: Where it sits; None: in the whole rig.
            whole: Figures that the explained share is of.
            parameters: What is told of it.
            said: The sentence; the gain is added.
        """
        torque, rolled = (
            [one[name][self.joint] for one in (self.before, self.after)] for name in ("torque_rmse", "rollout_rmse")
        )
        change = 100 * (torque[1] / max(torque[0], 1e-300) - 1)
        gain = f"held-out torque error of {self.joint} {torque[0]:.3g} → {torque[1]:.3g} N m ({change:+.0f} %) by it"
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
            p_value=float(norm.sf(self.z)),
            selection_frequency=1.0,
            explained_share=(torque[0] ** 2 - torque[1] ** 2) / max(whole["torque_rmse"][self.joint], 1e-300) ** 2,
            visible_fraction=1.0,
            rivals=(),
            sentence=f"{said}; {gain}",
            next_experiment=None,
        )


def counterfactual(
    found: State, held: Evidence, train: Sequence[Log], test: Sequence[Log], filtering: Filtering, base: BaseMotion
) -> Counterfactual | None:
    """Fit the causes of a state to logs without something; None where that is no worse.

    Args:
        found: The fit with it.
        held: The reporting part with it.
        train: The fitted logs without it.
        test: The reporting ones without it; none where blocks of the fitted logs stand for them.
        filtering: The band.
        base: How the base moves without it.
    """
    rig, known = found.problem.evidence.rig, found.problem.evidence
    origins = {log.name: float(log.t[0]) for log in (*test, *train)}  # a log began where its first part did
    problem = replace(
        Problem.of(alike(gather(rig, train, filtering, origins), known), reduce(rig, base=base)),
        luck=found.problem.luck,
    )
    plain = solved(problem, (), solved(problem, ()))
    state = consistent(solved(problem, found.causes, plain)) if found.causes else plain
    other = judged(rig, test, filtering, origins) if test else gather(rig, train, filtering, origins)
    without = alike(other, held)
    before, after = measured(without, extended(state)), measured(held, extended(found))
    ratios = [before["torque_rmse"][joint] / max(after["torque_rmse"][joint], 1e-300) for joint in rig.joints]
    j = int(np.argmax(ratios))
    z = vuong(squares(state, j) - squares(found, j))
    if ratios[j] < CONFIRMED or z < APART:
        return None
    return Counterfactual(measured(without, extended(plain)), before, after, rig.joints[j], z)


def alike(evidence: Evidence, known: Evidence) -> Evidence:
    """Return the same stretches of logs, gated, timed and whitened as they are known."""
    pairs = zip(evidence.parts, known.parts, strict=True)
    parts = [part._replace(gate=as_.gate, whitener=as_.whitener) for part, as_ in pairs]
    return retimed(replace(evidence, parts=tuple(parts)), shifts(known))


def squares(state: State, joint: int) -> Array:
    """One joint's squared residual in units of the noise floor, summed over each block, (blocks,)."""
    rows = state.fit.residual.reshape(-1, len(state.fit.scale)) / state.fit.scale
    own = np.zeros_like(rows)
    own[:, joint] = rows[:, joint] ** 2
    return state.fit.by_block(own.reshape(-1, 1))[:, 0]
