"""Descent inside limits: a primal-dual interior-point method with a quasi-Newton Hessian, for few unknowns.

SciPy's methods with the same exact derivatives were tried in its place. SLSQP in the same search (three seeds, `thesis`
and `handheld`) takes 1.3-2.0 times its time for condition numbers 0.98-1.07 times its own; trust-constr takes 28 s for
a descent of 0.14 s.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

import numpy as np

from gimbal_pin.log.log import Array

FIRST_GAP, LAST_GAP, SHRINK = 6.0, 0.002, 0.65
"""Barrier's weight, all limits together, at first, at last, and from step to step; in units of ``|f'| |x|``. It starts
high: far inside the limits a criterion has fewer poor minima."""
CURVATURE = 0.02
"""Curvature that is assumed at first, in units of ``|f'| / |x|``; low, for steps that the limits make short."""
TO_THE_WALL = 0.95
"""Share of the way to the nearest limit that a step may go."""
DESCENT, BACK, TRIALS = 1e-4, 0.4, 8
"""Armijo's share, shortening of a step that does not descend, and how often."""
SPREAD = 1e3
"""Factor by which a multiplier may be off the one that the barrier gives (Wächter and Biegler 2006, eq. 16)."""
PATIENCE = 2
"""Steps in a row that gain too little."""


class Program(Protocol):
    """Minimise a value of x subject to ``room(x) >= 0``."""

    def at(self, x: Array) -> tuple[float, Callable[[], Array]]:
        """Return the value, and what returns its gradient (k,)."""

    def room(self, x: Array) -> Array:
        """Return what is left of every limit (m,)."""

    def room_slopes(self, x: Array) -> Array:
        """Return its Jacobian (m, k), the same array where it is the same."""


class Point(NamedTuple):
    """An iterate: x, value, gradient, room and its Jacobian."""

    x: Array
    f: float
    g: Array
    s: Array
    A: Array


def descent(program: Program, start: Array, tolerance: float) -> Iterator[Point]:
    """Yield ever better points, all strictly within the limits, from a start that is; ends where it gains too little.

    ``(B + A' Z/S A) dx = -f' + mu A'/s`` with multipliers z, s = room(x), B from damped BFGS, and mu shrinking from
    step to step (Nocedal and Wright 2006, ch. 19; feasible throughout, so that it can be stopped anywhere).

    Args:
        program: What is to be minimised.
        start: x with ``room(x) > 0``, (k,).
        tolerance: Gain of a step that is too little.
    """
    f, gradient = program.at(start)
    at = Point(start, f, gradient(), program.room(start), program.room_slopes(start))
    size = float(np.linalg.norm(at.g) * np.linalg.norm(start))
    mu, last = FIRST_GAP * size / len(at.s), LAST_GAP * size / len(at.s)
    z: Array = mu / at.s
    B: Array = CURVATURE * size / float(start @ start) * np.eye(len(start))
    idle = 0
    while idle < PATIENCE:
        walls = np.sqrt(z / at.s)[:, None] * at.A
        down = at.A.T @ (mu / at.s) - at.g
        dx = np.linalg.solve(B + walls.T @ walls, down)
        along = at.A @ dx
        new = stepped(program, at, dx, mu, -float(down @ dx), reach(at.s, along))
        if new is None:
            return
        dz = mu / at.s - z - z / at.s * along
        z = np.clip(z + reach(z, dz) * dz, mu / at.s / SPREAD, mu / at.s * SPREAD)
        bend = 0.0 if new.A is at.A else (new.A - at.A).T @ z
        B = updated(B, new.x - at.x, new.g - at.g - bend)
        idle = idle + 1 if mu == last and at.f - new.f < tolerance else 0
        mu, at = max(last, SHRINK * mu), new
        yield at


def reach(values: Array, change: Array) -> float:
    """Largest share of a change, at most all of it, that keeps positive values positive."""
    return 1.0 / max(1.0, float(np.max(-change / values)) / TO_THE_WALL)


def stepped(program: Program, at: Point, dx: Array, mu: float, slope: float, share: float) -> Point | None:
    """Return the point after as much of a step as ``f - mu sum log(room)`` descends by, or None.

    Args:
        program: What is to be minimised.
        at: Where the step begins.
        dx: The step.
        mu: Weight of the barrier.
        slope: What the sum's derivative is along the step.
        share: Most of the step that may be tried.
    """
    for _ in range(TRIALS):
        x = at.x + share * dx
        s = program.room(x)
        if s.min() > 0:
            f, gradient = program.at(x)
            if f - at.f - mu * float(np.sum(np.log(s / at.s))) <= DESCENT * share * slope:
                return Point(x, f, gradient(), s, program.room_slopes(x))
        share *= BACK
    return None


def updated(B: Array, step: Array, change: Array) -> Array:
    """Return the BFGS update of B, damped so that it stays positive definite (Powell 1978)."""
    along = B @ step
    curvature, seen = float(step @ along), float(step @ change)
    if seen < 0.2 * curvature:
        share = 0.8 * curvature / (curvature - seen)
        change = share * change + (1 - share) * along
    return B - np.outer(along, along) / curvature + np.outer(change, change) / float(step @ change)
