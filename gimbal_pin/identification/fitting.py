"""Rows of the logs, an estimate from them, and what was held out to judge it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gimbal_pin.checks import (
    check_assignment,
    check_log,
    check_time,
    collect_alterations,
    compare_scales,
)
from gimbal_pin.dynamics.model import (
    Doubt,
    Estimated,
    Model,
    build_stated_effects,
    find_rotors,
    is_inertia_positive,
    is_parameter,
)
from gimbal_pin.dynamics.reduction import Reduction, reduce_parameters
from gimbal_pin.dynamics.regressor import name_columns
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import Effect
from gimbal_pin.effects.parse import parse_estimated_effect
from gimbal_pin.effects.torque_table import TorqueTable
from gimbal_pin.errors import DataError, UsageError, digits
from gimbal_pin.identification import payload_change
from gimbal_pin.identification.agreement import assess_agreement
from gimbal_pin.identification.bias_test import WhenTested, check_bias
from gimbal_pin.identification.estimators import find_estimator
from gimbal_pin.identification.identified import IdentificationResult, describe_faults
from gimbal_pin.identification.requirements import check_enough, check_seen, find_unseen
from gimbal_pin.identification.validation import Accuracy, Validation, measure_accuracy
from gimbal_pin.log.log import Array, Log, drop_repeated_logs, find_interval
from gimbal_pin.log.platform import BASE_MOTIONS, BaseMotion
from gimbal_pin.regression import (
    TRUST,
    Block,
    Design,
    DesignBlocks,
    Estimate,
    Estimator,
    Filtering,
    Misfit,
    add_lag_spread,
    add_misfit,
    align_rows,
    bound_deviations,
    check_trust,
    classify_base_motion,
    compute_blocks,
    fit_weighted,
    limit_cutoff,
    resolution,
)
from gimbal_pin.regression.consistency import Consistent, find_likeliest_bodies, find_nearest_bodies
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.rig import Rig

SHAKEN = 12.0
"""Cutoff for a base that is shaken, Hz: hands and airframes shake at 4 to 12 Hz, and what is fast shows inertias."""
BOUND_CUTOFF = 16.0
"""Cutoff of the rows that the bound is taken from, Hz: of thesis's 60 s it is the same at 12 and at 25."""


def split_logs(
    logs: Sequence[Log], holdout: str | None, filters: Filtering
) -> tuple[tuple[Log, ...], tuple[Log, ...], str]:
    """Return training logs, held-out logs, and how they were parted."""
    if not logs:
        raise UsageError("logs", "none was given", "give at least one log")
    how = holdout or choose_holdout(logs)
    if how == "none":
        return tuple(logs), (), "none"
    if how == "last-third":
        halves = [_split_log(log, filters) for log in logs]
        return tuple(a for a, _ in halves), tuple(b for _, b in halves), "last third"
    match = re.fullmatch(r"log:(\d+)", how)
    if not match or not 1 <= int(match[1]) <= len(logs) or len(logs) < 2:
        several = (
            f", or log:1 to log:{len(logs)}" if len(logs) > 1 else "; log:N takes several logs"
        )
        raise UsageError("--holdout", f"cannot be '{how}'", f"use last-third or none{several}")
    k = int(match[1]) - 1
    return (*logs[:k], *logs[k + 1 :]), (logs[k],), f"log {k + 1} of {len(logs)}"


def choose_holdout(logs: Sequence[Log]) -> str:
    """Return what is held out where nothing is asked for: the last third of one log, of several the last."""
    return "last-third" if len(logs) == 1 else f"log:{len(logs)}"


def _split_log(log: Log, filters: Filtering) -> tuple[Log, Log]:
    """Split at two thirds of the time; the filters' settling at the cut keeps a gap between the two."""
    cut = int(np.searchsorted(log.t, log.t[0] + (log.t[-1] - log.t[0]) * 2 / 3))
    return log.part(slice(0, cut)), log.part(slice(cut, None))


def compute_held_out_blocks(design: Design, logs: tuple[Log, ...]) -> DesignBlocks | None:
    """Compute the rows of held-out logs, None without logs; raise `DataError` where the filters leave no row."""
    if not logs:
        return None
    if blocks := compute_blocks(replace(design, logs=logs)):
        return blocks
    what = "its held-out part is shorter than the filters' memory"
    raise DataError(logs[0].name, what, "record more, or use --holdout none")


