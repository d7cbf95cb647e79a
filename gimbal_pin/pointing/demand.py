"""What a platform's motion asks of the motors: where no controller holds the camera, and loops that ask for more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import degrees, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from gimbal_pin.control.laws.uncertainty import inertia
from gimbal_pin.dynamics.model import Model
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.result import SETTLING, Contest, Pointing, Swing, split
from gimbal_pin.pointing.sight import Sight, holding

BEFORE, AFTER = 0.1, 0.6
"""Around a moment at which a motor is too weak, what is not counted either, s: the loop has to find back."""
READY = 0.3
"""How long before such a moment a controller that foresees it may begin to make ready, s."""
RATE = 250.0
"""Samples of a motion that are looked at, Hz."""


@dataclass(frozen=True, eq=False)
class Demand:
    """Torque that holds the camera exactly along a motion, beside what the motors give.

    Attributes:
        joints: Joint names.
        t: Time, s, (N,).
        tau: Torque, N m, (N, n).
        tau_max: Largest torque of each motor, N m, (n,).
        answer: Angular acceleration of the line of sight per torque of each joint, 1/(kg m²), (N, n).
    """

    joints: tuple[str, ...]
    t: Array
    tau: Array
    tau_max: Array
    answer: Array

    @staticmethod
    def of(plant: Model, wanted: Array, platform: Platform) -> Demand:
        """Return it for a plant whose camera looks as wanted, (3, 3): inverse dynamics of the exact motion."""
        step = max(1, round(1 / RATE / float(platform.t[1] - platform.t[0])))
        part, rig = platform.part(slice(None, None, step)), plant.rig
        sight = Sight(rig)
        held = holding(sight, wanted, part)
        across = np.array([np.linalg.norm(sight.view(q).J[-2:], axis=0) for q in held.q])
        own = np.diagonal(inertia(plant, held.q), axis1=1, axis2=2)
        tau = plant.inverse(held.q, held.v, held.a, platform=part)
        return Demand(rig.joints, part.t, tau, rig.tau_max, across / own)

    @property
    def peak(self) -> Mapping[str, float]:
        """Joint → largest torque, N m."""
        return dict(zip(self.joints, np.abs(self.tau).max(axis=0).tolist()))

    @property
    def weak(self) -> tuple[str, ...]:
        """Joints whose motors give less than that."""
        limits = zip(self.peak.items(), self.tau_max.tolist())
        return tuple(joint for (joint, peak), limit in limits if peak > limit)

    @property
    def moments(self) -> tuple[tuple[float, float], ...]:
        """First and last time of every moment at which a motor is too weak, s; those `AFTER` s apart are one."""
        times = self.t[(np.abs(self.tau) > self.tau_max).any(axis=1)]
        parts = np.split(times, np.flatnonzero(np.diff(times) > AFTER) + 1) if len(times) else []
        return tuple((float(part[0]), float(part[-1])) for part in parts)

    @cached_property
    def least(self) -> Mapping[str, float]:
        """Jitter that the torque limits alone leave, rad rms, "unforeseen" and "foreseen"; nan where it takes too long.

        A controller that does not foresee the motion does nothing before a moment begins; one that does makes ready.
        """
        counts = self.t >= self.t[0] + SETTLING
        out = {}
        for name in ("unforeseen", "foreseen"):
            parts = [self.left(rows, j, name == "foreseen") for rows, j in self.stretches]
            power = sum([float(np.sum(part[counts[rows]] ** 2)) for part, (rows, _) in zip(parts, self.stretches)])
            out[name] = float(np.sqrt(power / max(1, int(counts.sum()))))
        return out

    @property
    def stretches(self) -> list[tuple[slice, int]]:
        """Samples around every moment, and the joint whose motor is too weak in it."""
        edges = [(np.searchsorted(self.t, [first - READY, last + AFTER])).tolist() for first, last in self.moments]
        beyond = np.abs(self.tau) > self.tau_max
        return [(slice(a, b), j) for a, b in edges for j in np.flatnonzero(beyond[a:b].any(axis=0)).tolist()]

    def left(self, rows: slice, j: int, foreseen: bool) -> Array:
        """Least error of the line of sight over some samples by a joint's weak motor, rad."""
        asked, limit = self.tau[rows, j], float(self.tau_max[j])
        if len(asked) > LONGEST_STRETCH:
            return np.full(len(asked), np.nan)
        known = 0 if foreseen else int(np.argmax(np.abs(asked) > limit))
        return least(float(self.t[1] - self.t[0]), asked, limit, self.answer[rows, j], known)

    def within(self, t: Array) -> NDArray[np.bool_]:
        """Whether the motors are strong enough at each of the times t, s, and were so just before."""
        fine = np.ones(len(t), dtype=bool)
        for first, last in self.moments:
            fine &= (t < first - BEFORE) | (t > last + AFTER)
        return fine

    def jitter(self, run: Pointing) -> float:
        """Jitter of a run where the motors are strong enough, rad rms; nan where they never are."""
        fast, _ = split(run.sight, run.dt)
        power = np.sum(fast**2, axis=1)[self.within(run.t[run.counted])]
        return float(np.sqrt(power.mean())) if len(power) else float("nan")

    def apart(self, contest: Contest) -> Mapping[str, float]:
        """Controller → its jitter where the motors are strong enough, over all its runs, rad rms."""
        return {
            row.controller: float(np.sqrt(np.mean([self.jitter(run) ** 2 for run in row.runs]))) for row in contest.rows
        }

    def to_dict(self, contest: Contest) -> dict[str, Any]:
        """Return what JSON holds; null for the jitter of a run in which the motors never suffice."""
        still = self.apart(contest)
        return {
            "peak": dict(self.peak),
            "tau_max": dict(zip(self.joints, self.tau_max.tolist())),
            "beyond": [list(moment) for moment in self.moments],
            "jitter_rms_deg_within": {name: None if isnan(x) else degrees(x) for name, x in still.items()},
            "least_jitter_rms_deg": {name: None if isnan(x) else degrees(x) for name, x in self.least.items()},
        }


