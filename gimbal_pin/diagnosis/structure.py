"""Flexible model of a joint's torque: a rich regression on the motion and the load, and bursts of power.

What the flexible model does not contain can never be *unknown*, so it is rich. Its groups of functions are measured
alone; the best are joined, and ridge and number are chosen by the held-out gain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, find_peaks, lfilter, sosfiltfilt

from gimbal_pin.diagnosis.candidates import Candidate
from gimbal_pin.diagnosis.problem import Problem
from gimbal_pin.diagnosis.rows import Indices
from gimbal_pin.diagnosis.score import (
    GROUP_RIDGE,
    compute_standard_error,
    pack_columns,
    split_folds,
)
from gimbal_pin.log.log import Array

if TYPE_CHECKING:
    from gimbal_pin.diagnosis.search import Search, Solution

MEMORY_SECONDS = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Time constants of the memories of the motion and of the load, s."""
HEATING_SECONDS = (0.3, 3.0, 10.0, 30.0, 100.0)
"""Time constants of the heat, s."""
RINGING_HERTZ = np.geomspace(0.5, 4.0, 14)
"""Resonances that the acceleration drives, Hz: above 4 Hz they read the acceleration's noise."""
RINGING_DAMPING = 0.08
"""Damping ratio of these: as wide as two are apart."""
RIDGES = (3.0, 0.3)
"""Ridges on the columns of unit norm that are tried; the last is that of a group alone."""
FORCE_RIDGES = (0.03, 3e-4)
"""Ridges for a force in the place of causes: it is large against what is left, so that its prior must be weak."""
JOINED = (1, 2, 4, 7)
"""Numbers of the best groups that are joined: roughly twice as many each time."""
LINES = 6
"""Lines over time or load that are tried. It bounds the time; each pays for the frequencies that were searched."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Signals that the functions at a joint read along one stretch.

    Neighbours are all other joints on a rig of up to three.

    Attributes:
        t: Time, s, (m,).
        q: Angle, rad, (m,).
        v: Rate, rad/s, (m,).
        direction: Direction of sliding, (m,).
        weight: Torque at rest over the rms torque, (m,).
        others: Rates, directions and torques of the other joints, (k, m) each.
        neighbours: Angles and rates of the neighbours, (k, m) each.
        accelerations: Accelerations of the joint and its neighbours, rad/s², (k, m).
        torques: Torques of the joint and its neighbours, N m, (k, m).
        dt: Interval, s.
        seconds: Length of the logs, s.
        travel: The joint's travel, rad.
        place: Angle from the middle of the travel over a quarter of it, (m,).
        rate: Rate over half of what 98 % of the rates stay under, (m,).
        load: Torque over the rms torque, (m,).
    """

    t: Array
    q: Array
    v: Array
    direction: Array
    weight: Array
    others: tuple[Array, Array, Array]
    neighbours: tuple[Array, Array]
    accelerations: Array
    torques: Array
    dt: float
    seconds: float
    travel: float
    place: Array
    rate: Array
    load: Array


def bump(x: Array, count: int) -> Array:
    """Return Gaussian bumps of unit height whose centres lie evenly over ±2, (count, m)."""
    centres = np.linspace(-2.0, 2.0, count)[:, None]
    return np.asarray(np.exp(-0.5 * ((x - centres) * (count - 1) / 3.2) ** 2))


def turn(angle: Array, count: int) -> Array:
    """Return cosines and sines of the first multiples of an angle, (2 count, m)."""
    waves = np.cumprod(np.broadcast_to(np.exp(1j * angle), (count, len(angle))), axis=0)
    return np.vstack([waves.real, waves.imag])


def cross(first: Array, *second: Array | float) -> Array:
    """Return the products of functions (a, m) with each of others, (k, m) or (m,), (all k times a, m)."""
    rows = np.vstack([np.atleast_2d(x + 0 * first[0]) for x in second])
    return (first[:, None] * rows).reshape(-1, first.shape[1])


def forget(s: Surroundings, seconds: Sequence[float], *signals: Array) -> Array:
    """Return first-order fading memories of signals (m,), (signals times time constants, m)."""
    keep = np.exp(-s.dt / np.array(seconds))
    return np.stack([lfilter([1 - k], [1, -k], x, zi=k * x[:1])[0] for k in keep for x in signals])


