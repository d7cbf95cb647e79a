"""A payload that sits elsewhere than its URDF says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.rig_effect import (
    RigEffect,
    build_place_parameters,
    describe_way,
    find_camera_axes,
    get_payload,
    replace_payload,
    shift_inertia,
)
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True)
class PayloadShift(RigEffect):
    """The payload moved by (x, y, z), m, in the frame it is mounted in: forward, left and up on the bundled rigs."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    name: ClassVar[str] = "payload-shift"
    of_joint: ClassVar[bool] = False
    of_given_model: ClassVar[bool] = True
    shapes: ClassVar[tuple[Parameter, ...]] = build_place_parameters(
        "how far the centre of mass is from the URDF's, along the payload's frame"
    )
    experiment: ClassVar[str] = (
        "all axes at once, the payload turned through as many attitudes as the limits allow"
    )
    compensation: ClassVar[str] = (
        "correct the payload's URDF, or let the controller use the identified model"
    )

    def apply(self, rig: Rig) -> Rig:
        """Take the payload's inertia out of its body and put it back in at the other place."""
        _, inertia, frame = get_payload(rig)
        return replace_payload(
            rig, shift_inertia(inertia, frame, np.array([self.x, self.y, self.z])), self.name
        )

    def told(self, rig: Rig) -> str:
        """Say it in the camera's own directions, however its frame is turned."""
        _, _, frame = get_payload(rig)
        way = find_camera_axes(rig).T @ frame.rotation @ np.array([self.x, self.y, self.z])
        return f"{self.place}: {self.name}, {_describe_shift(way)}"

    def says(self, values: Sequence[float] = ()) -> str:
        """Return where it sits, in millimetres."""
        return _describe_shift(np.array([self.x, self.y, self.z]))


def _describe_shift(way: Array) -> str:
    """Say where a payload sits that is so many metres forward, left and up of its place, (3,)."""
    said = describe_way(way)
    return (
        f"the payload sits {said} of where its URDF says"
        if said
        else "the payload sits where its URDF says"
    )
