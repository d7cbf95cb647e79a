"""Search for causes: screen all beside those accepted, refine the best, refit, and keep what predicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from gimbal_pin.diagnosis.candidates import REFINEMENTS, Candidate, vary_shape
from gimbal_pin.diagnosis.library import (
    Shelf,
    build_joint_columns,
    build_shelves,
    pack_candidates,
    renew_shelves,
)
from gimbal_pin.diagnosis.problem import (
    TORQUE_PASSES,
    Columns,
    Problem,
    Whitening,
    build_base_rows,
    build_precision,
    build_target,
    compute_torque,
    fit_rows,
)
from gimbal_pin.diagnosis.rig_causes import RigChange
from gimbal_pin.diagnosis.score import (
    BlockFit,
    Gains,
    Pack,
    compare_fits,
    pack_columns,
)
from gimbal_pin.log.log import Array

REFINED = 4
"""Number of the best causes whose shapes are refined."""
HALVINGS = 3
"""Steps of a refinement, each the root of the one before."""
LEAST_LEFT = 3e-3
"""Share of a candidate's power beside the model from which it is told from the model."""
MOST_STRIKES = 2
"""Times that shapes of a cause may pass the screen and then predict no torque before all its shapes are left out."""


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
        first = problem.own_count
        for own, columns in zip(self.accepted, self.columns):
            if own == candidate:
                return slice(first, first + columns.width)
            first += columns.width
        raise ValueError(f"{candidate.name} was not accepted")


@dataclass(frozen=True, eq=False)
class Hit:
    """A candidate that was measured beside a model.

    Attributes:
        candidate: The candidate.
        gain: Held-out gain D, nats.
        by_fold: D of each fold, (K,).
        coefficients: Its coefficients, (k,).
        covariance: Their covariance, (k, k).
    """

    candidate: Candidate
    gain: float
    by_fold: Array
    coefficients: Array
    covariance: Array

    @property
    def score(self) -> float:
        """Gain and log prior, nats."""
        return self.gain + self.candidate.log_prior

    @property
    def standard_error(self) -> float:
        """Standard error of the gain, nats."""
        return float(np.sqrt(len(self.by_fold)) * self.by_fold.std(ddof=1))


