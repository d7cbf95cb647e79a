"""Excitation: the motion that teaches most about a rig within its limits (thesis 4.4.2-4.4.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, isinf
from typing import Any, ClassVar

import numpy as np
from tqdm import trange

from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.regressor import compute_gravity, compute_rnea
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import Effect
from gimbal_pin.errors import UsageError
from gimbal_pin.excitation.clearance import Clearance, Gap
from gimbal_pin.excitation.columns import ExcitationColumns
from gimbal_pin.excitation.criteria import Criterion, find_criterion
from gimbal_pin.excitation.fourier import Series
from gimbal_pin.excitation.limits import QUANTITIES, AssumedLimit, Envelope, assume_limits
from gimbal_pin.excitation.problem import ExcitationProblem
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator

CLEARANCE = 0.005
"""Distance that parts keep which can hit each other, m."""
FIRST_SHARE = 0.1
"""Amplitude of a first motion as a share of the full one's, and share of each torque limit that it takes beyond gravity
and friction at most: a wrong sign then pushes with a tenth of the motor, for a tenth of the way."""


@dataclass(frozen=True, eq=False)
class Excitation(Record):
    """A motion that starts and ends at rest, can be repeated, and keeps to the rig's limits.

    Attributes:
        rig: The rig.
        motion: The motion, both ends included.
        series: The Fourier series; a long motion holds a whole number of its periods.
        coefficients: Its coefficients (2 L + 1, n): q0 rad, a_l and b_l rad/s.
        criterion: Name of what was minimised.
        value: Its value.
        condition_number: Of the columns in unit torque (`ExcitationColumns.compute_condition_number`).
        limits_used: Joint → q, dq, ddq, tau → the largest share of the limit that is used; 0 where there is none.
        finished: False if it was interrupted; it is then the best found until that moment.
        speed: Joint → its rms rate, rad/s.
        clearance: The smallest distance between parts that can hit each other; None: there are none.
        unchecked: Links that are not checked, as their collision mesh is missing.
        seed: Repeats it as `rng`; None where a generator was given.
        assumed: Limits that nobody states, and that it keeps to all the same.
    """

    rig: Rig
    motion: Motion
    series: Series
    coefficients: Array
    criterion: str
    value: float
    condition_number: float
    limits_used: Mapping[str, Mapping[str, float]]
    speed: Mapping[str, float]
    finished: bool = True
    clearance: Gap | None = None
    unchecked: tuple[str, ...] = ()
    seed: int | None = None
    assumed: tuple[AssumedLimit, ...] = ()

    ROWS: ClassVar[str] = "limits_used"
    __repr__ = brief

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names (n)."""
        return self.rig.joints

    @property
    def seconds(self) -> float:
        """Length of the motion, s."""
        return float(self.motion.t[-1])

    def __str__(self) -> str:
        """One line: condition number and length; its page has what it uses of the limits."""
        return f"excitation of {self.rig.name}: condition number {self.condition_number:.1f} in {self.length}"

    def sample(self, rate: float | None) -> Motion:
        """Return the motion at so many samples per second; None: as it is."""
        if rate is None:
            return self.motion
        return self.series.motion(
            self.coefficients, np.arange(0.0, self.seconds * (1 + 1e-12), 1 / rate)
        )

    @property
    def periods(self) -> int:
        """How often the series is repeated."""
        return round(self.seconds / self.series.seconds)

    @property
    def length(self) -> str:
        """Its length and what it is made of, in words."""
        own = f"{self.series.harmonics} harmonics"
        times = self.periods
        return f"{self.seconds:g} s, {own}" + (
            f" of {self.series.seconds:.4g} s, {times} times over" * (times > 1)
        )

    @property
    def repeated(self) -> str:
        """What its periods are for."""
        if self.periods > 3:  # the first is the start's, and two tell no noise
            what = "what differs from one to the next is noise, and what all of them show is not"
            return (
                f"{self.periods} periods: {what}; record them in one go, the first is the start's"
            )
        return f"too few repeats to tell noise from what a model misses ({self.periods}): --seconds 25 has five"

    def to_dict(self) -> dict[str, Any]:
        """The result as `gimbal-pin excite --json` writes it."""
        return {
            "schema": 1,
            "rig": self.rig.name,
            "criterion": self.criterion,
            "value": self.value,
            "condition_number": self.condition_number,
            "seconds": self.seconds,
            "harmonics": self.series.harmonics,
            "period": self.series.seconds,
            "periods": self.periods,
            "finished": self.finished,
            "speed": dict(self.speed),
            "clearance": None if self.clearance is None else self.clearance._asdict(),
            "unchecked": list(self.unchecked),
            "assumed": [
                {**one._asdict(), "stated": None if isinf(one.stated) else one.stated}
                for one in self.assumed
            ],
            "limits_used": {joint: dict(shares) for joint, shares in self.limits_used.items()},
        }


