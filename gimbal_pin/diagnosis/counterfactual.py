"""What a sensor shows and what that is worth: the same causes fitted to the logs as they would be without it.

The platform's motion by its IMU, and encoders off their joint's centre by the rates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.checks import Eccentricity
from gimbal_pin.diagnosis.engine.alignment import retimed, shifts
from gimbal_pin.diagnosis.engine.criterion import vuong
from gimbal_pin.diagnosis.engine.selection import APART
from gimbal_pin.diagnosis.evidence import Evidence, gather, judged
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.gain import CONFIRMED, Figures, measured
from gimbal_pin.diagnosis.result import MEASURED, Finding
from gimbal_pin.diagnosis.state import Problem, State, consistent, solved
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import LEANS, BaseMotion, Platform
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import GRAVITY, Rig

NAME = "encoder-offset"
Encoders = Mapping[str, Mapping[str, Eccentricity]]
"""Log → joint → how far its encoder sits off the centre."""
COMPENSATION = "a controller that reads the platform's IMU: see 'gimbal-pin track RIG --platform'"


class Counterfactual(NamedTuple):
    """A fit to logs without something, against the fit with it.

    Attributes:
        plain: Figures on the reporting part without it and without any cause.
        before: Figures without it.
        after: Figures with it.
        rig: The rig.
        joint: The joint whose torque is missed most without it.
        z: By how many standard deviations the fit there gains (Vuong).
    """

    plain: Figures
    before: Figures
    after: Figures
    rig: Rig
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
        gain = self.rig.in_units(self.joint, gain)
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
        Problem.of(alike(gather(rig, train, filtering, origins), known), reduce_parameters(rig, base=base)),
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
    return Counterfactual(measured(without, extended(plain)), before, after, rig, rig.joints[j], z)


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


def off_centre(
    found: State, held: Evidence, train: Sequence[Log], test: Sequence[Log], filtering: Filtering, encoders: Encoders
) -> list[Finding]:
    """Findings of the encoders whose angles were mended, each where the angles as read predict torques worse.

    Args:
        found: The fit to the mended angles, with all that was found.
        held: The reporting part at mended angles.
        train: The logs that were fitted, mended.
        test: The reporting ones; none where blocks of the fitted logs stand for them.
        filtering: The band.
        encoders: What was mended.
    """
    findings = []
    for joint in sorted({joint for one in encoders.values() for joint in one}):
        fitted, other = ([read(log, joint, encoders) for log in logs] for logs in (train, test))
        without = counterfactual(found, held, fitted, other, filtering, found.problem.reduction.base)
        if without is not None:
            off = max((one[joint] for one in encoders.values() if joint in one), key=lambda one: one.size)
            figures = (Parameter("eccentricity", off.size, "rad", std=off.std), Parameter("phase", off.phase, "rad"))
            said = f"{joint}: encoder-offset, the encoder sits off the joint's centre and reads up to "
            said += f"{np.degrees(off.size):.3g}° wrong once per turn, by the rates; mend its readings, or seat it anew"
            findings.append(without.finding(NAME, joint, without.before, figures, said))
    return findings


def read(log: Log, joint: str, encoders: Encoders) -> Log:
    """Return the log with a joint's angles as its encoder read them."""
    one = encoders.get(log.name, {}).get(joint)
    if one is None:
        return log
    q, j = np.array(log.q), log.joints.index(joint)
    q[:, j] += one.error(q[:, j])
    return replace(log, q=q)


def joined(findings: Sequence[Finding], more: Sequence[Finding]) -> list[Finding]:
    """Put eccentric encoders beside what was found: one whose zero is off, too, is one finding of both."""
    out = list(findings)
    for one in more:
        twin = next((f for f in out if (f.cause, f.joint) == (one.cause, one.joint)), None)
        if twin is None:
            out.append(one)
        else:
            figures, said = (*twin.parameters, *one.parameters), f"{twin.sentence}; {one.sentence}"
            out[out.index(twin)] = replace(twin, parameters=figures, sentence=said)
    return out


class Ridden(NamedTuple):
    """The platform's motion as a finding.

    Attributes:
        finding: It.
        baseline: Held-out figures of the refitted model whose base stands.
    """

    finding: Finding
    baseline: Figures


def ridden(
    found: State, held: Evidence, train: Sequence[Log], test: Sequence[Log], filtering: Filtering
) -> Ridden | None:
    """Refit the rig as if its base stood, and compare; None where no IMU says that it moves, or where that is nothing.

    Args:
        found: The refitted model on the base's measured motion with what was found, beside which it is compared.
        held: The reporting part, with that motion.
        train: The logs that were fitted.
        test: The reporting ones; none where blocks of the fitted logs stand for them.
        filtering: The band.
    """
    if found.problem.reduction.base == "fixed":
        return None
    rig = found.problem.evidence.rig
    fitted, other = (
        [replace(log, imus={link: imu for link, imu in log.imus.items() if link != rig.base}) for log in logs]
        for logs in (train, test)
    )
    without = counterfactual(found, held, fitted, other, filtering, "fixed")
    if without is None:
        return None
    rate, force = motion(rig, train)
    felt = f" and feels {force:.3g} m/s² beside its weight" if force > LEANS else ""
    said = f"rig: platform-motion, the platform turns at {rate:.3g} rad/s{felt} (rms, by its IMU)"
    figures = (Parameter("rate", rate, "rad/s"), Parameter("force", force, "m/s^2"))
    finding = without.finding(MEASURED, None, without.plain, figures, f"{said}, and the model has that")
    return Ridden(finding, without.plain)


def motion(rig: Rig, logs: Sequence[Log]) -> tuple[float, float]:
    """Root mean square of the base's rate, rad/s, and of its specific force off what an upright base feels, m/s²."""
    moves = [Platform.measured(log.t, log.imus[rig.base], log.name) for log in logs if rig.base in log.imus]
    w, f = (np.concatenate([getattr(move, name) for move in moves]) for name in ("w", "f"))
    off = f - np.array([0.0, 0.0, GRAVITY])
    rate, force = (float(np.sqrt(np.mean(np.sum(x**2, axis=1)))) for x in (w, off))
    return rate, force
