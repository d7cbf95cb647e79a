"""A finding against its rivals: how far a motion that has not been made yet would part them.

A candidate motion becomes evidence as a log does (same gate at standstill, same noise floor, same columns). The
finding's fitted torque along it is then explained as well as may be by rival, rigid model and friction, with the logs
so far in the same rows: what is left, in units of the noise, is the separation of the two.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.evidence import Evidence, Part, fade
from gimbal_pin.diagnosis.fit import project
from gimbal_pin.diagnosis.parting import Apart
from gimbal_pin.diagnosis.score import gained
from gimbal_pin.diagnosis.shapes import moved, shape_names
from gimbal_pin.diagnosis.state import Problem, State, width, without
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.effects.base import AMBIENT
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.log import Array, Motion
from gimbal_pin.model import Model
from gimbal_pin.rows import Channels, Filtering, mask, settling, standstill

FORMS = 4
"""Forms of a rival, those that come nearest on the logs so far, that a motion must part from the finding."""
STEPS = (2.0, 1.4, 1.1)
"""Factors by which a rival's shape is moved towards the finding once the motion is known."""
RANK = 1e-10
"""Share of the largest singular value under which a combination of columns is none."""


@dataclass(frozen=True, eq=False)
class Contest:
    """One finding, and one cause that the logs cannot tell from it.

    Attributes:
        cause: The finding's cause, with its shape parameters.
        beta: Its fitted coefficients, (c,).
        base: The state without it.
        rival: Name of the other cause.
        forms: The rival with the shapes that come nearest on the logs so far.
    """

    cause: Cause
    beta: Array
    base: State
    rival: str
    forms: tuple[Cause, ...]

    def on(self, problem: Problem, torque: Array) -> State:
        """The state without the cause on a candidate motion, whose torque is given, N m, (m, n)."""
        return replace(self.base, problem=problem, torque=[torque], acting=[torque], learned=self.base)

    def common(self, state: State) -> Array:
        """Weighted columns of all that is refitted, and the finding's torque, side by side, (rows n, k)."""
        own = state.columns(self.cause).values @ self.beta
        return self.base.fit.stacked(np.concatenate([*refitted(state), own[..., None]], axis=2))

    def stack(self, state: State, common: Array) -> Array:
        """Put the forms beside what is `common` to all contests of a finding, (rows n, k)."""
        forms = [self.base.fit.stacked(state.columns(form).values) for form in self.forms]
        return np.hstack([common, *forms])

    @cached_property
    def known(self) -> Array:
        """Triangular factor of `stack` on the logs so far, (k, k)."""
        return triangle(self.stack(self.base, self.common(self.base)))

    @cached_property
    def now(self) -> Apart:
        """How far apart the two are on the logs so far."""
        return self.parted(self.known)

    def expected(self, state: State, common: Array, alone: bool = False) -> Apart:
        """How far apart they will be with a candidate motion, or on its log alone.

        `state` and `common` are those `on` it.
        """
        new = triangle(self.stack(state, common))
        return self.parted(new if alone else triangle(np.vstack([self.known, new])))

    def parted(self, rows: Array) -> Apart:
        """Separation from the form that comes nearest, from rows of `stack` or a triangular factor of them."""
        first = self.base.fit.stack.shape[1]
        base, own = rows[:, :first], rows[:, first]
        whole, at, found = unexplained(base, own), first + 1, list[float]()
        for form in self.forms:
            end = at + max(width(form), 1)
            found.append(unexplained(np.hstack([base, rows[:, at:end]]), own))
            at = end
        return Apart(min(found), min(found) / max(whole, 1e-300))

    def closest(self, state: State, common: Array, alone: bool = False) -> Contest:
        """The contest with one form of the rival, its shape where it imitates the finding best on all those rows."""

        def against(form: Cause) -> float:
            return replace(self, forms=(form,)).expected(state, common, alone).deviations

        form = min(self.forms, key=against)
        for step in STEPS if shape_names(form) else ():
            form = min((form, *neighbours(form, step)), key=against)
        return replace(self, forms=(form,))


def neighbours(cause: Cause, step: float) -> Iterator[Cause]:
    """Yield the cause with each of its shape parameters a step larger and smaller, within bounds."""
    for name in shape_names(cause):
        for factor in (step, 1 / step):
            other = moved(cause, name, factor)
            if other is not None:
                yield other