def ring(s: Surroundings) -> Array:
    """Return displacements and rates of oscillators that the accelerations nearby drive."""
    low_pass = butter(3, RINGING_HERTZ[-1], fs=1 / s.dt, output="sos")
    slow = sosfiltfilt(low_pass, s.accelerations - s.accelerations.mean(axis=1, keepdims=True))
    damped = complex(-RINGING_DAMPING, np.sqrt(1 - RINGING_DAMPING**2))
    poles = np.exp(damped * 2 * np.pi * RINGING_HERTZ * s.dt)
    swings = [lfilter([1 - abs(pole)], [1, -pole], slow + 0j) for pole in poles]
    return np.vstack([part for x in swings for part in (x.real, x.imag)])


def slip(x: Array, *reaches: float) -> Array:
    """Return stretches of springs behind friction elements as x moves, over their largest, in ±1, (reaches, m)."""
    # From turn to turn x moves in one direction: the stretch at the last turn and the way since say all.
    turns = np.r_[0, 1 + np.flatnonzero(np.diff(np.diff(x) > 0))]
    since = np.searchsorted(turns, np.arange(len(x)), "right") - 1

    def stretch(reach: float) -> Array:
        moves = np.diff(x[turns]).tolist()
        at = accumulate(moves, lambda y, dx: min(max(y + dx, -reach), reach), initial=0.0)
        return np.clip(np.array([*at])[since] + x - x[turns][since], -reach, reach)

    return np.array([stretch(reach) for reach in reaches]) / np.array(reaches)[:, None]


def _mix_motions(s: Surroundings) -> Array:
    """Return rates and directions of the other joints and their products with the joint's."""
    v, direction, _ = s.others
    return np.vstack([direction, v, np.abs(v), s.v * v, v**2, s.direction * direction])


def _mix_torques(s: Surroundings) -> Array:
    """Return torques of the other joints, their sizes, and these times the joint's direction."""
    torque = s.others[2]
    return np.vstack([torque, np.abs(torque), s.direction * torque])


def _mix_angles(s: Surroundings) -> Array:
    """Return waves of the joint's angle, its neighbours' and their sums and differences, also times their rates."""
    q, v = s.neighbours
    angles = [q, s.q - q, s.q + q, s.q + 0 * q]
    waves = [wave(angle) for angle in angles for wave in (np.cos, np.sin)]
    return np.vstack([*waves, *(wave * v for wave in waves)])


def _list_hysteresis(s: Surroundings) -> Array:
    """Return springs behind friction over the angle, and their squares with the sign."""
    stretch = slip(s.q, *(share * max(s.travel, 1e-6) for share in (0.01, 0.03, 0.1, 0.2, 0.4)))
    return np.vstack([stretch, stretch[1:] * np.abs(stretch[1:])])


def _list_slow_waves(s: Surroundings) -> Array:
    """Return half waves over the whole log, (6, m)."""
    return np.cos(np.pi * np.arange(1, 7)[:, None] * s.t / s.seconds)


Function = Callable[[Surroundings], Array]

GROUPS: dict[str, Function] = {
    "angle": lambda s: turn(np.pi / 4 * s.place, 14),
    "angle by direction": lambda s: s.direction * turn(np.pi / 4 * s.place, 7),
    "places": lambda s: bump(s.place, 40),
    "places by direction": lambda s: s.direction * bump(s.place, 40),
    "rate": lambda s: cross(bump(s.rate, 9), 1.0, s.direction),
    "slow time": lambda s: cross(_list_slow_waves(s), 1.0, s.direction, s.v),
    "memory of motion": lambda s: forget(
        s, MEMORY_SECONDS, s.q - s.q[0], s.v, s.direction, np.abs(s.v)
    ),
    "hysteresis": _list_hysteresis,
    "ringing": ring,
    "angle and rate": lambda s: cross(bump(s.place, 6), bump(s.rate, 6)),
    "other joints": _mix_motions,
    "other joints by angle": _mix_angles,
    "load": lambda s: cross(bump(s.load, 9), 1.0, s.direction),
    "fine load": lambda s: bump(s.load, 40),
    "load over slow time": lambda s: s.load * _list_slow_waves(s),
    "heat": lambda s: cross(forget(s, HEATING_SECONDS, s.load**2), 1.0, s.load, s.direction, s.v),
    "torques over angle": lambda s: cross(turn(s.q, 8), s.torques),
    "memory of load": lambda s: forget(s, MEMORY_SECONDS, s.load, np.abs(s.load)),
    "hysteresis of load": lambda s: slip(s.load, 0.1, 0.2, 0.5, 1.0),
    "load and rate": lambda s: cross(bump(s.load, 6), bump(s.rate, 6)),
    "load and angle": lambda s: cross(bump(s.load, 6), bump(s.place, 6)),
    "other torques": _mix_torques,
}
"""Name of a group of the flexible model → its functions along a stretch, (k, m)."""

