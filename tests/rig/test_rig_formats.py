"""Laws of formats: what SDF, MJCF, xacro and URDF say of one rig moves with the same torques.

Sensors, motors, gears and frames arrive from each; what no URDF can say is refused.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

from gimbal_pin.dynamics import compute_regressor, compute_rnea, nominal
from gimbal_pin.errors import RigError
from gimbal_pin.log import Array
from gimbal_pin.rig import Rig
from gimbal_pin.rig.formats import mjcf
from tests.mujoco_peer import rigid_bodies, torque
from tests.rigs import spelled

INERTIA = '<inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0.002" ixz="-0.003" iyz="0.004"/>'
LIMIT = '<limit lower="-2" upper="2" effort="5" velocity="3"/>'
TREE = f"""<link name="base"/>
<link name="a"><inertial><origin xyz="0.05 -0.12 0.2" rpy="0.3 -0.8 1.1"/><mass value="3"/>{INERTIA}</inertial></link>
<joint name="ja" type="revolute"><parent link="base"/><child link="a"/>
<origin xyz="0.1 0.2 0.3" rpy="0.5 0 0"/><axis xyz="0 0.6 0.8"/>{LIMIT}</joint>
<link name="b"><inertial><origin xyz="0.1 0.02 0.3" rpy="0.1 0.2 0.3"/><mass value="2"/>{INERTIA}</inertial></link>
<joint name="jb" type="prismatic"><parent link="a"/><child link="b"/>
<origin xyz="0 0.1 0.2" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/>{LIMIT}</joint>
<link name="c"><inertial><origin xyz="0 0.03 0.1" rpy="0 0 0.7"/><mass value="1"/>{INERTIA}</inertial></link>
<joint name="jc" type="continuous"><parent link="b"/><child link="c"/>
<origin xyz="0.2 0.1 0" rpy="0.5235987755982988 0 0"/><axis xyz="0 1 0"/></joint>"""
URDF = f'<robot name="tree">{TREE}</robot>'
"""A revolute, a prismatic and a continuous joint, askew in every way."""
MOMENTS = """<inertia><ixx>0.03</ixx><iyy>0.04</iyy><izz>0.05</izz>
<ixy>0.002</ixy><ixz>-0.003</ixz><iyz>0.004</iyz></inertia>"""
STOPS = "<limit><lower>-2</lower><upper>2</upper><effort>5</effort></limit>"
SDF = f"""<sdf version="1.11"><model name="tree"><pose>1 2 3 0 0 1</pose>
<link name="base"><inertial><mass>0</mass><inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia></inertial></link>
<link name="a"><pose>0.1 0.2 0.3 0.5 0 0</pose>
<inertial><pose>0.05 -0.12 0.2 0.3 -0.8 1.1</pose><mass>3</mass>{MOMENTS}</inertial></link>
<joint name="ja" type="revolute"><parent>base</parent><child>a</child><axis><xyz>0 0.6 0.8</xyz>{STOPS}</axis></joint>
<link name="b"><pose relative_to="a" rotation_format="quat_xyzw">0.1 0.1 0.2 0 0 1 1</pose>
<inertial><pose>0.1 0.12 0.3 0.1 0.2 0.3</pose><mass>2</mass>{MOMENTS}</inertial></link>
<joint name="jb" type="prismatic"><pose>0 0.1 0 0 0 0</pose><parent>a</parent><child>b</child>
<axis><xyz expressed_in="a">0 1 0</xyz>{STOPS}</axis></joint>
<link name="c"><pose relative_to="b" degrees="true">0.2 0.2 0 30 0 0</pose>
<inertial><pose>0 0.03 0.1 0 0 0.7</pose><mass>1</mass>{MOMENTS}</inertial></link>
<joint name="jc" type="continuous"><pose>0 0 0 0 0 1.5707963267948966</pose><parent>b</parent><child>c</child>
<axis><xyz>1 0 0</xyz></axis></joint></model></sdf>"""
"""The same rig in SDF: the frame of b lies 0.1 m beside its joint, the frame of jc is turned in c."""
ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="$(find arm)/parts.xacro"/></robot>"""
PARTS = f"""<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="prefix" default="x"/>
<xacro:macro name="tree" params="p">{TREE.replace('"j', '"${p}')}</xacro:macro>
<xacro:tree p="$(arg prefix)"/></robot>"""


