"""Logs in, model with uncertainty out (THESIS 4.2, 4.5)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from gimbal_pin import halves
from gimbal_pin.bodies import TRUST, Body, bodies
from gimbal_pin.calibration import Mounting, rectified
from gimbal_pin.consistency import LEANT, Consistent, nearest
from gimbal_pin.effects import ALWAYS, Effect
from gimbal_pin.errors import DataError, UsageError
from gimbal_pin.estimators import Estimate, Estimator, weighted
from gimbal_pin.inertia import to_urdf
from gimbal_pin.log import Array, Log
from gimbal_pin.model import Estimated, Model, friction_effects
from gimbal_pin.platform import MOTIONS, BaseMotion
from gimbal_pin.reduction import Reduction, reduce
from gimbal_pin.regressor import columns
from gimbal_pin.rig import Rig
from gimbal_pin.rows import (
    Block,
    Filtering,
    Regression,
    Rows,
    base_motion,
    camera_body,
    columns_of,
    kept,
    over_phi,
    settling,
)
from gimbal_pin.suspicion import Asked, Suspicion, suspicion
from gimbal_pin.threads import one_thread
from gimbal_pin.urdf import with_friction

MIXED = 1e-9
"""Share of a body's parameter in a base parameter under which that knows nothing of it."""
DROWNED = 0.1
"""Share of a joint's samples under which it is told that the others were masked out."""


@dataclass(frozen=True)
class Accuracy:
    """How well a model predicts the filtered torque of some rows.

    Attributes:
        how: Which rows.
        torque_rmse: Joint → root mean square error, N m, over all samples but those near standstill.
        fit_percent: Joint → ``100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖)`` (THESIS 4.28), over the same samples.
        used: Joint → share of the rows that were used; the rest is near standstill, where a joint's motion does not
            tell its torque.
    """

    how: str
    torque_rmse: Mapping[str, float]
    fit_percent: Mapping[str, float]
    used: Mapping[str, float]


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
        consistent: The physical parameters nearest to the estimate: what a URDF can be given.
        torque_change: Joint → rms change in predicted torque from the estimate to `consistent`, N m.
        logs: Names of the logs.
        filtering: The filter in force.
        given: Inertial parameters of the rig as it was given, (10 n,).
        mountings: Log → link → how its IMU sits there, where gyros and encoders could tell.
        notes: What of the logs was not used, in sentences.
        bias: Whether least squares is biased on these logs; None where that was not asked.
        parting: By how much the halves of the data differ, in shares of what chance allows, see `halves.apart`; above
            one they are of two rigs; None where that was not asked.
        trust: Relative deviation of the URDF's masses that the bodies' deviations stand on.
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
    trust: float = TRUST
    swapped: bool = False

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
        return halves.sentence(len(self.logs)) in self.notes

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
            "notes": list(self.notes),
            "physical": self.physical,
            "consistent": {"distance": self.consistent.distance, "torque_change_rms": dict(self.torque_change)},
            "base_parameters": [
                {"name": name, "value": x, "std": s, "unit": unit, "urdf": number(given), "deviations": number(z)}
                for name, unit, x, s, given, z in rows
            ],
            "trust": self.trust,
            "bodies": [body.to_dict() for body in self.bodies],
            "train": asdict(self.train),
            "held_out": None if self.held_out is None else asdict(self.held_out),
            "halves_apart": self.parting,
            "least_squares": None if self.bias is None else self.bias.to_dict(),
        }


def number(value: float) -> float | None:
    """Return a number as JSON holds it: null where there is none."""
    return value if np.isfinite(value) else None


