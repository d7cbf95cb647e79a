"""Whether a model predicts what it was not fitted to: ``F = rmse² / rmse'²`` over independent rows, at one per cent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import isnan

import numpy as np
from scipy.special import fdtri

from gimbal_pin.checks.refusals import NEGLIGIBLE_TORQUE
from gimbal_pin.dynamics.model import Doubt
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array
from gimbal_pin.regression import (
    FORM_ERROR,
    STRUCTURED,
    Block,
    Misfit,
    compute_autocovariance,
    count_independent_rows,
    join_blocks,
)
from gimbal_pin.rig.brief import brief

POOR_FIT = 50.0
"""Held-out fit, %, up to which no joint counts as explained: the model leaves half of the torque, or more. At twice the
value, none would; at half of it, a model may leave three quarters of the torque."""
LEAST_JUDGED_SHARE = 1e-3
"""Least share of a joint's samples away from standstill from which its torque is judged."""
EXPLAINED = 90.0
"""Held-out fit, %, from which a joint's misfit is a matter of accuracy: a tenth of the torque's deviation is what rigid
bodies with dry and viscous friction leave of a real arm (double pendulum: 0.18 of 1.8 N m)."""
UNEXPLAINED_SHARE = 0.5
"""Share of what is left, as power, from which a poor fit is for want of a formula, not for noise."""
CERTAINTY = 0.99
"""Certainty with which an error is called greater than another."""
OVERFITTED = 2.0
"""Held-out error over the training part's: ``√((1 + x)/(1 - x))`` of a fit with x coefficients per row, x = 0.6."""


class Opinion(str, Enum):
    """State of a joint's torque beside a model; `identify` and `diagnose` state no other.

    `EXPLAINED`: the fit is above `EXPLAINED`, and the rest looks like noise. `NOISE_LEFT`: the rest looks like noise
    and is larger than that. `STRUCTURE_LEFT`: a function of the motion predicts some of the rest. `NOT_EXPLAINED`: it
    predicts more than a matter of accuracy, the fit is at most `POOR_FIT`, or fitting made the error larger than that
    of a simpler model. `NOT_JUDGED`: the torque does not change, or the joint hardly moves.
    """

    EXPLAINED = "explained"
    NOISE_LEFT = "noise left"
    STRUCTURE_LEFT = "structure left"
    NOT_EXPLAINED = "not explained"
    NOT_JUDGED = "not judged"

    @property
    def is_open(self) -> bool:
        """Whether something is left that is not known to be noise."""
        return self in (Opinion.STRUCTURE_LEFT, Opinion.NOT_EXPLAINED)


def is_degraded(fit: float, simpler: float) -> bool:
    """Return whether a fit, %, is materially below a simpler model's on unseen rows.

    ``√((100 - fit)² - (100 - simpler)²) > 100 - EXPLAINED``: what fitting added to the error is more than a matter of
    accuracy.
    """
    return max((100 - fit) ** 2 - (100 - simpler) ** 2, 0.0) ** 0.5 > 100 - EXPLAINED


def judge_joint(
    fit: float, used: float, structured: bool, lacks_form: bool, is_worse: bool
) -> Opinion:
    """Return the state of a joint's torque.

    Args:
        fit: Of the torque, %; nan where it does not change.
        used: Share of the joint's samples away from standstill.
        structured: Whether a function of the motion predicts some of what is left.
        lacks_form: Whether it predicts most of it.
        is_worse: Whether a simpler model fits better, see `is_degraded`.
    """
    if isnan(fit) or used < LEAST_JUDGED_SHARE:
        return Opinion.NOT_JUDGED
    is_accurate = fit > EXPLAINED
    if fit <= POOR_FIT or is_worse or (structured and lacks_form and not is_accurate):
        return Opinion.NOT_EXPLAINED
    if structured:
        return Opinion.STRUCTURE_LEFT
    return Opinion.EXPLAINED if is_accurate else Opinion.NOISE_LEFT


