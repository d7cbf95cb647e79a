"""Which causes a log of a motion would show, from which size on, and what each would be taken for.

Every cause is planted on the nominal rig's log of the motion. What the model without causes leaves of its torque says
from which size `diagnose` finds it, and what other causes leave of that, from which size it alone is named.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, fields, replace
from math import sqrt
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.diagnosis.candidates import DRIVES, RESONANCE_SHARE, Candidate
from gimbal_pin.diagnosis.explanation import Explanation, search_rows
from gimbal_pin.diagnosis.interpret import build_physical
from gimbal_pin.diagnosis.rows import build_rows, choose_band
from gimbal_pin.diagnosis.search import Hit
from gimbal_pin.diagnosis.settings import SETTINGS, Settings
from gimbal_pin.diagnosis.visibility import (
    NINETEEN_OF_TWENTY,
    Group,
    compute_size,
    compute_sure_gain,
    get_joint,
    list_forms,
    list_groups,
    measure_rivals,
    shows_in_motion,
    whiten_torque,
)
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import CAUSES, Effect, Term
from gimbal_pin.errors import DataError
from gimbal_pin.excitation import record_log
from gimbal_pin.log.io.columns import LEAST_TRAVEL
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.regression import subsample_log
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator

MOST_FORMS = 16
"""Most forms of a cause that are planted: those in front, and ever fewer of a hundred harmonics."""
LARGEST_SHARE = 1.0
"""Largest torque of a cause that a rig may have, as a share of its joint's largest. It changes no verdict."""
SOFTEST = 1.01 * RESONANCE_SHARE[0]
"""Share of a joint's torque behind its spring that is planted at least: less is no spring that is looked for."""
WEAK = "the motion shows it only at sizes that no rig has"
STILL = "the motion holds the joint still"
COMMANDED = "it acts on the controller's command, which a motion does not hold"


@dataclass(frozen=True)
class CauseAt:
    """A cause's name and its joint, None for the whole rig."""

    cause: str
    joint: str | None


@dataclass(frozen=True)
class Size:
    """Size of a cause.

    Attributes:
        parameter: Name of the figure that states it.
        value: Its value.
        unit: Its unit.
        share_of_torque: Torque that it adds over the joint's, rms over rms.
        sentence: All of the cause that was planted, in words.
        effect: The same as `simulate --effect` takes it.
    """

    parameter: str
    value: float
    unit: str
    share_of_torque: float
    sentence: str
    effect: str


@dataclass(frozen=True)
class Rehearsed(CauseAt):
    """A cause at its place, in one form or in some: other harmonics, other speeds.

    Attributes:
        forms: Forms that were planted.
        shown: Number of them that a log shows.
        seen_from: Size from which it, or what it is taken for, is found, of the middle form; None: none is.
        named_from: Size from which it alone is named; None: from none on.
        confused_with: Causes that it may be taken for at `seen_from`, or, if it is never named, at any size.
        why: Reason why no log of the motion shows it; None where one does.
    """

    forms: int = 0
    shown: int = 0
    seen_from: Size | None = None
    named_from: Size | None = None
    confused_with: tuple[CauseAt, ...] = ()
    why: str | None = None


@dataclass(frozen=True, eq=False)
class Rehearsal(Record):
    """Result of `rehearse`.

    Attributes:
        rig: The rig's name.
        seconds: Length of the log, s.
        causes: Every cause at every place.
    """

    rig: str
    seconds: float
    causes: tuple[Rehearsed, ...]

    ROWS: ClassVar[str] = "causes"
    __repr__ = brief

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return {"schema": 1, **asdict(self)}


@limit_to_one_thread()
@check_arguments
def rehearse(
    rig: Rig,
    motion: Motion,
    *,
    still: Collection[str] = (),
    torque_noise: float = 0.01,
    rng: Rng = None,
    settings: Settings = SETTINGS,
) -> Rehearsal:
    """Compute which causes `diagnose` would find in a log of a motion, from which size on, and as which.

    Causes that compare the given model with the data are left out: the refitted model takes them up.

    Args:
        rig: The rig, its encoders and gyros.
        motion: The motion, of the rig's joints.
        still: Joints that the motion holds still, and that are fixed in the rig.
        torque_noise: White noise on the reported torque, as a share of each joint's torque rms.
        rng: Source of the sensors' noise, or its seed; None: a fresh one.
        settings: Constants of the diagnosis.

    Raises:
        DataError: The motion is too short to judge, or does not move a joint.
    """
    idle = tuple(x for x, q in zip(rig.joints, motion.q.T) if np.ptp(q) < LEAST_TRAVEL)
    if idle:
        mend = "move every joint: see 'gimbal-pin excite'"
        raise DataError("the motion", "shows nothing of", mend, idle)
    log = record_log(nominal(rig), motion, torque_noise, make_generator(rng)[0])
    log = subsample_log(log).log
    rows = build_rows(rig, [log], choose_band([log], settings), settings)
    explanation = search_rows(rig, rows, "fixed", [None] * len(rows.stretches), settings)
    first = explanation.found.first.fit
    groups = list_groups(explanation.search, explanation.found.shelves, first.theta)
    forms = list_forms(first, groups)
    causes = list[Rehearsed]()
    for kind in CAUSES.values():
        if kind.of_given_model:
            continue
        if kind.of_joint:
            causes += [Rehearsed(kind.name, joint, why=STILL) for joint in still]
        for place in rig.joints if kind.of_joint else ("rig",):
            tried = forms.get((kind.name, place), [])
            plain = [x for x in tried if _get_formula(x[0]) == _get_formula(tried[0][0])]
            picked = np.geomspace(1, len(plain) or 1, MOST_FORMS).round()
            plain = [x for k, x in enumerate(plain, 1) if k in picked]
            shown = [candidate for candidate, share in plain if share >= settings.min_left_share]
            why = kind.hidden if shows_in_motion(kind) else COMMANDED
            about = Rehearsed(kind.name, get_joint(place), len(plain), len(shown), why=why)
            row = about
            middle = (len(shown) - 1) / 2
            for k in sorted(range(len(shown)), key=lambda k: abs(k - middle)):
                row = _rehearse_form(explanation, groups, about, shown[k])
                if row.seen_from is not None:
                    break
            if not kind.is_stated(place, rig):
                causes.append(row)
    order = [*rig.joints, *still, None]
    causes.sort(key=lambda row: order.index(row.joint))
    return Rehearsal(rig.name, float(motion.t[-1] - motion.t[0]), tuple(causes))