@limit_to_one_thread()
@check_arguments
def excite(
    rig: Rig,
    *,
    seconds: float = 10.0,
    periods: int = 1,
    harmonics: int | None = None,
    starts: int = 5,
    rng: Rng = None,
    criterion: str | Criterion = "condition",
    effects: Sequence[Effect] = (),
    margin: float = 0.05,
    first: bool = False,
    clearance: float = CLEARANCE,
    speed: float = 0.3,
    torque_model: Model | None = None,
    dt: float = 1e-3,
) -> Excitation:
    """Design the finite Fourier series that shows a rig's base parameters and friction best, within its limits.

    SLSQP with exact gradients from random motions; the best of its ends is finished on a finer grid. Limits are kept
    on the optimisation's grid, and checked on one ten times denser; amplitudes are scaled down until they hold there.
    Interrupted (Ctrl-C), it returns the best so far.

    Args:
        rig: The rig and its limits. A revolute joint without angle limits is moved by at most half a turn either
            way; an acceleration without a limit is bounded by the motor's torque. Where neither is stated,
            limits are assumed, see `limits.assume_limits`.
        seconds: Length, s.
        periods: Periods in it, one or more: what differs between them is noise, see `fourier.count_periods`.
        harmonics: Harmonics of one over the period, two or more; None: up to half a hertz, at least five, a period of
            more than 20 s being parted into several (`Series.of`).
        starts: Random motions to begin from, one or more.
        rng: Source of the starts, or its seed; None: a fresh one, whose seed is in the result.
        criterion: "condition", "determinant", or a criterion of your own.
        effects: Effects to be shown on top of Coulomb and viscous friction.
        margin: Share of every limit that is left free.
        first: Return the motion as it is to be run first on a machine, see `slow_down`.
        clearance: Distance that parts keep which can hit each other, by the URDF's collision geometry, m.
        speed: Rms rate that every joint should reach so that friction shows, as a share of its rate limit (without one:
            of what half a hertz over its travel takes), under one; limits go first.
        torque_model: Model that the torque limits are checked with; None: the rig's nominal model.
        dt: Sampling interval of the returned motion, s; its length is a whole number of it.

    Returns:
        The motion, its condition number, and what it uses of the limits.

    Raises:
        UsageError: An argument is out of range, or the rig cannot move within its limits.
    """
    if not seconds >= 0.5 * max(periods, 1):
        raise UsageError(
            "seconds",
            f"is {seconds:g}",
            "give at least 0.5 for each period: no rig shows itself in less",
        )
    samples = round(seconds / dt) if dt > 0 else 0
    if samples < 1 or abs(samples * dt - seconds) > 1e-9 * seconds:
        raise UsageError(
            "dt", f"is {dt:g}", f"give an interval of which {seconds:g} s is a whole number"
        )
    if starts < 1:
        raise UsageError("starts", f"is {starts}", "give one or more")
    rig, assumed = assume_limits(rig)
    model = nominal(rig) if torque_model is None else torque_model
    if not clearance >= 0:
        raise UsageError(
            "clearance", f"is {clearance:g}", "give a distance in metres, zero or more"
        )
    if not 0 <= speed < 1:
        raise UsageError(
            "speed", f"is {speed:g}", "give a share of the rate limits from 0 up to under 1"
        )
    envelope = Envelope.of(rig, margin)
    problem = ExcitationProblem(
        model,
        Series.of(seconds, harmonics, periods),
        ExcitationColumns.of(rig, effects),
        find_criterion(criterion),
        envelope,
        Clearance.of(rig, clearance, envelope),
        speed,
    )
    generator, seed = make_generator(rng)
    x, finished = optimise(problem, starts, generator)
    if first:
        problem, x, samples = slow_down(problem, x, samples)
    x, gap = enforce_clearance(problem, x)
    motion = problem.series.motion(problem.coefficients(x), dt * np.arange(samples + 1))
    return replace(
        describe(problem, x, motion, finished), clearance=gap, seed=seed, assumed=assumed
    )


