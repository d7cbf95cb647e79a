"""Causes as groups of columns: their shapes on a grid, their prior, and the columns that they add to a model.

Columns that depend on load read the model's own torque, never the measured one, whose noise would explain itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isnan, log, pi

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from gimbal_pin.diagnosis.rows import FADE_SHARE
from gimbal_pin.dynamics.model import is_parameter
from gimbal_pin.effects import (
    CAUSES,
    Armature,
    CableSpring,
    Cause,
    Effect,
    JointFlexibility,
    Sample,
    TorqueBias,
)
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig

PARAMETER_PRIOR = 1e3
"""Log prior of what the rig states to be there, nats: no other cause stands for it."""

LOG_PRIORS = {
    "torque-bias": 2.0,
    "armature": 2.0,
    "asymmetric-friction": 1.0,
    "cogging": 1.0,
    "load-dependent-friction": 1.0,
    "base-tilt": 1.0,
    "torque-ripple": -1.0,
    "friction-drift": -1.0,
    "torque-gain": -1.0,
    "joint-flexibility": -2.0,
    "saturation": -1.0,
    "dead-zone": -1.0,
}
"""Log prior of a cause, nats; 0 for the others. What every peer's base model has comes first; what imitates anything
comes last. Chosen on the development logs."""
PART_TURN_COST = 3.0
"""Cost of a harmonic of which less than one period was travelled, nats: it is a bend like any other.

A part of the prior, chosen on the development logs."""
ORDINARY = ("torque-bias", "armature")
"""Causes that are tried before all others."""
MOTORS = (
    "actuator-lag",
    "armature",
    "cogging",
    "dead-zone",
    "delay",
    "joint-flexibility",
    "load-dependent-friction",
    "saturation",
    "torque-bias",
    "torque-gain",
    "torque-ripple",
)
"""Causes of motors and gears, which a joint whose torque is zero all along has not."""
DRAG_POWERS = (1.3, 1.5, 1.7, 1.85, 2.0, 2.25, 2.5, 3.0, 3.5)
"""Powers of the rate that are tried: beside one that is far off viscous friction turns negative."""
PASSIVE = ("stribeck", "quadratic-drag")
"""Friction laws beside which dry and viscous friction must not turn negative."""
DRIVES = ("joint-flexibility",)
"""Causes that act on the command and have columns that read the model's own torque."""
RESONANCE_SHARE = (0.25, 1.5)
"""Admissible share of a joint's torque that stands behind its spring: 1 is a rotor without inertia, and a fit errs.

Chosen on the development logs."""
RESONANCE_DAMPING = 0.05
"""Damping ratio of the resonances that are tried, that of lightly damped joints; a drive's own is refined."""
RESONANCE_BAND = 1.0 - FADE_SHARE
"""Highest resonance that is tried, in bands: above it rows fade out, and noise of the acceleration looks like one."""
LARGEST_RIPPLE = 0.5
"""Largest ripple that a motor has, as a share of its torque: that of a single-phase motor."""
SMALLEST_PERIODS = 0.35
"""Periods of a harmonic that must be travelled for it to be tried: a third of one is a bend. Chosen on the development
logs."""
HARMONICS = {"cogging": 400, "torque-ripple": 132, "position-dependent-friction": 16}
"""Highest harmonic that is tried, per turn; above 100 the even ones alone. It bounds the grid: more take longer."""


