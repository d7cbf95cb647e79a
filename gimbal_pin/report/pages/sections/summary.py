"""The verdict, in plain words and a handful of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gimbal_pin.control.tracking import Tracking
from gimbal_pin.control.tuning import Tuning
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.estimation.identification import Identified
from gimbal_pin.log.limited import SPOKEN
from gimbal_pin.log.log import Log
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import bullets, cards, join, notice, paragraph
from gimbal_pin.report.pages.joints import joints_of
from gimbal_pin.report.pages.numbers import SURE, between, figures, file_name, listed, rows_named, torque_text
from gimbal_pin.report.pages.sections.experiments import BASELINE, TOGETHER, chosen
from gimbal_pin.report.pages.sections.headline import (
    about_gain,
    bandwidth_card,
    error_card,
    extended_card,
    fit_card,
    margin_card,
    missed,
    parameter_card,
    ratio_card,
)
from gimbal_pin.report.pages.sections.torque import FAIR, GOOD, grade
from gimbal_pin.report.view.names import controller_name
from gimbal_pin.rig.rig import Rig


def summary(
    rig: Rig,
    found: Identified,
    tuning: Tuning | None = None,
    result: Tracking | None = None,
    logs: Sequence[Log] = (),
    plant: str = "the identified model",
    wrong: Diagnosis | None = None,
) -> Section:
    """Return the verdict on a rig's identification, controller and tracking.

    On what was run; `plant`: what the steps were simulated on, within a sentence.
    """
    ratio = {} if result is None else ratios(result)
    barred = tuning is not None and bool(tuning.doubts)
    fair = not barred and (result is None or at_limit(result, BASELINE)[1] < SPOKEN)
    accuracy = found.held_out or found.train
    fit = min(accuracy.fit_percent.values())
    sentences = [about_fit(rig, found, logs), *about_gain(wrong), about_parameters(found)]
    numbers = [fit_card(found), *extended_card(wrong), error_card(found), parameter_card(found)]
    if tuning is not None:
        sentences.append(about_tuning(tuning))
        numbers += [bandwidth_card(tuning), margin_card(tuning)]
    if result is not None and ratio:
        sentences += [] if barred else [about_tracking(rig, result, ratio, plant)]
        numbers.append(ratio_card(ratio, fair))
    missing = missed(wrong)
    spoilt = wrong is not None and wrong.verdict == "data"
    tone = "poor" if spoilt else "fair" if missing else grade(fit)
    if wrong is not None and wrong.lacking:
        fit = min(wrong.extended["fit_percent"].values())  # the controllers are built on what was found
    said = verdict(fit, ratio if fair and not spoilt else {}, missing, barred)
    headline = paragraph(said, f"headline {tone}")
    parts = [headline, paragraph(" ".join(sentences), "verdict"), cards(numbers)]
    if warnings := cautions(tuning, result):
        parts.append(notice("Take care", bullets(warnings)))
    return Section("Summary", join(parts))


def ratios(result: Tracking) -> Mapping[str, float]:
    """Return joint → rms error under the baseline over that under the last controller, all axes moving together."""
    by_controller = {experiment.controller: experiment for experiment in chosen(result, TOGETHER)}
    ours = [name for name in by_controller if name != BASELINE]
    if BASELINE not in by_controller or not ours:
        return {}
    theirs, best = by_controller[BASELINE].joints, by_controller[ours[-1]].joints
    return {joint: theirs[joint].rms_error / max(best[joint].rms_error, 1e-300) for joint in theirs}


def verdict(fit: float, ratio: Mapping[str, float], missing: str = "", barred: bool = False) -> str:
    """Return the headline; `missing`: what a diagnosis found wrong, see `missed`; `barred`: no controller to be run."""
    if fit < FAIR:
        return (
            f"{missing}."
            if missing
            else "The model leaves much of the measured torque unexplained: what is simulated with it may not hold."
        )
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


def about_fit(rig: Rig, found: Identified, logs: Sequence[Log]) -> str:
    """Say what was identified from what, and how well it predicts."""
    name = f"{rig.name} with payload {rig.payload}" if rig.payload else rig.name
    source = listed(map(file_name, found.logs))
    seconds = sum(float(log.t[-1] - log.t[0]) for log in logs)
    length = f" ({figures(seconds)} s)" if logs else ""
    accuracy = found.held_out or found.train
    where = (
        f"On {rows_named(accuracy.how)}, which the fit did not see,"
        if found.held_out
        else "On the data it was fitted to"
    )
    error = torque_text(max(accuracy.torque_rmse.values()))
    return (
        f"{name} was identified from {source}{length}. {where} the model predicts the motor torque, filtered at "
        f"{found.filtering.cutoff:g} Hz, to {error} rms or better: a fit of "
        f"{between(accuracy.fit_percent.values(), 3)} %."
    )


def about_parameters(found: Identified) -> str:
    """Say how well the parameters are known."""
    blind = int(np.sum(np.abs(found.estimate.theta) <= SURE * found.estimate.std))
    count = len(found.names)
    if not blind:
        return f"All {count} parameters are told from zero."
    are = "is" if blind == 1 else "are"
    return f"{count - blind} of {count} parameters are told from zero; {blind} {are} too small for this log to show."


def about_tuning(tuning: Tuning) -> str:
    """Say how fast the loops are, and how safe."""
    phase = min(found.phase_margin_deg for found in tuning.margins)
    delay = min(found.delay_margin for found in tuning.margins)
    name, hertz = controller_name(tuning.wish.kind), between(tuning.bandwidth_hz)
    margin = f"{figures(phase, 2)}° of phase margin and {figures(1e3 * delay, 2)} ms of delay margin"
    return f"The {name} controller is tuned to a bandwidth of {hertz} Hz, with at least {margin}."


def about_tracking(rig: Rig, result: Tracking, ratio: Mapping[str, float], plant: str) -> str:
    """Say how steps on all axes together are followed in simulation."""
    by_controller = {experiment.controller: experiment for experiment in chosen(result, TOGETHER)}
    ours = [name for name in by_controller if name != BASELINE][-1]

    def worst(name: str) -> str:
        errors = [(joint.scale * by_controller[name].joints[joint.name].rms_error, joint) for joint in joints_of(rig)]
        error, joint = max(errors, key=lambda pair: pair[0])
        return joint.text(error / joint.scale, digits=2)

    times = f"{between(ratio.values())} times as closely as {controller_name(BASELINE)}"
    errors = f"rms error of the worst axis {worst(ours)} against {worst(BASELINE)}"
    return f"Simulated on {plant}, with steps on all axes together, it follows {times} ({errors})."


def cautions(tuning: Tuning | None, result: Tracking | None) -> list[str]:
    """Return what speaks against taking the headline at its word."""
    found = [*tuning.doubts, *(why for why in tuning.reasons if "is safer" in why)] if tuning is not None else []
    if result is None:
        return found
    for experiment in chosen(result, TOGETHER):
        joint, share = at_limit(result, experiment.controller)
        if share >= SPOKEN:
            name = controller_name(experiment.controller)
            unfair = ": no fair rival, so that its errors say little" if experiment.controller == BASELINE else ""
            found.append(f"{name} is at the torque limit of {joint} in {100 * share:.0f} % of the step{unfair}.")
    return found


def at_limit(result: Tracking, controller: str) -> tuple[str, float]:
    """Return the joint that a controller has longest at its torque limit, all axes moving, and in what share of it."""
    shares = [
        (joint, metrics.saturated)
        for experiment in chosen(result, TOGETHER)
        if experiment.controller == controller
        for joint, metrics in experiment.joints.items()
    ]
    return max(shares, key=lambda pair: pair[1], default=("", 0.0))
