"""What is refused of rows: too few of them, and parameters that leave no trace in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.checks.refusals import NEGLIGIBLE_TORQUE, check_driven, find_driven
from gimbal_pin.errors import DataError
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Block, Design, DesignBlocks, Estimate, compute_settling_time

LEAST_MOVING = 0.1
"""Share of a joint's samples under which the error says that the others were masked out."""


def check_enough(blocks: DesignBlocks) -> None:
    """Raise `DataError` if there are fewer rows than three per parameter, or a joint moves without a torque."""
    design = blocks.design
    name = blocks.design.logs[0].name
    have = sum(block.b.size for block in blocks)
    want = 3 * len(design.names)
    if have < want:
        seconds = max(float(np.ptp(log.t)) if len(log) else 0.0 for log in design.logs)
        what = f"{seconds:.3g} s leave {have} filtered rows for {len(design.names)} parameters; they cannot show any of"
        need = want / design.rig.n / (2 * design.filtering.cutoff) + 2 * compute_settling_time(
            design.filtering
        )
        raise DataError(
            name, what, f"record at least {max(need * 2, 10):.0f} s of motion", design.names
        )
    check_motors(name, design, blocks)


def check_motors(name: str, design: Design, blocks: Sequence[Block]) -> None:
    """Raise `DataError` if the torques of all joints are zero, or that of one which needs a motor to move as it does.

    Another whose torque is zero all along has none, and its rows ``0 = A theta`` are as good as any.
    """
    torque = np.max([np.abs(block.b).max(axis=0, initial=0.0) for block in blocks], axis=0)
    balanced = [j for j in design.undriven if not find_driven(design, blocks)[j]]
    torque[list(design.undriven)] = 0.0
    is_moving = compute_used_shares(blocks) > LEAST_MOVING
    is_moving[balanced] = False
    check_driven(name, design.rig.joints, torque, is_moving)


def check_seen(
    place: str, names: Sequence[str], blocks: Sequence[Block], estimate: Estimate
) -> None:
    """Raise `DataError` with the parameters whose uncertainty alone moves more torque than the whole log has."""
    if hidden := find_unseen(names, blocks, estimate):
        raise DataError(place, *_explain_hidden(blocks), hidden)


def _explain_hidden(blocks: Sequence[Block]) -> tuple[str, str]:
    """Say why parameters leave no trace, and what to do: too little motion, or more noise than motion."""
    kept = compute_used_shares(blocks).min()
    if kept >= LEAST_MOVING:
        return (
            "its motion leaves no trace of",
            "move every joint, several at a time: see 'gimbal-pin excite'",
        )
    what = f"no faster than their rate's noise, or still, are all but {100 * kept:.2g} % of a joint's samples"
    mend = "move every joint, all the time: see 'gimbal-pin excite'; or record finer angles, or rates (dq_)"
    return f"{what}; the rest leaves no trace of", mend


def compute_used_shares(blocks: Sequence[Block]) -> Array:
    """Return the share of each joint's samples that tell which way it turns, (n,)."""
    return np.asarray(np.mean(np.concatenate([block.share for block in blocks]) ** 2, axis=0))


def find_unseen(
    names: Sequence[str], blocks: Sequence[Block], estimate: Estimate
) -> tuple[str, ...]:
    """Return the parameters whose uncertainty alone moves more torque than the whole log has."""
    power = np.mean([np.mean(block.A**2, axis=0) for block in blocks], axis=0)
    torque = np.sqrt(np.mean([np.mean(block.b**2, axis=0) for block in blocks], axis=0))
    reach = np.where(power.sum(axis=0) > 0, np.sqrt(power).max(axis=0), 0.0)
    std = np.where(np.isfinite(estimate.std), estimate.std, np.inf)
    blind = (reach == 0) | (std * np.maximum(reach, 1e-300) > torque.max())
    return tuple(
        name for name, hidden in zip(names, blind) if hidden or torque.max() < NEGLIGIBLE_TORQUE
    )
