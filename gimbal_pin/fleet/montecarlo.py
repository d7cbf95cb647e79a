"""Monte Carlo over rigs that differ: how many meet a specification, and what costs those that do not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.special import ndtri
from scipy.stats import binomtest, spearmanr

from gimbal_pin.control.tuning import StoredController, Tuning
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.errors import UsageError
from gimbal_pin.fleet.engine import Capacity, ExecutorFactory, check_installed, compute_table
from gimbal_pin.fleet.study import SHORTEST_DRIFTING, Limit, list_figures, make_study, parse_limit
from gimbal_pin.fleet.variation import RigDesign, Variation, Vary, choose_default_vary
from gimbal_pin.log.io.files import to_plain
from gimbal_pin.log.log import Array
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from pandas import DataFrame

CONFIDENCE = 0.95
"""Of every interval that is stated."""
RESAMPLED = 200
"""Bootstrap samples behind the confidence of a Sobol index."""
SHOWN = 10
"""Rigs that are looked at one by one."""


@dataclass(frozen=True)
class Yield:
    """Share of rigs that meet the specification, with Wilson's interval of 95 % confidence; `of` how many rigs."""

    value: float
    low: float
    high: float
    of: int


@dataclass(frozen=True, eq=False)
class MonteCarlo(Record):
    """The result of `monte_carlo`.

    Attributes:
        rig: Name of the rig.
        payload: Its payload, or None.
        count: Rigs.
        failed: Rigs that cannot be, or whose loop diverged: none of these meets a specification.
        inputs: What varied.
        specification: What was asked for.
        yield_: How many rigs meet it; None: nothing was asked for.
        figures: A row per figure over all rigs that could be run: `median`, the 5 % below and above, `p5` and `p95`,
            and the `worst`, in rad (m of a joint that slides), s, per cent or as a share of a torque limit.
        sensitivity: What costs most of the specification first, see `rank_influences`; without one, what counts most
            for the first figure.
        worst: The rigs that use most of it: unit, inputs, figures, error.
        units: Figure → its unit for people; angles are in degrees there.
        table: One row per rig: unit, inputs, figures, error.
    """

    rig: str
    payload: str | None
    count: int
    failed: int
    inputs: tuple[str, ...]
    specification: tuple[Limit, ...]
    yield_: Yield | None
    figures: DataFrame
    sensitivity: DataFrame
    worst: tuple[Mapping[str, Any], ...]
    units: Mapping[str, str] = field(repr=False)
    table: DataFrame = field(repr=False)

    ROWS: ClassVar[str] = "figures"
    __repr__ = brief

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds; null for what is infinite or unknown."""
        found = {
            "schema": 1,
            **{name: getattr(self, name) for name in ("rig", "payload", "count", "failed")},
            "specification": [own.text for own in self.specification],
            "yield": {name: getattr(self.yield_, name, None) for name in ("value", "low", "high", "of")},
            "figures": self.figures.to_dict("index"),
            "sensitivity": self.sensitivity.rename_axis("input").reset_index().to_dict("records"),
            "worst": self.worst,
        }
        return dict(to_plain(found, finite=True))


@check_arguments
def monte_carlo(
    rig: Rig,
    model: Model | None = None,
    *,
    count: int = 100,
    folder: str | Path | None = None,
    vary: Vary | None = None,
    spec: Sequence[str] = (),
    controller: StoredController | Tuning | None = None,
    retune: bool = False,
    platform: bool = False,
    seconds: float = 5.0,
    sobol: bool = False,
    seed: int = 0,
    executor: ExecutorFactory | None = None,
    workers: int | Capacity = 0,
    quiet: bool = True,
) -> MonteCarlo:
    """Simulate rigs that differ, and judge how many meet a specification and what costs those that do not.

        found = monte_carlo(rig, model, count=1000, spec=["rms_error < 0.02 deg", "settling_time < 0.6"])

    The results depend on the arguments up to `seed` alone, to the last bit on machines of one kind, whatever runs them.

    Args:
        rig: The rig.
        model: The nominal rig, with its covariance; None: as its URDF states it.
        count: Rigs; with `sobol` base points, a power of two, each of which takes a rig per input and two more.
        folder: Where results go as Parquet, a path or URL; what is there is not computed again. None: nowhere.
        vary: What varies; None: `choose_default_vary`.
        spec: Requirements ``FIGURE < NUMBER``, angles in degrees; a rig has to meet them all.
        controller: The controller, or with `retune` what is asked of one; None: tuned for the nominal rig.
        retune: True tunes a controller for every rig, as if each were identified without error.
        platform: True holds the camera still on profile S instead of stepping all axes.
        seconds: Length of a run, s.
        sobol: True draws Saltelli's design and estimates Sobol indices; else rigs are independent.
        seed: Seed of everything random.
        executor: Makes what runs the rigs, see `gimbal_pin.fleet`; None: processes of this machine.
        workers: How many run at once; 0: as many as there are processors; 1: in this process.
        quiet: True shows no progress bar.

    Raises:
        UsageError: Something asked for cannot be; it names what.
    """
    check_installed("monte_carlo", "pyarrow", "fsspec")
    known = nominal(rig) if model is None else model
    variation = Variation(known, choose_default_vary(known) if vary is None else vary)
    design = RigDesign(variation.inputs, count, seed, sobol, variation.vary.own_noise)
    variation.check()
    units = list_figures(rig, platform)
    limits = tuple(parse_limit(text, units) for text in spec)
    if platform and seconds < SHORTEST_DRIFTING and any(limit.figure == "drift" for limit in limits):
        raise UsageError(
            "--seconds", f"is {seconds:g} s, which shows no drift", f"give {SHORTEST_DRIFTING:g} s or more"
        )
    study = make_study(variation, controller, retune, platform, seconds)
    settings = {**study.describe(), "seed": seed, "sobol": sobol}
    table = compute_table(study.run, design, settings, folder, executor, workers, quiet)
    return summarise_rigs(rig, units, design, limits, table)


def summarise_rigs(
    rig: Rig, units: Mapping[str, str], design: RigDesign, limits: tuple[Limit, ...], table: DataFrame
) -> MonteCarlo:
    """Return what the rows say."""
    table = table.reindex(columns=list(dict.fromkeys([*table, *units])))  # a figure that no rig has is unknown
    ran = table["error"].isna().to_numpy()
    figures = {name: table[name].to_numpy(dtype=float) for name in units}
    asked = limits or (Limit(next(iter(units)), 1.0, ""),)
    used = np.max([np.where(ran, figures[own.figure], np.inf) / own.bound for own in asked], axis=0)
    drawn = np.isin(np.arange(len(design)) % design.group, [0, design.group - 1])  # A and B are independent
    worst = table.iloc[np.argsort(-used, kind="stable")[:SHOWN]].astype(object)
    independent = table.loc[drawn & ran, [*units]].astype(float)
    shares = {"median": 0.5, "p5": 0.05, "p95": 0.95, "worst": 1.0}
    spread = independent.quantile([*shares.values()], interpolation="nearest").set_axis([*shares]).T
    return MonteCarlo(
        rig=rig.name,
        payload=rig.payload,
        count=len(design),
        failed=int((~ran).sum()),
        inputs=design.inputs,
        specification=limits,
        yield_=estimate_yield(used[drawn] < 1.0) if limits else None,
        figures=spread if len(independent) else spread[:0],
        sensitivity=rank_influences(design, used),
        worst=tuple(worst.where(worst.notna(), None).to_dict("records")),
        units=units,
        table=table,
    )


def estimate_yield(met: Array) -> Yield:
    """Return the share of what is true, and Wilson's interval."""
    found = binomtest(int(met.sum()), len(met)).proportion_ci(CONFIDENCE, method="wilson")
    return Yield(float(met.mean()), float(found.low), float(found.high), len(met))


