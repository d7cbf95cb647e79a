"""Result of a diagnosis: findings, what is left, and the errors of the models before and after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gimbal_pin.checks import Alteration, Fault, describe_parameters, list_alterations
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.given_model import state_payload_with_causes
from gimbal_pin.diagnosis.held_out import HeldOut
from gimbal_pin.diagnosis.planning import NextExperiment
from gimbal_pin.diagnosis.visibility import (
    Untestable,
    compute_detection_limits,
    list_untestable,
)
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Cause, Term
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.identification import PayloadStatement
from gimbal_pin.identification.model_file import write_extended
from gimbal_pin.identification.validation import Opinion, is_degraded, judge_joint
from gimbal_pin.log.log import Log
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief

if TYPE_CHECKING:
    from pandas import DataFrame

MEASURED_CAUSE = "platform-motion"
"""Cause that a sensor measures: `identify` has it as well, given a log with that sensor."""


@dataclass(frozen=True)
class Rival:
    """Another cause that was fitted in place of a finding.

    Attributes:
        cause: Its name.
        nats: Gain by which it predicts worse than the finding.
        std: Standard error of that, nats.
        probability: Its probability among the finding and all rivals.
    """

    cause: str
    nats: float
    std: float
    probability: float


@dataclass(frozen=True, eq=False)
class Finding:
    """A cause that the data show.

    Attributes:
        cause: Name of the cause.
        joint: Its joint; None: the whole rig.
        status: "named"; "ambiguous": others predict equally well; "unconfirmed": it explains too little of what is
            predictable at its joint to be stated as the cause, and is not in the extended model.
        alike: Names of the causes that this log cannot tell from it, itself first.
        probability: Its probability among itself and all rivals.
        parameters: Its sizes with standard deviations.
        nats: Held-out gain, nats.
        std: Standard error of the gain, nats.
        at: Joint whose torque error is stated: its own, or the one that it changes most.
        before: Held-out torque error there without it, N m rms.
        after: The same with it.
        share: Share of the predictable error power at that joint that it explains.
        rivals: The best form of every other cause there, the nearest first.
        physical: Term or cause that the extended model holds; None: nothing.
    """

    cause: str
    joint: str | None
    status: str
    alike: tuple[str, ...]
    probability: float
    parameters: tuple[Parameter, ...]
    nats: float
    std: float
    at: str
    before: float
    after: float
    share: float
    rivals: tuple[Rival, ...] = ()
    physical: Term | Cause | None = None

    __repr__ = brief

    @property
    def is_stated(self) -> bool:
        """True if it is stated as a cause, alone or with others."""
        return self.status != "unconfirmed"

    @property
    def sized(self) -> tuple[Parameter, ...]:
        """Parameters that have a standard deviation."""
        return tuple(p for p in self.parameters if p.std == p.std)

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as JSON holds it; sentences are added by the command line."""
        return {
            "cause": self.cause,
            "joint": self.joint,
            "status": self.status,
            "class": list(self.alike),
            "probability": self.probability,
            "parameters": describe_parameters(self.parameters),
            "gain": {
                "nats": self.nats,
                "std": self.std,
                "joint": self.at,
                "torque_rmse_before": self.before,
                "torque_rmse_after": self.after,
            },
            "explained_share": self.share,
            "rivals": [asdict(rival) for rival in self.rivals],
        }


@dataclass(frozen=True)
class Residual:
    """Torque that is left at a joint after all findings.

    Attributes:
        state: "noise", or "structured" where too much of it is predictable.
        left: Held-out torque error, N m rms.
        noise_floor: What no function of motion and load predicts, N m rms.
        predictable: What the best flexible model predicts of `left`, N m rms.
        over: What it depends on, as a group of functions; "": nothing.
    """

    state: str
    left: float
    noise_floor: float
    predictable: float
    over: str = ""


