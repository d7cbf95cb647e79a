"""Structure of a joint's residual: a rich regression on the motion and the load, and bursts of power.

What the flexible model does not contain can never be *unknown*, so it is rich. Its groups of functions are screened
alone; the best are joined, and ridge and number are chosen by the held-out gain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from gimbal_pin.diagnosis.problem import Problem, Whitening
from gimbal_pin.diagnosis.score import BlockFit, compute_standard_error, pack_columns
from gimbal_pin.effects import Sample
from gimbal_pin.log.log import Array

TIME_CONSTANTS = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Time constants of the memories of the motion, s."""
HEATING_TIMES = (0.3, 3.0, 10.0, 30.0, 100.0)
"""Time constants of the heat, s."""
RINGING_HERTZ = np.geomspace(0.5, 4.0, 14)
"""Resonances that the acceleration drives, Hz: above 4 Hz they read the acceleration's noise."""
RINGING_DAMPING = 0.08
"""Damping ratio of these: as wide as two are apart."""
ALONE_RIDGE = 0.3
"""Ridge on a group alone, on columns of unit norm."""
OTHER_RIDGES = (3.0, 0.03)
"""Ridges that the best group is tried with besides."""
JOINED = (2, 4, 7)
"""Numbers of the best groups that are joined."""
JOINED_RIDGES = (3.0, 0.3)
"""Ridges that they are tried with."""
WORST_JOINED = -5.0
"""Gain of the last of these, nats, from which they are joined."""
LINES = 6
"""Lines over time or load that are tried."""
LINE_GAIN = 3.0
"""Gain of a line beyond the number of frequencies that were searched, nats."""
BURST_SECONDS = 0.25
"""Length of the windows in which bursts are looked for, s."""
FEWEST_WINDOWS = 40
"""Fewest windows that tell what is usual."""

Features = dict[str, list[Array]]


def bump(z: Array, count: int, reach: float = 2.0) -> list[Array]:
    """Return Gaussian bumps of unit height whose centres lie evenly over ±reach."""
    centres = np.linspace(-reach, reach, count)
    width = 0.8 * 2 * reach / (count - 1)
    return [np.exp(-0.5 * ((z - centre) / width) ** 2) for centre in centres]


def turn(angle: Array, orders: range) -> list[Array]:
    """Return cosines and sines of multiples of an angle."""
    return [wave(k * angle) for k in orders for wave in (np.cos, np.sin)]


def forget(x: Array, time_constant: float, dt: float) -> Array:
    """Return a first-order fading memory of x (m,)."""
    keep = np.exp(-dt / time_constant)
    return np.asarray(lfilter([1 - keep], [1, -keep], x, zi=keep * x[:1])[0])


def ring(x: Array, hertz: float, dt: float) -> list[Array]:
    """Return displacement and rate of an oscillator that x drives, (m,) each."""
    w = 2 * np.pi * hertz
    pole = np.exp(complex(-RINGING_DAMPING, np.sqrt(1 - RINGING_DAMPING**2)) * w * dt)
    swing = lfilter([1 - abs(pole)], [1, -pole], x - x.mean() + 0j)
    return [swing.real, swing.imag]


def slip(x: Array, reach: float) -> Array:
    """Return the stretch of a spring behind a friction element as x moves, over its largest, in ±1 (m,)."""
    up = np.diff(x, prepend=x[:1]) >= 0
    turns = np.flatnonzero(up[1:] != up[:-1])
    at = x[np.r_[0, turns]]
    stretch = [0.0]
    for moved in np.diff(at).tolist():
        stretch.append(min(max(stretch[-1] + moved, -reach), reach))
    since = np.searchsorted(turns, np.arange(len(x)))
    return np.asarray(np.clip(np.array(stretch)[since] + x - at[since], -reach, reach) / reach)


class JointState(NamedTuple):
    """State that a joint's effects read along one stretch, (m,) each: see `Sample`."""

    t: Array
    q: Array
    v: Array
    a: Array
    slide: Array
    tau: Array
    weight: Array

    @classmethod
    def of(cls, sample: Sample) -> JointState:
        """Return the arrays of a sample."""
        values = [np.asarray(getattr(sample, name), dtype=float) for name in cls._fields]
        return cls(*values)


