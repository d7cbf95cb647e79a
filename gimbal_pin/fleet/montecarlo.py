"""Monte Carlo over rigs that differ: share that meets a specification, and inputs that use most of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.special import ndtri
from scipy.stats import binomtest, sobol_indices, spearmanr

from gimbal_pin.control.tuning import StoredController, Tuning
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.errors import UsageError
from gimbal_pin.fleet.executor import map_units
from gimbal_pin.fleet.study import SHORTEST_DRIFTING, Limit, list_figures, make_study, parse_limit
from gimbal_pin.fleet.variation import RigDraw, Vary, draw_rigs, make_variation
from gimbal_pin.log.io.files import to_plain
from gimbal_pin.log.log import Array
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from pandas import DataFrame

CONFIDENCE = 0.95
"""Confidence of every interval."""
RESAMPLES = 200
"""Number of bootstrap samples behind the interval of a Sobol index: its width is known to 5 %, and to 3.5 % of twice as
many."""
SHOWN = 10
"""Number of rigs that are listed one by one."""


@dataclass(frozen=True)
class Yield:
    """Share of `of` rigs that meet the specification, with Wilson's interval of 95 % confidence."""

    value: float
    low: float
    high: float
    of: int


@dataclass(frozen=True, eq=False)
class MonteCarlo(Record):
    """Result of `monte_carlo`.

    Attributes:
        rig: Name of the rig.
        payload: Its payload, or None.
        count: Number of rigs.
        failed: Number of rigs that cannot exist, or whose loop diverged: none of these meets a specification.
        inputs: Names of what varied.
        specification: Requirements.
        yield_: Share of rigs that meet them; None: there are none.
        figures: A row per figure over all rigs that could be run: `median`, the 5 % below and above, `p5` and `p95`,
            and the `worst`, in rad (m of a joint that slides), s, per cent or as a share of a torque limit.
        sensitivity: Influence of each input on the share of the specification that a rig uses, see `rank_influences`;
            without a specification on the first figure.
        worst: The rigs that use most of it: unit, inputs, figures, error.
        units: Figure → its unit in reports; angles are in degrees there.
        table: A row per rig: unit, inputs, figures, error.
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
        """Return the values of the JSON output; null for what is infinite or unknown."""
        values = {
            "schema": 1,
            **{name: getattr(self, name) for name in ("rig", "payload", "count", "failed")},
            "specification": [limit.text for limit in self.specification],
            "yield": {
                name: getattr(self.yield_, name, None) for name in ("value", "low", "high", "of")
            },
            "figures": self.figures.to_dict("index"),
            "sensitivity": self.sensitivity.rename_axis("input").reset_index().to_dict("records"),
            "worst": self.worst,
        }
        return dict(to_plain(values, finite=True))


@check_arguments
def monte_carlo(
    rig: Rig,
    model: Model | None = None,
    *,
    count: int = 100,
    folder: str | Path | None = None,
    vary: Vary | str | Path | None = None,
    spec: Sequence[str] = (),
    controller: StoredController | Tuning | None = None,
    retune: bool = False,
    platform: bool = False,
    seconds: float = 5.0,
    sobol: bool = False,
    seed: int = 0,
    executor: Executor | None = None,
    quiet: bool = True,
) -> MonteCarlo:
    """Simulate rigs that differ, and report how many meet a specification and which inputs use most of it.

        study = monte_carlo(rig, model, count=1000, spec=["rms_error < 0.02", "settling_time < 0.6"])

    The results depend on the arguments up to `seed` alone, to the last bit on machines of one kind, whatever runs them.

    Args:
        rig: The rig.
        model: The nominal rig, with its covariance; None: as its URDF states it.
        count: Number of rigs; with `sobol` of base points, a power of two, each of which takes a rig per input and two
            more.
        folder: Folder of the results; rigs in it are not computed again. None: no folder.
        vary: What varies, or the path of such a YAML file; None: `choose_default_vary`.
        spec: Requirements ``FIGURE < NUMBER``, angles in degrees; a rig has to meet them all.
        controller: The controller, or with `retune` its specification; None: tuned for the nominal rig.
        retune: True tunes a controller for every rig, as if each were identified without error.
        platform: True holds the camera still on profile S instead of stepping all axes.
        seconds: Length of a run, s.
        sobol: True estimates Sobol' indices from Saltelli's design; False draws independent rigs.
        seed: Seed of everything random.
        executor: Runs the rigs; None: a process per processor of this machine.
        quiet: True shows no progress bar.

    Raises:
        UsageError: An argument is wrong; it names which.
    """
    variation = make_variation(nominal(rig) if model is None else model, vary)
    rigs = draw_rigs(variation.inputs, count, seed, sobol)
    units = list_figures(rig, platform)
    limits = tuple(parse_limit(text, units) for text in spec)
    if (
        platform
        and seconds < SHORTEST_DRIFTING
        and any(limit.figure == "drift" for limit in limits)
    ):
        what = f"is {seconds:g} s, which shows no drift"
        raise UsageError("--seconds", what, f"give {SHORTEST_DRIFTING:g} s or more")
    study = make_study(variation, controller, retune, platform, seconds)
    settings = {**study.describe(), "seed": seed, "sobol": sobol}
    table = map_units(study.run, rigs, executor, folder=folder, settings=settings, quiet=quiet)
    table = table.reindex(columns=list(dict.fromkeys([*table, *units])))
    is_run = table["error"].isna().to_numpy()
    asked = limits or (Limit(next(iter(units)), 1.0, ""),)
    shares = [
        np.where(is_run, table[limit.figure].astype(float), np.inf) / limit.bound for limit in asked
    ]
    used = np.max(shares, axis=0)
    # Of a base point of Saltelli's design only the first and the last rig are independent draws.
    group = len(variation.inputs) + 2 if sobol else 1
    is_independent = np.isin(np.arange(len(rigs)) % group, [0, group - 1])
    run = table.loc[is_independent & is_run, [*units]].astype(float)
    spread = run.quantile([0.5, 0.05, 0.95, 1.0], interpolation="nearest").T
    worst = table.iloc[np.argsort(-used, kind="stable")[:SHOWN]].astype(object)
    return MonteCarlo(
        rig=rig.name,
        payload=rig.payload,
        count=len(rigs),
        failed=int((~is_run).sum()),
        inputs=variation.inputs,
        specification=limits,
        yield_=estimate_yield(used[is_independent] < 1.0) if limits else None,
        figures=spread.set_axis(["median", "p5", "p95", "worst"], axis=1),
        sensitivity=rank_influences(variation.inputs, rigs, used, sobol, seed),
        worst=tuple(worst.where(worst.notna(), None).to_dict("records")),
        units=units,
        table=table,
    )


def estimate_yield(is_met: Array) -> Yield:
    """Return the share of what is true, and Wilson's interval."""
    interval = binomtest(int(is_met.sum()), len(is_met)).proportion_ci(CONFIDENCE, method="wilson")
    return Yield(float(is_met.mean()), float(interval.low), float(interval.high), len(is_met))


