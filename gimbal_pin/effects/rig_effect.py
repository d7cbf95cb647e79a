"""Causes in the rig itself: its inertias, how it stands, where its encoders read zero."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.rig import Rig

DIRECTIONS = (("forward", "back"), ("left", "right"), ("up", "down"))
"""Directions of a camera along its axes and against them."""


@dataclass(frozen=True)
class RigEffect(Cause):
    """``rig' = apply(rig)``: the rig as it is, from the rig as its URDF says."""

    @abstractmethod
    def apply(self, rig: Rig) -> Rig:
        """Return the rig with this cause in its Pinocchio model; the URDF text stays as it is."""

    def carried(self, t: Array, platform: Platform | None) -> Platform | None:
        """Return how the base moves with this cause at the times t, s, (N,), from how it moves without; None: not."""
        return platform

    @property
    def angle(self) -> float:
        """How far it turns something, rad: from some hundredths on its torque is no more in proportion to its size."""
        return max(abs(float(getattr(self, shape.name))) for shape in self.shapes)

    @classmethod
    def forms(cls, rig: Rig) -> tuple[Mapping[str, float], ...]:
        """Return the forms in which a fit looks for it in a rig: figures that are free, each with where it starts."""
        return ({shape.name: 0.0 for shape in cls.shapes},)

    def plausible(self, rig: Rig) -> bool:
        """Whether a rig could be so."""
        return True

    def told(self, rig: Rig) -> str:
        """``rig: payload-shift, … 4.2 mm forward of where its URDF says``, in directions that no frame turns."""
        return self.sentence()


def build_place_parameters(meaning: str) -> tuple[Parameter, ...]:
    """x, y and z, m, of a place in the frame in which the payload is mounted."""
    return tuple(Parameter(axis, 0.0, "m", -0.5, 0.5, meaning=meaning) for axis in "xyz")


def copy_model(rig: Rig) -> Rig:
    """Return the rig with a copy of its Pinocchio model, free to be changed."""
    return replace(rig, model=rig.model.copy())


def get_payload(rig: Rig) -> tuple[int, pin.Inertia, pin.SE3]:
    """Return the body (from 0) that carries the payload, the payload's inertia in that joint's frame, and its frame.

    A rig without a payload of its own carries one all the same: see `find_payload_link`.

    Raises:
        UsageError: Nothing with a mass is mounted.
    """
    root = rig.model.getFrameId(find_payload_link(rig), pin.FrameType.BODY)
    frame = rig.model.frames[root]
    body = int(rig.model.frames[root].parentJoint)
    if find_payload_link(rig) in rig.links:
        return body - 1, rig.model.inertias[body], frame.placement
    inertia = compute_fixed_inertia(rig, root)
    if not inertia.mass > 0:
        raise UsageError(
            f"rig {rig.name}", "carries no payload of its own", "mount one: --payload NAME"
        )
    return body - 1, inertia, frame.placement


def compute_gyration_radius(inertia: pin.Inertia) -> float:
    """Radius of gyration about the centre of mass, m: ``√(tr I/2m)``."""
    return float(np.sqrt(np.trace(inertia.inertia) / 2 / inertia.mass))


def find_payload_link(rig: Rig) -> str:
    """Return the link that is the payload: the mounted one's root, else what is fixed to the link that aims the camera.

    Of several links that are fixed there the heaviest is meant, with all that hangs on it; where none has a mass of its
    own, the moving link as a whole.
    """
    if rig.payload_link is not None:
        return rig.payload_link
    body = (
        rig.model.frames[rig.model.getFrameId(rig.camera_frame, pin.FrameType.BODY)].parentJoint
        or rig.n
    )
    own = rig.model.getFrameId(rig.links[body - 1], pin.FrameType.BODY)
    fixed = [
        k
        for k, frame in enumerate(rig.model.frames)
        if k != own and frame.type == pin.FrameType.BODY
    ]
    here = [
        k
        for k in fixed
        if rig.model.frames[k].parentJoint == body and _find_parent_frame(rig, k) == own
    ]
    heaviest = max(here, key=lambda k: float(compute_fixed_inertia(rig, k).mass), default=own)
    massive = heaviest != own and compute_fixed_inertia(rig, heaviest).mass > 0
    return str(rig.model.frames[heaviest if massive else own].name)


