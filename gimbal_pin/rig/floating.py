"""A fixed-base Pinocchio model set on a free one."""

from __future__ import annotations

import numpy as np
import pinocchio as pin


def floating(model: pin.Model) -> pin.Model:
    """Return the model behind a free-flyer, without gravity: the base's prescribed acceleration is specific force.

    With the base's attitude identity, its velocity (0, ω) and its acceleration (f, ω̇), the joints' torques are those
    of the base that moves so. Pinocchio's base acceleration is spatial, classical minus ω×v: hence v = 0. The base's
    own inertia is left out, as no joint feels it: the first six rows of RNEA are what the moved bodies ask of it.

    Gravity that the model had leaning (`base-tilt`) says how the base leans against its platform: the rig leans so.
    """
    out = pin.Model()
    out.gravity.linear = np.zeros(3)
    root = out.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
    lean = pin.SE3(leaning(model.gravity.linear), np.zeros(3))
    places = [lean * place if model.parents[j] == 0 else place for j, place in enumerate(model.jointPlacements)]
    for j in range(1, model.njoints):
        out.addJoint(int(model.parents[j]) + root, model.joints[j], places[j], model.names[j])
        out.appendBodyToJoint(j + root, model.inertias[j], pin.SE3.Identity())
    for frame in model.frames[1:]:
        place = lean * frame.placement if frame.parentJoint == 0 else frame.placement
        out.addFrame(pin.Frame(frame.name, frame.parentJoint + root, 0, place, frame.type), False)
    return out


def leaning(gravity: np.ndarray) -> np.ndarray:
    """Smallest rotation R with ``gravity = Rᵀ (0, 0, -g)``; identity without gravity."""
    if not np.any(gravity):
        return np.eye(3)
    down = np.array([0.0, 0.0, -np.linalg.norm(gravity)])
    return np.asarray(pin.Quaternion.FromTwoVectors(np.asarray(gravity), down).toRotationMatrix())