@dataclass(frozen=True)
class Slight:
    """A cause that is significant and too small to matter.

    Attributes:
        cause: Its name.
        joint: Its joint; None: the whole rig.
        share: Torque that it explains, as a share of its joint's, rms over rms.
    """

    cause: str
    joint: str | None
    share: float


@dataclass(frozen=True)
class Candidate(Slight):
    """The cause that comes nearest where none was accepted.

    Attributes:
        nats: Its held-out gain, nats.
    """

    nats: float


@dataclass(frozen=True, eq=False)
class Diagnosis(Record):
    """Result of `diagnose`.

    Attributes:
        rig: Name of the rig.
        logs: Names of the logs.
        verdict: "data" where the logs are at fault; "named", "ambiguous", "unknown" or "nothing".
        faults: What is wrong with the logs.
        notes: Remarks on the logs and on what was done with them.
        statements: Remarks on all of the logs that stand before the findings and keep the verdict from "nothing".
        before: The refitted model: rigid bodies, dry and viscous friction.
        after: The extended model: with the findings that are stated.
        findings: Causes, the strongest first; unconfirmed ones are not in the extended model.
        residual: Joint → what is left after all findings.
        idle: Joints at rest, of which nothing is said.
        candidate: The cause that comes nearest where none was accepted; None: there is none.
        immaterial: Causes that are significant and too small to matter.
        alignment: Joint → time by which its torque acts later than logged, s.
        held_out: Errors of URDF, refitted and extended model on the same rows; None: the logs are spoilt.
        mass: Mass of the payload where it was weighed, kg.
        explanation: The search's models and rows; None: the logs are spoilt.
        planned: The motion that separates what is ambiguous, where `next_experiment` was asked for it.
        altered: Log → what was altered in it before anything was fitted.
        data: The logs.
    """

    rig: str
    logs: tuple[str, ...]
    verdict: str
    before: Model
    after: Model
    faults: tuple[Fault, ...] = ()
    notes: tuple[str, ...] = ()
    statements: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    residual: Mapping[str, Residual] = field(default_factory=dict)
    idle: tuple[str, ...] = ()
    candidate: Candidate | None = None
    immaterial: tuple[Slight, ...] = ()
    alignment: Mapping[str, float] = field(default_factory=dict)
    held_out: HeldOut | None = None
    mass: float | None = None
    explanation: Explanation | None = None
    planned: NextExperiment | None = None
    altered: Mapping[str, tuple[Alteration, ...]] = field(default_factory=dict)
    data: tuple[Log, ...] = ()

    ROWS: ClassVar[str] = "findings"
    __repr__ = brief

    @check_arguments
    def save(self, path: str | Path) -> None:
        """Write the extended model, which `read_model`, ``tune``, ``track`` and ``studio`` read."""
        write_extended(self.after, path)

    @property
    def errors(self) -> DataFrame:
        """Table of the held-out errors, a row per joint and model; without rows where the logs are spoilt.

        Columns: joint; model: urdf, refitted or extended; torque_rmse, N m (N of a slide); fit_percent, see `Errors`.
        """
        import pandas as pd

        stages = {} if self.held_out is None else self.held_out.stages
        rows = [
            (joint, model.lower(), rmse, one.fit_percent[joint])
            for model, one in stages.items()
            for joint, rmse in one.torque_rmse.items()
        ]
        return pd.DataFrame(rows, columns=["joint", "model", "torque_rmse", "fit_percent"])

    @cached_property
    def untestable(self) -> tuple[Untestable, ...]:
        """Causes that the logs cannot show."""
        if self.explanation is None:
            return ()
        return list_untestable(self.explanation, [(one.cause, one.joint) for one in self.findings])

    @cached_property
    def detection_limit(self) -> Mapping[str, float]:
        """Joint → torque that would have been found, N m rms."""
        return {} if self.explanation is None else compute_detection_limits(self.explanation)

    @cached_property
    def given(self) -> PayloadStatement:
        """Statement on the payload against its URDF; empty where the logs are spoilt.

        Raises:
            UsageError: The mass is far from the stated one.
        """
        if self.explanation is None:
            return PayloadStatement()
        return state_payload_with_causes(self.explanation, self.after, self.mass)

    @property
    def spoiling(self) -> tuple[Fault, ...]:
        """Faults that make the physics unreliable."""
        return tuple(fault for fault in self.faults if fault.makes_physics_unreliable)

    @property
    def stated(self) -> tuple[Finding, ...]:
        """Findings that are named or ambiguous."""
        return tuple(finding for finding in self.findings if finding.is_stated)

    @property
    def lacking(self) -> tuple[Finding, ...]:
        """Stated findings that `identify`'s model lacks: all but the platform's motion, which an IMU measures."""
        return tuple(finding for finding in self.stated if finding.cause != MEASURED_CAUSE)

    @property
    def is_silent(self) -> bool:
        """True if nothing is found and nothing is left but the motion that an IMU measures."""
        if self.verdict != "named":
            return self.verdict == "nothing"
        return not (self.lacking or self.unexplained or self.statements)

    @property
    def unexplained(self) -> list[str]:
        """Joints at which something predictable is left, or which fitting made worse."""
        return [joint for joint, opinion in self.opinions.items() if opinion.is_open]

    @property
    def opinions(self) -> dict[str, Opinion]:
        """Joint → opinion on its held-out torque after all findings."""
        if self.held_out is None:
            return {}
        opinions = dict[str, Opinion]()
        for joint, left in self.residual.items():
            fit = self.held_out.extended.fit_percent[joint]
            used = 0.0 if joint in self.idle else self.held_out.used[joint]
            is_structured = left.state == "structured"
            is_worse = joint in self.deteriorations
            opinions[joint] = judge_joint(fit, used, is_structured, is_structured, is_worse)
        return opinions

    @property
    def deteriorations(self) -> dict[str, str]:
        """Joint at which the extended model is materially worse than a simpler one → name of the best model."""
        worse = dict[str, str]()
        stages = {} if self.held_out is None else self.held_out.stages
        for joint in self.residual if stages else ():
            fits = {name: errors.fit_percent[joint] for name, errors in stages.items()}
            best = max(fits, key=lambda name: fits[name])
            if joint not in self.idle and is_degraded(fits["extended"], fits[best]):
                worse[joint] = best
        return worse

    @property
    def finds_payload(self) -> bool:
        """True if a finding states a payload other than the URDF's, so that `given` would state it twice."""
        return any(finding.cause.startswith("payload-") for finding in self.stated)

    def to_dict(self) -> dict[str, Any]:
        """Return the diagnosis as JSON holds it, schema 2: faults that spoil the logs stand before the physics."""
        mended = [x for x in self.faults if not (x.makes_physics_unreliable or x.slight)]
        findings = [
            *(fault.to_dict() for fault in self.spoiling),
            *(finding.to_dict() for finding in self.findings),
            *(fault.to_dict() for fault in mended),
        ]
        given = replace(self.given, apart=None) if self.finds_payload else self.given
        return {
            "schema": 2,
            "rig": self.rig,
            "logs": list(self.logs),
            "verdict": self.verdict,
            "findings": findings,
            "residual": {
                joint: {**asdict(left), "opinion": self.opinions[joint].value}
                for joint, left in self.residual.items()
            },
            "candidate": None if self.candidate is None else asdict(self.candidate),
            "immaterial": [asdict(one) for one in self.immaterial],
            "alignment_s": dict(self.alignment),
            "untestable": [asdict(one) for one in self.untestable],
            "detection_limit": dict(self.detection_limit),
            "held_out": None if self.held_out is None else self.held_out.to_dict(),
            **{key: value or {} for key, value in given.to_dict().items()},
            "next_experiment": None if self.planned is None else self.planned.to_dict(),
            "notes": [*self.statements, *self.notes],
            "altered": list_alterations(self.altered),
        }