@dataclass(frozen=True)
class Accuracy:
    """How well a model predicts the filtered torque of some rows.

    Attributes:
        how: Which rows.
        torque_rmse: Joint → root mean square error, N m, over all samples but those near standstill.
        fit_percent: Joint → ``100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖)`` (thesis 4.28), over the same samples; nan where the torque
            does not change.
        used: Joint → share of the rows that were used; the rest is near standstill, where a joint's motion does not
            tell its torque.
        effective_rows: Joint → independent rows that tell its error as well: ``N / Σ ρ²`` over the lags of the
            error's autocorrelation ρ.
    """

    how: str
    torque_rmse: Mapping[str, float]
    fit_percent: Mapping[str, float]
    used: Mapping[str, float]
    effective_rows: Mapping[str, float]

    __repr__ = brief

    def __str__(self) -> str:
        """One line: every joint's error and fit."""
        each = (
            f"{j} {error:.3g} N m ({digits(self.fit_percent[j], 4)} %)"
            for j, error in self.torque_rmse.items()
        )
        return f"{self.how}: torque error rms (fit)  {', '.join(each)}"

    def judge(self, joint: str, missed: Misfit, simpler: Sequence[Accuracy] = ()) -> Opinion:
        """Return the state of a joint's torque.

        Args:
            joint: Its name.
            missed: What a flexible function of its motion predicts of what the model leaves.
            simpler: Accuracies of simpler models on the same rows.
        """
        fit = self.fit_percent[joint]
        torque = self.torque_rmse[joint] / max(1.0 - fit / 100.0, 1e-9)
        structured = missed.share > STRUCTURED and missed.size > FORM_ERROR * torque
        is_worse = any(is_degraded(fit, one.fit_percent[joint]) for one in simpler)
        return judge_joint(
            fit, self.used[joint], structured, missed.share > UNEXPLAINED_SHARE, is_worse
        )

    def exceeds(self, other: Accuracy, joint: str, ratio: float = 1.0) -> bool:
        """Whether the error at a joint is surely more than so many times the other's."""
        mine, others = (max(one.effective_rows[joint], 1.0) for one in (self, other))
        least = ratio * other.torque_rmse[joint] * np.sqrt(fdtri(mine, others, CERTAINTY))
        return bool(self.torque_rmse[joint] > least)


def measure_accuracy(
    joints: Sequence[str], blocks: Sequence[Block], theta: Array, how: str
) -> Accuracy:
    """Compare predicted and measured filtered torque of at least one block."""
    whole = join_blocks(blocks)
    errors = [block.b - block.A @ theta for block in whole]
    measured, share = (
        np.concatenate([getattr(block, name) for block in whole]) for name in ("b", "share")
    )
    error = np.concatenate(errors)
    rows = np.maximum(np.sum(share**2, axis=0), 1e-300)
    rmse = np.sqrt(np.sum(error**2, axis=0) / rows)
    mean = np.sum(measured * share, axis=0) / rows
    spread = np.linalg.norm(measured - mean * share, axis=0)
    fit = 100 * (
        1
        - np.linalg.norm(error, axis=0)
        / np.where(spread > NEGLIGIBLE_TORQUE * np.sqrt(rows), spread, np.nan)
    )
    used = np.mean(share**2, axis=0)
    lags = compute_autocovariance(errors, [block.share for block in whole])
    effective = count_independent_rows(lags, rows)
    return Accuracy(
        how, *(dict(zip(joints, values.tolist())) for values in (rmse, fit, used, effective))
    )


@dataclass(frozen=True)
class Validation:
    """A model's accuracy on the rows that were fitted, and on those that were not."""

    train: Accuracy
    held_out: Accuracy

    def overfitted(self, joint: str) -> bool:
        """Whether a joint is explained in the rows that were fitted only."""
        unexplained = self.held_out.fit_percent[joint] < EXPLAINED
        return unexplained and self.held_out.exceeds(self.train, joint, OVERFITTED)

    def holds_beside(self, plain: Validation, joint: str) -> bool:
        """Whether what a joint has beyond a plain model holds for rows that were not fitted.

        It does not where it makes their error greater, nor where it alone is overfitted and makes their error no less.
        """
        alone = self.overfitted(joint) and not plain.overfitted(joint)
        useless = not plain.held_out.exceeds(self.held_out, joint)
        return not (self.held_out.exceeds(plain.held_out, joint) or (alone and useless))

    def doubts(self) -> Iterator[Doubt]:
        """Yield the joints whose torque is known in the rows that were fitted only."""
        for joint in self.train.torque_rmse:
            if self.overfitted(joint):
                yield Doubt(
                    joint,
                    f"{self.fits(joint)}: it holds for nothing but what it was fitted to",
                    True,
                )

    def fits(self, joint: str) -> str:
        """Return how well each part is fitted, in words."""
        one, other = (digits(each.fit_percent[joint], 3) for each in (self.train, self.held_out))
        return f"the model fits its training part to {one} %, the held-out part to {other} %"