class Surroundings(NamedTuple):
    """Signals that the functions at a joint read along one stretch.

    Attributes:
        own: State of the joint.
        others: States of the other joints.
        near: Those of the neighbouring joints, all of them on a rig of up to three.
        dt: Interval, s.
        seconds: Length of the logs, s.
        travel: The joint's travel, rad.
        middle: Middle of it, rad.
        rate: What 98 % of its rates stay under, rad/s.
        level: Rms of its torque, N m.
    """

    own: JointState
    others: list[JointState]
    near: list[JointState]
    dt: float
    seconds: float
    travel: float
    middle: float
    rate: float
    level: float


def _look_around(
    problem: Problem, stretch: int, joint: int, torque: Sequence[Array]
) -> Surroundings:
    """Return what the functions at a joint read along a stretch."""
    samples = [JointState.of(problem.sample(stretch, j, torque[stretch])) for j in problem.joints]
    seen = problem.ranges[joint]
    n = problem.rig.n
    near = [samples[j] for j in problem.joints if j != joint and (n <= 3 or abs(j - joint) <= 1)]
    return Surroundings(
        own=samples[joint],
        others=[x for j, x in enumerate(samples) if j != joint],
        near=near,
        dt=problem.rows.stretches[stretch].dt,
        seconds=seen.seconds,
        travel=seen.travel,
        middle=seen.middle,
        rate=seen.rate + 1e-12,
        level=seen.rms + 1e-12,
    )


def compute_smooth_functions(problem: Problem, joint: int, torque: Sequence[Array]) -> list[Array]:
    """Return some hundred smooth functions for the noise's estimate along each stretch, (m, k).

    Of angle, rate, load, direction, slow time and the other joints. More of them make the estimate worse: with those of
    the flexible model a joint's held-out error rose from 9 to 15 %.
    """
    out = list[Array]()
    for s in range(len(problem.rows.stretches)):
        around = _look_around(problem, s, joint, torque)
        q = around.own.q
        v = around.own.v
        d = around.own.slide
        load = around.own.tau
        angle = np.pi * q / max(around.travel, 0.3)
        columns = turn(angle, range(1, 15))
        columns += [d * x for x in turn(angle, range(1, 8))]
        for z in (2 * v / around.rate, load / around.level):
            columns += [w * x for x in bump(z, 9) for w in (1.0, d)]
        for wave in _list_slow_waves(around):
            columns += [wave, d * wave]
        for x in around.others:
            columns += [x.slide, x.v, x.tau, np.abs(x.tau)]
        for x in [around.own, *around.near]:
            columns += [x.tau * wave for wave in turn(q, range(1, 9))]
        out.append(np.column_stack(columns))
    return out


def _list_slow_waves(around: Surroundings) -> list[Array]:
    """Return half waves over the whole log."""
    return [np.cos(np.pi * k * around.own.t / around.seconds) for k in range(1, 7)]


def _list_motion_features(around: Surroundings) -> Features:
    """Return groups of functions of the motion."""
    q = around.own.q
    v = around.own.v
    d = around.own.slide
    angle = np.pi * q / max(around.travel, 0.3)
    place = (q - around.middle) / (0.25 * max(around.travel, 1e-9))
    rate = 2 * v / around.rate
    low_pass = butter(3, min(4.0, 0.4 / around.dt), fs=1 / around.dt, output="sos")
    hysteresis = [slip(q, r * max(around.travel, 1e-6)) for r in (0.01, 0.03, 0.1, 0.2, 0.4)]
    features: Features = {
        "angle": turn(angle, range(1, 15)),
        "angle by direction": [d * x for x in turn(angle, range(1, 8))],
        "places": bump(place, 40),
        "places by direction": [d * x for x in bump(place, 40)],
        "rate": [w * x for x in bump(rate, 9) for w in (1.0, d)],
        "slow time": [w * x for x in _list_slow_waves(around) for w in (1.0, d, v)],
        "memory of motion": [
            forget(x, time, around.dt)
            for time in TIME_CONSTANTS
            for x in (q - q[0], v, d, np.abs(v))
        ],
        "hysteresis": [*hysteresis, *(x * np.abs(x) for x in hysteresis[1:])],
        "ringing": [
            swing
            for x in [around.own, *around.near]
            for hertz in RINGING_HERTZ
            if hertz > 2 / around.seconds
            for swing in ring(sosfiltfilt(low_pass, x.a), float(hertz), around.dt)
        ],
        "angle and rate": [x * y for x in bump(place, 6) for y in bump(rate, 6)],
    }
    if around.others:
        features["other joints"] = [
            x
            for other in around.others
            for x in (
                other.slide,
                other.v,
                np.abs(other.v),
                v * other.v,
                other.v**2,
                d * other.slide,
            )
        ]
    if around.near:
        features["other joints by angle"] = [
            w * wave
            for other in around.near
            for w in (1.0, other.v)
            for angles in (other.q, q - other.q, q + other.q, q)
            for wave in turn(angles, range(1, 2))
        ]
    return features


