"""Rigs: what is bundled is sound, a YAML overlays a URDF, and what is no rig is told in one line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import fields
from math import inf, pi
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from gimbal_pin.dynamics import compute_rnea
from gimbal_pin.errors import RigError, UsageError
from gimbal_pin.rig import (
    Limits,
    Motor,
    Rig,
    bundled_payloads,
    bundled_rigs,
    describe_broken_rule,
    find_nearest_inertia,
    urdf,
)
from gimbal_pin.rig import bundled as data_folder
from tests.command_line import Run
from tests.rigs import COMBINATIONS, bundled

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
    """TWO with the first `old` replaced."""
    assert old in TWO
    return TWO.replace(old, new, 1)


def in_head(old: str, new: str) -> str:
    """TWO with the `old` of the link that both joints turn replaced, each about a direction of its own."""
    before, _, after = TWO.rpartition(old)
    return before + new + after


def write(folder: Path, content: str, name: str = "two.urdf") -> Path:
    path = folder / name
    path.write_text(content)
    return path


def refused(load: Callable[[], object], *words: str) -> RigError:
    """Assert that loading raises one line with place, fault and mend, exit code 2, and these words in it."""
    with pytest.raises(RigError) as caught:
        load()
    error = caught.value
    text = str(error)
    assert "\n" not in text
    assert error.exit_code == 2
    assert error.place and error.what and error.mend
    assert text == f"{error.place}: {error.what}; {error.mend}"
    for word in words:
        assert word in text
    return error


# --- what is bundled ------------------------------------------------------------------------------------------------


def test_the_promised_rigs_and_payloads_are_there() -> None:
    assert set(bundled_rigs()) >= {"thesis", "handheld", "turret", "drone", "ptu"}
    assert set(bundled_payloads()) >= {"mirrorless", "cinema", "zoom-lens", "infrared", "none"}


def pseudo_inertia(body: pin.Inertia) -> np.ndarray:
    """[[Σ, h], [hᵀ, m]]: positive definite for the bodies that can exist, and for no others (Wensing 2018)."""
    about_origin = body.inertia + body.mass * (
        body.lever @ body.lever * np.eye(3) - np.outer(body.lever, body.lever)
    )
    h = body.mass * body.lever[:, None]
    return np.block(
        [[np.trace(about_origin) / 2 * np.eye(3) - about_origin, h], [h.T, np.array([[body.mass]])]]
    )


@pytest.mark.parametrize(("name", "payload"), COMBINATIONS)
def test_every_bundled_combination_is_sound(name: str, payload: str) -> None:
    rig = bundled(name, payload)
    assert (
        rig.n
        == rig.model.nq
        == rig.model.nv
        == len(rig.links)
        == len(rig.motors)
        == len(rig.limits)
    )
    assert (rig.name, rig.payload) == (name, payload)
    assert np.isfinite(rig.tau_max).all() and (rig.tau_max > 0).all()
    assert rig.friction.shape == (rig.n, 2) and (rig.friction > 0).all()
    for limit, motor in zip(rig.limits, rig.motors):
        assert -inf < limit.lower < 0 < limit.upper < inf
        assert 0 < limit.velocity < inf and 0 < limit.acceleration < inf
        assert motor.slots and motor.poles and motor.encoder_step > 0
    for body in rig.model.inertias[1:]:
        assert np.linalg.eigvalsh(pseudo_inertia(body)).min() > 0
    links = urdf.list_element_names(urdf.parse_robot(rig.urdf, "rig"), "link")
    assert {rig.camera_frame, rig.base, rig.payload_link, *rig.links, *rig.config.imus} <= set(
        links
    )


@pytest.mark.parametrize(("name", "payload"), COMBINATIONS)
def test_the_motors_hold_the_payload_anywhere(name: str, payload: str) -> None:
    rig = bundled(name, payload)
    low, high = (
        np.array([getattr(limit, end) for limit in rig.limits]) for end in ("lower", "upper")
    )
    q = low + np.random.default_rng(1).uniform(size=(200, rig.n)) * (high - low)
    holding = np.abs(compute_rnea(rig, q, 0 * q, 0 * q)).max(axis=0)
    assert (holding + rig.friction[:, 0] < rig.tau_max).all()


@pytest.mark.parametrize("payload", bundled_payloads())
def test_a_payload_weighs_the_same_on_every_rig_and_moves_with_the_last_link(payload: str) -> None:
    added = []
    for name in bundled_rigs():
        bare = bundled(name, "none")
        rig = bundled(name, payload)
        assert (rig.joints, rig.links, rig.base) == (bare.joints, bare.links, bare.base)
        np.testing.assert_array_equal(rig.phi[:-10], bare.phi[:-10])
        added.append(rig.model.inertias[rig.n].mass - bare.model.inertias[rig.n].mass)
    np.testing.assert_allclose(added, added[0], atol=1e-12)
    assert added[0] == 0 if payload == "none" else added[0] > 0


def test_a_bundled_rig_mounts_its_own_payload_unless_told() -> None:
    for name in bundled_rigs():
        stated = yaml.safe_load((data_folder() / f"{name}.yaml").read_text())["payload"]
        assert bundled(name).payload == stated
        np.testing.assert_array_equal(bundled(name).phi, bundled(name, stated).phi)


# --- URDF alone -----------------------------------------------------------------------------------------------------


def test_a_urdf_needs_no_yaml(tmp_path: Path) -> None:
    rig = Rig.load(write(tmp_path, TWO))
    assert rig.joints == ("yaw", "tilt") and rig.links == ("arm", "head")
    assert (rig.name, rig.base, rig.camera_frame, rig.payload) == ("two", "base", "head", None)
    assert rig.motors == (Motor(), Motor())
    assert rig.limits == (Limits(-1.5, 1.5, 3.0, inf, 2.0),) * 2
    np.testing.assert_array_equal(rig.friction, [[0.2, 0.1]] * 2)
    np.testing.assert_array_equal(rig.tau_max, [2.0, 2.0])


def test_tau_max_is_the_smaller_of_motor_and_joint(tmp_path: Path) -> None:
    write(tmp_path, TWO)
    path = write(tmp_path, "motors: {yaw: {tau_max: 1.5}, tilt: {tau_max: 9}}", "two.yaml")
    np.testing.assert_array_equal(Rig.load(path).tau_max, [1.5, 2.0])


def test_effort_and_velocity_of_zero_are_not_stated(tmp_path: Path) -> None:
    rig = Rig.load(write(tmp_path, in_two('effort="2" velocity="3"', 'effort="0" velocity="0"')))
    assert rig.limits[0] == Limits(-1.5, 1.5)
    assert rig.limits[1] == Limits(-1.5, 1.5, 3.0, inf, 2.0)


@pytest.mark.parametrize(
    "limit", ["", '<limit effort="2" velocity="3"/>', '<limit lower="-1" effort="2" velocity="3"/>']
)
def test_continuous_joints_keep_one_angle_without_bounds(tmp_path: Path, limit: str) -> None:
    text = in_two('type="revolute"', 'type="continuous"')
    text = text.replace('<limit lower="-1.5" upper="1.5" effort="2" velocity="3"/>', limit, 1)
    rig = Rig.load(write(tmp_path, text))
    plain = Rig.load(write(tmp_path, TWO, "plain.urdf"))
    assert rig.model.nq == rig.model.nv == rig.n == 2
    assert (rig.limits[0].lower, rig.limits[0].upper) == (-inf, inf)
    assert 'type="continuous"' in rig.urdf
    q, v, a = np.random.default_rng(2).normal(size=(3, 10, 2))
    turned = q + 2 * pi * np.array([40, 0])
    np.testing.assert_allclose(
        compute_rnea(rig, turned, v, a), compute_rnea(plain, q, v, a), atol=1e-11
    )


BAD_URDF = {
    "negative mass": (in_two('mass value="1"', 'mass value="-1"'), ":4:", "arm", "mass -1"),
    "no mass at all": (in_two('<mass value="1"/>', ""), "arm", "no mass"),
    "mass without value": (in_two('mass value="1"', "mass"), ":6:", "<mass> has no value"),
    "mass in words": (in_two('mass value="1"', 'mass value="heavy"'), ":6:", "heavy"),
    "mass not a number": (in_two('mass value="1"', 'mass value="nan"'), ":6:", "nan"),
    "no inertia": (
        in_two('<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>', ""),
        "arm",
        "no inertia",
    ),
    "half an inertia": (in_two(' ixy="0"', ""), ":7:", "<inertia> has no ixy"),
    "infinite inertia": (in_two('ixx="1"', 'ixx="inf"'), ":7:", "ixx='inf'"),
    "triangle inequality": (
        in_head('izz="1"', 'izz="2.5"'),
        "head",
        "triangle inequality",
        "--mend",
    ),
    "not positive definite": (
        in_head('ixy="0"', 'ixy="1.2"'),
        "head",
        "positive definite",
        "--mend",
    ),
    "centre of mass": (
        in_two('xyz="0.1 0.2 0.3"', 'xyz="0.1 0.2"'),
        ":5:",
        "<origin> has xyz='0.1 0.2'",
        "3 finite",
    ),
    "moves nothing": (in_two(LINK.format("head"), '<link name="head"/>'), "tilt", "moves no mass"),
    "loop": (in_two("</robot>", JOINT.format("back", "head", "base") + "</robot>"), "loop"),
    "two parents": (
        in_two("</robot>", JOINT.format("extra", "base", "head") + "</robot>"),
        "head",
        "two parent",
    ),
    "loop apart": (
        in_two("</robot>", LINK.format("lone") + JOINT.format("ring", "lone", "lone") + "</robot>"),
        "lone",
        "loop",
    ),
    "two roots": (
        in_two("</robot>", LINK.format("island") + "</robot>"),
        "2 root links: base, island",
    ),
    "no movable joint": (TWO.replace('type="revolute"', 'type="fixed"'), "no movable joint"),
    "no joints": ('<robot name="x"><link name="a"/></robot>', "no movable joint"),
    "no links": ('<robot name="x"/>', "no root link"),
    "floating": (
        in_two('type="revolute"', 'type="floating"'),
        "yaw",
        "floating",
        "revolute, continuous, prismatic",
    ),
    "planar": (in_two('type="revolute"', 'type="planar"'), "yaw", "planar"),
    "no type": (in_two(' type="revolute"', ""), "yaw", "type None"),
    "broken XML": (TWO.replace("</robot>", ""), "not XML"),
    "empty": ("", "not XML"),
    "another format": ("<html/>", "<html>", "URDF", "SDF", "MJCF", "xacro"),
    "link twice": (in_two("</robot>", '<link name="arm"/></robot>'), "two links are named 'arm'"),
    "joint twice": (in_two('name="tilt"', 'name="yaw"'), "two joints are named 'yaw'"),
    "nameless joint": (in_two('<joint name="yaw"', "<joint"), ":17:", "<joint> has no name"),
    "nameless link": (in_two('<link name="base"/>', "<link/>"), ":2:", "<link> has no name"),
    "nameless robot": (in_two(' name="two"', ""), ":1:", "<robot> has no name"),
    "no parent": (in_two('<parent link="base"/>', ""), ":17:", "yaw", "nothing as parent"),
    "misspelled child": (
        in_two('<child link="arm"/>', '<child link="amr"/>'),
        ":17:",
        "yaw",
        "'amr' as child",
    ),
    "axis of no length": (in_two('xyz="0 0 1"', 'xyz="0 0 0"'), "yaw", "axis of zero length"),
    "axis of two numbers": (in_two('xyz="0 0 1"', 'xyz="0 1"'), ":21:", "<axis> has xyz='0 1'"),
    "axis with commas": (in_two('xyz="0 0 1"', 'xyz="0,0,1"'), ":21:", "<axis> has xyz='0,0,1'"),
    "no limit": (
        in_two('<limit lower="-1.5" upper="1.5" effort="2" velocity="3"/>', ""),
        "yaw",
        "no <limit>",
    ),
    "no effort": (in_two(' effort="2"', ""), ":22:", "<limit> has no effort"),
    "limits crossed": (
        in_two('lower="-1.5"', 'lower="2"'),
        "yaw",
        "lower limit 2",
        "above upper 1.5",
    ),
    "negative effort": (in_two('effort="2"', 'effort="-2"'), "yaw", "negative limit"),
    "negative friction": (in_two('friction="0.2"', 'friction="-0.2"'), "yaw", "negative friction"),
    "damping in words": (in_two('damping="0.1"', 'damping="little"'), ":23:", "little"),
    "visual without shape": (
        in_two("<inertial>", "<visual><geometry/></visual><inertial>"),
        "<visual> has no shape",
    ),
}


@pytest.mark.parametrize("case", BAD_URDF)
def test_what_is_no_rig_is_told_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str
) -> None:
    text, *words = BAD_URDF[case]
    path = write(tmp_path, text)
    refused(lambda: Rig.load(path), str(path), *words)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["nowhere.urdf", "nowhere.yaml", "thesys", "."])
def test_a_rig_that_is_not_there(name: str) -> None:
    refused(lambda: Rig.load(name), f"{name}: is neither a file nor a bundled rig", *bundled_rigs())


@pytest.fixture
def clones(
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Callable[[Callable[[str, str | None], str]], None]]:
    """Puts a function in the place of what clones a repository for robot_descriptions; its own modules are kept."""
    pytest.importorskip("robot_descriptions")
    yield lambda clone: monkeypatch.setattr("robot_descriptions._cache.clone_to_cache", clone)
    for name in ("panda_description", "fr3_description"):
        sys.modules.pop(f"robot_descriptions.{name}", None)


def test_a_robot_of_robot_descriptions_is_loaded_by_its_name(
    tmp_path: Path, clones: Callable[..., None]
) -> None:
    """The package's own module, which finds its clone here: the download is not tried. A YAML may name it, too."""
    place = tmp_path / "robots" / "panda_description" / "urdf"
    place.mkdir(parents=True)
    (place / "panda.urdf").write_text(bundled("turret").urdf)
    clones(lambda name, commit: str(tmp_path))
    loaded = Rig.load("panda_description")
    assert (loaded.name, loaded.joints) == ("panda", bundled("turret").joints)
    (tmp_path / "mine.yaml").write_text("urdf: panda_description\nmotors:\n  pan: {tau_max: 0.5}\n")
    assert Rig.load(tmp_path / "mine.yaml").motors[0].tau_max == 0.5


