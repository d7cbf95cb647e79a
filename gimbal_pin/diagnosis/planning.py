"""The next experiment: the motion whose log is expected to separate causes that look alike so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import log
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import trange

from gimbal_pin.diagnosis.candidates import list_candidates
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.library import pack_candidates
from gimbal_pin.diagnosis.problem import (
    Columns,
    build_base_rows,
    build_precision,
    build_problem,
    compute_torque,
    fit_rows,
)
from gimbal_pin.diagnosis.rig_causes import list_rig_changes
from gimbal_pin.diagnosis.rows import build_rows
from gimbal_pin.diagnosis.score import BlockFit, Pack
from gimbal_pin.diagnosis.search import Search, split_coefficients
from gimbal_pin.diagnosis.visibility import (
    compute_expected_gain,
    compute_sure_gain,
    list_groups,
    measure_remaining_power,
    whiten_torque,
)
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import CAUSES
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

if TYPE_CHECKING:
    from gimbal_pin.diagnosis.result import Diagnosis

LEAST_GAIN = 1.0
"""Expected gain, nats, below which a motion separates nothing."""
OCTAVES = 4
"""Octaves over which the series' length is varied: from `excite`'s own of 20 s, up to 4 Hz."""
SERIES_HARMONICS = 10
"""Harmonics of such a series."""
TRIES = 40
"""Random motions that are tried; that half of them were changes of the best added a tenth to the gain in nats."""
LIMIT_MARGIN = 0.05
"""Share of every limit that is kept free, as `excite` keeps it."""


@dataclass(frozen=True)
class Parting:
    """A finding and a cause that is not told from it.

    Attributes:
        cause: Name of the finding.
        joint: Its joint; None: the whole rig.
        rival: Name of the other cause.
        nats_now: Gain by which the finding predicts these logs better; None: it was not measured.
        is_tried: Whether motions were tried: not where one of them acts on the command, which no motion tells.
        instead: Experiments that may separate them otherwise, as clauses.
        nats_expected: Gain that is expected of the next experiment; None where no motion that was tried separates them.
        is_named: Whether that names the finding in 19 of 20 logs, if it is there.
    """

    cause: str
    joint: str | None
    rival: str
    nats_now: float | None
    is_tried: bool
    instead: tuple[str, ...]
    nats_expected: float | None = None
    is_named: bool = False


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
        partings = [asdict(parting) for parting in self.partings]
        return {"seconds": self.seconds, "finished": self.finished, "partings": partings}


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
    if explanation is None:
        return diagnosis
    partings = _list_partings(diagnosis, explanation)
    if not partings:
        return diagnosis
    problem = explanation.search.problem
    fixed = problem.rig.config.fixed
    planned = NextExperiment((*problem.rig.joints, *fixed), None, tuple(partings))
    if not any(parting.is_tried for parting in partings):
        return replace(diagnosis, planned=planned)
    envelope = Envelope.of(problem.rig, LIMIT_MARGIN)
    clearance = Clearance.of(problem.rig, CLEARANCE, envelope)
    columns = ExcitationColumns.of(problem.rig)
    tried = list[tuple[ExcitationProblem, Array]]()
    gains = list[Array]()
    try:
        for k in trange(tries, desc="next experiment", unit="motion", disable=None, leave=False):
            series = Series(seconds / 2 ** (k % OCTAVES), SERIES_HARMONICS)
            limits = ExcitationProblem(
                diagnosis.after, series, columns, Determinant(), envelope, clearance
            )
            x = limits.repair(limits.draw_start(rng))
            if x is None:
                raise limits.explain_infeasibility()
            motion = _sample_motion(limits, x, seconds, problem.rows.stretches[0].dt)
            gains.append(_measure_motion(diagnosis, explanation, partings, motion, rng))
            tried.append((limits, x))
    except KeyboardInterrupt:
        if not tried:
            raise
    # The motion with the largest smallest gain over what any motion separates.
    table = np.array(gains)
    possible = table.max(axis=0) >= LEAST_GAIN
    best = int(np.argmax(table[:, possible].min(axis=1, initial=np.inf)))
    odds = max(problem.settings.kept_nats, -log(problem.settings.rival_probability))
    needed = compute_sure_gain(odds, explanation.search.count_deviations(1))
    expected = [
        replace(parting, nats_expected=gain, is_named=gain >= needed)
        if gain >= LEAST_GAIN
        else parting
        for parting, gain in zip(partings, gains[best].tolist())
    ]
    planned = replace(planned, partings=tuple(expected), finished=len(tried) == tries)
    if possible.any():
        limits, x = tried[best]
        motion = _sample_motion(limits, enforce_clearance(limits, x)[0], seconds, dt)
        planned = replace(planned, motion=_hold_joints(motion, [*fixed.values()]))
    return replace(diagnosis, planned=planned)


def _list_partings(diagnosis: Diagnosis, explanation: Explanation) -> list[Parting]:
    """Return each ambiguous finding with each cause of its class; nothing is expected yet."""
    columns = {one.name for group, _ in list_groups(explanation) for one in group}
    accepted = {(one.name, one.place) for one in explanation.found.final.accepted}
    return [
        Parting(
            finding.cause,
            finding.joint,
            rival,
            next((one.nats for one in finding.rivals if one.cause == rival), None),
            (finding.cause, finding.joint or "rig") in accepted and rival in columns,
            tuple(CAUSES[name].experiment for name in (finding.cause, rival) if name in CAUSES),
        )
        for finding in diagnosis.findings
        if finding.status == "ambiguous"
        for rival in finding.alike[1:]
    ]


def _measure_motion(
    diagnosis: Diagnosis,
    explanation: Explanation,
    partings: Sequence[Parting],
    motion: Motion,
    rng: np.random.Generator,
) -> Array:
    """Return the gain by which each finding is expected to predict a motion's log better than its rival, nats.

    The log has the noise of the logs so far; the extended model predicts its torque.
    """
    known = explanation.search.problem
    final = explanation.found.final
    log = record_log(diagnosis.after, motion, 0.0, rng)
    rows = build_rows(known.rig, [log], known.rows.band, known.settings, "none")
    upright = [None] * len(rows.stretches)
    problem = build_problem(rows, known.reduction, known.settings, upright)
    changes = tuple(list_rig_changes(problem, upright))
    search = Search(problem, explanation.search.whitening, changes)
    theta = final.fit.theta
    torque = compute_torque(problem, theta, ())
    noise = final.errors * rng.standard_normal(problem.target.shape)
    values = split_coefficients(known, theta, final.columns)
    columns = [search.build_columns(one, torque, theta) for one in final.accepted]
    gains = np.zeros(len(partings))
    for k, parting in enumerate(partings):
        others = list[Columns]()
        planted = dict[int, Array]()
        is_blurred = False
        for one, own, size in zip(final.accepted, columns, values):
            if (one.name, one.place) != (parting.cause, parting.joint or "rig"):
                others.append(own)
                continue
            for j, x in own.rows.items():
                planted[j] = planted.get(j, 0.0) + x @ size
            is_blurred |= parting.rival in one.cause.blurred(problem.ranges[one.joint or 0])
        if not parting.is_tried or is_blurred:
            continue
        fit = fit_rows(
            problem,
            search.whitening,
            build_base_rows(problem, torque, others),
            noise,
            build_precision(problem, others),
            final.fit.weight,
        )
        fit = fit.refit(whiten_torque(search, planted))
        packs = _pack_rivals(search, fit, torque, theta, parting)
        power = [float(measure_remaining_power(fit, pack)[0].min()) for pack in packs]
        count = float(fit.rows.sum(axis=0).max())
        gains[k] = compute_expected_gain(min(power, default=0.0), count)
    return gains


def _pack_rivals(
    search: Search, fit: BlockFit, torque: Sequence[Array], theta: Array, parting: Parting
) -> list[Pack]:
    """Return the whitened columns of all shapes of a rival, at the finding's joint or of the whole rig."""
    problem = search.problem
    packs = list[Pack]()
    for j, joint in enumerate(problem.rig.joints):
        shapes = [
            one
            for one in list_candidates(problem.rig, j, problem.ranges[j])
            if one.name == parting.rival and parting.joint in (None, joint)
        ]
        if shapes:
            packs.append(pack_candidates(problem, search.whitening, fit.target, shapes, j, torque))
    changes = [one for one in search.changes if one.candidate.name == parting.rival]
    return [*packs, *(search.pack(one.build_columns(problem, theta)) for one in changes)]


def _sample_motion(limits: ExcitationProblem, x: Array, seconds: float, dt: float) -> Motion:
    """Return the motion of a series' free coefficients."""
    times = dt * np.arange(round(seconds / dt) + 1)
    return limits.series.motion(limits.coefficients(x), times)


def _hold_joints(motion: Motion, angles: Sequence[float]) -> Motion:
    """Return a motion with further joints that stand still."""
    still = np.tile(angles, (len(motion), 1))
    v, a = (np.hstack([x, 0 * still]) for x in (motion.v, motion.a))
    return replace(motion, q=np.hstack([motion.q, still]), v=v, a=a)
