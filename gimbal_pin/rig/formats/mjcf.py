"""MJCF, MuJoCo's format, compiled by MuJoCo where that is installed: defaults, includes, inertia from shapes.

MuJoCo places a joint anywhere in its body; a URDF has one frame for both. So a body's frame moves to its joint, without
turning. Cameras, and sites with a gyro or accelerometer, become links.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.errors import RigError, UsageError
from gimbal_pin.rig import urdf
from gimbal_pin.rig.bounded import ProcessStopped, run_bounded

if TYPE_CHECKING:
    import mujoco

_CAMERA_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Axes whose x looks where a MuJoCo camera looks, its -z, and whose z is the camera's y, up."""


def convert_mjcf(path: Path) -> tuple[str, list[str], list[str]]:
    """Return a MuJoCo model as a URDF, a sentence on what that does not hold, and the files that it includes."""
    if find_spec("mujoco") is None:
        mend = "install it (pip install 'gimbal_pin[mjcf]'), or convert the file to a URDF"
        raise UsageError(str(path), "is an MJCF, which needs the package mujoco", mend)
    try:
        found = run_bounded(__name__, str(path.resolve()))
    except ProcessStopped as error:
        raise RigError(
            str(path), f"is an MJCF that MuJoCo does not compile ({error})", "mend it"
        ) from error
    if "wrong" in found:
        raise RigError(str(path), *found["wrong"])
    return found["text"], found["notes"], _list_included(path.resolve())


def _list_included(path: Path) -> list[str]:
    """Return the files that a compiled model includes, beside the first one; MuJoCo allows each once."""
    found = list[str]()
    open_ = [path]
    while open_:
        root = urdf.parse_xml(open_.pop().read_text("utf-8"), str(path))
        inner = [path.parent / str(one.get("file", "")) for one in root.iter("include")]
        open_ += [file for file in inner if file.is_file()]
        found += map(str, inner)
    return found


def main(path: str) -> dict[str, Any]:
    """Compile and convert a file, in a process that has bounds: MuJoCo is not made for untrusted files."""
    import mujoco

    try:
        text, notes = convert_mujoco_model(mujoco.MjModel.from_xml_path(path), path)
    except RigError as error:
        return {"wrong": [error.what, error.mend]}
    return {"text": text, "notes": notes}


def convert_mujoco_model(model: mujoco.MjModel, path: str) -> tuple[str, list[str]]:
    """Return a compiled model as the text of a URDF, and what was left out."""
    import mujoco

    if np.isin(model.eq_type, [int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)]).any():
        raise RigError(
            path, "ties bodies to each other beside its tree (<equality>)", "cut the loop"
        )
    names = {i: model.body(i).name or f"body{i}" for i in range(model.nbody)}
    joints = {i: _find_joint(model, i, names[i], path) for i in range(1, model.nbody)}
    first = [i for i in joints if model.body_parentid[i] == 0]
    rooted = len(first) == 1 and joints[first[0]] is None and not len(_list_shapes(model, 0))
    out = etree.Element("robot", {"name": Path(path).stem}, nsmap={"drake": urdf.DRAKE_NAMESPACE})
    notes = list[str]()
    for i in range(int(rooted), model.nbody):
        _add_body(out, model, i, names[i], _find_anchor(model, joints.get(i)))
    for i, joint in joints.items():
        if not (rooted and i == first[0]):
            parent = int(model.body_parentid[i])
            between = pin.SE3(np.eye(3), -_find_anchor(model, joints.get(parent)))
            own = _make_pose(model.body_pos[i], model.body_quat[i])
            origin = between * own * pin.SE3(np.eye(3), _find_anchor(model, joint))
            notes += _add_joint(out, model, joint, (names[parent], names[i]), origin)
    places = [(*sensed, "imu") for sensed in _list_imus(model)]
    for k in range(model.ncam):
        at = _make_pose(model.cam_pos[k], model.cam_quat[k])
        places.append((model.camera(k).name or f"camera{k}", int(model.cam_bodyid[k]), at, ""))
    for name, body, place, kind in places:
        own = place if kind else place * pin.SE3(_CAMERA_AXES, np.zeros(3))
        if body >= int(rooted):
            at = pin.SE3(np.eye(3), -_find_anchor(model, joints.get(body))) * own
            urdf.add_sensor(out, name, kind or "camera", names[body], at)
    ties = [
        k
        for k in range(model.neq)
        if model.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj2id[k] >= 0
    ]
    for k in ties:
        first_name, other = (
            model.joint(int(ids[k])).name for ids in (model.eq_obj1id, model.eq_obj2id)
        )
        offset, slope, *_ = model.eq_data[k]
        for joint_element in out.findall(f"joint[@name='{first_name}']"):
            etree.SubElement(
                joint_element,
                "mimic",
                joint=other,
                multiplier=f"{slope:.17g}",
                offset=f"{offset:.17g}",
            )
    return str(etree.tostring(out, encoding="unicode")), notes


