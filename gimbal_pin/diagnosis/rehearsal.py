"""Which causes a log of a motion would show, from which size on, and what each would be taken for.

A cause of size a adds ``a X_g u`` to the torque of a log with nothing else in it. Columns X_h are expected to lower its
weighted sum of squares by ``a² uᵀ K_gh K_hh⁺ K_hg u``, where K are the inner products of what the rigid model leaves of
all whitened columns. So one matrix says for every size whether `diagnose` finds the cause, and which others explain as
much.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import islice
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from scipy.special import logit
from tqdm import tqdm

from gimbal_pin.checks.torque_time import LARGEST_SHIFT
from gimbal_pin.diagnosis.band import alternate_blocks, choose_band
from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.engine.alignment import project_slope
from gimbal_pin.diagnosis.engine.criterion import compare_with_form_error, rows
from gimbal_pin.diagnosis.engine.selection import PROMISE, REFITTED_CANDIDATES, Search
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.fit import Fit, project
from gimbal_pin.diagnosis.library import ColumnLibrary, list_candidates
from gimbal_pin.diagnosis.pipeline import check_moved, of_refitted
from gimbal_pin.diagnosis.probability import LUCKY, SURE, foresee_log_odds
from gimbal_pin.diagnosis.result import get_joint
from gimbal_pin.diagnosis.score import (
    HIDDEN,
    batches,
    fitting,
    products,
    share,
    visibility,
    weigh_together,
)
from gimbal_pin.diagnosis.shapes import form, free
from gimbal_pin.diagnosis.state import Problem, State, resize, solve_causes
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import CAUSES, Cause, Effect, RigEffect, Sample, Signal
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.excitation import record_log
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.regression import FORM_ERROR, subsample_log
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator

WEAK = "the motion shows it only at sizes that no rig has, or that stop the motor within the joint's limits"


@dataclass(frozen=True)
class CauseAt:
    """A cause's name and its joint, None for the whole rig."""

    cause: str
    joint: str | None


@dataclass(frozen=True)
class Size:
    """How large a cause is.

    Attributes:
        parameter: Name of the figure that says so.
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
        shown: How many of them a log shows at a size that a rig may have.
        seen_from: Size from which it, or what it is taken for, is found; of the median of these forms. None: none is.
        named_from: Size from which it alone is named; None: from none on.
        confused_with: What it may be taken for at `seen_from`, or, if it is never named, at any size; nearest first.
        why: Why no log of the motion shows it; None where one does.
    """

    forms: int = 0
    shown: int = 0
    seen_from: Size | None = None
    named_from: Size | None = None
    confused_with: tuple[CauseAt, ...] = ()
    why: str | None = None


