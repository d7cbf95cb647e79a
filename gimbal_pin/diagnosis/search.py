"""Search for causes: screen all beside those accepted, refine the best, refit, and keep what predicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtr, stdtrit

from gimbal_pin.diagnosis.candidates import (
    REFINEMENTS,
    Candidate,
    list_candidates,
    list_parameters,
    vary_shape,
)
from gimbal_pin.diagnosis.library import (
    Shelf,
    build_joint_columns,
    build_shelves,
    renew_shelves,
)
from gimbal_pin.diagnosis.problem import (
    Columns,
    Problem,
    Whitening,
    build_base_rows,
    build_precision,
    build_target,
    compute_torque,
    split_coefficients,
)
from gimbal_pin.diagnosis.rig_causes import RigChange
from gimbal_pin.diagnosis.score import (
    BlockFit,
    Gains,
    Pack,
    compare_fits,
    compute_standard_error,
    fit_blocks,
    pack_columns,
)
from gimbal_pin.diagnosis.structure import OWN_GROUPS, measure_beside_forms
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Flags

TORQUE_PASSES = 2
"""Fits until the columns that read the model's torque are built from the torque that they are part of."""
REFINED = 4
"""Number of the best causes whose shapes are refined. It bounds the time."""
HALVINGS = 3
"""Steps of a refinement, each the root of the one before: the shape is known to a fourth of the first."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A model with its accepted causes, fitted to all folds but each in turn.

    Attributes:
        accepted: The causes.
        columns: Their columns.
        torque: The model's own torque along each stretch, N m, (m, n).
        fit: The fit.
        left: Held-out residual, not whitened, N m, (N, n); shown blocks are predicted by all folds.
        base: Rows of the model's columns at each joint, n of (N, p).
        errors: Its rms at each joint, N m, (n,).
    """

    accepted: tuple[Candidate, ...]
    columns: tuple[Columns, ...]
    torque: tuple[Array, ...]
    fit: BlockFit
    left: Array
    base: tuple[Array, ...]
    errors: Array

    def get_places(self, candidate: Candidate, problem: Problem) -> slice:
        """Return where a cause's coefficients stand in θ."""
        ends = np.cumsum([problem.own_count, *(x.width for x in self.columns)]).tolist()
        k = self.accepted.index(candidate)
        return slice(ends[k], ends[k + 1])

    def find_places(self, causes: Sequence[Candidate], problem: Problem) -> Flags:
        """Return which coefficients are those of some causes, (p,)."""
        places = np.zeros(len(self.fit.norms), bool)
        for cause in causes:
            places[self.get_places(cause, problem)] = True
        return places

    @cached_property
    def kinds(self) -> set[tuple[str, str]]:
        """Names and places of its causes."""
        return {cause.kind for cause in self.accepted}


@dataclass(frozen=True, eq=False)
class Hit:
    """A candidate that was measured beside a model.

    Attributes:
        candidate: The candidate.
        by_fold: Its held-out gain by fold, nats, (K,).
        coefficients: Its coefficients, (k,).
    """

    candidate: Candidate
    by_fold: Array
    coefficients: Array

    @cached_property
    def gain(self) -> float:
        """Held-out gain D, nats."""
        return float(np.add.reduce(self.by_fold))

    @property
    def score(self) -> float:
        """Gain and log prior, nats."""
        return self.gain + self.candidate.log_prior


@dataclass(frozen=True)
class Rejection:
    """A cause that the screen found and that was not kept, with the share of the torque that it explains, rms."""

    candidate: Candidate
    share: float


