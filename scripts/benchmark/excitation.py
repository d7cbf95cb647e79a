"""Excitation design against plain SLSQP, CMA-ES and splines: one yardstick, the same limits, starts and termination."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from statistics import median
from time import process_time

import numpy as np
from tqdm import tqdm

from benchmark.figure import Figure
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.excitation import (
    Condition,
    Envelope,
    ExcitationColumns,
    ExcitationProblem,
    Series,
    excite,
)
from gimbal_pin.log.log import Array
from gimbal_pin.regression import compute_direction
from gimbal_pin.rig.rig import Rig

SEEDS, STARTS, SECONDS, HARMONICS, MARGIN = 3, 5, 10.0, 5, 0.05
RIGS = ("thesis", "handheld")
"""The reference problem, and a rig with axes that miss each other."""
SAMPLES = 240
"""Samples per period of the highest harmonic of the grid on which all are judged."""
TOLERANCE = 3e-4
"""Gain per step at which a descent ends, as ours does."""
ITERATIONS, EVALUATIONS = 150, 40_000
"""Most iterations of SLSQP and evaluations of CMA-ES per start; both end before by the tolerance."""
STEP = 0.3
"""CMA-ES's first deviation as a share of the coefficients' mean size."""
PENALTY = 100.0
"""What exceeding a limit by its own size costs CMA-ES, for the worst and for the mean over the grid."""


@dataclass(frozen=True)
class Splines(Series):
    """Cubic splines through as many knots as a Fourier series has free coefficients, from rest to rest.

    FIGAROH's parametrisation (its optimiser, IPOPT, aside); every joint's free coefficients are its inner angles.
    """

    def basis(self, t: Array) -> Array:
        """Angle, rate and acceleration per unit of each knot's angle, (3, T, 2 L + 1)."""
        from scipy.interpolate import CubicSpline

        count = 2 * self.harmonics + 1
        curve = CubicSpline(np.linspace(0.0, self.seconds, count), np.eye(count), bc_type="clamped")
        return np.stack([curve(t, order) for order in range(3)])

    @cached_property
    def rest(self) -> Array:
        """Basis of the knots that start and end without acceleration, (2 L + 1, 2 L - 1)."""
        ends = self.basis(np.array([0.0, self.seconds]))[2]
        return np.linalg.qr(ends.T, mode="complete")[0][:, 2:]


@dataclass(frozen=True)
class Entry:
    """What a way achieved: condition number, largest share of the rig's limits, CPU time, s."""

    condition: float
    share: float
    seconds: float


def measure() -> Iterator[Figure]:
    """Yield condition numbers and times on both rigs, CMA-ES and splines on the reference problem only."""
    ways: dict[str, Callable[[Rig, int], Entry]] = {"slsqp": slsqp, "ours": ours}
    others = {**({"cma": cma_es} if find_spec("cma") else {}), "splines": splines}
    total = SEEDS * (len(RIGS) * len(ways) + len(others))
    with tqdm(total=total, desc="excitation", unit="design", disable=None, leave=False) as bar:
        for name in RIGS:
            rig = Rig.load(name)
            first = name == RIGS[0]
            at: dict[str, list[Entry]] = {}
            for way, run in {**ways, **(others if first else {})}.items():
                for seed in range(SEEDS):
                    at.setdefault(way, []).append(run(rig, seed))
                    bar.update()
            yield from compared(name, at, required=first)


def compared(name: str, at: dict[str, list[Entry]], required: bool) -> Iterator[Figure]:
    """Yield the figures of a rig."""
    of = f"excitation of {name}, {STARTS} starts: "
    labels = {
        "slsqp": "plain SLSQP",
        "cma": "CMA-ES",
        "splines": "splines by SLSQP",
        "ours": "ours",
    }
    for way, label in labels.items():
        if way in at:
            yield Figure(f"{of}{label}, condition number", median(one.condition for one in at[way]))
            yield Figure(f"{of}{label}, CPU time", median(one.seconds for one in at[way]), "s")
        elif required:
            yield Figure(f"{of}{label}, condition number", None)
    if required and not find_spec("cyipopt"):
        yield Figure(f"{of}FIGAROH's own splines (IPOPT)", None)
    yield from ratios(of, at, required)