@dataclass(frozen=True, eq=False)
class Rehearsal(Record):
    """What a log of a motion would show.

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


class _Planted(NamedTuple):
    """A form of a cause and what is expected of it.

    Attributes:
        cause: It, with its shape parameters.
        direction: Its coefficients where its size is one, (c,).
        rest: What the model leaves of its torque then, (rows n,).
        share: Torque that it then adds over the joint's.
        largest: Largest size that a rig may have.
        seen: Size from which it is found.
        named: Size from which it is told from all others.
        alike: What it is taken for at `seen`, or, where it is never named, at any size.
    """

    cause: Cause
    direction: Array
    rest: Array
    share: float
    largest: float
    seen: float
    named: float = np.inf
    alike: tuple[CauseAt, ...] = ()


def describe_size(one: _Planted, size: float, rig: Rig) -> Size:
    """Return a size in the units of its joint: the first of its figures that it changes."""
    cause = one.cause
    values = tuple((size * one.direction).tolist())
    if isinstance(cause, RigEffect):
        cause = resize(cause, values[0])
    given, none = (values, (0.0,) * len(values)) if isinstance(cause, Effect) else ((), ())
    shown = cause.shown(given)
    changed = [
        figure for figure, other in zip(shown, cause.shown(none)) if figure.value != other.value
    ]
    figure = next(iter(changed or (figure for figure in shown if figure.value)))
    unit, said = (rig.in_units(cause.place, x) for x in (figure.unit, cause.sentence(given)))
    return Size(figure.name, figure.value, unit, size * one.share, said, write_effect(cause, shown))


def write_effect(cause: Cause, shown: Sequence[Parameter]) -> str:
    """Return a cause with these figures as a person states it: ``cogging:yaw:amplitude=0.03,harmonic=42``."""
    values = {field.name: getattr(cause, field.name) for field in fields(cause)} | {
        p.name: p.value for p in shown
    }
    stated = [p for p in cause.stated() if p.name in values and values[p.name] != p.value]
    pairs = ",".join(f"{p.name}={float(values[p.name]):.6g}" for p in stated)
    return f"{cause.name}:{f'{cause.place}:' if cause.of_joint else ''}{pairs}"


@limit_to_one_thread()
@check_arguments
def rehearse(
    rig: Rig,
    motion: Motion,
    causes: Mapping[str, type[Cause]] = CAUSES,
    *,
    still: Collection[str] = (),
    torque_noise: float = 0.01,
    rng: Rng = None,
) -> Rehearsal:
    """Say which causes `diagnose` would find in a log of a motion, from which size on, and what it would take them for.

    Causes that compare the given model with the data are left out: the refitted model takes them up.

    Args:
        rig: The rig, its encoders and gyros.
        motion: The motion, of the rig's joints.
        causes: The causes to plant and to look for.
        still: Joints that the motion holds still, and that are fixed in the rig.
        torque_noise: White noise on the reported torque, as a share of each joint's torque rms.
        rng: Source of the sensors' noise, or its seed; None: a fresh one.

    Raises:
        DataError: The motion is too short to judge, or does not move a joint.
    """
    log = subsample_log(record_log(nominal(rig), motion, torque_noise, make_generator(rng)[0])).log
    band = replace(choose_band(rig, [log]), alignment=0.0)
    evidence = alternate_blocks(gather(rig, [log], band), band)[0]
    check_moved(evidence, "the motion")
    kinds = of_refitted(causes)
    library = ColumnLibrary(rig, list_candidates(evidence, kinds), of_model=True)
    search = Search.among(Problem.of(evidence, reduce_parameters(rig)), library)
    state = solve_causes(search.problem, ())
    bar = tqdm(library.causes, "rehearsal", unit="cause", disable=None, leave=False, delay=2)
    columns = [library.of(cause, state) for cause in bar]
    of_joints = [
        (joint, name, kind) for joint in rig.joints for name, kind in kinds.items() if kind.of_joint
    ]
    places = [
        CauseAt(name, joint) for joint, name, kind in of_joints if not kind.is_stated(joint, rig)
    ]
    places += [CauseAt(name, None) for name, kind in kinds.items() if not kind.of_joint]
    grids: dict[CauseAt, list[Columns]] = {at: [] for at in places}
    for one in columns:
        grids[get_place(one.cause)].append(one)
    planted = [
        plant_cause(search, state, one) for grid in grids.values() for one in pick_forms(grid)
    ]
    gains = explain_planted(
        state.fit, np.stack([one.seen * one.rest for one in planted], axis=1), columns
    )
    told = [compare_cause(search, state, *pair, columns) for pair in zip(planted, gains)]
    found = [
        summarize_forms(at, kinds[at.cause], [x for x in told if get_place(x.cause) == at], rig)
        for at in places
    ]
    idle = "the motion holds the joint still"
    found += [
        Rehearsed(name, at, why=idle)
        for at in still
        for name, kind in kinds.items()
        if kind.of_joint
    ]
    return Rehearsal(rig.name, float(motion.t[-1] - motion.t[0]), tuple(found))


def get_place(cause: Cause) -> CauseAt:
    """Return where a cause is."""
    return CauseAt(cause.name, get_joint(cause))


def pick_forms(grid: Sequence[Columns], tones: int = 8) -> list[Columns]:
    """Return what is planted of a cause's grid: its plainest form, which grids begin with; of harmonics so many."""
    if grid and grid[0].cause.pieces:
        every = np.array([one.cause.pieces[0] for one in grid])
        nearest = np.argmin(
            np.abs(every - np.geomspace(every[0], every[-1], tones)[:, None]), axis=1
        )
        return [grid[k] for k in np.unique(nearest).tolist()]
    return [one for one in grid if form(one.cause) == form(grid[0].cause)]


