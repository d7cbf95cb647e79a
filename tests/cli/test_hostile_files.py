"""Files that nobody would write on purpose: each is read, or refused in one line, at once."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gimbal_pin.control import stored, tune
from gimbal_pin.control.laws.design import KINDS
from gimbal_pin.dynamics import (
    Estimated,
    Model,
    Reference,
    compute_rnea,
    nominal,
    reduce_parameters,
)
from gimbal_pin.effects import BaseTilt, Cogging, DeadZone, Delay, Stribeck, Term
from gimbal_pin.errors import GimbalPinError, LogError, ModelError, RigError, UsageError
from gimbal_pin.identification import read_model, write_extended
from gimbal_pin.log import follow
from gimbal_pin.log.io.files import read_run, to_plain
from gimbal_pin.pointing import Controller
from gimbal_pin.rig import Rig, read_bytes, read_yaml
from gimbal_pin.rig import bundled as data_folder
from tests.command_line import Run, refused
from tests.damaged import damaged_tree, damaged_xml
from tests.rigs import spelled

RUN = "run.json"

BUNDLED = sorted(data_folder().rglob("*.urdf"))

SOON = 15.0
"""Longest that anything here may take, s: what it guards against takes minutes or all of the memory."""


def soon(read: Callable[[], object], kind: type[GimbalPinError] = UsageError) -> object:
    """What is read, or the error of `kind` in one line; it took no time."""
    start = time.perf_counter()
    try:
        found = read()
    except kind as error:
        assert "\n" not in str(error)
        found = error
    assert time.perf_counter() - start < SOON
    return found


# --- YAML -----------------------------------------------------------------------------------------------------------

BOMB = "a0: &a0 [1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join(9 * [f'*a{k - 1}'])}]\n" for k in range(1, 40)
)
TRICKS = {
    "brackets": 20_000 * "[",
    "closed brackets": 20_000 * "[" + 20_000 * "]",
    "tables in tables": 20_000 * "{a: ",
    "dashes": 20_000 * "- ",
    "aliases of aliases": BOMB,
    "itself": "a: &a [*a]",
    "an alias of nothing": "a: *b",
    "a file larger than any": 17 * 2**20 * " ",
    "no boolean": "a: !!bool x",
    "no integer": "a: !!int x",
    "an integer of nothing": "a: !!int",
    "an integer without digits": "a: 0b_",
    "a long integer": "a: !!int " + 5000 * "1",
    "a long sexagesimal": "a: !!float 1" + 5000 * ":1" + ".5",
    "a date": "a: !!timestamp 2020-01-01",
    "bytes": "a: !!binary aGk=",
    "a set": "!!set {a, b}",
    "pairs": "!!omap [a: 1]",
    "code": "!!python/object/apply:os.getcwd []",
    "a list as key": "{[a]: 1}",
    "a number as key": "{1: 1}",
    "two documents": "a: 1\n---\na: 2",
    "a null character": "a: \0",
    "an escaped null character": 'urdf: "a\\0b"',
    "an escape": "a: \x1b[31m",
}


@pytest.mark.parametrize("trick", TRICKS)
def test_a_yaml_that_is_no_plain_data_is_refused_before_it_unfolds(
    tmp_path: Path, trick: str
) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(TRICKS[trick], encoding="utf-8")
    refusal = soon(lambda: read_yaml(path))
    assert isinstance(refusal, UsageError) and refusal.place.startswith(str(path))


def test_what_looks_like_a_date_a_merge_or_a_huge_number_is_a_text(tmp_path: Path) -> None:
    for text in ("2020-01-01", "<<", "=", 400 * "1", "1" + 9000 * ":1"):
        (tmp_path / "x.yaml").write_text(f"a: {text}")
        assert soon(lambda: read_yaml(tmp_path / "x.yaml")) == {"a": text}


def test_a_few_aliases_mean_what_they_stand_for(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(
        "yaw: &motor {slots: 24, size: [&n 1, 2]}\nroll: *motor\ntilt: *n"
    )
    motor = {"slots": 24, "size": [1, 2]}
    assert read_yaml(tmp_path / "x.yaml") == {"yaw": motor, "roll": motor, "tilt": 1}


SPELLED = st.text("ab01.:-,[]{}&*!?|>#'\"% \n\t_enx", max_size=40)


@given(SPELLED.map(str.encode) | st.binary(max_size=60))
@example(b"\xff\xfea\0")
@example(b"\xef\xbb\xbfa: 1")
def test_any_bytes_are_a_value_or_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    found = soon(lambda: read_yaml(path))
    assert isinstance(found, UsageError) or is_plain(found)


def is_plain(value: object) -> bool:
    """Whether a value is of texts, numbers, booleans, nothing, lists, and tables with texts as keys."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and is_plain(inner) for key, inner in value.items())
    return (
        all(map(is_plain, value))
        if isinstance(value, list)
        else isinstance(value, (str, int, float, type(None)))
    )


