"""Scenes: what is drawn stands where an independent kinematics puts it, at the instants that were asked for.

- solids, ghost, line of sight and keyframes agree with yourdfpy and Pinocchio, whatever the order of columns;
- the base turns with its IMU; a second run stands apart and keeps its own motion, errors are magnified alike;
- every view holds the rig; what cannot be drawn is named, what cannot be used is refused;
- a name is no part of a page; a file is whole or not there.
"""

from __future__ import annotations

import asyncio
import base64
import io
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache, reduce
from pathlib import Path
from typing import Any
from urllib.request import urlopen
from xml.sax.saxutils import quoteattr

import lxml.html
import numpy as np
import pinocchio as pin
import pytest
import trimesh
import umsgpack
from PIL import Image

from gimbal_pin.errors import GimbalPinError, UsageError
from gimbal_pin.log import Imu, Log
from gimbal_pin.report import view
from gimbal_pin.report.elements import embed
from gimbal_pin.report.view import figure, output
from gimbal_pin.report.view.motion import motion, poses
from gimbal_pin.report.view.scene import scene
from gimbal_pin.report.view.solids import Y_TO_Z, visuals
from gimbal_pin.rig import Rig
from tests.browsing import go, media, needs_browser, pause, until, visit
from tests.report.records import EVIL
from tests.rigs import bundled, spelled

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
  <joint name="turn" type="continuous"><parent link="base"/><child link="mast"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit effort="1" velocity="1"/></joint>
  <joint name="lift" type="revolute"><parent link="mast"/><child link="boom"/>
    <origin xyz="0 0 0.4" rpy="0 0.3 0"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="boom"/><child link="ns/slide"/>
    <origin xyz="0.25 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  EXTRA
</robot>"""
"""Three joints of three kinds; fixed links and visuals go where EXTRA stands."""

LUMPED = """<material name="paint"><color rgba="0.2 0.4 0.6 1"/></material>
  <link name="tip"><visual><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>
    <geometry><box size="0.1 0.2 0.3"/></geometry><material name="paint"/></visual></link>
  <joint name="weld" type="fixed"><parent link="ns/slide"/><child link="tip"/>
    <origin xyz="0.3 0.1 0.2" rpy="0.7 -0.2 0.1"/></joint>
  <link name="foot"><visual><geometry><cylinder radius="0.1" length="0.5"/></geometry></visual></link>
  <joint name="stand" type="fixed"><parent link="base"/><child link="foot"/>
    <origin xyz="0 0 -0.3" rpy="1 0 0"/></joint>"""
"""A payload lumped into the last joint, another link fixed to the base."""

RIG_OF = {"lumped": spelled(BARE.replace("EXTRA", LUMPED)), "handheld": bundled("handheld")}
"""The rig whose visuals are all on fixed links, and a bundled one."""


@pytest.fixture
def lumped() -> Rig:
    """The rig of three kinds of joints."""
    return RIG_OF["lumped"]


def sweep(rig: Rig, seconds: float = 2.0) -> Log:
    """Return a smooth motion of all joints, 300 samples per second, and a reference that it lags behind."""
    t = 3.0 + np.arange(0, seconds + 1 / 600, 1 / 300)
    angle = 2 * np.pi * 0.4 * t[:, None] + np.arange(rig.n)
    return Log("sweep", rig.joints, t, 0.5 * np.sin(angle - 0.3), q_ref=0.5 * np.sin(angle))


@cache
def commands(page: str) -> list[dict[str, Any]]:
    """Return the commands in a recorded page."""
    found = re.search(r'<script id="scene" type="application/json">(.*?)</script>', page, re.S)
    assert found is not None
    return [umsgpack.unpackb(base64.b64decode(text)) for text in json.loads(found[1])["commands"]]


def array(packed: Any, width: int) -> np.ndarray:
    """Return a packed Float32Array as (N, width)."""
    return np.frombuffer(packed.data, dtype="<f4").astype(float).reshape(-1, width)


def square(matrix: list[float]) -> np.ndarray:
    """Return three.js's sixteen numbers as a matrix."""
    return np.array(matrix).reshape(4, 4).T


