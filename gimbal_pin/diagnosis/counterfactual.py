"""What a sensor shows and what that is worth: the same causes fitted to the logs as they would be without it.

The platform's motion by its IMU, and encoders off their joint's centre by the rates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.checks import Eccentricity
from gimbal_pin.diagnosis.evidence import Evidence, gather, gather_for_judgement
from gimbal_pin.diagnosis.extended import build_extended_model
from gimbal_pin.diagnosis.fit import CRITICAL_Z, compute_vuong_z
from gimbal_pin.diagnosis.gain import CONFIRMED, Figures, compare_errors, measure_errors
from gimbal_pin.diagnosis.result import MEASURED, Diagnosis, Finding
from gimbal_pin.diagnosis.state import Problem, State, solve_consistently, solved
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import LEANS, BaseMotion, Platform
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import GRAVITY, Rig

COMPENSATION = "a controller that reads the platform's IMU: see 'gimbal-pin track RIG --platform'"


class SensorContext(NamedTuple):
    """What a finding of a sensor is measured on.

    Attributes:
        found: The fit with what the sensor shows, and all that was found.
        held: The reporting part with it.
        train: The logs that were fitted.
        test: The reporting ones; none where blocks of the fitted logs stand for them.
        wholes: Name of each log → the whole of it.
        filtering: The band.
    """

    found: State
    held: Evidence
    train: Sequence[Log]
    test: Sequence[Log]
    wholes: Mapping[str, Log]
    filtering: Filtering


class _Comparison(NamedTuple):
    """A fit to logs without what a sensor shows, against the fit with it.

    Attributes:
        plain: Figures on the reporting part without it and without any cause.
        before: Figures without it.
        after: Figures with it.
        joint: The joint whose torque is missed most without it.
        z: By how many standard deviations the fit there gains (Vuong 1989).
    """

    plain: Figures
    before: Figures
    after: Figures
    joint: str
    z: float

    def describe(
        self, rig: Rig, cause: str, place: str | None, whole: Figures, figures: Sequence[Parameter], said: str
    ) -> Finding:
        """Return the finding.

        Args:
            rig: The rig.
            cause: Its name.
            place: The joint where it sits; None: in the whole rig.
            whole: Figures that the explained share is of.
            figures: What is said of it in numbers.
            said: The sentence; the gain is added.
        """
        gain = compare_errors(self.before, self.after, self.joint)
        before, after = gain["torque_rmse_before"], gain["torque_rmse_after"]
        change = 100 * (after / max(before, 1e-300) - 1)
        gained = f"held-out torque error of {self.joint} {before:.3g} → {after:.3g} N m ({change:+.0f} %) by it"
        return Finding(
            cause=cause,
            joint=place,
            parameters=tuple(figures),
            gain=gain,
            p_value=float(norm.sf(self.z)),
            explained_share=(before**2 - after**2) / max(whole["torque_rmse"][self.joint], 1e-300) ** 2,
            sentence=f"{said}; {rig.in_units(self.joint, gained)}",
        )


def add_sensor_findings(
    said: Diagnosis, context: SensorContext, encoders: Mapping[str, Mapping[str, Eccentricity]]
) -> Diagnosis:
    """Put what sensors show, and the model has, beside what was found.

    Args:
        said: The diagnosis so far.
        context: What is compared.
        encoders: Log → joint → how far its encoder, whose angles were mended, sits off the centre.
    """
    every, baseline = list(said.findings), said.baseline
    moving = _refit_without_base_motion(context)
    if moving is not None:
        every.append(moving[0])
        baseline = moving[1]
    for one in _iterate_eccentric_encoders(context, encoders):
        twin = next((k for k, f in enumerate(every) if (f.cause, f.joint) == (one.cause, one.joint)), None)
        if twin is None:
            every.append(one)
        else:  # its zero is off, too: one finding of both
            figures, both = (*every[twin].parameters, *one.parameters), f"{every[twin].sentence}; {one.sentence}"
            every[twin] = replace(every[twin], parameters=figures, sentence=both)
    return replace(said, findings=tuple(every), baseline=baseline)


def _compare(context: SensorContext, train: Sequence[Log], test: Sequence[Log], base: BaseMotion) -> _Comparison | None:
    """Fit what was found to logs without what a sensor shows, where the base moves so; None where that is no worse."""
    found, held, filtering, wholes = context.found, context.held, context.filtering, context.wholes
    known = found.problem.evidence
    rig = known.rig
    evidence = _match(gather(rig, train, filtering, wholes), known)
    problem = replace(Problem.of(evidence, reduce_parameters(rig, base=base)), luck=found.problem.luck)
    plain = solved(problem, (), solved(problem, ()))
    state = solve_consistently(solved(problem, found.causes, plain)) if found.causes else plain
    other = gather_for_judgement(rig, test, filtering, wholes) if test else gather(rig, train, filtering, wholes)
    without = _match(other, held)
    pairs = (without, state), (held, found)
    before, after = (measure_errors(rows, build_extended_model(one)) for rows, one in pairs)
    ratios = [before["torque_rmse"][joint] / max(after["torque_rmse"][joint], 1e-300) for joint in rig.joints]
    j = int(np.argmax(ratios))
    gained = _sum_squares(state, j) - _sum_squares(found, j)
    z = compute_vuong_z(gained)
    if ratios[j] < CONFIRMED or z < CRITICAL_Z:
        return None
    return _Comparison(measure_errors(without, build_extended_model(plain)), before, after, rig.joints[j], z)


def _match(evidence: Evidence, known: Evidence) -> Evidence:
    """Return the same stretches of logs, gated, timed and whitened as they are known."""
    late = np.broadcast_to(known.parts[0].late, (known.rig.n,))
    pairs = zip(evidence.parts, known.parts, strict=True)
    parts = [part._replace(gate=as_.gate, whitener=as_.whitener).retimed(late) for part, as_ in pairs]
    return replace(evidence, parts=tuple(parts))


def _sum_squares(state: State, joint: int) -> Array:
    """One joint's squared residual in units of the noise floor, summed over each block, (blocks,)."""
    rows = state.fit.residual.reshape(-1, len(state.fit.scale)) / state.fit.scale
    own = np.zeros_like(rows)
    own[:, joint] = rows[:, joint] ** 2
    return state.fit.by_block(own.reshape(-1, 1))[:, 0]


