"""References: multisines, chirps, speed staircases, smoothed random steps, small reversals, and mixtures of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .draws import log_uniform
from .habits import Habit
from .rigs import Array
from .rnea import inverse_dynamics


@dataclass(frozen=True)
class Reference:
    """Wanted motion on the samples' grid: t (N,), q dq ddq (N, n), and a dither torque (N, n) that shakes on top."""

    t: Array
    q: Array
    dq: Array
    ddq: Array
    dither: Array

    def first(self, samples):
        """Its first samples."""
        return Reference(
            *(values[:samples] for values in (self.t, self.q, self.dq, self.ddq, self.dither))
        )


def multisine(rng, t):
    """Five to ten sines, 0.08–2.5 Hz, smaller as they get faster."""
    count = int(rng.integers(5, 11))
    hertz = log_uniform(rng, 0.08, 2.5, count)
    weight = hertz ** -rng.uniform(0.5, 1.1)
    x = (weight * np.sin(2.0 * np.pi * hertz * t[:, None] + rng.uniform(-np.pi, np.pi, count))).sum(
        axis=1
    )
    return x / weight.sum() * 1.6


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
    return goals[row] + (goals[row + 1] - goals[row]) * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def reversals(rng, t):
    """Small triangles of changing size around places that change now and then."""
    size = np.interp(t, np.linspace(0.0, t[-1] + 1.0, 12), log_uniform(rng, 0.02, 0.2, 12))
    hertz = rng.uniform(0.4, 1.2)
    triangle = 4.0 * np.abs((hertz * t + 0.25) % 1.0 - 0.5) - 1.0
    return 0.8 * random_steps(rng, t / 6.0) + size * triangle


SHAPES = {
    "multisine": multisine,
    "chirp": chirp,
    "staircase": staircase,
    "random-steps": random_steps,
    "reversals": reversals,
}
EXCITATIONS = (*SHAPES, "mixture")


def _smooth(x, samples):
    """Twice a moving mean over `samples`: corners become finite accelerations."""
    if samples < 2:
        return x
    window = np.hanning(2 * samples + 1)
    padded = np.pad(x, samples, mode="edge")
    return np.convolve(padded, window / window.sum(), mode="valid")


def _mixture(rng, t, own):
    """Two or three shapes one after the other, each faded into the next within half a second."""
    names = rng.choice(list(SHAPES), int(rng.integers(2, 4)), replace=False)
    edges = np.linspace(t[0], t[-1], len(names) + 1)
    rise = [
        np.clip((t - edge) / 0.5, 0.0, 1.0) if i else np.ones_like(t)
        for i, edge in enumerate(edges[:-1])
    ]
    x = np.zeros_like(t)
    for name, gate in zip(names, rise, strict=True):
        soft = gate * gate * (3.0 - 2.0 * gate)
        x = (1.0 - soft) * x + soft * SHAPES[name](rng, own)
    return x


def _angles(rig, kind, t, paces, seeds):
    """Angles of every joint at its pace; each joint draws from its own seed, so that only the pace changes them."""
    period = float(t[1] - t[0])
    columns = []
    for link, seed, pace in zip(rig.links, seeds, paces, strict=True):
        child = np.random.default_rng(seed)
        reach = 0.5 * (link.upper - link.lower) * child.uniform(0.45, 0.85)
        centre = 0.5 * (link.upper + link.lower) + 0.1 * child.uniform(-1.0, 1.0) * reach
        own = pace * child.uniform(0.8, 1.25) * t
        x = _mixture(child, t, own) if kind == "mixture" else SHAPES[kind](child, own)
        columns.append(centre + reach * _smooth(x, round(0.08 / pace**0.5 / period)))
    return np.stack(columns, axis=1)


def _derivatives(q, period):
    dq = np.gradient(q, period, axis=0)
    return dq, np.gradient(dq, period, axis=0)


def load(rig, q, period):
    """How much of its limits each joint's motion takes: the larger of torque over limit and speed over limit, (n,)."""
    dq, ddq = _derivatives(q, period)
    few = slice(None, None, max(1, round(0.01 / period)))
    tau = (
        np.abs(inverse_dynamics(rig, q[few], dq[few], ddq[few]))
        + rig.coulomb
        + rig.viscous * np.abs(dq[few])
    )
    limits = np.array([motor.tau_max for motor in rig.motors])
    return np.maximum(
        np.quantile(tau, 0.999, axis=0) / limits, np.abs(dq).max(axis=0) / rig.velocity_limit
    )


def _dither(rng, t, size):
    """Four sines of torque per joint between 8 and 45 Hz."""
    hertz = log_uniform(rng, 8.0, 45.0, (len(size), 4))
    wave = np.sin(
        2.0 * np.pi * hertz * t[:, None, None] + rng.uniform(-np.pi, np.pi, (len(size), 4))
    )
    return size * wave.sum(axis=2) / 2.0**0.5


def draw_reference(
    rng,
    rig,
    kind,
    seconds,
    rate,
    habit=None,
):
    """The fastest motion of this kind that takes no more than a drawn share (40–70 %) of each joint's limits."""
    habit = habit or Habit()
    t = np.arange(round(seconds * rate)) / rate
    seeds = rng.integers(2**31, size=len(rig.links)).tolist()
    wanted = rng.uniform(0.4, 0.7, len(rig.links))
    slow = np.full(len(rig.links), 0.1)
    fast = np.full(len(rig.links), 3.0)
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
    return Reference(t, q, dq, ddq, habit.torque(_dither(rng, t, size)))