def test_a_robot_that_cannot_be_had_is_told_with_the_reason(
    clones: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    from git.exc import GitCommandError

    def clone(name: str, commit: str | None) -> str:
        raise GitCommandError("clone", 128, "Could not resolve host")

    refused(lambda: Rig.load("nowhere_description"), "robot_descriptions has none of that name")
    clones(clone)
    refused(
        lambda: Rig.load("panda_description"),
        "panda_description",
        "cannot be fetched",
        "Could not resolve host",
    )
    clones(lambda name, commit: "/nowhere")
    refused(lambda: Rig.load("fr3_description"), "xacro alone")
    monkeypatch.setattr("gimbal_pin.rig.files.find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"pip install 'gimbal-pin\[robots\]'"):
        Rig.load("panda_description")


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_bytes(b"\xff\xfe\x00")
    refused(lambda: Rig.load(path), str(path), "is not text")


def test_payloads_that_cannot_be_mounted(tmp_path: Path) -> None:
    path = write(tmp_path, TWO)
    refused(lambda: Rig.load("thesis", "canon"), "canon: is neither", *bundled_payloads())
    refused(lambda: Rig.load(path, "cinema"), str(path), "no link 'camera_mount'", "mount:")
    write(tmp_path, "mount: head", "two.yaml")
    refused(
        lambda: Rig.load(path, path), str(path), "both have a link 'arm'", "name the rig without it"
    )
    weightless = f'<robot name="p">\n{LINK.format("p")}</robot>'.replace(
        "<mass value=", "<mass worth="
    )
    part = write(tmp_path, weightless, "p.urdf")
    refused(lambda: Rig.load(path, part), f"{part}:5:", "<mass> has no value")


def test_an_unknown_joint_is_told_with_those_there_are() -> None:
    rig = bundled("thesis")
    assert [rig.joint_index(joint) for joint in rig.joints] == [0, 1, 2]
    refused(lambda: rig.joint_index("jaw"), "jaw", *rig.joints)


# --- YAML -----------------------------------------------------------------------------------------------------------


def test_a_yaml_overlays_a_bundled_rig_and_keeps_the_rest(tmp_path: Path) -> None:
    text = """
    urdf: thesis
    payload: zoom-lens
    inertia: trusted
    motors: {roll: {tau_max: 2.5}}
    limits: {tilt: {upper: 0.9}, yaw: {velocity: 1.1}}
    """
    rig = Rig.load(write(tmp_path, text, "mine.yaml"))
    base = bundled("thesis", "zoom-lens")
    assert rig.payload == "zoom-lens" and rig.config.inertia == "trusted"
    assert (rig.config.imus, rig.config.noise) == (base.config.imus, base.config.noise)
    assert rig.camera_frame == base.camera_frame
    np.testing.assert_array_equal(rig.phi, base.phi)
    ours = rig.motors[1]
    theirs = base.motors[1]
    assert ours.tau_max == 2.5 != theirs.tau_max
    assert (ours.torque_constant, ours.slots, ours.poles, ours.encoder_bits) == (
        theirs.torque_constant,
        theirs.slots,
        theirs.poles,
        theirs.encoder_bits,
    )
    assert (rig.motors[0], rig.motors[2]) == (base.motors[0], base.motors[2])
    assert rig.limits[2].upper == 0.9 and rig.limits[2].acceleration == base.limits[2].acceleration
    assert (
        rig.limits[0].velocity == 1.1 and rig.limits[0].acceleration == base.limits[0].acceleration
    )
    assert rig.limits[1] == base.limits[1]


def test_an_empty_overlay_changes_nothing(tmp_path: Path) -> None:
    rig = Rig.load(write(tmp_path, "urdf: handheld", "mine.yaml"))
    base = bundled("handheld")
    for field in ("joints", "links", "motors", "limits", "base", "camera_frame", "payload", "urdf"):
        assert getattr(rig, field) == getattr(base, field)
    assert rig.config.urdf == "handheld"


def test_overlays_stack(tmp_path: Path) -> None:
    write(
        tmp_path,
        "urdf: turret\nmotors: {pan: {tau_max: 1}}\nlimits: {pan: {velocity: 1}}",
        "one.yaml",
    )
    path = write(
        tmp_path,
        "urdf: one.yaml\nmotors: {pan: {slots: 12}}\nlimits: {pan: {upper: 1}}",
        "two.yaml",
    )
    rig = Rig.load(path)
    base = bundled("turret")
    assert (rig.motors[0].tau_max, rig.motors[0].slots, rig.motors[0].poles) == (
        1,
        12,
        base.motors[0].poles,
    )
    assert (rig.limits[0].velocity, rig.limits[0].upper, rig.limits[0].lower) == (
        1,
        1,
        base.limits[0].lower,
    )


def test_paths_in_a_yaml_are_relative_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "rigs"
    folder.mkdir()
    write(folder, TWO, "body.urdf")
    write(folder, f'<robot name="p">{LINK.format("load")}</robot>', "load.urdf")
    path = write(folder, "urdf: body.urdf\nmount: head\npayload: load.urdf", "mine.yaml")
    monkeypatch.chdir(tmp_path)
    for name in (path, "rigs/mine.yaml"):
        rig = Rig.load(name)
        assert (rig.payload, rig.payload_link) == ("load", "load")
        assert rig.model.inertias[2].mass == pytest.approx(2.0)


def test_an_argument_beats_the_yaml_payload(tmp_path: Path) -> None:
    path = write(tmp_path, "urdf: thesis\npayload: zoom-lens", "mine.yaml")
    np.testing.assert_array_equal(Rig.load(path, "infrared").phi, bundled("thesis", "infrared").phi)


SIZE = st.floats(1e-9, 1e6)
MOTOR = st.fixed_dictionaries(
    {},
    optional={
        "tau_max": SIZE,
        "torque_constant": SIZE,
        "slots": st.integers(1, 99),
        "poles": st.integers(2, 99),
        "encoder_bits": st.floats(1, 30),
    },
)
LIMIT = st.fixed_dictionaries(
    {},
    optional={
        "lower": st.floats(-10, 0),
        "upper": st.floats(0, 10),
        "velocity": SIZE,
        "acceleration": SIZE,
        "effort": SIZE,
    },
)


@given(MOTOR, LIMIT)
def test_numbers_in_a_yaml_arrive_as_written(
    tmp_path: Path, motor: dict[str, float], limit: dict[str, float]
) -> None:
    write(tmp_path, TWO)
    path = write(
        tmp_path, yaml.safe_dump({"motors": {"tilt": motor}, "limits": {"tilt": limit}}), "two.yaml"
    )
    rig = Rig.load(path)
    assert rig.motors == (Motor(), Motor(**motor))
    urdf_limits = {field.name: getattr(rig.limits[0], field.name) for field in fields(Limits)}
    assert rig.limits[1] == Limits(**{**urdf_limits, **limit})


@pytest.mark.parametrize("size", [1e16, 1e160, float("inf")])
def test_a_limit_beyond_all_is_none(tmp_path: Path, size: float) -> None:
    """1e16 is SDF's word for it; the squares of what is larger are no numbers."""
    write(tmp_path, TWO)
    limit = {"lower": -size, "upper": size, "velocity": size, "acceleration": size, "effort": size}
    rig = Rig.load(write(tmp_path, yaml.safe_dump({"limits": {"tilt": limit}}), "two.yaml"))
    assert rig.limits[1] == Limits()


BAD_YAML = {
    "unknown key": ("motor: {}", "unknown key 'motor'", "motors"),
    "unknown key of a motor": (
        "motors: {yaw: {tau: 3}}",
        "motors.yaw",
        "unknown key 'tau'",
        "tau_max",
    ),
    "unknown key of a limit": (
        "limits: {yaw: {top: 3}}",
        "limits.yaw",
        "unknown key 'top'",
        "upper",
    ),
    "unknown key of the noise": ("noise: {gyros: 1}", "noise", "unknown key 'gyros'"),
    "unknown joint with a motor": ("motors: {jaw: {tau_max: 3}}", "joint 'jaw'", "yaw, tilt"),
    "unknown joint with a limit": ("limits: {jaw: {upper: 3}}", "joint 'jaw'", "yaw, tilt"),
    "unknown IMU link": ("imus: [nose]", "link 'nose'", "base, arm, head"),
    "unknown camera link": ("camera_frame: nose", "link 'nose'", "base, arm, head"),
    "torque in words": ("motors: {yaw: {tau_max: strong}}", "motors.yaw", "strong"),
    "a torque of zero": ("motors: {yaw: {tau_max: 0}}", "motors.yaw.tau_max", "is 0"),
    "a torque that is a truth": (
        "motors: {yaw: {tau_max: true}}",
        "motors.yaw.tau_max",
        "no number",
    ),
    "no constant": ("motors: {yaw: {torque_constant: 0}}", "motors.yaw.torque_constant", "is 0"),
    "an encoder finer than numbers": (
        "motors: {yaw: {encoder_bits: 5000}}",
        "motors.yaw.encoder_bits",
        "1 to 52",
    ),
    "a motor all of poles": ("motors: {yaw: {poles: 1e12}}", "motors.yaw.poles", "2 to 1000"),
    "a speed of zero": ("limits: {yaw: {velocity: 0}}", "limits.yaw.velocity", "is 0"),
    "noise without end": ("noise: {gyro: .inf}", "noise.gyro", "is inf"),
    "no torque": ("motors: {yaw: {tau_max: }}", "motors.yaw", "no number"),
    "torque not a number": ("motors: {yaw: {tau_max: .nan}}", "motors.yaw.tau_max", "nan"),
    "negative torque": ("motors: {yaw: {tau_max: -3}}", "motors.yaw.tau_max", "-3"),
    "negative speed": ("limits: {yaw: {velocity: -1}}", "limits.yaw.velocity", "-1"),
    "half a slot": ("motors: {yaw: {slots: 3.5}}", "motors.yaw.slots", "whole number"),
    "slots not a number": ("motors: {yaw: {slots: .nan}}", "motors.yaw.slots", "nan"),
    "slots without end": ("motors: {yaw: {slots: .inf}}", "motors.yaw.slots", "is inf"),
    "limits crossed": ("limits: {yaw: {lower: 2}}", "limits.yaw", "lower limit 2 above upper 1.5"),
    "motors as a list": ("motors: [1, 2]", "motors", "table"),
    "motor as a number": ("motors: {yaw: 3}", "motors.yaw", "table of keys"),
    "noise as a number": ("noise: 5", "noise", "table of keys"),
    "IMUs as a text": ("imus: arm", "imus", "write a list"),
    "IMUs as a number": ("imus: 5", "imus", "write a list"),
    "inertia in doubt": ("inertia: maybe", "inertia", "trusted or nominal"),
    "description as a list": ("description: [a]", "description", "text"),
    "payload as a number": ("payload: 3", "payload", "text"),
    "payload nowhere": ("payload: canon", "canon", "bundled payload"),
    "URDF as a number": ("urdf: 3", "urdf", "text"),
    "key twice": ("imus: []\nmotors: {}\nmotors: {}", ":3", "'motors' stands twice"),
    "joint twice": ("motors: {yaw: {slots: 3}, yaw: {slots: 4}}", ":1", "'yaw' stands twice"),
    "value twice": ("motors:\n  yaw: {slots: 3, slots: 4}", ":2", "'slots' stands twice"),
    "a list": ("- a", "table of keys"),
    "a text": ("hello", "table of keys"),
    "not YAML": ("motors:\n\t- a", ":2", "not YAML"),
    "unclosed": ("motors: {yaw: {tau_max: 3}", ":1", "not YAML"),
    "code": ("!!python/object/apply:os.getcwd []", "not YAML"),
    "itself": ("urdf: two.yaml", "names itself"),
}


@pytest.mark.parametrize("case", BAD_YAML)
def test_a_yaml_that_cannot_be_used_is_told_in_one_line(tmp_path: Path, case: str) -> None:
    text, *words = BAD_YAML[case]
    write(tmp_path, TWO)
    path = write(tmp_path, text, "two.yaml")
    place = "canon" if case == "payload nowhere" else str(path)
    refused(lambda: Rig.load(path), place, *words)
    if "urdf" not in text:
        refused(lambda: Rig.load(tmp_path / "two.urdf"), place, *words)


def test_a_model_beside_a_urdf_is_not_its_yaml(tmp_path: Path) -> None:
    """What `identify x.urdf … -o x.yaml --urdf x.urdf` leaves is a rig, the same as where the model lies elsewhere."""
    urdf_file = write(tmp_path, TWO)
    alone = Rig.load(urdf_file)
    model = write(tmp_path, "kind: gimbal_pin model\nschema: 1", "two.yaml")
    beside = Rig.load(urdf_file)
    assert beside.config == alone.config and beside.urdf == alone.urdf
    refused(lambda: Rig.load(model), str(model), "not a rig's YAML", "give the rig's URDF")


def test_the_yaml_that_is_wrong_is_the_one_named(tmp_path: Path) -> None:
    path = write(tmp_path, "urdf: thesis\nmotors: {jaw: {tau_max: 3}}", "mine.yaml")
    refused(lambda: Rig.load(path), str(path), "jaw", "yaw, roll, tilt")
    write(tmp_path, "urdf: there.yaml", "here.yaml")
    write(tmp_path, "urdf: here.yaml", "there.yaml")
    refused(lambda: Rig.load(tmp_path / "here.yaml"), "here.yaml", "names itself")
    missing = write(tmp_path, "urdf: gone.urdf", "missing.yaml")
    refused(lambda: Rig.load(missing), str(missing), "gone.urdf")


# --- inertias that break a rule -------------------------------------------------------------------------------------

NO_BODY = '<inertia ixx="1" iyy="-0.5" izz="2.5" ixy="0.3" ixz="0" iyz="0.1"/>'
"""Neither positive definite nor within the triangle inequality."""
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'


def torques(rig: Rig) -> np.ndarray:
    return compute_rnea(rig, *np.random.default_rng(3).normal(size=(3, 20, rig.n)))


def stated(text: str) -> np.ndarray:
    """Torques of what a URDF states, whether a body can have it or not."""
    model = pin.buildModelFromXML(text)
    q, v, a = np.random.default_rng(3).normal(size=(3, 20, model.nv))
    return np.array([pin.rnea(model, model.createData(), *row) for row in zip(q, v, a)])


def test_what_no_torque_shows_is_said_and_changes_none(tmp_path: Path) -> None:
    """A link at rest, one that weighs nothing, one that turns one way only, and one whose sum with others is sound."""
    at_rest = LINK.format("base").replace(INERTIA, NO_BODY)
    ballast = LINK.format("ballast").replace(INERTIA, INERTIA.replace('="1"', '="9"'))
    tip = (
        LINK.format("tip")
        .replace(INERTIA, NO_BODY)
        .replace('<mass value="1"/>', '<mass value="0.01"/>')
    )
    mark = (
        '<link name="mark"><inertial><mass value="0"/>'
        + INERTIA.replace('"1"', '"0"')
        + "</inertial></link>"
    )
    fixed = "".join(
        f'<joint name="to_{link}" type="fixed"><parent link="head"/><child link="{link}"/></joint>'
        for link in ("ballast", "tip", "mark")
    )
    text = in_two('<link name="base"/>', at_rest).replace(
        "</robot>", ballast + tip + mark + fixed + "</robot>"
    )
    text = text.replace(LINK.format("arm"), LINK.format("arm").replace(INERTIA, NO_BODY))
    rig = Rig.load(write(tmp_path, text))
    np.testing.assert_allclose(torques(rig), stated(text), rtol=1e-9, atol=1e-9)
    for link, words in (
        ("mark", "no mass"),
        ("base", "no joint moves"),
        ("arm", "is kept"),
        ("tip", "their sum"),
    ):
        assert sum(link in note and words in note for note in rig.notes) == 1
    assert len(rig.notes) == 4
    for body in rig.model.inertias[1:]:
        assert np.linalg.eigvalsh(pseudo_inertia(body)).min() > 0


def test_a_mended_rig_is_sound_and_another_mends_to_itself(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path, TWO.replace(INERTIA, NO_BODY))
    out = tmp_path / "out.urdf"
    refused(lambda: Rig.load(path), "head", "--mend")
    assert run("check", path, "--mend", out)[0] == 0
    rig = Rig.load(out)
    assert rig.notes == ()
    for body in rig.model.inertias[1:]:
        assert np.linalg.eigvalsh(pseudo_inertia(body)).min() > 0
    again = tmp_path / "again.urdf"
    assert run("check", out, "--mend", again)[0] == 0
    assert again.read_text() == out.read_text()
    assert run("check", path, "--mend", path)[0] == 2


@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6))
def test_the_nearest_inertia_is_some_bodys_and_none_is_nearer(entries: list[float]) -> None:
    inertia = np.zeros((3, 3))
    inertia[np.tril_indices(3)] = entries
    inertia = inertia + np.tril(inertia, -1).T
    found = find_nearest_inertia(1.0, inertia)

    def moments(x):
        return np.trace(x) / 2 * np.eye(3) - x

    small, middle, large = np.linalg.eigvalsh(found)
    assert small > 0 and small + middle > large
    if describe_broken_rule(inertia) is None and np.linalg.eigvalsh(moments(inertia))[
        0
    ] > 1e-5 * np.trace(moments(inertia)):
        np.testing.assert_allclose(found, inertia, atol=1e-12)
    rng = np.random.default_rng(0)
    for _ in range(20):
        other = (root := rng.normal(size=(3, 3))) @ root.T
        way = other - moments(found)
        if np.linalg.eigvalsh(moments(inertia)).max() > 0.1:  # no descent towards any other body
            assert np.sum((moments(found) - moments(inertia)) * way) > -1e-4


