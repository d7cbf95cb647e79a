"""How well a model predicts torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.errors import DataError, digits
from gimbal_pin.estimation.identification.seen import FAINT
from gimbal_pin.estimation.rows import Block
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class Accuracy:
    """How well a model predicts the filtered torque of some rows.

    Attributes:
        how: Which rows.
        torque_rmse: Joint → root mean square error, N m, over all samples but those near standstill.
        fit_percent: Joint → ``100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖)`` (THESIS 4.28), over the same samples; nan where the torque
            does not change.
        used: Joint → share of the rows that were used; the rest is near standstill, where a joint's motion does not
            tell its torque.
    """

    how: str
    torque_rmse: Mapping[str, float]
    fit_percent: Mapping[str, float]
    used: Mapping[str, float]

    def __str__(self) -> str:
        """One line: every joint's error and fit."""
        each = (f"{j} {error:.3g} N m ({digits(self.fit_percent[j], 4)} %)" for j, error in self.torque_rmse.items())
        return f"{self.how}: torque error rms (fit)  {', '.join(each)}"


def accuracy(joints: Sequence[str], blocks: Sequence[Block], theta: Array, how: str) -> Accuracy:
    """Compare predicted and measured filtered torque; `DataError` if there is no row to compare."""
    if not blocks:
        raise DataError("held-out part", "is shorter than the filters' memory", "hold out more, or use --holdout none")
    measured, share = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("b", "share"))
    error = measured - np.concatenate([block.A @ theta for block in blocks])
    rows = np.maximum(np.sum(share**2, axis=0), 1e-300)
    rmse = np.sqrt(np.sum(error**2, axis=0) / rows)
    mean = np.sum(measured * share, axis=0) / rows
    spread = np.linalg.norm(measured - mean * share, axis=0)
    fit = 100 * (1 - np.linalg.norm(error, axis=0) / np.where(spread > FAINT * np.sqrt(rows), spread, np.nan))
    used = np.mean(share**2, axis=0)
    return Accuracy(how, *(dict(zip(joints, values.tolist())) for values in (rmse, fit, used)))