def _list_load_features(around: Surroundings) -> Features:
    """Return groups of functions that read the model's torque."""
    q = around.own.q
    v = around.own.v
    d = around.own.slide
    torque = around.own.tau
    load = torque / around.level
    place = (q - around.middle) / (0.25 * max(around.travel, 1e-9))
    rate = 2 * v / around.rate
    features: Features = {
        "load": [w * x for x in bump(load, 9) for w in (1.0, d)],
        "fine load": bump(load, 40),
        "load over slow time": [load * x for x in _list_slow_waves(around)],
        "heat": [
            w * forget(load**2, time, around.dt)
            for time in HEATING_TIMES
            for w in (1.0, load, d, v)
        ],
        "torques over angle": [
            x.tau * wave for x in [around.own, *around.near] for wave in turn(q, range(1, 9))
        ],
        "memory of load": [
            forget(x, time, around.dt) for time in TIME_CONSTANTS for x in (load, np.abs(load))
        ],
        "hysteresis of load": [slip(load, reach) for reach in (0.1, 0.2, 0.5, 1.0)],
        "load and rate": [x * y for x in bump(load, 6) for y in bump(rate, 6)],
        "load and angle": [x * y for x in bump(load, 6) for y in bump(place, 6)],
    }
    if around.others:
        features["other torques"] = [
            x for other in around.others for x in (other.tau, np.abs(other.tau), d * other.tau)
        ]
    return features


def list_curve(name: str, around: Surroundings) -> list[Array]:
    """Return a flexible function of a cause's own variable that any form of the cause is; none: it has one form only.

    Any friction over load or rate is friction over these. A force over the angle need be no spring.
    """
    own = around.own
    d = own.slide
    match name:
        case "load-dependent-friction":
            loads = [own.tau / around.level, own.weight / around.level]
            return [d * x for z in loads for x in bump(z, 9)]
        case "asymmetric-friction":
            return [w * x for x in bump(2 * own.v / around.rate, 9) for w in (1.0, d)]
        case "stribeck":
            return [d * x for x in bump(2 * np.abs(own.v) / around.rate, 17)]
        case "dead-zone" | "saturation":
            return bump(own.tau / around.level, 40)
    return []


def measure_curve(
    problem: Problem,
    whitening: Whitening,
    fit: BlockFit,
    torque: Sequence[Array],
    joint: int,
    name: str,
) -> float:
    """Return the held-out error over that of a model, rms over rms, once a cause has a curve of its own variable.

    Args:
        problem: The rows.
        whitening: Their whitening.
        fit: The model with the cause.
        torque: Its torque along each stretch, N m, (m, n).
        joint: The joint.
        name: Name of the cause.
    """
    made = [
        list_curve(name, _look_around(problem, s, joint, torque))
        for s in range(len(problem.rows.stretches))
    ]
    if not made[0]:
        return 1.0
    signals = [np.column_stack(own) for own in made]
    white = whitening.apply(problem.rows, problem.rows.project(signals, joint), joint)
    pack = pack_columns({joint: white}, fit.folds)
    after = float(fit.measure(pack, ALONE_RIDGE).errors[0, :, joint].sum())
    before = max(float(fit.squared_errors[:, joint].sum()), 1e-300)
    return float(min(np.sqrt(after / before), 1.0))


@dataclass(frozen=True)
class Structure:
    """Torque that the best flexible model predicts beyond a model.

    Attributes:
        gain: Its held-out gain less the cost of what was searched, nats.
        standard_error: Standard error of the gain, nats.
        left: Held-out error that it leaves over that of the model, whitened rms over rms.
        groups: Names of its groups of functions, the best first.
    """

    gain: float
    standard_error: float
    left: float
    groups: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class FeatureRows:
    """Whitened rows of the groups of functions of the motion at every joint, (N, k) by name."""

    by_joint: tuple[dict[str, Array], ...]


def build_motion_rows(
    problem: Problem, whitening: Whitening, torque: Sequence[Array]
) -> FeatureRows:
    """Return the functions that do not depend on the model."""
    return FeatureRows(
        tuple(
            _whiten_features(problem, whitening, j, torque, _list_motion_features)
            for j in problem.joints
        )
    )


