"""Laws of a rig.

What is bundled is sound; a YAML overlays a URDF; inertias that no torque shows change none, and those that break a rule
are mended to the nearest that does not; parameters come back from the URDF they are written to; one refusal per kind
of wrong file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lxml import etree

from gimbal_pin.dynamics import check, compute_rnea
from gimbal_pin.errors import RigError
from gimbal_pin.log import Array
from gimbal_pin.rig import (
    Limits,
    Motor,
    Rig,
    bundled_payloads,
    bundled_rigs,
    describe_broken_rule,
    find_nearest_inertia,
    is_physical,
    urdf,
)
from tests.command_line import Run
from tests.rigs import COMBINATIONS, bundled

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LINK = """  <link name="{0}">
    <inertial>
      <origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/>
      <mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
"""
JOINT = """  <joint name="{0}" type="revolute">
    <parent link="{1}"/>
    <child link="{2}"/>
    <origin xyz="0 0 0.5" rpy="0 0.5 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1.5" upper="1.5" effort="2" velocity="3"/>
    <dynamics damping="0.1" friction="0.2"/>
  </joint>
"""
TWO = (
    '<robot name="two">\n  <link name="base"/>\n'
    + LINK.format("arm")
    + LINK.format("head")
    + JOINT.format("yaw", "base", "arm")
    + JOINT.format("tilt", "arm", "head")
    + "</robot>\n"
)
"""Two joints, three links: small enough to break in every way."""


def in_two(old: str, new: str) -> str:
    """Return TWO with the first `old` replaced."""
    assert old in TWO
    return TWO.replace(old, new, 1)


def in_head(old: str, new: str) -> str:
    """Return TWO with the `old` of the link that both joints turn replaced."""
    before, _, after = TWO.rpartition(old)
    return before + new + after


def write(folder: Path, content: str, name: str = "two.urdf") -> Path:
    """Return the path of a file that was written."""
    path = folder / name
    path.write_text(content)
    return path


def refused(load: Callable[[], object], *words: str) -> None:
    """Assert that loading raises one line with these words in it."""
    with pytest.raises(RigError) as caught:
        load()
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(("name", "payload"), COMBINATIONS)
def test_every_bundled_combination_is_sound_and_its_motors_hold_it_anywhere(
    name: str, payload: str
) -> None:
    """A payload moves with the last link."""
    rig = bundled(name, payload)
    assert is_physical(rig.phi)
    np.testing.assert_array_equal(rig.phi[:-10], bundled(name, "none").phi[:-10])
    low, high = rig.stops
    assert (-inf < low).all() and (low < 0).all() and (high > 0).all() and (high < inf).all()
    q = low + np.random.default_rng(1).uniform(size=(200, rig.n)) * (high - low)
    holding = np.abs(compute_rnea(rig, q, 0 * q, 0 * q)).max(axis=0)
    assert (holding + rig.friction[:, 0] < rig.tau_max).all()


@pytest.mark.parametrize("payload", sorted({*bundled_payloads()} - {"none"}))
def test_a_payload_weighs_the_same_on_every_rig(payload: str) -> None:
    added = [
        bundled(name, payload).phi[-10] - bundled(name, "none").phi[-10] for name in bundled_rigs()
    ]
    assert added[0] > 0
    np.testing.assert_allclose(added, added[0], atol=1e-12)


def test_a_urdf_needs_no_yaml(tmp_path: Path) -> None:
    """Effort and velocity of zero are not stated."""
    rig = Rig.load(write(tmp_path, in_two('effort="2" velocity="3"', 'effort="0" velocity="0"')))
    assert (rig.joints, rig.base, rig.camera_frame) == (("yaw", "tilt"), "base", "head")
    assert rig.motors == (Motor(), Motor())
    assert rig.limits == (Limits(-1.5, 1.5), Limits(-1.5, 1.5, 3.0, inf, 2.0))
    np.testing.assert_array_equal(rig.friction, [[0.2, 0.1]] * 2)
    np.testing.assert_array_equal(rig.tau_max, [inf, 2.0])
    assert any("yaw: no torque limit" in note for note in check(rig).warnings)


BAD_URDF = {
    "negative mass": (in_two('mass value="1"', 'mass value="-1"'), ":4:", "arm", "mass -1"),
    "mass without value": (in_two('mass value="1"', "mass"), ":6:", "<mass> has no value"),
    "mass beyond machines": (in_two('mass value="1"', 'mass value="1e-12"'), "arm"),
    "no inertia": (in_two(INERTIA, ""), "arm", "no inertia"),
    "inertia of no size": (in_two('ixx="1"', 'ixx="1e8"'), "arm", "radii"),
    "triangle inequality": (in_head('izz="1"', 'izz="2.5"'), "head", "triangle inequality"),
    "not positive definite": (in_head('ixy="0"', 'ixy="1.2"'), "head", "positive definite"),
    "centre of mass": (in_two('xyz="0.1 0.2 0.3"', 'xyz="0.1 0.2"'), ":5:", "3 finite"),
    "moves nothing": (in_two(LINK.format("head"), '<link name="head"/>'), "tilt", "no mass"),
    "loop": (in_two("</robot>", JOINT.format("back", "head", "base") + "</robot>"), "loop"),
    "two parents": (in_two("</robot>", JOINT.format("x", "base", "head") + "</robot>"), "two"),
    "loop apart": (
        in_two("</robot>", LINK.format("l") + JOINT.format("r", "l", "l") + "</robot>"),
        "loop",
    ),
    "two roots": (in_two("</robot>", LINK.format("island") + "</robot>"), "base, island"),
    "no movable joint": (TWO.replace('type="revolute"', 'type="fixed"'), "no movable joint"),
    "planar": (in_two('type="revolute"', 'type="planar"'), "yaw", "planar"),
    "empty": ("", "not XML"),
    "another format": ("<html/>", "<html>", "URDF", "SDF", "MJCF", "xacro"),
    "link twice": (in_two("</robot>", '<link name="arm"/></robot>'), "'arm'"),
    "nameless joint": (in_two('<joint name="yaw"', "<joint"), ":17:", "<joint> has no name"),
    "name of a reference": (in_two('"tilt"', '"ref_yaw"'), "q_ref_yaw"),
    "blank in a name": (in_two('"tilt"', '"tilt "'), "<joint>"),
    "no parent": (in_two('<parent link="base"/>', ""), ":17:", "yaw", "nothing as parent"),
    "misspelled child": (in_two('<child link="arm"/>', '<child link="amr"/>'), "'amr' as child"),
    "axis of no length": (in_two('xyz="0 0 1"', 'xyz="0 0 0"'), "yaw", "axis of zero length"),
    "no limit": (in_two("limit", "lmit"), "yaw", "no <limit>"),
    "limits crossed": (in_two('lower="-1.5"', 'lower="2"'), "yaw", "above upper 1.5"),
    "negative effort": (in_two('effort="2"', 'effort="-2"'), "yaw", "negative limit"),
    "negative friction": (in_two('friction="0.2"', 'friction="-0.2"'), "yaw", "negative friction"),
    "no shape": (in_two("<inertial>", "<visual><geometry/></visual><inertial>"), "no shape"),
}


@pytest.mark.parametrize("case", BAD_URDF)
def test_what_is_no_rig_is_told_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str
) -> None:
    text, *words = BAD_URDF[case]
    path = write(tmp_path, text)
    refused(lambda: Rig.load(path), str(path), *words)
    assert capfd.readouterr() == ("", "")


def test_a_rig_payload_or_joint_that_is_not_there_is_named_with_those_that_are(
    tmp_path: Path,
) -> None:
    path = write(tmp_path, TWO)
    refused(lambda: Rig.load("thesys"), "thesys: is neither", *bundled_rigs())
    refused(lambda: Rig.load("thesis", "canon"), "canon: is neither", *bundled_payloads())
    refused(lambda: Rig.load(path, "cinema"), str(path), "no link 'camera_mount'", "mount:")
    refused(lambda: bundled("thesis").joint_index("jaw"), "jaw", *bundled("thesis").joints)
    write(tmp_path, "fixed: {jaw: 0}", "two.yaml")
    refused(lambda: Rig.load(path), str(path), "no joint 'jaw'")
    write(tmp_path, "mount: head", "two.yaml")
    refused(lambda: Rig.load(path, path), str(path), "both have a link 'arm'")
    path.write_bytes(b"\xff\xfe\x00")
    refused(lambda: Rig.load(path), str(path), "is not text")


def test_a_robot_of_robot_descriptions_is_loaded_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From where the package's own module finds its clone; a YAML may name it, too."""
    pytest.importorskip("robot_descriptions")
    place = tmp_path / "robots" / "panda_description" / "urdf"
    place.mkdir(parents=True)
    write(place, bundled("turret").urdf, "panda.urdf")
    clone = "robot_descriptions._cache.clone_to_cache"
    monkeypatch.setattr(clone, lambda name, commit: str(tmp_path))
    path = write(tmp_path, "urdf: panda_description\nmotors: {pan: {tau_max: 0.5}}", "my.yaml")
    rig = Rig.load(path)
    assert rig.joints == bundled("turret").joints and rig.motors[0].tau_max == 0.5
    refused(lambda: Rig.load("fr3_description"), "xacro alone")
    refused(lambda: Rig.load("nowhere_description"), "robot_descriptions has none of that name")


