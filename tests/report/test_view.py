"""The view: what is drawn is where an independent kinematics puts it, and a real browser shows it move."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.request import urlopen
from xml.sax.saxutils import quoteattr

import lxml.html
import numpy as np
import pinocchio as pin
import pytest
import umsgpack
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log import Imu, Log
from gimbal_pin.report import view
from gimbal_pin.report.elements import embed
from gimbal_pin.report.view import browser, figure, output, stage
from gimbal_pin.report.view.motion import base_attitude, motion, poses
from gimbal_pin.report.view.scene import scene
from gimbal_pin.report.view.solids import Y_TO_Z, visuals
from gimbal_pin.rig import Rig, bundled_rigs
from tests.browsing import needs_browser, pause, visit

GHOST = "/meshcat/ghost"
RIG = "/meshcat/rig"

BARE = """<robot name="bare">
  <link name="base"/>
  <link name="mast"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="boom"><inertial><origin xyz="0.1 0 0"/><mass value="0.6"/>
    <inertia ixx="0.001" iyy="0.003" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="ns/slide"><inertial><mass value="0.3"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="mast"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 0 1"/><limit effort="1" velocity="1"/></joint>
  <joint name="lift" type="revolute"><parent link="mast"/><child link="boom"/><origin xyz="0 0 0.4" rpy="0 0.3 0"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="boom"/><child link="ns/slide"/><origin xyz="0.25 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  EXTRA
</robot>"""
"""Three joints of three kinds; fixed links and visuals go where EXTRA stands."""

LUMPED = """<material name="paint"><color rgba="0.2 0.4 0.6 1"/></material>
  <link name="tip"><visual><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/><geometry><box size="0.1 0.2 0.3"/></geometry>
    <material name="paint"/></visual></link>
  <joint name="weld" type="fixed"><parent link="ns/slide"/><child link="tip"/>
    <origin xyz="0.3 0.1 0.2" rpy="0.7 -0.2 0.1"/></joint>
  <link name="foot"><visual><geometry><cylinder radius="0.1" length="0.5"/></geometry></visual></link>
  <joint name="stand" type="fixed"><parent link="base"/><child link="foot"/>
    <origin xyz="0 0 -0.3" rpy="1 0 0"/></joint>"""
"""A payload lumped into the last joint, another link fixed to the base."""


def bare(folder: Path, extra: str = "") -> Rig:
    """Return the rig BARE with more elements in it."""
    path = folder / "bare.urdf"
    path.write_text(BARE.replace("EXTRA", extra), encoding="utf-8")
    return Rig.load(path)


@pytest.fixture(scope="module")
def lumped(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """A rig with visuals on fixed links only."""
    return bare(tmp_path_factory.mktemp("rig"), LUMPED)


def sweep(rig: Rig, seconds: float = 2.0, rate: float = 300.0, **more: Any) -> Log:
    """Return a smooth motion of all joints and a reference that it lags behind."""
    t = 3.0 + np.arange(0, seconds + 0.5 / rate, 1 / rate)
    angle = 2 * np.pi * 0.4 * t[:, None] + np.arange(rig.n)
    return Log("sweep", rig.joints, t, 0.5 * np.sin(angle - 0.3), q_ref=0.5 * np.sin(angle), **more)


def at(rig: Rig, q: np.ndarray, **more: Any) -> Log:
    """Return a log of one sample."""
    return Log("still", rig.joints, np.zeros(1), np.reshape(q, (1, rig.n)), **more)


def recorded(page: str) -> dict[str, Any]:
    """Return what the script of a page plays."""
    found = re.search(r'<script id="scene" type="application/json">(.*?)</script>', page, re.S)
    assert found is not None
    values: dict[str, Any] = json.loads(found[1])
    return values


def commands(page: str) -> list[dict[str, Any]]:
    """Return the commands in a recorded page."""
    return [umsgpack.unpackb(base64.b64decode(text)) for text in recorded(page)["commands"]]


def array(packed: Any, width: int) -> np.ndarray:
    """Return a packed Float32Array as (N, width)."""
    assert packed.type == 0x17
    return np.frombuffer(packed.data, dtype="<f4").astype(float).reshape(-1, width)


def square(matrix: list[float]) -> np.ndarray:
    """Return three.js's sixteen numbers as a matrix."""
    return np.array(matrix).reshape(4, 4).T


def keyframes(page: str) -> dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """Return scene path → property → (times, values) of a recorded page."""
    width = {".quaternion": 4, ".position": 3}
    found: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = {}
    for command in commands(page):
        for entry in command.get("animations", ()):
            for track in entry["clip"]["tracks"]:
                on = isinstance(track["values"], list)
                values = (
                    np.array(track["values"])
                    if on
                    else array(track["values"], width.get(track["name"], 3))
                )
                found.setdefault(entry["path"], {})[track["name"]] = (
                    array(track["times"], 1)[:, 0],
                    values,
                )
    return found


def groups(page: str, frame: int | None = None) -> dict[str, np.ndarray]:
    """Return scene path → pose within its parent: as set, or as the given keyframe has it."""
    found = {c["path"]: square(c["matrix"]) for c in commands(page) if c["type"] == "set_transform"}
    for path, tracks in keyframes(page).items() if frame is not None else ():
        if ".quaternion" in tracks:
            found[path][:3, :3] = (
                pin.Quaternion(tracks[".quaternion"][1][frame]).normalized().matrix()
            )
        if ".position" in tracks:
            found[path][:3, 3] = tracks[".position"][1][frame]
    return found


