"""Excitation: the motion that teaches most about a rig within its limits (THESIS 4.4.2-4.4.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tqdm import tqdm

from gimbal_pin.effects import Effect
from gimbal_pin.errors import UsageError
from gimbal_pin.excitation.columns import Columns, condition_number
from gimbal_pin.excitation.criteria import Criterion, Sequential, named
from gimbal_pin.excitation.fourier import Series
from gimbal_pin.excitation.limits import QUANTITIES, Envelope
from gimbal_pin.excitation.problem import Problem
from gimbal_pin.log import Array, Motion
from gimbal_pin.model import Model, nominal
from gimbal_pin.rig import Rig

TOLERANCE = 3e-4
"""Change of the criterion at which the optimiser stops; the log of a condition number need not be known better."""

HEATS, BRIEF, FULL = 3, 10, 150
"""Random motions for every start; the optimiser's iterations on each of them, and on those that are followed up."""

COARSE, FINE = 12, 24
"""Samples per period of the highest harmonic: from the random motions, and from changes of the best."""

KICK = 0.15
"""Random change of the best motion's coefficients before it is optimised again, as a share of their mean size."""
SHORTEST = 0.5
"""Shortest motion, s."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """A motion that starts and ends at rest, repeats every `seconds`, and keeps to the rig's limits.

    Attributes:
        rig: The rig's name.
        joints: Joint names (n).
        motion: The motion, one period, both ends included.
        series: The Fourier series.
        coefficients: Its coefficients (2 L + 1, n): q0 rad, a_l and b_l rad/s.
        criterion: Name of what was minimised.
        value: Its value.
        condition_number: Of the columns in unit torque (see `condition_number`).
        limits_used: Joint → q, dq, ddq, tau → the largest share of the limit that is used; 0 where there is none.
        finished: False if it was interrupted; it is then the best found until that moment.
        narrowed: Standard deviations of base parameters and friction with this motion over those of the earlier logs
            alone, (p,); None where no earlier logs were given.
    """

    rig: str
    joints: tuple[str, ...]
    motion: Motion
    series: Series
    coefficients: Array
    criterion: str
    value: float
    condition_number: float
    limits_used: Mapping[str, Mapping[str, float]]
    finished: bool = True
    narrowed: Array | None = None

    @property
    def seconds(self) -> float:
        """Length of one period, s."""
        return self.series.seconds

    def to_dict(self) -> dict[str, Any]:
        """The result as `gimbal-pin excite --json` writes it (CONTRACT)."""
        return {
            "schema": 1,
            "rig": self.rig,
            "criterion": self.criterion,
            "value": self.value,
            "condition_number": self.condition_number,
            "seconds": self.seconds,
            "harmonics": self.series.harmonics,
            "finished": self.finished,
            "narrowed": None if self.narrowed is None else self.narrowed.tolist(),
            "limits_used": {joint: dict(shares) for joint, shares in self.limits_used.items()},
        }


def excite(
    rig: Rig,
    *,
    seconds: float = 10.0,
    harmonics: int = 5,
    starts: int = 5,
    rng: np.random.Generator,
    criterion: str | Criterion = "condition",
    effects: Sequence[Effect] = (),
    margin: float = 0.05,
    torque_model: Model | None = None,
    dt: float = 1e-3,
) -> Excitation:
    """Design the finite Fourier series that shows a rig's base parameters and friction best, within its limits.

    SLSQP with exact gradients: briefly from a few random motions for each of the `starts`, then to the end from as
    many of the best as there are starts, then on a finer grid from as many random changes of the best. Limits are
    kept on the optimisation's grid, and checked on one ten times denser; amplitudes are scaled down until they hold
    there. Interrupted (Ctrl-C), it returns the best so far.

    Args:
        rig: The rig and its limits. A revolute joint without angle limits is moved by at most half a turn either
            way; rate, acceleration and torque are free where the rig states no limit.
        seconds: Length, s.
        harmonics: Harmonics of 1/seconds, two or more.
        starts: How many of the motions tried are followed up, one or more.
        rng: Source of the starts.
        criterion: "condition", "determinant", or a criterion of your own.
        effects: Effects to be shown on top of Coulomb and viscous friction.
        margin: Share of every limit that is left free.
        torque_model: Model that the torque limits are checked with; None: the rig's nominal model.
        dt: Sampling interval of the returned motion, s; the period is a whole number of it.

    Returns:
        The motion, its condition number, and what it uses of the limits.

    Raises:
        UsageError: An argument is out of range, or the rig cannot move within its limits.
    """
    if not seconds >= SHORTEST:
        raise UsageError("seconds", f"is {seconds:g}", f"give at least {SHORTEST:g}: no rig shows itself in less")
    samples = round(seconds / dt) if dt > 0 else 0
    if samples < 1 or abs(samples * dt - seconds) > 1e-9 * seconds:
        raise UsageError("dt", f"is {dt:g}", f"give an interval of which {seconds:g} s is a whole number")
    if starts < 1:
        raise UsageError("starts", f"is {starts}", "give one or more")
    model = nominal(rig) if torque_model is None else torque_model
    problem = Problem(
        model, Series(seconds, harmonics), Columns.of(rig, effects), named(criterion), Envelope.of(rig, margin), COARSE
    )
    x, finished = optimised(problem, starts, rng)
    motion = problem.series.motion(problem.coefficients(x), np.linspace(0.0, seconds, samples + 1))
    return described(problem, x, motion, finished)


def described(problem: Problem, x: Array, motion: Motion, finished: bool) -> Excitation:
    """Return x as an `Excitation`, its figures from the dense grid."""
    rig = problem.columns.rig
    dense = problem.motion(x, problem.dense)
    shares = Envelope.of(rig).shares(problem.model, dense)
    return Excitation(
        rig=rig.name,
        joints=rig.joints,
        motion=motion,
        series=problem.series,
        coefficients=problem.coefficients(x),
        criterion=problem.criterion.name,
        value=problem.objective(x),
        condition_number=condition_number(rig, dense, problem.columns.effects[2 * rig.n :]),
        limits_used={joint: dict(zip(QUANTITIES, column.tolist())) for joint, column in zip(rig.joints, shares.T)},
        finished=finished,
        narrowed=narrowed(problem, dense),
    )


def narrowed(problem: Problem, dense: Motion) -> Array | None:
    """How much the motion narrows what earlier logs left open, where there are any."""
    if not isinstance(problem.criterion, Sequential):
        return None
    return problem.criterion.narrowed(problem.columns.unit(dense, np.sign(dense.v)))


def optimised(problem: Problem, starts: int, rng: np.random.Generator) -> tuple[Array, bool]:
    """Return the best motion found, and whether the search came to its end."""
    found = [problem.start(rng)]
    bar = tqdm(
        searches(problem, starts, rng, found),
        total=(HEATS + 2) * starts,
        desc="excitation",
        unit="search",
        disable=None,
        leave=False,
    )
    finished = True
    try:
        for at, first, iterations in bar:
            x, finished = descended(at, first, iterations)
            repaired = problem.repaired(x)
            if repaired is not None:
                found.append(repaired)
            if not finished:
                break
    except KeyboardInterrupt:
        finished = False
    return min(found, key=replace(problem, per_period=FINE).objective), finished


def searches(
    problem: Problem, starts: int, rng: np.random.Generator, found: list[Array]
) -> Iterator[tuple[Problem, Array, int]]:
    """Yield what to descend on, from where, and for how many iterations; `found` grows meanwhile.

    A heat of random motions, the best `starts` of them to the end, then as many random changes of the best.
    """
    for _ in range(HEATS * starts):
        yield problem, problem.start(rng), BRIEF
    for x in sorted(found, key=problem.objective)[:starts]:
        yield problem, x, FULL
    fine = replace(problem, per_period=FINE)
    for _ in range(starts):
        best = min(found, key=fine.objective)
        yield fine, best + KICK * np.mean(np.abs(best)) * rng.standard_normal(len(best)), FULL


def descended(problem: Problem, x: Array, iterations: int) -> tuple[Array, bool]:
    """Return what SLSQP makes of x, or where it was when it was interrupted, and whether it was not."""
    from scipy.optimize import minimize

    path = [x]
    room = {"type": "ineq", "fun": problem.room, "jac": problem.room_slopes}
    options = {"maxiter": iterations, "ftol": TOLERANCE}
    try:
        minimize(
            problem.objective,
            x,
            jac=problem.gradient,
            method="SLSQP",
            constraints=[room],
            options=options,
            callback=lambda at: path.append(at.copy()),
        )
    except KeyboardInterrupt:
        return path[-1], False
    return path[-1], True