def _whiten_features(
    problem: Problem,
    whitening: Whitening,
    joint: int,
    torque: Sequence[Array],
    list_features: Callable[[Surroundings], Features],
) -> dict[str, Array]:
    """Return the whitened inner rows of groups of functions at a joint."""
    made = [
        list_features(_look_around(problem, s, joint, torque))
        for s in range(len(problem.rows.stretches))
    ]
    signals = [np.column_stack([x for group in own.values() for x in group]) for own in made]
    white = whitening.apply(problem.rows, problem.rows.project(signals, joint), joint)
    ends = np.cumsum([len(group) for group in made[0].values()])
    return dict(zip(made[0], np.split(white, ends[:-1], axis=1)))


def find_structure(
    problem: Problem,
    whitening: Whitening,
    fit: BlockFit,
    torque: Sequence[Array],
    motion: FeatureRows,
    joint: int,
    left: Array,
) -> Structure:
    """Return the best flexible model of a joint beside a model.

    Args:
        problem: The rows.
        whitening: Their whitening.
        fit: The model.
        torque: Its torque along each stretch, N m, (m, n).
        motion: Rows of the functions of the motion.
        joint: The joint.
        left: Its held-out unwhitened residual, (N,).
    """
    loads = _whiten_features(problem, whitening, joint, torque, _list_load_features)
    lines, costs = _find_lines(problem, whitening, fit, torque, joint, left)
    groups = {**motion.by_joint[joint], **loads, **lines}
    squared = max(float(fit.squared_errors[:, joint].sum()), 1e-300)

    def attempt(names: Sequence[str], ridges: Sequence[float]) -> Structure:
        columns = np.hstack([groups[name] for name in names])
        pack = pack_columns({joint: columns}, fit.folds)
        cost = sum(costs.get(name, 0.0) for name in names)
        tried = [
            Structure(
                float(gains.total[0]) - cost,
                float(compute_standard_error(gains.by_fold[0])),
                float(np.sqrt(gains.errors[0, :, joint].sum() / squared)),
                tuple(names),
            )
            for gains in (fit.measure(pack, ridge) for ridge in ridges)
        ]
        return max(tried, key=lambda one: one.gain)

    alone = sorted((attempt([name], [ALONE_RIDGE]) for name in groups), key=lambda one: -one.gain)
    tried = [*alone, attempt(alone[0].groups, OTHER_RIDGES)]
    for count in JOINED:
        if count <= len(alone) and alone[count - 1].gain > WORST_JOINED:
            names = [name for one in alone[:count] for name in one.groups]
            tried.append(attempt(names, JOINED_RIDGES))
    return max(tried, key=lambda one: one.gain)


def _find_lines(
    problem: Problem,
    whitening: Whitening,
    fit: BlockFit,
    torque: Sequence[Array],
    joint: int,
    left: Array,
) -> tuple[dict[str, Array], dict[str, float]]:
    """Return whitened lines over time, over time times load, and over load, with the cost of having searched them."""
    rows = problem.rows
    load = [x[:, joint] for x in torque]
    span = float(np.ptp(np.concatenate(load)))
    seconds = rows.seconds
    ones: list[Array] = [np.ones(len(x)) for x in load]
    start = float(rows.stretches[0].time[0])
    time = [part.time - start for part in rows.stretches]
    kinds: list[tuple[str, list[Array], list[Array], tuple[float, float], float]] = [
        ("lines in time", time, ones, (0.3, 0.95 * rows.band), seconds),
        ("lines times load", time, load, (0.3, 0.95 * rows.band), seconds),
    ]
    if span > 0:
        kinds.append(("lines over load", load, ones, (2 / span, 40 / span), span))
    lines = dict[str, Array]()
    costs = dict[str, float]()
    for name, over, times, (low, high), length in kinds:
        frequencies = np.arange(low, high, 0.4 / length)
        if not len(frequencies):
            continue
        at = _resample(problem, over)
        power = np.abs(_transform(left * _resample(problem, times), at, frequencies)) ** 2
        chosen = list[float]()
        for _ in range(LINES):
            k = int(np.argmax(power))
            chosen.append(float(frequencies[k]))
            power[np.abs(frequencies - frequencies[k]) < 1.5 / length] = 0
        signals = [
            np.column_stack(
                [w * wave(2 * np.pi * f * x) for f in chosen for wave in (np.cos, np.sin)]
            )
            for x, w in zip(over, times)
        ]
        white = whitening.apply(rows, rows.project(signals, joint), joint)
        cost = float(np.log(max(length * (high - low), 1.0)))
        pack = pack_columns({joint: white}, fit.folds, 2)
        clear = np.flatnonzero(fit.measure(pack).total - cost > LINE_GAIN)
        if len(clear):
            lines[name] = white[:, np.repeat(2 * clear, 2) + np.tile([0, 1], len(clear))]
            costs[name] = cost * len(clear)
    return lines, costs