def refitted(state: State) -> list[Array]:
    """Columns of all that a state refits, as `search.solved` orders them, each (rows, n, c)."""
    effects = [*state.problem.friction, *(cause for cause in state.causes if width(cause))]
    return [state.problem.rigid, *(state.columns(effect).values for effect in effects)]


def triangle(rows: Array) -> Array:
    """Triangular factor: the same sums of squares in as few rows as there are columns."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


def unexplained(A: Array, b: Array) -> float:
    """``min |b - A x|``, columns of any size, dependent ones too."""
    size = np.linalg.norm(A, axis=0)
    unit = A[:, size > 0] / size[size > 0]
    x = np.linalg.lstsq(unit, b, rcond=RANK)[0]
    return float(np.linalg.norm(b - unit @ x))


def contest(state: State, cause: Cause, rival: str, kinds: Mapping[str, type[Cause]]) -> Contest | None:
    """Return a cause's contest with the causes of another name; None where that one has no form here, or is no kind."""
    base = without(state, cause)
    found = gained(base.fit, base.columns(cause), isinstance(cause, Signal)).beta
    beta = found if len(found) else np.ones(base.columns(cause).width)
    mine = project(base.fit, base.columns(cause)) @ beta
    forms = tried(base, cause, kinds[rival]) if rival in kinds else []
    gaps = [unexplained(project(base.fit, base.columns(form)), mine) for form in forms]
    nearest = [forms[i] for i in np.argsort(gaps, kind="stable")[:FORMS]]
    return Contest(cause, beta, base, rival, tuple(nearest)) if nearest else None


def tried(base: State, cause: Cause, kind: type[Cause]) -> list[Cause]:
    """A rival's forms at a cause's place: its coarse grid, and the cause's own harmonics where both repeat."""
    evidence = base.problem.evidence
    joints = evidence.rig.joints
    at = [joints.index(cause.place)] if cause.of_joint else list(range(len(joints)) if kind.of_joint else (0,))
    forms = [form for j in at for form in kind.tried(joints[j], evidence.seen[j])]
    if isinstance(cause, Harmonic) and issubclass(kind, Harmonic):
        forms.append(kind(cause.joint, cause.harmonic))
    return forms


def imagined(known: Evidence, motion: Motion, model: Model, filtering: Filtering) -> tuple[Evidence, Array]:
    """Return a motion as the evidence that its log would be, by the sensors of the logs so far, and its torque.

    Args:
        known: The logs so far.
        motion: The motion, at the interval of `known`'s parts.
        model: Predicts the torque, N m, (m, n).
        filtering: As the logs were filtered.
    """
    dt, length = float(motion.t[1] - motion.t[0]), 2 * (len(motion) // 2)
    motion = Motion(*(values[:length] for values in (motion.t, motion.q, motion.v, motion.a)))
    count = max(2 * round(length * dt * known.band), 4)
    tau = model.inverse(motion.q, motion.v, motion.a, t=motion.t)
    rate_std = np.mean([part.channels.rate_std for part in known.parts], axis=0)
    channels = Channels(motion.t, motion.q, motion.v, motion.a, tau, rate_std)
    gate = mask(standstill(channels, filtering), round(0.5 / filtering.cutoff / dt))
    gate *= fade(length, int(np.ceil(settling(filtering) / dt)))[:, None]
    frequency = fft.rfftfreq(length, dt)
    gain = np.mean([gain_at(part, frequency[: count // 2 + 1]) for part in known.parts], axis=0)
    trust = np.ones((known.rig.n, len(frequency)))
    warm = np.full(motion.q.shape, AMBIENT)
    none = np.zeros(motion.q.shape)
    part = Part(channels, warm, gate, gain, trust, float(motion.t[0]), dt, count, none)
    return Evidence(known.rig, (part,), known.band, np.zeros(count, int), known.seen), tau


def gain_at(part: Part, frequency: Array) -> Array:
    """A part's whitening gain at other frequencies, Hz, (f,): (n, f)."""
    own = np.arange(part.whitener.shape[1]) / (len(part.gate) * part.dt)
    return np.stack([np.interp(frequency, own, gain) for gain in part.whitener])