CURVES: dict[str, Function] = {
    "asymmetric-friction": GROUPS["rate"],
    "dead-zone": GROUPS["fine load"],
    "load-dependent-friction": lambda s: (
        s.direction * np.vstack([bump(s.load, 9), bump(s.weight, 9)])
    ),
    "saturation": GROUPS["fine load"],
    "stribeck": lambda s: s.direction * bump(np.abs(s.rate), 17),
}
"""Name of a cause → flexible functions of its own variable, of which every form of it is one; others have one form.

Any friction over load or rate is friction over these. A force over the angle need be no spring.
"""

OWN_GROUPS: dict[str, tuple[str, ...]] = {
    "torque-bias": (),
    "armature": (),
    "cable-spring": ("angle", "places"),
    "cogging": ("angle", "places"),
    "position-dependent-friction": ("angle by direction", "places by direction"),
    "stribeck": ("rate",),
    "quadratic-drag": ("rate",),
    "asymmetric-friction": ("rate",),
    "load-dependent-friction": ("load", "fine load"),
    "torque-gain": ("load", "fine load"),
    "torque-ripple": ("torques over angle", "load and angle"),
    "presliding": ("hysteresis",),
    "friction-drift": ("slow time",),
}
"""Name of a cause → groups of functions of its own variable, over which its form may be another."""
FORCES = (
    ("angle",),
    ("places",),
    ("angle by direction",),
    ("places by direction",),
    ("angle", "angle by direction"),
    ("places", "places by direction"),
    ("rate",),
    ("angle and rate",),
    ("hysteresis",),
    ("load",),
    ("fine load",),
    ("load", "fine load", "load and rate"),
    ("load and angle",),
    ("torques over angle",),
)
"""Groups of functions that together are one force of any form over angle, direction, rate, way or load."""


def list_surroundings(problem: Problem, joint: int, torque: Sequence[Array]) -> list[Surroundings]:
    """Return what the functions at a joint read along each stretch; `torque`: a model's, N m, (m, n) per stretch."""
    stretches = range(len(problem.rows.stretches))
    return [_describe_stretch(problem, s, joint, torque[s]) for s in stretches]


def _describe_stretch(problem: Problem, stretch: int, joint: int, torque: Array) -> Surroundings:
    """Return what the functions at a joint read along a stretch."""
    part = problem.rows.stretches[stretch]
    x = part.samples
    q, v, a, direction, tau = (y.T for y in (x.q, x.v, x.a, part.direction, torque))
    apart = np.abs(np.array(problem.joints) - joint)
    is_near = apart <= (1 if len(apart) > 3 else 2)
    is_neighbour = is_near & (apart > 0)
    observed = problem.ranges[joint]
    level = observed.rms + 1e-12
    return Surroundings(
        t=part.time,
        q=q[joint],
        v=v[joint],
        direction=direction[joint],
        weight=problem.weight[stretch][:, joint] / level,
        others=(v[apart > 0], direction[apart > 0], tau[apart > 0]),
        neighbours=(q[is_neighbour], v[is_neighbour]),
        accelerations=a[is_near],
        torques=tau[is_near],
        dt=part.dt,
        seconds=observed.seconds,
        travel=observed.travel,
        place=(q[joint] - observed.middle) / (0.25 * max(observed.travel, 1e-9)),
        rate=2 * v[joint] / (observed.rate + 1e-12),
        load=tau[joint] / level,
    )


def project_functions(
    problem: Problem, joint: int, states: Sequence[Surroundings], groups: Mapping[str, Function]
) -> dict[str, Array]:
    """Return the rows of groups of functions at a joint, (N, k) by name; empty groups are left out."""
    rows = {
        name: problem.rows.project([functions(state).T for state in states], joint)
        for name, functions in groups.items()
    }
    return {name: x for name, x in rows.items() if x.shape[1]}


def _whiten_functions(
    search: Search,
    solution: Solution,
    joint: int,
    groups: Mapping[str, Function],
    states: Sequence[Surroundings] = (),
) -> dict[str, Array]:
    """Return the whitened inner rows of groups of functions at a joint beside a model."""
    problem = search.problem
    states = states or list_surroundings(problem, joint, solution.torque)
    rows = project_functions(problem, joint, states, groups)
    return {name: search.whitening.apply(problem.rows, x, joint) for name, x in rows.items()}


