"""Torque measured and predicted on the rows that a model is judged by."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.estimation.identification import Identified, split
from gimbal_pin.estimation.rows import Block, Rows, kept
from gimbal_pin.log.log import Array, Log


@dataclass(frozen=True, eq=False)
class Part:
    """Filtered rows of one trajectory.

    Attributes:
        log: Name of the log.
        t: Time, s, (m,); it jumps at gaps of the log.
        v: Joint rates, rad/s, (m, n).
        measured: Torque, N m, (m, n).
        predicted: The model's, N m, (m, n); near standstill, where dry friction may have any direction, a guess.
        error: Measured minus predicted with the samples near standstill masked out, N m, (m, n): what is judged.
        share: How much of each row's samples was not masked out, in [0, 1], (m, n).
    """

    log: str
    t: Array
    v: Array
    measured: Array
    predicted: Array
    error: Array
    share: Array

    def cut(self, rows: slice) -> Part:
        """Return the rows in `rows`."""
        names = ("t", "v", "measured", "predicted", "error", "share")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


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
        """Return "v", "measured", "predicted", "error" or "share" of all trajectories, (rows, n)."""
        return np.concatenate([getattr(part, name) for part in self.parts])

    @property
    def torque_rms(self) -> Array:
        """Root mean square of the measured torque, N m, (n,)."""
        return np.asarray(np.sqrt(np.mean(self.stacked("measured") ** 2, axis=0)))

    @property
    def scale(self) -> Array:
        """What errors are shares of: the same torque, (n,); infinite at a joint that nothing drove."""
        return np.where(self.torque_rms > 0, self.torque_rms, np.inf)

    @property
    def reach(self) -> Array:
        """Torque per unit of each parameter on the joint where it is largest, N m rms per unit, (k,)."""
        return np.asarray(self.columns.max(axis=0))

    @property
    def share(self) -> Array:
        """The same as a share of the joint's measured torque, on the joint where that is largest, per unit, (k,)."""
        return np.asarray((self.columns / self.scale[:, None]).max(axis=0))


def evaluate(found: Identified, logs: Sequence[Log]) -> Evaluated:
    """Return the held-out rows and the model's prediction of them; the training rows where nothing was held out."""
    train, test, how = split(logs, holdout(found), found.filtering)
    effects = tuple(term.effect for term in found.model.terms)
    rig = found.model.rig
    rows = Rows(rig, found.reduction, effects, test or train, found.filtering)
    each = [replace(rows, logs=(log,)) for log in rows.logs]
    pairs = [(kept(one), kept(replace(one, masked=False))) for one in each]
    theta = found.estimate.theta
    parts = tuple(part(log.name, *pair, theta) for log, pair in zip(rows.logs, pairs) if pair[0])
    blocks = [block for judged, _ in pairs for block in judged]
    return Evaluated(rig.joints, how if test else "training part", parts, column_rms(blocks))


def holdout(found: Identified) -> str:
    """Return the way of holding out that `identify` was given, from what it says of it."""
    if found.held_out is None:
        return "none"
    number = re.match(r"log (\d+) of", found.held_out.how)
    return f"log:{number[1]}" if number else "last-third"


def part(name: str, judged: Sequence[Block], whole: Sequence[Block], theta: Array) -> Part:
    """Return the rows of one trajectory from its blocks with and without the samples near standstill."""
    t, v, measured = (np.concatenate([getattr(block, field) for block in whole]) for field in ("t", "v", "b"))
    return Part(
        name,
        t,
        v,
        measured,
        predicted=np.concatenate([block.A @ theta for block in whole]),
        error=np.concatenate([block.b - block.A @ theta for block in judged]),
        share=np.concatenate([block.share for block in judged]),
    )


def column_rms(blocks: Sequence[Block]) -> Array:
    """Root mean square of each joint's columns, N m per unit, (n, k)."""
    power = np.sum([np.sum(block.A**2, axis=0) for block in blocks], axis=0)
    rows = np.sum([np.sum(block.share**2, axis=0) for block in blocks], axis=0)
    return np.asarray(np.sqrt(power / np.maximum(rows, 1e-300)[:, None]))