@dataclass(frozen=True, eq=False)
class Search:
    """Rows, noise and causes of the rig that a search works with.

    Attributes:
        problem: The rows.
        whitening: Their whitening.
        changes: Causes of the whole rig.
    """

    problem: Problem
    whitening: Whitening
    changes: tuple[RigChange, ...]

    @property
    def least_deviations(self) -> float:
        """Standard errors that a cause's gain must have: each joint is one more place for chance to find something."""
        return self.count_deviations(self.problem.rig.n)

    def count_deviations(self, places: int) -> float:
        """Return the standard errors that a gain must have which was looked for at some places."""
        folds = len(self.problem.rows.folds)
        tail = ndtr(-self.problem.settings.clear_deviations) / places
        return -float(stdtrit(max(folds - 1, 2), tail))

    def is_clear(self, hit: Hit, nats: float) -> bool:
        """Return whether a gain is above its prior's cost and its own error."""
        gain = hit.gain
        if not np.isfinite(gain) or gain + hit.candidate.log_prior < nats:
            return False
        return gain >= self.least_deviations * float(compute_standard_error(hit.by_fold))

    def build_columns(
        self,
        candidate: Candidate,
        torque: Sequence[Array],
        theta: Array,
        size: Array | None = None,
    ) -> Columns:
        """Return a candidate's columns beside a model with some torque and coefficients.

        Args:
            candidate: The candidate.
            torque: The model's own torque along each stretch, N m, (m, n).
            theta: The model's coefficients.
            size: Coefficients of the candidate at which it is made linear; None: 0.
        """
        if candidate.joint is not None:
            return build_joint_columns(self.problem, candidate, torque)
        change = next(change for change in self.changes if change.candidate == candidate)
        return change.build_columns(self.problem, theta, size)

    def solve(self, accepted: Sequence[Candidate], start: Solution | None = None) -> Solution:
        """Fit a model with causes; columns that read the model's torque are built from it.

        Args:
            accepted: The causes.
            start: Model whose torque and coefficients are the first guess; None: the URDF.
        """
        problem = self.problem
        if start is None:
            base = build_base_rows(problem, problem.known, ())
            start = self._fit(base, (), (), build_precision(problem, ()))
        for _ in range(TORQUE_PASSES):
            theta = start.fit.theta
            values = split_coefficients(problem, theta, start.columns)
            sizes = dict(zip(start.accepted, values))
            columns = [
                self.build_columns(cause, start.torque, theta, sizes.get(cause))
                for cause in accepted
            ]
            base = build_base_rows(problem, start.torque, columns)
            precision = build_precision(problem, columns)
            start = self._fit(base, accepted, columns, precision, start.fit.weight)
        return start

    def fit_without(
        self, solution: Solution, left_out: Sequence[Candidate], places: Sequence[int] = ()
    ) -> Solution:
        """Return a model without some of its causes or coefficients; the other columns stay as they are."""
        kept = ~solution.find_places(left_out, self.problem)
        kept[list(places)] = False
        pairs = [x for x in zip(solution.accepted, solution.columns) if x[0] not in left_out]
        return self._fit(
            [B[:, kept] for B in solution.base],
            [cause for cause, _ in pairs],
            [columns for _, columns in pairs],
            build_precision(self.problem, solution.columns)[kept],
            solution.fit.weight,
            solution.torque,
        )

    def _fit(
        self,
        base: Sequence[Array],
        accepted: Sequence[Candidate],
        columns: Sequence[Columns],
        precision: Array,
        weight: Array | None = None,
        torque: Sequence[Array] | None = None,
    ) -> Solution:
        """Fit rows of columns at each joint, n of (N, p); without a torque its own is that of the fit."""
        problem = self.problem
        rows = problem.rows
        target = build_target(problem, columns)
        white = [self.whitening.apply(rows, B, j) for j, B in enumerate(base)]
        fit = fit_blocks(
            white,
            self.whitening.apply_each(rows, target),
            rows.folds,
            rows.count_effective_rows(),
            precision,
            weight,
        )
        # Outer rows are predicted by the fit to all folds, which stands last.
        fold = np.full(len(target), -1)
        fold[rows.inner] = rows.fold_of_rows
        thetas = fit.thetas[fold]
        residual = target - np.stack([np.sum(B * thetas, axis=1) for B in base], axis=1)
        errors = problem.compute_rms(residual[rows.inner])
        if torque is None:
            torque = compute_torque(problem, fit.theta, columns)
        return Solution(
            tuple(accepted), tuple(columns), tuple(torque), fit, residual, tuple(base), errors
        )

    def pack_rows(self, rows: Mapping[int, Array]) -> Pack:
        """Return one group of rows, joint → (N, k), as a pack."""
        problem = self.problem
        white = {j: self.whitening.apply(problem.rows, x, j) for j, x in rows.items()}
        return pack_columns(white, problem.rows.folds)

    def measure_causes(
        self, solution: Solution, without: Solution, causes: Sequence[Candidate]
    ) -> Array:
        """Return the gain of some causes of a model together beside it without them, by fold, (K,)."""
        places = solution.find_places(causes, self.problem)
        rows = {j: B[:, places] for j, B in enumerate(solution.base) if B[:, places].any()}
        return np.asarray(without.fit.measure(self.pack_rows(rows)).by_fold[0])

    def build_shelves(self, torque: Sequence[Array]) -> list[Shelf]:
        """Return all candidates' columns at every joint beside a model with some torque, N m, (m, n) per stretch."""
        problem = self.problem
        return [
            shelf
            for j in problem.joints
            for shelf in build_shelves(
                problem,
                self.whitening,
                list_candidates(problem.rig, j, problem.ranges[j]),
                j,
                torque,
            )
        ]

    def renew_shelves(self, shelves: Sequence[Shelf], solution: Solution) -> list[Shelf]:
        """Return shelves that are built from a model's torque."""
        return renew_shelves(self.problem, self.whitening, shelves, solution.torque)

    def screen(
        self, solution: Solution, shelves: Iterable[Shelf], with_rig: bool = True
    ) -> list[Hit]:
        """Return what every candidate gains beside a model, the highest score first."""
        hits = list[Hit]()
        for shelf in shelves:
            gains = solution.fit.measure(shelf.pack)
            hits += self._read_hits(solution, gains, shelf.candidates)
        for change in self.changes if with_rig else ():
            columns = change.build_columns(self.problem, solution.fit.theta)
            gains = solution.fit.measure(self.pack_rows(columns.rows))
            hits += self._read_hits(solution, gains, [change.candidate])
        return sorted(hits, key=lambda hit: -hit.score)

    def measure(self, solution: Solution, candidate: Candidate) -> Hit | None:
        """Return what one candidate gains beside a model; None: it is not admissible."""
        columns = self.build_columns(candidate, solution.torque, solution.fit.theta)
        gains = solution.fit.measure(self.pack_rows(columns.rows))
        return next(iter(self._read_hits(solution, gains, [candidate])), None)

    def _read_hits(
        self, solution: Solution, gains: Gains, candidates: Sequence[Candidate]
    ) -> list[Hit]:
        """Return the gains of candidates that are not in a model, differ from it and are admissible."""
        settings = self.problem.settings
        friction: Array = np.zeros((len(candidates), 0))
        if (joint := candidates[0].joint) is not None:
            own = self.problem.get_own_columns(joint)
            friction = gains.beside[:, own][:, :2] / settings.clear_deviations
        hits = list[Hit]()
        for candidate, left, by_fold, coefficients, beside in zip(
            candidates, gains.remaining, gains.by_fold, gains.coefficients, friction
        ):
            # A change of bodies is a part of the rigid columns, told from them by their prior alone.
            differs = left >= settings.min_left_share or candidate.cause.of_given_model
            # A harmonic may come again with other periods.
            is_new = candidate.kind not in solution.kinds or (
                candidate.is_harmonic and candidate not in solution.accepted
            )
            if differs and is_new and candidate.is_admissible(coefficients, beside):
                hits.append(Hit(candidate, by_fold, coefficients))
        return hits

    def refine(self, solution: Solution, hits: Sequence[Hit], count: int = REFINED) -> list[Hit]:
        """Return the best hit of each cause at each place, their shapes refined by bisection on the gain."""
        best = dict[tuple[str, ...], Hit]()
        for hit in hits:
            best.setdefault(hit.candidate.form, hit)
        simple = [self._simplify(hit, hits) for hit in [*best.values()][:count]]
        refined = [self.bisect(solution, hit) for hit in simple]
        return sorted(refined, key=lambda hit: -hit.score)

    def _simplify(self, best: Hit, hits: Sequence[Hit]) -> Hit:
        """Return the form of a cause with fewest coefficients: each further one has to gain `Settings.kept_nats`."""
        if best.candidate.is_harmonic:
            return best
        cost = self.problem.settings.kept_nats
        form = best.candidate.form
        forms = [hit for hit in hits if hit.candidate.form == form]
        return max(forms, key=lambda hit: hit.score - cost * len(hit.coefficients))

    def bisect(self, solution: Solution, hit: Hit) -> Hit:
        """Return a hit with the shape near its own that gains most."""
        if hit.candidate.name not in REFINEMENTS:
            return hit
        assert hit.candidate.joint is not None
        step = REFINEMENTS[hit.candidate.name][1]
        for _ in range(HALVINGS):
            for varied in vary_shape(hit.candidate, step, self.problem.ranges[hit.candidate.joint]):
                tried = self.measure(solution, varied)
                if tried is not None and tried.score > hit.score:
                    hit = tried
            step = step**0.5
        return hit

    def measure_torque(self, solution: Solution, hit: Hit) -> Array:
        """Return the torque that a hit adds and the model's columns do not imitate, N m rms, (n,).

        Of a change of bodies, which they imitate all, it is the whole torque.
        """
        problem = self.problem
        columns = self.build_columns(hit.candidate, solution.torque, solution.fit.theta)
        added = np.zeros_like(problem.target)
        for j, x in columns.rows.items():
            added[:, j] = x @ hit.coefficients
        if not hit.candidate.cause.of_given_model:
            white = self.whitening.apply_each(problem.rows, added)
            imitated = solution.fit.refit(white).theta
            added -= np.stack([B @ imitated for B in solution.base], axis=1)
        return problem.compute_rms(added[problem.rows.inner])