LONGEST_STRETCH = 600
"""Samples of the longest stretch that is worked out, in about a second."""


def least(dt: float, asked: Array, limit: float, answer: Array, first: int) -> Array:
    """``min Σ e²`` over all torques within the limit, ``ë = b (τ - τ_d)``: a bounded least-squares problem.

    No law of any kind gets below it, unless other joints turn the camera in this one's stead, which tilts the horizon:
    each of them is granted all the torque that it takes to stay.

    Args:
        dt: Sampling interval, s.
        asked: τ_d, torque that follows the motion exactly, N m, (N,).
        limit: Largest torque, N m.
        answer: b, acceleration of what is to be kept still, per torque, 1/(kg m²), (N,).
        first: Sample before which nothing is foreseen, so that e is zero until then; 0: the whole motion is known.

    Returns:
        The error at the end of every interval, rad, (N,).
    """
    from scipy.optimize import lsq_linear

    n = len(asked)
    summed = np.tril(np.ones((n, n)))
    # Torque that may not act before `first` is no unknown of the problem.
    moved = (dt**2 * (summed @ summed - summed / 2) * answer)[:, first:]
    bounds = -limit - asked[first:], limit - asked[first:]
    found = lsq_linear(moved, np.zeros(n), bounds, tol=1e-12)
    return np.asarray(moved @ found.x)


BAND = (2.0, 60.0)
"""Frequencies at which a loop is looked for that swings, Hz: below are motions, above the propellers."""
LINE = 0.1
"""Half width of a line, in shares of its frequency."""
SMALLEST = 0.05
"""A line of less torque, rms in torque limits, is none."""
BEYOND = 9.0
"""Power beyond that which the motion asks for: a loop of disk margin 0.5 has less than five times as much."""
LONGEST = 2.0
"""Length of the stretches whose spectra are averaged, s; a run of fewer than two is looked at as one."""


def swinging(plant: Model, wanted: Array, platform: Platform, run: Pointing) -> tuple[Swing, ...]:
    """Return the joints that swing by themselves in the second half of a run, the one that swings most first.

    What the motion asks for is inverse dynamics of the camera standing still; a stable loop gives that, times its
    complementary sensitivity. Moments at which a motor is too weak for it are not looked at.

    Args:
        plant: The plant.
        wanted: The camera's attitude in the world, (3, 3).
        platform: What carried it.
        run: What the camera did.
    """
    half = slice((run.counted.start + len(run.t)) // 2, None)
    step = max(1, round(1 / RATE / run.dt))
    rows = len(run.t[half]) // step
    whole = np.column_stack([run.t[half], run.tau[half] / run.tau_max])[: rows * step]
    t, *shares = whole.reshape(rows, step, -1).mean(axis=1).T
    if len(t) < 8 or not any(lines(x, t)[1].max(initial=0.0) > SMALLEST**2 for x in shares):
        return ()
    asked = Demand.of(plant, wanted, platform.at(t))
    fine, found = asked.within(t), []
    for joint, own, torque, limit in zip(run.joints, shares, asked.tau.T, run.tau_max):
        (f, power), (_, known) = lines(fine * own, t), lines(fine * torque / limit, t)
        # Of the lines of at least half the power of the loudest one, that which exceeds the motion's most.
        beyond = np.where(power >= power.max(initial=0.0) / 2, power / np.maximum(known, 1e-12), 0.0)
        k = int(np.argmax(beyond)) if len(f) else 0
        if len(f) and power[k] > SMALLEST**2 and beyond[k] > BEYOND:
            found.append(Swing(joint, float(f[k]), float(np.sqrt(power[k]))))
    return tuple(sorted(found, key=lambda swing: -swing.share))


def lines(x: Array, t: Array) -> tuple[Array, Array]:
    """Frequencies within `BAND`, Hz, and the power of a line at each of them, (K,)."""
    rate = 1 / float(t[1] - t[0])
    f, density = welch(x - x.mean(), rate, nperseg=min(len(x), round(LONGEST * rate)))
    total = np.concatenate([[0.0], np.cumsum(density * (f[1] - f[0]))])
    wide = np.maximum(LINE * f, 1.5 * f[1])  # a window smears a line over three bins at least
    low, high = np.searchsorted(f, f - wide, "left"), np.searchsorted(f, f + wide, "right")
    inside = (f >= BAND[0]) & (f <= BAND[1])
    return f[inside], (total[high] - total[low])[inside]
