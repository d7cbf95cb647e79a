"""Experiments: what logs would have shown, what they cannot show, and the motion that separates causes that look alike.

A model's columns leave the whitened power p of a further torque in n rows. Its cause is expected to gain

    E[D] = n/2 log(1 + p/n),   std(D) = √(2 E[D])

nats, as the log ratio of two normal densities whose means are δ deviations apart has mean δ²/2 and deviation δ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import log, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import trange

from gimbal_pin.diagnosis.candidates import DRIVES, Candidate, list_candidates
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.library import build_shelves
from gimbal_pin.diagnosis.problem import (
    Columns,
    build_base_rows,
    build_precision,
    build_problem,
    compute_torque,
    split_coefficients,
)
from gimbal_pin.diagnosis.rig_causes import list_rig_changes
from gimbal_pin.diagnosis.rows import build_rows
from gimbal_pin.diagnosis.score import BlockFit, Gains, Pack, fit_blocks
from gimbal_pin.diagnosis.search import LEAST_LEFT, Search
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import CAUSES, Effect, RigEffect
from gimbal_pin.excitation import record_log
from gimbal_pin.excitation.clearance import Clearance
from gimbal_pin.excitation.columns import ExcitationColumns
from gimbal_pin.excitation.criteria import Determinant
from gimbal_pin.excitation.design import CLEARANCE, enforce_clearance
from gimbal_pin.excitation.fourier import LONGEST_PERIOD, Series
from gimbal_pin.excitation.limits import Envelope
from gimbal_pin.excitation.problem import ExcitationProblem
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from gimbal_pin.diagnosis.result import Diagnosis, Finding

NINETEEN_OF_TWENTY = 1.645
"""Deviations below the mean above which a normal variable is in 19 of 20 cases."""
LEAST_GAIN = 1.0
"""Expected gain, nats, below which a motion separates nothing."""
SERIES_REPEATS = (1, 2, 4, 8)
"""Repetitions of a series in the motion: `excite`'s own of 20 s, and by octaves up to 4 Hz."""
SERIES_HARMONICS = 10
"""Harmonics of such a series."""
TRIES = 40
"""Random motions that are tried; that half of them were changes of the best added a tenth to the gain in nats."""
LIMIT_MARGIN = 0.05
"""Share of every limit that is left free, as `excite` leaves it."""
Group = tuple[Sequence[Candidate], Pack]
"""Candidates with their whitened columns."""


@dataclass(frozen=True)
class Untestable:
    """A cause that these logs cannot show.

    Attributes:
        cause: Its name.
        joint: Its joint; None: the whole rig.
        why: The reason, as a clause.
    """

    cause: str
    joint: str | None
    why: str


@dataclass(frozen=True)
class Parting:
    """A finding and a cause that is not told from it.

    Attributes:
        cause: Name of the finding.
        joint: Its joint; None: the whole rig.
        rival: Name of the other cause.
        nats_now: Gain by which the finding predicts these logs better; None: it was not measured.
        nats_expected: The same that is expected of the next experiment; None where no motion separates the two.
        is_named: Whether that names the finding in 19 of 20 logs, if it is there.
        instead: Experiments that may separate them otherwise, as clauses.
    """

    cause: str
    joint: str | None
    rival: str
    nats_now: float | None
    nats_expected: float | None
    is_named: bool
    instead: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class NextExperiment:
    """The motion that separates what is ambiguous.

    Attributes:
        joints: Names of the joints, (n).
        motion: From rest to rest within the rig's limits; None where no motion separates anything.
        partings: Each ambiguous finding and each cause that is not told from it.
        finished: False if the search was interrupted: the motion is then the best so far.
    """

    joints: tuple[str, ...]
    motion: Motion | None
    partings: tuple[Parting, ...]
    finished: bool = True

    __repr__ = brief

    @property
    def seconds(self) -> float:
        """Length of the motion, s."""
        return 0.0 if self.motion is None else float(self.motion.t[-1] - self.motion.t[0])

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        partings = [asdict(one) for one in self.partings]
        return {"seconds": self.seconds, "finished": self.finished, "partings": partings}


