"""Torque measured and predicted on the rows that a model is judged by."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.identify import Identified, split
from gimbal_pin.log import Array, Log
from gimbal_pin.rows import Block, Rows, kept


@dataclass(frozen=True, eq=False)
class Part:
    """Filtered rows of one trajectory, (m,) and (m, n): time s, rates rad/s, torques N m; t jumps at gaps."""

    log: str
    t: Array
    v: Array
    measured: Array
    predicted: Array

    @property
    def error(self) -> Array:
        """Measured minus predicted torque, N m, (m, n)."""
        return self.measured - self.predicted


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A model against data.

    Attributes:
        joints: Joint names (n).
        how: Which rows.
        parts: The trajectories.
        columns: Root mean square of the torque per unit of each parameter, N m per unit, (n, k).
    """

    joints: tuple[str, ...]
    how: str
    parts: tuple[Part, ...]
    columns: Array

    def stacked(self, name: str) -> Array:
        """Return "v", "measured", "predicted" or "error" of all trajectories, (rows, n)."""
        return np.concatenate([getattr(part, name) for part in self.parts])

    @property
    def torque_rms(self) -> Array:
        """Root mean square of the measured torque, N m, (n,)."""
        return np.asarray(np.sqrt(np.mean(self.stacked("measured") ** 2, axis=0)))

    @property
    def reach(self) -> Array:
        """Torque per unit of each parameter on the joint where it is largest, N m rms per unit, (k,)."""
        return np.asarray(self.columns.max(axis=0))

    @property
    def share(self) -> Array:
        """The same as a share of the joint's measured torque, on the joint where that is largest, per unit, (k,)."""
        return np.asarray((self.columns / np.maximum(self.torque_rms, 1e-300)[:, None]).max(axis=0))


def evaluate(found: Identified, logs: Sequence[Log]) -> Evaluated:
    """Return the held-out rows and the model's prediction of them; the training rows where nothing was held out.

    Args:
        found: What `identify` returned.
        logs: The logs it was given.
    """
    train, test, how = split(logs, holdout(found), found.filtering)
    effects = tuple(term.effect for term in found.model.terms)
    rig = found.model.rig
    rows = Rows(rig, found.reduction, effects, test or train, found.filtering, masked=False)
    each = [(log.name, kept(replace(rows, logs=(log,)))) for log in rows.logs]
    blocks = [block for _, some in each for block in some]
    parts = tuple(part(name, some, found.estimate.theta) for name, some in each if some)
    return Evaluated(rig.joints, how if test else "training part", parts, column_rms(blocks))


def holdout(found: Identified) -> str:
    """Return the way of holding out that `identify` was given, from what it says of it."""
    if found.held_out is None:
        return "none"
    number = re.match(r"log (\d+) of", found.held_out.how)
    return f"log:{number[1]}" if number else "last-third"


def part(name: str, blocks: Sequence[Block], theta: Array) -> Part:
    """Return the rows of one trajectory."""
    t, v, measured = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("t", "v", "b"))
    return Part(name, t, v, measured, np.concatenate([block.A @ theta for block in blocks]))


def column_rms(blocks: Sequence[Block]) -> Array:
    """Root mean square of each joint's columns, N m per unit, (n, k)."""
    power = np.sum([np.sum(block.A**2, axis=0) for block in blocks], axis=0)
    return np.asarray(np.sqrt(power / max(1, sum(len(block.t) for block in blocks))))