@dataclass(frozen=True, eq=False)
class Rejection:
    """A cause that the screen found and that was not kept, with the torque that it explains, N m rms."""

    candidate: Candidate
    torque: float
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
        tail = float(norm.sf(self.problem.settings.gain_deviations)) / places
        return float(student.isf(tail, max(folds - 1, 2)))

    def is_clear(self, hit: Hit, nats: float) -> bool:
        """Return whether a gain is above its prior's cost and its own error."""
        if not np.isfinite(hit.gain):
            return False
        return hit.score >= nats and hit.gain >= self.least_deviations * hit.standard_error

    def find_change(self, candidate: Candidate) -> RigChange:
        """Return the change of the rig that a candidate stands for."""
        return next(change for change in self.changes if change.candidate == candidate)

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
        if candidate.joint is None:
            return self.find_change(candidate).build_columns(self.problem, theta, size)
        return build_joint_columns(self.problem, candidate, torque)

    def solve(self, accepted: Sequence[Candidate], start: Solution | None = None) -> Solution:
        """Fit a model with causes; columns that read the model's torque are built from it.

        Args:
            accepted: The causes.
            start: Model whose torque and coefficients are the first guess; None: the URDF.
        """
        problem = self.problem
        torque: Sequence[Array] = problem.known if start is None else start.torque
        theta = np.zeros(problem.own_count) if start is None else start.fit.theta
        weight = None if start is None else start.fit.weight
        sizes = dict[Candidate, Array]()
        if start is not None:
            split = split_coefficients(problem, start.fit.theta, start.columns)
            sizes = dict(zip(start.accepted, split))
        for _ in range(TORQUE_PASSES):
            columns = tuple(
                self.build_columns(one, torque, theta, sizes.get(one)) for one in accepted
            )
            base = build_base_rows(problem, torque, columns)
            target = build_target(problem, columns)
            precision = build_precision(problem, columns)
            fit = fit_rows(problem, self.whitening, base, target, precision, weight)
            theta = fit.theta
            weight = fit.weight
            torque = compute_torque(problem, theta, columns)
            sizes = dict(zip(accepted, split_coefficients(problem, theta, columns)))
        left = _predict_held_out(problem, fit, base, target)
        errors = problem.compute_rms(left[problem.rows.inner])
        return Solution(tuple(accepted), columns, tuple(torque), fit, left, tuple(base), errors)

    def fit_without(self, solution: Solution, left_out: Sequence[Candidate]) -> Solution:
        """Return a model without some of its causes, the others' columns as they are."""
        pairs = [x for x in zip(solution.accepted, solution.columns) if x[0] not in left_out]
        accepted = tuple(one for one, _ in pairs)
        columns = tuple(x for _, x in pairs)
        problem = self.problem
        kept = np.ones(solution.base[0].shape[1], bool)
        for one in left_out:
            kept[solution.get_places(one, problem)] = False
        base = [B[:, kept] for B in solution.base]
        target = build_target(problem, columns)
        precision = build_precision(problem, columns)
        fit = fit_rows(problem, self.whitening, base, target, precision, solution.fit.weight)
        left = _predict_held_out(problem, fit, base, target)
        errors = problem.compute_rms(left[problem.rows.inner])
        return Solution(accepted, columns, solution.torque, fit, left, tuple(base), errors)

    def fit_without_column(self, solution: Solution, place: int) -> Solution:
        """Return a model without one of its columns."""
        base = [np.delete(B, place, axis=1) for B in solution.base]
        problem = self.problem
        precision = np.delete(build_precision(problem, solution.columns), place)
        target = build_target(problem, solution.columns)
        fit = fit_rows(problem, self.whitening, base, target, precision, solution.fit.weight)
        left = _predict_held_out(problem, fit, base, target)
        errors = problem.compute_rms(left[problem.rows.inner])
        return replace(solution, fit=fit, left=left, base=tuple(base), errors=errors)

    def pack(self, columns: Columns) -> Pack:
        """Return one group of columns as a pack."""
        return self.pack_rows(columns.rows, columns.width)

    def pack_rows(self, rows: Mapping[int, Array], width: int) -> Pack:
        """Return one group of rows, joint → (N, width), as a pack."""
        white = {j: self.whitening.apply(self.problem.rows, x, j) for j, x in rows.items()}
        return pack_columns(white, [width], self._target, self.problem.rows.folds)

    @property
    def _target(self) -> Array:
        problem = self.problem
        return np.hstack(
            [self.whitening.apply(problem.rows, problem.target[:, [j]], j) for j in problem.joints]
        )

    def build_shelves(self, solution: Solution) -> list[Shelf]:
        """Return all candidates' columns at every joint."""
        return build_shelves(self.problem, self.whitening, solution.fit.target, solution.torque)

    def renew_shelves(self, shelves: Sequence[Shelf], solution: Solution) -> list[Shelf]:
        """Return shelves that are built from a model's torque."""
        target = solution.fit.target
        return renew_shelves(self.problem, self.whitening, target, shelves, solution.torque)

    def screen(
        self, solution: Solution, shelves: Iterable[Shelf], with_rig: bool = True
    ) -> list[Hit]:
        """Return what every candidate gains beside a model, the highest score first."""
        hits = list[Hit]()
        for shelf in shelves:
            own = self.problem.get_own_columns(shelf.joint)
            beside = [own.start, own.start + 1]
            gains = solution.fit.measure(shelf.pack, beside=beside)
            for place, candidate in enumerate(shelf.candidates):
                if not _is_present(solution, candidate):
                    hits += _read_hit(gains, place, candidate)
        for change in self.changes if with_rig else ():
            if _is_present(solution, change.candidate):
                continue
            columns = change.build_columns(self.problem, solution.fit.theta)
            hits += _read_hit(solution.fit.measure(self.pack(columns)), 0, change.candidate)
        return sorted(hits, key=lambda hit: -hit.score)

    def measure(self, solution: Solution, candidate: Candidate) -> Hit | None:
        """Return what one candidate gains beside a model; None: it is not admissible."""
        if candidate.joint is None:
            columns = self.build_columns(candidate, solution.torque, solution.fit.theta)
            gains = solution.fit.measure(self.pack(columns))
        else:
            j = candidate.joint
            own = self.problem.get_own_columns(j)
            pack = pack_candidates(
                self.problem, self.whitening, solution.fit.target, [candidate], j, solution.torque
            )
            gains = solution.fit.measure(pack, beside=[own.start, own.start + 1])
        return next(iter(_read_hit(gains, 0, candidate)), None)

    def refine(self, solution: Solution, hits: Sequence[Hit], count: int = REFINED) -> list[Hit]:
        """Return the best hit of each cause at each place, their shapes refined by bisection on the gain."""
        best = list[Hit]()
        for hit in hits:
            if not any(hit.candidate.is_same_form(other.candidate) for other in best):
                best.append(self._simplify(hit, hits))
        refined = [self.bisect(solution, hit) for hit in best[:count]]
        return sorted(refined, key=lambda hit: -hit.score)

    def _simplify(self, best: Hit, hits: Sequence[Hit]) -> Hit:
        """Return the form of a cause with fewest coefficients: each further one has to gain `Settings.kept_nats`."""
        cost = self.problem.settings.kept_nats
        forms = [hit for hit in hits if hit.candidate.is_same_form(best.candidate)]
        if best.candidate.is_harmonic:
            return best
        return max(forms, key=lambda hit: hit.score - cost * len(hit.coefficients))

    def bisect(self, solution: Solution, hit: Hit) -> Hit:
        """Return a hit with the shape near its own that gains most."""
        if hit.candidate.name not in REFINEMENTS:
            return hit
        assert hit.candidate.joint is not None
        seen = self.problem.ranges[hit.candidate.joint]
        step = REFINEMENTS[hit.candidate.name][1]
        for _ in range(HALVINGS):
            for varied in vary_shape(hit.candidate, step, seen):
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
        rows = {j: x @ hit.coefficients for j, x in columns.rows.items()}
        if hit.candidate.cause.of_given_model:
            count = len(problem.rows.inner)
            whole = [rows.get(j, np.zeros(count)) for j in problem.joints]
            return problem.compute_rms(np.stack(whole, axis=1)[problem.rows.inner])
        white = {
            j: self.whitening.apply(problem.rows, x[:, None], j)[:, 0] for j, x in rows.items()
        }
        imitated = solution.fit.project_off(white)
        added = np.stack(
            [rows.get(j, 0.0) - B @ imitated for j, B in enumerate(solution.base)], axis=1
        )
        return problem.compute_rms(added[problem.rows.inner])


