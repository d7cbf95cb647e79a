"""A model against the rows that it is judged by: torque measured and predicted, and what each parameter moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.effects import TorqueTable
from gimbal_pin.errors import NORMAL_95
from gimbal_pin.identification import IdentificationResult, split_logs
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Block, Design, compute_blocks
from gimbal_pin.report.elements import Content, toned
from gimbal_pin.report.format import DASH, figures, list_shown_joints

HARMLESS_SHARE, BAD_SHARE = 0.01, 0.05
"""Shares of a joint's torque: an interval that moves less does no harm, one that moves more is bad."""


@dataclass(frozen=True, eq=False)
class EvaluatedPart:
    """Filtered rows of one trajectory.

    Attributes:
        log: Name of the log.
        t: Time, s, (m,); it jumps at gaps of the log.
        q: Joint angles, rad, (m, n).
        v: Joint rates, rad/s, (m, n).
        measured: Torque, N m, (m, n).
        predicted: The model's, N m, (m, n); near standstill, where dry friction may have any direction, a guess.
        error: Measured minus predicted with the samples near standstill masked out, N m, (m, n): what is judged.
        share: How much of each row's samples was not masked out, in [0, 1], (m, n).
    """

    log: str
    t: Array
    q: Array
    v: Array
    measured: Array
    predicted: Array
    error: Array
    share: Array

    def cut(self, rows: slice) -> EvaluatedPart:
        """Return the rows in `rows`."""
        return replace(self, **{name: x[rows] for name, x in vars(self).items() if name != "log"})


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A model against data.

    Attributes:
        joints: Joint names (n).
        parts: The trajectories.
        columns: Root mean square of the torque per unit of each parameter, N m per unit, (n, k).
    """

    joints: tuple[str, ...]
    parts: tuple[EvaluatedPart, ...]
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


def evaluate(found: IdentificationResult, logs: Sequence[Log]) -> Evaluated:
    """Return the held-out rows and the model's prediction of them; the training rows where nothing was held out."""
    train, test, _ = split_logs(logs, found.holdout, found.filtering)
    effects = tuple(term.effect for term in found.model.terms)
    rig = found.model.rig
    theta = found.estimate.theta
    rows = Design(rig, found.reduction, effects, test or train, found.filtering)
    parts = list[EvaluatedPart]()
    every = list[Block]()
    for log in rows.logs:
        one = replace(rows, logs=(log,))
        judged = compute_blocks(one)
        whole = compute_blocks(replace(one, masked=False))
        every += judged
        if judged:
            t, q, v = (np.concatenate([getattr(block, name) for block in whole]) for name in "tqv")
            measured = np.concatenate([block.b + block.known for block in whole])
            predicted = np.concatenate([block.A @ theta + block.known for block in whole])
            error = np.concatenate([block.b - block.A @ theta for block in judged])
            share = np.concatenate([block.share for block in judged])
            parts.append(EvaluatedPart(log.name, t, q, v, measured, predicted, error, share))
    count = np.sum([np.sum(block.share**2, axis=0) for block in every], axis=0)
    power = np.sum([np.sum(block.A**2, axis=0) for block in every], axis=0)
    columns = np.sqrt(power / np.maximum(count, 1e-300)[:, None])
    return Evaluated(rig.joints, tuple(parts), columns)


def find_worst(t: Array, squares: Array, longest: float) -> tuple[float, slice]:
    """Return the mean of squares, (N,), in those `longest` s where it is largest, and these rows; of less, in all."""
    power = np.concatenate([[0.0], np.cumsum(squares)])
    ends = np.searchsorted(t, t + longest)
    score = (power[ends] - power[:-1]) / np.maximum(ends - np.arange(len(ends)), 1)
    first = int(np.argmax(np.where(t <= max(t[-1] - longest, t[0]), score, -np.inf)))
    return float(score[first]), slice(first, int(ends[first]))


@dataclass(frozen=True)
class KnownParameter:
    """One parameter.

    Attributes:
        name: Its name; a base parameter's is its regrouping.
        value: Estimate, SI.
        std: Its standard deviation.
        unit: SI unit.
        given: What the URDF states, nan where it does not.
        away: By how many deviations the estimate differs from that, nan without.
        reach: Torque that it moves per unit, N m rms; 0 where that is not known.
        share: The same as a share of the torque of the joint where that is largest, or None.
        colour: Of the joint it belongs to: it moves the link, or bears the effect.
    """

    name: str
    value: float
    std: float
    unit: str
    given: float
    away: float
    reach: float
    share: float | None
    colour: str

    @property
    def half(self) -> float:
        """Half the 95 % interval."""
        return NORMAL_95 * self.std

    @property
    def moved(self) -> float:
        """Torque that it moves, N m rms."""
        return abs(self.value) * self.reach

    @property
    def tone(self) -> str:
        """What its uncertainty does: to the torque where that is known, else to its value."""
        doubt = (
            self.half / max(abs(self.value), 1e-300) / 4
            if self.share is None
            else self.half * self.share
        )
        return "poor" if doubt > BAD_SHARE else "fair" if doubt > HARMLESS_SHARE else ""

    @property
    def deviation(self) -> Content:
        """The interval as a share of the value; of what is not told from zero that it is not."""
        if self.std == 0:
            return DASH
        seen = abs(self.value) > self.half
        return toned(
            f"{figures(100 * self.half / abs(self.value), 2)} %" if seen else "like zero", self.tone
        )


def find_tables(found: IdentificationResult) -> dict[TorqueTable, range]:
    """Return tables of torque → where their values stand among the parameters, too many for a line each."""
    ends = len(found.reduction.independent) + np.cumsum(
        [0, *(len(term.values) for term in found.model.terms)]
    )
    places = zip(
        (term.effect for term in found.model.terms), map(range, ends.tolist(), ends[1:].tolist())
    )
    return {effect: place for effect, place in places if isinstance(effect, TorqueTable)}


def list_shown(found: IdentificationResult) -> list[int]:
    """Return which parameters have a line each: all but the values of tables."""
    tabled = {k for place in find_tables(found).values() for k in place}
    return [k for k in range(len(found.names)) if k not in tabled]


def known(found: IdentificationResult, evaluated: Evaluated | None = None) -> list[KnownParameter]:
    """Return every parameter, base parameters first, and what each moves on the rows in `evaluated`."""
    count = len(found.names)
    rig = found.model.rig
    reach = [0.0] * count if evaluated is None else evaluated.reach.tolist()
    share = [None] * count if evaluated is None else evaluated.share.tolist()
    joints = list_shown_joints(rig)
    by_link = {link: joint.colour for link, joint in zip(rig.links, joints)}
    by_joint = {joint.name: joint.colour for joint in joints}
    colours = [
        by_link[found.reduction.names[j].rsplit(".", 1)[0]] for j in found.reduction.independent
    ]
    colours += [by_joint[term.effect.joint] for term in found.model.terms for _ in term.values]
    figures_of = (found.estimate.theta, found.estimate.std, found.stated, found.moved)
    value, std, given, away = (x.tolist() for x in figures_of)
    return [
        KnownParameter(*row)
        for row in zip(found.names, value, std, found.units, given, away, reach, share, colours)
    ]
