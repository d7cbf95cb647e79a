"""The result of an identification: model, accuracy, and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from gimbal_pin.checks import Alteration, CheckedLog, Mounting, check_log, list_alterations
from gimbal_pin.checks.calibration import correct_imus
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.dynamics.regressor import name_columns
from gimbal_pin.effects import ALWAYS, PLAIN, Effect, Parameter
from gimbal_pin.errors import (
    NORMAL_95,
    DataError,
    UsageError,
    digits,
    finite_or_none,
    format_estimate,
)
from gimbal_pin.identification.agreement import Agreement
from gimbal_pin.identification.bias_test import BiasCheck
from gimbal_pin.identification.bodies import Body, estimate_bodies
from gimbal_pin.identification.validation import Accuracy, Opinion, is_degraded
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    TRUST,
    Design,
    Estimate,
    Filtering,
    Misfit,
    find_moving_base,
    map_phi_to_base,
    split_segments,
)
from gimbal_pin.regression.consistency import Consistent
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.inertia import to_urdf
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator
from gimbal_pin.rig.urdf import replace_friction

if TYPE_CHECKING:
    from pandas import DataFrame

NEGATIVE_FROM = 3.0
"""Deviations under zero from which a parameter that cannot be negative is said to be: one in 700 is by chance."""
MASKED_FROM = 0.5
"""Share of a joint's samples that may be masked out before the rest are no longer the log."""
POSITIVE = ("Ixx", "Iyy", "Izz", "m", "Ia")
"""Parameters of a body that no body has negative; a sum of them is not either."""
LARGE_REST = 0.1
"""Least share of every joint's torque that is unexplained, for a cause to be sought outside of the joints; at twice
that, a base that moves half as much is not mentioned."""
OVER_NOISE = 5.0
"""Unexplained torque over that of the sensors' noise in the same band, of torque or acceleration: none is by chance.
At twice that, logs of drives with noisy currents are not judged."""


def describe_faults(checked: Sequence[CheckedLog]) -> tuple[str, ...]:
    """Say what is wrong with logs, worst fault first."""
    found = [(one.log.name, fault) for one in checked for fault in one.faults]
    worst_first = sorted(found, key=lambda each: not each[1].makes_physics_unreliable)
    serious = [(name, fault) for name, fault in worst_first if not fault.slight]
    return tuple(
        f"{name + ': ' if len(checked) > 1 else ''}{fault.sentence}; {fault.next_experiment}"
        for name, fault in serious
    )


def _iterate_warnings(found: IdentificationResult) -> Iterator[str]:
    """Yield what does not hold, which joints are not explained, the logs' faults, then what else is wrong."""
    yield from map(str, found.model.doubts)
    yield from _iterate_unexplained(found)
    yield from _iterate_common_residual(found)
    yield from found.faults
    yield from _iterate_negative(found)
    if found.held_out is not None:
        said = {doubt.joint for doubt in found.model.doubts if doubt.unsafe}
        for joint, fit in found.held_out.fit_percent.items():
            if fit < 0 and joint not in said:
                what = f"the model predicts the held-out torque worse than its mean does (fit {digits(fit, 2)} %)"
                yield f"{joint}: {what}: it holds for nothing but the logs that it was fitted to"
    for joint, used in found.train.used.items():
        if used < 1 - MASKED_FROM:
            what = "near standstill, where dry friction is unknown, and left out"
            yield f"{joint}: {100 * (1 - used):.0f} % of the samples are {what}: the parameters are of the rest"


def _iterate_unexplained(found: IdentificationResult) -> Iterator[str]:
    """Yield the joints whose torque follows from their motion in a way that the model does not hold."""
    for joint, opinion in found.opinions.items():
        if opinion is not Opinion.NOT_EXPLAINED:
            continue
        judged = found.held_out or found.train
        fit = judged.fit_percent[joint]
        parts = [
            f"the model fits the {judged.how} up to {found.filtering.cutoff:g} Hz to {digits(fit, 2)} %"
        ]
        others = [(one.how, one.fit_percent[joint]) for one in found.simpler]
        parts += [
            f"{how} fits it to {digits(other, 2)} %"
            for how, other in others
            if is_degraded(fit, other)
        ]
        unit = found.model.rig.in_units(joint, "N m")
        if (size := found.missed[joint].size) > 0:
            parts.append(
                f"{digits(size, 2)} {unit} rms are a function of its motion that the model lacks"
            )
        yield f"{joint} is {opinion.value}: {', '.join(parts)}; run 'gimbal-pin diagnose'"


