"""What was found, what to do first and what not to trust: the head of the terminal's text and of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isnan
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.control.controller_names import BASELINE, OURS
from gimbal_pin.control.laws.reasons import ReasonKind, list_compensated
from gimbal_pin.control.tuning import RIVAL
from gimbal_pin.errors import NORMAL_95
from gimbal_pin.log.limited import LEAST_SHARE_TOLD
from gimbal_pin.report.diagnosis_text import (
    describe_candidate,
    get_compensation,
    get_experiment,
    list_deciding_faults,
    list_rest,
    name_finding,
    state_verdict,
)
from gimbal_pin.report.elements import Card, Section, bullets, cards, folded, notice, paragraph
from gimbal_pin.report.format import (
    angle,
    controller_name,
    figures,
    file_name,
    format_range,
    list_shown_joints,
    listed,
    percent,
    rows_named,
    to_sentence,
    torque_text,
)
from gimbal_pin.report.rig_drawing import RigDrawing
from gimbal_pin.report.tables import FAIR, GOOD, TOGETHER, grade, state_jitter
from gimbal_pin.rig.brief import brief

if TYPE_CHECKING:
    from gimbal_pin.control.judging import Judgement
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.control.tuning import Tuning
    from gimbal_pin.diagnosis import Diagnosis
    from gimbal_pin.identification import IdentificationResult, PayloadStatement
    from gimbal_pin.log.log import Log
    from gimbal_pin.pointing import Verified
    from gimbal_pin.rig.rig import Rig

EXPORT = (
    "Put the controller on the gimbal: in the report's folder, 'gimbal-pin export controller.yaml --c DIR' writes it "
    "as C99."
)
SIMULATED = "The controllers were simulated, their steps on {}, and not run on the gimbal."
"""What holds of every figure of a controller; within it the plant."""


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
        drawing: The rig, what is in question, and how to balance it.
    """

    found: str
    tone: str
    to_do: tuple[str, ...]
    doubts: tuple[str, ...]
    details: tuple[str, ...]
    numbers: tuple[Card, ...]
    drawing: RigDrawing

    __repr__ = brief

    @property
    def section(self) -> Section:
        """The head of a page."""
        beside = [
            paragraph(self.found, f"headline {self.tone}"),
            notice("What to do", bullets(self.to_do)),
        ]
        beside += [notice("Take care", bullets(self.doubts))] if self.doubts else []
        heads, rest = (
            [one for one in self.numbers if one.is_headline == wanted] for wanted in (True, False)
        )
        more = [
            paragraph(" ".join(self.details), "verdict"),
            *([cards(rest, is_detail=False)] if rest else []),
        ]
        return Section(
            "Summary",
            [
                replace(self.drawing, beside=beside),
                cards(heads, is_detail=False),
                folded("What it was identified from, and more figures", *more, is_detail=False),
            ],
        )

    def describe(self, most: int = 14) -> str:
        """Return the head in at most so many lines: what was found, what to do, what not to trust, headline numbers."""
        numbers = str(cards([card for card in self.numbers if card.is_headline])).split("\n")[1:]
        free = most - 4 - len(numbers)
        doubts = self.doubts[: max(free - len(self.to_do), 2)]
        lines = [
            self.found,
            "What to do",
            *(f"  {one}" for one in self.to_do[: free - len(doubts)]),
        ]
        lines += ["Take care", *(f"  {one}" for one in doubts)] if doubts else []
        return "\n".join([*lines, " ".join(self.details), *numbers])


def summary(
    rig: Rig,
    found: IdentificationResult,
    tuning: Tuning | None = None,
    result: Tracking | None = None,
    logs: Sequence[Log] = (),
    plant: str = "the identified model",
    wrong: Diagnosis | None = None,
    undiagnosed: str = "",
    judged: Judgement | None = None,
    payload: PayloadStatement | None = None,
    held: Verified | None = None,
    not_held: str = "",
) -> Summary:
    """Return the verdict on a rig's identification, controller and tracking.

    `plant`: what the steps were simulated on, within a sentence; `undiagnosed`: why there is no diagnosis; `not_held`:
    why no camera was held on a platform.
    """
    spoilt = wrong is not None and wrong.verdict == "data"
    model = rate_model(rig, found)
    missing = missed(wrong)
    tested = found.held_out or found.train
    fit = min(tested.fit_percent.values())
    tone = "poor" if spoilt else "fair" if missing else grade(fit)
    if wrong is not None and wrong.held_out is not None and not spoilt:
        where = f"to {wrong.held_out.cutoff_hz:g} Hz, held out"
        fits = wrong.held_out.refitted.fit_percent
        worst, stated = min(wrong.held_out.urdf.fit_percent.items(), key=lambda pair: pair[1])
        model[0] = rate_fit(
            "Fit of the torque", fits, f"{where}; the URDF's {percent(stated)}, at {worst}"
        )
        if wrong.lacking:
            fits = wrong.held_out.extended.fit_percent
            model.insert(1, rate_fit("With what was found", fits, where))
            fit = min(fits.values())
    numbers = [*model, *rate_controller(tuning, judged, held)]
    unknown = [f"Not diagnosed: {undiagnosed}."] if undiagnosed else []
    unknown += (
        [f"No camera was held on a platform that moves: {not_held}."]
        if not_held and rig.aims
        else []
    )
    simulated = [] if result is None else [SIMULATED.format(plant)]
    doubts = (*cautions(tuning, result, judged), *unexplained(wrong), *unknown, *simulated)
    details = [name_source(rig, found, logs)]
    if payload is not None:
        place = () if payload.beside is None else (payload.beside.sentence,)
        sits = payload.lines[:1] if wrong is None or not wrong.finds_payload else ()
        details += [to_sentence(line) for line in (*sits, *place)]
    steps = to_do(wrong, tuning, payload)
    barred = tuning is not None and bool(tuning.doubts)
    drawing = RigDrawing(rig, list_questioned(wrong), payload.balance if payload else None, ())
    return Summary(
        verdict(fit, missing, barred), tone, steps, doubts, tuple(details), tuple(numbers), drawing
    )


