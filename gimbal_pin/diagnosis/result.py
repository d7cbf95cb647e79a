"""What `diagnose` says: findings, what was left, and what the log could not show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import exp
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.checks import Alteration, Fault, describe_parameters, list_alterations
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.parting import NextExperiment
from gimbal_pin.diagnosis.probability import LISTED, SURE, moderate
from gimbal_pin.diagnosis.state import State
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.identification import PayloadStatement
from gimbal_pin.identification.model_file import write_extended
from gimbal_pin.identification.validation import Opinion, is_degraded, judge_joint
from gimbal_pin.log.log import Log
from gimbal_pin.rig.brief import Record, brief

MEASURED_CAUSE = "platform-motion"
"""The cause that a sensor measures, so that every model has it that is made of such a log."""
ONLY_TOGETHER = "only together; other sizes fit this log as well"
"""What holds of figures none of which the log tells by itself."""


@dataclass(frozen=True)
class Curve:
    """What no cause explains, as a table with what is known of it.

    Attributes:
        over: "angle", "rate" or "load".
        knots: rad, rad/s or N m.
        torque: N m at each.
        std: Its standard deviation.
        acts: Ranges over which the torque is told from zero, to the knots beside them.
    """

    over: str
    knots: tuple[float, ...]
    torque: tuple[float, ...]
    std: tuple[float, ...]
    acts: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Residual:
    """What is left at one joint after all findings.

    Attributes:
        state: "noise" or "structured".
        noise_floor: What the noise alone leaves, N m rms.
        dispersion: Residual power over noise power.
        discrepancy: Structured power left over that before any finding, 0 for noise.
        where: Where the structure is, or "".
        curve: What of it the extended model carries as a table; None: nothing.
    """

    state: str
    noise_floor: float
    dispersion: float
    discrepancy: float = 0.0
    where: str = ""
    curve: Curve | None = None


@dataclass(frozen=True)
class Rival:
    """Another cause that was fitted in a finding's place.

    Attributes:
        cause: Its name.
        delta: Log-likelihood of the finding less that of the rival.
        z: The same over its standard deviation by blocks (Vuong 1989).
        joint: Where it would sit; None for a cause of the whole rig.
    """

    cause: str
    delta: float
    z: float
    joint: str | None = None

    @property
    def log_odds(self) -> float:
        """How likely it is beside the finding, nats."""
        return -moderate(self.delta, self.delta / self.z) if self.z else 0.0


def get_joint(cause: Cause) -> str | None:
    """Return where a cause sits; None for one of the whole rig."""
    return cause.place if cause.of_joint else None


def list_nearest(name: str, rivals: Iterable[Rival]) -> tuple[Rival, ...]:
    """Return the most probable rival of each name but a finding's own, in that order."""
    every = sorted(rivals, key=lambda one: -one.log_odds)
    best = {one.cause: one for one in reversed(every)}
    return tuple(one for one in every if one.cause != name and one is best[one.cause])


def find_credible(name: str, rivals: Iterable[Rival]) -> list[str]:
    """Return the fewest causes that hold a probability of `SURE` together, a finding's name first."""
    every = sorted(rivals, key=lambda one: -one.log_odds)
    held = np.cumsum([1.0, *np.exp([one.log_odds for one in every])])
    return [name, *(one.cause for one, before in zip(every, held) if before < SURE * held[-1])]