def torques(rig: Rig) -> Array:
    """RNEA with the joints in alphabetical order, (20, n): formats list them in orders of their own."""
    order = np.argsort(rig.joints)
    draw = np.random.default_rng(0).normal(size=(3, 20, rig.n))
    return compute_rnea(rig, *draw[:, :, np.argsort(order)])[:, order]


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_one_rig_in_every_format_asks_for_the_same_torques(tmp_path: Path) -> None:
    """Files are known by what is in them, not by their suffix; xacro takes an argument from the rig's YAML,
    and a package is a folder above the file.

    MuJoCo writes five digits.
    """
    peer = rigid_bodies(etree.fromstring(URDF))
    expected = torque(peer, ["ja", "jb", "jc"], *np.random.default_rng(0).normal(size=(3, 20, 3)))
    folder = tmp_path / "arm"
    folder.mkdir()
    written(folder, "parts.xacro", PARTS)
    written(folder, "xacro.yaml", "xacro: {prefix: j}\n")
    mujoco.mj_saveLastXML(str(folder / "mjcf.xml"), peer)
    for name, text in (("urdf", URDF), ("xacro", ARM), ("sdf", SDF)):
        written(folder, f"{name}.xml", text)
    for name, digits in (("urdf", 1e-12), ("xacro", 1e-12), ("sdf", 1e-12), ("mjcf", 1e-4)):
        rig = Rig.load(folder / f"{name}.xml")
        atol = digits * np.abs(expected).max()
        np.testing.assert_allclose(torques(rig), expected, rtol=0, atol=atol, err_msg=name)
        lower = {joint: limit.lower for joint, limit in zip(rig.joints, rig.limits)}
        assert lower == {"ja": -2, "jb": -2, "jc": -np.inf}


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
    assert nominal(rig).inverse_dynamics(*row) - bodies == pytest.approx(
        0.2 + 0.3 * 0.7 + 0.02 * 1.3
    )


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


def test_axes_of_old_sdf_are_the_models(tmp_path: Path) -> None:
    """Of versions before 1.5; the link is a quarter turned."""
    turned = changed(
        '<link name="head">', '<link name="head"><pose>0 0 0 0 0 1.5707963267948966</pose>'
    )
    old = turned.replace('version="1.9"', 'version="1.4"').replace("0 1 0</xyz>", "-1 0 0</xyz>")
    one, other = (Rig.load(written(tmp_path, "g.sdf", text)) for text in (turned, old))
    np.testing.assert_allclose(torques(one), torques(other), atol=1e-12)


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
    "two joints": (MUJOCO.replace("<joint", '<joint axis="1 0 0"/><joint', 1), "2 joints"),
    "xacro that never ends": (
        '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="m" params=""><xacro:m/>'
        "</xacro:macro><xacro:m/></robot>",
        "recursion",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_a_rig_is_told_in_one_line(tmp_path: Path, case: str) -> None:
    text, *words = BAD[case]
    path = written(tmp_path, "bad.xml", text)
    with pytest.raises(RigError) as caught:
        Rig.load(path)
    assert "\n" not in str(caught.value)
    for word in ("bad.xml", *words):
        assert word in str(caught.value)


BESIDE = """<mujoco><worldbody><body name="base"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="arm" pos="0 0.1 0.2"><joint name="pan" axis="0 0 1" pos="0.3 0 0.1"/>
<inertial pos="0.1 0 0" mass="2" diaginertia="1 1 1"/>
<body name="head" pos="0.2 0 0" euler="20 0 30"><joint name="tilt" axis="0 1 0" pos="0 0.2 0.5"/>
<inertial pos="0.3 0 0" mass="1" diaginertia="1 1 1"/></body></body></body></worldbody></mujoco>"""


def test_joints_of_mujoco_may_lie_beside_their_bodies_frames() -> None:
    model = mujoco.MjModel.from_xml_string(BESIDE)
    rig = spelled(mjcf.convert_mujoco_model(model, "g.xml")[0])
    draw = np.random.default_rng(0).normal(size=(3, 20, 2))
    np.testing.assert_allclose(torques(rig), torque(model, ["pan", "tilt"], *draw), atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('axis="0 1 0" pos="0 0 0.5" ref="0.4"', 'type="ball"', "ball"),
        (
            "<actuator>",
            '<equality><weld body1="head" body2="base"/></equality><actuator>',
            "cut the loop",
        ),
    ],
)
def test_bodies_of_mujoco_that_no_urdf_can_state_are_refused(old: str, new: str, said: str) -> None:
    model = mujoco.MjModel.from_xml_string(MUJOCO.replace(old, new, 1))
    with pytest.raises(RigError, match=said):
        mjcf.convert_mujoco_model(model, "g.xml")
