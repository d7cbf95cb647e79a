"""What is wrong with a log, before any physics: one file per cause, each with the fault it finds and can plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from gimbal_pin.diagnosis.audit.acceleration_noise import AccelerationNoise
from gimbal_pin.diagnosis.audit.base import Check, Fault
from gimbal_pin.diagnosis.audit.clock import Clock
from gimbal_pin.diagnosis.audit.commanded_torque import CommandedTorque
from gimbal_pin.diagnosis.audit.filtered_velocity import FilteredVelocity
from gimbal_pin.diagnosis.audit.outliers import Outliers
from gimbal_pin.diagnosis.audit.quantisation import Resolution, resolutions
from gimbal_pin.diagnosis.audit.stuck_channel import StuckChannel
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig

IN_ORDER: tuple[Check, ...] = (
    Clock(),
    StuckChannel(),
    Outliers(),
    FilteredVelocity(),
    CommandedTorque(),
    AccelerationNoise(),
)
"""A later check needs what the earlier ones mend: spikes are no noise, and false stamps no spikes."""

CHECKS: Mapping[str, Check] = MappingProxyType({check.name: check for check in IN_ORDER})
"""Every data cause of CONTRACT.md by its name there, in the order in which they are examined."""


@dataclass(frozen=True, eq=False)
class Audit:
    """What the audit of one log found.

    Attributes:
        log: The log to go on with: mended as far as the faults found can be.
        faults: Findings and notes, in the order of the checks.
        resolution: Step sizes of every joint's channels.
    """

    log: Log
    faults: tuple[Fault, ...]
    resolution: tuple[Resolution, ...]

    @property
    def reliable(self) -> bool:
        """Whether a fit of the log as it was recorded shows physics."""
        return not any(fault.makes_physics_unreliable for fault in self.faults)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about what does no harm: harmless faults, coarse encoders."""
        harmless = [fault.sentence for fault in self.faults if not fault.makes_physics_unreliable]
        return (*harmless, *(each.sentence for each in self.resolution if each.sentence))


def audit(rig: Rig, log: Log) -> Audit:
    """Examine a log with every check, each on what the checks before it have mended.

    Args:
        rig: The rig.
        log: One trajectory with torque.
    """
    faults: list[Fault] = []
    going = log
    for check in IN_ORDER:
        fault = check.examine(rig, going)
        if fault is not None:
            faults.append(fault)
            going = fault.mended or going
    return Audit(going, tuple(faults), resolutions(log))


__all__ = ["CHECKS", "Audit", "Check", "Fault", "Resolution", "audit", "resolutions"]