def assemble_result(
    blocks: DesignBlocks,
    estimate: Estimate,
    tested: Sequence[Block] | None,
    how: str,
    trust: float = TRUST,
) -> IdentificationResult:
    """Return what is known once the parameters of some rows are estimated: model, accuracy, nearest physical bodies.

    The model has these bodies where no rig could move with the estimated ones.

    Args:
        blocks: The training rows.
        estimate: Parameters in the order of the design's names.
        tested: Blocks that were held out, or None.
        how: How they were parted.
        trust: Relative standard deviation of the URDF's masses, see `estimate_bodies`.
    """
    design = blocks.design
    rig = design.rig
    model = to_model(design, estimate)
    train = measure_accuracy(rig.joints, blocks, estimate.theta, "training part")
    held_out = None if tested is None else measure_accuracy(rig.joints, tested, estimate.theta, how)
    if held_out is not None:
        model = replace(model, doubts=tuple(Validation(train, held_out).doubts()))
    consistent, shift = _find_nearest_physical(design, estimate, trust)
    if not is_inertia_positive(model.rig, rotors=model.motor_inertia):
        model = replace(model, rig=model.rig.with_phi(consistent.phi))
    moved = np.concatenate([block.A[:, :, : len(shift)] @ shift for block in blocks])
    change = np.sqrt(np.mean(moved**2, axis=0))
    found = IdentificationResult(
        model=model,
        reduction=design.reduction,
        estimate=estimate,
        names=design.names,
        units=design.units,
        train=train,
        held_out=held_out,
        consistent=consistent,
        torque_change=dict(zip(rig.joints, change.tolist())),
        logs=tuple(log.name for log in design.logs),
        filtering=design.filtering,
        given=rig.phi,
        trust=trust,
    )
    return replace(
        found, simpler=_measure_simpler_models(found, blocks if tested is None else tested)
    )


def _measure_simpler_models(
    found: IdentificationResult, blocks: Sequence[Block]
) -> tuple[Accuracy, ...]:
    """Return the accuracy of the URDF, and of its bodies with the fitted friction and effects, on some rows."""
    given = np.nan_to_num(found.stated)
    width = len(found.reduction.independent)
    rubbing = np.concatenate([given[:width], found.estimate.theta[width:]])
    models = {"the URDF": given, "the URDF with the fitted friction": rubbing}
    return tuple(
        measure_accuracy(found.model.rig.joints, blocks, theta, how)
        for how, theta in models.items()
    )


def add_misfit_and_lags(
    found: IdentificationResult, missed: Sequence[Misfit], late: Array
) -> IdentificationResult:
    """Return an estimate, and its model, with what the model misses at each joint, and when the torques act.

    Args:
        found: The estimate.
        missed: What is missed at each joint.
        late: Covariance of the lags of the estimate's filter, s², (n, n).
    """
    known = found.model.estimated
    assert known is not None
    per_root_hertz = found.filtering.cutoff**-0.5
    known = replace(
        known,
        missed=tuple(one.size for one in missed),
        misfit=tuple(one.group_std for one in missed),
        noise=tuple(per_root_hertz * one.noise for one in missed),
        pure_error=tuple(per_root_hertz * one.pure_error for one in missed),
        lags=found.filtering.lags,
        lag_std=tuple(np.sqrt(np.diag(late)).tolist()),
    )
    said = dict(zip(found.model.rig.joints, missed))
    return replace(found, model=replace(found.model, estimated=known), missed=said)


def to_model(design: Design, estimate: Estimate) -> Model:
    """Return the model with these parameters: RNEA and regressor then predict the same torque.

    Bodies that were fitted are taken as they are, else `Design.to_bodies`; `find_nearest_bodies` has physical ones.
    """
    width = len(design.reduction.independent)
    phi = design.to_bodies(estimate.theta[:width]) if estimate.phi is None else estimate.phi
    dt = find_interval(log.dt for log in design.logs)
    noise = np.mean([resolution(log) for log in design.logs] or [np.zeros(0)], axis=0)
    known = Estimated(
        design.names,
        design.units,
        estimate.theta,
        estimate.covariance,
        dt,
        angle_noise=tuple(noise.tolist()),
        digests=tuple(dict.fromkeys(log.digest for log in design.logs)),
    )
    return Model(design.rig.with_phi(phi), design.to_terms(estimate.theta), known)


