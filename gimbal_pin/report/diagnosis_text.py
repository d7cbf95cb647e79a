"""Sentences about a diagnosis, the same in JSON, in the terminal, on a page and in a summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite, isnan
from typing import TYPE_CHECKING, Any

from gimbal_pin.diagnosis.result import MEASURED_CAUSE
from gimbal_pin.dynamics.model import is_inertia_positive
from gimbal_pin.effects import CAUSES
from gimbal_pin.errors import NORMAL_95
from gimbal_pin.report.format import DASH, figures, interval, listed, nats, to_sentence, torque_unit

if TYPE_CHECKING:
    from gimbal_pin.checks import Fault
    from gimbal_pin.diagnosis import Diagnosis, Finding, Rival
    from gimbal_pin.effects.parameter import Parameter

NOTHING_FOUND = "No error was found in the refitted model beyond the limits below."
UNUSABLE_MODEL = (
    "The extended model cannot move: the log does not determine its inertias, and some are not positive. "
    "Record faster motion before you simulate or tune with it."
)
"""Remark on a model whose mass matrix is not positive."""
PLATFORM_COUNTS = "The platform's motion is taken from its IMU; its gain stands below."
PLATFORM_COMPENSATION = (
    "a controller that reads the platform's IMU: see 'gimbal-pin track RIG --platform'"
)
MOST_RIVALS = 3
"""Most rivals in a sentence."""
VARIABLES = {
    "places": "angle, in places",
    "places by direction": "angle and direction, in places",
    "ringing": "a resonance below 4 Hz",
    "fine load": "load, in places",
    "lines in time": "time, at fixed frequencies",
    "lines times load": "load and time, at fixed frequencies",
    "lines over load": "load, periodically",
}
"""Group of functions of a flexible model → its variables, where the group's name does not say them."""