@one_thread()
def identify(
    rig: Rig,
    logs: Sequence[Log],
    effects: Sequence[Effect] = (),
    *,
    estimator: Estimator = weighted,
    holdout: str | None = None,
    filtering: Filtering | None = None,
    examined: Asked = "never",
) -> Identified:
    """Estimate base parameters, Coulomb and viscous friction, and `effects`, from logs.

    Where a log holds the base's IMU and that says that the base moved or leant, its motion is part of the equations,
    and the parameters that only such a motion shows are estimated, too. Gyros on several links are first turned into
    their links' axes, see `calibration.rectified`.

    Args:
        rig: The rig.
        logs: Trajectories; each is filtered on its own and none is joined to another.
        effects: Effects on top of Coulomb and viscous friction.
        estimator: Blocks → `Estimate`.
        holdout: "last-third", "log:N" (counted from 1) or "none"; None: the last third of one log, the last of several.
        filtering: Cutoff and alignment; None: the defaults.
        examined: Whether to test if least squares is biased on these logs, see `suspicion`, and, unless "never", if
            their halves are of one rig, see `halves.apart`.

    Raises:
        DataError: The logs are too short, or some parameters leave no trace in them; it names these.
        UsageError: An unknown way of holding out, or a log without torque.
    """
    filters = filtering or Filtering()
    for log in logs:
        within(log, filters)
    calibrated = [rectified(rig, log) for log in logs]
    notes = tuple(said for log, one in zip(logs, calibrated) for said in one.log.events if said not in log.events)
    logs = [one.log for one in calibrated]
    train, test, how = split(logs, holdout, filters)
    everything = friction_effects(rig.joints) + tuple(effects)
    blocks, estimate = fitted(rig, everything, train, filters, estimator, moved(rig, train))
    tested = kept(replace(blocks.rows, logs=test)) if test else None
    found = assembled(blocks.rows, blocks, estimate, tested, how)
    mountings = {one.log.name: one.mountings for one in calibrated if one.mountings}
    judged = suspicion(blocks, examined, estimate.method)
    parting = None if examined == "never" else halves.apart([*blocks, *(tested or ())], halves.directions(blocks.rows))
    # Noise in the angles biases either half in its own way: that is said already, and is no second rig.
    noisy = judged is not None and judged.test is not None and judged.test.biased and judged.by_noise
    notes += (halves.sentence(len(logs)),) if parting is not None and parting > 1 and not noisy else ()
    return replace(
        found, logs=tuple(log.name for log in logs), mountings=mountings, notes=notes, bias=judged, parting=parting
    )


def refitted(judged: Identified, whole: Identified) -> Identified:
    """Return an estimate from all data with the held-out accuracy of one that had not seen what was held out.

    That accuracy is of fewer data than the result has, so it errs on the safe side.

    Args:
        judged: Estimated with something held out.
        whole: The same with nothing held out.
    """
    if judged.held_out is None:
        return whole
    note = f"the parameters are of all data; the accuracy on '{judged.held_out.how}' is that of a fit without it"
    return replace(whole, held_out=judged.held_out, notes=(*whole.notes, note))


def assembled(
    rows: Rows, blocks: Sequence[Block], estimate: Estimate, tested: Sequence[Block] | None, how: str
) -> Identified:
    """Return what is known once the parameters of some rows are estimated: model, accuracy, nearest physical bodies.

    Args:
        rows: The training rows.
        blocks: Their blocks.
        estimate: Parameters in the order of `rows.names`.
        tested: Blocks that were held out, or None.
        how: How they were parted.
    """
    rig, model = rows.rig, to_model(rows, estimate)
    held_out = None if tested is None else accuracy(rig.joints, tested, estimate.theta, how)
    consistent, shift = nearest_physical(rows, estimate)
    change = rms([block.A[:, :, : len(shift)] @ shift for block in blocks])
    return Identified(
        model=model,
        reduction=rows.reduction,
        estimate=estimate,
        names=rows.names,
        units=units_of(rows),
        train=accuracy(rig.joints, blocks, estimate.theta, "training part"),
        held_out=held_out,
        consistent=consistent,
        torque_change=dict(zip(rig.joints, change.tolist())),
        logs=tuple(log.name for log in rows.logs),
        filtering=rows.filtering,
        given=rig.phi,
    )


def fitted(
    rig: Rig,
    effects: tuple[Effect, ...],
    logs: tuple[Log, ...],
    filters: Filtering,
    estimator: Estimator,
    base: BaseMotion,
) -> tuple[Regression, Estimate]:
    """Fit the base parameters that a motion of the base shows; if the logs hide some, those of a lesser motion.

    Raises:
        DataError: Too few rows, or parameters without a trace that a fixed base would show.
    """
    rows = Rows(rig, reduce(rig, base=base), effects, logs, filters)
    blocks = kept(rows)
    enough(rows, blocks)
    estimate = estimator(blocks)
    if base != "fixed" and unseen(rows.names, blocks, estimate):
        return fitted(rig, effects, logs, filters, estimator, MOTIONS[MOTIONS.index(base) - 1])
    check_seen(logs[0].name, rows.names, blocks, estimate)
    return blocks, estimate