def _find_nearest_physical(
    design: Design, estimate: Estimate, trust: float
) -> tuple[Consistent, Array]:
    """Return the most likely bodies, how far off the nearest are, and the change in base parameters, (b,)."""
    width = len(design.reduction.independent)
    if estimate.phi is not None:
        return Consistent(estimate.phi, 0.0), np.zeros(width)
    estimated = (
        design.rig.phi,
        design.mixing,
        estimate.theta[:width],
        estimate.covariance[:width, :width],
    )
    phi = find_likeliest_bodies(*estimated, trust)
    return Consistent(
        phi, find_nearest_bodies(*estimated).distance
    ), design.mixing @ phi - estimate.theta[:width]


def given_beta(rig: Rig, reduction: Reduction) -> Array:
    """Base parameters of the URDF as it stands, (b,)."""
    return reduction.mixing @ rig.phi[name_columns(rig)[1]]


def _choose_filter(logs: Sequence[Log], base: BaseMotion) -> Filtering:
    """Return the filter for logs where none is given: wider where the base turns and joint rates were measured."""
    measured = all(log.v is not None for log in logs)
    return limit_cutoff(
        Filtering(cutoff=SHAKEN) if base == "rotating" and measured else Filtering(), logs
    )


def _bound_deviations(design: Design, base: BaseMotion) -> Array | None:
    """Return the least standard deviations that a design's logs allow, see `regression.bound_deviations`, (k,).

    Under a wider filter; None where the rows then show other parameters.
    """
    wide = replace(design.filtering, cutoff=max(BOUND_CUTOFF, design.filtering.cutoff))
    further = tuple(effect for effect in design.effects if not is_parameter(design.rig, effect))
    blocks, estimate, _ = _fit_shown(design.rig, further, design.logs, wide, fit_weighted, base)
    return bound_deviations(blocks, estimate.theta) if blocks.design.names == design.names else None


@limit_to_one_thread()
@check_arguments
def identify(
    rig: Rig,
    logs: Log | Sequence[Log],
    effects: Sequence[Effect | str] = (),
    *,
    estimator: Estimator | str = "weighted",
    holdout: str | None = None,
    filtering: Filtering | None = None,
    examined: WhenTested = "noisy",
    trust: float = TRUST,
) -> IdentificationResult:
    """Estimate base parameters, Coulomb and viscous friction, rotors, and `effects`, from logs.

    Constant torques are estimated where the rig says ``torque_offset: fit``.
    Rotors are those of joints for which the rig states a gear or a rotor, ``tau = Ia a``. Where no motion tells one
    from the bodies, `Reduction.grouped`, it is a sum's; where the logs do not, it stays as stated, with a note.

    Where a log holds the base's IMU and that says that the base moved or leant, its motion is part of the equations,
    and the parameters that only such a motion shows are estimated, too. The logs are first checked, and
    mended where something is wrong with their data, see `checks.check_log`.

    Args:
        rig: The rig.
        logs: One trajectory, or several; each is filtered on its own and none is joined to another.
        effects: Effects on top of Coulomb and viscous friction, or their words as on the command line, such as
            ``cogging:yaw:harmonic=42``, in which no coefficient need be.
        estimator: Name of one of `ESTIMATORS`, or a function: blocks → `Estimate`.
        holdout: "last-third", "log:N" (counted from 1) or "none"; None: the last third of one log, the last of several.
        filtering: Cutoff and alignment; None: the defaults, a wider cutoff where the base turns.
        examined: Whether to test if least squares is biased on these logs, see `check_bias`, and, unless "never",
            what is wrong with the data beside what is mended, whether the halves are of one rig, see
            `payload_change.compare_halves`, whether several logs agree, see `agreement.assess_agreement`, and the least
            deviations that logs of a base that turned allow.
        trust: Relative standard deviation of the URDF's masses, see `estimate_bodies`; the prior of "ridge" is as wide.

    Raises:
        DataError: The logs are too short, or some parameters leave no trace in them; it names these.
        UsageError: An unknown way of holding out, estimator or effect; an effect that reads the torque itself; a log
            without torque.
        LogError: A log lacks a joint of the rig, a torque has the wrong sign, or two have changed places, see
            `checks.check_assignment`; or one acts too early or late, see `checks.check_time`.
    """
    logs = [logs] if isinstance(logs, Log) else logs
    further = tuple(
        parse_estimated_effect(one, rig) if isinstance(one, str) else one for one in effects
    )
    for effect in further:
        if effect.loaded:
            what = "reads the model's own torque, of which rows have only the measured one, whose noise biases the fit"
            raise UsageError(
                f"effect '{effect.name}'", what, "leave it out: 'diagnose' estimates it"
            )
    check_trust(trust)
    method = find_estimator(estimator, trust)
    logs, repeated = drop_repeated_logs(logs)
    checked = [
        check_log(rig, log, filtering=filtering, repairs_only=examined == "never") for log in logs
    ]
    logs = [one.log for one in checked]
    filters = filtering or _choose_filter(logs, greatest_base_motion(rig, logs))
    notes = (*repeated, *check_time(rig, logs, filters))
    train, test, how = split_logs(logs, holdout, filters)
    base = greatest_base_motion(rig, train)
    parted = _LogSplit(rig, train, test, filters, method, base)
    (blocks, estimate, late, tested), left_out = parted.fit_without_overfitted(further)
    check_assignment(blocks, estimate)
    estimate, missed = add_misfit(blocks, estimate)
    estimate = add_lag_spread(blocks, estimate, late)
    unused = [log.name for log in test if any(log is one for one in logs)]
    reduction = blocks.design.reduction
    fitted = find_rotors(blocks.design.effects)
    notes += tuple(
        f"{joint}: the logs do not tell its rotor from the bodies: it stays as stated"
        for joint in reduction.rotors
        if joint not in fitted
    )
    notes += tuple(
        f"{name} only judged the others and taught nothing; --refit learns from all"
        for name in unused
    )
    found = add_misfit_and_lags(assemble_result(blocks, estimate, tested, how, trust), missed, late)
    found = replace(
        found,
        model=replace(found.model, doubts=(*left_out, *found.model.doubts)),
        logs=tuple(log.name for log in logs),
        mountings={one.log.name: one.mountings for one in checked if one.mountings},
        notes=notes,
        altered=collect_alterations(checked),
        data=tuple(logs),
        holdout=holdout or choose_holdout(logs),
        faults=tuple(fault.sentence for fault in compare_scales(blocks, estimate)),
    )
    if examined == "never":
        return found
    found = replace(
        found,
        bias=check_bias(blocks, examined, estimate.method),
        parting=payload_change.compare_halves([*blocks, *(tested or ())], blocks.design),
        agreement=assess_agreement(replace(blocks.design, logs=tuple(logs)))
        if len(logs) > 1
        else None,
        faults=(*found.faults, *describe_faults(checked)),
        bound=_bound_deviations(blocks.design, base) if base == "rotating" else None,
    )
    return (
        replace(found, notes=(*notes, payload_change.describe_two_rigs(len(logs))))
        if found.is_of_two_rigs
        else found
    )