def rate_model(rig: Rig, found: IdentificationResult) -> list[Card]:
    """Return how well the model predicts the torque, at the joint where it does so worst, and how well it is known."""
    tested = found.held_out or found.train
    band = f"to {found.filtering.cutoff:g} Hz"
    worst, rmse = max(tested.torque_rmse.items(), key=lambda pair: pair[1])
    force = next(one.force for one in list_shown_joints(rig) if one.name == worst)
    theta = np.abs(found.estimate.theta)
    std = found.estimate.std
    told = int(np.sum(theta > NORMAL_95 * std))
    deviation = 100 * float(np.median(std / np.maximum(theta, 1e-300)))
    known = f"{told} of {len(theta)} differ{'s' * (told == 1)} significantly from zero"
    how = f"{band}, {'held out' if found.held_out else 'training data'}"
    error = torque_text(rmse, force=force)
    note = f"rms {band}, largest: {worst}, {tested.how}"
    return [
        rate_fit("Fit of the torque", tested.fit_percent, how),
        Card("Torque error", error, note, is_headline=False),
        Card(
            "Parameters",
            str(len(theta)),
            f"{known}; median deviation {figures(deviation, 2)} %",
            is_headline=False,
        ),
    ]


def rate_fit(label: str, fits: Mapping[str, float], how: str) -> Card:
    """Return the fit at the joint where it is worst."""
    joint, fit = min(fits.items(), key=lambda pair: pair[1])
    where = "there is no fit where there is no torque" if isnan(fit) else f"worst joint: {joint}"
    return Card(label, percent(fit), f"{where}, {how}", grade(fit))


def rate_controller(
    tuning: Tuning | None, judged: Judgement | None, held: Verified | None
) -> list[Card]:
    """Return bandwidth and margins, the errors of a PID over the controller's, and how still it holds a camera."""
    found = list[Card]()
    if tuning is not None:
        margins = tuning.margins
        phase, disk = (
            min(getattr(one, name) for one in margins)
            for name in ("phase_margin_deg", "disk_margin")
        )
        delay = min(one.delay_margin for one in margins)
        crossover = format_range(one.crossover_hz for one in margins)
        law = f"{controller_name(tuning.wish.kind)}; crossover {crossover} Hz"
        least = f"disk margin {figures(disk, 2)}, delay margin {figures(1e3 * delay, 2)} ms, worst joint"
        found.append(Card("Bandwidth", f"{format_range(tuning.bandwidth_hz)} Hz", law))
        found.append(Card("Phase margin", f"{figures(phase, 2)}°", least, is_headline=False))
    if judged is not None:
        ratios = judged.compute_ratios(next(iter(judged.errors)))[:, -1]
        note = f"median; worst {figures(ratios.min(), 2)}, of {judged.plants} perturbed plants, all joints"
        found.append(
            Card("Error of a PID over the controller's", figures(float(np.median(ratios)), 2), note)
        )
    if held is not None:
        note = f"{controller_name(OURS)} {state_jitter(held, OURS)}; a PID {state_jitter(held, BASELINE)}"
        found.append(
            Card("Jitter on a platform that moves", f"{angle(held.jitter[OURS])} rms", note)
        )
    return found


