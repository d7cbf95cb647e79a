"""Compare the parameters of several logs of one rig by Cochran's test."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from gimbal_pin.errors import NORMAL_95, DataError, finite_or_none
from gimbal_pin.identification.requirements import check_enough
from gimbal_pin.log.log import Array
from gimbal_pin.regression import (
    Block,
    Design,
    Estimate,
    add_misfit,
    compute_blocks,
    fit_weighted,
)
from gimbal_pin.rig.brief import brief

MATERIAL_SHARE = 0.01
"""Torque that a difference moves, as a share of the joint's rms, under which it does not matter."""


class LogVerdict(str, Enum):
    """What the logs say of a parameter."""

    AGREES = "agrees"
    DRIFTS = "drifts"
    NOT_SHOWN = "not shown"

    __str__ = str.__str__


class LoggedParameter(NamedTuple):
    """One parameter, log by log.

    Attributes:
        name: Its name.
        unit: SI unit.
        values: Each log's own estimate, (L,).
        std: Their deviations under coloured residuals, (L,); infinite where a log does not show it.
        shared: ``Σ w x / Σ w``, ``w = 1 / std²``.
        p_value: Chance of a larger ``Q = Σ w (x - shared)²`` if all logs have the same value (Cochran 1954).
        verdict: Whether it drifts; *not shown*: no log tells it from zero, or fewer than two show it.
    """

    name: str
    unit: str
    values: Array
    std: Array
    shared: float
    p_value: float
    verdict: LogVerdict

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)


@dataclass(frozen=True, eq=False)
class Agreement:
    """Parameters of several logs, each with its values log by log.

    Attributes:
        logs: Names of the logs, (L,).
        parameters: Base parameters, then friction and other effects.
    """

    logs: tuple[str, ...]
    parameters: tuple[LoggedParameter, ...]

    __repr__ = brief

    @property
    def drifting(self) -> tuple[LoggedParameter, ...]:
        """The parameters that differ from log to log."""
        return tuple(one for one in self.parameters if one.verdict is LogVerdict.DRIFTS)

    @property
    def sentence(self) -> str:
        """Number of parameters that agree, that drift, and that no log shows."""
        count = {one: sum(x.verdict is one for x in self.parameters) for one in LogVerdict}
        head = f"{len(self.logs)} logs: {count[LogVerdict.AGREES]} of {len(self.parameters)} parameters agree"
        others = ((count[LogVerdict.DRIFTS], "drift"), (count[LogVerdict.NOT_SHOWN], "not shown"))
        return ", ".join([head, *(f"{number} {verb}" for number, verb in others if number)])

    def to_dict(self) -> dict[str, Any]:
        """Return what `identify --json` writes."""
        return {
            "logs": list(self.logs),
            "sentence": self.sentence,
            "parameters": [
                {
                    "name": one.name,
                    "unit": one.unit,
                    "values": one.values.tolist(),
                    "std": [finite_or_none(x) for x in one.std.tolist()],
                    "shared": one.shared,
                    "p_value": one.p_value,
                    "verdict": one.verdict.value,
                }
                for one in self.parameters
            ],
        }


def assess_agreement(design: Design, chance: float = 0.01) -> Agreement | None:
    """Fit each log on its own, and test every parameter for drift.

    Args:
        design: Rows of several logs.
        chance: That any parameter of logs that agree is said to drift: each is tested to its share (Bonferroni).

    Returns:
        None where fewer than two logs are long enough for an estimate of their own.
    """
    names = list[str]()
    each = list[tuple[Block, ...]]()
    for log in design.logs:
        with contextlib.suppress(DataError):
            blocks = compute_blocks(replace(design, logs=(log,)))
            check_enough(blocks)
            names.append(log.name)
            each.append(blocks.blocks)
    if len(each) < 2:
        return None
    found = [add_misfit(blocks, fit_weighted(blocks))[0] for blocks in each]
    parameters = _test_parameters(design, each, found, chance / len(design.names))
    return Agreement(tuple(names), parameters)


def _test_parameters(
    design: Design, each: list[tuple[Block, ...]], found: list[Estimate], chance: float
) -> tuple[LoggedParameter, ...]:
    """Cochran's test of every parameter; a difference that moves next to no torque is none."""
    values = np.array([one.theta for one in found])
    std = np.array([one.std for one in found])
    weight = np.where(np.isfinite(std), 1.0 / np.maximum(std, 1e-300) ** 2, 0.0)
    shared = np.sum(weight * values, axis=0) / np.maximum(np.sum(weight, axis=0), 1e-300)
    shown = np.sum(weight > 0, axis=0)
    p_value = chi2.sf(np.sum(weight * (values - shared) ** 2, axis=0), np.maximum(shown - 1, 1))
    every = [block for blocks in each for block in blocks]
    torque = np.sum([np.sum(block.b**2, axis=0) for block in every], axis=0)
    power = np.sum([np.sum(block.A**2, axis=0) for block in every], axis=0)
    reach = np.sqrt((power / np.maximum(torque, 1e-300)[:, None]).max(axis=0))
    moved = reach * np.max(np.where(weight > 0, np.abs(values - shared), 0.0), axis=0)
    drifts = (p_value < chance) & (moved > MATERIAL_SHARE) & (shown > 1)
    vague = (shown < 2) | np.all(np.abs(values) < NORMAL_95 * std, axis=0)
    verdicts = [
        LogVerdict.DRIFTS if drifting else LogVerdict.NOT_SHOWN if hidden else LogVerdict.AGREES
        for drifting, hidden in zip(drifts, vague)
    ]
    rows = zip(
        design.names, design.units, values.T, std.T, shared.tolist(), p_value.tolist(), verdicts
    )
    return tuple(LoggedParameter(*row) for row in rows)