def test_the_root_world_need_not_be_declared(tmp_path: Path) -> None:
    weld = (
        '<joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint></robot>'
    )
    rig = Rig.load(write(tmp_path, in_two("</robot>", weld)))
    assert rig.base == "world"
    np.testing.assert_array_equal(rig.phi, Rig.load(write(tmp_path, TWO, "plain.urdf")).phi)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_joint_that_mimics_is_held_at_its_offset(tmp_path: Path, kind: str) -> None:
    mimics = in_head(
        'type="revolute">', f'type="{kind}"><mimic joint="yaw" multiplier="2" offset="0.3"/>'
    )
    rig = Rig.load(write(tmp_path, mimics))
    free = Rig.load(write(tmp_path, mimics.replace("<mimic", "<x"), "free.urdf"))
    q, v, a = (np.random.default_rng(4).normal(size=(10, 2)) * [1, 0] + [0, c] for c in (0.3, 0, 0))
    np.testing.assert_allclose(
        compute_rnea(rig, q[:, :1], v[:, :1], a[:, :1])[:, 0],
        compute_rnea(free, q, v, a)[:, 0],
        atol=1e-12,
    )
    assert rig.joints == ("yaw",) and "mimics" in rig.notes[0] and "tilt (yaw)" in rig.notes[0]