def compute_expected_gain(power: float, rows: float) -> float:
    """``E[D] = n/2 log(1 + p/n)``, nats, of a whitened power p in n effective rows."""
    return float(0.5 * rows * np.log1p(max(power, 0.0) / rows))


def compute_sure_gain(nats: float, deviations: float) -> float:
    """Return the expected gain of which 19 of 20 logs give so many nats, and so many standard errors."""
    root = NINETEEN_OF_TWENTY / sqrt(2)
    gain = (root + sqrt(root**2 + max(nats, 0.0))) ** 2
    return max(gain, 2 * (deviations + NINETEEN_OF_TWENTY) ** 2)


def compute_size(gain: float, power: float, rows: float) -> float:
    """Return the size from which a torque of a whitened power p at size 1 is expected to gain so many nats."""
    return float(np.sqrt(rows * np.expm1(2 * gain / rows) / max(power, 1e-300)))


def compute_detection_limits(explanation: Explanation) -> dict[str, float]:
    """Return joint → torque of a further cause with one coefficient that would have been found, N m rms.

    It is what the model leaves of the cause's torque, with the spectrum of the joint's own torque, in 19 of 20 logs.
    """
    search = explanation.search
    problem = search.problem
    settings = problem.settings
    fit = explanation.found.final.fit
    limits = dict[str, float]()
    for j, joint in enumerate(problem.rig.joints):
        level = float(problem.torque_rms[j])
        count = len(list_candidates(problem.rig, j, problem.ranges[j]))
        gain = compute_sure_gain(settings.gain_nats + log(count), search.least_deviations)
        white = search.whitening.apply(problem.rows, problem.measured[:, [j]], j)
        power = float(fit.weight[j] * np.sum(white**2))
        rows = max(float(fit.rows[:, j].sum()), 1.0)
        share = max(settings.material_share, compute_size(gain, power, rows))
        limits[joint] = share * level
    return limits


def list_untestable(
    explanation: Explanation, findings: Sequence[Finding]
) -> tuple[Untestable, ...]:
    """Return the causes of which the model without causes explains all, whatever their shape."""
    rig = explanation.search.problem.rig
    fit = explanation.found.first.fit
    visible = {(one.cause, one.joint or "rig") for one in findings}
    for candidates, pack in list_groups(explanation):
        shares = fit.measure(pack).remaining
        shown = [one for one, share in zip(candidates, shares) if share >= LEAST_LEFT]
        # A gain is hidden if the one of both directions is, whatever shows of one direction.
        coupled = {(one.name, one.place) for one in candidates if one.cause.coupled}
        visible |= {
            (one.name, one.place)
            for one in shown
            if one.cause.coupled or (one.name, one.place) not in coupled
        }
    hidden = list[Untestable]()
    for kind in CAUSES.values():
        if kind.of_given_model or not (issubclass(kind, Effect | RigEffect) or kind.name in DRIVES):
            continue
        for place in rig.joints if kind.of_joint else ("rig",):
            if (kind.name, place) not in visible and not kind.is_stated(place, rig):
                joint = place if kind.of_joint else None
                hidden.append(Untestable(kind.name, joint, kind.hidden))
    return tuple(hidden)


def list_groups(explanation: Explanation) -> list[Group]:
    """Return all candidates with their whitened columns, by joint and of the whole rig."""
    search = explanation.search
    theta = explanation.found.first.fit.theta
    groups: list[Group] = [(shelf.candidates, shelf.pack) for shelf in explanation.found.shelves]
    for change in search.changes:
        pack = search.pack_rows(change.build_columns(search.problem, theta).rows)
        groups.append(([change.candidate], pack))
    return groups


def whiten_torque(search: Search, rows: Mapping[int, Array]) -> Array:
    """Return joint → rows (N,) of a torque as inner whitened rows, (N, n)."""
    problem = search.problem
    added = np.zeros_like(problem.measured)
    for j, own in rows.items():
        added[:, j] = own
    return search.whitening.apply_each(problem.rows, added)


def compute_power(fit: BlockFit) -> float:
    """Return the power that a model leaves of the torque that it is fitted to, in its noise's deviations."""
    return float(np.sum(fit.squared_errors * fit.weight))