def compute_solution_gain(before: Solution, after: Solution) -> float:
    """Return the held-out gain of one model over another, nats."""
    return float(compare_fits(before.fit, after.fit).sum())


def sum_squares_by_fold(problem: Problem, solution: Solution) -> Array:
    """Return the squared unwhitened held-out errors of each fold, (K, n)."""
    left = solution.left[problem.rows.inner]
    return np.add.reduceat(left**2, problem.rows.starts, axis=0)


@dataclass(frozen=True, eq=False)
class Found:
    """Result of a search.

    Attributes:
        first: The model without causes.
        final: The model with those that were found.
        rejected: What the screen found and was not kept.
        shelves: All candidates' columns beside the final model.
    """

    first: Solution
    final: Solution
    rejected: tuple[Rejection, ...]
    shelves: tuple[Shelf, ...]


def find_causes(search: Search, shelves: Sequence[Shelf] = ()) -> Found:
    """Accept causes one by one, ordinary ones first, until none is clear; then leave out what became needless.

    Args:
        search: The search.
        shelves: Candidates beside another torque of the same rows; none: they are built.
    """
    problem = search.problem
    settings = problem.settings
    first = search.solve(list_parameters(problem.rig))
    solution = first
    shelves = search.renew_shelves(shelves, first) or search.build_shelves(first.torque)
    rejected = list[Rejection]()
    while len(solution.accepted) < settings.max_causes + 2 * problem.rig.n:
        past = [rejection.candidate for rejection in rejected]
        failures = Counter(candidate.kind for candidate in past)
        clear = [
            hit
            for hit in search.screen(solution, shelves)
            if search.is_clear(hit, settings.gain_nats)
            and failures[hit.candidate.kind] <= settings.max_failures
            and hit.candidate not in past
        ]
        hits = [hit for hit in clear if hit.candidate.is_ordinary] or clear
        if not hits:
            break
        best = search.refine(solution, hits)[0]
        candidate = best.candidate
        torque = search.measure_torque(solution, best)
        joint = candidate.joint
        if joint is None:
            joint = int(np.argmax(torque / problem.torque_rms))
        least = _compute_needed_torque(problem, first, solution, candidate, joint)
        if torque[joint] < least:
            share = float(torque[joint] / problem.torque_rms[joint])
            rejected.append(Rejection(candidate, share))
            continue
        if not _is_clear_beside_forms(search, solution, best):
            rejected.append(Rejection(candidate, 0.0))
            continue
        extended = search.solve((*solution.accepted, candidate), solution)
        lowered = float(solution.errors[joint] ** 2 - extended.errors[joint] ** 2)
        is_of_bodies = candidate.cause.of_given_model
        if not is_of_bodies and np.sqrt(max(lowered, 0.0)) < settings.unwhitened_share * least:
            rejected.append(Rejection(candidate, 0.0))
            continue
        solution = extended
        shelves = search.renew_shelves(shelves, solution)
    solution = drop_needless_causes(search, solution)
    shelves = search.renew_shelves(shelves, solution)
    return Found(first, solution, tuple(rejected), tuple(shelves))


