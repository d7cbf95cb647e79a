"""Do several logs of one rig agree? Each parameter log by log, and the likeliest reason where they differ."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from gimbal_pin.dynamics.regressor import compute_gravity
from gimbal_pin.effects.rig_effect import copy_model
from gimbal_pin.errors import NORMAL_95, DataError, digits, finite_or_none
from gimbal_pin.identification.payload_change import payload_directions
from gimbal_pin.identification.requirements import check_enough
from gimbal_pin.log.log import Array
from gimbal_pin.regression import (
    Block,
    Design,
    Estimate,
    add_misfit,
    compute_blocks,
    count_effective_rows,
    factor_rows,
    fit_weighted,
    solve_factors,
)
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import GRAVITY, Rig

MATERIAL_SHARE = 0.01
"""Torque that a difference moves, as a share of the joint's rms, under which it does not matter."""
STRONG_EVIDENCE = 10.0
"""Difference of Schwarz's criterion from which a reason is said to be one: very strong (Kass and Raftery 1995)."""


class DriftReason(str, Enum):
    """Why logs differ, in words; what stands for {joint} is where."""

    HEAT = "the friction of all joints changes together, as by heat"
    WEAR = "the friction of {joint} alone changes, as by wear, a warm motor or a touched cable"
    GAIN = "all torque of {joint} is scaled, as by another supply or torque constant"
    LEAN = "gravity is turned, as by a leaning stand"
    PAYLOAD = "only the payload's parameters change, as if the camera was moved or changed"
    UNKNOWN = "no single reason explains it: another rig, or one that was touched in several ways"

    __str__ = str.__str__


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


class _Hypothesis(NamedTuple):
    """A way in which logs differ: columns of ``[A X]`` whose coefficients each log has its own of."""

    reason: DriftReason | None
    joint: str
    columns: list[int]