@dataclass(frozen=True)
class Finding:
    """One cause that the data show.

    Attributes:
        cause: Its name.
        joint: Where it sits; None for a cause of the whole rig.
        parameters: Its figures with standard deviations.
        gain: Held-out torque and rollout errors without and with it, at its joint.
        false_alarm: Bound on the probability that a log without it shows as much, by the test that found it.
        sentence: All of it for a person.
        experiment: What would part it from its rivals.
        rivals: The nearest other causes.
        blurred: Causes that no log of its range tells from it.
        visible_fraction: Share of its column that the rigid model and friction do not explain.
    """

    cause: str
    joint: str | None
    parameters: tuple[Parameter, ...]
    gain: Mapping[str, float]
    false_alarm: float
    sentence: str
    experiment: str = ""
    rivals: tuple[Rival, ...] = ()
    blurred: tuple[str, ...] = ()
    visible_fraction: float = 1.0

    __repr__ = brief

    @property
    def explained_share(self) -> float:
        """``1 - a²/b²``: share of its joint's held-out error power without it, b², that it removes."""
        return (
            1.0
            - (self.gain["torque_rmse_after"] / max(self.gain["torque_rmse_before"], 1e-300)) ** 2
        )

    @property
    def alike(self) -> tuple[str, ...]:
        """Every cause that this log cannot tell from it, itself first."""
        return tuple(dict.fromkeys((*find_credible(self.cause, self.rivals), *self.blurred)))

    @property
    def status(self) -> str:
        """Whether it is "named", or "ambiguous" as others are alike."""
        return "ambiguous" if len(self.alike) > 1 else "named"

    @property
    def sized(self) -> tuple[Parameter, ...]:
        """Figures that have a deviation."""
        return tuple(p for p in self.parameters if p.std == p.std)

    @property
    def unsized(self) -> tuple[Parameter, ...]:
        """Figures of which other sizes fit as well, and only together: all of them where none has a deviation."""
        return self.parameters if self.cause != MEASURED_CAUSE and not self.sized else ()

    @property
    def probabilities(self) -> tuple[tuple[str, str | None, float], ...]:
        """How probable it is that each cause is there: cause, joint and probability, the finding's own first.

        Of all that were fitted in its place, times `LISTED`: what is there may have a form that nobody fitted. What no
        log of this range tells from it shares its probability.
        """
        credible = find_credible(self.cause, self.rivals)
        own = [self.cause, *(name for name in self.alike if name not in credible)]
        odds = [(name, self.joint, 1.0 / len(own)) for name in own]
        odds += [
            (one.cause, one.joint, exp(one.log_odds)) for one in self.rivals if one.cause not in own
        ]
        share = LISTED * (1.0 - self.false_alarm) / sum(each for *_, each in odds)
        return tuple((name, joint, share * each) for name, joint, each in odds)

    @property
    def probability(self) -> float:
        """How probable it is that the cause is there."""
        return self.probabilities[0][2]

    def tell_from(self, name: str) -> Rival:
        """Return what the logs tell of it and a cause of its class: nothing where no log of their range can."""
        likely = find_credible(self.cause, self.rivals)
        return next(
            (one for one in self.rivals if one.cause == name in likely), Rival(name, 0.0, 0.0)
        )

    @property
    def open(self) -> str:
        """What else it may be, and how probably, in a sentence; nothing where it is named."""
        chances = {
            name: f" ({digits(100 * chance, 2)} %)" for name, _, chance in self.probabilities
        }
        others = ", ".join(f"{name}{chances.get(name, '')}" for name in self.alike[1:])
        return f"this log cannot tell it from {others}" if others else ""

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return {
            "cause": self.cause,
            "joint": self.joint,
            "status": self.status,
            "class": list(self.alike),
            "probability": self.probability,
            "parameters": describe_parameters(self.parameters),
            "gain": dict(self.gain),
            "explained_share": self.explained_share,
            "visible_fraction": self.visible_fraction,
            "rivals": [asdict(rival) for rival in self.rivals],
            "sentence": self.sentence,
            "next_experiment": self.experiment if self.open else None,
        }


@dataclass(frozen=True)
class Candidate:
    """A cause that was not accepted.

    Attributes:
        cause: Its name.
        joint: Where it sits, or None.
        at: The joint whose torque it changes most.
        before: Held-out torque error there without it, N m rms.
        after: The same with it.
    """

    cause: str
    joint: str | None
    at: str
    before: float
    after: float

    @property
    def sentence(self) -> str:
        """State its held-out gain."""
        change = 100 * (self.after / self.before - 1)
        errors = f"{digits(self.before, 2)} → {digits(self.after, 2)} N m ({change:+.0f} %)"
        return f"{self.cause} at {self.joint or 'the rig'} comes nearest: held-out torque error of {self.at} {errors}"


@dataclass(frozen=True)
class Slight:
    """A cause that is significant and too small to matter.

    Attributes:
        cause: Its name.
        joint: Where it sits, or None.
        share: What of the joint's torque it explains, rms over rms.
    """

    cause: str
    joint: str | None
    share: float


@dataclass(frozen=True)
class Untestable:
    """A cause that this log cannot show.

    Attributes:
        cause: Its name.
        joint: Where it would sit, or None.
        why: One clause.
    """

    cause: str
    joint: str | None
    why: str