def missed(wrong: Diagnosis | None) -> str:
    """Return what the rigid model misses, or what is wrong with the logs, as a sentence without its full stop."""
    if wrong is None:
        return ""
    if wrong.verdict == "data":
        return state_verdict(wrong)[:-1]
    if not (wrong.lacking or wrong.unexplained):
        return "" if wrong.is_silent else state_verdict(wrong)[:-1]
    found = listed(map(name_finding, wrong.lacking)) if wrong.lacking else ""
    rest = (
        f"torque at {listed(wrong.unexplained)} for which no cause was accepted"
        if wrong.unexplained
        else ""
    )
    return f"The rigid model misses {', and '.join(part for part in (found, rest) if part)}"


def list_questioned(wrong: Diagnosis | None) -> list[str]:
    """Return the joints at which a diagnosis found something, or left more than noise."""
    found = [] if wrong is None else [*(one.joint for one in wrong.lacking), *wrong.unexplained]
    return [joint for joint in dict.fromkeys(found) if joint is not None]


def verdict(fit: float, missing: str = "", barred: bool = False) -> str:
    """Return the headline; `missing`: what a diagnosis found wrong, see `missed`; `barred`: no controller to be run."""
    if not fit >= FAIR:  # nor is there any where no torque was held out
        vague = "The model leaves much of the measured torque unexplained: what is simulated with it may not hold"
        return f"{missing or vague}."
    first = missing or f"The model explains {'' if fit >= GOOD else 'most of '}the measured torque"
    if barred:
        return (
            f"{first}; the controller is not to be run, for the log leaves open what it stands on."
        )
    return f"{first}."


def to_do(
    wrong: Diagnosis | None, tuning: Tuning | None, payload: PayloadStatement | None = None
) -> tuple[str, ...]:
    """Return what to do about what was found, the most urgent first."""
    if wrong is not None and wrong.verdict == "data":
        faults = list_deciding_faults(wrong)
        return tuple(to_sentence(fault.next_experiment) for fault in faults)
    open_ = []
    known = []
    slid = () if payload is None else tuple(to_sentence(one) for one in payload.advice[:1])
    compensated = [] if tuning is None else list_compensated(tuning.model, tuning.wish.kind)
    for finding in [] if wrong is None else wrong.lacking:
        experiment = get_experiment(finding)
        if experiment is not None:
            open_.append(f"Find out whether it is {name_finding(finding)}: {experiment}.")
        elif (finding.cause, finding.joint) not in compensated:
            known.append(f"Against {name_finding(finding)}: {get_compensation(finding)}.")
    if tuning is not None and tuning.doubts:
        richer = "Record a richer log, for which 'gimbal-pin excite' designs the motion, before a controller runs."
        return (*open_, richer, *known, *slid)
    return (*open_, *known, *slid, *([] if tuning is None else [EXPORT]))


def unexplained(wrong: Diagnosis | None) -> list[str]:
    """Say what the diagnosis could not explain."""
    if wrong is None or not wrong.unexplained:
        return []
    return [*list_rest(wrong), *filter(None, [describe_candidate(wrong)])]


def cautions(
    tuning: Tuning | None, result: Tracking | None, judged: Judgement | None = None
) -> list[str]:
    """Return what speaks against taking the headline at its word."""
    found = []
    if (
        tuning is not None
    ):  # where the controller is not to be run, a PID for the same model is no safer
        safer = [
            to_sentence(why.sentence) for why in tuning.reasons if why.kind is ReasonKind.PID_SAFER
        ]
        found = [f"{doubt}." for doubt in tuning.doubts] or safer
    if judged is not None:  # joints that the PID follows at least as closely on half of the plants
        median = np.median(judged.compute_ratios(next(iter(judged.errors))), axis=0)
        worse = [joint for joint, ratio in zip(judged.joints, median.tolist()) if ratio <= 1]
        found += (
            [f"On {listed(worse)}, a {controller_name(RIVAL)} follows at least as closely."]
            if worse
            else []
        )
    if result is None:
        return found
    for name in dict.fromkeys(one.controller for one in result.experiments):
        share, joint = max(
            (own.saturated, joint) for joint, own in result.of(TOGETHER, name).joints.items()
        )
        if share >= LEAST_SHARE_TOLD:
            step = "step: no fair rival, so that its errors say little" if name == RIVAL else "step"
            law = controller_name(name)
            found.append(
                f"{law} is at the torque limit of {joint} in {100 * share:.0f} % of the {step}."
            )
    return found


def name_source(rig: Rig, found: IdentificationResult, logs: Sequence[Log]) -> str:
    """Say what was identified from what, and by what it is judged."""
    name = f"{rig.name} with payload {rig.payload}" if rig.payload else rig.name
    seconds = sum(float(log.t[-1] - log.t[0]) for log in logs)
    source = listed(map(file_name, found.logs)) + (f" ({figures(seconds)} s)" if logs else "")
    held = found.held_out
    judged = (
        "the data it was fitted to"
        if held is None
        else f"{rows_named(held.how)}, which the fit did not see"
    )
    return f"{name} was identified from {source}, and judged on {judged}."