def _find_joint(model: mujoco.MjModel, body: int, name: str, path: str) -> int | None:
    """Return the one hinge or slide of a body; None if it has none, or floats: a rig's base is fixed."""
    import mujoco

    start = int(model.body_jntadr[body])
    count = int(model.body_jntnum[body])
    kinds = [int(model.jnt_type[start + k]) for k in range(count)]
    if kinds == [int(mujoco.mjtJoint.mjJNT_FREE)]:
        return None
    if count > 1:
        raise RigError(
            path,
            f"body '{name}' has {count} joints",
            "give each joint a body of its own, with its mass",
        )
    if kinds == [int(mujoco.mjtJoint.mjJNT_BALL)]:
        raise RigError(path, f"body '{name}' has a ball joint", "use hinge and slide joints")
    return start if count else None


def _find_anchor(model: mujoco.MjModel, joint: int | None) -> np.ndarray:
    """Return where in its body a joint is, m, (3,): the place of the link's frame."""
    return np.zeros(3) if joint is None else np.array(model.jnt_pos[joint])


def _make_pose(position: np.ndarray, quaternion: np.ndarray) -> pin.SE3:
    """Return MuJoCo's position and quaternion w x y z as a pose."""
    w, x, y, z = quaternion
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), np.array(position))


def _add_body(
    out: etree._Element, model: mujoco.MjModel, body: int, name: str, at: np.ndarray
) -> None:
    """Add a body as a link whose frame is at a point of it."""
    link = etree.SubElement(out, "link", name=name)
    shift = pin.SE3(np.eye(3), -at)
    if body and model.body_mass[body] > 0:
        own = shift * _make_pose(model.body_ipos[body], model.body_iquat[body])
        inertia = own.rotation @ np.diag(model.body_inertia[body]) @ own.rotation.T
        urdf.write_inertial(link, float(model.body_mass[body]), own.translation, inertia)
    for kind, sizes, where, colour in _list_shapes(model, body):
        visual = urdf.add_visual(link, shift * where, kind, **sizes)
        etree.SubElement(
            etree.SubElement(visual, "material", name=""), "color", rgba=urdf.format_numbers(colour)
        )


def _list_shapes(
    model: mujoco.MjModel, body: int
) -> list[tuple[str, dict[str, str], pin.SE3, np.ndarray]]:
    """Return shape, sizes, pose and colour of what is seen of a body; a mesh is the box around it."""
    import mujoco  # whose enumerations are equal to numpy's numbers, but not found among them: hence int()

    out = []
    start = int(model.body_geomadr[body])
    for k in range(start, start + int(model.body_geomnum[body])):
        kind = model.geom_type[k]
        size = model.geom_size[k]
        at = _make_pose(model.geom_pos[k], model.geom_quat[k])
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            shape = ("box", {"size": urdf.format_numbers(2 * size)})
        elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            shape = ("sphere", {"radius": urdf.format_numbers(size[:1])})
        elif kind in (int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE)):
            sizes = {
                "radius": urdf.format_numbers(size[:1]),
                "length": urdf.format_numbers(2 * size[1:2]),
            }
            shape = ("cylinder", sizes)
        elif kind in (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)):
            middle = model.geom_aabb[k][:3]
            half = model.geom_aabb[k][3:]
            at = at * pin.SE3(np.eye(3), np.array(middle))
            shape = ("box", {"size": urdf.format_numbers(2 * half)})
        else:
            continue
        out.append((*shape, at, np.array(model.geom_rgba[k])))
    return out