def test_a_yaml_overlays_a_rig_and_keeps_the_rest(tmp_path: Path) -> None:
    """Overlays stack, and an argument beats the payload that they state."""
    first = "urdf: thesis\npayload: zoom-lens\nmotors: {roll: {tau_max: 2.5}}"
    write(tmp_path, f"{first}\nlimits: {{yaw: {{velocity: 1.1}}}}", "one.yaml")
    second = "urdf: one.yaml\nmotors: {roll: {slots: 15}}\nlimits: {yaw: {upper: 0.9}}"
    path = write(tmp_path, second, "two.yaml")
    rig = Rig.load(path)
    base = bundled("thesis", "zoom-lens")
    np.testing.assert_array_equal(rig.phi, base.phi)
    assert (rig.config.imus, rig.config.noise) == (base.config.imus, base.config.noise)
    roll = replace(base.motors[1], tau_max=2.5, slots=15)
    assert rig.motors == (base.motors[0], roll, base.motors[2])
    yaw = replace(base.limits[0], velocity=1.1, upper=0.9)
    assert rig.limits == (yaw, *base.limits[1:])
    other = bundled("thesis", "infrared")
    np.testing.assert_array_equal(Rig.load(path, "infrared").phi, other.phi)


@pytest.mark.parametrize("far", [10.0, 1e16, inf])
def test_numbers_in_a_yaml_arrive_as_written_and_a_limit_beyond_all_is_none(
    tmp_path: Path, far: float
) -> None:
    """1e16 is SDF's word for it; a motor's torque limit holds where it is below the joint's."""
    motor = {"tau_max": 1.5, "slots": 12, "encoder_bits": 17}
    limit = {"lower": -far, "upper": far, "velocity": far, "effort": far}
    stated = {"motors": {"tilt": motor}, "limits": {"tilt": limit}}
    write(tmp_path, yaml.safe_dump(stated), "two.yaml")
    rig = Rig.load(write(tmp_path, TWO))
    assert rig.motors[1] == Motor(**motor)
    assert rig.limits[1] == (Limits(**limit) if far == 10 else Limits())
    np.testing.assert_array_equal(rig.tau_max, [2.0, 1.5])