def keyframes(page: str) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Yield scene path, property, times and values of what turns or shifts in a recorded page."""
    width = {".quaternion": 4, ".position": 3}
    for command in commands(page):
        for entry in command.get("animations", ()):
            for track in entry["clip"]["tracks"]:
                if track["name"] in width:
                    values = array(track["values"], width[track["name"]])
                    yield entry["path"], track["name"], array(track["times"], 1)[:, 0], values


def groups(page: str, frame: int = 0) -> dict[str, np.ndarray]:
    """Return scene path → pose within its parent at a keyframe."""
    found = {c["path"]: square(c["matrix"]) for c in commands(page) if c["type"] == "set_transform"}
    for path, name, _, values in keyframes(page):
        if name == ".quaternion":
            found[path][:3, :3] = pin.Quaternion(values[frame]).normalized().matrix()
        else:
            found[path][:3, 3] = values[frame]
    return found


def world(poses_of: Mapping[str, np.ndarray], path: str) -> np.ndarray:
    """Return the pose of a scene path below /meshcat, which only centres the view."""
    names = path.split("/")
    paths = ("/".join(names[:k]) for k in range(3, len(names) + 1))
    return reduce(np.matmul, (poses_of.get(one, np.eye(4)) for one in paths))


def parts(page: str, root: str = RIG, frame: int = 0) -> np.ndarray:
    """Return the poses in the world of all solids that a page draws under a root, (N, 4, 4)."""
    moved = groups(page, frame)
    return np.array(
        [
            world(moved, command["path"]) @ square(child["matrix"])
            for command in commands(page)
            if command["path"].startswith(root) and command["path"].endswith("/solids")
            if command["type"] == "set_object"
            for child in command["object"]["object"]["children"]
        ]
    )


def other_kinematics(rig: Rig, q: np.ndarray) -> Any:
    """Return yourdfpy's robot at a pose."""
    import yourdfpy

    robot = yourdfpy.URDF.load(io.BytesIO(rig.urdf.encode()), load_meshes=False)
    robot.update_cfg(dict(zip(rig.joints, q, strict=True)))
    return robot


def expected(rig: Rig, q: np.ndarray) -> np.ndarray:
    """Return where yourdfpy's kinematics puts the URDF's visuals, (N, 4, 4)."""
    robot = other_kinematics(rig, q)
    found = []
    for link in robot.robot.links:
        for visual in link.visuals:
            turn = Y_TO_Z if visual.geometry.cylinder is not None else np.eye(4)
            pose = np.eye(4) if visual.origin is None else visual.origin
            found.append(robot.get_transform(link.name, rig.base) @ pose @ turn)
    return np.array(found)


def assert_same_set(have: np.ndarray, want: np.ndarray, tolerance: float) -> None:
    """Assert that each pose of one list is one of the other, one to one."""
    from scipy.optimize import linear_sum_assignment

    assert len(have) == len(want) > 0
    distance = np.abs(have[:, None] - want[None]).max(axis=(2, 3))
    row, column = linear_sum_assignment(distance)
    assert distance[row, column].max() < tolerance


# -- where things are --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RIG_OF)
def test_solids_stand_where_another_kinematics_puts_them(name: str) -> None:
    """Also those of links that are fixed to a moved one or to the base, at rest and in motion."""
    rig = RIG_OF[name]
    log = sweep(rig)
    page = view.record(rig, log, fps=30)
    for frame in (0, 17, 60):
        q = log.q[10 * frame]  # 300 samples and 30 frames per second
        assert_same_set(parts(page, frame=frame), expected(rig, q), 2e-7)


def test_the_ghost_stands_where_the_reference_is(lumped: Rig) -> None:
    log = sweep(lumped)
    tint, depth = parts(view.record(lumped, log), GHOST, 17)
    np.testing.assert_array_equal(tint, depth)
    assert_same_set(tint[None], expected(lumped, log.q_ref[170])[:1], 2e-7)
    assert not len(parts(view.record(lumped, log, ghost=False), GHOST))
    assert not len(parts(view.record(lumped, replace(log, q_ref=None)), GHOST))


