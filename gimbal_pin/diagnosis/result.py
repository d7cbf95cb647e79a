"""What `diagnose` says: findings, what was left, and what the log could not show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import Any

import numpy as np
from scipy.stats import norm

from gimbal_pin.checks import Alteration, Fault, list_alterations
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import Extended
from gimbal_pin.diagnosis.likeness import Likeness
from gimbal_pin.diagnosis.parting import NextExperiment
from gimbal_pin.diagnosis.probability import SURE, moderate
from gimbal_pin.diagnosis.state import State
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.identification import PayloadStatement
from gimbal_pin.rig.brief import brief

MEASURED = "platform-motion"
"""The cause that a sensor measures, so that every model has it that is made of such a log."""
NOISY = 0.1
"""Share of a joint's torque from which it is told what may hide in the noise that is left: under it that has less than
a hundredth of the torque's power."""
IMPROBABLE = 0.01
"""Probability under which a cause is not listed."""
TOGETHER = "only together; other sizes fit this log as well"
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

    @property
    def sentence(self) -> str:
        """What is left, and where."""
        return f"{self.state} {self.where}".strip()


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


def find_credible(name: str, rivals: Sequence[Rival]) -> list[str]:
    """Return the fewest causes that hold a probability of `SURE` together, a finding's name first."""
    odds = [1.0, *(float(np.exp(one.log_odds)) for one in rivals)]
    names, held = [name], odds[0]
    for one, of_it in sorted(zip(rivals, odds[1:]), key=lambda pair: -pair[1]):
        if held >= SURE * sum(odds):
            break
        names.append(one.cause)
        held += of_it
    return names


