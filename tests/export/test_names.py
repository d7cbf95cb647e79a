"""Names of joints, links and rigs are data in every file that is written, whatever characters they have."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest
import yaml
from lxml import etree

from gimbal_pin.control import tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import RigError
from gimbal_pin.rig import Rig
from tests.command_line import Run, result
from tests.exported import has
from tests.rigs import BODY, bundled

NAMES = (
    "**// static int evil(void){return 1;}} /** ??/",
    "evil(); // \\",
    "\"); evil(\"</script><evil a='1'>&lt;-->",
    "evil: [1, 'x'] # {{ evil }} $evil^$",
    "evil---,;é",
)
"""Names that close comments, strings, tags and scalars of C, C++, XML, HTML, YAML, Markdown, Jinja and CSV."""


def load_renamed(folder: Path) -> Rig:
    """Return the turret with these names of pan, tilt, base, yoke and camera, and one of its own."""
    text = bundled("turret").urdf
    for plain, name in zip(("pan", "tilt", "base", "yoke", "camera"), NAMES):
        text = text.replace(f'"{plain}"', quoteattr(name))
    stem = "evil() 'rig' --<evil>`#"
    (folder / f"{stem}.urdf").write_text(text, encoding="utf-8")
    config = {"urdf": f"{stem}.urdf", "camera_frame": NAMES[4], "imus": [NAMES[2], NAMES[4]]}
    (folder / f"{stem}.yaml").write_text(yaml.safe_dump(config, allow_unicode=True), "utf-8")
    return Rig.load(folder / f"{stem}.yaml")


def list_code(path: Path) -> str:
    """Return a file of C or C++ without comments and string literals."""
    c = path.suffix in (".c", ".h")
    language = ("-x", "c", "-std=c99") if c else ("-x", "c++", "-std=c++17")
    command = ["gcc", *language, "-trigraphs", "-fpreprocessed", "-dD", "-E", "-P", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return re.sub(r'"(?:\\.|[^"\\])*"', '""', done.stdout)


@pytest.mark.skipif(not has("gcc"), reason="no C compiler")
def test_no_part_of_a_name_is_code_in_what_export_writes(run: Run, tmp_path: Path) -> None:
    """C99, SimpleFOC, ros2_control, ODrive and MuJoCo: sources compile without it, data hold exactly it."""
    pytest.importorskip("casadi")
    tune(nominal(load_renamed(tmp_path))).save(tmp_path / "c.yaml")
    kinds = {"c": "c", "ros2": "ros2", "simplefoc": "foc", "odrive": "o.json", "mjcf": "m.xml"}
    options = [part for kind, name in kinds.items() for part in (f"--{kind}", tmp_path / name)]
    result(run, "export", tmp_path / "c.yaml", *options)
    for path in tmp_path.glob("*/*"):
        if path.suffix in (".c", ".h", ".ino", ".cpp", ".hpp"):
            assert "evil" not in list_code(path).replace("gimbal_evil_rig_evil", "")
        elif path.suffix in (".xml", ".urdf"):
            assert not etree.parse(path).findall(".//evil")
    assert not re.search(r"(?<!\\)[<`]evil", (tmp_path / "c" / "README.md").read_text("utf-8"))
    sources = [str(path) for path in (*tmp_path.glob("c/*.c"), *tmp_path.glob("foc/*.h"))]
    check = ["gcc", "-std=c99", "-Wall", "-Werror", "-fsyntax-only", *sources]
    subprocess.run(check, cwd=tmp_path / "c", capture_output=True, check=True)
    given = yaml.safe_load((tmp_path / "ros2" / "controllers.yaml").read_text("utf-8"))
    parameters = given["gimbal_controller"]["ros__parameters"]
    assert parameters["base_imu"] == f"{NAMES[2]}_imu"
    assert parameters["camera_imu"] == f"{NAMES[4]}_imu"
    axes = json.loads((tmp_path / "o.json").read_text("utf-8"))["axes"]
    assert list(axes) == list(NAMES[:2])
    for file, place in (("ros2/gimbal.urdf", "ros2_control/joint"), ("m.xml", ".//body/joint")):
        joints = etree.parse(tmp_path / file).findall(place)
        assert [joint.get("name") for joint in joints] == list(NAMES[:2])


@pytest.mark.parametrize("name", ["a&#10;b", "a&#9;b", "a\x9bb", "a\u202eb", " a", "a" * 65])
def test_a_name_of_other_characters_is_refused(name: str, tmp_path: Path) -> None:
    """Line ends, control characters, marks of direction, spaces at an end, and more than 64 characters."""
    path = tmp_path / "x.urdf"
    for joint, link in ((name, "link"), ("joint", name)):
        path.write_text(
            f'<robot name="x"><link name="base"/>{BODY.format(link, 1)}'
            f'<joint name="{joint}" type="continuous">'
            f'<parent link="base"/><child link="{link}"/></joint></robot>'
        )
        with pytest.raises(RigError, match="64 printable"):
            Rig.load(path)
