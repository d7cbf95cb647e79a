"""One run of one controller on one platform's motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.log.limited import at_limit
from gimbal_pin.log.log import Array, frozen
from gimbal_pin.pointing.measures import SETTLING, jitter

if TYPE_CHECKING:
    from gimbal_pin.pointing.swinging import Swing


@dataclass(frozen=True, eq=False)
class Pointing:
    """What the camera did.

    Attributes:
        controller: The controller's name.
        platform: "S" or "log".
        seed: Seed of the run.
        joints: Joint names.
        t: Time, s, (N,).
        error: ``log(R_dᵀ R)`` in the camera's frame: about the line of sight, then the two across it, rad, (N, 3).
        q: True angles, rad, (N, n).
        tau: Torque that was commanded for each interval, clipped, N m, (N, n).
        base: Attitude of the platform in the world, (w, x, y, z), (N, 4).
        tau_max: Largest torque of each motor, N m, (n,).
        events: What happened, in sentences.
        swings: Joints whose loops swing by themselves.
    """

    controller: str
    platform: str
    seed: int
    joints: tuple[str, ...]
    t: Array
    error: Array
    q: Array
    tau: Array
    base: Array
    tau_max: Array
    events: tuple[str, ...] = ()
    swings: tuple[Swing, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
        samples, n = len(self.t), len(self.joints)
        for name, shape in (("t", ()), ("error", (3,)), ("q", (n,)), ("tau", (n,)), ("base", (4,))):
            object.__setattr__(self, name, frozen(getattr(self, name), (samples, *shape), f"pointing: {name}"))

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return float(self.t[1] - self.t[0])

    @property
    def counted(self) -> slice:
        """The samples that count: all but the first `SETTLING` s, or the first quarter of a short run."""
        return slice(min(round(SETTLING / self.dt), len(self.t) // 4), None)

    @property
    def sight(self) -> Array:
        """Line-of-sight error of the samples that count, rad, (M, 2)."""
        return self.error[self.counted, 1:]

    @cached_property
    def jitter(self) -> tuple[float, float, float]:
        """Jitter rms, jitter max, drift, rad."""
        return jitter(self.sight, self.dt)

    @property
    def at_limit(self) -> Mapping[str, float]:
        """Joint → share of the samples that count at the motor's limit."""
        return at_limit(self.joints, self.tau[self.counted], self.tau_max)

    @property
    def torque_rms(self) -> Mapping[str, float]:
        """Joint → torque over the samples that count, N m rms."""
        rms = np.sqrt(np.mean(self.tau[self.counted] ** 2, axis=0))
        return dict(zip(self.joints, rms.tolist()))
