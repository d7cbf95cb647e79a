"""Which causes: forward and backward with a beam, everything refitted at each step, compared by one criterion.

``C = Σ_j N_j log φ_j + k log N``: twice the negative log likelihood of rows of unit noise, up to a constant, with the
penalty of Schwarz (Ann. Statist. 6, 1978); N_j are joint j's rows, k what the causes have free, φ_j is the dispersion
``⟨|R(f)|²/ρ(f)⟩`` of its residual. A drive's signal changes the measured torque, and the noise in it: ρ is the share of
a noise's power that it passes on at each frequency. Without that any low-pass would explain half of any noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.engine.prediction import overfit
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
    """Return ``Σ_j N_j log φ_j + k log N``."""
    count = rows(state)
    freedom = sum(free(cause) for cause in state.causes)
    return float(count @ np.log(dispersion(state)) + np.log(count.max()) * freedom)


def dispersion(state: State) -> Array:
    """Return each joint's ``φ = ⟨|R(f)|²/ρ(f)⟩``, (n,): residual power over the noise's, as the drives pass it on."""
    found = state.fit.dispersion.copy()
    for joint in {cause.joint for cause in state.causes if isinstance(cause, Signal)}:
        evidence, first = state.problem.evidence, 0
        j = evidence.rig.joint_index(joint)
        own, power, fair = state.fit.residual[state.fit.rows(j)], 0.0, 0.0
        for part, share in zip(evidence.parts, passed_on(state, j)):
            spectrum = np.abs(fft.rfft(own[first : first + part.rows])) ** 2
            first += part.rows
            power, fair = power + spectrum.sum(), fair + float(np.sum(spectrum / share))
        found[j] *= fair / max(power, 1e-300)
    return found


def passed_on(state: State, joint: int) -> list[Array]:
    """Return ρ at a joint, the share of a noise's power that its drive's signals pass on, (f,) for each part.

    A small noise of the estimated spectrum is put beside the measured torque: for a filter ρ is its gain. A limit below
    nearly all that was measured leaves a constant, in which no noise is left: that explains nothing.
    """
    evidence = state.problem.evidence
    shares: list[Array] = [np.ones(part.whitener.shape[1]) for part in evidence.parts]
    for signal in state.causes:
        if not isinstance(signal, Signal) or evidence.rig.joint_index(signal.joint) != joint:
            continue
        bearing: Sequence[Borne | None] = state.bearing_for(signal, state.acting) or [None] * len(evidence.parts)
        for k, (part, left, borne) in enumerate(zip(evidence.parts, state.unexplained, bearing)):
            torque, noise = part.channels.tau[:, joint], flattened(part, left[:, joint], joint)
            change = part.acted(signal, torque, joint, borne) - part.acted(signal, torque - noise, joint, borne)
            after, before = (np.abs(fft.rfft(part.whiten(x, joint))) ** 2 for x in (change, noise))
            inside = slice(0, int(INSIDE * len(before)) // WIDTH * WIDTH)
            after, before = (np.mean(x[inside].reshape(-1, WIDTH), axis=1) for x in (after, before))
            share = np.repeat(np.clip(after / np.maximum(before, 1e-300), 1e-300, 1.0), WIDTH)
            shares[k] *= np.pad(share, (0, len(shares[k]) - len(share)), mode="edge")
    return shares


def better(state: State, other: State, search: Search) -> bool:
    """Whether a model is better than another by the threshold: in its fit, and on blocks that the fit has not seen."""
    if criterion(other) - criterion(state) < search.threshold:
        return False
    foreseen = [rows(one) @ np.log(dispersion(one) * overfit(one)) for one in (state, other)]
    return bool(foreseen[1] - foreseen[0] >= search.threshold)


def vuong(state: State, other: State) -> float:
    """``Σ_b d_b/(√B std d_b)``: by how much, in deviations, a model's log likelihood is above another's.

    d_b is what block b adds to it: ``Σ_j (r'_j² - r_j²)/φ_j``, both over the noise as their drives pass it on.
    """
    known = dispersion(state)
    size, than = (np.sqrt(dispersion(one) / known) for one in (state, other))
    count = len(state.fit.residual) // len(known)
    difference = (np.tile(than, count) * other.fit.residual) ** 2 - (np.tile(size, count) * state.fit.residual) ** 2
    blocks = state.fit.by_block(difference[:, None])[:, 0]
    return float(blocks.sum() / max(np.sqrt(len(blocks)) * blocks.std(ddof=1), 1e-12))


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
                if not better(new, model, search):
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
    """Drop the cause that is missed least, as long as the model is not better with each that it has."""
    while state.causes:
        needless = [less for cause in state.causes if not better(state, less := without(state, cause, search), search)]
        if not needless:
            break
        state = min(needless, key=criterion)
    return state


def without(state: State, cause: Cause, search: Search) -> State:
    """Refit without a cause."""
    return fitted(search.problem, [one for one in state.causes if one is not cause], state)


def polished(state: State, search: Search) -> State:
    """Refine each cause's shape once more beside the others, as long as the criterion falls by one bit."""
    for k in range(len(state.causes)):
        for _ in range(MOST):
            cause = state.causes[k]
            other = refined(without(state, cause, search), cause, STEP)
            new = fitted(search.problem, [other if one is cause else one for one in state.causes], state)
            if criterion(new) > criterion(state) - 2.0 * np.log(2.0):
                break
            state = new
    return state