def ratios(of: str, at: dict[str, list[Entry]], required: bool) -> Iterator[Figure]:
    """Yield ours over the others', medians over the same seeds; requirements are on the reference problem."""
    usual = {way: median(one.condition for one in found) for way, found in at.items()}
    rest = min(condition for way, condition in usual.items() if way != "ours")
    yield Figure(
        f"{of}condition of ours / best other's",
        usual["ours"] / rest,
        at_most=1.0 if required else None,
    )
    mine = at["ours"]
    others = [found for way, found in at.items() if way != "ours"]
    worst = max(
        one.condition / min(rival.condition for rival in rivals)
        for one, *rivals in zip(mine, *others)
    )
    yield Figure(f"{of}the same, worst of {SEEDS} seeds", worst)
    ratio = median(one.seconds / plain.seconds for one, plain in zip(mine, at["slsqp"]))
    yield Figure(
        f"{of}CPU time of ours / plain SLSQP's", ratio, at_most=1 / 3 if required else None
    )
    yield Figure(
        f"{of}ours, largest share of a limit, dense grid",
        max(one.share for one in mine),
        at_most=1.0,
    )


def problem(rig: Rig, series: Series) -> ExcitationProblem:
    """What all of them minimise, and the limits on the grid that all of them see."""
    return ExcitationProblem(
        nominal(rig), series, ExcitationColumns.of(rig), Condition(), Envelope.of(rig, MARGIN)
    )


def compute_objective(at: ExcitationProblem, x: Array) -> float:
    """Return what `ExcitationProblem.evaluate` does, without the gradient, which these ways do not use."""
    motion = at.motion(x, at.coarse)
    return at.criterion.value(
        at.columns.scale_rows(motion, compute_direction(motion.v, motion.a, at.step))
    )


def judged(rig: Rig, series: Series, coefficients: Array, seconds: float) -> Entry:
    """Judge a motion on a grid that no optimiser saw, between the samples of a ten times denser one."""
    count = SAMPLES * HARMONICS
    motion = series.motion(coefficients, (np.arange(count) + 0.5) * SECONDS / count)
    return Entry(
        ExcitationColumns.of(rig).compute_condition_number(motion),
        float(Envelope.of(rig).find_largest_shares(nominal(rig), motion).max()),
        seconds,
    )


def ours(rig: Rig, seed: int) -> Entry:
    """Ours, everything included that is done once for a rig."""
    begin = process_time()
    rng = np.random.default_rng(seed)
    found = excite(rig, seconds=SECONDS, harmonics=HARMONICS, starts=STARTS, rng=rng, margin=MARGIN)
    return judged(rig, found.series, found.coefficients, process_time() - begin)


def slsqp(rig: Rig, seed: int) -> Entry:
    """SciPy's SLSQP with finite differences, to its end from every start."""
    return by_slsqp(rig, problem(rig, Series(SECONDS, HARMONICS)), seed)


def splines(rig: Rig, seed: int) -> Entry:
    """Splines, optimised in the same way."""
    return by_slsqp(rig, problem(rig, Splines(SECONDS, HARMONICS)), seed)


def by_slsqp(rig: Rig, at: ExcitationProblem, seed: int) -> Entry:
    """The best of SLSQP's ends."""
    from scipy.optimize import minimize

    def end(x: Array) -> Array:
        room = {"type": "ineq", "fun": at.compute_room}
        options = {"maxiter": ITERATIONS, "ftol": TOLERANCE}
        found: Array = minimize(
            lambda x: compute_objective(at, x),
            x,
            method="SLSQP",
            constraints=[room],
            options=options,
        ).x
        return found

    return best(rig, at, seed, end)


def cma_es(rig: Rig, seed: int) -> Entry:
    """Hansen's CMA-ES from every start, what exceeds a limit penalised."""
    import cma

    at = problem(rig, Series(SECONDS, HARMONICS))

    def penalised(x: Array) -> float:
        beyond = np.maximum(-at.compute_room(x), 0.0)
        return compute_objective(at, x) + PENALTY * float(
            beyond.max() + beyond.sum() / at.per_period
        )

    def end(x: Array) -> Array:
        options = {"seed": seed + 1, "verbose": -9, "tolfun": TOLERANCE, "maxfevals": EVALUATIONS}
        found: Array = cma.fmin2(penalised, x, STEP * float(np.mean(np.abs(x))), options)[0]
        return found

    return best(rig, at, seed, end)


def best(rig: Rig, at: ExcitationProblem, seed: int, end: Callable[[Array], Array]) -> Entry:
    """Return the best of the ends of so many starts, as it is found: what exceeds a limit a little is let pass."""
    begin = process_time()
    rng = np.random.default_rng(seed)
    x = min(
        (end(at.draw_start(rng)) for _ in range(STARTS)), key=lambda x: compute_objective(at, x)
    )
    return judged(rig, at.series, at.coefficients(x), process_time() - begin)