def slow_down(
    problem: ExcitationProblem, x: Array, samples: int
) -> tuple[ExcitationProblem, Array, int]:
    """Return a motion at a tenth of its amplitude about the same middle, so slow that its torque is small.

    With the amplitude every rate and acceleration fall to a tenth. What moves the bodies and rotors, ``M a + C v``,
    falls with the square of the time that the path takes: it is stretched until that is under a tenth of every limit.
    Gravity and dry friction no motion can lower.
    """
    repaired = problem.repair(problem.scale(x, FIRST_SHARE))
    if repaired is None:
        raise problem.explain_infeasibility()
    rig = problem.model.rig
    motion = problem.motion(repaired, problem.dense)
    push = compute_rnea(rig, motion.q, motion.v, motion.a) - compute_gravity(rig, motion.q)
    slower = np.sqrt(
        max(1.0, float((np.abs(push) / (FIRST_SHARE * problem.envelope.torque)).max()))
    )
    longer = ceil(samples * slower - 1e-9)
    series = replace(problem.series, seconds=problem.series.seconds * longer / samples)
    return replace(problem, series=series), problem.scale(repaired, samples / longer), longer


def enforce_clearance(problem: ExcitationProblem, x: Array) -> tuple[Array, Gap | None]:
    """Return x and its smallest clearance; scaled down where parts come too near that were not watched."""
    if problem.clearance is None:
        return x, None
    q = problem.motion(x, problem.dense).q
    gap = problem.clearance.find_smallest_gap(q)
    if gap is None or gap.distance >= problem.clearance.required:
        return x, gap
    clearance = problem.clearance.watch_close_pairs(q)
    if clearance.watched == problem.clearance.watched:
        return x, gap  # they keep it but for rounding
    watching = replace(problem, clearance=clearance)
    repaired = watching.repair(x)
    if repaired is None:
        raise watching.explain_infeasibility()
    return enforce_clearance(watching, repaired)


def describe(problem: ExcitationProblem, x: Array, motion: Motion, finished: bool) -> Excitation:
    """Return x as an `Excitation`, its figures from the dense grid."""
    rig = problem.columns.rig
    criterion = problem.criterion
    dense = problem.motion(x, problem.dense)
    shares = Envelope.of(rig).find_largest_shares(problem.model, dense)
    return Excitation(
        rig=rig,
        motion=motion,
        series=problem.series,
        coefficients=problem.coefficients(x),
        criterion=criterion.name,
        value=problem.evaluate(x)[0],
        condition_number=problem.columns.compute_condition_number(dense),
        limits_used={
            joint: dict(zip(QUANTITIES, column.tolist()))
            for joint, column in zip(rig.joints, shares.T)
        },
        speed=dict(zip(rig.joints, np.sqrt(np.mean(dense.v**2, axis=0)).tolist())),
        finished=finished,
        unchecked=() if problem.clearance is None else problem.clearance.unchecked,
    )


def optimise(
    problem: ExcitationProblem, starts: int, rng: np.random.Generator
) -> tuple[Array, bool]:
    """Return the best motion found, and whether the search came to its end.

    SLSQP with exact gradients from so many random motions, and again on the finer grid from the best of its ends.
    An interior-point method of our own with three times as many starts reached condition numbers 0.94-1.00 times these
    (medians of three seeds, three bundled rigs, 5 and 20 s) in 0.4-1.3 times the time.
    """
    tried = [problem.draw_start(rng) for _ in range(starts)]
    fine = replace(problem, per_period=2 * problem.per_period)
    finished = True
    try:
        for k in trange(starts + 1, desc="excitation", unit="descent", disable=None, leave=False):
            if k == starts:
                tried.append(min(tried, key=lambda x: fine.evaluate(x)[0]))
            descend(problem if k < starts else fine, tried, k)
    except KeyboardInterrupt:
        finished = False
    repaired = [x for x in map(fine.repair, tried) if x is not None]
    if not repaired:
        raise problem.explain_infeasibility()
    return min(repaired, key=lambda x: fine.evaluate(x)[0]), finished


def descend(problem: ExcitationProblem, tried: list[Array], k: int) -> None:
    """Minimise from the k-th of the motions tried, which is where the descent is by then, even if it is interrupted."""
    from scipy.optimize import minimize

    def keep(x: Array) -> None:
        tried[k] = x.copy()

    limits = {"type": "ineq", "fun": problem.compute_room, "jac": problem.differentiate_room}
    options = {"ftol": 3e-4, "maxiter": 100}  # a log of a condition number need not be known better
    found = minimize(
        problem.evaluate,
        tried[k],
        jac=True,
        method="SLSQP",
        constraints=limits,
        callback=keep,
        options=options,
    )
    keep(found.x)