def _iterate_common_residual(found: IdentificationResult) -> Iterator[str]:
    """Yield what `describe_common_residual` says of the rows that were fitted, where the motion's noise was judged."""
    rig = found.model.rig
    train = found.train
    if found.bias is None:
        return
    noise = np.zeros(rig.n)
    for log in found.data:
        gain = signals.compute_noise_gain(
            signals.lowpass(found.filtering.cutoff, 1 / log.dt), 1 / log.dt, 0
        )
        noise = np.maximum(noise, gain * signals.jumping_noise_std(np.asarray(log.tau)))
    rest = np.array([train.torque_rmse[joint] for joint in rig.joints])
    size = np.array(
        [found.missed[joint].size if joint in found.missed else np.inf for joint in rig.joints]
    )
    share = 1.0 - max(train.fit_percent.values()) / 100.0
    if share > OVER_NOISE * found.bias.noise:
        yield from describe_common_residual(rig, found.data, share, rest, noise, size)


def describe_common_residual(
    rig: Rig, logs: Sequence[Log], share: float, rest: Array, noise: Array, size: Array
) -> tuple[str, ...]:
    """Return a sentence where most of every joint's rest is neither sensors' noise nor a function of its motion.

    A base that moves does that if its IMU is not in the logs; a log of the joints alone cannot tell it from contact.

    Args:
        rig: The rig.
        logs: What was recorded.
        share: Least share of a joint's torque that is left.
        rest: What is left, N m rms, (n,).
        noise: What the sensors' noise leaves in the same band, N m rms, (n,).
        size: What a function of the joint's motion predicts of the rest, N m rms, (n,).
    """
    if rig.n < 2 or any(rig.base in log.imus for log in logs) or not share > LARGE_REST:
        return ()
    if not (np.all(rest > OVER_NOISE * noise) and np.all(2.0 * size**2 < rest**2)):
        return ()
    what = f"{digits(100 * share, 2)} % or more of every joint's torque are neither noise nor a function of its motion"
    mend = f"if the base moved, log its IMU (gyro_{rig.base}_x, accel_{rig.base}_x, …)"
    return (f"{what} that was found: {mend}; else look for contact, or for what changes with time",)


def _iterate_negative(found: IdentificationResult) -> Iterator[str]:
    """Yield the friction and the moments of inertia that are significantly under zero; then those that only may be.

    A value under zero that its deviation explains is a value that the logs do not determine.
    """
    sums = (
        all(factor > 0 and name.rsplit(".", 1)[1] in POSITIVE for name, factor in terms.items())
        for terms in found.reduction.terms
    )
    positive = ["no body has such an inertia" if only else "" for only in sums]
    coefficients = (
        (term.effect, c) for term in found.model.terms for c in term.effect.coefficients
    )
    positive += [_say_why_positive(effect, c) for effect, c in coefficients]
    rows = zip(
        found.names,
        positive,
        found.estimate.theta.tolist(),
        found.estimate.std.tolist(),
        found.units,
    )
    vague = []
    for name, why, value, std, unit in rows:
        figure = f"{format_estimate(value, std, 2)} {unit}"
        if why and value < -NEGATIVE_FROM * std:
            yield f"{name} is negative ({figure}), and {why}: something else acts there, see 'gimbal-pin diagnose'"
        elif why and value < 0:
            vague.append(f"{name} ({figure})")
    if vague:
        yield f"undetermined, for their values are under zero and no such thing exists: {', '.join(vague)}"


def _say_why_positive(effect: Effect, coefficient: Parameter) -> str:
    """Say why a coefficient cannot be negative; nothing where it can."""
    if coefficient.lower < 0:
        return ""
    return "no rotor has such an inertia" if effect.like_inertia else "friction takes power"