def _measure_groups(
    solution: Solution, joint: int, groups: Sequence[Array], ridge: float
) -> list[list[float]]:
    """Return gain and its standard error, nats, and the remaining share of the error, rms, beside each group."""
    fit = solution.fit
    before = max(float(fit.squared_errors[:, joint].sum()), 1e-300)
    figures = list[list[float]]()
    for columns in groups:
        gains = fit.measure(pack_columns({joint: columns}, fit.folds), ridge)
        std = float(compute_standard_error(gains.by_fold[0]))
        remaining = float(np.sqrt(gains.errors[0, :, joint].sum() / before))
        figures.append([float(gains.total[0]), std, remaining])
    return figures


class Force(NamedTuple):
    """Columns beside a model.

    Attributes:
        by_fold: Their held-out gain, nats, (K,).
        left: Share of the joint's squared held-out error that they leave.
    """

    by_fold: Array
    left: float


def _measure_force(model: Solution, joint: int, columns: Array, ridges: Sequence[float]) -> Force:
    """Return what whitened columns at a joint gain beside a model, with the best of some ridges."""
    fit = model.fit
    pack = pack_columns({joint: columns}, fit.folds)
    best = max((fit.measure(pack, ridge) for ridge in ridges), key=lambda x: x.total[0])
    squares = float(best.errors[0, :, joint].sum())
    return Force(best.by_fold[0], squares / max(float(fit.squared_errors[:, joint].sum()), 1e-300))


def measure_curve(search: Search, solution: Solution, joint: int, name: str) -> float:
    """Return the share of a joint's held-out error, rms, that a curve of a cause's own variable leaves of a model's."""
    if name not in CURVES:
        return 1.0
    curve = _whiten_functions(search, solution, joint, {name: CURVES[name]})[name]
    return min(float(np.sqrt(_measure_force(solution, joint, curve, RIDGES[-1:]).left)), 1.0)


def measure_beside_forms(search: Search, solution: Solution, joint: int, columns: Array) -> Array:
    """Return what columns (N, k) gain beside a model whose causes at a joint may have any form, by fold, nats, (K,).

    Other forms of these are in the model where they gain something themselves.
    """
    white = search.whitening.apply(search.problem.rows, columns, joint)
    causes = [cause.name for cause in solution.accepted if cause.joint == joint]
    names = dict.fromkeys(group for name in causes for group in OWN_GROUPS.get(name, ()))
    if names:
        groups = _whiten_functions(search, solution, joint, {name: GROUPS[name] for name in names})
        forms = np.hstack([*groups.values()])
        ridges = (RIDGES[-1], *FORCE_RIDGES)
        alone = _measure_force(solution, joint, forms, ridges).by_fold
        if alone.sum() > 0:
            both = _measure_force(solution, joint, np.hstack([white, forms]), ridges).by_fold
            return np.asarray(both - alone)
    return _measure_force(solution, joint, white, (GROUP_RIDGE,)).by_fold


def find_misshapen_causes(
    search: Search, solution: Solution, joint: int, findings: Sequence[Sequence[Candidate]]
) -> list[bool]:
    """Return which findings at a joint are parts of one force of another form.

    One force over few variables must predict clearly better than all of the findings together, their priors paid. A
    finding is a part of it where it alone leaves more than `Settings.material_share` of the power that the force
    explains. A cause that may have any form over its own variable has the best one.

    Args:
        search: The search.
        solution: The model with them.
        joint: The joint.
        findings: Accepted causes of each.
    """
    if not findings:
        return []
    problem = search.problem
    settings = problem.settings
    together = [cause for causes in findings for cause in causes]
    without = search.fit_without(solution, together)
    prior = sum(cause.log_prior for cause in together) + float(np.log(len(FORCES)))
    gain = search.measure_causes(solution, without, together)
    groups = _whiten_functions(search, solution, joint, GROUPS)

    def is_better(force: Force) -> bool:
        more = force.by_fold - gain
        error = search.count_deviations(1) * float(compute_standard_error(more))
        return bool(more.sum() - prior > max(settings.kept_nats, error))

    columns = (np.hstack([groups[name] for name in names]) for names in FORCES)
    forces = [_measure_force(without, joint, x, FORCE_RIDGES) for x in columns]
    least = min((force.left for force in forces if is_better(force)), default=1.0)

    def leave(causes: Sequence[Candidate]) -> float:
        places = solution.find_places(causes, problem)
        own = search.whitening.apply(problem.rows, solution.base[joint][:, places], joint)
        left = _measure_force(without, joint, own, (GROUP_RIDGE,)).left
        name = causes[0].name
        if name not in CURVES:
            return left
        curve = _whiten_functions(search, solution, joint, {name: CURVES[name]})[name]
        free = _measure_force(without, joint, np.hstack([own, curve]), FORCE_RIDGES)
        return min(left, free.left)

    most = settings.material_share * (1.0 - least)
    return [least < 1.0 and leave(causes) - least > most for causes in findings]


