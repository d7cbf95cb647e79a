"""What a studio is about, prepared once, and the model and the controller of a state."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gimbal_pin.control.tuning import Tuning, TuningBasis, tune
from gimbal_pin.diagnosis.rows import Rows
from gimbal_pin.diagnosis.traces import build_model_rows
from gimbal_pin.dynamics.model import Estimated, Model, is_inertia_positive, nominal
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import name_columns
from gimbal_pin.effects import Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.payload_mass import PayloadMass
from gimbal_pin.effects.payload_shift import PayloadShift
from gimbal_pin.effects.rig_effect import get_payload
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import identify, split_logs
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import BASE_MOTIONS, Platform
from gimbal_pin.pointing import WANTED, Recipe, Station, draw_profile, learn_recipe, unable
from gimbal_pin.regression import Filtering, limit_cutoff
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig
from gimbal_pin.studio.state import StudioState


@dataclass(frozen=True, eq=False)
class StudioSource:
    """What the command line named.

    Attributes:
        rig: The rig, with the payload of the logs.
        logs: Its logs; none: nothing is identified.
        model: Its model; None: identified from the logs, or as the URDF states it where there are none.
        filtering: As for `identify`.
        seconds: Length of the run on a platform that shows the pointing error, s: half a second is a tenth of a second
            of work, so that it follows a slider; `track` judges by 30.
        seed: Seed of that run's motion and noise: the same for every state, so that only what was moved changes it.
    """

    rig: Rig
    logs: tuple[Log, ...] = ()
    model: Model | None = None
    filtering: Filtering | None = None
    seconds: float = 0.5
    seed: int = 1

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Subject:
    """What does not change while sliders move.

    Attributes:
        rig: The rig as its URDFs state it, with the chosen payload.
        model: Its model, the payload where the URDF has it.
        rows: The judged part of the logs; None: there is no log.
        recipe: What a controller that holds the camera is made of; None: this rig cannot hold it.
        platform: The motion along which the camera is held; None as above.
        unable: Why it cannot; empty: it can.
        seed: Seed of the sensors' noise along it.
    """

    rig: Rig
    model: Model
    rows: Rows | None
    recipe: Recipe | None
    platform: Platform | None
    unable: str = ""
    seed: int = 1

    __repr__ = brief


def prepare_subject(
    source: StudioSource, payload: str | None = None, judged: tuple[float, float] | None = None
) -> Subject:
    """Return what figures are computed from, once per payload and marked part: seconds where a log is identified.

    Args:
        source: What was given.
        payload: Another camera than the logs', which replaces theirs body for body; None: theirs.
        judged: The part of the logs that only judges, see `split_at`; None: what `identify` holds out.

    Raises:
        GimbalPinError: A payload cannot be mounted, or the logs do not show the parameters.
    """
    rig = source.rig
    logs = source.logs
    model = source.model
    filters = source.filtering
    parts = logs if judged is None or not logs else split_at(logs, *judged)
    how = None if parts is logs else f"log:{len(parts)}"
    if model is None:
        model = (
            identify(rig, parts, holdout=how, filtering=filters, examined="never").model
            if logs
            else nominal(rig)
        )
        judges = (
            split_logs(parts, how, filters or limit_cutoff(Filtering(), logs))[1] if logs else ()
        )
    else:
        judges = logs if parts is logs else parts[-1:]
    rows = build_model_rows(model, judges) if judges else None
    if payload is not None:
        other = mount_payload(rig, payload)
        is_stated = source.model is None and not logs
        model = nominal(other) if is_stated else transfer_bodies(model, rig, other)
        rig = other
    if reason := unable(rig, WANTED):
        return Subject(rig, model, rows, None, None, reason)
    recipe = learn_recipe(rig, None, Station.of(rig), model)
    platform = draw_profile(rig, source.seconds, source.seed)
    return Subject(rig, model, rows, recipe, platform, seed=source.seed)


def mount_payload(rig: Rig, payload: str | None) -> Rig:
    """Return the rig with another payload; None: with its own."""
    return rig if payload is None else Rig.load(rig.source, payload, fixed=rig.config.fixed)


def list_ends(logs: Sequence[Log]) -> Array:
    """Return where each log begins, and the last one ends, on an axis on which they follow each other, s."""
    return np.cumsum([0.0, *(log.t[-1] - log.t[0] for log in logs)])


def find_marked_log(logs: Sequence[Log], first: float, last: float) -> int:
    """Return which log a part of the axis of `list_ends` is of: the one that holds its middle."""
    return min(int(np.searchsorted(list_ends(logs)[1:], (first + last) / 2)), len(logs) - 1)


def split_at(logs: Sequence[Log], first: float, last: float) -> tuple[Log, ...]:
    """Return what trains, and as the last the part of one log between two times on the axis of `list_ends`."""
    k = find_marked_log(logs, first, last)
    log = logs[k]
    others = (*logs[:k], *logs[k + 1 :])
    begin, end = np.searchsorted(log.t - log.t[0] + list_ends(logs)[k], [first, last]).tolist()
    around = [
        log.part(part) for part in (slice(0, begin), slice(end, None)) if len(log.t[part]) > 1
    ]
    if end - begin < 2 or not (around or others):
        raise UsageError(
            "judged part", "leaves nothing to judge or to learn from", "mark a third of the log"
        )
    return (*around, *others, log.part(slice(begin, end)))


def list_causes(model: Model) -> tuple[str, ...]:
    """Return the causes of a model that can be switched off: torques and drives, ``coulomb at yaw``."""
    return tuple(
        dict.fromkeys(map(name_cause, (*(term.effect for term in model.terms), *model.drive)))
    )


def name_cause(cause: Cause) -> str:
    """Return how a cause is called in `StudioState.off`."""
    return f"{cause.name} at {cause.place}"


def build_plant(subject: Subject, state: StudioState) -> Model:
    """Return the gimbal of a state: its model with the payload moved, every cause acting.

    Raises:
        UsageError: No body can have such a payload, or no rig moves with it.
    """
    changes: list[PayloadMass | PayloadShift] = []
    if state.mass is not None:
        changes.append(PayloadMass(state.mass - float(get_payload(subject.rig)[1].mass)))
    if state.x or state.y or state.z:
        changes.append(PayloadShift(state.x, state.y, state.z))
    if not changes:
        return subject.model
    moved = subject.rig
    for change in changes:
        moved = change.apply(moved)
    return transfer_bodies(subject.model, subject.rig, moved)


def build_model(subject: Subject, state: StudioState) -> Model:
    """Return what the controller of a state knows: the gimbal without the causes that are off."""
    model = build_plant(subject, state)
    if not state.off:
        return model
    is_known = partial(_is_known, off=frozenset(state.off))
    terms = tuple(term for term in model.terms if is_known(term.effect))
    known = model.estimated and _select_terms(model.estimated, model.terms, terms)
    return replace(model, terms=terms, drive=tuple(filter(is_known, model.drive)), estimated=known)


def _is_known(cause: Cause, off: frozenset[str]) -> bool:
    """Whether a cause is not among those that are off."""
    return name_cause(cause) not in off


def _select_terms(known: Estimated, terms: Sequence[Term], kept: Sequence[Term]) -> Estimated:
    """Return what is known of the base parameters and of some of the terms."""
    counts = [len(term.values) for term in terms]
    base = len(known.names) - sum(counts)
    ends = base + np.cumsum([0, *counts])
    is_kept = [any(term is one for one in kept) for term in terms]
    places = [range(base), *(range(a, b) for a, b, keep in zip(ends, ends[1:], is_kept) if keep)]
    at = list(itertools.chain.from_iterable(places))
    names, units = (tuple(row[k] for k in at) for row in (known.names, known.units))
    return replace(
        known,
        names=names,
        units=units,
        theta=known.theta[at],
        covariance=known.covariance[np.ix_(at, at)],
    )


def tune_state(subject: Subject, state: StudioState, basis: TuningBasis | None = None) -> Tuning:
    """Return the controller of a state: what `tune` returns for the same model and wishes.

    `basis`: what is known of the state's model; None: it is worked out.
    """
    basis = basis or TuningBasis(build_model(subject, state))
    hertz = state.bandwidth_hz
    margin = state.disk_margin
    delay = state.delay
    return tune(basis.model, bandwidth_hz=hertz, disk_margin=margin, delay=delay, basis=basis)


def transfer_bodies(model: Model, given: Rig, other: Rig) -> Model:
    """Return a model on another rig: ``phi + phi(other) - phi(given)``, so that what was identified stays.

    Args:
        model: The model, on `given` with the bodies as they were identified.
        given: That rig as its URDFs state it.
        other: The same gimbal with another payload, as stated.

    Raises:
        UsageError: The joints are others, or the inertia is not positive at some pose.
    """
    if other.joints != given.joints:
        raise UsageError(
            "payload", f"brings the joints {', '.join(other.joints)}", "choose one without joints"
        )
    change = other.phi - given.phi
    rig = other.with_phi(model.rig.phi + change)
    if not is_inertia_positive(rig, rotors=model.armature):
        raise UsageError(
            "payload",
            "leaves the joints an inertia that no rig has",
            "move it back, or make it heavier",
        )
    known = model.estimated
    return replace(
        model, rig=rig, estimated=None if known is None else _move_parameters(known, model, change)
    )


def _move_parameters(known: Estimated, model: Model, change: Array) -> Estimated:
    """Return what is known of base parameters when the bodies change by `change`, (10 n,); the covariance stays."""
    width = len(known.names) - sum(len(term.values) for term in model.terms)
    for diagonal, base in itertools.product((False, True), BASE_MOTIONS):
        reduction = reduce_parameters(model.rig, diagonal, base)
        if reduction.base_names == tuple(known.names[:width]):
            theta = known.theta.copy()
            theta[:width] += reduction.mixing @ change[name_columns(model.rig, diagonal)[1]]
            return replace(known, theta=theta)
    return known