def _add_joint(
    out: etree._Element,
    model: mujoco.MjModel,
    joint: int | None,
    links: tuple[str, str],
    origin: pin.SE3,
) -> list[str]:
    """Add what joins two links; return a sentence on what a URDF cannot hold."""
    import mujoco

    if joint is None:
        urdf.add_joint(out, f"{links[1]}_on_{links[0]}", "fixed", *links, origin)
        return []
    name = model.joint(joint).name or f"joint{joint}"
    axis = np.array(model.jnt_axis[joint])
    slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    limited = bool(model.jnt_limited[joint])
    # A file shows its bodies where the joint reads `ref`; at zero it is turned back by that.
    back = -float(model.qpos0[model.jnt_qposadr[joint]]) * axis
    origin = origin * (pin.SE3(np.eye(3), back) if slides else pin.SE3(pin.exp3(back), np.zeros(3)))
    kind = "prismatic" if slides else "revolute" if limited else "continuous"
    new = urdf.add_joint(out, name, kind, *links, origin, axis)
    dof = int(model.jnt_dofadr[joint])
    low, high = model.jnt_range[joint] if limited else (-1e16, 1e16)
    effort = f"{_find_largest_torque(model, joint):.17g}"
    etree.SubElement(
        new, "limit", lower=f"{low:.17g}", upper=f"{high:.17g}", effort=effort, velocity="0"
    )
    damping = float(model.dof_damping[dof])
    friction = float(model.dof_frictionloss[dof])
    etree.SubElement(new, "dynamics", damping=f"{damping:.17g}", friction=f"{friction:.17g}")
    if model.dof_armature[dof] > 0:
        transmission = etree.SubElement(out, "transmission", name=f"{name}_transmission")
        etree.SubElement(transmission, "joint", name=name)
        actuator = etree.SubElement(transmission, "actuator", name=f"{name}_motor")
        etree.SubElement(actuator, f"{{{urdf.DRAKE_NAMESPACE}}}gear_ratio", value="1")
        armature = f"{float(model.dof_armature[dof]):.17g}"
        etree.SubElement(actuator, f"{{{urdf.DRAKE_NAMESPACE}}}rotor_inertia", value=armature)
    spring = f"{name} has a spring, which is left out: it is a cable-spring to plant or to find"
    return [spring] if model.jnt_stiffness[joint] else []


def _find_largest_torque(model: mujoco.MjModel, joint: int) -> float:
    """Return the largest torque of a joint's actuators, N m; 0 where none is stated."""
    import mujoco

    found = [0.0]
    if model.jnt_actfrclimited[joint]:
        found.append(float(np.abs(model.jnt_actfrcrange[joint]).max()))
    for k in range(model.nu):
        if (
            model.actuator_trntype[k] != mujoco.mjtTrn.mjTRN_JOINT
            or model.actuator_trnid[k, 0] != joint
        ):
            continue
        gear = abs(float(model.actuator_gear[k, 0]))
        direct = model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_NONE
        if model.actuator_forcelimited[k]:
            found.append(gear * float(np.abs(model.actuator_forcerange[k]).max()))
        elif model.actuator_ctrllimited[k] and direct:
            gain = abs(float(model.actuator_gainprm[k, 0]))
            found.append(gear * gain * float(np.abs(model.actuator_ctrlrange[k]).max()))
    return max(found)


def _list_imus(model: mujoco.MjModel) -> list[tuple[str, int, pin.SE3]]:
    """Return name, body and pose in it of the sites with a gyro or an accelerometer."""
    import mujoco

    kinds = (int(mujoco.mjtSensor.mjSENS_GYRO), int(mujoco.mjtSensor.mjSENS_ACCELEROMETER))
    sites = sorted(
        {int(model.sensor_objid[k]) for k in range(model.nsensor) if model.sensor_type[k] in kinds}
    )
    return [
        (
            model.site(k).name or f"imu{k}",
            int(model.site_bodyid[k]),
            _make_pose(model.site_pos[k], model.site_quat[k]),
        )
        for k in sites
    ]