BAD_YAML = {
    "unknown key": ("motor: {}", "unknown key 'motor'", "motors"),
    "unknown key of a motor": ("motors: {yaw: {tau: 3}}", "motors.yaw", "'tau'", "tau_max"),
    "unknown joint with a motor": ("motors: {jaw: {tau_max: 3}}", "joint 'jaw'", "yaw, tilt"),
    "unknown IMU link": ("imus: [nose]", "link 'nose'", "base, arm, head"),
    "unknown camera link": ("camera_frame: nose", "link 'nose'", "base, arm, head"),
    "a torque of zero": ("motors: {yaw: {tau_max: 0}}", "motors.yaw.tau_max", "is 0"),
    "a torque that is a truth": ("motors: {yaw: {tau_max: true}}", "tau_max", "no number"),
    "torque not a number": ("motors: {yaw: {tau_max: .nan}}", "motors.yaw.tau_max", "nan"),
    "a motor all of poles": ("motors: {yaw: {poles: 1e12}}", "motors.yaw.poles", "2 to 1000"),
    "half a slot": ("motors: {yaw: {slots: 3.5}}", "motors.yaw.slots", "whole number"),
    "noise without end": ("noise: {gyro: .inf}", "noise.gyro", "is inf"),
    "limits crossed": ("limits: {yaw: {lower: 2}}", "limits.yaw", "above upper 1.5"),
    "motors as a list": ("motors: [1, 2]", "motors", "table"),
    "IMUs as a text": ("imus: arm", "imus", "write a list"),
    "inertia in doubt": ("inertia: maybe", "inertia", "trusted or nominal"),
    "payload as a number": ("payload: 3", "payload", "text"),
    "key twice": ("imus: []\nmotors: {}\nmotors: {}", ":3", "'motors' stands twice"),
    "a text": ("hello", "table of keys"),
    "not YAML": ("motors:\n\t- a", ":2", "not YAML"),
    "code": ("!!python/object/apply:os.getcwd []", "not YAML"),
    "itself": ("urdf: two.yaml", "names itself"),
    "a URDF that is not there": ("urdf: gone.urdf", "gone.urdf"),
    "a model of identify": ("kind: gimbal_pin model\nschema: 1", "not a rig's YAML"),
}