def _get_formula(candidate: Candidate) -> list[object]:
    """Return the fields of a cause that no person states."""
    cause = candidate.cause
    stated = {one.name for one in cause.stated()}
    return [getattr(cause, field.name) for field in fields(cause) if field.name not in stated]


def _rehearse_form(
    explanation: Explanation, groups: Sequence[Group], row: Rehearsed, candidate: Candidate
) -> Rehearsed:
    """Return from which size on a log shows a form of a cause, and what it is taken for up to which size.

    Args:
        explanation: The models of the log.
        groups: All candidates.
        row: What is known of the cause.
        candidate: The form.
    """
    search = explanation.search
    problem = search.problem
    settings = problem.settings
    first = explanation.found.first
    cause = candidate.cause
    joint = candidate.joint
    at = slice(None) if joint is None else joint
    columns = search.build_columns(candidate, first.torque, first.fit.theta)
    names = [x.name for x in cause.coefficients] if isinstance(cause, Effect) else []
    stated = [names.index(x.name) for x in cause.stated() if x.name in names]
    direction = np.eye(columns.width)[stated[0] if stated else 0]
    if joint is None:
        direction = -direction  # an offset and a turn have the other sign than what they move
    torque = {j: x @ direction for j, x in columns.rows.items()}
    added = np.stack([torque.get(j, np.zeros(len(problem.measured))) for j in problem.joints], 1)
    share = float(np.max(problem.compute_rms(added[problem.rows.inner]) / problem.torque_rms))
    largest = np.array([one.peak for one in problem.ranges])[at]
    peak = max(float(np.max(np.abs(x @ direction) / largest)) for x in columns.torques)

    def is_possible(size: float) -> bool:
        is_small = size * peak <= LARGEST_SHARE
        return is_small and candidate.is_admissible(size * direction, np.zeros(0))

    fit = first.fit.refit(whiten_torque(search, torque))
    count = float(fit.rows[:, at].sum())
    power = float(np.sum(fit.squared_errors * fit.weight))
    gain = compute_sure_gain(settings.gain_nats - candidate.log_prior, search.least_deviations)
    # The fitted torque, whose size is known to one over the root of its power, must be material.
    hit = Hit(candidate, np.zeros(2), direction)
    beside = float(np.max(search.measure_torque(first, hit) / problem.torque_rms))
    least = settings.material_share / beside + NINETEEN_OF_TWENTY / sqrt(power)
    bound = SOFTEST if candidate.name in DRIVES else 0.0
    seen = max(compute_size(gain, power, count), least, bound)
    if not is_possible(seen):
        return replace(row, shown=0, why=WEAK)
    needed = dict[CauseAt, float]()
    rivals = measure_rivals(search, fit, groups, candidate, seen)
    for (name, place), (left, prior) in rivals.items():
        odds = prior - candidate.log_prior + settings.kept_nats
        gain = compute_sure_gain(max(settings.kept_nats, odds), search.count_deviations(1))
        needed[CauseAt(name, get_joint(place))] = compute_size(gain, left, count)
    named = max([seen, *needed.values()])
    is_named = is_possible(named)
    alike = [x for x in needed if needed[x] > seen and (is_named or not is_possible(needed[x]))]
    return replace(
        row,
        seen_from=_describe_size(candidate, seen * direction, seen * share, problem.rig),
        named_from=_describe_size(candidate, named * direction, named * share, problem.rig)
        if is_named
        else None,
        confused_with=tuple(sorted(alike, key=lambda x: -needed[x])),
        why=None,
    )


def _describe_size(candidate: Candidate, coefficients: Array, share: float, rig: Rig) -> Size:
    """Return a size in the units of its joint: the first of the cause's figures that it changes."""
    values = coefficients.tolist()
    physical = build_physical(candidate.cause, values, rig)
    cause, given = (physical.effect, values) if isinstance(physical, Term) else (physical, [])
    shown = cause.shown(given)
    without = candidate.cause.shown([0.0] * len(given))
    figure = next((x for x, other in zip(shown, without) if x.value != other.value), shown[0])
    # The same as a person states it: ``cogging:yaw:amplitude=0.03,harmonic=42``.
    figures = {field.name: getattr(cause, field.name) for field in fields(cause)}
    figures |= {x.name: x.value for x in shown}
    stated = [x for x in cause.stated() if figures.get(x.name, x.value) != x.value]
    pairs = ",".join(f"{x.name}={float(figures[x.name]):.6g}" for x in stated)
    return Size(
        figure.name,
        figure.value,
        rig.in_units(cause.place, figure.unit),
        share,
        rig.in_units(cause.place, cause.sentence(given)),
        f"{cause.name}:{cause.place}:{pairs}" if cause.of_joint else f"{cause.name}:{pairs}",
    )