def _is_clear_beside_forms(search: Search, solution: Solution, hit: Hit) -> bool:
    """Return whether a cause gains clearly where the accepted ones at its joint may have any form.

    Curves imitate a constant or a rotor on a short travel: these pay in torque, see `_compute_needed_torque`.
    """
    candidate = hit.candidate
    joint = candidate.joint
    if joint is None or candidate.is_ordinary or candidate.kind in solution.kinds:
        return True
    columns = search.build_columns(candidate, solution.torque, solution.fit.theta).rows[joint]
    by_fold = measure_beside_forms(search, solution, joint, columns)
    return search.is_clear(replace(hit, by_fold=by_fold), search.problem.settings.gain_nats)


def _compute_needed_torque(
    problem: Problem, first: Solution, solution: Solution, candidate: Candidate, joint: int
) -> float:
    """Return the torque that a cause must explain at a joint, N m rms."""
    settings = problem.settings
    least = settings.material_share * float(problem.torque_rms[joint])
    if candidate.kind in solution.kinds:
        return settings.harmonic_share * least
    if all(other.joint != joint for other in solution.accepted):
        return least
    near = [other for other in solution.accepted if other.joint in (joint, None)]
    if not candidate.is_ordinary and all(other.name in OWN_GROUPS for other in near):
        return least
    explained = max(first.errors[joint] ** 2 - solution.errors[joint] ** 2, 0.0)
    return float(np.hypot(least, settings.cause_form_error * np.sqrt(explained)))


def refine_shapes(search: Search, solution: Solution) -> Solution:
    """Return a model whose causes' shapes are refined beside all others, where that predicts better."""
    for old in solution.accepted:
        if old.name not in REFINEMENTS:
            continue
        without = search.fit_without(solution, [old])
        hit = search.measure(without, old)
        if hit is None:
            continue
        new = search.bisect(without, hit).candidate
        if new == old:
            continue
        tried = search.solve([new if x == old else x for x in solution.accepted], solution)
        if compute_solution_gain(solution, tried) > 0:
            solution = tried
    return solution


def drop_needless_causes(search: Search, solution: Solution) -> Solution:
    """Leave out, the worst first, causes whose gain beside all others is not clear."""
    none = np.zeros(len(solution.fit.folds))
    while len(solution.accepted) > 1:
        measured = [
            search.measure(search.fit_without(solution, [cause]), cause)
            or Hit(cause, none, np.zeros(1))
            for cause in solution.accepted
        ]
        worst = min(measured, key=lambda hit: hit.score)
        if search.is_clear(worst, search.problem.settings.kept_nats):
            break
        kept = [cause for cause in solution.accepted if cause != worst.candidate]
        solution = search.solve(kept, solution)
    return solution
