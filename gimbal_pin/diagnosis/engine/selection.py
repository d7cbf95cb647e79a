"""Which causes: forward and backward with a beam, everything refitted at each step, compared by one criterion.

``C = Σ_j N_j (log φ_j - Σ_s log ρ_js) + k log N``: twice the negative log likelihood of rows of unit noise, up to a
constant, with the penalty of Schwarz (Ann. Statist. 6, 1978); φ_j is the dispersion at joint j, N_j its rows, k what
the causes have free. A drive's signal s changes the measured torque, and the noise in it: ρ_js, the share of a noise's
power that it passes on at each frequency, is its Jacobian. Without that any low-pass would explain half of any noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.evidence import Part
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.score import all_gained
from gimbal_pin.diagnosis.shapes import free, refined
from gimbal_pin.diagnosis.state import Problem, State, consistent, solved
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.effects.signal import Borne
from gimbal_pin.log import Array

BEAM = 2
"""Models that are carried on from step to step."""
TRIED = 6
"""Candidates that are refined and refitted beside each of them."""
MOST = 6
"""Causes of one model: what needs more is not understood."""
ERROR_RATE = 0.01
"""Chance that a log with nothing in it gets a name."""
PROMISE = 0.3
"""Share of the threshold that a candidate must gain on the coarse grid, before its shape is refined."""
INSIDE, WIDTH = 0.75, 8
"""Share of the band that does not fade, and frequencies that are averaged where two spectra are compared."""
STEP = 2.0**0.25
"""Factor by which shapes are moved first when a model is refined once more."""


@dataclass(frozen=True)
class Search:
    """What a search knows beside a model.

    Attributes:
        shelf: Columns of the candidates.
        threshold: Fall of the criterion from which a cause is one.
    """

    shelf: Library
    threshold: float

    @staticmethod
    def of(problem: Problem, causes: Sequence[Cause]) -> Search:
        """Return the search among some candidates.

        ``2 log(K/α)``: that one of K candidates gains so much by chance, ``exp(-gain/2)`` each, has a chance of α.
        """
        return Search(Library(problem, causes), 2.0 * float(np.log(max(len(causes), 1) / ERROR_RATE)))

    @property
    def problem(self) -> Problem:
        """The logs."""
        return self.shelf.problem


def rows(state: State) -> Array:
    """Return how many rows of each joint tell, (n,)."""
    evidence = state.problem.evidence
    return np.asarray(evidence.rows * np.maximum(evidence.used(), 1e-3))


def criterion(state: State) -> float:
    """Return ``Σ_j N_j (log φ_j - Σ_s log ρ_js) + k log N``."""
    count = rows(state)
    freedom = sum(free(cause) for cause in state.causes)
    less = np.log(state.fit.dispersion)
    for cause in state.causes:
        if isinstance(cause, Signal):
            less[state.problem.evidence.rig.joint_index(cause.joint)] -= passed_on(state, cause)
    return float(count @ less + np.log(count.max()) * freedom)


def passed_on(state: State, signal: Signal) -> float:
    """Return ``log ρ = ⟨log |S(f)|²⟩``, at most zero, over the band: what a signal makes of noise at its joint.

    S is what it makes of a small noise of the estimated spectrum beside the measured torque: for a filter its gain. A
    limit below nearly all that was measured leaves a constant, in which no noise is left: that explains nothing.
    """
    evidence = state.problem.evidence
    j = evidence.rig.joint_index(signal.joint)
    bearing: Sequence[Borne | None] = state.bearing_for(signal, state.acting) or [None] * len(evidence.parts)
    gains = []
    for part, left, borne in zip(evidence.parts, state.unexplained, bearing):
        torque, noise = part.channels.tau[:, j], flattened(part, left[:, j], j)
        change = part.acted(signal, torque, j, borne) - part.acted(signal, torque - noise, j, borne)
        after, before = (np.abs(fft.rfft(part.whiten(x, j))) ** 2 for x in (change, noise))
        inside = slice(0, int(INSIDE * len(before)) // WIDTH * WIDTH)
        after, before = (np.mean(x[inside].reshape(-1, WIDTH), axis=1) for x in (after, before))
        gains.append(np.log(np.clip(after / np.maximum(before, 1e-300), 1e-300, 1.0)))
    return float(np.mean(np.concatenate(gains)))


def flattened(part: Part, signal: Array, joint: int) -> Array:
    """Return a torque with the phases of a signal, (m,), and of the spectrum that whitening makes flat."""
    spectrum, gain = fft.rfft(signal), part.whitener[joint]
    size = np.zeros(len(spectrum))
    size[: len(gain)] = np.divide(1.0, gain, out=np.zeros_like(gain), where=gain > 1e-3 * gain.max())
    return np.asarray(fft.irfft(spectrum / np.maximum(np.abs(spectrum), 1e-300) * size, len(signal)))


def fitted(problem: Problem, causes: Sequence[Cause], before: State) -> State:
    """Refit everything with these causes until what reads the model's torque agrees with it."""
    return consistent(solved(problem, causes, before))


def promising(state: State, search: Search, most: int = TRIED) -> list[Cause]:
    """Return the best candidate of each name and place by what it gains on the coarse grid, the best first."""
    columns = search.shelf.columns(state)
    drives = np.array([isinstance(one.cause, Signal) for one in columns], dtype=bool)
    gains = np.zeros(len(columns))
    for kind in (True, False):
        places = np.flatnonzero(drives == kind)
        gains[places] = [one.gain for one in all_gained(state.fit, [columns[k] for k in places], kind)]
    net = gains - np.log(rows(state).max()) * np.array([free(one.cause) for one in columns])
    best: dict[tuple[str, str], Cause] = {}
    for k in np.argsort(-net):
        if net[k] < PROMISE * search.threshold or len(best) == most:
            break
        best.setdefault((columns[k].cause.name, columns[k].cause.place), columns[k].cause)
    return list(best.values())


def selected(state: State, search: Search) -> State:
    """Add causes to a model, and drop those that others make needless, as long as the criterion falls by enough."""
    best, front = state, [state]
    for _ in range(MOST):
        grown: dict[frozenset[tuple[str, str]], State] = {}
        for model in front:
            for cause in promising(model, search):
                new = fitted(search.problem, (*model.causes, refined(model, cause)), model)
                if criterion(model) - criterion(new) < search.threshold:
                    continue
                new = pruned(new, search)
                key = frozenset((one.name, one.place) for one in new.causes)
                if key not in grown or criterion(new) < criterion(grown[key]):
                    grown[key] = new
        front = sorted(grown.values(), key=criterion)[:BEAM]
        if not front or criterion(front[0]) >= criterion(best):
            break
        best = front[0]
    return best


def pruned(state: State, search: Search) -> State:
    """Drop the cause that is missed least, as long as the criterion rises by less than the threshold."""
    while len(state.causes) > 1:
        fewer = [without(state, cause, search) for cause in state.causes]
        least = min(fewer, key=criterion)
        if criterion(least) - criterion(state) >= search.threshold:
            break
        state = least
    return state


def without(state: State, cause: Cause, search: Search) -> State:
    """Refit without a cause."""
    return fitted(search.problem, [one for one in state.causes if one is not cause], state)


def polished(state: State, search: Search) -> State:
    """Refine each cause's shape once more beside the others, where the criterion falls."""
    for k in range(len(state.causes)):
        cause = state.causes[k]
        other = refined(without(state, cause, search), cause, STEP)
        new = fitted(search.problem, [other if one is cause else one for one in state.causes], state)
        state = min(state, new, key=criterion)
    return state
