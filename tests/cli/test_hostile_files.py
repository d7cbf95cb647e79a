"""Files that nobody would write on purpose: each is read, or refused in one line, at once."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimbal_pin.control import stored, tune
from gimbal_pin.dynamics import Estimated, Model, Reference, nominal, reduce_parameters
from gimbal_pin.effects import BaseTilt, Cogging, DeadZone, Delay, Stribeck, Term
from gimbal_pin.errors import GimbalPinError, LogError, ModelError, RigError, UsageError
from gimbal_pin.identification import read_model, write_extended
from gimbal_pin.log import follow
from gimbal_pin.log.io.files import read_run, to_plain
from gimbal_pin.pointing import Controller
from gimbal_pin.rig import Rig, read_bytes, read_yaml
from tests.command_line import Run, refused
from tests.rigs import bundled

SOON = 15.0
"""Longest that anything here may take, s: what it guards against takes minutes or all of memory."""
TURRET = bundled("turret")


def refuse_soon(
    read: Callable[[], object], kind: type[GimbalPinError] = UsageError
) -> GimbalPinError:
    """Return the error of `kind`, in one line; it took no time."""
    start = time.perf_counter()
    with pytest.raises(kind) as caught:
        read()
    assert time.perf_counter() - start < SOON
    assert "\n" not in str(caught.value)
    return caught.value


# --- YAML and bytes -----------------------------------------------------------------------------

BOMB = "a0: &a0 [1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join(9 * [f'*a{k - 1}'])}]\n" for k in range(1, 40)
)


TRICKS = {
    "brackets": 20_000 * "[",
    "closed brackets": 20_000 * "[" + 20_000 * "]",
    "tables in tables": 20_000 * "{a: ",
    "aliases of aliases": BOMB,
    "blanks": 17 * 2**20 * " ",
    "a long integer": "a: !!int " + 5000 * "1",
    "a long sexagesimal": "a: !!float 1" + 5000 * ":1" + ".5",
    "itself": "a: &a [*a]",
    "an alias of nothing": "a: *b",
    "no boolean": "a: !!bool x",
    "no integer": "a: 0b_",
    "a date": "a: !!timestamp 2020-01-01",
    "a set": "!!set {a, b}",
    "pairs": "!!omap [a: 1]",
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
    assert refuse_soon(lambda: read_yaml(path)).place.startswith(str(path))


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
    """Also as a log that is followed, a controller and a run's list."""
    refuse_soon(lambda: read_bytes("/dev/zero", most=10**6))
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(2**40)
    refuse_soon(lambda: read_bytes(tmp_path / "sparse"))
    pipe = tmp_path / "pipe"
    for path in (pipe, tmp_path / "run.json"):
        os.mkfifo(path)
    assert read_bytes(pipe) == b""
    assert read_run(tmp_path) == {}
    refuse_soon(lambda: list(follow(str(pipe), TURRET, idle=0.1)), LogError)
    refuse_soon(lambda: Controller.load(pipe, TURRET), ModelError)


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
    "an endless number": (MASS, f'<mass value="{10**5 * "1"}"/>'),
    "many attributes": ("<link ", f"<link {MANY} "),
    "an entity": ("<robot", '<!DOCTYPE robot [<!ENTITY m "1">]><robot'),
    "a file": ("<robot", '<!DOCTYPE robot [<!ENTITY m SYSTEM "/etc/hostname">]><robot'),
    "digits of another script": (MASS, '<mass value="١"/>'),
    "a blank that is none to XML": (MASS, '<mass value="1&#xa0;"/>'),
    "an underscore": (MASS, '<mass value="1_0"/>'),
    "hexadecimal": (MASS, '<mass value="0x10"/>'),
    "a negative mass": (MASS, '<mass value="-1"/>'),
    "a planet": (MASS, '<mass value="1e24"/>'),
    "next to nothing": (MASS, '<mass value="5e-324"/>'),
    "a point": (INERTIA, 'ixx="1e-30" iyy="1e-30" izz="1e-30"'),
    "an orbit": (INERTIA, 'ixx="1e12" iyy="1e12" izz="1e12"'),
    "far away": ("<axis", '<origin xyz="1e300 0 0"/><axis'),
    "a turn without end": ("<axis", '<origin rpy="1e300 0 0"/><axis'),
    "no direction": ('xyz="0 0 1"', 'xyz="0 0 1e-30"'),
    "a star": ('effort="1"', 'effort="1e300"'),
    "no joint": ('type="revolute"', 'type="fixed"'),
    "a tab in a name": ('name="j1"', 'name="a&#9;b"'),
    "an escape in a name": ('name="j1"', 'name="a&#x9b;b"'),
    "a blank before a name": ('name="j1"', 'name=" a"'),
    "a long name": ('name="j1"', f'name="{65 * "a"}"'),
    "a link of two lines": ('"l1"', '"l&#10;1"'),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_urdf_of_no_machine_is_refused_in_one_line(
    case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    old, new = HOSTILE[case]
    assert old in ONE
    path = tmp_path / "x.urdf"
    path.write_text(ONE.replace(old, new), encoding="utf-8")
    refusal = refuse_soon(lambda: Rig.load(path), RigError)
    assert refusal.place.startswith(str(path))
    assert len(refusal.what) < 300
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (MASS, f"<!-- <mass value='2'/> -->{MASS}<a/><?pi?>"),
        ("<axis", '<xi:include xmlns:xi="x" href="/etc/hostname"/><dynamics/><axis'),
        (MASS, f'<mass value=" &#9;1{1000 * " "}"/>'),
        ("<robot", '<?xml version="1.0" encoding="iso-8859-1"?><robot'),
        ('name="j1"', 'name="俯仰"'),
        ('name="j1"', 'name="arm/joint.1 (left)"'),
        ('name="j1"', 'name="universe"'),
    ],
)
def test_what_a_model_is_not_made_of_changes_nothing(
    old: str, new: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    paths = (tmp_path / "one.urdf", tmp_path / "other.urdf")
    paths[0].write_text(ONE)
    paths[1].write_text(ONE.replace(old, new), encoding="utf-8")
    one, other = map(Rig.load, paths)
    np.testing.assert_array_equal(one.phi, other.phi)
    assert other.floating.nv == 7
    assert capfd.readouterr() == ("", "")


# --- Models and controllers ---------------------------------------------------------------------


@cache
def model() -> Model:
    """A model with all that its file can hold."""
    given = nominal(TURRET)
    cogging = Term(Cogging("pan", (12.0, 24.0)), (0.1, 0.2, 0.0, 0.1))
    terms = (*given.terms, cogging, Term(Stribeck("tilt", 0.1), (0.05,)))
    count = sum(len(term.values) for term in terms)
    names = (*reduce_parameters(TURRET).base_names, *(f"term {k}" for k in range(count)))
    k = len(names)
    known = Estimated(names, ("1",) * k, np.zeros(k), 1e-8 * (np.eye(k) + 0.1))
    drive = (Delay("pan", 0.002), DeadZone("tilt", 0.01))
    return Model(TURRET, terms, known, drive, (BaseTilt(0.01, 0.02),))


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the files of a model and of a controller of either kind hold."""
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    write_extended(model(), path)
    laws = {
        kind: to_plain(tune(model(), kind=kind, robust=kind != "pid").to_dict())  # type: ignore[arg-type]
        for kind in ("computed-torque", "pid")
    }
    return {"model": read_yaml(path), **laws}


def read_back(kind: str, content: Any, path: Path) -> None:
    """Read a file, and ask the model or law in it for a torque."""
    path.write_text(json.dumps(content).replace("NaN", ".nan"))
    q = np.array([[0.3, -0.2], [0.0, 0.1]])
    if kind == "model":
        assert np.isfinite(read_model(path, TURRET).inverse(q, q, q)).all()
        return
    law = stored(read_yaml(path), TURRET, str(path)).law
    tau, _ = law.torque(0.0, q[0], q[1], Reference(q[1], q[0], q[1]), law.start())
    assert np.isfinite(tau).all()


@pytest.mark.parametrize("kind", ["model", "computed-torque", "pid"])
def test_what_was_written_is_read(kind: str, contents: dict[str, Any], tmp_path: Path) -> None:
    read_back(kind, contents[kind], tmp_path / "x.yaml")


GONE = object()
NAN = float("nan")


@pytest.mark.parametrize(
    ("kind", "place", "value", "said"),
    [
        ("model", "schema", 99, "schema"),
        ("model", "changes", {"a": 1}, "changes"),
        ("model", "terms", ["coulomb"], "no table of a cause"),
        ("model", "terms.0.values", [NAN], r"values\[0\]"),
        ("model", "terms.0.values", [1.0] * 9, "one value per coefficient"),
        ("model", "drive.0.effect", "magic", "'magic' is unknown"),
        ("model", "drive.0.time", 9.0, "time is 9 s"),
        ("model", "drive.0.time", True, "time"),
        ("model", "drive.0.joint", "nose", "no joint 'nose'"),
        ("model", "phi", [0.0] * 19, "19 values"),
        ("model", "phi", [0.0] * 20, "not positive"),
        ("model", "joints", ["tilt", "pan"], "is for the joints"),
        ("model", "covariance.0", GONE, "another shape"),
        ("model", "covariance.0.0", NAN, r"covariance\[0\]\[0\]"),
        ("model", "covariance.0.0", -1e-8, "covariance"),
        ("model", "covariance.0.0", 0.0, "covariance"),
        ("model", "covariance.0.1", 9e-9, "covariance"),
        ("model", "lags", [0.001], "1 entries for 2 joints"),
        ("model", "lags", [0.001, 0.001], "lag_std: has 0 entries"),
        ("model", "noise", [1.0, 1.0, 1.0], "noise: has 3 entries"),
        ("model", "payloads", [1], "payloads"),
        ("computed-torque", "schema", "one", "schema"),
        ("computed-torque", "joints.pan.kp", GONE, "kp"),
        ("computed-torque", "joints.pan.kp", -1.0, "kp"),
        ("computed-torque", "joints.pan.ki", 1e9, "unstable"),
        ("computed-torque", "joints.pan", GONE, "is for the joints tilt"),
        ("computed-torque", "wish", [], "wish"),
        ("computed-torque", "wish.dt", 0, "dt"),
        ("computed-torque", "wish.delay", 86400.0, "delay"),
        ("computed-torque", "wish.kind", "fuzzy", "kind"),
        ("computed-torque", "wish.robust", "yes", "robust"),
        ("computed-torque", "robust.alpha", 1.0, "alpha"),
    ],
)
def test_a_model_or_controller_that_none_can_be_is_refused(
    kind: str, place: str, value: object, said: str, contents: dict[str, Any], tmp_path: Path
) -> None:
    content = deepcopy(contents[kind])
    *path, last = [int(x) if x.isdigit() else x for x in place.split(".")]
    owner = content
    for key in path:
        owner = owner[key]
    if value is GONE:
        del owner[last]
    else:
        owner[last] = value
    with pytest.raises(ModelError, match=said) as caught:
        read_back(kind, content, tmp_path / "x.yaml")
    assert caught.value.place.startswith(str(tmp_path / "x.yaml"))


@pytest.mark.parametrize("key", ["base_parameters", "phi", "covariance"])
def test_a_model_that_contradicts_itself_is_refused(key: str, made: Path, tmp_path: Path) -> None:
    """Its base parameters are sums of its bodies' parameters, and no estimate is exact."""
    content = read_yaml(made / "model.yaml")
    if key == "base_parameters":
        content[key][0]["value"] *= 1.1
    else:
        content[key] = (np.array(content[key]) * (2.0 if key == "phi" else 0.0)).tolist()
    path = tmp_path / "x.yaml"
    path.write_text(json.dumps(content))
    with pytest.raises(ModelError, match="covariance" if key == "covariance" else "base parameter"):
        read_model(path, bundled("turret", "cinema"))


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
