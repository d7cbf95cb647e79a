"""What is wrong with a log, before any physics: one file per cause, each with the fault it finds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from gimbal_pin.checks import (
    acceleration_noise,
    clock,
    commanded_torque,
    controller_formula,
    filtered_velocity,
    outliers,
    stuck_channel,
)
from gimbal_pin.checks.base import Check
from gimbal_pin.checks.base import Fault as Fault
from gimbal_pin.errors import DataError
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig

IN_ORDER = (
    clock,
    stuck_channel,
    outliers,
    controller_formula,
    filtered_velocity,
    commanded_torque,
    acceleration_noise,
)
"""A later check needs what the earlier ones mend: spikes are no noise, and false stamps no spikes.

A controller answers to the rate that it logs, before a filtered one is left out."""

CHECKS: Mapping[str, Check] = MappingProxyType({module.NAME: module.examine for module in IN_ORDER})
"""Every data cause of CONTRACT.md by its name there, in the order in which they are examined."""

FATAL = frozenset({controller_formula.NAME, stuck_channel.NAME})
"""Faults that leave no physics in a log: its torque is a formula of its motion, or is none."""


@dataclass(frozen=True, eq=False)
class Audit:
    """What the audit of one log found.

    Attributes:
        log: The log to go on with: mended as far as the faults found can be.
        faults: What is wrong, in the order of the checks.
    """

    log: Log
    faults: tuple[Fault, ...]

    @property
    def reliable(self) -> bool:
        """Whether a fit of the log as it was recorded shows physics."""
        return not any(fault.makes_physics_unreliable for fault in self.faults)

    @property
    def usable(self) -> bool:
        """Whether the mended log may show some physics, though not all of it: noisy inertias spoil no cogging map."""
        return not any(fault.makes_physics_unreliable and fault.cause in FATAL for fault in self.faults)

    @property
    def spared(self) -> Audit:
        """The audit of a log that is only judged and never fitted: that its true samples lie far apart is no harm."""
        faults = tuple(replace(f, makes_physics_unreliable=False) if f.sparse else f for f in self.faults)
        return replace(self, faults=faults)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about what does no harm."""
        return tuple(fault.sentence for fault in self.faults if not fault.makes_physics_unreliable)


def audit(rig: Rig, log: Log, *, filtering: Filtering | None = None) -> Audit:
    """Examine a log with every check, each on what the checks before it have mended.

    Args:
        rig: The rig.
        log: One trajectory with torque.
        filtering: The filter of the fit that faults are judged by; None: the default.

    Raises:
        DataError: It has one sample.
    """
    if len(log) < 2:
        raise DataError(log.name, "has one sample, which shows no motion", "record at least 10 s of motion")
    faults = []
    for check in CHECKS.values():
        examined = check(rig, log, filtering or Filtering())
        if examined is not None:
            faults.append(examined.fault.in_units(rig))
            log = examined.log
    return Audit(log, tuple(faults))