def rank_influences(
    inputs: Sequence[str], rigs: Sequence[RigDraw], used: Array, sobol: bool = False, seed: int = 0
) -> DataFrame:
    """Return the influence of each input on values of `draw_rigs`' rigs, the largest first.

    Args:
        inputs: Names of the inputs.
        rigs: The rigs.
        used: Their values, (N,); infinite where a rig failed.
        sobol: Whether the rigs are Saltelli's design.
        seed: Seed of the bootstrap.

    Returns:
        A row per input, NaN where the rigs do not show it. Sobol' indices: `first`, the share of the variance that the
        input explains alone, `total`, the share that would be left if all others were known, and half of their
        intervals of 95 % confidence, `first_confidence` and `total_confidence`; from the largest power of two of base
        points without a failed rig. Of independent rigs Spearman's `rank_correlation`.
    """
    import pandas as pd

    indices = ["first", "first_confidence", "total", "total_confidence"]
    table = pd.DataFrame(np.nan, list(inputs), [*indices, "rank_correlation"])
    if sobol:
        points = used.reshape(-1, len(inputs) + 2)
        points = points[np.isfinite(points).all(axis=1)]
        points = points[: 1 << max(len(points).bit_length() - 1, 0)]
        if len(points) > 1:
            table[indices] = estimate_sobol_indices(points, seed)
    elif len(used) > 2 and np.any(used != used[0]):
        columns = np.array([rig.probabilities for rig in rigs]).T
        table["rank_correlation"] = [spearmanr(column, used).statistic for column in columns]
    return table.sort_values(
        "total" if sobol else "rank_correlation", key=np.abs, ascending=False, kind="stable"
    )


def estimate_sobol_indices(points: Array, seed: int) -> Array:
    """Return first-order indices, half of their intervals, total indices, half of theirs, (d, 4).

    Args:
        points: Values of A, of A with each input from B, and of B, (N, d + 2), N a power of two.
        seed: Seed of the bootstrap.
    """

    def estimate(rows: Array) -> Array:
        values = {"f_A": rows[None, :, 0], "f_B": rows[None, :, -1], "f_AB": rows.T[1:-1, None]}
        found = sobol_indices(func=values, n=len(rows))
        return np.array([found.first_order, found.total_order])

    resamples = np.random.default_rng(seed).integers(len(points), size=(len(points), RESAMPLES)).T
    std = np.std([estimate(points[rows]) for rows in resamples], axis=0, ddof=1)
    half = ndtri(0.5 + CONFIDENCE / 2) * std
    return np.stack([estimate(points), half], axis=1).reshape(4, -1).T