@dataclass(frozen=True, eq=False)
class Diagnosis(Record):
    """The result of `diagnose`.

    Attributes:
        rig: The rig's name.
        logs: Names of the logs.
        verdict: "data" where faults spoil the logs, else "named", "ambiguous", "unknown" or "nothing".
        faults: What is wrong with the logs themselves.
        notes: Sentences about what of it does no harm.
        alignment: Mean delay of the torques behind their stamps, s: the hold of a sampled command and estimated shifts.
        before: The refitted model.
        after: The extended model.
        findings: Causes, the strongest first.
        residual: Joint → what is left after all findings.
        idle: Joints at rest, of which nothing is said.
        candidate: The cause that predicts held-out torque best where none was accepted; None: there is none.
        immaterial: Significant and too small to matter.
        untestable: What the logs cannot show.
        detection_limit: Joint → torque that would have been found, N m rms.
        stated: "torque_rmse", "fit_percent", "rollout_rmse": joint → figure, held out, of the rig as the URDF says.
        rubbing: The same of the URDF's bodies with the friction that was fitted.
        baseline: The same of the refitted model.
        extended: The same after all findings.
        held: The held-out part, or None where the logs are spoilt.
        given: What the logs say of the payload once the found causes are known; nothing where the logs are spoilt.
        state: What the search ended with on the training part; None where the logs are spoilt.
        planned: The motion that parts what is ambiguous, where `next_experiment` was asked for it.
        instead: Causes that were fitted in the findings' places.
        altered: Log → what was altered in it before anything was fitted, see `checks.check_log`.
        data: The logs.
        statements: Sentences about a whole log that stand before all findings and keep the verdict from *nothing*.
    """

    rig: str
    logs: tuple[str, ...]
    verdict: str = field(init=False)
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]
    alignment: float
    before: Model
    after: Model
    findings: tuple[Finding, ...] = ()
    residual: Mapping[str, Residual] = field(default_factory=dict)
    idle: tuple[str, ...] = ()
    candidate: Candidate | None = None
    immaterial: tuple[Slight, ...] = ()
    untestable: tuple[Untestable, ...] = ()
    detection_limit: Mapping[str, float] = field(default_factory=dict)
    stated: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    rubbing: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    baseline: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    extended: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    held: Evidence | None = None
    given: PayloadStatement = field(default_factory=PayloadStatement)
    state: State | None = None
    planned: NextExperiment | None = None
    instead: tuple[Cause, ...] = ()
    altered: Mapping[str, tuple[Alteration, ...]] = field(default_factory=dict)
    data: tuple[Log, ...] = ()
    statements: tuple[str, ...] = ()

    ROWS: ClassVar[str] = "findings"
    __repr__ = brief

    def save(self, path: str | Path) -> None:
        """Write the extended model as ``gimbal-pin diagnose -o`` does: `read_model`, ``tune``, ``studio`` take it."""
        write_extended(self.after, path)

    @property
    def spoiling(self) -> tuple[Fault, ...]:
        """Faults that make the physics unreliable."""
        return tuple(fault for fault in self.faults if fault.makes_physics_unreliable)

    @property
    def lacking(self) -> tuple[Finding, ...]:
        """Findings that `identify`'s model lacks: all but the motion that it has from the platform's IMU."""
        return tuple(finding for finding in self.findings if finding.cause != MEASURED_CAUSE)

    @property
    def stages(self) -> dict[str, Mapping[str, Mapping[str, float]]]:
        """Model → its held-out figures, each with more of what was fitted than the one before."""
        each = (self.stated, self.rubbing, self.baseline, self.extended)
        return dict(zip(("URDF", "friction found", "refitted", "extended"), each))

    @property
    def finds_payload(self) -> bool:
        """Whether a finding says what the payload has other than its URDF: then `given` would say it twice."""
        return any(one.cause.startswith("payload-") for one in self.findings)

    @property
    def is_extended(self) -> bool:
        """Whether the extended model has more than `identify`'s: findings, or a table of what nothing explains."""
        return bool(self.lacking) or any(left.curve for left in self.residual.values())

    def __post_init__(self) -> None:
        """Put the strongest finding first, and judge."""
        object.__setattr__(
            self, "findings", tuple(sorted(self.findings, key=lambda one: -one.explained_share))
        )
        object.__setattr__(self, "verdict", self.judge(self.findings))

    @property
    def verdict_without_platform(self) -> str:
        """The verdict over `lacking`: the platform's motion, which `identify` has from an IMU, does not count."""
        return self.judge(self.lacking)

    def judge(self, findings: Sequence[Finding]) -> str:
        """Return the verdict with some of the findings."""
        if self.spoiling:
            return "data"
        if findings:
            return "named" if any(one.status == "named" for one in findings) else "ambiguous"
        return "unknown" if self.unexplained or self.statements else "nothing"

    @property
    def opinions(self) -> dict[str, Opinion]:
        """Joint → state of its held-out torque after all findings; the simpler models are the URDF's."""
        if self.held is None:
            states = {"structured": Opinion.STRUCTURE_LEFT, "noise": Opinion.NOISE_LEFT}
            return {joint: states[left.state] for joint, left in self.residual.items()}
        used = dict(zip(self.held.rig.joints, self.held.used.tolist()))
        found = dict[str, Opinion]()
        for joint, left in self.residual.items():
            *simpler, _, extended = (
                errors["fit_percent"][joint] for errors in self.stages.values()
            )
            is_worse = any(is_degraded(extended, one) for one in simpler)
            structured = left.state == "structured"
            judged = 0.0 if joint in self.idle else used[joint]
            found[joint] = judge_joint(extended, judged, structured, structured, is_worse)
        return found

    @property
    def unexplained(self) -> list[str]:
        """Joints at which something is left that is not known to be noise."""
        return [joint for joint, state in self.opinions.items() if state.is_open]

    @property
    def deteriorations(self) -> list[str]:
        """Sentences about joints at which the fitted model is materially worse than a simpler one."""
        said = []
        for joint in self.unexplained if self.held is not None else ():
            *simpler, _, (_, extended) = (
                (model, each["fit_percent"][joint]) for model, each in self.stages.items()
            )
            model, fit = max(simpler, key=lambda one: one[1])
            if is_degraded(extended, fit):
                worse = digits(100 - extended, 2)
                better = digits(100 - fit, 2)
                said.append(
                    f"{joint}: fitting raises the held-out error from {better} % ({model}) to {worse} %"
                )
        return said

    @property
    def hidden(self) -> str:
        """What may hide in noise of more than a tenth of a joint's torque, a hundredth of its power; else nothing."""
        most = " and ".join(
            self.after.rig.in_units(
                joint, f"{digits(self.extended['torque_rmse'][joint], 2)} N m at {joint}"
            )
            for joint, state in self.opinions.items()
            if state is Opinion.NOISE_LEFT
        )
        return (
            f"the noise may hide up to {most} of what knocks, or has a form that nobody looks for"
            if most
            else ""
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds: what spoils the physics first, then the physics, then faults that were mended."""
        every = (one for finding in self.findings for one in finding.probabilities)
        likely = sorted((one for one in every if one[2] >= 0.01), key=lambda one: -one[2])
        return {
            "schema": 1,
            "rig": self.rig,
            "logs": list(self.logs),
            "verdict": self.verdict,
            "findings": [each.to_dict() for each in self.spoiling]
            + [each.to_dict() for each in self.findings]
            + [
                each.to_dict()
                for each in self.faults
                if not (each.makes_physics_unreliable or each.slight)
            ],
            "causes": [dict(zip(("cause", "joint", "probability"), one)) for one in likely],
            "notes": [*self.statements, *self.notes],
            "altered": list_alterations(self.altered),
            **{key: value or {} for key, value in self.given.to_dict().items()},
            "residual": {
                joint: {**asdict(left), "opinion": self.opinions[joint].value}
                for joint, left in self.residual.items()
            },
            "candidate": None if self.candidate is None else asdict(self.candidate),
            "probability_limit": LISTED,
            "cutoff_hz": None if self.held is None else self.held.band,
            "immaterial": [asdict(slight) for slight in self.immaterial],
            "alignment_s": self.alignment,
            "untestable": [asdict(row) for row in self.untestable],
            "detection_limit": self.detection_limit,
            "stated": self.stated,
            "rubbing": self.rubbing,
            "baseline": self.baseline,
            "extended": self.extended,
            "next_experiment": None if self.planned is None else self.planned.to_dict(),
        }