def world(poses_of: dict[str, np.ndarray], path: str) -> np.ndarray:
    """Return the pose of a scene path below /meshcat, which only centres the view."""
    pose = np.eye(4)
    names = path.strip("/").split("/")
    for depth in range(2, len(names) + 1):
        pose = pose @ poses_of.get("/" + "/".join(names[:depth]), np.eye(4))
    return pose


def parts(page: str, root: str = RIG, frame: int | None = None) -> list[np.ndarray]:
    """Return the poses in the world of all solids that a page draws under a root."""
    moved = groups(page, frame)
    return [
        world(moved, command["path"]) @ square(child["matrix"])
        for command in commands(page)
        if command["type"] == "set_object"
        and command["path"].startswith(root)
        and command["path"].endswith("/solids")
        for child in command["object"]["object"]["children"]
    ]


def expected(rig: Rig, q: np.ndarray) -> list[np.ndarray]:
    """Return where yourdfpy's kinematics puts the URDF's visuals."""
    import yourdfpy

    robot = yourdfpy.URDF.load(io.BytesIO(rig.urdf.encode()), load_meshes=False)
    robot.update_cfg(dict(zip(rig.joints, q, strict=True)))
    found = []
    for link in robot.robot.links:
        for visual in link.visuals:
            turn = Y_TO_Z if visual.geometry.cylinder is not None else np.eye(4)
            pose = np.eye(4) if visual.origin is None else visual.origin
            found.append(robot.get_transform(link.name, rig.base) @ pose @ turn)
    return found


def assert_same_set(have: list[np.ndarray], want: list[np.ndarray], tolerance: float) -> None:
    """Assert that each pose of one list is one of the other, one to one."""
    from scipy.optimize import linear_sum_assignment

    assert len(have) == len(want) > 0
    distance = np.abs(np.array(have)[:, None] - np.array(want)[None]).max(axis=(2, 3))
    row, column = linear_sum_assignment(distance)
    assert distance[row, column].max() < tolerance


# -- where things are --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", bundled_rigs())
def test_solids_stand_where_another_kinematics_puts_them(name: str) -> None:
    rig = Rig.load(name)
    q = np.random.default_rng(1).uniform(-1, 1, rig.n)
    assert_same_set(parts(view.record(rig, at(rig, q))), expected(rig, q), 1e-9)


def told_from_zero(most: float) -> st.SearchStrategy[float]:
    """Draw what yourdfpy does not take for zero, as it does with angles under 1e-8 rad."""
    return st.floats(-most, most).filter(lambda x: x == 0 or abs(x) > 1e-7)


@given(q=st.tuples(told_from_zero(4), told_from_zero(2), told_from_zero(1)))
def test_links_fixed_to_a_moved_one_or_to_the_base_stand_where_they_belong(
    lumped: Rig, q: tuple[float, ...]
) -> None:
    page = view.record(lumped, at(lumped, np.array(q), q_ref=np.array([q]) / 2))
    assert_same_set(parts(page), expected(lumped, np.array(q)), 1e-9)
    ghosts = parts(page, GHOST)  # a depth pass and a tint of what moves
    assert_same_set(ghosts[:1], [expected(lumped, np.array(q) / 2)[0]], 1e-9)
    assert np.array_equal(ghosts[0], ghosts[1]) and len(ghosts) == 2


@pytest.mark.parametrize("name", ["handheld", "lumped"])
def test_keyframes_are_forward_kinematics(name: str, lumped: Rig) -> None:
    rig = lumped if name == "lumped" else Rig.load(name)
    log = sweep(rig)
    page = view.record(rig, log, fps=30)
    data = rig.model.createData()
    for frame in (0, 17, 60):
        q = log.q[10 * frame]  # 300 samples and 30 frames per second
        pin.framesForwardKinematics(rig.model, data, q)
        moved = groups(page, frame)
        for joint, path in enumerate(figure.list_scene_paths(rig, RIG)):
            assert np.allclose(
                world(moved, path), data.oMi[joint].homogeneous, atol=2e-7
            )  # keyframes are float32
        assert_same_set(parts(page, frame=frame), expected(rig, q), 2e-7)


@pytest.mark.parametrize("name", ["handheld", "lumped"])
def test_the_line_of_sight_is_plus_x_of_the_camera_frame(name: str, lumped: Rig) -> None:
    import yourdfpy

    rig = lumped if name == "lumped" else Rig.load(name)
    q = np.random.default_rng(2).uniform(-1, 1, rig.n)
    page = view.record(rig, at(rig, q, q_ref=-q[None]))
    robot = yourdfpy.URDF.load(io.BytesIO(rig.urdf.encode()), load_meshes=False)
    for root, sign, trail in ((RIG, 1, "/meshcat/trail"), (GHOST, -1, "/meshcat/reference")):
        robot.update_cfg(dict(zip(rig.joints, sign * q, strict=True)))
        camera = robot.get_transform(rig.camera_frame, rig.base)
        beam = next(
            c
            for c in commands(page)
            if c["path"].startswith(root) and c["path"].endswith("line of sight")
        )
        ray, _, dot = (
            world(groups(page), beam["path"]) @ square(c["matrix"])
            for c in beam["object"]["object"]["children"]
        )
        length = beam["object"]["geometries"][0]["height"]
        assert np.allclose(ray[:3, 1], camera[:3, 0])  # a three.js cylinder stands on its y
        assert np.allclose(dot[:3, 3], camera[:3, 3] + length * camera[:3, 0])
        assert np.allclose(2 * ray[:3, 3], camera[:3, 3] + dot[:3, 3])
        path = next(c for c in commands(page) if c["path"] == trail)["object"]["geometries"][0]
        assert np.allclose(
            array(path["data"]["attributes"]["position"]["array"], 3), dot[:3, 3], atol=1e-6
        )