def moved(rig: Rig, logs: Sequence[Log]) -> BaseMotion:
    """Return the greatest motion of the base in some logs."""
    return max((base_motion(rig, log) for log in logs), key=MOTIONS.index, default="fixed")


def within(log: Log, filters: Filtering) -> None:
    """Raise `UsageError` if the cutoff leaves the filters nothing to remove."""
    if len(log) > 1 and filters.cutoff * log.dt > 0.2:
        what = f"of {filters.cutoff:g} Hz is too high for {1 / log.dt:.0f} samples a second"
        raise UsageError(f"{log.name}: the cutoff", what, f"give at most {0.2 / log.dt:.3g} Hz")


def enough(rows: Rows, blocks: Sequence[Block]) -> None:
    """Raise `DataError` if there are fewer rows than three per parameter."""
    have, want = sum(block.b.size for block in blocks), 3 * len(rows.names)
    if have < want:
        seconds = max((log.t[-1] - log.t[0] for log in rows.logs), default=0.0)
        name = rows.logs[0].name if rows.logs else "no log"
        what = f"{seconds:.3g} s leave {have} filtered rows for {len(rows.names)} parameters; they cannot show any of"
        need = want / rows.rig.n / (2 * rows.filtering.cutoff) + 2 * settling(rows.filtering)
        raise DataError(name, what, f"record at least {max(need * 2, 10):.0f} s of motion", rows.names)


def check_seen(place: str, names: Sequence[str], blocks: Sequence[Block], estimate: Estimate) -> None:
    """Raise `DataError` with the parameters whose uncertainty alone moves more torque than the whole log has."""
    if hidden := unseen(names, blocks, estimate):
        raise DataError(place, *untraced(blocks), hidden)


def untraced(blocks: Sequence[Block]) -> tuple[str, str]:
    """Say why parameters leave no trace, and what to do: too little motion, or more noise than motion."""
    kept = min(np.mean(np.concatenate([block.share for block in blocks]) ** 2, axis=0).tolist())
    if kept >= DROWNED:
        return "its motion leaves no trace of", "move every joint, several at a time: see 'gimbal-pin excite'"
    what = f"all but {100 * kept:.2g} % of a joint's samples are near standstill, or no faster than their rate's noise"
    mend = "move every joint, all the time: see 'gimbal-pin excite'; or record finer angles, or rates (dq_) from a gyro"
    return f"{what}; the rest leaves no trace of", mend


def unseen(names: Sequence[str], blocks: Sequence[Block], estimate: Estimate) -> tuple[str, ...]:
    """Return the parameters whose uncertainty alone moves more torque than the whole log has."""
    power = np.mean([np.mean(block.A**2, axis=0) for block in blocks], axis=0)
    torque = np.sqrt(np.mean([np.mean(block.b**2, axis=0) for block in blocks], axis=0))
    reach = np.where(power.sum(axis=0) > 0, np.sqrt(power).max(axis=0), 0.0)
    std = np.where(np.isfinite(estimate.std), estimate.std, np.inf)
    blind = (reach == 0) | (std * np.maximum(reach, 1e-300) > torque.max())
    return tuple(name for name, hidden in zip(names, blind) if hidden)


def split(logs: Sequence[Log], holdout: str | None, filters: Filtering) -> tuple[tuple[Log, ...], tuple[Log, ...], str]:
    """Return training logs, held-out logs, and how they were parted."""
    if not logs:
        raise UsageError("logs", "none was given", "give at least one log")
    how = holdout or ("last-third" if len(logs) == 1 else f"log:{len(logs)}")
    if how == "none":
        return tuple(logs), (), "none"
    if how == "last-third":
        halves = [thirds(log, filters) for log in logs]
        return tuple(a for a, _ in halves), tuple(b for _, b in halves), "last third"
    match = re.fullmatch(r"log:(\d+)", how)
    if not match or not 1 <= int(match[1]) <= len(logs) or len(logs) < 2:
        several = f", or log:1 to log:{len(logs)}" if len(logs) > 1 else "; log:N takes several logs"
        raise UsageError("--holdout", f"cannot be '{how}'", f"use last-third or none{several}")
    k = int(match[1]) - 1
    return (*logs[:k], *logs[k + 1 :]), (logs[k],), f"log {k + 1} of {len(logs)}"