def measure_left(fit: BlockFit, pack: Pack) -> tuple[Array, Gains]:
    """Return the power that is left beside each group of columns, (G,): see `compute_power`; and their coefficients."""
    gains = fit.measure(pack)
    return np.asarray(np.sum(gains.errors * fit.weight, axis=(1, 2))), gains


def _list_partings(diagnosis: Diagnosis) -> list[Parting]:
    """Return each ambiguous finding with each cause of its class; nothing is expected yet."""
    partings = list[Parting]()
    for one in diagnosis.findings:
        now = {x.cause: x.nats for x in one.rivals}
        for rival in one.alike[1:] if one.status == "ambiguous" else ():
            instead = tuple(
                CAUSES[name].experiment for name in (one.cause, rival) if name in CAUSES
            )
            partings.append(
                Parting(one.cause, one.joint, rival, now.get(rival), None, False, instead)
            )
    return partings


def _measure_motion(
    diagnosis: Diagnosis, partings: Sequence[Parting], motion: Motion, rng: np.random.Generator
) -> Array:
    """Return the gain by which each finding is expected to predict a motion's log better than its rival, nats.

    The log has the noise of the logs so far; the extended model predicts its torque.
    """
    explanation = diagnosis.explanation
    assert explanation is not None
    known = explanation.search
    final = explanation.found.final
    log = record_log(diagnosis.after, motion, 0.0, rng)
    settings = known.problem.settings
    rows = build_rows(known.problem.rig, [log], known.problem.rows.band, settings, "none")
    upright = [None] * len(rows.stretches)
    problem = build_problem(rows, known.problem.reduction, settings, upright)
    search = Search(problem, known.whitening, tuple(list_rig_changes(problem, upright)))
    torque = compute_torque(problem, final.fit.theta, ())
    columns = [search.build_columns(one, torque, final.fit.theta) for one in final.accepted]
    values = split_coefficients(known.problem, final.fit.theta, final.columns)
    gains = np.zeros(len(partings))
    for k, parting in enumerate(partings):
        at = parting.cause, parting.joint or "rig"
        own = [i for i, one in enumerate(final.accepted) if (one.name, one.place) == at]
        causes = [(final.accepted[i].cause, final.accepted[i].joint or 0) for i in own]
        is_blurred = any(parting.rival in x.blurred(problem.ranges[j]) for x, j in causes)
        if is_blurred or not own:
            continue
        others = [x for i, x in enumerate(columns) if i not in own]
        fit = _fit_others(search, torque, others, final.fit.weight, rng)
        parts = [{j: x @ values[i] for j, x in columns[i].rows.items()} for i in own]
        fit = fit.refit(sum((whiten_torque(search, part) for part in parts), 0.0 * fit.target))
        packs = _pack_rivals(search, torque, final.fit.theta, parting)
        left = min((float(measure_left(fit, x)[0].min()) for x in packs), default=0.0)
        gains[k] = compute_expected_gain(left, float(fit.rows.sum(axis=0).max()))
    return gains


def _pack_rivals(
    search: Search, torque: Sequence[Array], theta: Array, parting: Parting
) -> list[Pack]:
    """Return the whitened columns of all shapes of a rival, at the finding's joint or of the whole rig."""
    problem = search.problem
    rig = problem.rig
    joints = problem.joints if parting.joint is None else [rig.joint_index(parting.joint)]
    packs = list[Pack]()
    for j in joints:
        own = [
            one for one in list_candidates(rig, j, problem.ranges[j]) if one.name == parting.rival
        ]
        packs += [x.pack for x in build_shelves(problem, search.whitening, own, j, torque)]
    changes = [one for one in search.changes if one.candidate.name == parting.rival]
    return [*packs, *(search.pack_rows(one.build_columns(problem, theta).rows) for one in changes)]


def _fit_others(
    search: Search,
    torque: Sequence[Array],
    others: Sequence[Columns],
    weight: Array,
    rng: np.random.Generator,
) -> BlockFit:
    """Return the fit of a model without a finding to noise of the logs' deviation."""
    problem = search.problem
    base = build_base_rows(problem, torque, others)
    white = [search.whitening.apply(problem.rows, B, j) for j, B in enumerate(base)]
    noise = rng.standard_normal((len(white[0]), problem.rig.n)) / np.sqrt(weight)
    rows = problem.rows.count_effective_rows()
    precision = build_precision(problem, others)
    return fit_blocks(white, noise, problem.rows.folds, rows, precision, weight)