# --- bytes ----------------------------------------------------------------------------------------------------------


def test_a_file_without_end_is_refused_and_a_pipe_that_nobody_fills_is_empty(
    tmp_path: Path,
) -> None:
    assert isinstance(soon(lambda: read_bytes("/dev/zero", most=10**6)), UsageError)
    os.mkfifo(tmp_path / "pipe")
    assert soon(lambda: read_bytes(tmp_path / "pipe")) == b""
    assert isinstance(
        soon(lambda: list(follow(str(tmp_path / "pipe"), Rig.load("turret"), idle=0.1)), LogError),
        LogError,
    )
    sparse = tmp_path / "sparse"
    with sparse.open("wb") as file:
        file.truncate(2**40)
    assert isinstance(soon(lambda: read_bytes(sparse)), UsageError)


@pytest.mark.parametrize("content", [None, b"[" * 100_000], ids=["pipe", "brackets"])
def test_a_stored_controller_and_a_runs_list_are_read_as_any_file(
    tmp_path: Path, content: bytes | None
) -> None:
    path = tmp_path / RUN
    if content is None:
        os.mkfifo(path)
    else:
        path.write_bytes(content)
    assert isinstance(
        soon(lambda: Controller.load(path, Rig.load("turret")), ModelError), ModelError
    )
    assert soon(lambda: read_run(tmp_path)) == {}


def test_a_pipe_that_somebody_fills_is_read_to_its_end() -> None:
    end, start = os.pipe()
    os.write(start, b"abc")
    os.close(start)
    assert soon(lambda: read_bytes(f"/dev/fd/{end}")) == b"abc"
    os.close(end)


def test_an_element_of_a_hundred_thousand_attributes_is_refused_at_once(tmp_path: Path) -> None:
    """Readers take a time that grows with their square, of the robot, of a link, of a mass."""
    text = (data_folder() / "turret.urdf").read_text()
    many = " ".join(f'a{k}="1"' for k in range(100_000))
    for tag in ("<robot ", "<link ", "<mass "):
        (tmp_path / "rig.urdf").write_text(text.replace(tag, f"{tag}{many} ", 1))
        assert "attributes" in str(soon(lambda: Rig.load(tmp_path / "rig.urdf"), RigError))


# --- URDF -----------------------------------------------------------------------------------------------------------

