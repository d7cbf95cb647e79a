"""Which causes, forward and backward with a beam, everything refitted at each step; and which the log does not part."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.engine.criterion import (
    by_block,
    compare_models,
    criterion,
    exceeds_form_error,
    fitted,
    leave_cause_out,
    overfit,
    penalty,
    rows,
    unsupported,
)
from gimbal_pin.diagnosis.fit import Fit, refit
from gimbal_pin.diagnosis.library import ColumnLibrary
from gimbal_pin.diagnosis.score import all_gained, gained
from gimbal_pin.diagnosis.shapes import free, other_forms, refine_shapes, same
from gimbal_pin.diagnosis.state import Problem, State, width
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.log.log import Array

BEAM_WIDTH = 2
"""Models that are carried on from step to step."""
REFITTED_CANDIDATES = 6
"""Candidates that are refined and refitted beside each of them."""
MOST_CAUSES = 6
"""Causes of one model: what needs more is not understood."""
ERROR_RATE = 0.01
"""Chance that a log with nothing in it gets a name."""
PROMISE = 0.3
"""Share of the threshold that a candidate must gain on the coarse grid, before its shape is refined."""
MOST_PIECES = 24
"""Harmonics of one cause: no motor has more that matter."""
REFINING_FACTOR = 2.0**0.25
"""Factor by which shapes are moved first when a model is refined once more."""
Names = frozenset[tuple[str, str]]
"""Causes of a model by name and place."""


@dataclass(frozen=True)
class Search:
    """What a search knows beside a model.

    Attributes:
        problem: The logs.
        library: Columns of the candidates.
        threshold: Fall of the criterion from which a cause is one.
    """

    problem: Problem
    library: ColumnLibrary
    threshold: float
    shared: dict[Signal, float] = field(default_factory=dict)
    unseen: WeakKeyDictionary[State, float] = field(default_factory=WeakKeyDictionary)

    @staticmethod
    def among(problem: Problem, library: ColumnLibrary) -> Search:
        """Return the search among some candidates.

        ``2 log(K/α)``: that one of K candidates gains so much by chance, ``exp(-gain/2)`` each, has a chance of α.
        """
        return Search(
            problem, library, 2.0 * float(np.log(max(len(library.causes), 1) / ERROR_RATE))
        )

    def share(self, state: State, signal: Signal) -> float:
        """Return the share of all noise that a candidate passes on, worked out once: no model changes it by much."""
        if signal not in self.shared:
            self.shared[signal] = float(np.mean(np.concatenate(state.pass_noise(signal))))
        return self.shared[signal]

    def foreseen(self, state: State) -> float:
        """Return ``Σ_j N_j log φ_j`` of a model on blocks that its fit has not seen, worked out once."""
        if state not in self.unseen:
            self.unseen[state] = float(rows(state) @ np.log(state.dispersion * overfit(state)))
        return self.unseen[state]


def is_better(state: State, other: State, search: Search) -> bool:
    """Whether a model is better than another by the threshold, and by more than an error of the other's form."""
    return (
        criterion(other) - criterion(state) >= search.threshold
        and lasting(state, other, search)
        and exceeds_form_error(state, other)
        and predicts(state, other, search)
    )


def lasting(state: State, other: State, search: Search) -> bool:
    """Whether a model is better by the threshold without the block that tells most: one event is no evidence."""
    told = by_block(state, other)
    return bool(2.0 * (told.sum() - told.max()) >= search.threshold)


def predicts(state: State, other: State, search: Search) -> bool:
    """Whether a model is better by the threshold on blocks that its fit has not seen."""
    return search.foreseen(other) - search.foreseen(state) >= search.threshold


def names(causes: Sequence[Cause]) -> Names:
    """Return the names and places of causes."""
    return frozenset((one.name, one.place) for one in causes)