class _Trial(NamedTuple):
    """A fit: the rows, what was estimated from them, covariance of the lags, and the rows that were held out."""

    blocks: DesignBlocks
    estimate: Estimate
    late: Array
    tested: DesignBlocks | None

    @property
    def validation(self) -> Validation | None:
        """Its accuracy, where something was held out."""
        if not self.tested:
            return None
        each = ((self.blocks, "training part"), (self.tested, "held-out part"))
        return Validation(
            *(
                measure_accuracy(self.blocks.design.rig.joints, x, self.estimate.theta, how)
                for x, how in each
            )
        )


@dataclass(frozen=True)
class _LogSplit:
    """Logs to fit, logs to judge by, and how; as for `identify`."""

    rig: Rig
    train: tuple[Log, ...]
    test: tuple[Log, ...]
    filters: Filtering
    estimator: Estimator
    base: BaseMotion

    def fit(self, effects: tuple[Effect, ...]) -> _Trial:
        """Fit with some effects beside friction and rotors."""
        blocks, estimate, late = _fit_shown(
            self.rig, effects, self.train, self.filters, self.estimator, self.base
        )
        return _Trial(blocks, estimate, late, compute_held_out_blocks(blocks.design, self.test))

    def fit_without_overfitted(
        self, effects: tuple[Effect, ...]
    ) -> tuple[_Trial, tuple[Doubt, ...]]:
        """Fit without the effects of joints where they do not hold for what was held out; say which these are."""
        trial = self.fit(effects)
        left_out = list[Doubt]()
        for joint in dict.fromkeys(effect.joint for effect in effects):
            mine = [one for one in effects if one.joint == joint]
            full = trial.validation
            if full is None:
                break
            plain = self.fit(tuple(one for one in effects if one not in mine))
            if plain.validation is None or full.holds_beside(plain.validation, joint):
                continue
            trial = plain
            effects = tuple(one for one in effects if one not in mine)
            names = ", ".join(dict.fromkeys(one.name for one in mine))
            without = digits(plain.validation.held_out.fit_percent[joint], 3)
            why = f"{names} left out: with it {full.fits(joint)}; without it to {without} %"
            left_out.append(Doubt(joint, why, False))
        return trial, tuple(left_out)