def compute_solution_gain(before: Solution, after: Solution) -> float:
    """Return the held-out gain of one model over another, nats."""
    return float(compare_fits(before.fit, after.fit).sum())


def sum_squares_by_fold(problem: Problem, solution: Solution) -> Array:
    """Return the squared unwhitened held-out errors of each fold, (K, n)."""
    left = solution.left[problem.rows.inner]
    return np.add.reduceat(left**2, problem.rows.starts, axis=0)


def split_coefficients(problem: Problem, theta: Array, columns: Sequence[Columns]) -> list[Array]:
    """Return the coefficients of each of a model's causes."""
    ends = np.cumsum([problem.own_count, *(x.width for x in columns)])
    return [theta[first:last] for first, last in pairwise(ends)]


def _predict_held_out(
    problem: Problem, fit: BlockFit, base: Sequence[Array], target: Array
) -> Array:
    """Return the unwhitened residual of each fold's rows by the fit without it, (N, n)."""
    rows = problem.rows
    out = np.empty_like(target)
    fold = np.full(len(rows.inner), -1)
    fold[rows.inner] = rows.fold_of_rows
    thetas = fit.fold_thetas
    for j, B in enumerate(base):
        out[:, j] = target[:, j] - B @ fit.theta
        for k, theta in enumerate(thetas):
            own = fold == k
            out[own, j] = target[own, j] - B[own] @ theta
    return out


def _is_present(solution: Solution, candidate: Candidate) -> bool:
    """Return whether a cause is in a model already; a harmonic may come again with other periods."""
    if candidate.is_harmonic:
        return candidate in solution.accepted
    return any(candidate.is_same(other) for other in solution.accepted)


def _read_hit(gains: Gains, place: int, candidate: Candidate) -> list[Hit]:
    """Return one group's gain as a hit; none if it is not told from the model or not admissible."""
    # A change of bodies is a part of the rigid columns, told from them by their prior alone.
    if gains.remaining[place] < LEAST_LEFT and not candidate.cause.of_given_model:
        return []
    width = int(np.count_nonzero(np.diag(gains.covariance[place])))
    coefficients = gains.coefficients[place, :width]
    if not candidate.is_admissible(coefficients, gains.beside[place]):
        return []
    covariance = gains.covariance[place, :width, :width]
    gain = float(gains.total[place])
    return [Hit(candidate, gain, gains.by_fold[place], coefficients, covariance)]


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