BODY = (
    '<link name="l{0}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="j{0}" type="{1}"><parent link="l{2}"/><child link="l{0}"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)


def chain(count: int, kind: str, last: str = "revolute", root: str = '<link name="l0"/>') -> str:
    """A URDF of so many links behind each other, the last of them on a joint of the kind `last`."""
    links = [BODY.format(k, last if k == count else kind, k - 1) for k in range(1, count + 1)]
    return f'<robot name="chain">{root}{"".join(links)}</robot>'


def in_one(old: str, new: str) -> str:
    """A rig of one joint with the first `old` replaced."""
    text = chain(1, "revolute")
    assert old in text
    return text.replace(old, new, 1)


MASS = '<mass value="1"/>'
HOSTILE = {
    "too many joints": chain(200, "revolute"),
    "too many links": chain(10_000, "fixed"),
    "elements in elements": f"<robot>{20_000 * '<a>'}{20_000 * '</a>'}</robot>",
    "a huge text": in_one("</robot>", f"<x>{12_000_000 * 'a'}</x></robot>"),
    "an entity as mass": '<!DOCTYPE robot [<!ENTITY m "1">]>' + in_one(MASS, '<mass value="&m;"/>'),
    "a file as entity": '<!DOCTYPE robot [<!ENTITY m SYSTEM "/etc/hostname">]>'
    + in_one(MASS, f"&m;{MASS}"),
    "digits of another script": in_one(MASS, '<mass value="١"/>'),
    "a blank that is none to XML": in_one(MASS, '<mass value="1&#xa0;"/>'),
    "an underscore": in_one(MASS, '<mass value="1_0"/>'),
    "hexadecimal": in_one(MASS, '<mass value="0x10"/>'),
    "an endless number": in_one(MASS, f'<mass value="{10**5 * "1"}"/>'),
    "a planet": in_one(MASS, '<mass value="1e24"/>'),
    "an atom": in_one(MASS, '<mass value="1e-24"/>'),
    "next to nothing": in_one(MASS, '<mass value="5e-324"/>'),
    "a point": in_one('ixx="1" iyy="1" izz="1"', 'ixx="1e-30" iyy="1e-30" izz="1e-30"'),
    "a planet's orbit": in_one('ixx="1" iyy="1" izz="1"', 'ixx="1e12" iyy="1e12" izz="1e12"'),
    "far away": in_one("<axis", '<origin xyz="1e300 0 0"/><axis'),
    "a turn without end": in_one("<axis", '<origin rpy="1e300 0 0"/><axis'),
    "no direction": in_one('xyz="0 0 1"', 'xyz="0 0 1e-30"'),
    "the effort of a star": in_one('effort="1"', 'effort="1e300"'),
    **{
        f"a joint named {name!r}": in_one('name="j1"', f'name="{name}"')
        for name in ("a&#9;b", "a&#10;b", "a&#x9b;b", " a", "a ", "&#xa0;", 65 * "a")
    },
    "a link of two lines": in_one("<robot", '<robot id="1"').replace('"l1"', '"l&#10;1"'),
    "an angle that is a reference": chain(2, "revolute")
    .replace('"j1"', '"a"')
    .replace('"j2"', '"ref_a"'),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_urdf_of_no_machine_is_refused_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str
) -> None:
    (tmp_path / "x.urdf").write_text(HOSTILE[case], encoding="utf-8")
    refusal = soon(lambda: Rig.load(tmp_path / "x.urdf"), RigError)
    assert isinstance(refusal, RigError) and refusal.place.startswith(str(tmp_path / "x.urdf"))
    assert HOSTILE[case] not in str(refusal) and len(refusal.what) < 300
    assert capfd.readouterr() == ("", "")


ODD = (
    "<dynamics/>",
    "<?pi?>",
    "<!-- <mass value='2'/> -->",
    '<xi:include xmlns:xi="x" href="/etc/hostname"/>',
    "<a/>",
)


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("before", ["<robot", MASS, "<axis", "</robot>"])
def test_what_a_model_is_not_made_of_changes_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], odd: str, before: str
) -> None:
    if before == "<robot" and not odd.startswith(("<?", "<!")):
        before = '<link name="l0"/>'
    (tmp_path / "x.urdf").write_text(in_one(before, odd + before))
    np.testing.assert_array_equal(
        Rig.load(tmp_path / "x.urdf").phi, spelled(chain(1, "revolute")).phi
    )
    assert capfd.readouterr() == ("", "")


def test_blanks_around_a_number_change_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for old in (MASS, 'effort="1"', 'ixx="1"'):
        (tmp_path / "x.urdf").write_text(in_one(old, old.replace('"1"', f'" &#9;1{1000 * " "}"')))
        np.testing.assert_array_equal(
            Rig.load(tmp_path / "x.urdf").phi, spelled(chain(1, "revolute")).phi
        )
    assert capfd.readouterr() == ("", "")


def test_names_in_any_script_and_an_encoding_wrongly_declared_are_taken(tmp_path: Path) -> None:
    for name in (
        "schwenk-achse",
        "俯仰",
        "arm/joint.1 (left)",
        "universe",
        "platform",
        "root_joint",
    ):
        text = '<?xml version="1.0" encoding="iso-8859-1"?>' + in_one('name="j1"', f'name="{name}"')
        (tmp_path / "x.urdf").write_text(text, encoding="utf-8")
        rig = Rig.load(tmp_path / "x.urdf")
        assert rig.joints == (name,) and rig.floating.nv == 7