# --- nothing else comes out -----------------------------------------------------------------------------------------

WORDS = [
    "",
    " ",
    "0",
    "-1",
    "1",
    "nan",
    "inf",
    "1e999",
    "x",
    "0 0",
    "0 0 0",
    "1 0 0",
    "0 0 1 1",
    "arm",
    "yaw",
    "fixed",
]


def elements(robot: etree._Element) -> list[etree._Element]:
    return [
        element for element in robot.iter() if isinstance(element.tag, str) and element is not robot
    ]


@st.composite
def broken(draw: st.DrawFn) -> str:
    """TWO with one or two attributes or elements changed, taken away or doubled."""
    robot = etree.fromstring(TWO)
    for _ in range(draw(st.integers(1, 2))):
        element = draw(st.sampled_from(elements(robot)))
        what = draw(
            st.sampled_from(["attribute", "attribute", "remove attribute", "remove", "double"])
        )
        if what == "remove":
            element.getparent().remove(element)
        elif what == "double":
            element.getparent().append(etree.fromstring(etree.tostring(element)))
        elif element.attrib:
            key = draw(st.sampled_from(sorted(element.attrib)))
            if what == "attribute":
                element.set(key, draw(st.sampled_from(WORDS)))
            else:
                del element.attrib[key]
        if not elements(robot):
            break
    return etree.tostring(robot).decode()