def thirds(log: Log, filters: Filtering) -> tuple[Log, Log]:
    """Split at two thirds of the time; the filters' settling at the cut keeps a gap between the two."""
    cut = int(np.searchsorted(log.t, log.t[0] + (log.t[-1] - log.t[0]) * 2 / 3))
    return log.part(slice(0, cut)), log.part(slice(cut, None))


def to_model(rows: Rows, estimate: Estimate) -> Model:
    """Return the model with these parameters: RNEA and regressor then predict the same torque.

    Bodies that were fitted are taken as they are. Else the reduction's independent columns take the change; the others
    stay as the URDF has them. No other split is more right, as no torque can tell them apart; `consistency.nearest`
    looks for a physical one.
    """
    rig, width = rows.rig, len(rows.reduction.independent)
    phi = rig.phi.copy() if estimate.phi is None else estimate.phi.copy()
    if estimate.phi is None:
        phi[columns_of(rig, rows.reduction)] += estimate.theta[:width] - given_beta(rig, rows.reduction)
    known = Estimated(rows.names, units_of(rows), estimate.theta, estimate.covariance)
    return Model(rig.with_phi(phi), rows.terms(estimate.theta), known)


def nearest_physical(rows: Rows, estimate: Estimate) -> tuple[Consistent, Array]:
    """Return the physical parameters nearest to the estimate, and the change in base parameters, (b,)."""
    width = len(rows.reduction.independent)
    if estimate.phi is not None:
        return Consistent(estimate.phi, 0.0), np.zeros(width)
    found = nearest(rows.rig.phi, rows.mixing, estimate.theta[:width], estimate.covariance[:width, :width], LEANT)
    return found, rows.mixing @ found.phi - estimate.theta[:width]


def rms(parts: Sequence[Array]) -> Array:
    """Root mean square over the rows of all parts, per joint, (n,)."""
    return np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))


def given_beta(rig: Rig, reduction: Reduction) -> Array:
    """Base parameters of the URDF as it stands, (b,)."""
    return reduction.mixing @ rig.phi[columns(rig)[1]]


def units_of(rows: Rows) -> tuple[str, ...]:
    """SI units of theta, by the kind of each base parameter and by each coefficient."""
    leading = [rows.reduction.names[j].rsplit(".", 1)[1] for j in rows.reduction.independent]
    return units(leading) + tuple(c.unit for effect in rows.effects for c in effect.coefficients)


def units(symbols: Sequence[str]) -> tuple[str, ...]:
    """SI units of inertial parameters by their symbols."""
    return tuple({"I": "kg m^2", "m": "kg m"}[symbol[0]] if symbol != "m" else "kg" for symbol in symbols)


def accuracy(joints: Sequence[str], blocks: Sequence[Block], theta: Array, how: str) -> Accuracy:
    """Compare predicted and measured filtered torque; `DataError` if there is no row to compare."""
    if not blocks:
        raise DataError("held-out part", "is shorter than the filters' memory", "hold out more, or use --holdout none")
    measured, share = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("b", "share"))
    error = measured - np.concatenate([block.A @ theta for block in blocks])
    rows = np.maximum(np.sum(share**2, axis=0), 1e-300)
    rmse = np.sqrt(np.sum(error**2, axis=0) / rows)
    mean = np.sum(measured * share, axis=0) / rows
    spread = np.maximum(np.linalg.norm(measured - mean * share, axis=0), 1e-300)
    fit = 100 * (1 - np.linalg.norm(error, axis=0) / spread)
    used = np.mean(share**2, axis=0)
    return Accuracy(how, *(dict(zip(joints, values.tolist())) for values in (rmse, fit, used)))
