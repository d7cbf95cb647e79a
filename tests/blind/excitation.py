"""References: multisines, chirps, speed staircases, smoothed random steps, small reversals, and mixtures of them; and
how people move a rig: one motion several times over, a joint that turns on and on, a joint that is held still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .draws import draw_sign, log_uniform
from .rigs import Array
from .rnea import inverse_dynamics

LONGEST_FADE = 3.0
"""Seconds in which the end of a motion goes over into its next beginning."""


@dataclass(frozen=True)
class Reference:
    """Wanted motion on the samples' grid: t (N,), q dq ddq (N, n), and a dither torque (N, n) that shakes on top."""

    t: Array
    q: Array
    dq: Array
    ddq: Array
    dither: Array

    def every(self, rows):
        """Some of its samples."""
        return Reference(*(values[rows] for values in vars(self).values()))


def ease(x, move=1.0):
    """From 0 to `move` with the least jerk, as x goes from 0 to 1."""
    return move * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


@dataclass(frozen=True)
class Habit:
    """`period`, `fade`: of a repeated motion, in samples (0: not repeated); `held`: joints that stand; `turning`: a
    joint that follows `path` (N,), rad."""

    held: tuple[int, ...] = ()
    period: int = 0
    fade: int = 0
    turning: int | None = None
    path: Array | None = None

    def fold(self, x):
        """The first period of x (N, n) again and again, its end faded into its beginning."""
        if not self.period:
            return x
        once = x[: self.period].copy()
        soft = ease(np.arange(self.fade)[:, None] / self.fade)
        after = x[self.period : self.period + self.fade]
        once[: self.fade] = soft * x[: self.fade] + (1.0 - soft) * after
        return once[np.arange(len(x)) % self.period]

    def motion(self, q):
        """Angles (N, n), rad, as this habit has them."""
        q = self.fold(q)
        q[:, self.held] = q[0, self.held]
        if self.turning is not None:
            q[:, self.turning] = self.path
        return q

    def torque(self, dither):
        """Torque on top (N, n), N m: repeated with the motion, none on joints that are held."""
        dither = self.fold(dither)
        dither[:, self.held] = 0.0
        return dither