def refittable_effects(model: Model) -> tuple[Effect, ...]:
    """Return the effects of a model beside Coulomb and viscous friction that logs can be fitted with again.

    Not those that read the model's own torque: the rows have but the measured one, whose noise would leak. Nor tables,
    whose values nothing but their prior holds where the logs did not go.
    """
    return tuple(
        effect for effect in _list_further_effects(model) if not _reads_torque_or_table(effect)
    )


def describe_omitted_effects(model: Model) -> tuple[str, ...]:
    """Say in one sentence which of a model's effects `refittable_effects` leaves out; nothing where it has them all."""
    omitted = [
        f"{one.name} of {one.place}"
        for one in _list_further_effects(model)
        if _reads_torque_or_table(one)
    ]
    why = "they read the torque itself, or are tables that only their prior holds: diagnose's own model keeps them"
    return (
        (f"of the extended model, not estimated here: {', '.join(omitted)}; {why}",)
        if omitted
        else ()
    )


def _list_further_effects(model: Model) -> list[Effect]:
    """Return the effects that are no parameters of every model of the rig."""
    return [term.effect for term in model.terms if not is_parameter(model.rig, term.effect)]


def _reads_torque_or_table(effect: Effect) -> bool:
    """Whether an effect reads the model's own torque, or is a table."""
    return effect.loaded or isinstance(effect, TorqueTable)


def keep_held_out_accuracy(
    judged: IdentificationResult, whole: IdentificationResult
) -> IdentificationResult:
    """Return an estimate from all data with the held-out accuracy of one that had not seen what was held out.

    That accuracy is of fewer data than the result has, so it errs on the safe side.

    Args:
        judged: Estimated with something held out.
        whole: The same with nothing held out.
    """
    if judged.held_out is None:
        return whole
    note = f"the parameters are of all data; the accuracy on '{judged.held_out.how}' is that of a fit without it"
    model = replace(whole.model, doubts=judged.model.doubts)
    notes = (*whole.notes, note)
    kept = replace(whole, held_out=judged.held_out, simpler=judged.simpler, holdout=judged.holdout)
    return replace(kept, model=model, notes=notes)


def _fit_shown(
    rig: Rig,
    effects: tuple[Effect, ...],
    logs: tuple[Log, ...],
    filters: Filtering,
    estimator: Estimator,
    base: BaseMotion,
    hidden: tuple[Effect, ...] = (),
) -> tuple[DesignBlocks, Estimate, Array]:
    """Fit the base parameters that a motion of the base shows; if the logs hide some, those of a lesser motion.

    Friction and rotors are fitted beside the `effects`; rotors that the logs hide stay as stated. Beside the rows and
    the estimate it returns the covariance of the torques' lags, s², (n, n).

    Raises:
        DataError: Too few rows, or parameters without a trace that a fixed base would show.
    """
    reduction = reduce_parameters(rig, base=base)
    stated = build_stated_effects(rig, reduction)
    further = (one for one in effects if one not in stated)
    fitted = (*(one for one in stated if one not in hidden), *further)
    rows = compute_blocks(Design(rig, reduction, fitted, logs, filters))
    check_enough(rows)
    (blocks,), late = align_rows([rows])
    estimate = estimator(blocks)
    unseen = find_unseen(blocks.design.names, blocks, estimate)
    rotors = tuple(
        x
        for x in fitted
        if x in stated and x.like_inertia and not x.coupling and f"{x.joint}.Ia" in unseen
    )
    if rotors:
        return _fit_shown(rig, effects, logs, filters, estimator, base, (*hidden, *rotors))
    if base != "fixed" and unseen:
        return _fit_shown(
            rig, effects, logs, filters, estimator, BASE_MOTIONS[BASE_MOTIONS.index(base) - 1]
        )
    check_seen(logs[0].name, blocks.design.names, blocks, estimate)
    return blocks, estimate, late


def greatest_base_motion(rig: Rig, logs: Sequence[Log]) -> BaseMotion:
    """Return the greatest motion of the base in some logs."""
    return max(
        (classify_base_motion(rig, log) for log in logs), key=BASE_MOTIONS.index, default="fixed"
    )
