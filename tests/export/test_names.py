"""Names of joints, links, rigs and payloads are data in every file that is written, whatever characters they have."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
import yaml
from lxml import etree, html

from gimbal_pin.control import tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import RigError
from gimbal_pin.export.tables import simplefoc
from gimbal_pin.identification import identify
from gimbal_pin.log import Log, read_log, write_log
from gimbal_pin.rig import Rig
from tests.command_line import Run, result
from tests.exported import has
from tests.rigs import BODY

NAMES = (
    "**// static int evil(void){return 1;}} /** ??/",
    "evil(); // \\",
    "\"); evil(\"</script><evil a='1'>&lt;-->",
    "evil: [1, 'x'] # {{ evil }} $evil^$",
    "evil---,;é",
)
"""Names that close comments, strings, tags and scalars of C, C++, XML, HTML, YAML, Markdown, Jinja and CSV."""


def write_rig(folder: Path, names: tuple[str, ...], stem: str = "rig") -> Path:
    """Write a URDF of two joints, with a YAML: names of pan, tilt, base, fork and camera."""
    pan, tilt, base, fork, camera = (quoteattr(name) for name in names)
    limit = '<limit lower="-1" upper="1" effort="2" velocity="3"/><dynamics friction="0.1" damping="0.1"/>'
    joints = (
        f'<joint name={name} type="revolute"><parent link={parent}/><child link={child}/>'
        f'<axis xyz="{axis}"/>{limit}</joint>'
        for name, parent, child, axis in ((pan, base, fork, "0 0 1"), (tilt, fork, camera, "0 1 0"))
    )
    bodies = (BODY.replace('"{0}"', name).replace("{1}", "1") for name in (fork, camera))
    text = f'<robot name="two"><link name={base}/>{"".join((*bodies, *joints))}</robot>'
    (folder / f"{stem}.urdf").write_text(text, encoding="utf-8")
    config = {"urdf": f"{stem}.urdf", "camera_frame": names[4], "imus": [names[2], names[4]]}
    path = folder / f"{stem}.yaml"
    path.write_text(yaml.safe_dump(config, allow_unicode=True), encoding="utf-8")
    return path


def list_code(path: Path) -> str:
    """Return a file of C or C++ without comments and string literals."""
    compiler = (
        ["gcc", "-x", "c", "-std=c99"]
        if path.suffix in (".c", ".h")
        else ["g++", "-x", "c++", "-std=c++17"]
    )
    text = subprocess.run(
        [*compiler, "-trigraphs", "-fpreprocessed", "-dD", "-E", "-P", str(path)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    return re.sub(r'"(?:\\.|[^"\\])*"', '""', text)


@pytest.mark.skipif(not has("gcc"), reason="no C compiler")
def test_no_part_of_a_name_is_code_in_what_export_writes(run: Run, tmp_path: Path) -> None:
    """C99, SimpleFOC, ros2_control, ODrive and MuJoCo: sources compile without it, data hold exactly it."""
    pytest.importorskip("casadi")
    rig = Rig.load(write_rig(tmp_path, NAMES, "evil() 'rig' --<evil>`#"))
    tune(nominal(rig)).save(tmp_path / "c.yaml")
    out = {kind: tmp_path / kind for kind in ("c", "ros2", "simplefoc")}
    options = [part for kind, folder in out.items() for part in (f"--{kind}", folder)]
    result(
        run,
        "export",
        tmp_path / "c.yaml",
        *options,
        "--odrive",
        tmp_path / "o.json",
        "--mjcf",
        tmp_path / "m.xml",
    )
    for folder in out.values():
        for path in folder.iterdir():
            if path.suffix in (".c", ".h", ".ino", ".cpp", ".hpp"):
                assert "evil" not in list_code(path).replace("gimbal_evil_rig_evil", "")
            elif path.suffix in (".xml", ".urdf"):
                assert not etree.parse(path).findall(".//evil")
    assert not re.search(r"(?<!\\)[<`]evil", (out["c"] / "README.md").read_text("utf-8"))
    check = ["gcc", "-std=c99", "-Wall", "-Werror", "-fsyntax-only"]
    sources = [str(path) for path in (*out["c"].glob("*.c"), *out["simplefoc"].glob("*.h"))]
    subprocess.run([*check, *sources], cwd=out["c"], capture_output=True, check=True)
    given = yaml.safe_load((out["ros2"] / "controllers.yaml").read_text("utf-8"))
    parameters = given["gimbal_controller"]["ros__parameters"]
    assert (
        parameters["camera_imu"] == f"{NAMES[4]}_imu"
        and parameters["base_imu"] == f"{NAMES[2]}_imu"
    )
    interfaces = etree.parse(out["ros2"] / "gimbal.urdf").findall("ros2_control/joint")
    assert [joint.get("name") for joint in interfaces] == list(NAMES[:2])
    assert list(json.loads((tmp_path / "o.json").read_text("utf-8"))["axes"]) == list(NAMES[:2])
    moved = etree.parse(tmp_path / "m.xml").findall(".//body/joint")
    assert [joint.get("name") for joint in moved] == list(NAMES[:2])


@pytest.mark.parametrize("joint", [*NAMES, "/", "*/", "**//", "\\", "a'b`c|d<e>"])
def test_a_header_for_simplefoc_holds_no_code_of_a_name(joint: str, tmp_path: Path) -> None:
    """Comments of a header and of a sketch end where they would for a joint that is called pan."""
    if not has("gcc"):
        pytest.skip("no C compiler")
    codes = []
    for stem, name in (("plain", "pan"), ("odd", joint)):
        rig = Rig.load(write_rig(tmp_path, (name, "tilt", *NAMES[2:]), stem))
        for file, text in simplefoc(nominal(rig)).items():
            (tmp_path / file).write_text(text, encoding="utf-8")
        codes.append(
            [list_code(tmp_path / f"gimbal_feed_forward.{suffix}") for suffix in ("h", "ino")]
        )
    assert codes[0] == codes[1]


def test_logs_models_and_pages_keep_a_name(tmp_path: Path) -> None:
    """What is written as CSV and YAML is read again for the same joints; a page shows the name as text."""
    rig = Rig.load(write_rig(tmp_path, NAMES))
    t = np.arange(0, 12, 0.01)
    q = np.stack([np.sin(2 * t) + 0.3 * np.sin(5 * t), np.cos(3 * t) + 0.2 * np.sin(7 * t)], axis=1)
    v = np.gradient(q, 0.01, axis=0)
    a = np.gradient(np.gradient(q, 0.01, axis=0), 0.01, axis=0)
    log = Log("log", rig.joints, t, q, v, nominal(rig).inverse(q, v, a))
    for suffix in (".csv", ".tsv", ".parquet"):
        write_log(log, tmp_path / f"log{suffix}")
        again = read_log(tmp_path / f"log{suffix}", rig)
        assert again.joints == rig.joints and np.array_equal(again.tau, log.tau)
    found = identify(rig, [log])
    found.report(tmp_path / "page.html")
    page = html.fromstring((tmp_path / "page.html").read_text("utf-8"))
    assert not page.findall(".//evil") and NAMES[2] in page.text_content()


@pytest.mark.parametrize("name", ["a\nb", "a\tb", "a\x9bb", "a\u202eb", " a", "a ", "a" * 65])
@pytest.mark.parametrize("place", ["joint", "link", "rig", "payload"])
def test_a_name_of_other_characters_is_refused_once(name: str, place: str, tmp_path: Path) -> None:
    """Line ends, control characters, marks of direction, spaces at an end, and more than 64 characters."""
    spelled = (
        name.replace("\n", "&#10;").replace("\t", "&#9;") if place in ("joint", "link") else name
    )
    joint, link, stem = (spelled if place == kind else kind for kind in ("joint", "link", "rig"))
    text = (
        f'<robot name="x"><link name="base"/>{BODY.format(link, 1)}<joint name="{joint}" type="continuous">'
        f'<parent link="base"/><child link="{link}"/></joint></robot>'
    )
    path = tmp_path / f"{stem}.urdf"
    path.write_text(text, encoding="utf-8")
    payload = tmp_path / f"{name}.urdf"
    if place == "payload":
        payload.write_text(f'<robot name="x">{BODY.format("camera", 1)}</robot>', encoding="utf-8")
        (tmp_path / "rig.yaml").write_text("mount: link\n", encoding="utf-8")
    with pytest.raises(RigError, match="64 printable"):
        Rig.load(path, payload if place == "payload" else None)
