"""The one function that may alter a log's data between its reading and its samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from gimbal_pin.checks.acceleration_noise import check_acceleration_noise
from gimbal_pin.checks.calibration import Mounting, correct_imus, estimate_joint_rates
from gimbal_pin.checks.clock import check_clock
from gimbal_pin.checks.commanded_torque import check_commanded_torque
from gimbal_pin.checks.controller_formula import check_controller_formula
from gimbal_pin.checks.filtered_velocity import check_filtered_velocity
from gimbal_pin.checks.outliers import check_outliers
from gimbal_pin.checks.record import Alteration, Check, Fault, compare_logs
from gimbal_pin.checks.refusals import refuse_unusable
from gimbal_pin.checks.stuck_channel import check_stuck_channel
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Filtering, limit_cutoff, subsample_log
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

CHECKS: Mapping[str, Check] = MappingProxyType(
    {
        "clock": check_clock,
        "stuck-channel": check_stuck_channel,
        "outliers": check_outliers,
        "controller-formula": check_controller_formula,
        "filtered-velocity": check_filtered_velocity,
        "commanded-torque": check_commanded_torque,
        "acceleration-noise": check_acceleration_noise,
    }
)
"""Data causes by their public names, in the order in which they are examined.

A later check needs what the earlier ones mend: spikes are no noise, and false stamps no spikes. A controller answers to
the rate that it logs, before a filtered one is left out."""

FATAL = frozenset({"controller-formula", "stuck-channel"})
"""Faults that leave no physics in a log: its torque is a formula of its motion, or is none."""
CHECKS_WITHOUT_REPAIR = frozenset({"controller-formula", "acceleration-noise"})
"""Checks that mend nothing: who asks for repairs alone is spared them."""


@dataclass(frozen=True, eq=False)
class CheckedLog:
    """A log to go on with, what was altered in it, and what is wrong with it.

    Attributes:
        log: The log, mended as far as the faults found can be; the very log that was given where nothing was altered.
        alterations: What was altered, in the order in which it was done.
        faults: What is wrong with the log as it was recorded, in the order of the checks.
        mountings: Link → its IMU's misalignment and gyro bias.
    """

    log: Log
    alterations: tuple[Alteration, ...]
    faults: tuple[Fault, ...]
    mountings: Mapping[str, Mounting]

    __repr__ = brief

    @property
    def is_reliable(self) -> bool:
        """Whether a fit of the log as it was recorded shows physics."""
        return not any(fault.makes_physics_unreliable for fault in self.faults)

    @property
    def is_usable(self) -> bool:
        """Whether the mended log may show some physics, though not all of it: noisy inertias spoil no cogging map."""
        return not any(
            fault.makes_physics_unreliable and fault.cause in FATAL for fault in self.faults
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about what does no harm."""
        return tuple(fault.sentence for fault in self.faults if not fault.makes_physics_unreliable)


def collect_alterations(checked: Sequence[CheckedLog]) -> dict[str, tuple[Alteration, ...]]:
    """Return log → what was altered in it, for those where something was."""
    return {one.log.name: one.alterations for one in checked if one.alterations}


def check_log(
    rig: Rig, log: Log, *, filtering: Filtering | None = None, repairs_only: bool = False
) -> CheckedLog:
    """Refuse a log that nothing can be made of; mend what is wrong with another, and say what was altered and why.

    Nothing else alters data between the reading of a log and its samples, where short gaps are filled for the filters
    alone (`regression.split_segments`). First the sensors are made to agree: IMUs are turned into their links' axes,
    and rates that are missing come from the gyros. Then `CHECKS` follow, each on what those before it have mended. Of a
    long log they see an excerpt first, and the whole only where that has something to mend.

    A log that was returned is returned as it is.

    Args:
        rig: The rig.
        log: One trajectory with torque.
        filtering: The filter that will be run over the log; None: the default.
        repairs_only: Leave out the checks that alter nothing.

    Raises:
        DataError: It has one sample or no torque, or a joint moves without any.
        LogError: It lacks a joint of the rig, a torque is in another unit, or samples lie too far apart.
        UsageError: The filter's cutoff leaves nothing to remove.
    """
    log = log.ordered(rig)
    refuse_unusable(rig, log, filtering or limit_cutoff(Filtering(), [log]))
    imus, mountings = correct_imus(rig, log)
    steps = [*imus]
    latest = steps[-1][1] if steps else log
    if latest.v is None and (rates := estimate_joint_rates(rig, latest)) is not None:
        latest = replace(latest, v=rates)
        steps.append(("rates-from-gyros", latest))
    faults, repairs = _examine(rig, subsample_log(latest).log, repairs_only)
    if repairs and subsample_log(latest).log is not latest:
        faults, repairs = _examine(rig, latest, repairs_only)
    steps += repairs
    before = log
    alterations = list[Alteration]()
    for cause, after in steps:
        alterations += compare_logs(rig, cause, before, after)
        before = after
    return CheckedLog(before, tuple(alterations), faults, mountings)


def _examine(
    rig: Rig, log: Log, repairs_only: bool
) -> tuple[tuple[Fault, ...], list[tuple[str, Log]]]:
    """Return the faults that the checks find, and the log after each repair with the check that asks for it."""
    faults = list[Fault]()
    repairs = list[tuple[str, Log]]()
    for name, check in CHECKS.items():
        latest = repairs[-1][1] if repairs else log
        if repairs_only and name in CHECKS_WITHOUT_REPAIR:
            continue
        examined = check(rig, latest, limit_cutoff(Filtering(), [latest]))
        if examined is not None:
            faults.append(examined.fault.in_units(rig))
            repairs += [(name, repaired) for repaired in examined.repairs]
    return tuple(faults), repairs
