"""What was found, what to do first and what not to trust: the head of the terminal's text and of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.diagnosis.result import MEASURED
from gimbal_pin.effects import CAUSES
from gimbal_pin.log.limited import SPOKEN
from gimbal_pin.report.format import (
    SURE,
    between,
    controller_name,
    figures,
    file_name,
    joints_of,
    listed,
    percent,
    rows_named,
    torque_text,
)
from gimbal_pin.report.html import Card, Section, bullets, cards, join, notice, paragraph
from gimbal_pin.report.tables import BASELINE, FAIR, GOOD, TOGETHER, grade
from gimbal_pin.rig.brief import brief

if TYPE_CHECKING:
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.control.tuning import Tuning
    from gimbal_pin.diagnosis import Diagnosis, Finding
    from gimbal_pin.estimation.identification import Identified
    from gimbal_pin.log.log import Log
    from gimbal_pin.rig.rig import Rig

EXPORT = "Put the controller on the gimbal: 'gimbal-pin export controller.yaml --c DIR' writes it as C99."
SIMULATED = "Steps and camera were simulated: on the gimbal no controller has run yet."


@dataclass(frozen=True)
class Summary:
    """The head of a report.

    Attributes:
        found: What was found, a sentence.
        tone: "good", "fair" or "poor".
        to_do: What to do about it, the most urgent first, in sentences.
        doubts: What speaks against taking that at its word, in sentences.
        details: More of what was found, in sentences.
        numbers: The headline numbers.
    """

    found: str
    tone: str
    to_do: tuple[str, ...]
    doubts: tuple[str, ...]
    details: tuple[str, ...]
    numbers: tuple[Card, ...]

    __repr__ = brief

    @property
    def section(self) -> Section:
        """The head of a page."""
        parts = [paragraph(self.found, f"headline {self.tone}"), notice("What to do", bullets(self.to_do))]
        parts += [notice("Take care", bullets(self.doubts))] if self.doubts else []
        parts += [paragraph(" ".join(self.details), "verdict"), cards(self.numbers)]
        return Section("Summary", join(parts))


def summary(
    rig: Rig,
    found: Identified,
    tuning: Tuning | None = None,
    result: Tracking | None = None,
    logs: Sequence[Log] = (),
    plant: str = "the identified model",
    wrong: Diagnosis | None = None,
    undiagnosed: str = "",
) -> Summary:
    """Return the verdict on a rig's identification, controller and tracking.

    `plant`: what the steps were simulated on, within a sentence; `undiagnosed`: why there is no diagnosis.
    """
    ratio = {} if result is None else ratios(result)
    barred, spoilt = tuning is not None and bool(tuning.doubts), wrong is not None and wrong.verdict == "data"
    fair = not barred and (result is None or at_limit(result, BASELINE)[1] < SPOKEN)
    held, extended = found.held_out or found.train, wrong if wrong is not None and wrong.lacking else None
    joint, fit = min(held.fit_percent.items(), key=lambda pair: pair[1])
    worst, rmse = max(held.torque_rmse.items(), key=lambda pair: pair[1])
    where = "held out" if found.held_out else "training data"
    details, numbers = [about_fit(rig, found, logs)], []
    numbers.append(Card("Fit of the torque", f"{percent(fit)} %", f"worst joint: {joint}, {where}", grade(fit)))
    tone, missing = "poor" if spoilt else grade(fit), missed(wrong)
    tone = "fair" if missing and not spoilt else tone
    if extended is not None:
        before, after = extended.baseline["torque_rmse"], extended.extended["torque_rmse"]
        most = min(before, key=lambda name: after[name] / max(before[name], 1e-300))
        change = f"from {torque_text(before[most])} to {torque_text(after[most])}"
        details.append(f"With what the diagnosis found, {most}'s held-out torque error falls {change}.")
        joint, fit = min(extended.extended["fit_percent"].items(), key=lambda pair: pair[1])
        note = f"fit, worst joint: {joint}, held out"
        numbers.append(Card("With what was found", f"{percent(fit)} %", note, grade(fit)))
    details.append(about_parameters(found))
    numbers.append(Card("Torque error", torque_text(rmse), f"rms, largest: {worst}, {held.how}"))
    deviation = 100 * float(np.median(found.estimate.std / np.maximum(np.abs(found.estimate.theta), 1e-300)))
    numbers.append(Card("Parameters", str(len(found.names)), f"median deviation {figures(deviation, 2)} %"))
    if tuning is not None:
        hertz, margins = f"{between(tuning.bandwidth_hz)} Hz", tuning.margins
        phase, delay = min(one.phase_margin_deg for one in margins), 1e3 * min(one.delay_margin for one in margins)
        safe = f"{figures(phase, 2)}° of phase margin and {figures(delay, 2)} ms of delay margin"
        law, disk = controller_name(tuning.wish.kind), figures(min(one.disk_margin for one in margins), 2)
        details.append(f"The {law} controller is tuned to a bandwidth of {hertz}, with at least {safe}.")
        crossover = between(one.crossover_hz for one in margins)
        numbers.append(Card("Bandwidth", hertz, f"crossover {crossover} Hz"))
        numbers.append(Card("Phase margin", f"{figures(phase, 2)}°", f"disk margin {disk}, worst joint"))
    if result is not None and ratio:
        details += [] if barred else [about_tracking(rig, result, ratio, plant)]
        joint, times = min(ratio.items(), key=lambda pair: pair[1])
        note = f"than {controller_name(BASELINE)}: rms error, all axes together, least on {joint}"
        praise = "poor" if times <= 1 else "good" if fair else ""  # nothing is praised for beating no fair rival
        numbers.append(Card("Tracks closer", f"{figures(times, 2)} ×", note, praise))
    said = verdict(fit, ratio if fair and not spoilt else {}, missing, barred)
    unknown = [f"Not diagnosed: {undiagnosed}."] if undiagnosed else []
    doubts = (*cautions(tuning, result), *unexplained(wrong), *unknown)
    return Summary(said, tone, to_do(wrong, tuning), doubts, tuple(details), tuple(numbers))


def ratios(result: Tracking) -> Mapping[str, float]:
    """Return joint → rms error under the baseline over that under the last controller, all axes moving together."""
    by_controller = {one.controller: one.joints for one in result.experiments if one.name == TOGETHER}
    ours = [name for name in by_controller if name != BASELINE]
    if BASELINE not in by_controller or not ours:
        return {}
    theirs, best = by_controller[BASELINE], by_controller[ours[-1]]
    return {joint: theirs[joint].rms_error / max(best[joint].rms_error, 1e-300) for joint in theirs}


def missed(wrong: Diagnosis | None) -> str:
    """Return what the rigid model misses, or what is wrong with the logs, as a sentence without its full stop."""
    if wrong is None or wrong.beside == "nothing":
        return ""
    if wrong.verdict == "data":
        faults = listed(dict.fromkeys(fault.cause for fault in wrong.spoiling))
        return f"The log itself is at fault ({faults}): nothing that it seems to say about the rig should be believed"
    found = listed(named(finding) for finding in wrong.lacking) if wrong.lacking else ""
    rest = structured(wrong)
    foreign = f"something at {listed(rest)} that no known cause explains" if rest else ""
    return f"The rigid model misses {', and '.join(part for part in (found, foreign) if part)}"


def structured(wrong: Diagnosis) -> list[str]:
    """Return the joints at which more than noise is left."""
    return [joint for joint, left in wrong.residual.items() if left.state == "structured"]


def named(finding: Finding) -> str:
    """``cogging at yaw``; ``cogging or cable-spring at yaw`` where the log cannot tell."""
    *others, last = finding.alike if finding.status == "ambiguous" else (finding.cause,)
    either = f"{', '.join(others)} or {last}" if others else last
    return f"{either} at {finding.joint or 'the rig as a whole'}"


def verdict(fit: float, ratio: Mapping[str, float], missing: str = "", barred: bool = False) -> str:
    """Return the headline; `missing`: what a diagnosis found wrong, see `missed`; `barred`: no controller to be run."""
    if fit < FAIR:
        vague = "The model leaves much of the measured torque unexplained: what is simulated with it may not hold"
        return f"{missing or vague}."
    first = missing or f"The model explains {'' if fit >= GOOD else 'most of '}the measured torque"
    if barred:
        return f"{first}; the controller is not to be run, for the log leaves open what it stands on."
    if not ratio:
        return f"{first}."
    worse = [joint for joint, times in ratio.items() if times <= 1]
    other, law = controller_name(BASELINE), f"the controller built on {'what is known' if missing else 'it'}"
    if not worse:
        return f"{first}; {law} tracks better than {other} on every axis."
    return f"{first}; on {listed(worse)}, {other} tracks at least as well as {law}."


def to_do(wrong: Diagnosis | None, tuning: Tuning | None) -> tuple[str, ...]:
    """Return what to do about what was found, the most urgent first."""
    if wrong is not None and wrong.spoiling:
        return tuple(f"{fault.next_experiment[:1].upper()}{fault.next_experiment[1:]}." for fault in wrong.spoiling)
    open_, known = [], []
    compensated = "" if tuning is None else "; ".join(why for why in tuning.reasons if why.startswith("compensated"))
    for finding in [] if wrong is None else wrong.lacking:
        if finding.open and finding.next_experiment:
            open_.append(f"Find out whether it is {named(finding)}: {finding.next_experiment}.")
        elif finding.cause != MEASURED and f"{finding.cause} at {finding.joint}" not in compensated:
            known.append(f"Against {named(finding)}: {CAUSES[finding.cause].compensation}.")
    if tuning is not None and tuning.doubts:
        richer = "Record a richer log, for which 'gimbal-pin excite' designs the motion, before a controller runs."
        return (*open_, richer, *known)
    return (*open_, *known, *([] if tuning is None else [EXPORT]))


def unexplained(wrong: Diagnosis | None) -> list[str]:
    """Say what the diagnosis could not explain, or what noise may hide."""
    if wrong is None:
        return []
    rest = structured(wrong)
    found = [f"More than noise is left at {listed(rest)}, and no known cause explains it."] if rest else []
    return [*found, *([f"{wrong.hidden[:1].upper()}{wrong.hidden[1:]}."] if wrong.hidden else [])]


def cautions(tuning: Tuning | None, result: Tracking | None) -> list[str]:
    """Return what speaks against taking the headline at its word."""
    found = [*tuning.doubts, *(why for why in tuning.reasons if "is safer" in why)] if tuning is not None else []
    if result is None:
        return found
    for name in dict.fromkeys(one.controller for one in result.experiments):
        joint, share = at_limit(result, name)
        if share >= SPOKEN:
            unfair = ": no fair rival, so that its errors say little" if name == BASELINE else ""
            law = controller_name(name)
            found.append(f"{law} is at the torque limit of {joint} in {100 * share:.0f} % of the step{unfair}.")
    return found


def at_limit(result: Tracking, controller: str) -> tuple[str, float]:
    """Return the joint that a controller has longest at its torque limit, all axes moving, and in what share of it."""
    shares = [
        (joint, metrics.saturated)
        for one in result.experiments
        if (one.name, one.controller) == (TOGETHER, controller)
        for joint, metrics in one.joints.items()
    ]
    return max(shares, key=lambda pair: pair[1], default=("", 0.0))


def about_fit(rig: Rig, found: Identified, logs: Sequence[Log]) -> str:
    """Say what was identified from what, and how well it predicts."""
    name = f"{rig.name} with payload {rig.payload}" if rig.payload else rig.name
    seconds = sum(float(log.t[-1] - log.t[0]) for log in logs)
    source = listed(map(file_name, found.logs)) + (f" ({figures(seconds)} s)" if logs else "")
    held = found.held_out
    judged = "the data it was fitted to" if held is None else f"{rows_named(held.how)}, which the fit did not see"
    error = torque_text(max((held or found.train).torque_rmse.values()))
    fit = between((held or found.train).fit_percent.values(), 3)
    return (
        f"{name} was identified from {source}. On {judged}, the model predicts the motor torque, filtered at "
        f"{found.filtering.cutoff:g} Hz, to {error} rms or better: a fit of {fit} %."
    )


def about_parameters(found: Identified) -> str:
    """Say how many parameters the log tells from zero."""
    blind, count = int(np.sum(np.abs(found.estimate.theta) <= SURE * found.estimate.std)), len(found.names)
    if not blind:
        return f"All {count} parameters are told from zero."
    are = "is" if blind == 1 else "are"
    return f"{count - blind} of {count} parameters are told from zero; {blind} {are} too small for this log to show."


def about_tracking(rig: Rig, result: Tracking, ratio: Mapping[str, float], plant: str) -> str:
    """Say how steps on all axes together are followed in simulation."""
    together = {one.controller: one for one in result.experiments if one.name == TOGETHER}
    ours = [name for name in together if name != BASELINE][-1]

    def worst(name: str) -> str:
        errors = [(joint.scale * together[name].joints[joint.name].rms_error, joint) for joint in joints_of(rig)]
        error, joint = max(errors, key=lambda pair: pair[0])
        return joint.text(error / joint.scale, digits=2)

    times = f"{between(ratio.values())} times as closely as {controller_name(BASELINE)}"
    errors = f"rms error of the worst axis {worst(ours)} against {worst(BASELINE)}"
    return f"Simulated on {plant}, with steps on all axes together, it follows {times} ({errors})."