@pytest.mark.parametrize("name", RIG_OF)
def test_the_line_of_sight_is_plus_x_of_the_camera_frame(name: str) -> None:
    """Of the rig and of its reference."""
    rig = RIG_OF[name]
    q = np.random.default_rng(2).uniform(-1, 1, rig.n)
    page = view.record(rig, Log("still", rig.joints, np.zeros(1), q[None], q_ref=-q[None]))
    drawn = {c["path"]: c["object"] for c in commands(page) if c["type"] == "set_object"}
    for root, sign in ((RIG, 1), (GHOST, -1)):
        camera = other_kinematics(rig, sign * q).get_transform(rig.camera_frame, rig.base)
        (beam,) = (x for x in drawn if x.startswith(root) and x.endswith("line of sight"))
        dot = world(groups(page), beam) @ square(drawn[beam]["object"]["children"][-1]["matrix"])
        end = camera @ [drawn[beam]["geometries"][0]["height"], 0, 0, 1]
        np.testing.assert_allclose(dot[:, 3], end, atol=1e-9)


def test_frames_run_from_first_to_last_sample(lumped: Rig) -> None:
    """At half the speed; the last one is there though no whole step ends with it."""
    page = view.record(lumped, sweep(lumped, 2.01), fps=10, speed=0.5)
    for _, _, times, values in keyframes(page):
        assert len(times) == len(values)
        assert times[[0, 1, -1]] == pytest.approx([0, 0.1, 4.02], rel=1e-6)


def test_the_same_motion_gives_the_same_page_whatever_the_order_of_columns(lumped: Rig) -> None:
    log = replace(sweep(lumped), q_ref=None)
    q = np.column_stack([log.q[:, ::-1], np.full(len(log), 9.0)])
    other = Log("sweep", (*lumped.joints[::-1], "another"), log.t, q)
    page = view.record(lumped, log)
    assert view.record(lumped, other) == page
    assert len(page) < 2e6


def test_the_base_turns_with_the_attitude_that_its_imu_reports(lumped: Rig) -> None:
    turn = pin.Quaternion(pin.rpy.rpyToMatrix(0.2, -0.3, 0.4))
    log = sweep(lumped)
    quat = np.tile(turn.coeffs()[[3, 0, 1, 2]], (len(log), 1))
    quat[1::2] *= -1  # the same attitude
    tilted = replace(log, imus={lumped.base: Imu(quat=quat)})
    pose = np.eye(4)
    pose[:3, :3] = turn.matrix()
    have, level = (parts(view.record(lumped, x, fps=40), frame=21) for x in (tilted, log))
    np.testing.assert_allclose(have, pose @ level, atol=1e-6)  # between two samples


def test_two_runs_stand_apart_and_show_their_errors_magnified_by_one_factor(lumped: Rig) -> None:
    log = sweep(lumped)
    runs = [replace(log, q=log.q_ref - off) for off in (0.009, 0.002)]
    page = view.animate(runs[0], lumped, beside=runs[1]).page
    moved = groups(page, 7)
    for home, angle in (("/meshcat", 0.18), ("/meshcat/beside", 0.04)):
        places = (f"{home}/rig", f"{home}/ghost")
        own, ghost = (moved[figure.list_scene_paths(lumped, x)[2]][:3, :3] for x in places)
        assert np.linalg.norm(pin.log3(own.T @ ghost)) == pytest.approx(angle, abs=1e-5)
    apart = parts(page, "/meshcat/beside/rig", 7) - parts(view.record(lumped, runs[1]), frame=7)
    assert np.linalg.norm(apart[0]) > 0.5
    np.testing.assert_allclose(apart, np.broadcast_to(apart[0], apart.shape), atol=1e-6)


def test_meshes_are_drawn_in_their_scale_and_what_is_missing_is_named(tmp_path: Path) -> None:
    trimesh.creation.box((2.0, 4.0, 6.0)).export(tmp_path / "block.stl")
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    mesh = "<visual><geometry><mesh filename='{}.stl' scale='.1 .1 .1'/></geometry></visual>"
    link = f"<link name='hull'>{''.join(map(mesh.format, ('block', 'absent', 'broken')))}</link>"
    weld = "<joint name='w' type='fixed'><parent link='boom'/><child link='hull'/></joint>"
    (tmp_path / "bare.urdf").write_text(BARE.replace("EXTRA", LUMPED + link + weld))
    solids, events, missing = visuals(Rig.load(tmp_path / "bare.urdf"))
    (block,) = (solid for solid in solids if solid.link == "hull")
    np.testing.assert_allclose(block.corners.max(axis=0), [0.1, 0.2, 0.3])
    assert [one.rgba for one in solids if one.link == "tip"] == [(0.2, 0.4, 0.6, 1.0)]
    assert missing == {"hull"}
    assert ["absent.stl" in one for one in events] == [True, False]
    assert ["broken.stl" in one for one in events] == [False, True]


