"""A payload that sits elsewhere than its URDF says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from gimbal_pin.effects.rig_effect import RigEffect, payload, with_added
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig


@dataclass(frozen=True)
class PayloadShift(RigEffect):
    """The payload moved by (x, y, z), m, in the frame it is mounted in: forward, left and up on the bundled rigs."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    name: ClassVar[str] = "payload-shift"
    of_joint: ClassVar[bool] = False
    of_given_model: ClassVar[bool] = True
    shapes: ClassVar[tuple[Parameter, ...]] = tuple(Parameter(axis, 0.0, "m", -0.5, 0.5) for axis in "xyz")
    experiment: ClassVar[str] = "all axes at once, the payload turned through as many attitudes as the limits allow"
    lookalikes: ClassVar[tuple[str, ...]] = ("encoder-offset", "base-tilt", "torque-bias", "cable-spring")
    compensation: ClassVar[str] = "slide the payload back by as much, or let the controller use the identified model"

    def apply(self, rig: Rig) -> Rig:
        """Take the payload's inertia out of its body and put it back in at the other place."""
        body, inertia, frame = payload(rig)
        moved = pin.SE3(np.eye(3), frame.rotation @ np.array([self.x, self.y, self.z])).act(inertia)
        return with_added(rig, body, moved.toDynamicParameters() - inertia.toDynamicParameters(), self.name)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return how far to slide it, in millimetres."""
        ways = zip((self.x, self.y, self.z), (("back", "forward"), ("right", "left"), ("down", "up")))
        parts = [f"{1e3 * abs(d):.3g} mm {names[0] if d > 0 else names[1]}" for d, names in ways if d]
        return f"slide the camera {', '.join(parts)}" if parts else "the camera is where it should be"
