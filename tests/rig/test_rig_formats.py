"""One rig in every format is one rig: what SDF, MJCF, xacro and URDF say of it moves with the same torques."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import compute_regressor, compute_rnea, nominal
from gimbal_pin.errors import GimbalPinError, RigError
from gimbal_pin.log import Array
from gimbal_pin.rig import GRAVITY, Rig
from gimbal_pin.rig.formats import mjcf
from tests.command_line import Run
from tests.mujoco_peer import torque
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


def pose(rng: np.random.Generator) -> pin.SE3:
    return pin.SE3(pin.exp3(rng.normal(size=3)), 0.2 * rng.normal(size=3))


def parts(seed: int) -> list[Part]:
    """A tree of five links: each hangs on one before it, and its joint sits beside its frame."""
    rng = np.random.default_rng(seed)
    out = list[Part]()
    for k in range(5):
        points = 0.1 * rng.normal(size=(6, 3))
        inertia = sum(0.1 * (r @ r * np.eye(3) - np.outer(r, r)) for r in points)
        axis = rng.normal(size=3)
        kind = str(rng.choice(["revolute", "continuous", "prismatic"]))
        place = pose(rng)
        at = 0.1 * rng.normal(size=3)
        mass = rng.uniform(0.1, 2)
        out.append(
            Part(
                int(rng.integers(-1, k)) if k else -1,
                kind,
                place,
                at,
                axis,
                mass,
                pose(rng),
                inertia,
            )
        )
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


def as_mjcf(tree: list[Part], free: bool = False) -> str:
    """Bodies in bodies, joints beside their origins; `free`: on a base that floats, which a rig's does not."""

    def body(k: int) -> str:
        part = tree[k]
        before = tree[part.parent].pose if part.parent >= 0 else pin.SE3.Identity()
        at = before.actInv(part.pose)
        R = part.own.rotation
        w = np.roll(pin.Quaternion(at.rotation).coeffs(), 1)
        full = (R @ part.inertia @ R.T)[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
        kind = "slide" if part.kind == "prismatic" else "hinge"
        limit = "" if part.kind == "continuous" else 'limited="true" range="-2 2"'
        inner = "".join(body(j) for j, other in enumerate(tree) if other.parent == k)
        return (
            f'<body name="l{k}" pos="{numbers(at.translation)}" quat="{numbers(w)}">'
            f'<joint name="j{k}" type="{kind}" pos="{numbers(part.anchor)}" axis="{numbers(part.axis)}" {limit}/>'
            f'<inertial pos="{numbers(part.own.translation)}" mass="{numbers(part.mass)}" '
            f'fullinertia="{numbers(full)}"/>{inner}</body>'
        )

    inner = "".join(body(j) for j, part in enumerate(tree) if part.parent < 0)
    base = f'<body name="base"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{inner}</body>'
    return f'<mujoco><compiler angle="radian"/><worldbody>{base if free else inner}</worldbody></mujoco>'


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


def torques(rig: Rig, seed: int = 0) -> Array:
    """RNEA with the joints in alphabetical order, (20, n): formats list them in orders of their own."""
    order = [sorted(rig.joints).index(joint) for joint in rig.joints]
    q, v, a = (x[:, order] for x in np.random.default_rng(seed).normal(size=(3, 20, rig.n)))
    return compute_rnea(rig, q, v, a)[:, np.argsort(order)]


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("seed", range(6))
def test_one_rig_in_every_format_asks_for_the_same_torques(tmp_path: Path, seed: int) -> None:
    tree = parts(seed)
    plain = spelled(as_urdf(tree))
    peer = mujoco.MjModel.from_xml_string(as_mjcf(tree))
    sdf = Rig.load(written(tmp_path, "tree.sdf", as_sdf(tree, ("1.4", "1.9", "1.11")[seed % 3])))
    twin = spelled(mjcf.convert_mujoco_model(peer, "tree.xml")[0])
    peer.opt.gravity[:] = 0, 0, -GRAVITY
    peer.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    expected = torque(peer, sorted(plain.joints), *np.random.default_rng(0).normal(size=(3, 20, 5)))
    scale = np.abs(expected).max()
    for rig in (plain, sdf, twin):
        assert sorted(rig.joints) == ["j0", "j1", "j2", "j3", "j4"]
        np.testing.assert_allclose(torques(rig), expected, rtol=0, atol=1e-12 * scale)
        lower = {joint: limit.lower for joint, limit in zip(rig.joints, rig.limits)}
        assert lower == {
            f"j{k}": -np.inf if part.kind == "continuous" else -2 for k, part in enumerate(tree)
        }


def test_files_are_known_by_what_is_in_them(tmp_path: Path) -> None:
    """Under one suffix, three formats; MJCF on a floating base; xacro with an argument from the rig's YAML."""
    tree = parts(7)
    expected = torques(spelled(as_urdf(tree)))
    for name, text in (
        ("sdf", as_sdf(tree)),
        ("mjcf", as_mjcf(tree, free=True)),
        ("xacro", as_xacro(tree)),
    ):
        path = written(tmp_path, f"{name}.xml", text)
        written(
            tmp_path,
            f"{name}.yaml",
            "xacro: {prefix: l}\n" if name == "xacro" else f"urdf: {name}.xml\n",
        )
        rig = Rig.load(path if name == "mjcf" else tmp_path / f"{name}.yaml")
        np.testing.assert_allclose(torques(rig), expected, rtol=0, atol=1e-11)
        assert "l3" in rig.links


def test_a_xacro_package_is_a_folder_above(tmp_path: Path) -> None:
    folder = tmp_path / "arm_description" / "urdf"
    folder.mkdir(parents=True)
    written(folder, "parts.xacro", as_xacro(parts(8)))
    include = '<xacro:include filename="$(find arm_description)/urdf/parts.xacro"/>'
    space, given = (
        'xmlns:xacro="http://www.ros.org/wiki/xacro"',
        '<xacro:arg name="prefix" default="l"/>',
    )
    top = f'<robot name="top" {space}>{given}{include}</robot>'
    assert Rig.load(written(folder, "top.urdf.xacro", top)).n == 5


SENSORS = """<sdf version="1.9"><model name="g"><link name="base"><inertial><mass>1</mass></inertial></link>
<link name="head"><inertial><mass>1</mass></inertial>{}
<sensor name="eye" type="camera"><pose>0.1 0.2 0.3 0 0 3.141592653589793</pose></sensor>
<sensor name="gyro" type="imu"><pose>0 0 1 0 0 0</pose></sensor></link>
<joint name="tilt" type="revolute"><pose>0 0 0.5 0 0 0</pose><parent>base</parent><child>head</child>
<axis><xyz>0 1 0</xyz></axis></joint></model></sdf>"""


def test_sensors_of_an_sdf_are_links_and_its_camera_the_rigs(tmp_path: Path) -> None:
    rig = Rig.load(written(tmp_path, "g.sdf", SENSORS.format("")))
    assert rig.camera_frame == "eye"
    data = rig.model.createData()
    pin.framesForwardKinematics(rig.model, data, np.zeros(1))
    eye, gyro = (data.oMf[rig.model.getFrameId(name)] for name in ("eye", "gyro"))
    np.testing.assert_allclose(eye.translation, [0.1, 0.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(eye.rotation[:, 0], [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(gyro.translation, [0, 0, 1], atol=1e-15)


EYE = '<camera name="eye" pos="0.1 0.2 0.3" xyaxes="0 1 0 0 0 1"/><site name="gyro" pos="0 0 1"/>'
MUJOCO = f"""<mujoco><worldbody><body name="base"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><body name="head">
<joint name="tilt" axis="0 1 0" pos="0 0 0.5" ref="0.4" armature="0.02" damping="0.3" frictionloss="0.2"/>
<inertial pos="0.3 0 0" mass="1" diaginertia="1 1 1"/>{EYE}</body></body></worldbody>
<actuator><motor joint="tilt" ctrlrange="-3 2" gear="2"/></actuator><sensor><gyro site="gyro"/></sensor></mujoco>"""


def test_what_mujoco_knows_of_motors_and_sensors_is_the_rigs() -> None:
    """A camera looks along its -z; a joint's `ref` is where the file draws it; the rotor moves with the joint."""
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
        other.qpos[:] = q
        mujoco.mj_forward(model, other)
        eye, gyro = (data.oMf[rig.model.getFrameId(name)] for name in ("eye", "gyro"))
        np.testing.assert_allclose(eye.translation, other.cam("eye").xpos, atol=1e-12)
        np.testing.assert_allclose(
            eye.rotation[:, 0], -other.cam("eye").xmat.reshape(3, 3)[:, 2], atol=1e-12
        )
        np.testing.assert_allclose(
            eye.rotation[:, 2], other.cam("eye").xmat.reshape(3, 3)[:, 1], atol=1e-12
        )
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
    assert motor.gear_ratio == 50 and motor.torque_constant == (
        1.0 if kind == "ROS 1" else None
    )  # 50 times 0.02
    assert motor.armature == pytest.approx(0.05 if kind == "Drake" else 0.0)
    written(tmp_path, "r.yaml", "motors: {tilt: {rotor_inertia: 1e-4, encoder_bits: 12}}")
    motor = Rig.load(path).motors[0]
    assert (motor.gear_ratio, motor.rotor_inertia, motor.encoder_bits) == (50, 1e-4, 12)
    q = np.zeros((1, 1))
    v = np.zeros((1, 1))
    a = np.ones((1, 1))
    rig = Rig.load(path)
    assert nominal(rig).inverse(q, v, a) - compute_regressor(
        rig, q, v, a
    ) @ rig.phi == pytest.approx(0.25)


@pytest.mark.parametrize("axis", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_line_of_sight_is_the_axis_that_is_stated(tmp_path: Path, axis: str) -> None:
    path = written(tmp_path, "r.urdf", RIG.format(""))
    written(tmp_path, "r.yaml", f"camera_frame: arm\noptical_axis: {axis}\n")
    rig = Rig.load(path)
    data = rig.model.createData()
    pin.framesForwardKinematics(rig.model, data, np.zeros(1))
    sight = data.oMf[rig.model.getFrameId(rig.camera_frame)].rotation
    expected = np.eye(3)["xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1)
    np.testing.assert_allclose(sight[:, 0], expected, atol=1e-15)
    assert np.linalg.det(sight) == pytest.approx(1.0)


def test_a_joint_that_the_yaml_fixes_is_none(tmp_path: Path) -> None:
    tree = parts(9)
    path = written(tmp_path, "r.urdf", as_urdf(tree))
    full = Rig.load(path)
    written(tmp_path, "r.yaml", "fixed: {j1: 0.4, j3: -0.2}")
    rig = Rig.load(path)
    at = {"j1": 0.4, "j3": -0.2}
    assert sorted(rig.joints) == ["j0", "j2", "j4"]
    draw = np.random.default_rng(1).normal(size=(3, 8, 3))
    kept = [full.joints.index(joint) for joint in rig.joints]
    every = [
        np.tile([at.get(joint, 0.0) * (k == 0) for joint in full.joints], (8, 1)) for k in range(3)
    ]
    for values, own in zip(every, draw):
        values[:, kept] = own
    np.testing.assert_allclose(
        compute_rnea(rig, *draw), compute_rnea(full, *every)[:, kept], atol=1e-12
    )
    written(tmp_path, "r.yaml", "fixed: {j9: 0}")
    with pytest.raises(RigError, match="j9"):
        Rig.load(path)


def changed(old: str, new: str) -> str:
    text = SENSORS.format("")
    assert old in text
    return text.replace(old, new, 1)


BAD = {
    "ball joint": (changed('type="revolute"', 'type="ball"'), "tilt", "ball"),
    "include": (
        changed('<link name="head">', '<include><uri>x</uri></include><link name="head">'),
        "nests",
        "flatten",
    ),
    "nested model": (changed('<link name="head">', '<model name="m"/><link name="head">'), "nests"),
    "two models": (changed("<model", '<model name="o"/><model'), "2 models"),
    "no model": ("<sdf/>", "0 models"),
    "words": (changed("<mass>1</mass>", "<mass>heavy</mass>"), "<mass> holds 'heavy'", ":1:"),
    "short pose": (changed("0.1 0.2 0.3 0 0", "0.1 0.2"), "<pose> holds", "6 numbers"),
    "no such frame": (changed("<pose>0 0 0.5", '<pose relative_to="nose">0 0 0.5'), "nose"),
    "circle": (changed("<pose>0 0 0.5", '<pose relative_to="tilt">0 0 0.5'), "tilt", "itself"),
    "no child": (changed("<child>head", "<child>heda"), "heda"),
    "auto": (changed("<inertial>", '<inertial auto="true">'), "auto"),
    "twins": (changed('joint name="tilt"', 'joint name="head"'), "two", "head"),
    "entity": ("<!DOCTYPE sdf [<!ENTITY m '1'>]>" + SENSORS.format(""), "document type"),
    "no mass": (
        changed('<link name="head"><inertial><mass>1', '<link name="head"><inertial><mass>-1'),
        "mass -1",
    ),
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
    "xacro without a value": (
        '<robot name="$(arg name)" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:if value="1"/></robot>',
        "name",
        "xacro:",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_a_rig_is_told_in_one_line(tmp_path: Path, run: Run, case: str) -> None:
    text, *words = BAD[case]
    code, out, err = run("check", written(tmp_path, "bad.xml", text))
    assert (code, out, err.count("\n")) == (2, "", 1)
    for word in ("bad.xml", *words):
        assert word in err


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<joint", '<joint axis="1 0 0"/><joint', "2 joints"),
        ('axis="0 1 0" pos="0 0 0.5" ref="0.4"', 'type="ball"', "ball"),
        (
            "<actuator>",
            '<equality><weld body1="head" body2="base"/></equality><actuator>',
            "cut the loop",
        ),
    ],
)
def test_a_mujoco_model_that_no_urdf_can_say_is_refused(old: str, new: str, words: str) -> None:
    assert old in MUJOCO
    model = mujoco.MjModel.from_xml_string(MUJOCO.replace(old, new, 1))
    with pytest.raises(RigError, match=words):
        mjcf.convert_mujoco_model(model, "g.xml")


@given(st.data())
def test_a_damaged_sdf_is_a_rig_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    text = SENSORS.format('<pose relative_to="base">0 0 1 0 0 0</pose>')
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(start + 12, len(text))))
    junk = data.draw(st.sampled_from(["", "0", "<x/>", "1e999", "nan", '"', "inf", "head", "-1"]))
    try:
        rig = Rig.load(written(tmp_path, "damaged.sdf", text[:start] + junk + text[end:]))
    except GimbalPinError as error:
        assert "\n" not in str(error)
        return
    assert np.isfinite(torques(rig)).all()