def promising(state: State, search: Search, tried: Collection[Names] = ()) -> list[Cause]:
    """Return the best candidate of each name and place by what it gains on the coarse grid, refined, the best first.

    Args:
        state: The model.
        search: The candidates.
        tried: Models that others have grown into already: those are not made again.
    """
    columns = search.library.columns(state)
    net = falls(state, columns, state.fit)
    least = PROMISE * search.threshold
    for k in np.flatnonzero(
        net > least
    ).tolist():  # what takes the torque away takes the noise with it
        if isinstance(signal := columns[k].cause, Signal):
            j = state.problem.evidence.rig.joint_index(signal.place)
            net[k] += rows(state)[j] * np.log(search.share(state, signal))
    best: dict[tuple[str, str], Cause] = {}
    for k in np.argsort(-net).tolist():
        cause = columns[k].cause
        if net[k] < least or len(best) == REFITTED_CANDIDATES:
            break
        there = any(same(cause, one) for one in state.causes)
        if (
            cause.pieces or not cause.of_joint
            if there
            else names((*state.causes, cause)) not in tried
        ):
            best.setdefault((cause.name, cause.place), cause)
    return [
        completed(state, one, search) if one.pieces else refine_shapes(state, one, value)
        for one in best.values()
    ]


def falls(state: State, candidates: Sequence[Columns], fit: Fit) -> Array:
    """Return by how much each candidate would lower the criterion: ``-N log(1 - gain/cost) - k log N``, (k,)."""
    drives = np.array([isinstance(one.cause, Signal) for one in candidates], dtype=bool)
    gains = np.zeros(len(candidates))
    for kind in (True, False):
        places = np.flatnonzero(drives == kind)
        gains[places] = [
            one.gain for one in all_gained(fit, [candidates[k] for k in places.tolist()], kind)
        ]
    count = rows(state)
    power = [float(x @ x) for x in (fit.residual[fit.rows(j)] for j in range(len(fit.scale)))]
    cost = np.array([sum(power) if one.joint is None else power[one.joint] for one in candidates])
    many = np.array([count.sum() if one.joint is None else count[one.joint] for one in candidates])
    left = np.maximum(1.0 - gains / np.maximum(cost, 1e-300), 1e-12)
    return np.asarray(
        -many * np.log(left)
        - np.log(count.max()) * np.array([free(one.cause) for one in candidates])
    )


def value(state: State, cause: Cause) -> float:
    """Return what a cause as it stands is worth beside others of its kind: what takes the noise away gains nothing."""
    bearing = state.bearing_for(cause, state.acting)
    columns = state.columns(cause, bearing=bearing)
    if not isinstance(cause, Signal):
        return gained(state.fit, columns, False).gain
    count = rows(state)[state.problem.evidence.rig.joint_index(cause.joint)]
    share = np.mean(np.concatenate(state.pass_noise(cause, bearing)))
    return float(falls(state, [columns], state.fit)[0] + count * np.log(share))


def completed(state: State, cause: Cause, search: Search) -> Cause:
    """Return a cause with every further piece of its kind that gains enough beside those it has.

    Orthogonal matching pursuit (Pati, Rezaiifar and Krishnaprasad, Asilomar 1993): one piece at a time would take a
    step of the search each.
    """
    like = [one for one in search.library.columns(state) if same(one.cause, cause)]
    used = state.problem.evidence.used
    found = search.library.of(cause, state)
    assert found.joint is not None
    fit = refit(state.fit, found.own, found.joint, used)
    while len(cause.pieces) < MOST_PIECES:
        net = falls(state, like, fit)
        k = int(np.argmax(net))
        if net[k] < search.threshold:
            break
        cause = cause.joined(like[k].cause)
        fit = refit(fit, like[k].own, found.joint, used)
    return cause


def together(causes: Sequence[Cause], new: Cause) -> tuple[Cause, ...]:
    """Return causes with one more; what has pieces is one cause with all of them."""
    old = next((one for one in causes if same(one, new) and one.pieces), None)
    return (
        (*causes, new)
        if old is None
        else tuple(one.joined(new) if one is old else one for one in causes)
    )


def selected(state: State, search: Search) -> State:
    """Add causes to a model, and drop those that others make needless, as long as the criterion falls by enough."""
    best = state
    front = [state]
    for _ in range(MOST_CAUSES):
        tried: set[Names] = set()
        grown: list[tuple[State, State]] = []
        for model in front:
            for cause in promising(model, search, tried):
                tried.add(names((*model.causes, cause)))
                new = fitted(model.problem, together(model.causes, cause), model)
                if new.causes[:-1] == model.causes:
                    new.lacking[new.causes[-1]] = model
                if not unsupported(new):
                    grown.append((new, model))
        front = take_best(grown, search)
        if not front or criterion(front[0]) >= criterion(best):
            break
        best = front[0]
    return best