def rank_influences(design: RigDesign, used: Array) -> DataFrame:
    """Return what each input does to the values of a design's rigs, (N,), largest first; infinite: it failed.

    A base point of which a rig failed has no indices and is left out whole; a rank it has.

    Returns:
        A row per input, NaN where the design does not show it. Sobol indices: `first`, the share of the variance that
        the input explains alone, `total`, the share that would be left if all others were known, and half of their
        intervals of 95 % confidence, `first_confidence` and `total_confidence`. Spearman's `rank_correlation`.
    """
    import pandas as pd

    indices = ["first", "first_confidence", "total", "total_confidence"]
    found = pd.DataFrame(np.nan, list(design.inputs), [*indices, "rank_correlation"])
    points = used.reshape(-1, design.group)
    points = points[np.isfinite(points).all(axis=1)]
    if design.sobol and len(points) > 1 and np.ptp(points) > 0:
        found[indices] = estimate_sobol_indices(points, design.seed).T
    elif not design.sobol and len(used) > 2 and np.any(used != used[0]):
        shares = np.array([unit.shares for unit in design]).T
        found["rank_correlation"] = [spearmanr(own, used).statistic for own in shares]
    by = "total" if design.sobol else "rank_correlation"
    return found.sort_values(by, key=np.abs, ascending=False, kind="stable")


def estimate_sobol_indices(points: Array, seed: int) -> Array:
    """Return first-order indices, half of their intervals, total indices, half of theirs, (4, d).

    Args:
        points: Values of A, of A with each input from B, and of B, (N, d + 2).
        seed: Seed of the bootstrap.
    """
    resampled = np.random.default_rng(seed).integers(len(points), size=(len(points), RESAMPLED))
    centred = points - points.mean()
    std = np.std([compute_sobol_indices(centred[own]) for own in resampled.T], axis=0, ddof=1)
    return np.stack([compute_sobol_indices(centred), ndtri(0.5 + CONFIDENCE / 2) * std], axis=1).reshape(4, -1)


def compute_sobol_indices(centred: Array) -> Array:
    """``S = mean(f_B (f_AB - f_A)) / V,  T = mean((f_A - f_AB)²) / 2 V``, (2, d), from centred values (N, d + 2).

    Saltelli et al., Computer Physics Communications 181 (2010), table 2 (b) and (f).
    """
    a, mixed, b = centred[:, :1], centred[:, 1:-1], centred[:, -1:]
    return np.array([(b * (mixed - a)).mean(axis=0), ((a - mixed) ** 2).mean(axis=0) / 2]) / np.var([a, b])