@given(st.sampled_from(BUNDLED).flatmap(lambda path: damaged_xml(path.read_bytes())))
def test_a_damaged_urdf_is_a_rig_or_refused_and_nothing_is_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], content: bytes
) -> None:
    (tmp_path / "x.urdf").write_bytes(content)
    rig = soon(lambda: Rig.load(tmp_path / "x.urdf"), RigError)
    assert (
        isinstance(rig, RigError) or np.isfinite(compute_rnea(rig, *np.ones((3, 1, rig.n)))).all()
    )
    assert capfd.readouterr() == ("", "")


# --- models and controllers -----------------------------------------------------------------------------------------


@cache
def model() -> Model:
    """A model with all that its file can hold."""
    given = nominal(Rig.load("turret"))
    terms = (
        *given.terms,
        Term(Cogging("pan", (12.0, 24.0)), (0.1, 0.2, 0.0, 0.1)),
        Term(Stribeck("tilt", 0.1), (0.05,)),
    )
    names = (
        *reduce_parameters(given.rig).base_names,
        *(f"term {k}" for k in range(sum(len(term.values) for term in terms))),
    )
    k = len(names)
    known = Estimated(names, ("1",) * k, np.zeros(k), 1e-8 * (np.eye(k) + 0.1))
    drive = (Delay("pan", 0.002), DeadZone("tilt", 0.01))
    changes = (BaseTilt(0.01, 0.02),)
    return Model(given.rig, terms, known, drive, changes)


@cache
def files() -> dict[str, Any]:
    """A model's, a computed-torque controller's and a PID's content."""
    with TemporaryDirectory() as folder:
        write_extended(model(), Path(folder) / "model.yaml")
        content = read_yaml(Path(folder) / "model.yaml")
    laws = {
        kind: to_plain(tune(model(), kind=kind, robust=kind != "pid").to_dict()) for kind in KINDS
    }
    assert laws["computed-torque"]["robust"] is not None
    return {"model": content, **laws}


def read_back(kind: str, content: Any, folder: Path) -> None:
    """Read a file, and ask the model or law in it for a torque."""
    rig = model().rig
    path = folder / "x.yaml"
    path.write_text(
        json.dumps(content).replace("NaN", ".nan").replace("Infinity", ".inf")
    )  # JSON is YAML, and quick
    q = np.array([[0.3, -0.2], [0.0, 0.1]])
    v = np.array([[0.1, 0.0], [-1.0, 2.0]])
    if kind == "model":
        found = read_model(path, rig)
        assert np.isfinite(found.inverse(q, v, v)).all()
        return
    law = stored(read_yaml(path), rig, str(path)).law
    tau, _ = law.torque(0.0, q[0], v[0], Reference(q[1], v[1], v[0]), law.start())
    assert np.isfinite(tau).all()


@pytest.mark.parametrize("kind", ["model", *KINDS])
def test_what_was_written_is_read(tmp_path: Path, kind: str) -> None:
    read_back(kind, files()[kind], tmp_path)


@given(st.sampled_from(["model", *KINDS]), st.data())
def test_a_damaged_model_or_controller_is_read_or_refused(
    tmp_path: Path, kind: str, data: st.DataObject
) -> None:
    content = data.draw(damaged_tree(files()[kind]))
    refusal = soon(lambda: read_back(kind, content, tmp_path), ModelError)
    assert refusal is None or refusal.place.startswith(str(tmp_path / "x.yaml"))