@given(broken())
def test_a_broken_urdf_is_refused_or_is_a_rig_that_can_move(tmp_path: Path, text: str) -> None:
    path = write(tmp_path, text, "broken.urdf")
    try:
        rig = Rig.load(path)
    except RigError as error:
        assert str(path) in str(error) and "\n" not in str(error)
        return
    q, v, a = np.random.default_rng(0).normal(size=(3, 5, rig.n))
    assert np.isfinite(compute_rnea(rig, q, v, a)).all()
    inertia = pin.crba(rig.model, rig.model.createData(), q[0])
    assert np.linalg.eigvalsh(inertia, UPLO="U").min() > 0
    for body in rig.model.inertias[1:]:
        assert np.linalg.eigvalsh(pseudo_inertia(body)).min() > -1e-9


VALUE = st.recursive(
    st.one_of(
        st.none(), st.booleans(), st.integers(-5, 5), st.floats(), st.text("ab1.-", max_size=4)
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=2),
        st.dictionaries(st.sampled_from(["yaw", "tilt", "tau_max", "lower", "gyro"]), inner),
    ),
    max_leaves=4,
)


@given(
    st.sampled_from(
        ["motors", "limits", "imus", "noise", "urdf", "payload", "mount", "inertia", "x"]
    ),
    VALUE,
)
def test_any_value_in_a_yaml_is_used_or_refused(tmp_path: Path, key: str, value: object) -> None:
    write(tmp_path, TWO)
    path = write(tmp_path, yaml.safe_dump({key: value}), "two.yaml")
    try:
        rig = Rig.load(path)
    except RigError as error:
        assert "\n" not in str(error)
        return
    assert not np.isnan(rig.tau_max).any() and (rig.tau_max >= 0).all()
    assert all(limit.lower <= limit.upper for limit in rig.limits)


