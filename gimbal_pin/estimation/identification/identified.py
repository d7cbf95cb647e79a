"""The result of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.dynamics.regressor import columns
from gimbal_pin.effects import ALWAYS
from gimbal_pin.estimation import payload_change
from gimbal_pin.estimation.bodies import TRUST, Body, bodies
from gimbal_pin.estimation.estimators import Estimate
from gimbal_pin.estimation.hausman_check import Suspicion
from gimbal_pin.estimation.identification.judging import Accuracy
from gimbal_pin.estimation.identification.misfit import Misfit
from gimbal_pin.estimation.identification.warning import warnings
from gimbal_pin.estimation.rows import Filtering, camera_body, over_phi
from gimbal_pin.log.calibration import Mounting
from gimbal_pin.log.log import Array
from gimbal_pin.rig.consistency import Consistent
from gimbal_pin.rig.inertia import to_urdf
from gimbal_pin.rig.urdf import with_friction

MIXED = 1e-9
"""Share of a body's parameter in a base parameter under which that knows nothing of it."""


@dataclass(frozen=True, eq=False)
class Identified:
    """The result of `identify`.

    Attributes:
        model: The rig with the identified parameters, friction and effects, and their uncertainty.
        reduction: The base parameters.
        estimate: Parameters and covariance as estimated: base parameters first, then effects' coefficients.
        names: Names of the parameters.
        units: Their SI units.
        train: Accuracy on the rows that were fitted.
        held_out: Accuracy on rows that were not, or None.
        consistent: The most likely bodies, what a URDF is given, and how far the nearest are from the estimate.
        torque_change: Joint → rms change in predicted torque from the estimate to `consistent`, N m.
        logs: Names of the logs.
        filtering: The filter in force.
        given: Inertial parameters of the rig as it was given, (10 n,).
        mountings: Log → link → how its IMU sits there, where gyros and encoders could tell.
        notes: What of the logs was not used, in sentences.
        bias: Whether least squares is biased on these logs; None where that was not asked.
        parting: By how much the halves of the data differ, in shares of what chance allows, see
            `payload_change.apart`; above one they are of two rigs; None where that was not asked.
        bound: Least standard deviations that any unbiased estimate from the training rows has, (k,), see
            `estimators.colour.least`; None where the base did not turn, or that was not asked.
        trust: Relative deviation of the URDF's masses that the bodies' deviations stand on.
        faults: What the audit of the logs found, in sentences, see `warning.faults`.
        missed: Joint → what of its torque the model misses, see `misfit`.
        swapped: Whether the payload was changed for one that nobody has named: then its mass is not the rig's.
    """

    model: Model
    reduction: Reduction
    estimate: Estimate
    names: tuple[str, ...]
    units: tuple[str, ...]
    train: Accuracy
    held_out: Accuracy | None
    consistent: Consistent
    torque_change: Mapping[str, float]
    logs: tuple[str, ...]
    filtering: Filtering
    given: Array
    mountings: Mapping[str, Mapping[str, Mounting]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    bias: Suspicion | None = None
    parting: float | None = None
    bound: Array | None = None
    trust: float = TRUST
    swapped: bool = False
    missed: Mapping[str, Misfit] = field(default_factory=dict)
    faults: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """A few lines: what was estimated, from what, and how well it predicts; `text.identified` has the table."""
        rig = self.model.rig
        mounted = f" with {rig.payload}" if rig.payload else ""
        head = (
            f"{rig.name}{mounted}: {len(self.names)} parameters by {self.estimate.method} from {', '.join(self.logs)}"
        )
        parts = [str(part) for part in (self.train, self.held_out) if part is not None]
        notes = [*(f"warning: {said}" for said in self.warnings), *(f"note: {said}" for said in self.notes)]
        return "\n".join(
            [head, *parts, *notes, "names, estimate, bodies, model, to_dict() and to_urdf() hold the rest"]
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What has to be known before the parameters are read, in sentences, see `warning.warnings`."""
        return tuple(warnings(self))

    @property
    def physical(self) -> bool:
        """Whether bodies exist that have the estimated base parameters, to a thousandth of their deviation."""
        return self.consistent.distance < 1e-3 * np.sqrt(len(self.reduction.independent))

    @property
    def bodies(self) -> tuple[Body, ...]:
        """Mass, centre of mass and inertia of the nearest physical bodies, with their deviations."""
        width, rig = len(self.reduction.independent), self.model.rig
        covariance = self.estimate.covariance[:width, :width]
        mixing = over_phi(rig, self.reduction)
        return bodies(rig.links, self.given, self.consistent.phi, mixing, covariance, self.trust)

    @property
    def stated(self) -> Array:
        """The URDF's value of every parameter, (k,); NaN for what it does not state, as of an unknown payload."""
        rig, names = self.model.rig, [kind.name for kind in ALWAYS]
        base = self.reduction.mixing @ self.given[columns(rig)[1]]
        if self.swapped:
            mine = slice(10 * camera_body(rig), 10 * camera_body(rig) + 10)
            base = np.where(np.any(np.abs(over_phi(rig, self.reduction)[:, mine]) > MIXED, axis=1), np.nan, base)
        others = np.full(len(self.names) - len(base), np.nan)
        at = 0
        for term in self.model.terms:
            if term.effect.name in names:
                others[at] = rig.friction[rig.joint_index(term.effect.joint), names.index(term.effect.name)]
            at += len(term.values)
        return np.concatenate([base, others])

    @property
    def torn(self) -> bool:
        """Whether the halves of the data were found to be of two rigs, so that nothing of this is of either."""
        return payload_change.sentence(len(self.logs)) in self.notes

    @property
    def moved(self) -> Array:
        """``(value - stated) / std``, (k,): by how many of its deviations each differs from the URDF; NaN without."""
        std = self.estimate.std
        return (self.estimate.theta - self.stated) / np.where(std > 0, std, np.nan)

    def to_urdf(self) -> str:
        """Return the rig's URDF with the nearest physical inertias and the identified friction; other tags are kept."""
        model = self.model
        values = {(term.effect.joint, term.effect.name): term.values[0] for term in model.terms}
        names = [kind.name for kind in ALWAYS]
        friction = {joint: (values[joint, names[0]], values[joint, names[1]]) for joint in model.rig.joints}
        return with_friction(to_urdf(model.rig, self.consistent.phi), friction)

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds (CONTRACT, `identify`)."""
        told = (self.estimate.theta, self.estimate.std, self.stated, self.moved)
        rows = zip(self.names, self.units, *(x.tolist() for x in told))
        return {
            "schema": 1,
            "rig": self.model.rig.name,
            "payload": self.model.rig.payload,
            "logs": list(self.logs),
            "estimator": self.estimate.method,
            "uncertainty": self.estimate.uncertainty,
            "samples": self.estimate.rows,
            "condition_number": self.estimate.condition_number,
            "base_motion": self.reduction.base,
            "cutoff_hz": self.filtering.cutoff,
            "imus": {
                log: {link: mounting.to_dict() for link, mounting in links.items()}
                for log, links in self.mountings.items()
            },
            "warnings": list(self.warnings),
            "notes": list(self.notes),
            "physical": self.physical,
            "consistent": {"distance": self.consistent.distance, "torque_change_rms": dict(self.torque_change)},
            "base_parameters": [
                {"name": name, "value": x, "std": s, "unit": unit, "urdf": number(given), "deviations": number(z)}
                for name, unit, x, s, given, z in rows
            ],
            "least_std": None if self.bound is None else dict(zip(self.names, self.bound.tolist())),
            "trust": self.trust,
            "bodies": [body.to_dict() for body in self.bodies],
            "train": asdict(self.train),
            "held_out": None if self.held_out is None else asdict(self.held_out),
            "misfit": {joint: {"torque_rms": one.size, "noise_rms": one.noise} for joint, one in self.missed.items()},
            "halves_apart": self.parting,
            "least_squares": None if self.bias is None else self.bias.to_dict(),
        }


def number(value: float) -> float | None:
    """Return a number as JSON holds it: null where there is none."""
    return value if np.isfinite(value) else None
