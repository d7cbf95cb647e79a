"""Laws of formats: what SDF, MJCF, xacro and URDF say of one rig moves with the same torques.

Sensors, motors, gears and frames arrive from each; what no URDF can say is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

from gimbal_pin.dynamics import compute_regressor, compute_rnea, nominal
from gimbal_pin.log import Array
from gimbal_pin.rig import Rig
from gimbal_pin.rig.formats import mjcf
from tests.command_line import Run
from tests.mujoco_peer import rigid_bodies, torque
from tests.rigs import spelled

DEGREES = 180 / np.pi


@dataclass(frozen=True)
class Part:
    """A link: its pose, its joint's place and axis in it, mass, and inertia in a frame of its own at its centre."""

    parent: int
    kind: str
    pose: pin.SE3
    anchor: Array
    axis: Array
    mass: float
    own: pin.SE3
    inertia: Array


def parts(seed: int) -> list[Part]:
    """Return a tree of five links: each hangs on one before it, and its joint sits beside its frame."""
    rng = np.random.default_rng(seed)

    def pose() -> pin.SE3:
        return pin.SE3(pin.exp3(rng.normal(size=3)), 0.2 * rng.normal(size=3))

    out = list[Part]()
    for k in range(5):
        root = 0.1 * rng.normal(size=(3, 6))
        moments = root @ root.T
        inertia = np.trace(moments) * np.eye(3) - moments
        kind = ("revolute", "continuous", "prismatic")[rng.integers(3)]
        parent = int(rng.integers(-1, k)) if k else -1
        anchor, axis = rng.normal(size=(2, 3))
        out.append(Part(parent, kind, pose(), anchor, axis, 0.5 + k, pose(), inertia))
    return out


def numbers(x: object) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(np.asarray(x, dtype=float)))


def xyz_rpy(at: pin.SE3) -> str:
    return f'xyz="{numbers(at.translation)}" rpy="{numbers(pin.rpy.matrixToRpy(at.rotation))}"'


def entries(inertia: Array) -> dict[str, str]:
    return {f"i{'xyz'[r]}{'xyz'[c]}": numbers(inertia[r, c]) for r in range(3) for c in range(r, 3)}


def as_urdf(tree: list[Part]) -> str:
    """Frames at the joints, each with the link's axes."""
    frames = [pin.SE3(part.pose.rotation, part.pose.act(part.anchor)) for part in tree]
    out = ['<robot name="tree"><link name="base"/>']
    for k, (part, frame) in enumerate(zip(tree, frames)):
        own = pin.SE3(np.eye(3), -part.anchor) * part.own
        inertia = " ".join(f'{key}="{value}"' for key, value in entries(part.inertia).items())
        parent = frames[part.parent] if part.parent >= 0 else pin.SE3.Identity()
        limit = (
            ""
            if part.kind == "continuous"
            else '<limit lower="-2" upper="2" effort="5" velocity="3"/>'
        )
        out.append(
            f'<link name="l{k}"><inertial><origin {xyz_rpy(own)}/><mass value="{numbers(part.mass)}"/>'
            f'<inertia {inertia}/></inertial></link><joint name="j{k}" type="{part.kind}">'
            f'<parent link="{f"l{part.parent}" if part.parent >= 0 else "base"}"/><child link="l{k}"/>'
            f'<origin {xyz_rpy(parent.actInv(frame))}/><axis xyz="{numbers(part.axis)}"/>{limit}</joint>'
        )
    return "".join([*out, "</robot>"])