def _find_parent_frame(rig: Rig, link: int) -> int:
    """Return the frame of the link that a link's frame is fixed to."""
    return int(rig.model.frames[rig.model.frames[link].parentFrame].parentFrame)


def compute_fixed_inertia(rig: Rig, root: int) -> pin.Inertia:
    """Return the inertia of a fixed link and of all that hangs on it, in the frame of the joint that moves it."""
    inside = [rig.model.frames[index] for index in find_fixed_frames(rig, root)]
    parts = [frame.placement.act(frame.inertia) for frame in inside if frame.inertia.mass > 0]
    return sum(parts[1:], parts[0]) if parts else pin.Inertia.Zero()


def find_fixed_frames(rig: Rig, root: int) -> list[int]:
    """Return the frames that hold the inertia of a fixed link and of all that hangs on it."""
    frames = rig.model.frames
    inside = [frames[root].parentFrame, root]
    for index in range(root + 1, len(frames)):
        if frames[index].parentFrame in inside[1:]:
            inside.append(index)
    return inside


def replace_payload(rig: Rig, inertia: pin.Inertia, owner: str) -> Rig:
    """Return the rig with another inertia of its payload, in the frame of the joint that carries it.

    Its frames hold it, too, so that `get_payload` returns it: what changes the payload next changes this one.

    Raises:
        UsageError: No such payload, or no such body that carries it, can exist.
    """
    if not inertia.mass > 0:
        raise UsageError(
            owner, "leaves the payload a mass that no body can have", "give smaller figures"
        )
    body, before, _ = get_payload(rig)
    changed = add_to_body(
        rig, body, inertia.toDynamicParameters() - before.toDynamicParameters(), owner
    )
    if find_payload_link(rig) not in rig.links:
        frames = changed.model.frames
        root = rig.model.getFrameId(find_payload_link(rig), pin.FrameType.BODY)
        for index in find_fixed_frames(rig, root):
            frames[index].inertia = pin.Inertia.Zero()
        frames[root].inertia = frames[root].placement.actInv(inertia)
    return changed


def shift_inertia(inertia: pin.Inertia, frame: pin.SE3, shift: Array) -> pin.Inertia:
    """Return a payload's inertia when it moves by `shift`, m, (3,), along its frame's axes."""
    return pin.SE3(np.eye(3), frame.rotation @ shift).act(inertia)


def find_camera_axes(rig: Rig) -> Array:
    """Forward, left and up of the camera as columns in the frame of the joint that carries it, (3, 3).

    The camera frame's axes where the rig names one; else the base's as the joints stand at zero: how a link's frame is
    turned in its body is the draughtsman's choice and says nothing.
    """
    frame = rig.model.frames[rig.model.getFrameId(rig.camera_frame, pin.FrameType.BODY)]
    if rig.config.camera_frame is not None or rig.camera_frame not in rig.links:
        return np.array(frame.placement.rotation)
    data = rig.model.createData()
    pin.forwardKinematics(rig.model, data, np.zeros(rig.n))
    return np.array(data.oMi[frame.parentJoint].rotation.T)


def find_joint_axis(rig: Rig, body: int) -> Array:
    """Axis of a body's joint in the joint's own frame, (3,); zero of one that slides."""
    data = rig.model.createData()
    pin.computeJointJacobians(rig.model, data, pin.neutral(rig.model))
    jacobian = pin.getJointJacobian(rig.model, data, body + 1, pin.LOCAL)
    return np.array(jacobian.reshape(6, -1)[3:, body])  # of one joint it is (6,)


def describe_way(way: Array) -> str:
    """Return a displacement in words, ``4.2 mm forward, 1 mm right``, of metres forward, left and up, (3,)."""
    ways = zip(way.tolist(), DIRECTIONS)
    return ", ".join(
        f"{1e3 * abs(d):.3g} mm {names[0] if d > 0 else names[1]}" for d, names in ways if d
    )


def add_to_body(rig: Rig, body: int, phi: Array, owner: str) -> Rig:
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