# --- parameters back into a URDF ------------------------------------------------------------------------------------

TAGGED = TWO.replace(
    "</robot>",
    """  <!-- a remark: 3 < 4 -->
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="yaw"/></transmission>
  <gazebo reference="arm"><mu1>0.2</mu1><plugin name="p"><inertial>no body</inertial></plugin></gazebo>
  <ros2_control name="c" type="system"><joint name="yaw"><command_interface name="effort"/></joint></ros2_control>
</robot>""",
)
TAGGED = TAGGED.replace("<inertial>", "<!-- weighed --><inertial>")
TAGGED = TAGGED.replace('iyy="1" izz="1" ixy="0"', 'iyy="1.2" izz="1.4" ixy="0.1"')


@st.composite
def bodies(draw: st.DrawFn) -> tuple[float, np.ndarray, np.ndarray]:
    """A body that can exist: a cloud of six points."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    masses = rng.uniform(0.01, 2, 6)
    points = rng.normal(size=(6, 3))
    com = masses @ points / masses.sum()
    arms = points - com
    inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arms))
    return float(masses.sum()), com, inertia


def without_numbers(text: str) -> bytes:
    """The XML with the attributes of every link's inertial cleared: what is left must not change."""
    robot = etree.fromstring(text.encode())
    for element in robot.xpath("link/inertial/*"):
        element.attrib.clear()
    return etree.tostring(robot, method="c14n")