def plant_cause(search: Search, state: State, one: Columns) -> _Planted:
    """Return a cause with the size from which it is found.

    `diagnose` asks that the criterion falls by the threshold, without the block that tells most as well, and by more
    than an error of the model's form.
    """
    now = state.fit
    evidence = state.problem.evidence
    count = rows(state)
    cause = one.cause
    rest = project(now, one.own, one.joint)
    u = pick_direction(cause, rest)
    felt = rest = rest @ u
    if (
        isinstance(cause, Signal) and cause.linear
    ):  # a delay of up to `LARGEST_SHIFT` is taken for the log's own
        late = min(cause.late(evidence.parts[0].dt), LARGEST_SHIFT)
        felt = rest - late * project_slope(state, evidence.rig.joint_index(cause.joint))
    blocks = now.by_block(felt[:, None] ** 2)[:, 0]
    many = count.sum() if one.joint is None else count[one.joint]
    asked = many * np.expm1((search.threshold + free(cause) * np.log(count.max())) / many)
    outside = felt.reshape(-1, len(now.scale)) / now.scale
    torque = evidence.whiten_all(state.torque)
    form_error = compare_with_form_error(
        evidence, outside, 0 * outside, [(FORM_ERROR, torque)]
    ).max()
    told = np.array([blocks.sum(), blocks.sum() - blocks.max(), form_error])
    # D² - 2 z D = fall: deviations of the noise from which a sum of squares falls by so much in 19 of 20 logs.
    far = np.append(LUCKY + np.sqrt(LUCKY**2 + np.array([asked, search.threshold])), 1.0)
    seen = float(np.max(far / np.sqrt(np.maximum(told, 1e-300))))
    power = float(
        np.linalg.norm(one.own @ u)
        / np.linalg.norm(torque if one.joint is None else torque[:, one.joint])
    )
    largest = (
        find_largest(one, u, evidence.rig, power) if visibility(now, [one])[0] >= HIDDEN else 0.0
    )
    return _Planted(cause, u, rest, power, largest, seen)


def compare_cause(
    search: Search, state: State, one: _Planted, gains: Array, columns: Sequence[Columns]
) -> _Planted:
    """Return a planted cause with the size from which it is named, and what it is taken for.

    As in `selection.find_rivals`, by the best of each place that promises anything at the size from which it is found.

    Args:
        search: The candidates.
        state: The rigid model.
        one: The cause.
        gains: What each candidate gains on it, (k,).
        columns: The candidates' columns.
    """
    cause = one.cause
    own = get_place(one.cause)
    best = dict[CauseAt, Columns]()
    for k in np.argsort(-gains).tolist():
        if gains[k] >= PROMISE * search.threshold and (place := get_place(columns[k].cause)) != own:
            best.setdefault(place, columns[k])
    evidence = state.problem.evidence
    cost = float(np.log(rows(state).max()))
    needed = {
        place: find_size_apart(state.fit, one.rest, rival, cost * (free(cause) - free(rival.cause)))
        for place, rival in islice(best.items(), REFITTED_CANDIDATES)
    }
    seen = evidence.seen[evidence.rig.joint_index(cause.place) if cause.of_joint else 0]
    needed |= {CauseAt(name, own.joint): np.inf for name in cause.blurred(seen)}
    named = max([one.seen, *needed.values()])
    limit = one.seen if named <= one.largest else one.largest
    return one._replace(
        named=named, alike=tuple(place for place, size in needed.items() if size > limit)
    )


def explain_planted(now: Fit, planted: Array, columns: Sequence[Columns]) -> Array:
    """Return what each candidate, within its bounds, explains of torques that the model leaves, (rows n, t): (t, k)."""
    found = np.zeros((planted.shape[1], len(columns)))
    for batch in batches(columns):
        some = [columns[k] for k in batch]
        joint = some[0].joint
        c = some[0].width
        S = weigh_together(now, some)
        whole = products(S, c)
        gram = whole - products(now.along(S, joint), c)
        s = (planted[now.rows(joint)].T @ S).reshape(len(found), -1, c)
        own = fitting(gram, s)
        lower, upper = (
            np.stack(bounds) for bounds in zip(*((one.lower, one.upper) for one in some))
        )
        possible = np.all((own >= lower) & (own <= upper), axis=2)
        possible &= share(gram, whole) * np.array([one.bulk for one in some]) >= HIDDEN
        found[:, batch] = np.where(possible, np.sum(own * s, axis=2), 0.0)
    return found


def pick_direction(cause: Cause, rest: Array) -> Array:
    """Return the coefficients to plant: the first that a person states; of a harmonic the phase that shows least."""
    if isinstance(cause, Harmonic):
        return np.linalg.eigh(rest.T @ rest)[1][:, 0]
    names = [c.name for c in cause.coefficients] if isinstance(cause, Effect) else []
    stated = [names.index(p.name) for p in cause.stated() if p.name in names]
    return np.eye(rest.shape[1])[stated[0] if stated else 0]


