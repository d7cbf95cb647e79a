"""The motion that parts a finding from its rivals: a search over Fourier series under the rig's limits.

Two causes lie ``d = min_x |f - A x|`` standard deviations of the noise apart: f is the finding's fitted torque, A the
columns of the rival, of how its torque changes with its shape, and of all that is refitted beside it. A motion becomes
evidence as a log does (same gate at standstill, same noise, same columns), in rows below those of the logs: of those
two thirds that a diagnosis is fitted to. What of d² stands in each block of time says how probable the finding becomes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import fft
from scipy.special import expit
from tqdm import trange

from gimbal_pin.diagnosis.band import DIAGNOSIS_BAND
from gimbal_pin.diagnosis.evidence import (
    Evidence,
    LogStretch,
    compute_gate,
    measure_ranges,
    number_blocks,
)
from gimbal_pin.diagnosis.extended import build_extended_model
from gimbal_pin.diagnosis.fit import project
from gimbal_pin.diagnosis.parting import Apart, NextExperiment, Parting
from gimbal_pin.diagnosis.probability import LUCKY, foresee_log_odds
from gimbal_pin.diagnosis.result import Diagnosis, Rival, get_joint
from gimbal_pin.diagnosis.shapes import refine_shapes
from gimbal_pin.diagnosis.state import Problem, State, refit_without, width
from gimbal_pin.diagnosis.uncertainty import compute_tangent
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import CAUSES, Cause
from gimbal_pin.effects.base import AMBIENT
from gimbal_pin.excitation.clearance import Clearance
from gimbal_pin.excitation.columns import ExcitationColumns
from gimbal_pin.excitation.criteria import Determinant
from gimbal_pin.excitation.design import CLEARANCE, enforce_clearance
from gimbal_pin.excitation.fourier import LONGEST_PERIOD, Series
from gimbal_pin.excitation.limits import Envelope
from gimbal_pin.excitation.problem import ExcitationProblem as Limits
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.regression import Samples

SERIES_REPEATS = (1, 2, 4, 8)
SERIES_HARMONICS = 10
"""How often a series repeats, and its harmonics: in 20 s `excite`'s own, and by octaves up to 4 Hz, which a position
loop follows."""
TRIES = 120
"""Motions that are tried, half of them as changes of the best: 60 part three look-alikes 2 to 16 % less, 240 up to 11 %
more."""
MARGIN = 0.05
"""Share of every limit that is left free, as `excite` leaves it."""
SMALLEST_CHANGE = 0.01
"""Smallest change of a motion as a share of it; the largest is a whole one, and any size in between is as likely: a
step that adapts (Rechenberg's one-fifth rule) parts the same look-alikes 1 to 2 % more."""


@dataclass(frozen=True, eq=False)
class Contest:
    """A finding and a cause that the logs cannot tell from it.

    Attributes:
        base: What the logs are explained by without the finding.
        cause: The finding's cause, with its shape parameters.
        beta: Its fitted coefficients, (c,).
        rival: The other, in the form that comes nearest on the logs.
        weights: Its coefficients there.
        told: What the logs so far tell of the two.
    """

    base: State
    cause: Cause
    beta: Array
    rival: Cause
    weights: Array
    told: Rival

    def rows(self, state: State) -> Array:
        """``[A f]`` on a state's evidence, A with what is refitted first, (rows n, k)."""
        effects = [*state.problem.friction, *(cause for cause in state.causes if width(cause))]
        beside = [state.problem.rigid, *(state.columns(effect).values for effect in effects)]
        own = state.columns(self.cause).values @ self.beta
        columns = np.concatenate(
            [*beside, compute_tangent(state, self.rival, self.weights), own[..., None]], axis=2
        )
        return self.base.fit.stacked(columns)

    @cached_property
    def known(self) -> Array:
        """That of the logs so far."""
        return self.rows(self.base)

    @cached_property
    def now(self) -> Apart:
        """How far apart the two are on the logs so far."""
        chance = float(expit(-self.told.log_odds))
        return Apart(*self.measure(self.known)[:2], chance, chance)

    def expected(self, problem: Problem, torque: Array) -> Apart:
        """How far apart the two will be with a motion: the problem that its log would be, and its torque, (m, n)."""
        state = replace(
            self.base, problem=problem, torque=[torque], acting=[torque], learned=self.base
        )
        deviations, share, left = self.measure(np.vstack([self.known, self.rows(state)]))
        logs = self.base.problem.evidence
        block = number_blocks([*logs.parts, *problem.evidence.parts], logs.band)
        power = np.asarray(np.bincount(np.repeat(block, logs.rig.n), left**2), dtype=float)
        odds = [
            foresee_log_odds(power, self.told.delta, self.now.deviations**2, z)
            for z in (LUCKY, 0.0)
        ]
        return Apart(
            deviations,
            share,
            *expit([0.0, 0.0] if self.is_blurred(problem.evidence) else odds).tolist(),
        )

    def is_blurred(self, evidence: Evidence) -> bool:
        """Whether other forms of the rival look the same on a range, whichever pieces of the finding stay."""
        some = [
            self.cause.without(piece) for piece in self.cause.pieces if len(self.cause.pieces) > 1
        ]
        seen = evidence.seen[
            evidence.rig.joint_index(self.cause.place) if self.cause.of_joint else 0
        ]
        return all(self.rival.name in one.blurred(seen) for one in (self.cause, *some))

    def measure(self, rows: Array) -> tuple[float, float, Array]:
        """How far apart the two are on rows of ``[A f]``: deviations, their share, and what A leaves of f."""
        R = np.asarray(np.linalg.qr(rows, mode="r"))
        x, deviations = nearest(R[:, :-1], R[:, -1])
        whole = nearest(R[:, : self.base.fit.stack.shape[1]], R[:, -1])[1]
        return deviations, deviations / max(whole, 1e-300), rows[:, -1] - rows[:, :-1] @ x

    def parting(self, expected: Apart | None) -> Parting:
        """Describe it, and what a next experiment will do to it."""
        instead = (self.cause.experiment, self.rival.experiment)
        return Parting(
            self.cause.name, get_joint(self.cause), self.rival.name, self.now, expected, instead
        )


def build_contest(
    state: State, cause: Cause, kind: type[Cause], told: Rival, known: Sequence[Cause] = ()
) -> Contest | None:
    """Return a cause's contest with that form of a kind which comes nearest on the logs; None where it has none.

    What the logs tell of the two is `told`, forms that a search has refined are `known`.
    """
    base = refit_without(state, cause)
    rig = state.problem.evidence.rig
    seen = state.problem.evidence.seen
    beta = state.coefficients(cause) if width(cause) else np.ones(1)

    def alone(form: Cause) -> Array:
        columns = base.columns(form)
        return project(base.fit, columns.own, columns.joint)

    own = alone(cause) @ beta

    def near(form: Cause) -> tuple[Array, float]:
        return nearest(alone(form), own)

    at = [cause.place] if cause.of_joint else rig.joints if kind.of_joint else rig.joints[:1]
    grid = [form for joint in at for form in kind.tried(joint, seen[rig.joint_index(joint)])]
    grid += [form for form in known if type(form) is kind and form.place in (*at, "rig")]
    if not grid:
        return None
    best = refine_shapes(
        base, min(grid, key=lambda form: near(form)[1]), lambda _, form: -near(form)[1]
    )
    return Contest(base, cause, beta, best, near(best)[0], told)


def nearest(A: Array, b: Array) -> tuple[Array, float]:
    """``argmin_x |b - A x|`` and that distance; columns of any size, of none, and dependent ones."""
    size = np.linalg.norm(A, axis=0)
    size[size == 0] = 1.0
    x = np.linalg.lstsq(A / size, b, rcond=1e-10)[0] / size
    return x, float(np.linalg.norm(b - A @ x))


def imagined(known: Problem, motion: Motion, model: Model) -> tuple[Problem, Array]:
    """Return the problem that a motion's log would be, with the noise of the longest so far, and its torque, (m, n).

    The motion has the logs' interval and begins at zero, and its last third is held out; the model predicts its torque.
    """
    logs = known.evidence
    like = max(known.evidence.parts, key=lambda part: part.rows)
    dt = float(motion.t[1])
    length = 2 * (len(motion) // 3)
    filtering = replace(DIAGNOSIS_BAND, cutoff=logs.band)
    t, q, v, a = (values[:length] for values in (motion.t, motion.q, motion.v, motion.a))
    channels = Samples(t, q, v, a, model.inverse(q, v, a, t=t), v, like.channels.rate_std)
    rows = 2 * round(length * dt * logs.band)
    frequency = fft.rfftfreq(length, dt)
    own = np.arange(like.whitener.shape[1]) / (len(like.gate) * like.dt)
    gain = np.stack([np.interp(frequency[: rows // 2 + 1], own, gain) for gain in like.whitener])
    none = np.zeros_like(q)
    part = LogStretch(
        channels,
        none + AMBIENT,
        compute_gate(channels, filtering),
        gain,
        np.zeros_like(gain),
        0.0,
        dt,
        rows,
        none,
    )
    block = number_blocks([part], logs.band)
    seen = measure_ranges(logs.rig, [*logs.parts, part], filtering)
    return Problem.of(
        Evidence(logs.rig, (part,), logs.band, block, seen), known.reduction
    ), channels.tau


class Tried(NamedTuple):
    """A motion's series under the rig's limits, its free coefficients, and what it parts with the logs so far."""

    limits: Limits
    x: Array
    apart: tuple[Apart, ...]

    @property
    def value(self) -> float:
        """``Σ p (1 + share)``, p the probability in half of the logs: where all are sure, how unlike the two are."""
        return sum(one.median * (1 + one.share) for one in self.apart)


@limit_to_one_thread()
def next_experiment(
    found: Diagnosis,
    causes: Mapping[str, type[Cause]] = CAUSES,
    *,
    rng: np.random.Generator,
    seconds: float = LONGEST_PERIOD,
    tries: int = TRIES,
    dt: float = 1e-3,
) -> NextExperiment | None:
    """Design the motion that parts a diagnosis's findings from their rivals; interrupted, return the best so far.

    Args:
        found: The diagnosis.
        causes: The causes that it knew.
        rng: Source of the motions.
        seconds: Length of the motion, s.
        tries: Motions that are tried.
        dt: Sampling interval of the returned motion, s.

    Returns:
        The motion with what it is expected to part; None where nothing is ambiguous.

    Raises:
        UsageError: The rig cannot move within its limits.
    """
    state = found.state
    known = {(one.name, one.place): one for one in reversed(state.causes)} if state else {}
    every = [
        build_contest(state, cause, causes[name], one.tell_from(name), found.instead)
        for one in found.findings
        for name in one.alike[1:]
        if state and name in causes and (cause := known.get((one.cause, one.joint or "rig")))
    ]
    contests = [one for one in every if one is not None]
    if state is None or not contests:
        return None
    problem = state.problem
    model = build_extended_model(state)
    rig = state.problem.evidence.rig

    def motion(limits: Limits, x: Array, dt: float) -> Motion:
        return limits.series.motion(limits.coefficients(x), dt * np.arange(round(seconds / dt) + 1))

    def tried(limits: Limits, x: Array) -> Tried:
        log = imagined(problem, motion(limits, x, problem.evidence.parts[0].dt), model)
        return Tried(limits, x, tuple(each.expected(*log) for each in contests))

    envelope = Envelope.of(rig, MARGIN)
    series = [Series(seconds / times, SERIES_HARMONICS) for times in SERIES_REPEATS]
    clear = Clearance.of(rig, CLEARANCE, envelope)
    columns = ExcitationColumns.of(rig)
    family = [Limits(model, each, columns, Determinant(), envelope, clear) for each in series]
    motions, finished = search_motions(family, tried, tries, rng)
    most = np.max([[apart.deviations for apart in one.apart] for one in motions], axis=0)
    possible = most >= 1  # less than the noise's own deviation is nothing
    best = max(motions, key=lambda one: one.value)
    moving = None
    if possible.any():
        x = best.limits.repair(best.x)
        if x is None:
            raise best.limits.explain_infeasibility()
        best = tried(best.limits, enforce_clearance(best.limits, x)[0])
        moving = motion(best.limits, best.x, dt)
    partings = (
        each.parting(apart if ok else None)
        for each, apart, ok in zip(contests, best.apart, possible)
    )
    held = rig.config.fixed
    if moving is not None and held:
        rest = np.zeros((len(moving), len(held)))
        q, v, a = (np.hstack([x, rest]) for x in (moving.q, moving.v, moving.a))
        q[:, rig.n :] = [*held.values()]
        moving = replace(moving, q=q, v=v, a=a)
    return NextExperiment((*rig.joints, *held), moving, tuple(partings), finished)


def planned(
    found: Diagnosis, causes: Mapping[str, type[Cause]] = CAUSES, *, rng: np.random.Generator
) -> Diagnosis:
    """Return the diagnosis with its `next_experiment`."""
    return replace(found, planned=next_experiment(found, causes, rng=rng))


def search_motions(
    family: Sequence[Limits],
    tried: Callable[[Limits, Array], Tried],
    tries: int,
    rng: np.random.Generator,
) -> tuple[list[Tried], bool]:
    """Try random motions of every series in turn, then changes of the best; return them, and whether all were tried."""
    motions: list[Tried] = []
    try:
        for k in trange(tries, desc="next experiment", unit="motion", disable=None, leave=False):
            limits = family[k % len(family)]
            x = None
            if 2 * k >= tries:
                limits, best, _ = max(motions, key=lambda one: one.value)
                change = (
                    SMALLEST_CHANGE ** rng.random()
                    * np.sqrt(np.mean(best**2))
                    * rng.standard_normal(len(best))
                )
                x = limits.repair(best + change, rough=True)
            motions.append(tried(limits, limits.draw_start(rng) if x is None else x))
    except KeyboardInterrupt:
        if not motions:
            raise
        return motions, False
    return motions, True
