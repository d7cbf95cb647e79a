"""Origin of a file that was made for a rig: its schema, and where that rig's joints are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from gimbal_pin.errors import ModelError
from gimbal_pin.rig.records import convert_value
from gimbal_pin.rig.rig import Rig

SCHEMA = 1
"""Schema of model and controller files that are written and read."""
PLACEMENT_TOLERANCE = 1e-3
"""Largest difference of one rig's joint placements in two files, m and rad: numbers are rounded or measured.

With twice the value, rigs have to differ by 2 mm or 2 mrad somewhere before one's model is refused for the other.
"""


def describe_structure(rig: Rig) -> dict[str, list[float]]:
    """Return joint → its frame in the base's where all joints read zero, (3, 4), and its motion in that frame, (6,)."""
    model = rig.stated.model
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(rig.n))
    out = {}
    for j, joint in enumerate(rig.joints, start=1):
        motion = model.joints[j].createData()
        model.joints[j].calc(motion, np.zeros(1))
        out[joint] = [*data.oMi[j].homogeneous[:3].ravel().tolist(), *np.ravel(motion.S).tolist()]
    return out


def check_origin(data: Mapping[str, Any], rig: Rig, place: str) -> None:
    """Raise `ModelError` if a file has another schema, or is of another rig: its joints have other names or placements.

    A file without placements is of an older version: there the rig's name decides.
    """
    if (schema := data.get("schema", SCHEMA)) != SCHEMA:
        raise ModelError(
            f"{place}: schema",
            f"is {schema!r}",
            f"write it with this version, which reads {SCHEMA}",
        )
    name = data.get("rig", rig.name)
    filed = data.get("structure", {} if name == rig.name else None)
    if filed is None:
        raise ModelError(
            place,
            f"is of the rig '{name}', not of '{rig.name}'",
            "give that rig, or make it for this one",
        )
    placements = convert_value(
        Mapping[str, tuple[float, ...]], filed, f"{place}: structure", ModelError
    )
    for joint, here in describe_structure(rig).items() if placements else ():
        there = placements.get(joint, ())
        if len(there) != len(here) or not np.allclose(
            there, here, rtol=0.0, atol=PLACEMENT_TOLERANCE
        ):
            what = f"is of the rig '{name}', whose joint {joint} is placed otherwise than that of '{rig.name}'"
            raise ModelError(place, what, "give that rig, or make it for this one")