class Structure(NamedTuple):
    """Torque that the best flexible model predicts beyond a model.

    Attributes:
        gain: Its held-out gain less the cost of what was searched, nats.
        standard_error: Standard error of the gain, nats.
        remaining: Held-out error that it leaves over that of the model, whitened rms over rms.
        groups: Names of its groups of functions, the best first.
    """

    gain: float
    standard_error: float
    remaining: float
    groups: tuple[str, ...]


def find_structure(search: Search, solution: Solution, joint: int) -> Structure:
    """Return the best flexible model of a joint beside a model."""
    states = list_surroundings(search.problem, joint, solution.torque)
    lines, costs = _find_lines(search, solution, joint, states)
    groups = _whiten_functions(search, solution, joint, GROUPS | lines, states)

    def attempt(tried: Sequence[tuple[str, ...]], ridge: float) -> list[Structure]:
        columns = [np.hstack([groups[name] for name in names]) for names in tried]
        figures = _measure_groups(solution, joint, columns, ridge)
        return [
            Structure(gain - sum(costs.get(name, 0.0) for name in names), std, remaining, names)
            for (gain, std, remaining), names in zip(figures, tried)
        ]

    alone = sorted(attempt([(name,) for name in groups], RIDGES[-1]), key=lambda x: -x.gain)
    names = [x.groups[0] for x in alone if x.gain > 0]
    joined = [tuple(names[:count]) for count in JOINED if count <= len(names)]
    tried = [x for ridge in RIDGES if joined for x in attempt(joined, ridge)]
    tried += [x for ridge in FORCE_RIDGES for x in attempt(FORCES, ridge)]
    return max([alone[0], *tried], key=lambda x: x.gain)


def _find_lines(
    search: Search, solution: Solution, joint: int, states: Sequence[Surroundings]
) -> tuple[dict[str, Function], dict[str, float]]:
    """Return clear lines over time, over time times load, and over load, and the cost of having searched them."""
    rows = search.problem.rows
    fit = solution.fit
    error = fit.errors[..., joint].ravel()
    load = np.concatenate([s.load for s in states])
    span = float(np.ptp(load)) + 1e-12
    band = 0.3, 0.95 * rows.band, rows.seconds
    kinds: dict[str, tuple[Function, Function, tuple[float, float, float]]] = {
        "lines in time": (lambda s: s.t, lambda s: np.ones_like(s.t), band),
        "lines times load": (lambda s: s.t, lambda s: s.load, band),
        "lines over load": (
            lambda s: s.load,
            lambda s: np.ones_like(s.t),
            (2 / span, 40 / span, span),
        ),
    }
    lines = dict[str, Function]()
    costs = dict[str, float]()
    for name, (variable, factor, (low, high, length)) in kinds.items():
        x, w = (
            split_folds(
                _resample(search.problem, [read(s) for s in states])[rows.inner], fit.folds
            ).ravel()
            for read in (variable, factor)
        )
        cost = float(np.log(max(length * (high - low), 1.0)))
        least = cost + search.problem.settings.kept_nats
        found = _find_frequencies(x, w * error, (low, high), length, least)
        if len(found):
            lines[name] = partial(_draw_lines, variable, factor, found)
            costs[name] = cost * len(found)
    return lines, costs


def _draw_lines(variable: Function, factor: Function, frequencies: Array, s: Surroundings) -> Array:
    """Return cosines and sines of a variable times a factor, (2 f, m)."""
    phase = 2 * np.pi * frequencies[:, None] * variable(s)
    return factor(s) * np.vstack([np.cos(phase), np.sin(phase)])