@limit_to_one_thread()
def plan_next_experiment(
    diagnosis: Diagnosis,
    rng: np.random.Generator,
    *,
    seconds: float = LONGEST_PERIOD,
    tries: int = TRIES,
    dt: float = 1e-3,
) -> Diagnosis:
    """Return a diagnosis with the motion that separates its ambiguous findings from what is not told from them.

    Args:
        diagnosis: The diagnosis.
        rng: Source of the motions.
        seconds: Length of the motion, s.
        tries: Number of motions that are tried; interrupted, the best so far is taken.
        dt: Sampling interval of the returned motion, s.

    Raises:
        UsageError: The rig cannot move within its limits.
    """
    explanation = diagnosis.explanation
    partings = _list_partings(diagnosis)
    if explanation is None or not partings:
        return diagnosis
    problem = explanation.search.problem
    rig = problem.rig

    def measure(limits: ExcitationProblem, x: Array) -> _Tried:
        motion = _sample_motion(limits, x, seconds, problem.rows.stretches[0].dt)
        return limits, x, _measure_motion(diagnosis, partings, motion, rng)

    family = _list_series(rig, diagnosis.after, seconds)
    tried = list[_Tried]()
    try:
        for k in trange(tries, desc="next experiment", unit="motion", disable=None, leave=False):
            limits = family[k % len(family)]
            tried.append(measure(limits, limits.draw_start(rng)))
    except KeyboardInterrupt:
        if not tried:
            raise
    limits, x, _ = _find_best(tried)
    repaired = limits.repair(x)
    if repaired is None:
        raise limits.explain_infeasibility()
    limits, x, gains = measure(limits, enforce_clearance(limits, repaired)[0])
    odds = log(1.0 / problem.settings.rival_probability)
    deviations = explanation.search.count_deviations(1)
    needed = compute_sure_gain(max(problem.settings.kept_nats, odds), deviations)
    told = [
        replace(one, nats_expected=gain, is_named=gain >= needed) if gain >= LEAST_GAIN else one
        for one, gain in zip(partings, gains.tolist())
    ]
    motion = None
    if gains.max() >= LEAST_GAIN:
        motion = _hold_joints(_sample_motion(limits, x, seconds, dt), [*rig.config.fixed.values()])
    joints = (*rig.joints, *rig.config.fixed)
    return replace(
        diagnosis, planned=NextExperiment(joints, motion, tuple(told), len(tried) == tries)
    )


_Tried = tuple[ExcitationProblem, Array, Array]
"""A series under the rig's limits, its free coefficients, and what it is expected to separate."""


def _list_series(rig: Rig, model: Model, seconds: float) -> list[ExcitationProblem]:
    """Return the series that are tried, under the rig's limits."""
    envelope = Envelope.of(rig, LIMIT_MARGIN)
    clear = Clearance.of(rig, CLEARANCE, envelope)
    columns = ExcitationColumns.of(rig)
    series = [Series(seconds / times, SERIES_HARMONICS) for times in SERIES_REPEATS]
    return [
        ExcitationProblem(model, one, columns, Determinant(), envelope, clear) for one in series
    ]


def _find_best(tried: Sequence[_Tried]) -> _Tried:
    """Return the motion with the largest smallest gain, over what any motion separates."""
    gains = np.array([one[2] for one in tried])
    possible = gains.max(axis=0) >= LEAST_GAIN
    return tried[int(np.argmax(gains[:, possible].min(axis=1, initial=np.inf)))]


def _sample_motion(limits: ExcitationProblem, x: Array, seconds: float, dt: float) -> Motion:
    """Return the motion of a series' free coefficients."""
    times = dt * np.arange(round(seconds / dt) + 1)
    return limits.series.motion(limits.coefficients(x), times)


def _hold_joints(motion: Motion, angles: Sequence[float]) -> Motion:
    """Return a motion with further joints that stand still."""
    rest = np.zeros((len(motion), len(angles)))
    q = np.hstack([motion.q, rest + np.array(angles)])
    return replace(motion, q=q, v=np.hstack([motion.v, rest]), a=np.hstack([motion.a, rest]))
