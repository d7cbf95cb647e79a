"""The next experiment: the motion whose log is expected to separate causes that look alike so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.problem import (
    build_base_rows,
    build_precision,
    build_problem,
    compute_torque,
    split_coefficients,
)
from gimbal_pin.diagnosis.rig_causes import list_rig_changes
from gimbal_pin.diagnosis.rows import build_rows
from gimbal_pin.diagnosis.score import fit_blocks
from gimbal_pin.diagnosis.search import Search
from gimbal_pin.diagnosis.visibility import (
    compute_expected_gain,
    compute_sure_gain,
    list_groups,
    measure_rivals,
    whiten_torque,
)
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import CAUSES
from gimbal_pin.excitation import Excitation, excite, list_shown_effects, record_log
from gimbal_pin.excitation.fourier import LONGEST_PERIOD
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.rig.brief import brief

if TYPE_CHECKING:
    from gimbal_pin.diagnosis.result import Diagnosis

LEAST_GAIN = 1.0
"""Expected gain, nats, below which a motion separates nothing: odds of a factor e. It changes no verdict."""
PERIODS = (1, 3, 9)
"""Periods of the motions that are compared, each designed by `excite`: some causes show slowly, others fast."""
HARMONICS = 5
"""Harmonics of each: twice as many took four times as long and separated no more."""


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
    dt: float = 1e-3,
) -> Diagnosis:
    """Return a diagnosis with the motion that separates its ambiguous findings from what is not told from them.

    Args:
        diagnosis: The diagnosis.
        rng: Source of the motions.
        seconds: Length of the motion, s; interrupted, the best so far is taken.
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
    rate = 1 / problem.rows.stretches[0].dt
    excitations = list[Excitation]()
    gains = list[Array]()
    for periods in PERIODS:
        excitation = excite(
            problem.rig,
            seconds=seconds,
            periods=periods,
            harmonics=HARMONICS,
            starts=1,
            rng=rng,
            criterion="determinant",
            effects=list_shown_effects(diagnosis.after, ()),
            torque_model=diagnosis.after,
            dt=dt,
        )
        excitations.append(excitation)
        motion = excitation.sample(rate)
        gains.append(_measure_motion(diagnosis, explanation, partings, motion, rng))
        if not excitation.finished:
            break
    # The motion with the largest smallest gain over what any motion separates.
    table = np.array(gains)
    possible = table.max(axis=0) >= LEAST_GAIN
    best = int(np.argmax(table[:, possible].min(axis=1, initial=np.inf)))
    needed = compute_sure_gain(problem.settings.kept_nats, explanation.search.count_deviations(1))
    expected = [
        replace(parting, nats_expected=gain, is_named=gain >= needed)
        if gain >= LEAST_GAIN
        else parting
        for parting, gain in zip(partings, table[best].tolist())
    ]
    finished = excitations[-1].finished
    planned = replace(planned, partings=tuple(expected), finished=finished)
    if possible.any():
        motion = _hold_joints(excitations[best].motion, [*fixed.values()])
        planned = replace(planned, motion=motion)
    return replace(diagnosis, planned=planned)


def _list_partings(diagnosis: Diagnosis, explanation: Explanation) -> list[Parting]:
    """Return each ambiguous finding with each cause of its class; nothing is expected yet."""
    found = explanation.found
    accepted = {(one.name, one.place) for one in found.final.accepted}
    columns = {one.name for shelf in found.shelves for one in shelf.candidates}
    columns |= {change.candidate.name for change in explanation.search.changes}
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
    noise = search.whitening.apply_each(
        rows, final.errors * rng.standard_normal(problem.target.shape)
    )
    values = split_coefficients(known, theta, final.columns)
    columns = [search.build_columns(one, torque, theta) for one in final.accepted]
    nothing = whiten_torque(search, {})
    groups = list_groups(search, search.build_shelves(torque), theta)
    gains = np.zeros(len(partings))
    for k, parting in enumerate(partings):
        at = parting.cause, parting.joint or "rig"
        parts = [i for i, one in enumerate(final.accepted) if (one.name, one.place) == at]
        if not parting.is_tried:
            continue
        others = [own for i, own in enumerate(columns) if i not in parts]
        base = build_base_rows(problem, torque, others)
        fit = fit_blocks(
            [search.whitening.apply(rows, B, j) for j, B in enumerate(base)],
            noise,
            rows.folds,
            rows.count_effective_rows(),
            build_precision(problem, others),
            final.fit.weight,
        )
        planted = nothing.copy()
        for i in parts:
            torques = {j: x @ values[i] for j, x in columns[i].rows.items()}
            planted += whiten_torque(search, torques)
        rivals = measure_rivals(
            search, fit.refit(planted), groups, final.accepted[parts[0]], size=1.0
        )
        power = [left for (name, _), (left, _) in rivals.items() if name == parting.rival]
        count = float(fit.rows.sum(axis=0).max())
        gains[k] = compute_expected_gain(min(power, default=0.0), count)
    return gains


def _hold_joints(motion: Motion, angles: Sequence[float]) -> Motion:
    """Return a motion with further joints that stand still."""
    still = np.tile(angles, (len(motion), 1))
    v, a = (np.hstack([x, 0 * still]) for x in (motion.v, motion.a))
    return replace(motion, q=np.hstack([motion.q, still]), v=v, a=a)