def test_frames_run_from_first_to_last_sample_at_the_asked_rate_and_speed(lumped: Rig) -> None:
    log = sweep(lumped, seconds=2.0)
    for fps, speed, count in ((30, 1.0, 61), (25, 0.5, 101), (10, 4.0, 6)):
        for tracks in keyframes(view.record(lumped, log, fps=fps, speed=speed)).values():
            for times, values in tracks.values():
                assert len(times) == len(values) == count
                assert times[0] == 0 and times[-1] == pytest.approx(2.0 / speed, rel=1e-6)
                assert np.allclose(times, np.arange(count) / fps, atol=1e-6)
    odd = keyframes(view.record(lumped, sweep(lumped, seconds=2.01), fps=10))
    assert next(iter(odd.values()))[".quaternion"][0][-2:] == pytest.approx(
        [2.0, 2.01]
    )  # the end is never cut off


def test_joint_order_and_extra_columns_of_the_log_do_not_matter(lumped: Rig) -> None:
    log = sweep(lumped)
    q = np.column_stack([log.q[:, ::-1], np.full(len(log), 9.0)])
    other = Log("sweep", (*lumped.joints[::-1], "another"), log.t, q)
    plain = view.record(lumped, replace(log, q_ref=None))
    assert view.record(lumped, other) == plain


def test_the_base_turns_with_the_attitude_that_its_imu_reports(lumped: Rig) -> None:
    turn = pin.Quaternion(pin.rpy.rpyToMatrix(0.2, -0.3, 0.4))
    x, y, z, w = turn.coeffs()
    log = sweep(lumped)
    quat = np.tile([w, x, y, z], (len(log), 1))
    quat[1::2] *= -1  # the same attitude
    tilted = replace(log, imus={lumped.base: Imu(quat=quat)})
    pose = np.eye(4)
    pose[:3, :3] = turn.matrix()
    page = view.record(lumped, tilted)
    plain = view.record(lumped, log)
    for a, b in zip(parts(page, frame=20), parts(plain, frame=20), strict=True):
        assert np.allclose(a, pose @ b, atol=1e-6)
    attitude = base_attitude(lumped, tilted, log.t)
    assert attitude is not None
    shown = poses(lumped.model, log.q, attitude)
    assert np.allclose(shown.world[40], pose @ poses(lumped.model, log.q).world[40])


def test_poses_are_pinocchio_s_forward_kinematics(lumped: Rig) -> None:
    q = 4 * np.random.default_rng(0).normal(size=(30, lumped.n))
    shown = poses(lumped.model, q)
    data = lumped.model.createData()
    for k, row in enumerate(q):
        pin.forwardKinematics(lumped.model, data, row)
        for i in range(1, lumped.n + 1):
            assert np.allclose(shown.local[k, i], data.liMi[i].homogeneous, atol=1e-12)
            assert np.allclose(shown.world[k, i], data.oMi[i].homogeneous, atol=1e-12)


@pytest.mark.parametrize("is_double", [False, True])
@pytest.mark.parametrize("aspect", [16 / 9, 1.0, 0.5])
@pytest.mark.parametrize("name", [*bundled_rigs(), "lumped"])
def test_every_view_holds_the_rig_and_its_line_of_sight_and_is_filled_by_it(
    name: str, aspect: float, is_double: bool, lumped: Rig
) -> None:
    """One rig, or the first of two; words stand where less of it is seen."""
    rig = lumped if name == "lumped" else Rig.load(name)
    shown = motion(rig, sweep(rig, rate=60), 15, 1.0, False)
    shot = scene(rig, shown, aspect=aspect, beside=shown if is_double else None)
    hull = figure.hull(visuals(rig)[0], poses(rig.model, shown.q).world)
    trail = next(c for c in shot.commands if c["path"] == "/meshcat/trail")["object"]["geometries"][
        0
    ]
    ends = array(trail["data"]["attributes"]["position"]["array"], 3)
    room = max(min(aspect / 2, 1.0), min(aspect, 0.5)) / 1.1 if is_double else min(aspect, 1.0)
    for view_name, placed in [*shot.views.items()][: 1 if is_double else None]:
        properties = {c["property"]: c["value"] for c in placed if c["type"] == "set_property"}
        x, z, y = properties["position"] * np.array([1, 1, -1])  # the camera's own frame has y up
        back = np.array([x, y, z]) / np.linalg.norm([x, y, z])
        right = np.cross([0, 0, 1.0], back) / np.linalg.norm(np.cross([0, 0, 1.0], back))
        points = np.vstack([hull, ends]) + square(placed[0]["matrix"])[:3, 3]
        depth = np.linalg.norm([x, y, z]) - points @ back
        slopes = (
            points
            @ np.array([right, np.cross(back, right)]).T
            / depth[:, None]
            / np.tan(np.deg2rad(32.0) / 2)
        )
        assert depth.min() > properties["near"] and depth.max() < properties["far"]
        share = np.abs(slopes / [aspect, 1.0]).max()
        assert share < 0.88 + 1e-6 if is_double else share == pytest.approx(0.88)
        if view_name == next(iter(shot.views)):
            across, up = (slopes / [aspect, 1.0]).T
            sides = {
                f"{high} {wide}": (y, x)
                for y, high in ((1, "upper"), (-1, "lower"))
                for x, wide in ((-1, "left"), (1, "right"))
            }
            behind = {
                at: np.sum((y * up > 0.55) & (x * across > 0.5)) for at, (y, x) in sides.items()
            }
            assert is_double or behind[shot.corner] == min(behind.values())
        if name != "lumped":
            assert np.ptp(slopes[: len(hull)], axis=0).max() / 2 > 0.6 * room, view_name
            assert (0 < back[2] < 0.5) == (view_name != "top")  # from above, but not from the top