@dataclass(frozen=True)
class Candidate:
    """One cause with one shape, at one joint or of the whole rig.

    Attributes:
        cause: The cause; its coefficients are what a fit finds.
        joint: Number of its joint; None: the whole rig.
        log_prior: Log of its prior probability up to a constant, nats.
    """

    cause: Cause
    joint: int | None
    log_prior: float

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name

    @property
    def place(self) -> str:
        """The joint's name, or "rig"."""
        return self.cause.place

    @cached_property
    def kind(self) -> tuple[str, str]:
        """Name and place: all that its shapes share."""
        return self.name, self.place

    @cached_property
    def is_harmonic(self) -> bool:
        """True if it may be there several times, with other numbers of periods per turn."""
        return isinstance(self.cause, Harmonic)

    @property
    def is_ordinary(self) -> bool:
        """True if it is tried before all others."""
        return self.name in ORDINARY

    @property
    def reads_torque(self) -> bool:
        """True if its columns read the model's own torque."""
        return (isinstance(self.cause, Effect) and self.cause.loaded) or self.name in DRIVES

    @cached_property
    def form(self) -> tuple[str, ...]:
        """Its kind and what is not refined of its shape: of a slack spring the ends that come taut."""
        ends = self.cause.list_ends() if isinstance(self.cause, CableSpring) else ()
        return *self.kind, *ends, *(str(getattr(self.cause, name)) for name in self.cause.chosen)

    def is_admissible(self, coefficients: Array, friction: Array) -> bool:
        """Return whether such coefficients are physically possible.

        Args:
            coefficients: Its own.
            friction: Dry and viscous friction beside it, over what is told from zero.
        """
        if self.name in PASSIVE and len(friction) and friction.min() < -1.0:
            return False
        if self.name == "joint-flexibility":
            return RESONANCE_SHARE[0] < coefficients[0] < RESONANCE_SHARE[1]
        if self.is_harmonic:
            return self.name != "torque-ripple" or bool(np.hypot(*coefficients) < LARGEST_RIPPLE)
        if not isinstance(self.cause, Effect):
            return True
        # A parameter that is not known may have any value.
        return all(
            isnan(p.value) or p.lower <= p.value <= p.upper
            for p in self.cause.shown(coefficients.tolist())
        )


def compute_resonance(torque: Array, dt: float, hertz: float) -> Array:
    """``N(T) - T``: what a load on a spring adds to the torque that moves it rigidly, (m,).

    N is the resonance ``1/(1 - s² + 2 i ζ s)`` of the load with the rotor held, s the frequency over its own.
    """
    memory = int(1.0 / (RESONANCE_DAMPING * hertz * dt))
    length = fft.next_fast_len(len(torque) + memory, real=True)
    ratio = fft.rfftfreq(length, dt) / hertz
    gain = 1.0 / (1.0 - ratio**2 + 2j * RESONANCE_DAMPING * ratio) - 1.0
    spectrum = fft.rfft(torque - torque.mean(), length)
    return np.asarray(fft.irfft(spectrum * gain, length)[: len(torque)])


def compute_columns(candidates: Iterable[Candidate], sample: Sample, dt: float) -> Iterator[Array]:
    """Return the columns of candidates at one joint one after the other, (m,) each."""
    q = np.asarray(sample.q)
    order = 0.0
    wave = np.ones(q.shape, complex)
    steps = dict[float, NDArray[np.complex128]]()
    for candidate in candidates:
        cause = candidate.cause
        if isinstance(cause, Harmonic):
            # ``exp(ikq)`` from the harmonic before, a fifth of the work of a cosine and a sine.
            step = cause.harmonic[0] - order
            if step not in steps:
                steps[step] = np.exp(1j * step * q)
            order += step
            wave = wave * steps[step]
            turned = cause.carrier(sample) * wave
            yield turned.real
            yield turned.imag
        elif isinstance(cause, Effect):
            yield from (np.asarray(x) for x in cause.basis(sample))
        elif isinstance(cause, JointFlexibility):
            yield compute_resonance(np.asarray(sample.tau), dt, cause.frequency)


def count_columns(candidate: Candidate) -> int:
    """Return the number of a joint's candidate's columns."""
    return len(candidate.cause.coefficients) if isinstance(candidate.cause, Effect) else 1


def list_parameters(rig: Rig) -> list[Candidate]:
    """Return causes that are parameters of the rig's model, beside which a search begins, and which it always keeps."""
    return [
        Candidate(kind(joint), j, PARAMETER_PRIOR)
        for j, joint in enumerate(rig.joints)
        for kind in (Armature, TorqueBias)
        if is_parameter(rig, kind(joint)) and not kind.is_stated(joint, rig)
    ]