def _iterate_eccentric_encoders(
    context: SensorContext, encoders: Mapping[str, Mapping[str, Eccentricity]]
) -> Iterator[Finding]:
    """Yield the encoders whose angles were mended, each where the angles as read predict torques worse."""
    rig, base = context.held.rig, context.found.problem.reduction.base

    def read(log: Log, joint: str) -> Log:
        """Return the log with a joint's angles as its encoder read them."""
        q, j = np.array(log.q), log.joints.index(joint)
        if joint in encoders.get(log.name, {}):
            q[:, j] += encoders[log.name][joint].error(q[:, j])
        return replace(log, q=q)

    for joint in sorted({joint for one in encoders.values() for joint in one}):
        fitted, other = ([read(log, joint) for log in logs] for logs in (context.train, context.test))
        without = _compare(context, fitted, other, base)
        if without is not None:
            off = max((one[joint] for one in encoders.values() if joint in one), key=lambda one: one.size)
            figures = Parameter("eccentricity", off.size, "rad", std=off.std), Parameter("phase", off.phase, "rad")
            said = (
                f"{joint}: encoder-offset, the encoder sits off the joint's centre and reads up to "
                f"{np.degrees(off.size):.3g}° wrong once per turn, by the rates; mend its readings, or seat it anew"
            )
            yield without.describe(rig, "encoder-offset", joint, without.before, figures, said)


def _refit_without_base_motion(context: SensorContext) -> tuple[Finding, Figures] | None:
    """Refit the rig as if its base stood: the platform's motion, and figures of the refitted model without it.

    None where no IMU says that it moves, or where that is nothing.
    """
    if context.found.problem.reduction.base == "fixed":
        return None
    rig = context.held.rig
    fitted, other = (
        [replace(log, imus={link: imu for link, imu in log.imus.items() if link != rig.base}) for log in logs]
        for logs in (context.train, context.test)
    )
    without = _compare(context, fitted, other, "fixed")
    if without is None:
        return None
    logs = [log for log in context.train if rig.base in log.imus]
    moves = [Platform.measured(log.t, log.imus[rig.base], log.name) for log in logs]
    w, f = (np.concatenate([getattr(move, name) for move in moves]) for name in "wf")
    rate, force = (float(np.sqrt(np.mean(np.sum(x**2, axis=1)))) for x in (w, f - np.array([0.0, 0.0, GRAVITY])))
    felt = f" and feels {force:.3g} m/s² beside its weight" if force > LEANS else ""
    said = f"rig: platform-motion, the platform turns at {rate:.3g} rad/s{felt} (rms, by its IMU)"
    said += ", and the model has that"
    figures = Parameter("rate", rate, "rad/s"), Parameter("force", force, "m/s^2")
    return without.describe(rig, MEASURED, None, without.plain, figures, said), without.plain