def _resample(problem: Problem, signals: Sequence[Array]) -> Array:
    """Return signals (m,) per stretch at the times of the rows, (N,)."""
    pairs = zip(problem.rows.stretches, signals)
    return np.concatenate(
        [
            np.interp(np.arange(part.count) / part.count * len(x), np.arange(len(x)), x)
            for part, x in pairs
        ]
    )


def _transform(y: Array, at: Array, frequencies: Array) -> Array:
    """Return ``Σ y exp(2πi f x)`` at evenly spaced frequencies, by one rotation per frequency."""
    rotation = (
        np.exp(2j * np.pi * (frequencies[1] - frequencies[0]) * at) if len(frequencies) > 1 else 1.0
    )
    term = y * np.exp(2j * np.pi * frequencies[0] * at)
    out = np.empty(len(frequencies), complex)
    for k in range(len(frequencies)):
        out[k] = term.sum()
        term = term * rotation
    return out


@dataclass(frozen=True)
class Bursts:
    """Part of a joint's residual that stands in few moments.

    Attributes:
        size: Its rms, N m.
        share: The same over the residual's rms.
    """

    size: float
    share: float


def find_bursts(problem: Problem, torque: Sequence[Array], joint: int, left: Array) -> Bursts:
    """Return windows whose power noise does not have.

    A cross-validated regression of the log power on load, its rate, acceleration and rate tells what is usual.

    Args:
        problem: The rows.
        torque: A model's torque along each stretch, N m, (m, n).
        joint: The joint.
        left: Its held-out unwhitened residual, (N,).
    """
    rows = problem.rows
    width = max(3, round(BURST_SECONDS * 2 * rows.band))
    power = list[Array]()
    motion = list[Array]()
    first = 0
    for part, x in zip(rows.stretches, torque):
        length = part.count // width * width
        own = left[first : first + length].reshape(-1, width)
        kept = rows.inner[first : first + length].reshape(-1, width).all(axis=1)
        first += part.count
        opened = part.project(np.ones((len(part.time), 1)), joint)[:length, 0]
        share = opened.reshape(-1, width).mean(axis=1)
        kept &= share > 0.5
        edges = np.linspace(0, len(part.time) * length / part.count, length // width + 1).astype(
            int
        )
        channels = [
            x[:, joint],
            np.gradient(x[:, joint], part.dt),
            part.samples.v[:, joint],
        ]
        drive = [np.add.reduceat(y**2, edges[:-1]) / np.diff(edges) for y in channels]
        shaken = np.sum(part.samples.a**2, axis=1)
        drive.append(np.add.reduceat(shaken, edges[:-1]) / np.diff(edges))
        power.append((np.mean(own**2, axis=1) / np.maximum(share, 1e-3) ** 2)[kept])
        motion.append(np.array(drive).T[kept])
    observed = np.concatenate(power)
    if len(observed) <= FEWEST_WINDOWS:
        return Bursts(0.0, 0.0)
    usual = _expect_power(observed, np.concatenate(motion))
    excess = np.maximum(observed - problem.settings.burst_power * usual, 0.0)
    # One window alone may be the only one of its motion, of which nothing is known.
    excess[np.argmax(excess)] = 0.0
    size = float(np.sqrt(np.mean(excess)))
    return Bursts(size, size / max(float(np.sqrt(observed.mean())), 1e-300))


def _expect_power(observed: Array, motion: Array) -> Array:
    """Return the power that the motion lets expect of each window, held out in eighths."""
    scaled = np.log(motion + 1e-3 * motion.mean(axis=0) + 1e-300)
    scaled = scaled - scaled.mean(axis=0)
    columns = np.column_stack([np.ones(len(scaled)), scaled, scaled**2])
    y = np.log(observed + 1e-300)
    penalty = np.diag([0.0, *[3.0] * (columns.shape[1] - 1)])
    fold = np.arange(len(y)) * 8 // len(y)
    predicted = np.empty_like(y)
    for k in range(8):
        own = fold == k
        X = columns[~own]
        predicted[own] = columns[own] @ np.linalg.solve(X.T @ X + penalty, X.T @ y[~own])
    return np.asarray(np.exp(predicted + np.median(y - predicted)))