@pytest.mark.parametrize("case", BAD_YAML)
def test_a_yaml_that_cannot_be_used_is_told_in_one_line(tmp_path: Path, case: str) -> None:
    text, *words = BAD_YAML[case]
    beside = write(tmp_path, TWO)
    path = write(tmp_path, text, "two.yaml")
    refused(lambda: Rig.load(path), str(path), *words)
    if case == "a model of identify":
        assert Rig.load(beside).motors == (Motor(), Motor())


NO_BODY = '<inertia ixx="1" iyy="-0.5" izz="2.5" ixy="0.3" ixz="0" iyz="0.1"/>'
"""Neither positive definite nor within the triangle inequality."""


def test_what_no_torque_shows_is_said_and_changes_none(tmp_path: Path) -> None:
    """A link at rest, one that turns one way only, and one whose sum with others is sound."""
    at_rest, arm, tip = (
        LINK.format(name).replace(INERTIA, NO_BODY) for name in ("base", "arm", "tip")
    )
    heavy = LINK.format("ballast").replace('ixx="1" iyy="1" izz="1"', 'ixx="9" iyy="9" izz="9"')
    weld = '<joint name="{0}_" type="fixed"><parent link="head"/><child link="{0}"/></joint>'
    text = in_two('<link name="base"/>', at_rest).replace(LINK.format("arm"), arm)
    ends = (heavy, tip.replace('mass value="1"', 'mass value="0.01"'))
    welds = (weld.format("ballast"), weld.format("tip"))
    text = text.replace("</robot>", "".join([*ends, *welds, "</robot>"]))
    rig = Rig.load(write(tmp_path, text))
    stated = pin.buildModelFromXML(text)
    draw = np.random.default_rng(3).normal(size=(3, 20, 2))
    expected = [pin.rnea(stated, stated.createData(), *row) for row in zip(*draw)]
    np.testing.assert_allclose(compute_rnea(rig, *draw), expected, rtol=1e-9, atol=1e-9)
    places = {"arm": "is kept", "base": "no joint moves", "tip": "their sum"}
    for note, (link, words) in zip(sorted(rig.notes), places.items(), strict=True):
        assert link in note
        assert words in note
    assert is_physical(rig.phi)


