"""Logs that are refused: nothing was measured, in another unit, or far too seldom."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from gimbal_pin.errors import DataError, LogError, UsageError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import HIGHEST_CUTOFF, Block, Design, Filtering, Flags
from gimbal_pin.rig.rig import Rig

LONGEST_INTERVAL = 0.2
"""Longest sampling interval of a rig's log, s; beyond, milliseconds were taken for seconds."""
SHORTEST_INTERVAL = 2e-5
"""Shortest, s: drives' current loops run at 50 kHz at most; below, t has another unit."""
WRONG_UNIT = 20.0
"""Times the motor's limit, rms, that no torque is: a motor's short-time torque is some five times what it holds, and a
torque in thousandths of its unit is a thousand times too large."""
BALANCED_SHARE = 0.5
"""Share of its largest term that the terms of a joint without a motor leave at most: URDFs are wrong by less."""
NEGLIGIBLE_TORQUE = 1e-12
"""A torque of less, N m, is none: a millionth of a gram weighs as much a tenth of a millimetre beside its axis."""


def refuse_unusable(rig: Rig, log: Log, filtering: Filtering) -> None:
    """Raise what tells that nothing can be made of a log, or that this filter cannot be run over it.

    Raises:
        DataError: It has one sample, or torques of zero.
        LogError: Its samples lie too far apart, or a torque is in another unit.
        UsageError: The cutoff leaves nothing to remove.
    """
    if len(log) < 2:
        raise DataError(
            log.name, "has one sample, which shows no motion", "record at least 10 s of motion"
        )
    check_sampling(log.name, log.dt, filtering.cutoff)
    if log.tau is not None:
        torque = np.abs(log.tau).max(axis=0)
        check_driven(
            log.name, log.joints, torque, np.full(len(torque), torque.max() < NEGLIGIBLE_TORQUE)
        )
        check_unit(rig, log)


def check_driven(place: str, joints: Sequence[str], torque: Array, moving: Flags) -> None:
    """Raise `DataError` if a joint's torque is none while it moves: parameters of zero would explain it perfectly.

    Args:
        place: What the error names.
        joints: Names of the joints.
        torque: Largest torque of each, N m, (n,).
        moving: Whether it moves and needs a motor for that, (n,).
    """
    silent = torque < NEGLIGIBLE_TORQUE
    if (moving & silent).any():
        name = joints[int(np.argmax(moving & silent))]
        one = f"tau_{name} is zero all along, while {name} moves"
        what = "its torques are zero at every joint" if silent.all() else one
        raise DataError(place, what, "log what the drives report or were commanded, in N m")


def find_driven(design: Design, blocks: Iterable[Block]) -> Flags:
    """Return which of the joints with a torque of zero cannot move as they do without a motor, (n,).

    The terms ``A_k x_k`` of a joint without a motor, x those of the URDF's bodies, balance each other: the weight of a
    pendulum its inertia, say.
    """
    coefficients = design.mixing @ design.rig.phi
    terms = [block.A[:, :, : len(coefficients)] * coefficients for block in blocks]
    left = np.sum([np.sum(block.b**2, axis=0) for block in blocks], axis=0)
    each = np.sum([np.sum(x**2, axis=0) for x in terms], axis=0)
    return np.asarray(left > BALANCED_SHARE**2 * each.max(axis=1))


def check_unit(rig: Rig, log: Log) -> None:
    """Raise `LogError` if a torque is so many times its motor's limit that it can only be in another unit."""
    if log.tau is None:
        return
    ratio = np.sqrt(np.mean(log.tau**2, axis=0)) / rig.tau_max
    if not np.any(ratio > WRONG_UNIT):
        return
    # Beside such a torque, every one that no motor holds has its unit, too.
    names = [f"tau_{joint}" for joint, share in zip(rig.joints, ratio.tolist()) if share > 1.0]
    # A column that is mapped with a factor has its torque constant in it.
    has_constant = [name in log.sources and abs(log.sources[name].factor) != 1.0 for name in names]
    maps = log.remapped({name: (name, 1e-3) for name in names})
    most = float(ratio.max())
    limit = float(rig.tau_max[ratio.argmax()])
    what = f"is {most:.2g} times the motor's {limit:.3g} N m, rms: another unit, mA or mN m say"
    joint = rig.joints[int(ratio.argmax())]
    unit = "if its current is in mA" if all(has_constant) else "from mN m, times KT from mA"
    mend = f"map it: {maps} {rig.in_units(joint, unit)}"
    raise LogError(f"{log.name}: {', '.join(names)}", rig.in_units(joint, what), mend)


def check_sampling(name: str, dt: float, cutoff: float) -> None:
    """Raise what `check_log` raises, for a sampling interval, s, and a cutoff, Hz."""
    if dt > LONGEST_INTERVAL:
        mend = "if t is in ms, map it: --map t=COLUMN*1e-3; else record twenty samples a second or more"
        raise LogError(
            name, f"has {dt:.3g} s between two samples, too long to see a rig move", mend
        )
    if dt < SHORTEST_INTERVAL:
        mend = "if t has another unit, map it: --map t=COLUMN*FACTOR; else keep every tenth sample or fewer"
        raise LogError(name, f"has {dt:.3g} s between two samples, too short for a drive", mend)
    if cutoff * dt > 1.000001 * HIGHEST_CUTOFF:
        what = f"of {cutoff:g} Hz is too high for {1 / dt:.0f} samples a second"
        raise UsageError(f"{name}: the cutoff", what, f"give at most {HIGHEST_CUTOFF / dt:.3g} Hz")
