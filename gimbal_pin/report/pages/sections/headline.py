"""The headline numbers as cards, and what a diagnosis found in the summary's words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gimbal_pin.control.tuning import Tuning
from gimbal_pin.diagnosis import Diagnosis, Finding
from gimbal_pin.estimation.identification import Identified
from gimbal_pin.report.pages.html import Card
from gimbal_pin.report.pages.numbers import between, figures, listed, percent, torque_text
from gimbal_pin.report.pages.sections.experiments import BASELINE
from gimbal_pin.report.pages.sections.torque import grade
from gimbal_pin.report.view.names import controller_name


def fit_card(found: Identified) -> Card:
    """Return the fit of the worst joint."""
    accuracy = found.held_out or found.train
    joint, fit = min(accuracy.fit_percent.items(), key=lambda pair: pair[1])
    where = "held out" if found.held_out else "training data"
    return Card("Fit of the torque", f"{percent(fit)} %", f"worst joint: {joint}, {where}", grade(fit))


def error_card(found: Identified) -> Card:
    """Return the largest torque error."""
    accuracy = found.held_out or found.train
    joint, rmse = max(accuracy.torque_rmse.items(), key=lambda pair: pair[1])
    return Card("Torque error", torque_text(rmse), f"rms, largest: {joint}, {accuracy.how}")


def parameter_card(found: Identified) -> Card:
    """Return the number of parameters and their median deviation."""
    deviation = np.median(found.estimate.std / np.maximum(np.abs(found.estimate.theta), 1e-300))
    return Card("Parameters", str(len(found.names)), f"median deviation {figures(100 * float(deviation), 2)} %")


def bandwidth_card(tuning: Tuning) -> Card:
    """Return the bandwidth."""
    crossover = between(found.crossover_hz for found in tuning.margins)
    return Card("Bandwidth", f"{between(tuning.bandwidth_hz)} Hz", f"crossover {crossover} Hz")


def margin_card(tuning: Tuning) -> Card:
    """Return the worst margins."""
    phase = min(found.phase_margin_deg for found in tuning.margins)
    disk = min(found.disk_margin for found in tuning.margins)
    return Card("Phase margin", f"{figures(phase, 2)}°", f"disk margin {figures(disk, 2)}, worst joint")


def ratio_card(ratio: Mapping[str, float], fair: bool = True) -> Card:
    """Return how many times closer the model-based controller follows, on the axis where it gains least.

    `ratio`: joint → error of the baseline over that of the model-based controller. Where the baseline is no fair rival
    the card praises nothing.
    """
    joint, times = min(ratio.items(), key=lambda pair: pair[1])
    note = f"than {controller_name(BASELINE)}: rms error, all axes together, least on {joint}"
    return Card("Tracks closer", f"{figures(times, 2)} ×", note, "poor" if times <= 1 else "good" if fair else "")


def missed(wrong: Diagnosis | None) -> str:
    """Return what the rigid model misses, or what is wrong with the logs, as a sentence without its full stop."""
    if wrong is None or wrong.beside == "nothing":
        return ""
    if wrong.verdict == "data":
        faults = listed(dict.fromkeys(fault.cause for fault in wrong.spoiling))
        return f"The log itself is at fault ({faults}): nothing that it seems to say about the rig should be believed"
    found = listed(named(finding) for finding in wrong.lacking) if wrong.lacking else ""
    rest = [joint for joint, left in wrong.residual.items() if left.state == "structured"]
    foreign = f"something at {listed(rest)} that no known cause explains" if rest else ""
    return f"The rigid model misses {', and '.join(part for part in (found, foreign) if part)}"


def named(finding: Finding) -> str:
    """``cogging at yaw``; ``cogging or cable-spring at yaw`` where the log cannot tell."""
    *others, last = finding.alike if finding.status == "ambiguous" else (finding.cause,)
    either = f"{', '.join(others)} or {last}" if others else last
    return f"{either} at {finding.joint or 'the rig as a whole'}"


def about_gain(wrong: Diagnosis | None) -> list[str]:
    """Say what knowing it does to the held-out torque error, at the joint where it does most."""
    if wrong is None or not wrong.lacking:
        return []
    before, after = wrong.baseline["torque_rmse"], wrong.extended["torque_rmse"]
    joint = min(before, key=lambda name: after[name] / max(before[name], 1e-300))
    change = f"from {torque_text(before[joint])} to {torque_text(after[joint])}"
    return [f"With what the diagnosis found, {joint}'s held-out torque error falls {change}."]


def extended_card(wrong: Diagnosis | None) -> list[Card]:
    """Return the fit of the extended model, of the worst joint."""
    if wrong is None or not wrong.lacking:
        return []
    joint, fit = min(wrong.extended["fit_percent"].items(), key=lambda pair: pair[1])
    return [Card("With what was found", f"{percent(fit)} %", f"fit, worst joint: {joint}, held out", grade(fit))]