def as_sdf(tree: list[Part], version: str = "1.9") -> str:
    """Links placed in the model or by their parents, in radians or degrees or quaternions; joints turned in links.

    Before 1.5 axes are stated in the model's axes.
    """
    massless = (
        "<inertial><mass>0</mass><inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia></inertial>"
    )
    out = [
        f'<sdf version="{version}"><model name="tree"><pose>1 2 3 0 0 1</pose><link name="base">{massless}</link>'
    ]
    for k, part in enumerate(tree):
        by = ""
        at = part.pose
        if part.parent >= 0 and k % 2:
            by = f'relative_to="l{part.parent}"'
            at = tree[part.parent].pose.actInv(part.pose)
        rpy = pin.rpy.matrixToRpy(at.rotation)
        where = f"<pose {by}>{numbers(at.translation)} {numbers(rpy)}</pose>"
        if k == 1:
            where = f'<pose {by} degrees="true">{numbers(at.translation)} {numbers(DEGREES * rpy)}</pose>'
        if k == 2:
            q = pin.Quaternion(at.rotation).coeffs()
            where = f'<pose {by} rotation_format="quat_xyzw">{numbers(at.translation)} {numbers(q)}</pose>'
        turned = pin.SE3(pin.exp3(np.array([0.3, k, 0.1])), part.anchor)
        axis = f"<xyz>{numbers(turned.rotation.T @ part.axis)}</xyz>"
        if version == "1.4":
            axis = f"<xyz>{numbers(part.pose.rotation @ part.axis)}</xyz>"
        elif k == 3:
            axis = f'<xyz expressed_in="__model__">{numbers(part.pose.rotation @ part.axis)}</xyz>'
        inertia = "".join(f"<{key}>{value}</{key}>" for key, value in entries(part.inertia).items())
        own = f"{numbers(part.own.translation)} {numbers(pin.rpy.matrixToRpy(part.own.rotation))}"
        limit = (
            ""
            if part.kind == "continuous"
            else "<limit><lower>-2</lower><upper>2</upper><effort>5</effort></limit>"
        )
        out.append(
            f'<link name="l{k}">{where}<inertial><pose>{own}</pose><mass>{numbers(part.mass)}</mass>'
            f'<inertia>{inertia}</inertia></inertial></link><joint name="j{k}" type="{part.kind}">'
            f"<pose>{numbers(turned.translation)} {numbers(pin.rpy.matrixToRpy(turned.rotation))}</pose>"
            f"<parent>{f'l{part.parent}' if part.parent >= 0 else 'base'}</parent><child>l{k}</child>"
            f"<axis>{axis}{limit}</axis></joint>"
        )
    return "".join([*out, "</model></sdf>"])


def as_xacro(tree: list[Part]) -> str:
    """The URDF with a macro per link, a folder found by its name, and an argument."""
    head, *links = as_urdf(tree).removesuffix("</robot>").split('<link name="l')
    macros = "".join(
        f'<xacro:macro name="part{k}" params="name"><link name="${{name}}{link[1:]}</xacro:macro>'
        for k, link in enumerate(links)
    )
    calls = "".join(f'<xacro:part{k} name="$(arg prefix){k}"/>' for k in range(len(links)))
    head = head.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    return f'{head}<xacro:arg name="prefix" default="x"/>{macros}{calls}</robot>'