# -- what is drawn -----------------------------------------------------------------------------------------------------


def test_named_materials_meshes_and_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg" / "block.stl").write_bytes(
        stl(np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]]))
    )
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    mesh = "<visual><geometry><mesh filename='{}' scale='0.1 0.1 0.1'/></geometry></visual>"
    files = ("package://pkg/block.stl", "absent.stl", "broken.stl", "pkg/block.stl")
    link = f"<link name='hull'>{''.join(mesh.format(file) for file in files)}</link>"
    weld = "<joint name='w' type='fixed'><parent link='boom'/><child link='hull'/></joint>"
    solids, events, missing = visuals(bare(tmp_path, LUMPED + link + weld))
    by_link = {solid.link: solid for solid in solids}
    assert by_link["tip"].rgba == (0.2, 0.4, 0.6, 1.0)
    assert [solid.facets for solid in solids if solid.link == "hull"] == [
        True,
        True,
    ] and missing == {"hull"}
    assert np.allclose(
        [solid.corners.max(axis=0) for solid in solids if solid.facets], [[0.1, 0.2, 0.3]] * 2
    )
    assert (
        len(events) == 2
        and "absent.stl' is not there" in events[0]
        and "broken.stl' cannot be read" in events[1]
    )


def test_a_link_whose_mesh_is_missing_gets_a_bar_and_one_without_visuals_none(
    tmp_path: Path,
) -> None:
    link = "<link name='hull'><visual><geometry><mesh filename='absent.stl'/></geometry></visual></link>"
    weld = "<joint name='w' type='fixed'><parent link='boom'/><child link='hull'/></joint>"
    rig = bare(tmp_path, LUMPED + link + weld)
    drawn = scene(rig, motion(rig, sweep(rig), 30, 1.0, False))
    owners = [
        path
        for path in figure.list_scene_paths(rig, RIG)
        if any(c["path"] == f"{path}/solids" for c in drawn.commands)
    ]
    assert owners == [figure.list_scene_paths(rig, RIG)[k] for k in (0, 2, 3)]  # not the mast
    assert "nothing to draw of boom" in drawn.events[-1]


def test_a_second_run_stands_beside_the_first_and_moves_by_its_own_log(
    lumped: Rig, tmp_path: Path
) -> None:
    log = sweep(lumped)
    other = replace(log, q=-log.q)
    view.animate(lumped, log, tmp_path / "both.html", beside=other, ghost=False)
    page = (tmp_path / "both.html").read_text(encoding="utf-8")
    alone = parts(view.record(lumped, other, ghost=False), frame=7)
    second = parts(page, "/meshcat/beside/rig", frame=7)
    shift = second[0][:3, 3] - alone[0][:3, 3]
    assert np.linalg.norm(shift) > 0.5 and shift[2] == 0
    for a, b in zip(second, alone, strict=True):
        assert np.allclose(a[:3, 3] - b[:3, 3], shift, atol=1e-6) and np.allclose(
            a[:3, :3], b[:3, :3], atol=1e-6
        )


