"""Files that nobody would write on purpose: each is read, or refused in one line, at once."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimbal_pin.control import stored, tune
from gimbal_pin.dynamics import Reference, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.errors import LogError, ModelError, RigError, UsageError
from gimbal_pin.identification import read_model, write_extended
from gimbal_pin.log import follow
from gimbal_pin.log.io.files import to_plain
from gimbal_pin.pointing import Controller
from gimbal_pin.rig import Rig, read_bytes, read_yaml
from tests.command_line import Run, refused
from tests.rigs import bundled

TURRET = bundled("turret", "cinema")

# --- YAML and bytes -----------------------------------------------------------------------------

BOMB = "a0: &a0 [1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join(9 * [f'*a{k - 1}'])}]\n" for k in range(1, 40)
)


TRICKS = {
    "closed brackets": 20_000 * "[" + 20_000 * "]",
    "aliases of aliases": BOMB,
    "blanks": 17 * 2**20 * " ",
    "a long integer": "a: !!int " + 5000 * "1",
    "itself": "a: &a [*a]",
    "an alias of nothing": "a: *b",
    "no boolean": "a: !!bool x",
    "a date": "a: !!timestamp 2020-01-01",
    "a set": "!!set {a, b}",
    "code": "!!python/object/apply:os.getcwd []",
    "a list as key": "{[a]: 1}",
    "a number as key": "{1: 1}",
    "two documents": "a: 1\n---\na: 2",
    "an escaped null": 'urdf: "a\\0b"',
    "an escape": "a: \x1b[31m",
}


@pytest.mark.parametrize("trick", TRICKS)
def test_a_yaml_that_is_no_plain_data_is_refused_before_it_unfolds(
    trick: str, tmp_path: Path
) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(TRICKS[trick], encoding="utf-8")
    with pytest.raises(UsageError, match=f"^{path}.*$"):
        read_yaml(path)


def test_what_looks_like_a_date_a_merge_or_a_huge_number_is_a_text(tmp_path: Path) -> None:
    """A few aliases mean what they stand for."""
    path = tmp_path / "x.yaml"
    for text in ("2020-01-01", "<<", "=", 400 * "1", "1" + 9000 * ":1"):
        path.write_text(f"a: {text}")
        assert read_yaml(path) == {"a": text}
    path.write_text("yaw: &motor {slots: 24, size: [&n 1, 2]}\nroll: *motor\ntilt: *n")
    motor = {"slots": 24, "size": [1, 2]}
    assert read_yaml(path) == {"yaw": motor, "roll": motor, "tilt": 1}


def test_a_file_without_end_is_refused_and_a_pipe_that_nobody_fills_is_empty(
    tmp_path: Path,
) -> None:
    """Also as a log that is followed, and as a controller."""
    sparse = tmp_path / "sparse"
    sparse.touch()
    os.truncate(sparse, 2**40)
    for path in ("/dev/zero", sparse):
        with pytest.raises(UsageError):
            read_bytes(path, most=10**6)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert read_bytes(pipe) == b""
    with pytest.raises(LogError):
        list(follow(str(pipe), TURRET, idle=0.1))
    with pytest.raises(ModelError):
        Controller.load(pipe, TURRET)


# --- URDF ---------------------------------------------------------------------------------------

LINK = (
    '<link name="l{0}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="j{0}" type="{1}"><parent link="l{2}"/><child link="l{0}"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)
ONE = f'<robot name="one"><link name="l0"/>{LINK.format(1, "revolute", 0)}</robot>'
MANY = " ".join(f'a{k}="1"' for k in range(10**5))
MASS = '<mass value="1"/>'
INERTIA = 'ixx="1" iyy="1" izz="1"'


def chain(count: int, kind: str) -> str:
    """Return a URDF of so many links behind each other, the last of them on a joint that moves."""
    links = [LINK.format(k, kind, k - 1) for k in range(1, count)]
    links.append(LINK.format(count, "revolute", count - 1))
    return f'<robot name="chain"><link name="l0"/>{"".join(links)}</robot>'


HOSTILE = {
    "too many joints": (ONE, chain(200, "revolute")),
    "too many links": (ONE, chain(10_000, "fixed")),
    "elements in elements": (ONE, f"<robot>{20_000 * '<a>'}{20_000 * '</a>'}</robot>"),
    "a huge text": ("</robot>", f"<x>{12_000_000 * 'a'}</x></robot>"),
    "many attributes": ("<link ", f"<link {MANY} "),
    "an entity": ("<robot", '<!DOCTYPE robot [<!ENTITY m "1">]><robot'),
    "a file": ("<robot", '<!DOCTYPE robot [<!ENTITY m SYSTEM "/etc/hostname">]><robot'),
    "digits of another script": (MASS, '<mass value="١"/>'),
    "a blank that is none to XML": (MASS, '<mass value="1&#xa0;"/>'),
    "a negative mass": (MASS, '<mass value="-1"/>'),
    "a planet": (MASS, '<mass value="1e24"/>'),
    "next to nothing": (MASS, '<mass value="5e-324"/>'),
    "a point": (INERTIA, 'ixx="1e-30" iyy="1e-30" izz="1e-30"'),
    "an orbit": (INERTIA, 'ixx="1e12" iyy="1e12" izz="1e12"'),
    "far away": ("<axis", '<origin xyz="1e300 0 0"/><axis'),
    "no direction": ('xyz="0 0 1"', 'xyz="0 0 1e-30"'),
    "no joint": ('type="revolute"', 'type="fixed"'),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_urdf_of_no_machine_is_refused_in_one_line(
    case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    old, new = HOSTILE[case]
    assert old in ONE
    path = tmp_path / "x.urdf"
    path.write_text(ONE.replace(old, new), encoding="utf-8")
    with pytest.raises(RigError, match=f"^{path}.*$") as caught:
        Rig.load(path)
    assert len(caught.value.what) < 300
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (MASS, f"<!-- <mass value='2'/> -->{MASS}<a/><?pi?>"),
        ("<axis", '<xi:include xmlns:xi="x" href="/etc/hostname"/><dynamics/><axis'),
        (MASS, f'<mass value=" &#9;1{1000 * " "}"/>'),
        ("<robot", '<?xml version="1.0" encoding="iso-8859-1"?><robot'),
        ('name="j1"', 'name="俯仰/joint.1 (left)"'),
        ('name="j1"', 'name="universe"'),
    ],
)
def test_what_a_model_is_not_made_of_changes_nothing(old: str, new: str, tmp_path: Path) -> None:
    path = tmp_path / "one.urdf"
    path.write_text(ONE)
    one = Rig.load(path)
    path.write_text(ONE.replace(old, new), encoding="utf-8")
    np.testing.assert_array_equal(Rig.load(path).phi, one.phi)


# --- Models and controllers ---------------------------------------------------------------------

CAUSES = ("cogging:pan:amplitude=0.05,harmonic=12", "delay:pan:time=0.002", "base-tilt:roll=0.02")
"""A torque, a part of the drive and a change of the rig: what an extended model may hold."""


@pytest.fixture(scope="module")
def folder(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of each kind, as JSON: a model as it is identified or with causes,a controller."""
    folder = tmp_path_factory.mktemp("model")
    model = read_model(made / "model.yaml", TURRET)
    plant, drive = plant_with(model, [parse_effect(cause, TURRET) for cause in CAUSES])
    extended = replace(plant, drive=tuple(drive), estimated=model.estimated)
    write_extended(extended, folder / "model.yaml")
    contents: dict[str, Any] = {
        "identified": read_yaml(made / "model.yaml"),
        "model": read_yaml(folder / "model.yaml"),
        "computed-torque": to_plain(tune(extended).to_dict()),
    }
    for kind, content in contents.items():
        (folder / kind).write_text(json.dumps(content))
    return folder