def _find_frequencies(
    x: Array, y: Array, band: tuple[float, float], length: float, least: float
) -> Array:
    """Return the frequencies, per unit of x, of the highest peaks of ``|Σ y exp(2πi f x)|² / Σ y²``.

    Args:
        x: Variable, (N,).
        y: Values, (N,).
        band: Lowest and highest frequency.
        length: Range of x.
        least: Least height of a peak; of white noise it is exponentially distributed with mean 1.
    """
    rate = 8 * band[1]
    place = ((x - x.min()) * rate).astype(int)
    count = max(place.max() + 1, int(rate * length / 0.4))
    power = np.abs(np.fft.rfft(np.bincount(place, y, count))) ** 2 / max(float(y @ y), 1e-300)
    frequency = np.fft.rfftfreq(count, 1 / rate)
    power[(frequency < band[0]) | (frequency > band[1])] = 0.0
    peaks = find_peaks(power, least, distance=4)[0]
    return np.asarray(frequency[peaks[np.argsort(-power[peaks])[:LINES]]])


def _resample(problem: Problem, signals: Sequence[Array]) -> Array:
    """Return signals (m,) per stretch at the times of the rows, (N,)."""
    pairs = zip(problem.rows.stretches, signals)
    return np.concatenate(
        [
            np.interp(np.arange(part.count) / part.count * len(x), np.arange(len(x)), x)
            for part, x in pairs
        ]
    )


@dataclass(frozen=True)
class Bursts:
    """Part of a joint's residual that stands in few moments.

    Attributes:
        size: Its rms, N m.
        share: The same over the residual's rms.
    """

    size: float
    share: float


NO_BURSTS = Bursts(0.0, 0.0)
"""Bursts of noise."""


def find_bursts(search: Search, solution: Solution, joint: int) -> Bursts:
    """Return windows whose power noise does not have.

    A cross-validated regression of the log power on load, its rate, acceleration and rate tells what is usual.
    """
    problem = search.problem
    rows = problem.rows
    width = max(3, round(problem.settings.burst_seconds * 2 * rows.band))
    load = _resample(problem, [x[:, joint] for x in solution.torque])
    signals = [
        solution.left[:, joint],
        load,
        np.gradient(load, 0.5 / rows.band),
        rows.sample("v")[:, joint],
        np.linalg.norm(rows.sample("a"), axis=1),
    ]
    squares = np.column_stack(signals) ** 2
    kept = np.column_stack([rows.inner, rows.sample("weight")[:, joint]])
    middles = slice(width // 2, None, width)
    is_inner, weight = uniform_filter1d(kept, width, axis=0)[middles].T
    windows = uniform_filter1d(squares, width, axis=0)[middles]
    is_open = (is_inner > 0.99) & (weight > 0.5)
    power = windows[is_open, 0] / weight[is_open] ** 2
    if len(power) <= problem.settings.min_windows:
        return NO_BURSTS
    usual = _expect_power(power, windows[is_open, 1:])
    excess = np.maximum(power - problem.settings.burst_power * usual, 0.0)
    # One window alone may be the only one of its motion, of which nothing is known.
    excess[np.argmax(excess)] = 0.0
    size = float(np.sqrt(np.mean(excess)))
    return Bursts(size, size / max(float(np.sqrt(power.mean())), 1e-300))


def _expect_power(power: Array, motion: Array) -> Array:
    """Return the power that the motion lets expect of each window, held out in eighths."""
    scaled = np.log(motion + 1e-3 * motion.mean(axis=0) + 1e-300)
    scaled = scaled - scaled.mean(axis=0)
    columns = np.column_stack([np.ones(len(scaled)), scaled, scaled**2])
    penalty = np.r_[0.0, np.full(2 * scaled.shape[1], 3.0)]
    y = np.log(power + 1e-300)
    residual = hold_out(columns, y, penalty, np.arange(len(y)) * 8 // len(y))
    return np.asarray(np.exp(y - residual + np.median(residual)))


def hold_out(columns: Array, y: Array, penalty: Array, fold: Indices) -> Array:
    """Return y less its prediction by a ridge regression without each row's own fold; fold -1 is never fitted to.

    Args:
        columns: The regression's columns, (N, k).
        y: What is predicted, (N,).
        penalty: Ridge on each column, (k,).
        fold: Number of each row's fold, (N,).
    """
    fitted = columns * (fold >= 0)[:, None]
    gram = fitted.T @ columns + np.diag(penalty)
    right = fitted.T @ y
    residual = np.empty_like(y)
    for k in np.unique(fold):
        is_left_out = fold == k
        less = fitted[is_left_out].T
        values = np.linalg.solve(gram - less @ columns[is_left_out], right - less @ y[is_left_out])
        residual[is_left_out] = y[is_left_out] - columns[is_left_out] @ values
    return residual
