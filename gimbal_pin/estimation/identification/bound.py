"""What logs of a base that turned tell at best, and the cutoff with which an estimate comes near it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from gimbal_pin.estimation.estimators import Estimate
from gimbal_pin.estimation.estimators.colour import least
from gimbal_pin.estimation.rows import Filtering, Regression
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import BaseMotion

SHAKEN = 12.0
"""Cutoff for a base that is shaken, Hz: hands and airframes shake at 4 to 12 Hz, and what is fast shows inertias."""
WIDE = 16.0
"""Cutoff of the rows that the bound is taken from, Hz: of thesis's 60 s it is the same at 12 and at 25."""

Fit = Callable[[Filtering], tuple[Regression, Estimate]]


def usual(logs: Sequence[Log], base: BaseMotion) -> Filtering:
    """Return the filter for logs where none is asked for: wider where the base turns and joint rates were measured."""
    measured = all(log.v is not None for log in logs)
    return Filtering(cutoff=SHAKEN) if base == "rotating" and measured else Filtering()


def best(fit: Fit, filters: Filtering, names: Sequence[str]) -> Array | None:
    """Return the least standard deviations that the training rows allow, see `colour.least`, (k,).

    None where the wide rows show other parameters.

    Args:
        fit: Fits the training rows with a filter.
        filters: The filter in force; its alignment is kept.
        names: The parameters that were estimated.
    """
    blocks, estimate = fit(replace(filters, cutoff=max(WIDE, filters.cutoff)))
    return least(blocks, estimate.theta) if tuple(blocks.rows.names) == tuple(names) else None
