"""Which causes a log of a motion would show, from which size on, and what each would be taken for.

Every cause is planted on the nominal rig's log of the motion. What the model without causes leaves of its torque says
from which size `diagnose` finds it, and what other causes leave of that, from which size it alone is named.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, fields, replace
from math import inf, log
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.diagnosis.candidates import DRIVES, RESONANCE_SHARE, Candidate
from gimbal_pin.diagnosis.explanation import Explanation, search_rows
from gimbal_pin.diagnosis.interpret import build_physical
from gimbal_pin.diagnosis.planning import (
    NINETEEN_OF_TWENTY,
    Group,
    compute_power,
    compute_size,
    compute_sure_gain,
    list_groups,
    measure_left,
    whiten_torque,
)
from gimbal_pin.diagnosis.rows import build_rows, choose_band
from gimbal_pin.diagnosis.score import BlockFit
from gimbal_pin.diagnosis.search import LEAST_LEFT, Hit, Search, Solution
from gimbal_pin.diagnosis.settings import SETTINGS, Settings
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import CAUSES, Cause, Effect, RigEffect, Term
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import DataError
from gimbal_pin.excitation import record_log
from gimbal_pin.log.io.columns import LEAST_TRAVEL
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.regression import subsample_log
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator

PLANTED_HARMONICS = 8
"""Harmonics of a cause that are planted, of all that are looked for."""
LARGEST_SHARE = 1.0
"""Largest torque of a cause that a rig may have, as a share of its joint's largest."""
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
    """A cause at its place, planted in one form or in some: other harmonics, other speeds.

    Attributes:
        forms: Forms that were planted.
        shown: Number of them that a log shows at a size that a rig may have.
        seen_from: Size from which it, or what it is taken for, is found; of the median of these forms. None: none is.
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
    upright = [None] * len(rows.stretches)
    explanation = search_rows(rig, rows, "fixed", upright, settings)
    groups = list_groups(explanation)
    kinds = [kind for kind in CAUSES.values() if not kind.of_given_model]
    causes = [
        _rehearse_cause(explanation, groups, kind, place)
        for place in (*rig.joints, "rig")
        for kind in kinds
        if kind.of_joint == (place != "rig") and not kind.is_stated(place, rig)
    ]
    of_joints = [kind.name for kind in kinds if kind.of_joint]
    causes += [Rehearsed(name, joint, why=STILL) for joint in still for name in of_joints]
    return Rehearsal(rig.name, float(motion.t[-1] - motion.t[0]), tuple(causes))


@dataclass(frozen=True, eq=False)
class _Planted:
    """A form of a cause and what is expected of it.

    Attributes:
        candidate: The form.
        direction: Its coefficients where its size is one, (c,).
        fit: The model without causes, fitted to its torque at that size.
        share: Torque that it then adds over the joint's, rms over rms.
        peak: The same of the largest torques, near standstill as well.
        seen: Size from which it is found.
    """

    candidate: Candidate
    direction: Array
    fit: BlockFit
    share: float
    peak: float
    seen: float

    def is_possible(self, size: float) -> bool:
        """Return whether a rig may have it at a size."""
        is_small = size * self.peak <= LARGEST_SHARE
        return is_small and self.candidate.is_admissible(size * self.direction, np.zeros(0))

    def find_size(self, gain: float, power: float) -> float:
        """Return the size from which a power at size one is expected to gain so many nats."""
        rows = self.fit.rows.sum(axis=0)
        joint = self.candidate.joint
        return compute_size(gain, power, float(rows.sum() if joint is None else rows[joint]))


def _rehearse_cause(
    explanation: Explanation, groups: Sequence[Group], kind: type[Cause], place: str
) -> Rehearsed:
    """Return what a log shows of a cause at a place: of the form that is the median of those that show."""
    rig = explanation.search.problem.rig
    joint = None if place == "rig" else place
    if not issubclass(kind, Effect | RigEffect) and kind.name not in DRIVES:
        return Rehearsed(kind.name, joint, why=COMMANDED)
    forms = _pick_forms(explanation.found.first, groups, kind.name, place)
    planted = [_plant(explanation, form) for form, remaining in forms if remaining >= LEAST_LEFT]
    shown = [one for one in planted if one.is_possible(one.seen)]
    if not shown:
        why = WEAK if planted else kind.hidden
        return Rehearsed(kind.name, joint, len(forms), why=why)
    one = sorted(shown, key=lambda one: one.seen * one.share)[(len(shown) - 1) // 2]
    needed = _measure_rivals(explanation.search, groups, one)
    size = max([one.seen, *needed.values()])
    named = _describe_size(one, size, rig) if one.is_possible(size) else None
    alike = [
        x for x in needed if needed[x] > one.seen and (named or not one.is_possible(needed[x]))
    ]
    alike = sorted(alike, key=lambda x: -needed[x])
    seen = _describe_size(one, one.seen, rig)
    return Rehearsed(kind.name, joint, len(forms), len(shown), seen, named, tuple(alike))


def _pick_forms(
    first: Solution, groups: Sequence[Group], name: str, place: str
) -> list[tuple[Candidate, float]]:
    """Return what is planted of a cause, with the share that the model does not explain.

    It is every shape of its plainest formula, with which a grid begins, or some of its harmonics.
    """
    forms = list[tuple[Candidate, float]]()
    for candidates, pack in groups:
        if any((one.name, one.place) == (name, place) for one in candidates):
            shares = first.fit.measure(pack).remaining.tolist()
            forms += [x for x in zip(candidates, shares) if x[0].name == name]
    if forms and isinstance(forms[0][0].cause, Harmonic):
        picked = np.geomspace(1, len(forms), PLANTED_HARMONICS).round().astype(int) - 1
        return [forms[k] for k in np.unique(picked)]
    return [x for x in forms if _get_form(x[0].cause) == _get_form(forms[0][0].cause)]


def _get_form(cause: Cause) -> list[object]:
    """Return the fields of a cause that no person states: they choose its formula."""
    stated = {one.name for one in cause.stated()}
    return [getattr(cause, field.name) for field in fields(cause) if field.name not in stated]


def _plant(explanation: Explanation, candidate: Candidate) -> _Planted:
    """Return a form of a cause with the size from which it is found."""
    search = explanation.search
    problem = search.problem
    settings = problem.settings
    solution = explanation.found.first
    columns = search.build_columns(candidate, solution.torque, solution.fit.theta)
    cause = candidate.cause
    names = [x.name for x in cause.coefficients] if isinstance(cause, Effect) else []
    stated = [names.index(x.name) for x in cause.stated() if x.name in names]
    direction = np.eye(columns.width)[stated[0] if stated else 0]
    if candidate.joint is None:
        direction = -direction  # an offset and a turn have the other sign than what they move
    rows = {j: x @ direction for j, x in columns.rows.items()}
    fit = solution.fit.refit(whiten_torque(search, rows))
    hit = Hit(candidate, np.zeros(2), direction)
    beside = search.measure_torque(solution, hit) / problem.torque_rms
    none = np.zeros(len(problem.rows.inner))
    whole = np.stack([rows.get(j, none) for j in problem.joints], axis=1)
    share = problem.compute_rms(whole[problem.rows.inner]) / problem.torque_rms
    levels = np.array([one.peak for one in problem.ranges])
    level = levels if candidate.joint is None else levels[candidate.joint]
    peak = max(float(np.max(np.abs(x @ direction) / level)) for x in columns.torques)
    planted = _Planted(candidate, direction, fit, float(share.max()), peak, 0.0)
    gain = compute_sure_gain(settings.gain_nats - candidate.log_prior, search.least_deviations)
    power = compute_power(fit)
    # The fitted torque, whose size is known to one over the root of its power, must be material.
    least = settings.material_share / float(beside.max()) + NINETEEN_OF_TWENTY / np.sqrt(power)
    bound = SOFTEST if candidate.name in DRIVES else 0.0
    seen = float(max(planted.find_size(gain, power), least, bound))
    return replace(planted, seen=seen)


def _measure_rivals(search: Search, groups: Sequence[Group], one: _Planted) -> dict[CauseAt, float]:
    """Return the other causes that may stand for a planted one → size from which it is told from each."""
    problem = search.problem
    settings = problem.settings
    own = one.candidate
    needed = dict[CauseAt, float]()
    for candidates, pack in groups:
        if None not in (own.joint, candidates[0].joint) and own.joint != candidates[0].joint:
            continue
        left, gains = measure_left(one.fit, pack)
        for k in np.argsort(left).tolist():
            rival = candidates[k]
            place = CauseAt(rival.name, rival.place if rival.place != "rig" else None)
            values = one.seen * gains.coefficients[k]
            is_told = gains.remaining[k] < LEAST_LEFT or rival.kind == own.kind or place in needed
            if is_told or not rival.is_admissible(values, np.zeros(0)):
                continue
            odds = rival.log_prior - own.log_prior - log(settings.rival_probability)
            gain = compute_sure_gain(max(settings.kept_nats, odds), search.count_deviations(1))
            needed[place] = one.find_size(gain, float(left[k]))
    if own.joint is not None:
        blurred = own.cause.blurred(problem.ranges[own.joint])
        needed |= {CauseAt(name, own.place): inf for name in blurred}
    return needed


def _describe_size(one: _Planted, size: float, rig: Rig) -> Size:
    """Return a size in the units of its joint: the first of the cause's figures that it changes."""
    values = (size * one.direction).tolist()
    physical = build_physical(one.candidate.cause, values, rig)
    cause, given = (physical.effect, values) if isinstance(physical, Term) else (physical, [])
    shown = cause.shown(given)
    without = one.candidate.cause.shown([0.0] * len(given))
    changed = [x for x, other in zip(shown, without) if x.value != other.value]
    figure = next(iter(changed), shown[0])
    unit = rig.in_units(cause.place, figure.unit)
    sentence = rig.in_units(cause.place, cause.sentence(given))
    share = size * one.share
    return Size(figure.name, figure.value, unit, share, sentence, _write_effect(cause, shown))


def _write_effect(cause: Cause, shown: Sequence[Parameter]) -> str:
    """Return a cause with these figures as a person states it: ``cogging:yaw:amplitude=0.03,harmonic=42``."""
    values = {field.name: getattr(cause, field.name) for field in fields(cause)}
    values |= {one.name: one.value for one in shown}
    stated = [x for x in cause.stated() if x.name in values and values[x.name] != x.value]
    pairs = ",".join(f"{x.name}={float(values[x.name]):.6g}" for x in stated)
    place = f"{cause.place}:" if cause.of_joint else ""
    return f"{cause.name}:{place}{pairs}"