def list_candidates(rig: Rig, joint: int, ranges: OperatingRange) -> list[Candidate]:
    """Return what is tried at a joint; every cause's prior is shared by its shapes.

    All alike, but the k-th harmonic has the share 1/k of the first.
    """
    name = rig.joints[joint]
    candidates = list[Candidate]()
    for kind in CAUSES.values():
        has_place = kind.of_joint and not (ranges.peak == 0.0 and kind.name in MOTORS)
        if not has_place or kind.is_stated(name, rig):
            continue
        shapes = [x for x in _list_shapes(kind, name, ranges) if rig.n > 1 or not x.coupled]
        inverses = sum(1.0 / k for cause in shapes for k in cause.pieces)
        for cause in shapes:
            cost = log(len(shapes))
            if isinstance(cause, Harmonic):
                k = cause.harmonic[0]
                cost = log(k * inverses) + PART_TURN_COST * (k * ranges.travel < 2 * pi)
            prior = LOG_PRIORS.get(kind.name, 0.0) - cost
            candidates.append(Candidate(cause, joint, prior))
    return candidates


def _list_shapes(kind: type[Cause], joint: str, ranges: OperatingRange) -> Sequence[Cause]:
    """Return the shapes of a cause that are tried at a joint."""
    if issubclass(kind, Harmonic):
        highest = HARMONICS.get(kind.name, 0)
        orders = [*range(1, min(highest, 100) + 1), *range(102, highest + 1, 2)]
        return [
            kind(joint, (float(k),))
            for k in orders
            if k * ranges.travel > 2 * pi * SMALLEST_PERIODS
        ]
    match kind.name:
        case "joint-flexibility":
            resonances = np.geomspace(2.5, RESONANCE_BAND * ranges.band, 6).tolist()
            return [kind.inside(joint, hertz) for hertz in resonances]
        case "quadratic-drag":
            return [kind.inside(joint, power) for power in DRAG_POWERS]
        case "friction-drift":
            return _list_drifts(kind, joint, ranges)
    return kind.tried(joint, ranges) if issubclass(kind, Effect) else ()


def _list_drifts(kind: type[Cause], joint: str, ranges: OperatingRange) -> list[Cause]:
    """Return drifts over time, and over the temperature or what the motor itself turned into heat."""
    if ranges.seconds <= 20.0:
        return []
    spans = (ranges.seconds / 6, ranges.seconds / 2, 10 * ranges.seconds)
    drifts: list[Cause] = [kind.inside(joint, span) for span in spans]
    if ranges.warm:
        drifts.append(kind.inside(joint, thermal=True))
    elif ranges.rms:
        drifts += [kind.inside(joint, span, held=ranges.rms) for span in spans[:2]]
    return drifts


REFINEMENTS = {
    "stribeck": ("speed", 1.6),
    "presliding": ("stroke", 1.6),
    "friction-drift": ("span", 1.6),
    "quadratic-drag": ("power", 1.25),
    "joint-flexibility": ("frequency", 1.15),
    "cable-spring": ("", 1.1),
}
"""Name of a cause → what of its shape is refined, and the factor of the first step, less than the grid's.

The ends of a slack spring move by that share of the travel.
"""


def vary_shape(candidate: Candidate, step: float, ranges: OperatingRange) -> list[Candidate]:
    """Return the candidate with its refined shape parameters a step higher and lower, as far as logs can show it."""
    cause = candidate.cause
    name = REFINEMENTS[candidate.name][0]
    low = -inf
    high = inf
    if candidate.name == "joint-flexibility":
        high = RESONANCE_BAND * ranges.band
    if candidate.name == "stribeck":
        low = max(3 * ranges.rate_std, 0.01 * ranges.rate)
        high = ranges.rate
    if isinstance(cause, CableSpring):
        shift = (step - 1.0) * ranges.travel
        values = [
            (end, getattr(cause, end) + by) for end in cause.list_ends() for by in (-shift, shift)
        ]
    else:
        values = [(name, factor * getattr(cause, name)) for factor in (1 / step, step)]
    varied = [cause.moved(key, value) for key, value in values if low < value < high]
    return [replace(candidate, cause=x) for x in varied if x != cause]