def repeated(held, samples, repeats, rate):
    """A motion made `repeats` times within these samples, which it must divide."""
    period = samples // repeats if repeats > 1 else 0
    return Habit(held, period, min(period // 2, round(LONGEST_FADE * rate)))


def turning_path(rng, t, turns):
    """An angle (N,) that travels so many revolutions at a wandering speed, in every third log back again, rad."""
    hertz = log_uniform(rng, 0.03, 0.5, 4)
    wander = _waves(rng, t, hertz).mean(axis=1)
    speed = (1.0 + rng.uniform(0.05, 0.9) * wander) * np.clip(t / 0.5, 0.0, 1.0)
    if rng.random() < 1.0 / 3.0:
        speed *= np.clip((rng.uniform(0.4, 0.7) * t[-1] - t) / 0.5, -1.0, 1.0)
    speed *= draw_sign(rng) * 2.0 * np.pi * turns / np.abs(speed).sum()
    return np.cumsum(speed) + rng.uniform(-np.pi, np.pi)


def _waves(rng, t, hertz):
    """Sines of these frequencies and of random phase, (N, ...)."""
    angle = 2.0 * np.pi * hertz * t.reshape(-1, *[1] * hertz.ndim)
    return np.sin(angle + rng.uniform(-np.pi, np.pi, hertz.shape))


def multisine(rng, t):
    """Five to ten sines, 0.08–2.5 Hz, smaller as they get faster."""
    count = int(rng.integers(5, 11))
    hertz = log_uniform(rng, 0.08, 2.5, count)
    weight = hertz ** -rng.uniform(0.5, 1.1)
    return (weight * _waves(rng, t, hertz)).sum(axis=1) / weight.sum() * 1.6


def chirp(rng, t):
    """Sweeps up from 0.15 Hz to 4–8 Hz, one after the other, ever smaller on the way."""
    period = rng.uniform(8.0, 15.0)
    top = rng.uniform(4.0, 8.0)
    low = 0.15
    place = (t / period + rng.uniform()) % 1.0
    rate = np.log(top / low)
    hertz = low * np.exp(rate * place)
    phase = 2.0 * np.pi * period * (hertz - low) / rate
    fade = np.clip(8.0 * np.minimum(place, 1.0 - place), 0.0, 1.0)
    return np.sin(phase) * np.minimum(1.0, (0.3 / hertz) ** 1.3) * fade


def staircase(rng, t):
    """To and fro between the ends at constant speeds, each pass at another, slow ones and fast ones."""
    speeds = log_uniform(rng, 0.08, 2.5, 400)
    turns = np.concatenate([[0.0], np.cumsum(2.0 / speeds)]) - rng.uniform(0.0, 1.0)
    side = np.where(np.arange(len(turns)) % 2 == 0, -1.0, 1.0)
    return np.interp(t, turns, side)


def random_steps(rng, t):
    """Minimum-jerk moves of 0.3–1.2 s to random places, with rests between."""
    goals = rng.uniform(-1.0, 1.0, 400)
    moves = rng.uniform(0.3, 1.2, 400)
    rests = rng.uniform(0.05, 0.9, 400)
    starts = np.concatenate([[0.0], np.cumsum(moves + rests)[:-1]])
    row = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, 398)
    x = np.clip((t - starts[row]) / moves[row], 0.0, 1.0)
    return goals[row] + ease(x, goals[row + 1] - goals[row])


def reversals(rng, t):
    """Small triangles of changing size around places that change now and then."""
    size = np.interp(t, np.linspace(0.0, t[-1] + 1.0, 12), log_uniform(rng, 0.02, 0.2, 12))
    hertz = rng.uniform(0.4, 1.2)
    triangle = 4.0 * np.abs((hertz * t + 0.25) % 1.0 - 0.5) - 1.0
    return 0.8 * random_steps(rng, t / 6.0) + size * triangle


def _mixture(rng, t, own):
    """Two or three shapes one after the other, each faded into the next within half a second."""
    first, *others = rng.choice(list(SHAPES), int(rng.integers(2, 4)), replace=False)
    x = SHAPES[first](rng, own)
    for name, edge in zip(others, np.linspace(t[0], t[-1], len(others) + 2)[1:]):
        gate = np.clip((t - edge) / 0.5, 0.0, 1.0)
        soft = gate * gate * (3.0 - 2.0 * gate)
        x = (1.0 - soft) * x + soft * SHAPES[name](rng, own)
    return x


SHAPES = {
    "multisine": multisine,
    "chirp": chirp,
    "staircase": staircase,
    "random-steps": random_steps,
    "reversals": reversals,
}
EXCITATIONS = (*SHAPES, "mixture")


def _smooth(x, samples):
    """A weighted moving mean over `samples` to either side: corners become finite accelerations."""
    if samples < 2:
        return x
    window = np.hanning(2 * samples + 1)
    return np.convolve(np.pad(x, samples, mode="edge"), window / window.sum(), mode="valid")


def _angles(rig, kind, t, paces, seeds):
    """Angles of every joint at its pace; each joint draws from its own seed, so that only the pace changes them."""
    columns = []
    for link, seed, pace in zip(rig.links, seeds, paces):
        child = np.random.default_rng(seed)
        reach = 0.5 * (link.upper - link.lower) * child.uniform(0.45, 0.85)
        centre = 0.5 * (link.upper + link.lower) + 0.1 * child.uniform(-1.0, 1.0) * reach
        own = pace * child.uniform(0.8, 1.25) * t
        x = _mixture(child, t, own) if kind == "mixture" else SHAPES[kind](child, own)
        columns.append(centre + reach * _smooth(x, round(0.08 / pace**0.5 / float(t[1] - t[0]))))
    return np.stack(columns, axis=1)


def _derivatives(q, period):
    """First and second derivative of samples."""
    dq = np.gradient(q, period, axis=0)
    return dq, np.gradient(dq, period, axis=0)


def load(rig, q, period):
    """How much of its limits each joint's motion takes: the larger of torque over limit and speed over limit, (n,)."""
    dq, ddq = _derivatives(q, period)
    few = slice(None, None, max(1, round(0.01 / period)))
    rigid = np.abs(inverse_dynamics(rig, q[few], dq[few], ddq[few]))
    tau = rigid + rig.coulomb + rig.viscous * np.abs(dq[few])
    speed = np.abs(dq).max(axis=0)
    return np.maximum(np.quantile(tau, 0.999, axis=0) / rig.tau_max, speed / rig.velocity_limit)


def draw_reference(rng, rig, kind, seconds, rate, habit):
    """The fastest motion of this kind that takes no more than a drawn share (40–70 %) of each joint's limits."""
    joints = len(rig.links)
    t = np.arange(round(seconds * rate)) / rate
    seeds = rng.integers(2**31, size=joints).tolist()
    wanted = rng.uniform(0.4, 0.7, joints)
    slow = np.full(joints, 0.1)
    fast = np.full(joints, 3.0)
    for _ in range(9):
        paces = np.sqrt(slow * fast)
        easy = load(rig, habit.motion(_angles(rig, kind, t, paces, seeds)), 1.0 / rate) < wanted
        slow = np.where(easy, paces, slow)
        fast = np.where(easy, fast, paces)
    q = habit.motion(_angles(rig, kind, t, slow, seeds))
    dq, ddq = _derivatives(q, 1.0 / rate)
    shaken = rng.random() < 0.4
    torque = inverse_dynamics(rig, q[::10], dq[::10], ddq[::10]).std(axis=0) + rig.coulomb
    size = torque * rng.uniform(0.02, 0.08) if shaken else np.zeros_like(torque)
    hertz = log_uniform(rng, 8.0, 45.0, (joints, 4))
    dither = size * _waves(rng, t, hertz).sum(axis=2) / 2.0**0.5
    return Reference(t, q, dq, ddq, habit.torque(dither))