@dataclass(frozen=True, eq=False)
class Agreement:
    """What several logs say of each parameter, and why they differ.

    Attributes:
        logs: Names of the logs, (L,).
        parameters: Base parameters, then friction and other effects.
        reason: The likeliest reason by Schwarz's criterion; None: the logs agree.
        joint: Where it acts; empty: on the whole rig.
        sizes: By how much each log differs from the first, (L, r): shares of friction (Coulomb, viscous) or of torque,
            the lean about x and y in rad; parameters in SI units for wear and payload.
    """

    logs: tuple[str, ...]
    parameters: tuple[LoggedParameter, ...]
    reason: DriftReason | None
    joint: str
    sizes: Array

    __repr__ = brief

    @property
    def drifting(self) -> tuple[LoggedParameter, ...]:
        """The parameters that differ from log to log."""
        return tuple(one for one in self.parameters if one.verdict is LogVerdict.DRIFTS)

    @property
    def sentence(self) -> str:
        """How many parameters agree, and the likeliest reason why others do not."""
        agree, hidden = (
            sum(x.verdict is one for x in self.parameters) for one in (LogVerdict.AGREES, LogVerdict.NOT_SHOWN)
        )
        unseen = f", {hidden} not shown" if hidden else ""
        head = f"{len(self.logs)} logs: {agree} of {len(self.parameters)} parameters agree{unseen}"
        return f"{head}; {self.why}" if self.why else head

    @property
    def why(self) -> str:
        """The likeliest reason; empty where the logs agree."""
        if self.reason is None:
            return ""
        return f"likeliest: {self.reason.format(joint=self.joint or 'every joint')}{self._describe_sizes()}"

    def _describe_sizes(self) -> str:
        """Say by how much, where that is a share or an angle."""
        if self.reason is DriftReason.LEAN:
            return f" (by {', '.join(digits(np.degrees(x), 2) for x in np.linalg.norm(self.sizes, axis=1))}°)"
        if self.reason is DriftReason.HEAT or self.reason is DriftReason.GAIN:
            names = ("Coulomb ", "viscous ") if self.reason is DriftReason.HEAT else ("",)
            each = (f"{name}× {', '.join(digits(1 + x, 3) for x in own)}" for name, own in zip(names, self.sizes.T))
            return f" ({'; '.join(each)})"
        return ""

    def to_dict(self) -> dict[str, Any]:
        """Return what `identify --json` writes."""
        return {
            "logs": list(self.logs),
            "reason": None if self.reason is None else self.reason.name.lower(),
            "joint": self.joint or None,
            "sizes": self.sizes.tolist(),
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
    """Fit each log on its own, test every parameter for drift, and weigh the reasons why logs differ.

    Args:
        design: Rows of several logs.
        chance: That any parameter of logs that agree is said to drift: each is tested to its share (Bonferroni).

    Returns:
        None where fewer than two logs are long enough for an estimate of their own.
    """
    names, each = list[str](), list[tuple[Block, ...]]()
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
    is_drifting = any(one.verdict is LogVerdict.DRIFTS for one in parameters)
    best, sizes, is_material = _weigh_reasons(design, each, found[0].theta)
    agreed = _Hypothesis(DriftReason.UNKNOWN if is_drifting else None, "", [])
    if best.reason is None or not (is_drifting or is_material):
        best, sizes = agreed, np.zeros((len(each), 0))
    return Agreement(tuple(names), parameters, best.reason, best.joint, sizes)


def _test_parameters(
    design: Design, each: list[tuple[Block, ...]], found: list[Estimate], chance: float
) -> tuple[LoggedParameter, ...]:
    """Cochran's test of every parameter; a difference that moves next to no torque is none."""
    values, std = np.array([one.theta for one in found]), np.array([one.std for one in found])
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
    rows = zip(design.names, design.units, values.T, std.T, shared.tolist(), p_value.tolist(), verdicts)
    return tuple(LoggedParameter(*row) for row in rows)


def _weigh_reasons(design: Design, each: list[tuple[Block, ...]], theta: Array) -> tuple[_Hypothesis, Array, bool]:
    """The best hypothesis by Schwarz's criterion ``Σ_j N_j log RSS_j + p log N``, its sizes, (L, r), and if it matters.

    A reason gives every log but the first coefficients of its own along its columns; *unknown* gives it all of theta.
    Rows of all hypotheses have one weighting, that of logs fitted apart. It matters where it moves torque.

    `theta`: the first log's own: the parameters that reasons scale.
    """
    rig, k, first, payload = design.rig, len(theta), len(design.reduction.independent), payload_directions(design)
    leaning, factors = _turn_gravity(rig.with_phi(design.to_bodies(theta[:first]))), list[Array]()
    for blocks in each:
        rows = (np.concatenate([x.A, _build_reason_columns(x, first, theta, leaning, payload)], axis=2) for x in blocks)
        factors.append(factor_rows(block._replace(A=A) for block, A in zip(blocks, rows)))
    count = count_effective_rows([block for blocks in each for block in blocks])

    def fit(places: list[int], scale: Array) -> tuple[Array, Array]:
        """Each joint's residual sum of squares, (n,), and each log's own coefficients, (L, r)."""
        width = len(places)
        rows = np.zeros((len(factors), *factors[0].shape[:2], k + width * (len(factors) - 1) + 1))
        for i, R in enumerate(factors):
            rows[i, :, :, :k], rows[i, :, :, -1] = R[:, :, :k], R[:, :, -1]
            if i:
                rows[i, :, :, k + width * (i - 1) : k + width * i] = R[:, :, places]
        joined = np.concatenate(rows, axis=1)
        found = solve_factors(joined, scale).theta
        own = np.zeros((len(factors), width))
        own[1:] = found[k:].reshape(len(factors) - 1, width)
        return np.sum((joined @ np.append(found, -1.0)) ** 2, axis=1), own

    power, _ = fit(list(range(k)), np.ones(rig.n))
    scale = np.sqrt(np.maximum(count, 1.0) / np.maximum(power, 1e-300))
    hypotheses = _list_hypotheses(design, payload.shape[1])
    fits = [fit(one.columns, scale) for one in hypotheses]
    cost = (len(each) - 1) * np.log(max(float(np.sum(count)), 2.0))
    scores = [
        float(count @ np.log(np.maximum(left, 1e-300))) + cost * len(one.columns)
        for one, (left, _) in zip(hypotheses, fits)
    ]
    best = int(np.argmin(scores))
    whole = np.sum([np.sum(R[:, :, -1] ** 2, axis=1) for R in factors], axis=0)
    share = np.sqrt(np.max((fits[0][0] - fits[best][0]) / np.maximum(whole, 1e-300), initial=0.0))
    at = best if scores[0] - scores[best] > STRONG_EVIDENCE else 0
    return hypotheses[at], fits[at][1], bool(share > MATERIAL_SHARE)


def _list_hypotheses(design: Design, payload: int) -> list[_Hypothesis]:
    """List what is weighed, by its columns in ``[A X]``, see `_build_reason_columns`; first that the logs agree."""
    joints, k, first = design.rig.joints, len(design.names), len(design.reduction.independent)
    n, gains = len(joints), len(design.names) + 2
    several = [_Hypothesis(None, "", []), _Hypothesis(DriftReason.HEAT, "", [k, k + 1])]
    several += [
        _Hypothesis(DriftReason.WEAR, joint, [first + 2 * j, first + 2 * j + 1])
        for j, joint in enumerate(joints if n > 1 else ())
    ]
    several += [_Hypothesis(DriftReason.GAIN, joint, [gains + j]) for j, joint in enumerate((*joints, ""))]
    lean, camera = gains + n + 1, gains + n + 3
    if design.reduction.base == "fixed":
        several.append(_Hypothesis(DriftReason.LEAN, "", [lean, lean + 1]))
    several.append(_Hypothesis(DriftReason.PAYLOAD, "", list(range(camera, camera + payload))))
    return [*several, _Hypothesis(DriftReason.UNKNOWN, "", list(range(k)))]


def _turn_gravity(rig: Rig) -> tuple[Rig, Rig]:
    """Return the rig with ``d(Rᵀ g)/d(angle)`` as gravity: per rad that its base leans about x, and about y."""
    leaning = copy_model(rig), copy_model(rig)
    leaning[0].model.gravity.linear = np.array([0.0, -GRAVITY, 0.0])
    leaning[1].model.gravity.linear = np.array([GRAVITY, 0.0, 0.0])
    return leaning


def _build_reason_columns(block: Block, first: int, theta: Array, leaning: tuple[Rig, Rig], payload: Array) -> Array:
    """Columns X of the reasons: Coulomb, viscous, each joint's torque, all torque, lean about x and y, payload.

    Gravity is slow beside the filter: the masked torque is the share of it that was not masked out.

    `first`: place of the first friction coefficient.
    """
    predicted, n = block.A @ theta, block.b.shape[1]
    friction = (slice(first + kind, first + 2 * n, 2) for kind in (0, 1))
    scaled = [block.A[:, :, part] @ theta[part] for part in friction]
    scaled += [predicted * (np.arange(n) == j) for j in range(n)]
    leans = (block.share * compute_gravity(rig, block.q) for rig in leaning)
    return np.concatenate([np.stack([*scaled, predicted, *leans], axis=2), block.A @ payload], axis=2)