def test_the_ghosts_of_two_runs_show_their_errors_magnified_by_one_factor(
    lumped: Rig, tmp_path: Path
) -> None:
    log = sweep(lumped)
    assert log.q_ref is not None
    worse, better = (
        replace(log, q=log.q_ref - off, name=f"{off}/run.csv") for off in (0.011, 0.002)
    )
    alone = replace(better, q_ref=None, name="alone.csv")
    for left, right, names, legend, apart in (
        (worse, better, ["0.011/run.csv", "0.002/run.csv"], "reference, error × 20", (0.22, 0.04)),
        (better, worse, ["0.002/run.csv", "0.011/run.csv"], "reference, error × 20", (0.04, 0.22)),
        (alone, worse, ["alone.csv", "run.csv"], "first run, difference × 20", (None, 0.18)),
        (alone, alone, ["alone.csv", "alone.csv"], "first run, difference × 1000", (None, 0.0)),
    ):
        view.animate(lumped, left, tmp_path / "both.html", beside=right)
        page = (tmp_path / "both.html").read_text(encoding="utf-8")
        moved = groups(page, 7)
        assert legend in page
        assert [one["name"] for one in recorded(page)["names"]] == names
        for home, angle in zip(("/meshcat", "/meshcat/beside"), apart, strict=True):
            own, ghost = (
                figure.list_scene_paths(lumped, f"{home}/{one}")[2] for one in ("rig", "ghost")
            )
            assert (ghost in moved) == (angle is not None)
            if angle is not None:
                turn = moved[own][:3, :3].T @ moved[ghost][:3, :3]
                assert np.linalg.norm(pin.log3(turn)) == pytest.approx(angle, abs=1e-5)
    view.animate(lumped, worse, tmp_path / "both.html", beside=better, ghost=False)
    assert "ghost" not in " ".join(groups((tmp_path / "both.html").read_text(encoding="utf-8")))


def stl(corners: np.ndarray) -> bytes:
    """Return a tetrahedron as a binary STL."""
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    records = b"".join(
        np.vstack([np.zeros(3), corners[face]]).astype("<f4").tobytes() + b"\0\0" for face in faces
    )
    return bytes(80) + len(faces).to_bytes(4, "little") + records


def test_a_rig_that_draws_nothing_gets_a_stand_in_for_every_joint_and_says_so(
    tmp_path: Path,
) -> None:
    rig = bare(tmp_path)
    out = tmp_path / "out.html"
    (event,) = view.animate(rig, sweep(rig), out).events
    assert "stand-ins" in event
    page = out.read_text(encoding="utf-8")
    still = groups(page)
    drawn = {c["path"]: c["object"] for c in commands(page) if c["type"] == "set_object"}
    axes = [np.array([0, 0, 1.0]), np.array([0, 0.6, 0.8]), np.array([1.0, 0, 0])]
    for path, axis in zip(figure.list_scene_paths(rig, RIG)[1:], axes, strict=True):
        first = drawn[f"{path}/solids"]["object"]["children"][0]
        assert np.allclose(
            square(first["matrix"])[:3, 1], axis
        )  # a three.js cylinder stands on its y
    assert still[figure.list_scene_paths(rig, RIG)[2]][:3, 3] == pytest.approx([0, 0, 0.4])


def test_the_ghost_is_there_only_with_a_reference_and_only_if_asked(lumped: Rig) -> None:
    log = sweep(lumped)
    assert parts(view.record(lumped, log), GHOST)
    for page in (
        view.record(lumped, log, ghost=False),
        view.record(lumped, replace(log, q_ref=None)),
    ):
        assert not any(command["path"].startswith(GHOST) for command in commands(page))


def test_the_ghost_of_a_link_and_of_the_line_of_sight_is_drawn_only_while_it_is_apart(
    lumped: Rig,
) -> None:
    log = sweep(lumped)
    lag = np.where(log.t[:, None] < 4.0, 0.0, [0.0, 0.2, 0.0])
    tracks = keyframes(view.record(lumped, replace(log, q_ref=log.q + lag)))
    tip = f"{figure.list_scene_paths(lumped, GHOST)[3]}/solids"  # the only link that draws anything
    beam = next(
        path for path in tracks if path.startswith(GHOST) and path.endswith("line of sight")
    )
    for path in (tip, beam):
        times, shown = tracks[path][".visible"]
        assert np.array_equal(shown, times >= 1.0)


def test_the_same_log_gives_the_same_bytes_and_fewer_than_two_million() -> None:
    rig = Rig.load("thesis")
    log = sweep(rig, seconds=10, rate=1000)
    pages = {view.record(rig, log) for _ in range(3)}
    assert len(pages) == 1 and len(pages.pop()) < 2e6


@pytest.mark.parametrize("size", [1e-3, 0.02, 0.3, 1.0, 7.0, 200.0])
def test_grid_lines_are_a_round_distance_apart_and_few(size: float) -> None:
    step = stage.spacing(size)
    assert size / 5 <= step <= size / 2 * (1 + 1e-6)
    assert re.fullmatch(r"[125](\.0*)?e[-+]\d+", f"{step:.6e}")
    points, alpha = stage.build_grid(np.array([0.3 * size, -0.1 * size]), 5 * size, step)
    assert len(points) == len(alpha) < 5000 and len(points) % 2 == 0
    assert np.linalg.norm(points - [0.3 * size, -0.1 * size], axis=1).max() <= 5 * size * (1 + 1e-9)


