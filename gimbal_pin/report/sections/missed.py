"""What a diagnosis found, in the summary's words."""

from __future__ import annotations

from gimbal_pin.diagnosis import Diagnosis, Finding
from gimbal_pin.report.html import Card
from gimbal_pin.report.numbers import listed, percent, torque_text
from gimbal_pin.report.sections.torque import grade


def missed(wrong: Diagnosis | None) -> str:
    """Return what the rigid model misses, or what is wrong with the logs, as a sentence without its full stop."""
    if wrong is None or wrong.verdict == "nothing":
        return ""
    if wrong.verdict == "data":
        faults = listed(dict.fromkeys(fault.cause for fault in wrong.spoiling))
        return f"The log itself is at fault ({faults}): nothing that it seems to say about the rig should be believed"
    found = listed(named(finding) for finding in wrong.findings) if wrong.findings else ""
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
    if wrong is None or not wrong.findings:
        return []
    before, after = wrong.baseline["torque_rmse"], wrong.extended["torque_rmse"]
    joint = min(before, key=lambda name: after[name] / max(before[name], 1e-300))
    change = f"from {torque_text(before[joint])} to {torque_text(after[joint])}"
    return [f"With what the diagnosis found, {joint}'s held-out torque error falls {change}."]


def extended_card(wrong: Diagnosis | None) -> list[Card]:
    """Return the fit of the extended model, of the worst joint."""
    if wrong is None or not wrong.findings:
        return []
    joint, fit = min(wrong.extended["fit_percent"].items(), key=lambda pair: pair[1])
    return [Card("With what was found", f"{percent(fit)} %", f"fit, worst joint: {joint}, held out", grade(fit))]