@dataclass(frozen=True, eq=False)
class IdentificationResult(Record):
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
        bias: Whether least squares is biased on these logs; None where not tested.
        parting: By how much the halves of the data differ, in shares of what chance allows, see
            `payload_change.compare_halves`; above one they are of two rigs; None where not tested.
        agreement: Parameters of several logs, log by log; None for one log, or where not tested.
        bound: Least standard deviations that any unbiased estimate from the training rows has, (k,), see
            `regression.bound_deviations`; None where the base did not turn, or where not computed.
        trust: Relative deviation of the URDF's masses that the bodies' deviations stand on.
        faults: What is wrong with the logs as they were recorded, in sentences, see `describe_faults`.
        altered: Log → what was altered in it before it was fitted, see `checks.check_log`.
        missed: Joint → what of its torque the model misses, see `regression.fit_misfit`.
        simpler: Accuracy of simpler models on the rows by which the model is judged: the URDF, and its bodies with the
            fitted friction.
        holdout: What was held out, as `identify` takes it: "last-third", "log:N" or "none".
        data: The logs as they were fitted, mended where something was wrong with them; () where they came bit by bit.
        mass: Of the payload, kg, where it was weighed.
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
    bias: BiasCheck | None = None
    parting: float | None = None
    agreement: Agreement | None = None
    bound: Array | None = None
    trust: float = TRUST
    holdout: str = "none"
    missed: Mapping[str, Misfit] = field(default_factory=dict)
    simpler: tuple[Accuracy, ...] = ()
    faults: tuple[str, ...] = ()
    altered: Mapping[str, tuple[Alteration, ...]] = field(default_factory=dict)
    data: tuple[Log, ...] = ()
    mass: float | None = None

    ROWS: ClassVar[str] = "base_parameters"
    __repr__ = brief

    def __str__(self) -> str:
        """A few lines: what was estimated, from what, and how well it predicts; `show_parameters` has the table."""
        rig = self.model.rig
        mounted = f" with {rig.payload}" if rig.payload else ""
        head = (
            f"{rig.name}{mounted}: {len(self.names)} parameters by {self.estimate.method} from {', '.join(self.logs)}, "
            f"torque up to {self.filtering.cutoff:g} Hz"
        )
        parts = [str(part) for part in (self.train, self.held_out) if part is not None]
        notes = [
            *(f"warning: {said}" for said in self.warnings),
            *(f"note: {said}" for said in self.notes),
        ]
        notes += [f"altered: {log}: {one}" for log, each in self.altered.items() for one in each]
        return "\n".join(
            [
                head,
                *parts,
                *notes,
                "params, cov, bodies, model, to_dict() and to_urdf() hold the rest",
            ]
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What has to be known before the parameters are read, in sentences."""
        return tuple(_iterate_warnings(self))

    @property
    def opinions(self) -> dict[str, Opinion]:
        """Joint → state of its torque, by the rows that were not fitted, where there are any."""
        judged = self.held_out or self.train
        return {
            joint: judged.judge(joint, missed, self.simpler)
            for joint, missed in self.missed.items()
        }

    @property
    def params(self) -> DataFrame:
        """Table of the estimated parameters, one row each, in the order of `cov`.

        Columns: name; value, std and the 95 % interval, low to high = value ∓ 1.96 std, all in SI units, in which unit
        stands; urdf, the URDF's value, NaN where it states none. A parameter that the logs do not show has an infinite
        std.
        """
        import pandas as pd

        value = self.estimate.theta
        half = NORMAL_95 * self.estimate.std
        return pd.DataFrame(
            {
                "name": self.names,
                "value": value,
                "std": self.estimate.std,
                "low": value - half,
                "high": value + half,
                "unit": self.units,
                "urdf": self.stated,
            }
        )

    @property
    def cov(self) -> Array:
        """Covariance of the parameters, in the order of `params`, (k, k); SI units."""
        return self.estimate.covariance

    @check_arguments
    def predict(self, log: Log, *, masked: bool = True) -> DataFrame:
        """Return the torque that the parameters give the motion of a log, ``A theta``, N m: a column per joint.

        Its rows are those of the fit, two per period of the cutoff, low-passed at it; the index is their time t, s.
        The measured torque at them is ``predict(log) + residual(log)``. For the torque of a motion without a filter see
        `Model.inverse_dynamics`.

        Args:
            log: A log of the rig, with or without torque, which need not be among those of the fit. What the fit
                would mend in it is mended, see `checks.check_log`; without torque only its IMUs are turned.
            masked: Weight the rows down to zero near standstill, as the fit does, since there the motion does not tell
                the direction of dry friction. False: that direction is taken from the rate's sign.

        Raises:
            DataError: The log is shorter than the filter's memory.
            LogError: It lacks a joint of the rig, or samples lie too far apart.
        """
        if log.tau is not None:
            return self._compare(self._mend(log), masked)[0]
        rig = self.model.rig
        log = log.ordered(rig)
        turned = [log, *(after for _, after in correct_imus(rig, log)[0])][-1]
        # No column reads the torque, so that any will do.
        return self._compare(replace(turned, tau=np.zeros_like(log.q)), masked)[0]

    @check_arguments
    def residual(self, log: Log, *, masked: bool = True) -> DataFrame:
        """Return the measured torque of a log less `predict`, ``b - A theta``, N m: a column per joint.

        Args:
            log: A log of the rig with torque.
            masked: As for `predict`; then it is the residual that the fit minimised, where the log was fitted.

        Raises:
            DataError: The log has no torque, or is shorter than the filter's memory.
            LogError: It lacks a joint of the rig, or samples lie too far apart.
        """
        predicted, measured = self._compare(self._mend(log), masked)
        return measured - predicted

    def _mend(self, log: Log) -> Log:
        """Return a log as the fit would take it."""
        rig = self.model.rig
        return check_log(rig, log, filtering=self.filtering, repairs_only=True).log

    def _compare(self, log: Log, masked: bool) -> tuple[DataFrame, DataFrame]:
        """Return the predicted and the measured torque at the rows of a log, N m."""
        import pandas as pd

        rig = self.model.rig.with_phi(self.given)
        effects = tuple(term.effect for term in self.model.terms)
        # Without logs the design keeps the equation of a joint without a motor as it stands: its torque is zero.
        design = Design(rig, self.reduction, effects, (), self.filtering, masked)
        carrier = find_moving_base(rig, log)
        segments = split_segments(log, self.filtering.cutoff)
        blocks = [block for part in segments for block in design.build_blocks(part, carrier)]
        if not blocks:
            raise DataError(log.name, "is shorter than the filter's memory", "record more")
        t = pd.Index(np.concatenate([block.t for block in blocks]), name="t")
        theta = self.estimate.theta
        predicted = np.concatenate([block.A @ theta + block.known for block in blocks])
        measured = np.concatenate([block.b + block.known for block in blocks])
        joints = list(rig.joints)
        return (
            pd.DataFrame(predicted, index=t, columns=joints),
            pd.DataFrame(measured, index=t, columns=joints),
        )

    @property
    def physical(self) -> bool:
        """Whether bodies exist that have the estimated base parameters, to a thousandth of their deviation."""
        return self.consistent.distance < 1e-3 * np.sqrt(len(self.reduction.independent))

    @property
    def bodies(self) -> tuple[Body, ...]:
        """Mass, centre of mass and inertia of the nearest physical bodies, with their deviations."""
        width = len(self.reduction.independent)
        rig = self.model.rig
        covariance = self.estimate.covariance[:width, :width]
        mixing = map_phi_to_base(rig, self.reduction)
        known = self.estimate.theta[:width], covariance
        return estimate_bodies(
            rig.links, self.given, self.consistent.phi, mixing, *known, self.trust
        )

    @property
    def stated(self) -> Array:
        """The URDF's value of every parameter, (k,); NaN for what it does not state, as of an unknown payload."""
        rig = self.model.rig
        names = [kind.name for kind in PLAIN]
        rotors = [motor.armature or np.nan for motor in rig.motors]
        plain = np.column_stack([rig.friction, rotors, rotors, np.full(rig.n, np.nan)])
        base = self.reduction.mixing @ self.given[name_columns(rig)[1]]
        others = np.full(len(self.names) - len(base), np.nan)
        at = 0
        for term in self.model.terms:
            if term.effect.name in names:
                others[at] = plain[
                    rig.joint_index(term.effect.joint), names.index(term.effect.name)
                ]
            at += len(term.values)
        return np.concatenate([base, others])

    @property
    def is_of_two_rigs(self) -> bool:
        """Whether the halves of the data were found to be of two rigs, so that nothing of this is of either.

        Noise in the angles biases either half in its own way: that is said already, and is no second rig.
        """
        return (
            self.parting is not None
            and self.parting > 1
            and not (self.bias is not None and self.bias.is_of_noise)
        )

    @property
    def moved(self) -> Array:
        """``(value - stated) / std``, (k,): by how many of its deviations each differs from the URDF; NaN without."""
        std = self.estimate.std
        return (self.estimate.theta - self.stated) / np.where(std > 0, std, np.nan)

    @check_arguments
    def save(self, path: str | Path) -> None:
        """Write its model as ``gimbal-pin identify -o`` does: `read_model`, ``tune`` and ``studio`` take the file."""
        from gimbal_pin.identification.model_file import write_model

        write_model(self, path)

    def to_arviz(self, draws: int = 1000, rng: Rng = None) -> Any:
        """Return ``N(theta, covariance)`` as a posterior for ArviZ, in so many draws of every parameter.

        It takes the extra ``gimbal-pin[arviz]``; `rng` may be a seed; None: a fresh one.
        """
        try:
            import arviz
        except ImportError as error:
            raise UsageError(
                "arviz", "is not installed", "pip install 'gimbal-pin[arviz]'"
            ) from error
        generator, _ = make_generator(rng)
        theta = self.estimate.theta
        covariance = self.estimate.covariance
        drawn = generator.multivariate_normal(theta, covariance, (1, draws), method="eigh")
        return arviz.from_dict(posterior=dict(zip(self.names, np.moveaxis(drawn, -1, 0))))

    def to_urdf(self) -> str:
        """Return the rig's URDF with the nearest physical inertias and the identified friction; other tags are kept."""
        model = self.model
        values = {(term.effect.joint, term.effect.name): term.values[0] for term in model.terms}
        names = [kind.name for kind in ALWAYS]
        friction = {
            joint: (values[joint, names[0]], values[joint, names[1]]) for joint in model.rig.joints
        }
        return replace_friction(to_urdf(model.rig, self.consistent.phi), friction)

    def to_dict(self) -> dict[str, Any]:
        """Return what `identify --json` writes."""
        values = (self.estimate.theta, self.estimate.std, self.stated, self.moved)
        rows = zip(self.names, self.units, *(x.tolist() for x in values))
        return {
            "schema": 1,
            "rig": self.model.rig.name,
            "payload": self.model.rig.payload,
            "logs": list(self.logs),
            "estimator": self.estimate.method.value,
            "uncertainty": self.estimate.uncertainty,
            "samples": self.estimate.rows,
            "condition_number": self.estimate.condition_number,
            "base_motion": self.reduction.base,
            "cutoff_hz": self.filtering.cutoff,
            "lag_s": {
                joint: {"value": lag, "std": std} for joint, (lag, std) in self.model.lags.items()
            },
            "imus": {
                log: {link: mounting.to_dict() for link, mounting in links.items()}
                for log, links in self.mountings.items()
            },
            "warnings": list(self.warnings),
            "notes": list(self.notes),
            "altered": list_alterations(self.altered),
            "physical": self.physical,
            "consistent": {
                "distance": self.consistent.distance,
                "torque_change_rms": dict(self.torque_change),
            },
            "base_parameters": [
                {
                    "name": name,
                    "value": x,
                    "std": s,
                    "unit": unit,
                    "urdf": finite_or_none(given),
                    "deviations": finite_or_none(z),
                }
                for name, unit, x, s, given, z in rows
            ],
            "least_std": None if self.bound is None else dict(zip(self.names, self.bound.tolist())),
            "trust": self.trust,
            "bodies": [body.to_dict() for body in self.bodies],
            "train": asdict(self.train),
            "held_out": None if self.held_out is None else asdict(self.held_out),
            "misfit": {
                joint: {
                    "torque_rms": one.size,
                    "noise_rms": one.noise,
                    "opinion": self.opinions[joint].value,
                }
                for joint, one in self.missed.items()
            },
            "halves_apart": self.parting,
            "agreement": None if self.agreement is None else self.agreement.to_dict(),
            "least_squares": None if self.bias is None else self.bias.to_dict(),
        }