def torques(rig: Rig) -> Array:
    """RNEA with the joints in alphabetical order, (20, n): formats list them in orders of their own."""
    order = np.argsort(rig.joints)
    draw = np.random.default_rng(0).normal(size=(3, 20, rig.n))
    return compute_rnea(rig, *draw[:, :, np.argsort(order)])[:, order]


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="$(find arm)/parts.xacro"/></robot>"""


@pytest.mark.parametrize("seed", range(3))
def test_one_rig_in_every_format_asks_for_the_same_torques(tmp_path: Path, seed: int) -> None:
    """Files are known by what is in them, not by their suffix; xacro takes an argument from the rig's YAML,
    and a package is a folder above the file.

    MuJoCo writes five digits.
    """
    tree = parts(seed)
    plain = spelled(as_urdf(tree))
    peer = rigid_bodies(etree.fromstring(as_urdf(tree)))
    draw = np.random.default_rng(0).normal(size=(3, 20, 5))
    expected = torque(peer, sorted(plain.joints), *draw)
    size = np.abs(expected).max()
    folder = tmp_path / "arm"
    folder.mkdir()
    written(folder, "parts.xacro", as_xacro(tree))
    written(folder, "xacro.yaml", "xacro: {prefix: l}\n")
    written(folder, "xacro.xml", ARM)
    mujoco.mj_saveLastXML(str(tmp_path / "arm/mjcf.xml"), peer)
    written(folder, "sdf.xml", as_sdf(tree, ("1.4", "1.9", "1.11")[seed]))
    loaded = [Rig.load(folder / f"{name}.xml") for name in ("mjcf", "xacro", "sdf")]
    for rig, digits in zip((*loaded, plain), (1e-4, 1e-12, 1e-12, 1e-12)):
        np.testing.assert_allclose(torques(rig), expected, rtol=0, atol=digits * size)
        lower = {joint: limit.lower for joint, limit in zip(rig.joints, rig.limits)}
        assert lower == {
            f"j{k}": -np.inf if part.kind == "continuous" else -2 for k, part in enumerate(tree)
        }


SENSORS = """<sdf version="1.9"><model name="g"><link name="base"><inertial><mass>1</mass></inertial></link>
<link name="head"><inertial><mass>1</mass></inertial>
<sensor name="eye" type="camera"><pose>0.1 0.2 0.3 0 0 3.141592653589793</pose></sensor>
<sensor name="gyro" type="imu"><pose>0 0 1 0 0 0</pose></sensor></link>
<joint name="tilt" type="revolute"><pose>0 0 0.5 0 0 0</pose><parent>base</parent><child>head</child>
<axis><xyz>0 1 0</xyz></axis></joint></model></sdf>"""


def test_sensors_of_an_sdf_are_links_and_its_camera_the_rigs(tmp_path: Path) -> None:
    rig = Rig.load(written(tmp_path, "g.sdf", SENSORS))
    assert rig.camera_frame == "eye"
    data = rig.model.createData()
    pin.framesForwardKinematics(rig.model, data, np.zeros(1))
    eye, gyro = (data.oMf[rig.model.getFrameId(name)] for name in ("eye", "gyro"))
    np.testing.assert_allclose(eye.translation, [0.1, 0.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(eye.rotation[:, 0], [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(gyro.translation, [0, 0, 1], atol=1e-15)


EYE = '<camera name="eye" pos="0.1 0.2 0.3" xyaxes="0 1 0 0 0 1"/><site name="gyro" pos="0 0 1"/>'
MUJOCO = f"""<mujoco><worldbody><body name="base"><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><body name="head">
<joint name="tilt" axis="0 1 0" pos="0 0 0.5" ref="0.4" armature="0.02" damping="0.3" frictionloss="0.2"/>
<inertial pos="0.3 0 0" mass="1" diaginertia="1 1 1"/>{EYE}</body></body></worldbody>
<actuator><motor joint="tilt" ctrlrange="-3 2" gear="2"/></actuator><sensor><gyro site="gyro"/></sensor></mujoco>"""


def test_what_mujoco_knows_of_motors_and_sensors_is_the_rigs() -> None:
    """A camera looks along its -z; a joint's `ref` is where the file draws it; the rotor moves with the joint.

    A base that floats in the file stands.
    """
    model = mujoco.MjModel.from_xml_string(MUJOCO.replace("0.4", "22.9183118052329"))  # degrees
    rig = spelled(mjcf.convert_mujoco_model(model, "g.xml")[0])
    assert (rig.camera_frame, rig.base) == ("eye", "base")
    assert rig.motors[0].armature == pytest.approx(0.02, rel=1e-14)
    np.testing.assert_allclose(rig.friction, [[0.2, 0.3]])
    np.testing.assert_allclose(rig.tau_max, [6.0])
    data = rig.model.createData()
    other = mujoco.MjData(model)
    for q in (0.4, -0.9):
        pin.framesForwardKinematics(rig.model, data, np.array([q]))
        other.qpos[-1] = q
        mujoco.mj_forward(model, other)
        eye, gyro = (data.oMf[rig.model.getFrameId(name)] for name in ("eye", "gyro"))
        right, up, back = other.cam("eye").xmat.reshape(3, 3).T
        np.testing.assert_allclose(eye.translation, other.cam("eye").xpos, atol=1e-12)
        np.testing.assert_allclose(eye.rotation.T, [-back, -right, up], atol=1e-12)
        np.testing.assert_allclose(gyro.translation, other.site("gyro").xpos, atol=1e-12)
    row = [np.array([[x]]) for x in (0.1, 0.7, 1.3)]
    bodies = compute_regressor(rig, *row) @ rig.phi
    assert nominal(rig).inverse(*row) - bodies == pytest.approx(0.2 + 0.3 * 0.7 + 0.02 * 1.3)


RIG = """<robot name="r"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="tilt" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>{}</robot>"""
TRANSMISSIONS = {
    "ROS 1": '<transmission name="t"><joint name="tilt"/><actuator name="m"><motorTorqueConstant>0.02'
    "</motorTorqueConstant><mechanicalReduction>50</mechanicalReduction></actuator></transmission>",
    "ros2_control": '<ros2_control name="c" type="system"><transmission name="t"><actuator name="m"/>'
    '<joint name="tilt"><mechanical_reduction>50</mechanical_reduction></joint></transmission></ros2_control>',
    "Drake": '<transmission name="t"><joint name="tilt"/><actuator name="m"><d:gear_ratio xmlns:d="http://drake.mit.edu"'
    ' value="50"/><d:rotor_inertia xmlns:d="http://drake.mit.edu" value="2e-5"/></actuator></transmission>',
}


@pytest.mark.parametrize("kind", TRANSMISSIONS)
def test_gears_and_rotors_come_from_transmissions_and_the_yaml_beats_them(
    tmp_path: Path, kind: str
) -> None:
    path = written(tmp_path, "r.urdf", RIG.format(TRANSMISSIONS[kind]))
    motor = Rig.load(path).motors[0]
    constant = 50 * 0.02 if kind == "ROS 1" else None
    assert (motor.gear_ratio, motor.torque_constant) == (50, constant)
    assert motor.armature == pytest.approx(0.05 if kind == "Drake" else 0.0)
    written(tmp_path, "r.yaml", "motors: {tilt: {rotor_inertia: 1e-4, encoder_bits: 12}}")
    rig = Rig.load(path)
    assert (rig.motors[0].gear_ratio, rig.motors[0].encoder_bits) == (50, 12)
    row = np.array([[[0.0]], [[0.0]], [[1.0]]])
    assert compute_rnea(rig, *row) - compute_regressor(rig, *row) @ rig.phi == pytest.approx(0.25)


@pytest.mark.parametrize("axis", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_line_of_sight_is_the_axis_that_is_stated(tmp_path: Path, axis: str) -> None:
    path = written(tmp_path, "r.urdf", RIG.format(""))
    written(tmp_path, "r.yaml", f"camera_frame: arm\noptical_axis: {axis}\n")
    rig = Rig.load(path)
    data = rig.model.createData()
    pin.framesForwardKinematics(rig.model, data, np.zeros(1))
    sight = data.oMf[rig.model.getFrameId(rig.camera_frame)].rotation
    assert sight[:, 0]["xyz".index(axis[-1])] == (-1 if axis[0] == "-" else 1)
    assert np.linalg.det(sight) == pytest.approx(1.0)


def changed(old: str, new: str) -> str:
    """Return SENSORS with the first `old` replaced."""
    assert old in SENSORS
    return SENSORS.replace(old, new, 1)


BAD = {
    "ball joint": (changed('type="revolute"', 'type="ball"'), "tilt", "ball"),
    "nested model": (changed('<link name="head">', '<model name="m"/><link name="head">'), "nests"),
    "two models": (changed("<model", '<model name="o"/><model'), "2 models"),
    "words": (changed("<mass>1</mass>", "<mass>heavy</mass>"), "<mass> holds 'heavy'", ":1:"),
    "short pose": (changed("0.1 0.2 0.3 0 0", "0.1 0.2"), "<pose> holds", "6 numbers"),
    "no such frame": (changed("<pose>0 0 0.5", '<pose relative_to="nose">0 0 0.5'), "nose"),
    "circle": (changed("<pose>0 0 0.5", '<pose relative_to="tilt">0 0 0.5'), "tilt", "itself"),
    "no child": (changed("<child>head", "<child>heda"), "heda"),
    "auto": (changed("<inertial>", '<inertial auto="true">'), "auto"),
    "twins": (changed('joint name="tilt"', 'joint name="head"'), "two", "head"),
    "entity": ("<!DOCTYPE sdf [<!ENTITY m '1'>]>" + SENSORS, "document type"),
    "not a quaternion": (
        changed("<pose>0 0 1 0 0 0", '<pose rotation_format="quat_xyzw">0 0 1 0 0 0 0'),
        "quaternion",
    ),
    "MJCF that is none": ("<mujoco><wordbody/></mujoco>", "wordbody"),
    "xacro that never ends": (
        '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="m" params=""><xacro:m/>'
        "</xacro:macro><xacro:m/></robot>",
        "recursion",
    ),
    "two joints in a body": (
        MUJOCO.replace("<joint", '<joint axis="1 0 0"/><joint', 1),
        "2 joints",
    ),
    "a ball in a body": (
        MUJOCO.replace('axis="0 1 0" pos="0 0 0.5" ref="0.4"', 'type="ball"'),
        "ball",
    ),
    "a loop of bodies": (
        MUJOCO.replace(
            "<actuator>", '<equality><weld body1="head" body2="base"/></equality><actuator>'
        ),
        "cut the loop",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_a_rig_is_told_in_one_line(tmp_path: Path, run: Run, case: str) -> None:
    text, *words = BAD[case]
    code, out, err = run("check", written(tmp_path, "bad.xml", text))
    assert (code, out, err.count("\n")) == (2, "", 1)
    for word in ("bad.xml", *words):
        assert word in err