def find_largest(columns: Columns, u: Array, rig: Rig, power: float) -> float:
    """Return the largest size of a cause that a rig may have.

    It takes no more than all of the joint's torque, is within the bounds of its coefficients, and at the joint's limits
    of angle, at rest and at its limit of rate, no more than the motor gives.
    """
    cause = columns.cause
    if isinstance(cause, Signal):
        return 1.0
    with np.errstate(divide="ignore"):
        most = [1.0 / power, *(columns.upper[u > 0] / u[u > 0])]
    if isinstance(cause, Effect):
        limit = rig.limits[j := rig.joint_index(cause.joint)]
        tau = float(rig.tau_max[j])
        corners = ((q, v) for q in (limit.lower, limit.upper) for v in (0.0, limit.velocity))
        inside = (
            Sample(0.0, q, v, 0.0, 1.0, tau) for q, v in corners if np.isfinite([q, v, tau]).all()
        )
        loads = [abs(float(np.array([float(x) for x in cause.basis(at)]) @ u)) for at in inside]
        most += [tau / load for load in loads if load > 0]
    return float(min(most))


def find_size_apart(now: Fit, torque: Array, rival: Columns, fall: float) -> float:
    """Return the size from which a torque, (rows n,), is told from a rival, with a probability of `SURE`.

    `fall`: by how much the criterion is lower with the rival where both explain as much.
    """
    from scipy.optimize import brentq

    other = project(now, rival.own, rival.joint)
    left = torque - other @ np.linalg.lstsq(other, torque, rcond=1e-10)[0]
    power = now.by_block(left[:, None] ** 2)[:, 0]
    total = max(float(power.sum()), 1e-300)

    def compute_lack(far: float) -> float:
        """Log odds short of `SURE` where it lies so many deviations of the noise from what the rival explains."""
        return float(logit(SURE)) - foresee_log_odds(far**2 / total * power, -fall / 2)

    nearest, farthest = 1e-3, 1e6
    if compute_lack(farthest) > 0:
        return float("inf")
    apart = brentq(compute_lack, nearest, farthest) if compute_lack(nearest) > 0 else nearest
    return float(apart / np.sqrt(total))


def summarize_forms(
    place: CauseAt, kind: type[Cause], told: Sequence[_Planted], rig: Rig
) -> Rehearsed:
    """Return what is said of a cause at its place: of the form that is the median of those that show."""
    families: dict[tuple[object, ...], list[_Planted]] = {}
    for one in sorted(told, key=lambda one: one.share):
        key = [
            getattr(one.cause, field.name)
            for field in fields(one.cause)
            if field.name != get_size_name(one.cause)
        ]
        families.setdefault(tuple(key), []).append(one)
    edges = [
        [find_edge(family, "seen"), find_edge(family, "named")] for family in families.values()
    ]
    shown = [
        (
            describe_size(seen, seen.seen, rig),
            named and describe_size(named, named.named, rig),
            seen.alike,
        )
        for seen, named in edges
        if seen is not None
    ]
    if not shown:
        why = kind.hidden if all(one.largest == 0 for one in told) else WEAK
        return Rehearsed(place.cause, place.joint, len(families), why=why)
    middle = sorted(shown, key=lambda one: one[0].share_of_torque)[(len(shown) - 1) // 2]
    return Rehearsed(place.cause, place.joint, len(families), len(shown), *middle)


def get_size_name(cause: Cause) -> str:
    """Return the field that is a cause's size: of a drive its first shape parameter; of what is linear none."""
    return cause.shapes[0].name if isinstance(cause, Signal) else ""


def find_edge(family: Sequence[_Planted], what: Literal["seen", "named"]) -> _Planted | None:
    """Return the first of a cause's forms, the weakest first, that shows at the size it needs; None where none does.

    A drive's needs a size of one: it is moved, between its form and the next weaker, to where that is so.
    """
    needed = [float(getattr(one, what)) for one in family]
    k = next((k for k, one in enumerate(family) if needed[k] <= one.largest), None)
    if k is None or not (name := get_size_name(family[k].cause)):
        return None if k is None else family[k]
    one = family[k]
    before = min(needed[k - 1], 1e9) if k else 1.0
    if before > max(needed[k], 1.0):
        sizes = [np.log(getattr(x.cause, name)) for x in (one, family[k - 1])]
        at = float(np.exp(np.interp(0.0, np.log([needed[k], before]), sizes)))
        one = one._replace(cause=one.cause.altered(**{name: at}), share=one.share * needed[k])
    return one._replace(seen=1.0, named=1.0)
