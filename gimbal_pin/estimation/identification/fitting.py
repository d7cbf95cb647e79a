"""Rows of the logs, an estimate from them, and what was held out to judge it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gimbal_pin.dynamics.model import Model, friction_effects
from gimbal_pin.dynamics.reduction import reduce
from gimbal_pin.dynamics.threads import one_thread
from gimbal_pin.effects import ALWAYS, Effect
from gimbal_pin.estimation import payload_change
from gimbal_pin.estimation.bodies import TRUST
from gimbal_pin.estimation.channel_assignment import check_wiring
from gimbal_pin.estimation.estimators import Estimate, Estimator, weighted
from gimbal_pin.estimation.hausman_check import Asked, suspicion
from gimbal_pin.estimation.identification.assembling import assembled
from gimbal_pin.estimation.identification.bound import best, usual
from gimbal_pin.estimation.identification.holding_out import split
from gimbal_pin.estimation.identification.identified import Identified
from gimbal_pin.estimation.identification.misfit import honest
from gimbal_pin.estimation.identification.seen import check_seen, check_unit, enough, unseen, within
from gimbal_pin.estimation.identification.warning import faults
from gimbal_pin.estimation.rows import Filtering, Regression, Rows, base_motion, kept
from gimbal_pin.log.calibration import rectified
from gimbal_pin.log.log import Log
from gimbal_pin.log.platform import MOTIONS, BaseMotion
from gimbal_pin.rig.rig import Rig


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
    trust: float = TRUST,
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
        filtering: Cutoff and alignment; None: the defaults, a wider cutoff where the base turns, see `bound.usual`.
        examined: Whether to test if least squares is biased on these logs, see `hausman_check`, and, unless "never",
            what the audit says of them, if their halves are of one rig, see `payload_change.apart`, and what logs of a
            base that turned tell at best.
        trust: Relative standard deviation of the URDF's masses, see `bodies`.

    Raises:
        DataError: The logs are too short, or some parameters leave no trace in them; it names these.
        UsageError: An unknown way of holding out, or a log without torque.
        LogError: A torque has the wrong sign, or two have changed places, see `channel_assignment.check_wiring`.
    """
    for log in logs:
        within(log, filtering or Filtering())
        check_unit(rig, log)
    calibrated = [rectified(rig, log) for log in logs]
    notes = tuple(said for log, one in zip(logs, calibrated) for said in one.log.events if said not in log.events)
    logs = [one.log for one in calibrated]
    filters = filtering or usual(logs, moved(rig, logs))
    train, test, how = split(logs, holdout, filters)
    everything = friction_effects(rig.joints) + tuple(effects)
    base = moved(rig, train)
    blocks, estimate = fitted(rig, everything, train, filters, estimator, base)
    check_wiring(blocks, estimate)
    estimate, missed = honest(blocks, estimate)
    notes += tuple(
        f"{log.name} only judged the others and taught nothing; --refit learns from all" for log in whole(test, logs)
    )
    tested = kept(replace(blocks.rows, logs=test)) if test else None
    found = assembled(blocks.rows, blocks, estimate, tested, how, trust)
    mountings = {one.log.name: one.mountings for one in calibrated if one.mountings}
    judged = suspicion(blocks, examined, estimate.method)
    parting = None
    if examined != "never":
        parting = payload_change.apart([*blocks, *(tested or ())], payload_change.directions(blocks.rows))
    # Noise in the angles biases either half in its own way: that is said already, and is no second rig.
    noisy = judged is not None and judged.test is not None and judged.test.biased and judged.by_noise
    notes += (payload_change.sentence(len(logs)),) if parting is not None and parting > 1 and not noisy else ()
    return replace(
        found,
        logs=tuple(log.name for log in logs),
        mountings=mountings,
        notes=notes,
        bias=judged,
        parting=parting,
        missed=dict(zip(rig.joints, missed)),
        faults=() if examined == "never" else faults(rig, logs),
        bound=None
        if examined == "never" or base != "rotating"
        else best(lambda wide: fitted(rig, everything, train, wide, weighted, base), filters, found.names),
    )


def added(model: Model) -> tuple[Effect, ...]:
    """Return the effects of a model beside Coulomb and viscous friction that logs can be fitted with again.

    Not those that read the model's own torque: the rows have but the measured one, whose noise would leak.
    """
    usual = {kind.name for kind in ALWAYS}
    return tuple(term.effect for term in model.terms if term.effect.name not in usual and not term.effect.loaded)


def whole(held_out: Sequence[Log], logs: Sequence[Log]) -> list[Log]:
    """Return the logs that were held out as a whole."""
    return [log for log in held_out if any(log is one for one in logs)]


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