def report_diagnosis(found: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as JSON holds it, with a sentence and what to do next for each finding."""
    told = found.to_dict()
    physical = told["findings"][len(found.spoiling) :]
    for row, finding in zip(physical, found.findings):
        row["sentence"] = describe_finding(found, finding)
        row["next_experiment"] = get_experiment(finding)
    return told


# -- verdict -----------------------------------------------------------------------------------------------------------


def state_verdict(found: Diagnosis) -> str:
    """Return the verdict; it never states less than what is left."""
    if found.verdict == "data":
        causes = listed(dict.fromkeys(one.cause for one in list_deciding_faults(found)))
        said = f"The log itself is at fault ({causes})"
        if found.spoiling:
            return f"{said}: nothing that it seems to say about the rig should be believed."
        return f"{said}: it hides what the model may lack."
    left = listed(found.unexplained) if found.unexplained else ""
    if found.lacking:
        lacks = f"The model lacks {listed(map(name_finding, found.lacking))}"
        return f"{lacks}; torque is left unexplained at {left}." if left else f"{lacks}."
    if left:
        return f"The model leaves torque unexplained at {left}, and no cause was accepted."
    if len(found.findings) > len(found.stated):
        return "No cause was accepted: what was selected explains too little of the error."
    if found.statements:
        return "The logs differ from the URDF by a scale."
    return NOTHING_FOUND


def list_deciding_faults(found: Diagnosis) -> tuple[Fault, ...]:
    """Return the faults for which the verdict is on the logs; none where it is on the model."""
    if found.verdict != "data":
        return ()
    return found.spoiling or tuple(fault for fault in found.faults if not fault.slight)


def list_remarks(found: Diagnosis) -> list[str]:
    """Return what is to be known beside the verdict, in sentences."""
    remarks = [f"Verdict: {found.verdict}.", *map(to_sentence, found.statements)]
    after = found.after
    if found.held_out is not None and not is_inertia_positive(after.rig, rotors=after.armature):
        remarks.append(UNUSABLE_MODEL)
    return [*remarks, PLATFORM_COUNTS] if found.lacking != found.stated else remarks


def name_finding(finding: Finding) -> str:
    """Return ``cogging at yaw``; ``cogging or cable-spring at yaw`` where the log cannot tell."""
    return f"{_name_causes(finding)} at {finding.joint or 'the rig as a whole'}"


def _name_causes(finding: Finding) -> str:
    """Return the causes that a finding may be."""
    *others, last = finding.alike if finding.status == "ambiguous" else (finding.cause,)
    return f"{', '.join(others)} or {last}" if others else last


def head_finding(finding: Finding) -> str:
    """Return ``yaw: cogging`` or ``yaw: cogging or cable-spring``."""
    return f"{finding.joint or 'rig'}: {_name_causes(finding)}"


# -- findings ----------------------------------------------------------------------------------------------------------


def describe_finding(found: Diagnosis, finding: Finding) -> str:
    """Return a finding in one line: cause, place, size and gain."""
    if not finding.is_stated:
        said = "not stated as the cause, not in the model"
        return f"{describe_unconfirmed(finding)}: {said}"
    sizes = state_sizes(finding.parameters)
    head = f"{head_finding(finding)}, {sizes}" if sizes else head_finding(finding)
    return f"{head}; {state_gain(found, finding)}"


def describe_unconfirmed(finding: Finding) -> str:
    """Say what a selected cause gains that is not stated as the cause."""
    gain = " ".join(nats(finding.nats, finding.std))
    share = f"{figures(100 * finding.share, 2)} %"
    head = head_finding(finding)
    return f"{head}, selected with a gain of {gain} nats, but it explains {share} of the predictable error"


def state_gain(found: Diagnosis, finding: Finding) -> str:
    """Say by how much a finding lowers the torque error of its joint, which is of the folds that chose it.

    The table of the held-out errors is of rows that chose nothing, where there are such.
    """
    before = finding.before
    after = finding.after
    scale, unit = torque_unit(max(before, after), get_force(found, finding.at))
    change = 100 * (after / before - 1) if before > 0 else 0.0
    sign = "+" if change > 0 else ""
    where = "" if finding.at == finding.joint else f" at {finding.at}"
    errors = f"{figures(scale * before, 2)} → {figures(scale * after, 2)} {unit}"
    return f"cross-validated torque error{where} {errors} ({sign}{figures(change, 2)} %)"


def state_size(figure: Parameter) -> str:
    """Return a figure with its 95 % interval; a bound where it is not known."""
    said = figure.describe()
    if isfinite(figure.std) and figure.is_known:
        value = " ".join(interval(figure.value, NORMAL_95 * figure.std))
        said = f"{figure.name} {value}{figure.in_units}"
    return said.replace("^2", "²").replace("^3", "³")


def state_sizes(parameters: Sequence[Parameter]) -> str:
    """Return figures with their intervals; of several harmonics the amplitude at each, the strongest first."""
    if not any(figure.name == "harmonic_2" for figure in parameters):
        return ", ".join(map(state_size, parameters))
    name = parameters[0].name
    each = [
        f"{state_size(replace(size, name=name)).removeprefix(f'{name} ')} at {order.value:g}"
        for size, order in zip(parameters[::3], parameters[1::3])
    ]
    return f"{name} {', '.join(each)} per turn"


def list_alternatives(finding: Finding) -> list[str]:
    """Say what a finding may be instead, and by how much the nearest other cause predicts worse."""
    worse = {rival.cause: rival for rival in finding.rivals}
    lines = list[str]()
    if finding.status == "ambiguous":
        alike = [
            f"{name} (worse by {_state_nats(worse[name])} as fitted)" if name in worse else name
            for name in finding.alike[1:]
        ]
        lines.append(f"This log cannot tell it from {listed(alike)}.")
    others = [one for one in finding.rivals if one.cause not in finding.alike][:MOST_RIVALS]
    if others:
        names = listed(f"{one.cause} by {_state_nats(one)}" for one in others)
        lines.append(f"Worse in its place: {names}.")
    return lines


def _state_nats(rival: Rival) -> str:
    """Return by how much a rival predicts worse, ± 95 %."""
    return f"{' '.join(nats(max(rival.nats, 0.0), rival.std))} nats"


def get_experiment(finding: Finding) -> str | None:
    """Return the experiment that tells a finding from what it may be instead; None: it is not ambiguous."""
    cause = CAUSES.get(finding.cause)
    return cause.experiment if finding.status == "ambiguous" and cause is not None else None


def get_compensation(finding: Finding) -> str:
    """Return what a controller or a mechanic does against a finding."""
    if finding.cause == MEASURED_CAUSE:
        return PLATFORM_COMPENSATION
    return CAUSES[finding.cause].compensation


def advise(finding: Finding) -> str:
    """Say what to do next about a finding that is stated."""
    experiment = get_experiment(finding)
    if experiment is not None:
        return f"To tell them apart: {experiment}."
    return f"What to do about it: {get_compensation(finding)}."


# -- what is left ------------------------------------------------------------------------------------------------------


def describe_rest(found: Diagnosis, joint: str) -> str:
    """Say how much torque is left at a joint, and what of it depends on what."""
    assert found.held_out is not None
    rest = found.residual[joint]
    left = f"{joint}: {state_torque(found, joint, rest.left)} is left"
    if rest.predictable == 0:
        return f"{left}; no function of motion and load predicts it."
    predictable = state_torque(found, joint, rest.predictable)
    return f"{left}; of it {predictable} depends on {name_variables(rest.over)}."


def name_variables(over: str) -> str:
    """Return the variables of a group of functions."""
    return VARIABLES.get(over, over)


def list_rest(found: Diagnosis) -> list[str]:
    """Say of each joint at which torque is left unexplained how much that is; else what would have been found."""
    if found.unexplained:
        return [*(describe_rest(found, joint) for joint in found.unexplained), *list_worse(found)]
    if found.verdict != "nothing":
        return []
    return [
        f"{joint}: a cause of {state_torque(found, joint, limit)} or more."
        for joint, limit in found.detection_limit.items()
    ]


def list_worse(found: Diagnosis) -> list[str]:
    """Say at which joints a simpler model predicts better than the extended one."""
    lines = list[str]()
    for joint, best in found.deteriorations.items():
        assert found.held_out is not None
        stages = found.held_out.stages
        errors = (state_share(100 - stages[name].fit_percent[joint]) for name in (best, "extended"))
        better, worse = errors
        who = "the URDF" if best == "URDF" else f"the {best} model"
        lines.append(
            f"{joint}: {who} predicts better than the extended model, "
            f"with an error of {better} of the torque against {worse}."
        )
    return lines


def describe_candidate(found: Diagnosis) -> str:
    """Say which cause comes nearest where none was accepted; "" where there is none."""
    one = found.candidate
    if one is None or found.stated:
        return ""
    place = one.joint or "the rig as a whole"
    gain = (
        f"a gain of {figures(one.nats, 2)} nats and {figures(100 * one.share, 2)} % of the torque"
    )
    head = "Of what was not selected," if found.findings else "No cause was accepted:"
    return f"{head} {one.cause} at {place} comes nearest, with {gain}."


def list_unnamed(found: Diagnosis) -> list[str]:
    """Say what is too small to matter, and what the logs cannot show."""
    small = [
        f"{one.cause} at {one.joint or 'rig'} ({figures(100 * one.share, 2)} %)"
        for one in found.immaterial
    ]
    hidden = [f"{one.cause} at {one.joint or 'rig'}" for one in found.untestable]
    said = {"too small to matter": small, "this log cannot show": hidden}
    return [f"{what}: {', '.join(names)}" for what, names in said.items() if names]


# -- torques -----------------------------------------------------------------------------------------------------------


def get_force(found: Diagnosis, joint: str) -> str:
    """Return the unit of what drives a joint."""
    return found.after.rig.in_units(joint, "N m")


def state_torque(found: Diagnosis, joint: str, torque: float) -> str:
    """Return a torque, rms, with its share of the deviation of the joint's torque from its mean."""
    scale, unit = torque_unit(torque, get_force(found, joint))
    said = f"{figures(scale * torque, 2)} {unit} rms"
    level = _measure_torque(found, joint)
    return f"{said} ({state_share(100 * torque / level)} of the torque)" if level > 0 else said


def _measure_torque(found: Diagnosis, joint: str) -> float:
    """Return the deviation of a joint's torque from its mean on the held-out rows, N m; 0: it is not known."""
    if found.held_out is None:
        return 0.0
    errors = found.held_out.urdf
    missed = 1 - errors.fit_percent[joint] / 100
    return errors.torque_rmse[joint] / missed if missed > 0 else 0.0


def state_share(percent: float) -> str:
    """Return a share of a torque, %; of a torque that hardly changes a bound."""
    if isnan(percent):
        return DASH
    return f"{figures(percent, 2)} %" if percent < 1000 else "> 999 %"