@pytest.mark.parametrize("name", bundled_rigs())
def test_the_map_of_shadows_holds_all_that_casts_them_and_spends_few_texels_on_the_rest(
    name: str,
) -> None:
    rig = Rig.load(name)
    shown = motion(rig, sweep(rig, rate=60), 15, 1.0, False)
    shot = scene(rig, shown)
    drawn = {c["path"]: c for c in shot.commands if c["type"] in ("set_object", "set_transform")}
    key = drawn["/Studio/key"]["object"]["object"]
    eye = key["shadow"]["camera"]
    lamp = square(key["matrix"])[:3, 3]
    back = lamp / np.linalg.norm(lamp)  # a lamp looks at the origin, its right is level
    right = np.cross([0, 0, 1.0], back) / np.linalg.norm(np.cross([0, 0, 1.0], back))
    moves = [
        square(view[0]["matrix"])[:3, 3] for view in shot.views.values()
    ]  # what is looked at is at the origin
    points = np.vstack(
        [figure.hull(visuals(rig)[0], poses(rig.model, shown.q).world) + move for move in moves]
    )
    seen = (points - lamp) @ np.array([right, np.cross(back, right), -back]).T
    low, high = (
        np.array([eye[side] for side in sides])
        for sides in (("left", "bottom", "near"), ("right", "top", "far"))
    )
    assert (low < seen.min(axis=0)).all() and (seen.max(axis=0) < high).all()
    assert (np.ptp(seen, axis=0) > 0.7 * (high - low))[:2].all()
    texel = (high - low)[:2] / key["shadow"]["mapSize"]
    assert (
        texel[0] == pytest.approx(texel[1], rel=0.01)
        and texel[0] < 0.004 * np.ptp(seen, axis=0)[:2].min()
    )


# -- errors ------------------------------------------------------------------------------------------------------------


def test_arguments_that_cannot_be_used_are_refused_by_name(lumped: Rig, tmp_path: Path) -> None:
    log = sweep(lumped)
    nothing: dict[str, Any] = {}
    for name, more, word in (
        ("out.html", {"fps": 0.0}, "fps"),
        ("out.html", {"speed": -1.0}, "speed"),
        ("out.avi", nothing, r"\.avi.*\.mp4"),
        ("out.png", {"size": (0, 10)}, "size"),
        ("out.png", {"at": 99.0}, "at: is 99"),
        ("out.png", {"camera": "below"}, "three-quarter"),
        ("no/out.html", nothing, "does not exist"),
    ):
        with pytest.raises(UsageError, match=word):
            view.animate(lumped, log, tmp_path / name, **more)
    with pytest.raises(LogError, match="no joint 'slide'"):
        view.record(lumped, Log("part", lumped.joints[:2], log.t, log.q[:, :2]))
    with pytest.raises(LogError, match="no samples"):
        view.record(lumped, log.part(slice(0, 0)))
    assert not list(tmp_path.iterdir())


EVIL = ("</script><script>alert(1)</script>", "<!--<script>", "]]>&'<img src=x onerror=alert(1)>")


@pytest.mark.parametrize("name", EVIL)
def test_a_name_is_no_part_of_a_page(name: str, lumped: Rig, tmp_path: Path) -> None:
    """Of rig, joints, links, log and payload; the pages of a file, of a live view and of what a camera sees."""
    text = BARE.replace("EXTRA", LUMPED)
    for old in (
        "bare",
        "base",
        "mast",
        "boom",
        "ns/slide",
        "turn",
        "lift",
        "slide",
        "tip",
        "weld",
        "foot",
        "stand",
    ):
        text = text.replace(f'"{old}"', quoteattr(f"{old} {name}"))
    path = tmp_path / "evil.urdf"
    path.write_text(text, encoding="utf-8")
    rig = replace(Rig.load(path), payload=name)
    plain, evil = (
        view.record(one, replace(sweep(one), name=of))
        for one, of in ((lumped, "sweep"), (rig, name))
    )
    with view.Live(rig) as live, urlopen(live.url) as answer:
        served = answer.read().decode()
    assert (
        elements(evil) == elements(plain)
        and elements(served)["script"] == elements(plain)["script"]
    )
    for page in (evil, served):
        assert [one["name"] for one in recorded(page)["joints"]] == list(rig.joints)
    assert name in lxml.html.fromstring(evil).get_element_by_id("about").text_content()


def elements(page: str) -> Counter[str]:
    """Return how many elements of each kind a page has."""
    return Counter(str(one.tag) for one in lxml.html.fromstring(page).iter())


def test_without_chromium_pictures_say_what_to_install_and_html_works(
    lumped: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chromium = pytest.importorskip(
        "choreographer.browsers.chromium", reason="choreographer is not installed"
    )
    monkeypatch.setattr(chromium.Chromium, "find_browser", classmethod(lambda _, **__: None))
    for name in ("out.png", "out.gif"):
        with pytest.raises(UsageError, match="apt install chromium"):
            view.animate(lumped, sweep(lumped), tmp_path / name)
    assert not list(tmp_path.iterdir())
    view.animate(lumped, sweep(lumped), tmp_path / "out.html")
    assert (tmp_path / "out.html").stat().st_size > 5e5


# -- a real browser ----------------------------------------------------------------------------------------------------


def pixels(uri: str) -> np.ndarray:
    """Return a PNG data URI as (height, width, 3)."""
    from PIL import Image

    return np.asarray(
        Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))).convert("RGB")
    ).astype(int)


@needs_browser
def test_a_browser_without_webgl_says_so(tmp_path: Path) -> None:
    blind = "<head><script>HTMLCanvasElement.prototype.getContext = () => null</script>"
    path = tmp_path / "out.html"
    rig = Rig.load("turret")
    path.write_text(view.record(rig, sweep(rig)).replace("<head>", blind, 1), encoding="utf-8")
    assert (
        "it has no WebGL"
        in visit(path.as_uri(), "document.getElementById('meshcat-pane').textContent").values[0]
    )