def test_a_mended_rig_is_sound_and_mends_to_itself(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path, TWO.replace(INERTIA, NO_BODY))
    out = tmp_path / "out.urdf"
    again = tmp_path / "again.urdf"
    refused(lambda: Rig.load(path), "head", "--mend")
    assert run("check", path, "--mend", out)[0] == 0
    assert Rig.load(out).notes == () and is_physical(Rig.load(out).phi)
    assert run("check", out, "--mend", again)[0] == 0
    assert again.read_text() == out.read_text()
    assert run("check", path, "--mend", path)[0] == 2


@given(hnp.arrays(float, (3, 3), elements=st.floats(-2, 2)))
def test_the_nearest_inertia_is_some_bodys_and_none_is_nearer(drawn: Array) -> None:
    """In the moments ``tr(I)/2 - I``, where bodies are a convex cone: none of them lies towards what was given."""
    inertia = drawn + drawn.T
    found = find_nearest_inertia(1.0, inertia)
    moments, nearest = (np.trace(x) / 2 * np.eye(3) - x for x in (inertia, found))
    assert describe_broken_rule(found) is None
    least, _, most = np.linalg.eigvalsh(moments)
    if least > 1e-5 * np.trace(moments):
        np.testing.assert_allclose(found, inertia, atol=1e-12)
    if most > 0.1:
        for root in np.random.default_rng(0).normal(size=(20, 3, 3)):
            assert np.sum((nearest - moments) * (root @ root.T - nearest)) > -1e-4


MIMIC = '<mimic joint="yaw" multiplier="2" offset="0.3"/>'


@pytest.mark.parametrize("held", ["mimic", "yaml"])
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_joint_that_mimics_or_that_the_yaml_fixes_is_held(
    tmp_path: Path, kind: str, held: str
) -> None:
    text = in_head('type="revolute">', f'type="{kind}">{MIMIC}')
    free = text.replace(MIMIC, "")
    full = Rig.load(write(tmp_path, free, "free.urdf"))
    path = write(tmp_path, text if held == "mimic" else free)
    if held == "yaml":
        write(tmp_path, "fixed: {tilt: 0.3}", "two.yaml")
    rig = Rig.load(path)
    draw = np.random.default_rng(4).normal(size=(3, 10, 1))
    every = [np.hstack([x, np.full((10, 1), at)]) for x, at in zip(draw, (0.3, 0, 0))]
    expected = compute_rnea(full, *every)[:, :1]
    np.testing.assert_allclose(compute_rnea(rig, *draw), expected, atol=1e-12)
    assert rig.joints == ("yaw",)
    assert ["tilt (yaw)" in note for note in rig.notes] == [True] * (held == "mimic")


TAGGED = TWO.replace(
    "</robot>",
    """  <!-- a remark: 3 < 4 -->
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <gazebo reference="arm"><mu1>0.2</mu1><plugin name="p"><inertial>no body</inertial></plugin></gazebo>
</robot>""",
)


def strip(text: str) -> bytes:
    """Return the XML with the attributes of every link's inertial cleared: what is left must not change."""
    robot = etree.fromstring(text.encode())
    for element in robot.xpath("link/inertial/*"):
        element.attrib.clear()
    return etree.tostring(robot, method="c14n")


def test_inertials_arrive_as_written_and_every_other_tag_stays() -> None:
    """Each body is turned to its link's axes; one may be given to a link without any."""
    stated = TAGGED.replace('iyy="1" izz="1" ixy="0"', 'iyy="1.2" izz="1.4" ixy="0.1"')
    again = urdf.replace_inertials(stated, urdf.read_inertials(stated))
    assert strip(again) == strip(stated)
    own = (2.0, np.array([0.1, 0.0, -0.2]), np.diag([0.3, 0.4, 0.5]))
    changed = urdf.replace_inertials(stated, {"base": own, "head": own})
    arm, head = pin.buildModelFromXML(stated).inertias[1:]
    for text, last in ((again, head), (changed, pin.Inertia(*own))):
        bodies = pin.buildModelFromXML(text).inertias
        assert bodies[1].isApprox(arm, 1e-14)
        assert bodies[2].isApprox(last, 1e-14)
    for found, given_ in zip(urdf.read_inertials(changed)["base"], own):
        np.testing.assert_array_equal(found, given_)
