"""Rivals of a finding: other causes in its place, and how probable each is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gimbal_pin.diagnosis.candidates import Candidate
from gimbal_pin.diagnosis.library import Shelf
from gimbal_pin.diagnosis.search import (
    Hit,
    Search,
    Solution,
    compute_solution_gain,
)
from gimbal_pin.log.log import Array

DRAWS = 1000
"""Draws of the Bayesian bootstrap: a probability of .05 is known to .007."""
MOST_RIVALS = 5
"""Most rivals of one finding whose shapes are refined. It bounds the time."""
MOST_EXCHANGES = 6
"""Most exchanges of a finding for a better rival. It bounds the time."""


@dataclass(frozen=True, eq=False)
class Contest:
    """A finding and what else could stand at its place.

    Attributes:
        own: The accepted causes that make up the finding: several harmonics of one cause.
        joint: Number of the joint at which it adds most torque.
        without: The model without it.
        gain: Its gain beside all others by fold, nats, (K,).
        rivals: The best shape of every other cause there.
    """

    own: tuple[Candidate, ...]
    joint: int
    without: Solution
    gain: Array
    rivals: tuple[Hit, ...]

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.own[0].name

    @property
    def place(self) -> str:
        """Joint's name, or "rig"."""
        return self.own[0].place


def list_contests(search: Search, solution: Solution, shelves: Sequence[Shelf]) -> list[Contest]:
    """Return every finding of a model with its rivals.

    Args:
        search: The search.
        solution: The model.
        shelves: All candidates' columns beside it.
    """
    return [_hold_contest(search, solution, shelves, causes) for causes in _group_causes(solution)]


def _group_causes(solution: Solution) -> list[tuple[Candidate, ...]]:
    """Return the accepted causes that make up each finding."""
    groups = dict[tuple[str, str], list[Candidate]]()
    for candidate in solution.accepted:
        groups.setdefault(candidate.kind, []).append(candidate)
    return [tuple(group) for group in groups.values()]


def _hold_contest(
    search: Search, solution: Solution, shelves: Sequence[Shelf], causes: tuple[Candidate, ...]
) -> Contest:
    """Return a finding with its rivals."""
    first = causes[0]
    without = search.fit_without(solution, causes)
    gain = search.measure_causes(solution, without, causes)
    joint = first.joint
    near = [shelf for shelf in shelves if joint is None or shelf.joint == joint]
    if joint is None:
        lowered = (without.errors**2 - solution.errors**2) / search.problem.torque_rms**2
        joint = int(np.argmax(lowered))
    hits = [hit for hit in search.screen(without, near) if hit.candidate.name != first.name]
    rivals = dict[str, Hit]()
    for hit in search.refine(without, hits, MOST_RIVALS):
        rivals.setdefault(hit.candidate.name, hit)
    hits = list(rivals.values())
    return Contest(causes, joint, without, gain, tuple(hits))


def weigh(gains: Array, log_priors: Array) -> list[float]:
    """Return the probabilities of models: stacking weights by the Bayesian bootstrap over folds.

    Pseudo-BMA+ of Yao, Vehtari, Simpson and Gelman (Bayesian Analysis 13, 2018), with the models' priors. The draws are
    those of a fixed generator: they estimate an integral, and nothing random is wanted in an answer.

    Args:
        gains: Their gains by fold, nats, (m, K).
        log_priors: Their log priors, nats, (m,).
    """
    folds = gains.shape[1]
    weights = folds * np.random.default_rng(0).dirichlet(np.ones(folds), DRAWS)
    score = weights @ gains.T + log_priors
    odds = np.exp(score - score.max(axis=1, keepdims=True))
    probabilities: list[float] = (odds / odds.sum(axis=1, keepdims=True)).mean(axis=0).tolist()
    return probabilities


def is_close(search: Search, nats: float, std: float, probability: float) -> bool:
    """Return whether a finding is not told from a rival: it is not improbable, or the difference is not clear.

    Args:
        search: The search.
        nats: Gain of the finding less that of the rival.
        std: Standard error of that.
        probability: Probability of the rival.
    """
    settings = search.problem.settings
    is_clear = nats > max(settings.kept_nats, search.count_deviations(1) * std)
    return probability > settings.rival_probability or not is_clear


def exchange_for_better(
    search: Search, solution: Solution, shelves: Sequence[Shelf]
) -> tuple[Solution, tuple[Shelf, ...]]:
    """Exchange findings for rivals, or two for one, while the whole model then predicts better."""
    for _ in range(MOST_EXCHANGES):
        tried = (
            _exchange(search, solution, left_out, hit)
            for left_out, hit in _list_exchanges(search, solution, shelves)
        )
        better = next((x for x in tried if x is not None), None)
        if better is None:
            break
        solution = better
        shelves = search.renew_shelves(shelves, solution)
    return solution, tuple(shelves)


def _list_exchanges(
    search: Search, solution: Solution, shelves: Sequence[Shelf]
) -> Iterator[tuple[tuple[Candidate, ...], Hit]]:
    """Return findings with a rival of higher score, then two findings at a joint with one cause for both."""
    for causes in _group_causes(solution):
        contest = _hold_contest(search, solution, shelves, causes)
        for hit in contest.rivals:
            if hit.score > contest.gain.sum() + causes[0].log_prior:
                yield causes, hit
    for first, second in combinations(_group_causes(solution), 2):
        joint = first[0].joint
        if joint is not None and joint == second[0].joint:
            both = (*first, *second)
            without = search.fit_without(solution, both)
            near = [shelf for shelf in shelves if shelf.joint == joint]
            for hit in search.refine(without, search.screen(without, near, with_rig=False)):
                yield both, hit


def _exchange(
    search: Search, solution: Solution, left_out: Sequence[Candidate], hit: Hit
) -> Solution | None:
    """Return the model with one cause in place of others, where it predicts better by more than their priors."""
    if not search.is_clear(hit, search.problem.settings.kept_nats):
        return None
    kept = [cause for cause in solution.accepted if cause not in left_out]
    if any(hit.candidate.kind == cause.kind for cause in kept):
        return None
    prior = hit.candidate.log_prior - sum(cause.log_prior for cause in left_out)
    tried = search.solve([*kept, hit.candidate], solution)
    return tried if compute_solution_gain(solution, tried) + prior > 0 else None