COUNTED = """<head><script>{
  const request = requestAnimationFrame.bind(window);
  window.frames = 0;
  window.requestAnimationFrame = act => request(time => { frames++; act(time); });
}</script>"""
"""Counts the frames that a page draws."""


@needs_browser
def test_a_scene_runs_only_while_it_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Folded, scrolled away or folded again it draws no frame, and a folded one says nothing on the console."""
    rig = Rig.load("thesis")
    said = list[str]()

    async def hear(seen: object, event: Any) -> None:
        said.append(str(event["params"])[:200])

    monkeypatch.setattr("tests.browsing.Visit.complain", hear)
    frame = embed(
        view.record(rig, sweep(rig)).replace("<head>", COUNTED, 1), "scene", "scene", "run"
    )
    path = tmp_path / "page.html"
    path.write_text(
        f"<!DOCTYPE html><details><summary>scene</summary>{frame}</details><p style='height: 3000px'></p>"
    )
    frames = "document.querySelector('iframe').contentWindow.frames"
    still = (frames, pause(0.7), frames)
    fold = "document.querySelector('details').open = {}, 0"
    seen = visit(
        path.as_uri(), pause(1.0), *still, lambda _: note(said), fold.format("true"), pause(1.0), *still,
        "scrollTo(0, 2500), 0", pause(0.5), *still, "scrollTo(0, 0), 0", pause(0.7), frames,
        fold.format("false"), pause(0.5), *still,
    )  # fmt: skip
    never, folded, _, before, after, _, away, still_away, _, back, _, again, still_again = (
        seen.values
    )
    assert never == folded == 0 and said[: said.index("opened")] == []
    assert 0 < before < after <= away == still_away < back <= again == still_again


async def note(said: list[str]) -> None:
    """Note that the scene is opened next."""
    said.append("opened")


@needs_browser
@pytest.mark.parametrize("motion", ["reduce", "no-preference"])
def test_a_scene_stands_where_less_motion_is_preferred(tmp_path: Path, motion: str) -> None:
    """And on paper it is drawn, whatever the screen has drawn."""
    rig = Rig.load("thesis")
    (tmp_path / "page.html").write_text(view.record(rig, sweep(rig)))

    async def prefer(tab: Any) -> None:
        features = [{"name": "prefers-reduced-motion", "value": motion}]
        await tab.send_command("Emulation.setEmulatedMedia", {"features": features})
        await tab.send_command("Page.reload")
        await asyncio.sleep(2.0)

    url = (tmp_path / "page.html").as_uri()
    seen = visit(url, prefer, "animator.time > 0", "dispatchEvent(new Event('beforeprint'))")
    assert seen.values == [motion != "reduce", True] and seen.complaints == []


@needs_browser
def test_a_browser_plays_the_page_offline_and_shows_the_rig_move(tmp_path: Path) -> None:
    rig = Rig.load("thesis")
    log = sweep(rig)
    out = tmp_path / "out.html"
    assert view.animate(rig, log, out).events == ()
    url = out.as_uri()
    tip = figure.list_scene_paths(rig, RIG)[3].strip("/").split("/")
    pose = f"(viewer.scene_tree.find({tip}).object.updateWorldMatrix(true, true),"
    pose += f"viewer.scene_tree.find({tip}).object.matrixWorld.toArray())"
    beam = f"viewer.scene_tree.find({[*tip, 'line of sight']}).object.visible = "
    seen = visit(
        url,
        "[animator.time, animator.playing, animator.actions[0].loop, animator.actions[0].repetitions]",
        pause(0.3),
        "animator.time",
        "pictures([0.5], 320, 180)[0]",
        pose,
        "pictures([1.3], 320, 180)[0]",
        pose,
        "(animator.play(), 0)",
        pause(0.3),
        "pictures([0.5], 320, 180)[0]",
        "(seek(2.0), [animator.playing, document.getElementById('clock').value])",
        "(toggle(), animator.playing)",
        pause(0.3),
        beam + "false",
        "pictures([0.5], 320, 180)[0]",
        beam
        + "true; drawn.forEach(one => Object.assign(one.material, { onBeforeCompile() {}, needsUpdate: true }))",
        "pictures([0.5], 320, 180)[0]",
        "pictures([1.3, 0.5], 320, 180)",
        "(window.heard = 0, addEventListener('message', () => window.heard++), postMessage({seek: 1}, '*'), 0)",
        pause(0.3),
        "window.heard",
    )
    values = seen.values
    (_, playing, loop, repetitions), later, first, at_first, second, at_second = values[:6]
    assert (seen.complaints, seen.requests) == ([], [url])
    assert playing and later > 0 and loop == 2201 and repetitions > 1e6  # three.js: LoopRepeat
    one = pixels(first)
    two = pixels(second)
    assert one.shape == (180, 320, 3)
    assert len(np.unique(one.reshape(-1, 3), axis=0)) > 500  # not blank
    moved = np.abs(one - two).max(axis=2) > 24
    assert 0.02 < moved.mean() < 0.6  # the rig moves, not the whole picture
    assert np.array_equal(
        pixels(values[7]), one
    )  # a frame is the asked instant, whatever was shown before
    data = rig.model.createData()
    stands = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # the viewer's y is up
    for at_it, row in ((at_first, 150), (at_second, 390)):
        pin.forwardKinematics(rig.model, data, log.q[row])
        assert np.allclose(square(at_it)[:3, :3], stands @ data.oMi[3].rotation, atol=1e-5)
    assert values[8] == [False, "5.00 / 5.00 s"]
    assert values[9] is True and values[-1] == 1  # a message is not answered
    assert np.abs(pixels(values[11]) - one).max() > 60  # the line of sight is seen
    apart = np.abs(pixels(values[13]) - one).max(axis=2)  # from what three.js's own shaders draw
    assert apart.mean() < 0.3 and (apart > 24).mean() < 0.003
    assert [len(values[14]), values[14][1]] == [2, values[13]]  # drawn ahead or by itself


@needs_browser
@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_no_view_burns_out_what_it_shows(name: str, tmp_path: Path) -> None:
    from PIL import Image

    rig = Rig.load(name)
    for camera in ("top", "behind"):
        view.animate(rig, sweep(rig), tmp_path / "seen.png", camera=camera, size=(320, 180))
        with Image.open(tmp_path / "seen.png") as seen:
            assert (np.asarray(seen.convert("RGB")).max(axis=2) >= 254).mean() < 0.002


@needs_browser
def test_a_picture_and_a_film_hold_the_asked_frames(
    lumped: Rig, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip(
        "imageio_ffmpeg", reason="imageio-ffmpeg is not installed (gimbal-pin[video])"
    )
    from PIL import Image, ImageSequence

    log = sweep(lumped, seconds=0.25)
    view.animate(lumped, log, tmp_path / "still.png", size=(320, 180), at=3.2)
    with Image.open(tmp_path / "still.png") as still:
        assert still.size == (320, 180) and still.format == "PNG"
    strip = recorded(view.animate(lumped, log, tmp_path / "film.gif", size=(161, 91)).page)["strip"]
    with Image.open(tmp_path / "film.gif") as film:
        assert (film.info["duration"], film.info["loop"], film.size) == (50, 0, (161, 91))
        frames = [
            np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(film)
        ]
    assert len(frames) == 6 and (np.abs(frames[-1] - frames[0]).max(axis=2) > 40).mean() > 0.01
    error = np.degrees(log.q_ref - log.q)[[0, -1]] * [
        1,
        1,
        1e3 * np.pi / 180,
    ]  # the last one slides
    assert np.array(strip["curves"])[0, :, [0, -1]] == pytest.approx(error, abs=1e-5)
    assert [strip["low"], strip["high"]] == pytest.approx(
        [np.min(strip["curves"]), np.max(strip["curves"])], abs=1e-5
    )
    cursor = [
        frame[82:88, 9:].sum(axis=2).mean(axis=0).argmin() for frame in frames
    ]  # the darkest column
    assert np.all(np.diff(cursor) > 10)
    assert capfd.readouterr() == ("", "")


def test_every_format_of_video_is_whole_or_not_there(
    lumped: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ffmpeg = pytest.importorskip(
        "imageio_ffmpeg", reason="imageio-ffmpeg is not installed (gimbal-pin[video])"
    )
    from PIL import Image, ImageSequence

    def paint(
        _: str, times: list[float], size: tuple[int, int], take: Callable[[bytes], object]
    ) -> None:
        for seconds in times:
            picture = io.BytesIO()
            Image.new("RGB", size, (round(600 * seconds), 90, 40)).save(picture, "PNG")
            take(picture.getvalue())

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(output, "take_pictures", paint)
    log = sweep(lumped, seconds=0.25)
    for name in ("film.webp", "film.mp4"):
        view.animate(lumped, log, tmp_path / name, size=(161, 91), fps=10)
    with Image.open(tmp_path / "film.webp") as film:
        red = [
            np.asarray(frame.convert("RGB"))[:, :, 0].mean()
            for frame in ImageSequence.Iterator(film)
        ]
        assert film.size == (161, 91) and np.allclose(red, [0, 60, 120, 150], atol=8)
    assert ffmpeg.count_frames_and_secs(str(tmp_path / "film.mp4")) == (
        4,
        pytest.approx(0.4, abs=0.02),
    )
    before = sorted(tmp_path.iterdir())
    monkeypatch.setitem(output.ENCODERS, ".webp", "-c:v no-such-codec")
    with pytest.raises(UsageError, match="no-such-codec"):
        view.animate(lumped, log, tmp_path / "broken.webp", size=(160, 90))
    monkeypatch.setattr(output, "take_pictures", stop)
    with pytest.raises(KeyboardInterrupt):
        view.animate(lumped, log, tmp_path / "stopped.gif")
    assert sorted(tmp_path.iterdir()) == before


def test_a_browser_can_be_asked_from_inside_a_running_event_loop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def paint(
        page: str, times: list[float], size: object, take: Callable[[bytes], object], _: object
    ) -> None:
        await asyncio.sleep(0)
        take(page.encode())

    async def notebook() -> None:
        browser.take_pictures("one", [0.0], (16, 16), asked.append)

    asked: list[bytes] = []
    monkeypatch.setattr(browser, "shoot", paint)
    asyncio.run(notebook())
    browser.take_pictures("two", [0.0], (16, 16), asked.append)
    assert asked == [b"one", b"two"]
