"""Causes in the rig itself: its inertias, how it stands, where its encoders read zero."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from gimbal_pin.effects.cause import Cause
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array
from gimbal_pin.rig import Rig


@dataclass(frozen=True)
class RigEffect(Cause):
    """``rig' = apply(rig)``: the rig as it is, from the rig as its URDF says."""

    @abstractmethod
    def apply(self, rig: Rig) -> Rig:
        """Return the rig with this cause in its Pinocchio model; the URDF text stays as it is."""


def with_model(rig: Rig) -> Rig:
    """Return the rig with a copy of its Pinocchio model, free to be changed."""
    return replace(rig, model=rig.model.copy())


def payload(rig: Rig) -> tuple[int, pin.Inertia, pin.SE3]:
    """Return the body (from 0) that carries the payload, the payload's inertia in that joint's frame, and its frame.

    Raises:
        UsageError: No payload is mounted.
    """
    if rig.payload_link is None:
        raise UsageError(f"rig {rig.name}", "carries no payload of its own", "mount one: --payload NAME")
    frames = rig.model.frames
    root = rig.model.getFrameId(rig.payload_link, pin.FrameType.BODY)
    inside = [frames[root].parentFrame, root]
    for index in range(root + 1, len(frames)):
        if frames[index].parentFrame in inside[1:]:
            inside.append(index)
    parts = [frames[index].placement.act(frames[index].inertia) for index in inside if frames[index].inertia.mass > 0]
    return int(frames[root].parentJoint) - 1, sum(parts[1:], parts[0]), frames[root].placement


def with_added(rig: Rig, body: int, phi: Array, owner: str) -> Rig:
    """Return the rig with `phi` (order of `rig.PHI`) added to a body's parameters.

    Raises:
        UsageError: No such body can exist.
    """
    total = rig.phi
    total[10 * body : 10 * body + 10] += phi
    pseudo = pin.PseudoInertia.FromDynamicParameters(total[10 * body : 10 * body + 10]).toMatrix()
    if np.linalg.eigvalsh(pseudo)[0] < -1e-12 * np.trace(pseudo):
        what = f"leaves {rig.links[body]} a mass or inertia that no body can have"
        raise UsageError(owner, what, "give smaller figures")
    return rig.with_phi(total)