def take_best(grown: Sequence[tuple[State, State]], search: Search) -> list[State]:
    """Return the best models, pruned, of those that are better than what they have grown from, the best first.

    ``C - k log N`` of a model only rises when causes are dropped: what is behind with that needs no closer look.
    """
    found: dict[Names, State] = {}
    for new, model in sorted(grown, key=lambda pair: criterion(pair[0]) - penalty(pair[0])):
        front = sorted(found.values(), key=criterion)[:BEAM_WIDTH]
        if len(front) == BEAM_WIDTH and criterion(new) - penalty(new) > criterion(front[-1]):
            break
        if is_better(new, model, search):
            least = pruned(new, search)
            key = names(least.causes)
            found[key] = min(found.get(key, least), least, key=criterion)
    return sorted(found.values(), key=criterion)[:BEAM_WIDTH]


def pruned(state: State, search: Search) -> State:
    """Drop the cause, or the piece of one, that is missed least, as long as the model is not better with each."""
    while state.causes:
        if impossible := unsupported(state):
            state = leave_cause_out(state, impossible[0])
            continue
        needless = [less for less in lesser(state) if not is_better(state, less, search)]
        if not needless:
            break
        state = min(needless, key=criterion)
    return state


def lesser(state: State) -> Iterator[State]:
    """Yield a model without each of its causes, and without the weakest piece of those that have several."""
    for k, cause in enumerate(state.causes):
        yield leave_cause_out(state, cause)
        if len(cause.pieces) > 1:
            less = cause.without(cause.pieces[int(np.argmin(worth(state, cause)))])
            yield fitted(state.problem, (*state.causes[:k], less, *state.causes[k + 1 :]), state)


def worth(state: State, cause: Cause) -> Array:
    """Return by how much the sum of squares would rise without each piece of a cause: ``θ_iᵀ (H⁻¹)_ii⁻¹ θ_i``."""
    at = state.places(cause).start
    theta = state.fit.theta
    spread = state.fit.information
    size = width(cause) // len(cause.pieces)
    places = [slice(at + k * size, at + (k + 1) * size) for k in range(len(cause.pieces))]
    return np.array(
        [theta[i] @ np.linalg.lstsq(spread[i, i], theta[i], rcond=1e-10)[0] for i in places]
    )


def polished(state: State) -> State:
    """Refine each cause's shape once more beside the others, and try its other forms, while one bit is gained."""
    for k in range(len(state.causes)):
        for _ in range(MOST_CAUSES):
            cause = state.causes[k]
            base = leave_cause_out(state, cause)
            tried = (
                refine_shapes(base, cause, value, REFINING_FACTOR),
                *other_forms(base, cause, value),
            )
            every = [
                fitted(state.problem, (*state.causes[:k], x, *state.causes[k + 1 :]), state)
                for x in tried
            ]
            new = min((one for one in every if not unsupported(one)), key=criterion, default=state)
            if criterion(new) > criterion(state) - 2.0 * np.log(2.0):
                break
            state = new
    return state


@dataclass(frozen=True)
class FittedRival:
    """A cause in a finding's place.

    Attributes:
        cause: It, refined.
        state: The model with it.
        delta: By how much the log likelihood of the model with the finding is higher, less what its parameters cost.
        std: Standard deviation of that by blocks (Vuong, Econometrica 57, 1989).
    """

    cause: Cause
    state: State
    delta: float
    std: float


def find_rivals(state: State, cause: Cause, search: Search) -> tuple[FittedRival, ...]:
    """Return what else explains what a chosen cause explains, the nearest first."""
    less = leave_cause_out(state, cause)
    found = []
    for other in promising(less, search):
        if (other.name, other.place) != (cause.name, cause.place):
            new = fitted(less.problem, together(less.causes, other), less)
            if not unsupported(new):
                found.append(FittedRival(new.causes[-1], new, *compare_models(state, new)))
    return tuple(sorted(found, key=lambda one: one.delta))


def contested(state: State, search: Search) -> tuple[State, tuple[tuple[FittedRival, ...], ...]]:
    """Return a model in which no cause has a better rival, and the rivals of each of its causes.

    What was found first was found beside less: a cause from which another is told since gives way to it.
    """
    for swaps in range(MOST_CAUSES + 1):
        others = tuple(find_rivals(state, cause, search) for cause in state.causes)
        best = min((one.state for each in others for one in each), key=criterion, default=state)
        if criterion(best) - criterion(state) > -search.threshold or swaps == MOST_CAUSES:
            break
        state = best
    return state, others