def ask_torque(kind: str, path: Path) -> np.ndarray:
    """Read a file, and ask the model or law in it for a torque."""
    q = np.array([[0.3, -0.2]])
    if kind in ("model", "identified"):
        return read_model(path, TURRET).inverse_dynamics(q, q, q)
    law = stored(read_yaml(path), TURRET, str(path)).law
    return law.torque(0.0, q[0], q[0], Reference(0 * q[0], q[0], q[0]), law.start())[0]


@pytest.mark.parametrize("kind", ["identified", "model", "computed-torque"])
def test_what_was_written_is_read(kind: str, folder: Path) -> None:
    assert np.isfinite(ask_torque(kind, folder / kind)).all()


GONE = object()
NAN = float("nan")


@pytest.mark.parametrize(
    ("kind", "place", "value", "said"),
    [
        ("model", "schema", 99, "schema"),
        ("model", "terms", ["coulomb"], "no table of a cause"),
        ("model", "terms.0.values", [NAN], r"values\[0\]"),
        ("model", "drive.0.effect", "magic", "'magic' is unknown"),
        ("model", "drive.0.time", 9.0, "time is 9 s"),
        ("model", "phi", [0.0] * 19, "19 values"),
        ("model", "phi", [0.0] * 20, "not positive"),
        ("model", "joints", ["tilt", "pan"], "is for the joints"),
        ("model", "covariance.0", GONE, "another shape"),
        ("model", "covariance.0.0", -1e-8, "covariance"),
        ("model", "covariance.0.1", 9e-9, "covariance"),
        ("model", "lags", [0.001], "1 entries for 2 joints"),
        ("model", "noise", [1.0, 1.0, 1.0], "noise: has 3 entries"),
        ("computed-torque", "joints.pan.kp", GONE, "kp"),
        ("computed-torque", "joints.pan.kp", -1.0, "kp"),
        ("computed-torque", "joints.pan.ki", 1e9, "unstable"),
        ("computed-torque", "wish.dt", 0, "dt"),
        ("computed-torque", "wish.kind", "fuzzy", "kind"),
        ("identified", "base_parameters.0.value", 99.0, "base parameter"),
        ("identified", "phi.9", 99.0, "base parameter"),
        ("identified", "covariance.0", [0.0] * 40, "covariance"),
    ],
)
def test_a_model_or_controller_that_none_can_be_is_refused(
    kind: str, place: str, value: object, said: str, folder: Path, tmp_path: Path
) -> None:
    """Base parameters are sums of the bodies' parameters, and no estimate is exact."""
    content = json.loads((folder / kind).read_text())
    *path, last = [int(x) if x.isdigit() else x for x in place.split(".")]
    owner = content
    for key in path:
        owner = owner[key]
    owner[last] = value
    if value is GONE:
        del owner[last]
    file = tmp_path / "x.yaml"
    file.write_text(json.dumps(content).replace("NaN", ".nan"))
    with pytest.raises(ModelError, match=f"x.yaml.*{said}"):
        ask_torque(kind, file)


@pytest.mark.parametrize("text", ["", "[]", "3", "text", "{}", "kind: gimbal_pin model", "wish: 1"])
@pytest.mark.parametrize(
    "verb", ["tune turret {}", "track turret {}", "export {} --rig turret --odrive no.json"]
)
def test_every_verb_refuses_a_file_of_another_kind(
    verb: str, text: str, tmp_path: Path, run: Run
) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    refused(run(*verb.format(path).split()), 2, str(path))