BAD_MODELS: Mapping[str, tuple[Callable[[Any], object], str]] = {
    "changes as a table": (lambda m: m.update(changes={"a": 1}), "changes"),
    "a term that is but a name": (lambda m: m.update(terms=["coulomb"]), "no table of a cause"),
    "an unknown cause": (lambda m: m["drive"][0].update(effect="magic"), "'magic' is unknown"),
    "a cause outside its bounds": (lambda m: m["drive"][0].update(time=9.0), "time is 9 s"),
    "a cause at no joint": (lambda m: m["drive"][0].update(joint="nose"), "no joint 'nose'"),
    "a truth as a figure": (lambda m: m["drive"][0].update(time=True), "time"),
    "too many coefficients": (
        lambda m: m["terms"][0]["values"].append(1.0),
        "one value per coefficient",
    ),
    "a coefficient that is none": (
        lambda m: m["terms"][0].update(values=[float("nan")]),
        "values[0]",
    ),
    "too few parameters": (lambda m: m["phi"].pop(), "19 values"),
    "no inertia": (lambda m: m.update(phi=20 * [0.0]), "not positive"),
    "negative masses": (lambda m: m.update(phi=[-x for x in m["phi"]]), "not positive"),
    "joints in another order": (lambda m: m["joints"].reverse(), "is for the joints"),
    "a covariance of another shape": (lambda m: m["covariance"].pop(), "another shape"),
    "a covariance with a hole": (
        lambda m: m["covariance"][0].__setitem__(0, float("nan")),
        "covariance[0][0]",
    ),
    "a negative variance": (lambda m: m["covariance"][0].__setitem__(0, -1e-8), "covariance"),
    "a covariance that is not symmetric": (
        lambda m: m["covariance"][0].__setitem__(1, 9e-9),
        "covariance",
    ),
    "a variance of zero beside covariances": (
        lambda m: m["covariance"][0].__setitem__(0, 0.0),
        "covariance",
    ),
    "lags of one joint of two": (
        lambda m: m.update(lags=[0.001], lag_std=[0.001]),
        "1 entries for 2 joints",
    ),
    "lags without deviations": (lambda m: m.update(lags=[0.001, 0.001]), "lag_std: has 0 entries"),
    "noise of three joints": (lambda m: m.update(noise=[1.0, 1.0, 1.0]), "noise: has 3 entries"),
    "payloads as a list": (lambda m: m.update(payloads=[1]), "payloads"),
}


@pytest.mark.parametrize("case", BAD_MODELS)
def test_a_model_that_none_can_be_is_refused(tmp_path: Path, case: str) -> None:
    content = deepcopy(files()["model"])
    change, words = BAD_MODELS[case]
    change(content)
    with pytest.raises(ModelError) as caught:
        read_back("model", content, tmp_path)
    assert words in str(caught.value) and caught.value.place.startswith(str(tmp_path / "x.yaml"))


BAD_CONTROLLERS: Mapping[str, tuple[Callable[[Any], object], str]] = {
    "no gain": (lambda c: c["joints"]["pan"].pop("kp"), "kp"),
    "a negative gain": (lambda c: c["joints"]["pan"].update(kp=-1.0), "kp"),
    "an unstable gain": (lambda c: c["joints"]["pan"].update(ki=1e9), "unstable"),
    "a missing joint": (lambda c: c["joints"].pop("pan"), "is for the joints tilt"),
    "no interval": (lambda c: c["wish"].update(dt=0), "dt"),
    "an interval of nothing": (lambda c: c["wish"].update(dt=1e-300), "dt"),
    "a delay of a day": (lambda c: c["wish"].update(delay=86400.0), "delay"),
    "another kind": (lambda c: c["wish"].update(kind="fuzzy"), "kind"),
    "a robust truth in words": (lambda c: c["wish"].update(robust="yes"), "robust"),
    "a wish that is none": (lambda c: c.update(wish=[]), "wish"),
    "a model uncertain altogether": (lambda c: c["robust"].update(alpha=1.0), "alpha"),
}


@pytest.mark.parametrize("case", BAD_CONTROLLERS)
def test_a_controller_that_none_can_be_is_refused(tmp_path: Path, case: str) -> None:
    content = deepcopy(files()["computed-torque"])
    change, words = BAD_CONTROLLERS[case]
    change(content)
    with pytest.raises(ModelError) as caught:
        read_back("computed-torque", content, tmp_path)
    assert words in str(caught.value) and caught.value.place.startswith(str(tmp_path / "x.yaml"))


@pytest.mark.parametrize(
    "content", ["", "[]", "3", "text", "{}", "kind: gimbal_pin model", "wish: 1"]
)
@pytest.mark.parametrize(
    "verb",
    [
        "tune turret FILE",
        "track turret FILE",
        "simulate turret --model FILE -o x.csv",
        "simulate turret --controller FILE -o x.csv",
    ],
)
def test_every_verb_refuses_a_file_of_another_kind(
    tmp_path: Path, run: Run, verb: str, content: str
) -> None:
    (tmp_path / "x.yaml").write_text(content)
    words = [str(tmp_path / word) if word == "x.csv" else word for word in verb.split()]
    refused(
        run(*[str(tmp_path / "x.yaml") if word == "FILE" else word for word in words]),
        2,
        str(tmp_path / "x.yaml"),
    )