@pytest.mark.parametrize("aspect", [16 / 9, 0.5])
def test_every_view_holds_the_rig(aspect: float) -> None:
    """In its middle nine tenths, and in front of what is too far and behind what is too near to be drawn."""
    rig = bundled("thesis")
    shown = motion(rig, sweep(rig), 15, 1.0, False)
    hull = figure.hull(visuals(rig)[0], poses(rig.model, shown.q).world)
    for placed in scene(rig, shown, aspect=aspect).views.values():
        properties = {c["property"]: c["value"] for c in placed if c["type"] == "set_property"}
        eye = properties["position"] * np.array([1, 1, -1])  # the camera's own frame has y up
        back = eye[[0, 2, 1]] / np.linalg.norm(eye)
        right = np.cross([0, 0, 1.0], back) / np.hypot(*back[:2])
        points = hull + square(placed[0]["matrix"])[:3, 3]
        depth = np.linalg.norm(eye) - points @ back
        across = points @ np.array([right, np.cross(back, right)]).T / depth[:, None]
        share = np.abs(across / np.tan(np.deg2rad(16.0)) / [aspect, 1.0]).max()
        assert properties["near"] < depth.min()
        assert depth.max() < properties["far"]
        assert 0.5 < share < 0.88 + 1e-6


# -- what cannot be used, names, files ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "more", "word"),
    [
        (
            "out.html",
            {"log": Log("a", ("turn",), np.arange(2.0), np.zeros((2, 1)))},
            "joint 'lift'",
        ),
        ("out.html", {"fps": 0.0}, "fps"),
        ("out.html", {"speed": -1.0}, "speed"),
        ("out.avi", {}, r"\.avi.*\.mp4"),
        ("out.png", {"size": (0, 10)}, "size"),
        ("out.png", {"at": 99.0}, "at: is 99"),
        ("out.png", {"camera": "below"}, "three-quarter"),
        ("no/out.html", {}, "does not exist"),
    ],
)
def test_an_argument_that_cannot_be_used_is_refused_by_name(
    lumped: Rig, tmp_path: Path, name: str, more: dict[str, Any], word: str
) -> None:
    with pytest.raises(GimbalPinError, match=word):
        view.animate(**{"log": sweep(lumped), "rig": lumped, **more}, path=tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_name_is_no_part_of_a_page(lumped: Rig) -> None:
    """Of rig, joints, links, log and payload; the pages of a file and of a live view."""
    text = re.sub(
        r'(name|link)="([^"]*)"',
        lambda found: f"{found[1]}={quoteattr(f'{found[2]} {EVIL}')}",
        BARE.replace("EXTRA", LUMPED),
    )
    rig = replace(spelled(text), payload=EVIL)
    with view.Live(rig) as live, urlopen(live.url) as answer:
        served = answer.read().decode()
    pages = (view.record(one, replace(sweep(one), name=one.title)) for one in (lumped, rig))
    plain, evil, alive = (
        Counter(str(one.tag) for one in lxml.html.fromstring(page).iter())
        for page in (*pages, served)
    )
    assert evil == plain
    assert alive["script"] == plain["script"]


def test_without_chromium_pictures_say_what_to_install_and_html_works(
    lumped: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chromium = pytest.importorskip("choreographer.browsers.chromium")
    monkeypatch.setattr(chromium.Chromium, "find_browser", classmethod(lambda _, **__: None))
    with pytest.raises(UsageError, match="apt install chromium"):
        view.animate(sweep(lumped), lumped, tmp_path / "out.gif")
    view.animate(sweep(lumped), lumped, tmp_path / "out.html")
    assert [path.name for path in tmp_path.iterdir()] == ["out.html"]


@needs_browser
def test_a_picture_and_a_film_hold_the_asked_frames(
    lumped: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asked for in a running event loop, as a notebook has it; a file is whole or not there."""
    pytest.importorskip("imageio_ffmpeg")
    log = sweep(lumped, seconds=0.25)

    async def notebook() -> None:
        view.animate(log, lumped, tmp_path / "still.png", size=(320, 180), at=3.2)

    asyncio.run(notebook())
    with Image.open(tmp_path / "still.png") as still:
        assert (still.size, still.format) == ((320, 180), "PNG")
    view.animate(log, lumped, tmp_path / "film.gif", size=(161, 91))
    with Image.open(tmp_path / "film.gif") as film:
        assert (film.info["duration"], film.n_frames, film.size) == (50, 6, (161, 91))
    monkeypatch.setitem(output.ENCODERS, ".webp", "-c:v no-such-codec")
    with pytest.raises(UsageError, match="no-such-codec"):
        view.animate(log, lumped, tmp_path / "broken.webp", size=(160, 90))
    assert {path.name for path in tmp_path.iterdir()} == {"still.png", "film.gif"}


@needs_browser
def test_a_browser_plays_the_page_offline_and_shows_the_rig_move(tmp_path: Path) -> None:
    rig = bundled("thesis")
    log = sweep(rig)
    view.animate(log, rig, tmp_path / "out.html")
    tip = figure.list_scene_paths(rig, RIG)[3].strip("/").split("/")
    pose = f"(viewer.scene_tree.find({tip}).object.updateWorldMatrix(true, true),"
    pose += f"viewer.scene_tree.find({tip}).object.matrixWorld.toArray())"
    first, second = (f"pictures([{t}], 320, 180)[0]" for t in (0.5, 1.3))
    seen = visit((tmp_path / "out.html").as_uri(), first, pose, second, pose, first)
    assert seen.complaints == []
    assert seen.values[0] == seen.values[4] != seen.values[2]  # whatever was shown before
    data = rig.model.createData()
    stands = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # the viewer's y is up
    for have, row in zip(seen.values[1:4:2], (150, 390)):
        pin.forwardKinematics(rig.model, data, log.q[row])
        np.testing.assert_allclose(square(have)[:3, :3], stands @ data.oMi[3].rotation, atol=1e-5)


COUNTED = """<head><script>{
  const request = requestAnimationFrame.bind(window);
  window.frames = 0;
  window.requestAnimationFrame = act => request(time => { frames++; act(time); });
}</script>"""
DRAWN = "document.querySelector('iframe').contentWindow.frames"
"""How many frames the scene in a page has drawn."""
FOLD = "document.querySelector('details').open = {}, 0"
RUNS = f"window.before = {DRAWN}, 0", until(f"{DRAWN} > window.before + 2")
RESTS = pause(0.3), f"window.before = {DRAWN}, 0", pause(0.3), f"{DRAWN} - window.before"


@needs_browser
def test_a_scene_runs_only_while_it_is_seen(lumped: Rig, tmp_path: Path) -> None:
    """Folded, scrolled away or folded again it draws no frame."""
    page = view.record(lumped, sweep(lumped)).replace("<head>", COUNTED, 1)
    frame = embed(page, "scene", "scene", "run")
    path = tmp_path / "page.html"
    details = f"<details><summary>scene</summary>{frame}</details>"
    path.write_text(f"<!DOCTYPE html>{details}<p style='height: 3000px'></p>")
    steps = [*RESTS, FOLD.format("true"), *RUNS, "scrollTo(0, 2500), 0", *RESTS]
    steps += ["scrollTo(0, 0), 0", *RUNS, FOLD.format("false"), *RESTS]
    assert not any(visit(path.as_uri(), *steps).values)


@needs_browser
def test_a_scene_obeys_the_readers_wishes_and_is_drawn_on_paper(
    lumped: Rig, tmp_path: Path
) -> None:
    """It stands where less motion is preferred, is dark where that is, and a still on paper."""
    path = tmp_path / "page.html"
    path.write_text(view.record(lumped, sweep(lumped)))
    picture = "document.querySelector('#meshcat-pane canvas').toDataURL().length"
    bar = "getComputedStyle(document.getElementById('bar')).display"
    ground = "getComputedStyle(document.body).backgroundColor"
    steps = [until("animator.time > 0"), ground, media(color_scheme="dark"), ground]
    steps += [media(reduced_motion="reduce"), go(path.as_uri()), pause(0.5), "animator.time"]
    steps += [picture, media("print"), f"(dispatchEvent(new Event('beforeprint')), {picture})", bar]
    found = visit(path.as_uri(), *steps)
    light, dark, time, blank, drawn, shown = found.values
    assert found.complaints == []
    assert (time, shown) == (0, "none")
    assert light != dark
    assert drawn > 2 * blank