@dataclass(frozen=True)
class Finding:
    """One cause that the data show.

    Attributes:
        cause: Its name.
        joint: Where it sits; None for a cause of the whole rig.
        status: "named", "ambiguous" or "data".
        alike: Every cause that this log cannot tell from it, itself first.
        parameters: Its figures with standard deviations.
        gain: Held-out torque and rollout errors without and with it, at its joint.
        p_value: Chance that a log without it shows as much anywhere in the library.
        explained_share: Share of the baseline's held-out residual power that it removes; one where it removes more,
            of a model whose other findings only fit beside it.
        visible_fraction: Share of its column that the rigid model and friction do not explain.
        rivals: The nearest other causes.
        sentence: All of it for a person.
        next_experiment: What would part it from its rivals, or None.
    """

    cause: str
    joint: str | None
    status: str
    alike: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    gain: Mapping[str, float]
    p_value: float
    explained_share: float
    visible_fraction: float
    rivals: tuple[Rival, ...]
    sentence: str
    next_experiment: str | None

    __repr__ = brief

    @property
    def sized(self) -> tuple[Parameter, ...]:
        """Figures that have a deviation."""
        return tuple(p for p in self.parameters if p.std == p.std)

    @property
    def unsized(self) -> tuple[Parameter, ...]:
        """Figures of which other sizes fit as well, and only together: all of them where none has a deviation."""
        return self.parameters if self.cause != MEASURED and not self.sized else ()

    @property
    def probabilities(self) -> tuple[tuple[str, str | None, float], ...]:
        """How probable it is that each cause is there: cause, joint and probability, the finding's own first.

        Of all that were fitted in its place; what no log of this range tells from it shares its probability.
        """
        credible = find_credible(self.cause, self.rivals)
        hidden = [name for name in self.alike if name not in credible]
        apart = [one for one in self.rivals if one.cause not in hidden]
        odds = np.array([*np.ones(1 + len(hidden)) / (1 + len(hidden)), *(np.exp(one.log_odds) for one in apart)])
        names = [(self.cause, self.joint), *((name, self.joint) for name in hidden)]
        chances = (1.0 - self.p_value) * odds / odds.sum()
        places = [*names, *((one.cause, one.joint) for one in apart)]
        return tuple((name, joint, chance) for (name, joint), chance in zip(places, chances.tolist()))

    @property
    def probability(self) -> float:
        """How probable it is that the cause is there."""
        return self.probabilities[0][2]

    def tell_from(self, name: str) -> Rival:
        """Return what the logs tell of it and a cause of its class: nothing where no log of their range can."""
        likely = find_credible(self.cause, self.rivals)
        return next((one for one in self.rivals if one.cause == name in likely), Rival(name, 0.0, 0.0))

    @property
    def open(self) -> str:
        """What else it may be, and how probably, in a sentence; nothing where it is named."""
        chances = {name: f" ({digits(100 * chance, 2)} %)" for name, _, chance in self.probabilities}
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
            "parameters": {
                p.name: {"value": p.value, "std": p.std if isfinite(p.std) else None, "unit": p.unit}
                for p in self.parameters
            },
            "gain": dict(self.gain),
            "p_value": self.p_value,
            "selection_frequency": min((float(norm.cdf(one.z)) for one in self.rivals), default=1.0),
            "explained_share": self.explained_share,
            "visible_fraction": self.visible_fraction,
            "rivals": [asdict(rival) for rival in self.rivals],
            "sentence": self.sentence,
            "next_experiment": self.next_experiment,
        }


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
class Diagnosis:
    """The result of `diagnose`.

    Attributes:
        rig: The rig's name.
        logs: Names of the logs.
        verdict: "named", "ambiguous", "unknown", "nothing" or "data".
        faults: What is wrong with the logs themselves.
        notes: Sentences about what of it does no harm.
        findings: Causes, the strongest first.
        residual: Joint → what is left after all findings.
        immaterial: Significant and too small to matter.
        untestable: What the logs cannot show.
        detection_limit: Joint → torque that would have been found, N m rms.
        alignment: Hold of the sampled command, s.
        baseline: "torque_rmse", "fit_percent", "rollout_rmse": joint → figure, held out, before.
        extended: The same after all findings.
        before: The refitted model.
        after: The extended model.
        held: The held-out part, or None where the logs are spoilt.
        given: What the logs say of the payload once the found causes are known; nothing where the logs are spoilt.
        state: What the search ended with on the training part; None where the logs are spoilt.
        planned: The motion that parts what is ambiguous, where `next_experiment` was asked for it.
        tracking: Joint → "rms_before", "rms_after": simulated tracking error without and with the found causes
            compensated, rad; empty where nothing was found or is carried.
        likeness: For every finding, which other causes look like it on these logs.
        instead: Causes that were fitted in the findings' places.
        seed: Repeats it as `rng`; None where a generator was given.
        altered: Log → what was altered in it before anything was fitted, see `checks.check_log`.
    """

    rig: str
    logs: tuple[str, ...]
    verdict: str
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]
    findings: tuple[Finding, ...]
    residual: Mapping[str, Residual]
    immaterial: tuple[Slight, ...]
    untestable: tuple[Untestable, ...]
    detection_limit: Mapping[str, float]
    alignment: float
    baseline: Mapping[str, Mapping[str, float]]
    extended: Mapping[str, Mapping[str, float]]
    before: Extended
    after: Extended
    held: Evidence | None = None
    given: PayloadStatement = field(default_factory=PayloadStatement)
    state: State | None = None
    planned: NextExperiment | None = None
    tracking: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    likeness: tuple[Likeness, ...] = ()
    instead: tuple[Cause, ...] = ()
    seed: int | None = None
    altered: Mapping[str, tuple[Alteration, ...]] = field(default_factory=dict)

    __repr__ = brief

    @property
    def spoiling(self) -> tuple[Fault, ...]:
        """Faults that make the physics unreliable."""
        return tuple(fault for fault in self.faults if fault.makes_physics_unreliable)

    @property
    def lacking(self) -> tuple[Finding, ...]:
        """Findings that `identify`'s model lacks: all but the motion that it has from the platform's IMU."""
        return tuple(finding for finding in self.findings if finding.cause != MEASURED)

    @property
    def is_extended(self) -> bool:
        """Whether the extended model has more than `identify`'s: findings, or a table of what nothing explains."""
        return bool(self.lacking) or any(left.curve for left in self.residual.values())

    @property
    def beside(self) -> str:
        """The verdict without what that model has."""
        statuses = [finding.status for finding in self.lacking]
        return overall(statuses, tuple(self.residual.values())) if self.lacking != self.findings else self.verdict

    @property
    def model(self) -> Model:
        """The extended model."""
        return self.after.model

    @property
    def noisy(self) -> dict[str, float]:
        """Joint → noise that is left, N m rms, of joints at which that is over `NOISY` of the torque."""
        after, fit = (self.extended.get(name, {}) for name in ("torque_rmse", "fit_percent"))
        noise = (joint for joint, left in self.residual.items() if left.state == "noise")
        return {joint: after[joint] for joint in noise if fit[joint] < 100 * (1 - NOISY)}

    @property
    def hidden(self) -> str:
        """What may hide in that noise, in a sentence; nothing where there is none."""
        sizes = {
            joint: (digits(noise, 2), self.after.model.rig.in_units(joint, "N m"))
            for joint, noise in self.noisy.items()
        }
        most = " and ".join(f"{size} {unit} at {joint}" for joint, (size, unit) in sizes.items())
        return f"the noise may hide up to {most} of what knocks, or has a form that nobody looks for" if most else ""

    def list_causes(self) -> list[dict[str, Any]]:
        """Return every cause that is not improbable, with its joint and probability, as JSON holds it."""
        every = (one for finding in self.findings for one in finding.probabilities)
        likely = sorted((one for one in every if one[2] >= IMPROBABLE), key=lambda one: -one[2])
        return [dict(zip(("cause", "joint", "probability"), one)) for one in likely]

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds: what spoils the physics first, then the physics, then faults that were mended."""
        return {
            "schema": 1,
            "rig": self.rig,
            "logs": list(self.logs),
            "verdict": self.verdict,
            "findings": [each.to_dict() for each in self.spoiling]
            + [each.to_dict() for each in self.findings]
            + [each.to_dict() for each in self.faults if not (each.makes_physics_unreliable or each.slight)],
            "causes": self.list_causes(),
            "notes": list(self.notes),
            "altered": list_alterations(self.altered),
            **{key: value or {} for key, value in self.given.to_dict().items()},
            "residual": {joint: asdict(left) for joint, left in self.residual.items()},
            "immaterial": [asdict(slight) for slight in self.immaterial],
            "alignment_s": self.alignment,
            "untestable": [asdict(row) for row in self.untestable],
            "detection_limit": dict(self.detection_limit),
            "baseline": {key: dict(value) for key, value in self.baseline.items()},
            "extended": {key: dict(value) for key, value in self.extended.items()},
            "next_experiment": None if self.planned is None else self.planned.to_dict(),
            "tracking": {
                joint: {key: value if isfinite(value) else None for key, value in row.items()}
                for joint, row in self.tracking.items()
            },
            "look_alikes": [each.to_dict() for each in self.likeness],
        }


def overall(statuses: Sequence[str], residual: Sequence[Residual]) -> str:
    """The verdict on the physics: named before ambiguous, unknown before nothing."""
    if "named" in statuses:
        return "named"
    if "ambiguous" in statuses:
        return "ambiguous"
    return "unknown" if any(left.state == "structured" for left in residual) else "nothing"