@given(bodies(), bodies())
def test_inertials_arrive_and_every_other_tag_stays(
    arm: tuple[float, np.ndarray, np.ndarray], head: tuple[float, np.ndarray, np.ndarray]
) -> None:
    both = urdf.replace_inertials(TAGGED, {"arm": arm, "head": head})
    one = urdf.replace_inertials(TAGGED, {"head": head})
    assert without_numbers(both) == without_numbers(one) == without_numbers(TAGGED)
    for text, expected in ((both, (arm, head)), (one, (None, head))):
        model = pin.buildModelFromXML(text)
        original = pin.buildModelFromXML(TAGGED)
        for k, body in enumerate(expected, start=1):
            wanted = original.inertias[k] if body is None else pin.Inertia(*body)
            assert model.inertias[k].isApprox(wanted, 1e-14)
    for name, body in urdf.read_inertials(both).items():
        for ours, given_ in zip(body, {"arm": arm, "head": head}[name]):
            np.testing.assert_array_equal(ours, given_)


def test_writing_what_is_there_changes_no_torque() -> None:
    """`inertials` turns each body to its link's axes, which `with_inertials` writes: the same rig."""
    for text in (TAGGED, bundled("thesis").urdf):
        again = urdf.replace_inertials(text, urdf.read_inertials(text))
        for ours, theirs in zip(
            pin.buildModelFromXML(again).inertias, pin.buildModelFromXML(text).inertias
        ):
            np.testing.assert_allclose(
                ours.toDynamicParameters(), theirs.toDynamicParameters(), atol=1e-14
            )


def test_a_link_without_inertial_is_given_one() -> None:
    body = (2.0, np.array([0.1, 0.0, -0.2]), np.diag([0.3, 0.4, 0.5]))
    text = urdf.replace_inertials(TWO, {"base": body})
    mass, com, inertia = urdf.read_inertials(text)["base"]
    assert mass == 2.0
    np.testing.assert_array_equal(com, body[1])
    np.testing.assert_array_equal(inertia, body[2])
    assert urdf.list_element_names(urdf.parse_robot(text, "x"), "link") == ["base", "arm", "head"]


@given(st.lists(bodies(), min_size=3, max_size=3))
def test_other_parameters_make_another_rig_and_leave_this_one(clouds: list[tuple]) -> None:
    rig = bundled("thesis")
    before = rig.phi
    phi = np.concatenate([pin.Inertia(*body).toDynamicParameters() for body in clouds])
    other = rig.with_phi(phi)
    np.testing.assert_allclose(other.phi, phi, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(rig.phi, before)
    assert other.urdf == rig.urdf
