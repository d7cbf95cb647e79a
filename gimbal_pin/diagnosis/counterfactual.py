"""The platform's motion by its IMU, and its worth: the same causes fitted to the logs without that IMU."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.checks import CheckedLog
from gimbal_pin.diagnosis.engine.criterion import compare_models, fitted
from gimbal_pin.diagnosis.evidence import Evidence, gather, gather_for_judgement
from gimbal_pin.diagnosis.extended import build_extended_model
from gimbal_pin.diagnosis.fit import CRITICAL_Z
from gimbal_pin.diagnosis.gain import CONFIRMED, Figures, compare_errors, measure_errors
from gimbal_pin.diagnosis.result import MEASURED_CAUSE, Diagnosis, Finding
from gimbal_pin.diagnosis.state import Problem, solve_causes
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Log
from gimbal_pin.log.platform import LEANS, Platform
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import GRAVITY

COMPENSATION = "a controller that reads the platform's IMU: see 'gimbal-pin track RIG --platform'"


class _Shown(NamedTuple):
    """What a sensor shows.

    Attributes:
        cause: Its name.
        joint: Where it sits; None: in the whole rig.
        figures: What is said of it in numbers.
        sentence: The same in words.
        strip: A log → the same without it.
    """

    cause: str
    joint: str | None
    figures: tuple[Parameter, ...]
    sentence: str
    strip: Callable[[Log], Log]


def add_sensor_findings(
    said: Diagnosis,
    checked: Sequence[CheckedLog],
    train: Sequence[Log],
    test: Sequence[Log],
    filtering: Filtering,
) -> Diagnosis:
    """Put what sensors show, and the model has, beside what was found, where the fit without it is worse.

    Args:
        said: The diagnosis so far.
        checked: Every log.
        train: The logs that were fitted.
        test: The reporting ones; none where blocks of the fitted logs stand for them.
        filtering: The band.
    """
    every = {(one.cause, one.joint): one for one in said.findings}
    baseline = said.baseline
    wholes = {one.log.name: one.log for one in checked}
    for shown in _list_platform_motion(said, train):
        if (weighed := _weigh(said, shown, train, test, wholes, filtering)) is None:
            continue
        one, without = weighed
        baseline = without
        every[one.cause, one.joint] = one
    return replace(said, findings=tuple(every.values()), baseline=baseline)


def _list_platform_motion(said: Diagnosis, logs: Sequence[Log]) -> list[_Shown]:
    """Return a platform's motion where its IMU shows any: without it the rig is fitted as if its base stood."""
    assert said.state is not None
    rig = said.state.problem.evidence.rig
    reduction = said.state.problem.reduction
    if reduction.base == "fixed":
        return []
    moves = [
        Platform.measured(log.t, log.imus[rig.base], log.name)
        for log in logs
        if rig.base in log.imus
    ]
    w, f = (np.concatenate([getattr(move, name) for move in moves]) for name in "wf")
    rate, force = (
        float(np.sqrt(np.mean(np.sum(x**2, axis=1))))
        for x in (w, f - np.array([0.0, 0.0, GRAVITY]))
    )
    felt = f" and feels {force:.3g} m/s² beside its weight" if force > LEANS else ""
    sentence = (
        f"rig: platform-motion, the platform turns at {rate:.3g} rad/s{felt} (rms, by its IMU)"
    )
    sentence += ", and the model has that"

    def strip(log: Log) -> Log:
        """Take out the platform's IMU."""
        return replace(log, imus={link: imu for link, imu in log.imus.items() if link != rig.base})

    return [
        _Shown(
            MEASURED_CAUSE,
            None,
            (Parameter("rate", rate, "rad/s"), Parameter("force", force, "m/s^2")),
            sentence,
            strip,
        )
    ]


def _weigh(
    said: Diagnosis,
    shown: _Shown,
    train: Sequence[Log],
    test: Sequence[Log],
    wholes: Mapping[str, Log],
    filtering: Filtering,
) -> tuple[Finding, Figures] | None:
    """Fit what was found to logs without what a sensor shows; None where that is no worse.

    Returns:
        The finding, and the figures of the model without it and without any cause.
    """
    found = said.state
    held = said.held
    assert found is not None and held is not None
    train, test = ([shown.strip(log) for log in logs] for logs in (train, test))
    rig = held.rig
    base = "fixed" if shown.cause == MEASURED_CAUSE else found.problem.reduction.base
    evidence = gather(rig, train, filtering, wholes)
    other = gather_for_judgement(rig, test, filtering, wholes) if test else evidence
    evidence = _match(evidence, found.problem.evidence)
    without = _match(other, held)
    problem = replace(
        Problem.of(evidence, reduce_parameters(rig, base=base)), luck=found.problem.luck
    )
    plain = solve_causes(problem, ())
    state = fitted(problem, found.causes, plain)
    pairs = (without, plain), (without, state), (held, found)
    nothing, before, after = (
        measure_errors(rows, build_extended_model(one)) for rows, one in pairs
    )
    error = before["torque_rmse"]
    least = after["torque_rmse"]
    joint = max(rig.joints, key=lambda joint: error[joint] / max(least[joint], 1e-300))
    delta, std = compare_models(found, state)
    z = delta / max(std, 1e-12)
    if error[joint] < CONFIRMED * least[joint] or z < CRITICAL_Z:
        return None
    change = 100 * (least[joint] / max(error[joint], 1e-300) - 1)
    gained = f"held-out torque error of {joint} {error[joint]:.3g} → {least[joint]:.3g} N m ({change:+.0f} %) by it"
    finding = Finding(
        cause=shown.cause,
        joint=shown.joint,
        parameters=shown.figures,
        gain=compare_errors(before, after, joint),
        false_alarm=float(norm.sf(z)),
        sentence=f"{shown.sentence}; {rig.in_units(joint, gained)}",
    )
    return finding, nothing


def _match(evidence: Evidence, known: Evidence) -> Evidence:
    """Return the same stretches of logs, gated, timed and whitened as they are known."""
    late = np.broadcast_to(known.parts[0].late, (known.rig.n,))
    pairs = zip(evidence.parts, known.parts, strict=True)
    parts = [
        part._replace(gate=as_.gate, whitener=as_.whitener).retimed(late) for part, as_ in pairs
    ]
    return replace(evidence, parts=tuple(parts))