def find_causes(search: Search) -> Found:
    """Accept causes one by one, ordinary ones first, until none is clear; then leave out what became needless."""
    problem = search.problem
    settings = problem.settings
    first = search.solve(())
    first = search.solve((), first)
    solution = first
    shelves = search.build_shelves(solution)
    rejected = list[Rejection]()
    strikes = dict[tuple[str, str], int]()
    is_ordinary = True
    most = settings.most_causes + 2 * problem.rig.n
    while len(solution.accepted) < most:
        hits = [
            hit
            for hit in search.screen(solution, shelves)
            if search.is_clear(hit, settings.gain_nats) and not _is_rejected(hit, rejected, strikes)
        ]
        if is_ordinary:
            hits = [hit for hit in hits if hit.candidate.is_ordinary]
            if not hits:
                is_ordinary = False
                continue
        if not hits:
            break
        best = search.refine(solution, hits)[0]
        needed = _compute_needed_torque(problem, first, solution, best, search)
        torque, place, least = needed
        share = torque / float(problem.torque_rms[place])
        if torque < least:
            rejected.append(Rejection(best.candidate, torque, share))
            if not any(best.candidate.is_same(other) for other in solution.accepted):
                strikes[_key(best)] = MOST_STRIKES + 1
            continue
        extended = search.solve((*solution.accepted, best.candidate), solution)
        lowered = solution.errors[place] ** 2 - extended.errors[place] ** 2
        is_of_bodies = best.candidate.cause.of_given_model
        if not is_of_bodies and np.sqrt(max(lowered, 0.0)) < settings.unwhitened_share * least:
            rejected.append(Rejection(best.candidate, 0.0, 0.0))
            strikes[_key(best)] = strikes.get(_key(best), 0) + 1
            continue
        solution = extended
        shelves = search.renew_shelves(shelves, solution)
    solution = drop_needless_causes(search, solution)
    shelves = search.renew_shelves(shelves, solution)
    return Found(first, solution, tuple(rejected), tuple(shelves))


def _key(hit: Hit) -> tuple[str, str]:
    """Return name and place of a hit's cause."""
    return hit.candidate.name, hit.candidate.place


def _is_rejected(
    hit: Hit, rejected: Sequence[Rejection], strikes: dict[tuple[str, str], int]
) -> bool:
    """Return whether a candidate was rejected, or its cause so often that no shape of it is tried again."""
    if strikes.get(_key(hit), 0) > MOST_STRIKES:
        return True
    return any(hit.candidate == one.candidate for one in rejected)


def _compute_needed_torque(
    problem: Problem, first: Solution, solution: Solution, hit: Hit, search: Search
) -> tuple[float, int, float]:
    """Return the torque of a hit, N m rms, its joint, and the torque that it needs there."""
    settings = problem.settings
    torque = search.measure_torque(solution, hit)
    candidate = hit.candidate
    joint = candidate.joint
    if joint is None:
        joint = int(np.argmax(torque / problem.torque_rms))
    least = settings.material_share * float(problem.torque_rms[joint])
    if any(candidate.is_same(other) for other in solution.accepted):
        return float(torque[joint]), joint, settings.harmonic_share * least
    if any(other.joint == joint for other in solution.accepted):
        explained = max(first.errors[joint] ** 2 - solution.errors[joint] ** 2, 0.0)
        least = float(np.hypot(least, settings.cause_form_error * np.sqrt(explained)))
    return float(torque[joint]), joint, least


def refine_shapes(search: Search, solution: Solution) -> Solution:
    """Return a model whose causes' shapes are refined beside all others, where that predicts better."""
    for old in solution.accepted:
        if old.name not in REFINEMENTS:
            continue
        without = search.fit_without(solution, [old])
        hit = search.measure(without, old)
        if hit is None:
            continue
        better = search.bisect(without, hit)
        if better.candidate == old:
            continue
        kept = [better.candidate if one == old else one for one in solution.accepted]
        tried = search.solve(kept, solution)
        if compute_solution_gain(solution, tried) > 0:
            solution = tried
    return solution


def drop_needless_causes(search: Search, solution: Solution) -> Solution:
    """Leave out, the worst first, causes whose gain beside all others is not clear."""
    nats = search.problem.settings.kept_nats
    while len(solution.accepted) > 1:
        measured = list[Hit]()
        for candidate in solution.accepted:
            without = search.fit_without(solution, [candidate])
            hit = search.measure(without, candidate)
            if hit is None:
                zero = np.zeros(len(solution.fit.folds))
                hit = Hit(candidate, 0.0, zero, np.zeros(1), np.eye(1))
            measured.append(hit)
        worst = min(measured, key=lambda hit: hit.score)
        if search.is_clear(worst, nats):
            return solution
        kept = [one for one in solution.accepted if one != worst.candidate]
        solution = search.solve(kept, solution)
    return solution
