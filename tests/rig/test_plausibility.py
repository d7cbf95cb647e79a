"""Values in another unit are noted when a rig is loaded, travel of zero and bodies without mass are none that count."""

from __future__ import annotations

import re
from math import inf
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from gimbal_pin.rig import Rig
from gimbal_pin.rig import bundled as data_folder
from tests.command_line import Run, result
from tests.rigs import COMBINATIONS, bundled, chain

SLIPS = {
    "grams": ("mass", ("value",), 1e3, "link"),
    "kg mm²": ("inertia", ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1e6, "link"),
    "mm": ("origin", ("xyz",), 1e3, "joint"),
    "degrees": ("limit", ("lower", "upper"), 57.3, "joint"),
    "N mm": ("limit", ("effort",), 1e3, "joint"),
}
"""Unit → the tag and the attributes that are in it, by what they are too large, and of what they are."""


@pytest.mark.parametrize("is_everywhere", [False, True])
@pytest.mark.parametrize("slip", SLIPS)
def test_a_value_in_another_unit_is_noted_where_it_stands(
    tmp_path: Path, slip: str, is_everywhere: bool
) -> None:
    """Of the last link or joint alone, and of all: then the motors, materials and the size of gimbals show it."""
    tag, attributes, factor, owner = SLIPS[slip]
    robot = etree.fromstring((data_folder() / "turret.urdf").read_bytes())
    place = getattr(bundled("turret", "none"), f"{owner}s")[-1]
    which = "" if is_everywhere else f"[@name='{place}']"
    for element in robot.findall(f"{owner}{which}//{tag}"):
        for attribute in attributes:
            values = [factor * float(x) for x in element.get(attribute).split()]
            element.set(attribute, " ".join(map(str, values)))
    path = tmp_path / "rig.urdf"
    path.write_bytes(etree.tostring(robot))
    assert any(place in note for note in Rig.load(path, "none").notes)


def test_nothing_is_noted_of_the_bundled_rigs_and_of_chains() -> None:
    rigs = [bundled(name, payload) for name, payload in COMBINATIONS] + [chain(1), chain(7)]
    assert [rig.notes for rig in rigs] == [()] * len(rigs)


def test_check_tells_every_note_and_what_no_motor_holds(tmp_path: Path, run: Run) -> None:
    """Of a rig whose bodies all weigh a thousand times as much."""
    text = (data_folder() / "turret.urdf").read_text()
    path = tmp_path / "rig.urdf"
    path.write_text(re.sub(r'mass value="([^"]*)"', r'mass value="\1e3"', text))
    *said, last = result(run, "check", path, "--payload", "none")["warnings"]
    assert tuple(said) == Rig.load(path, "none").notes != ()
    assert last.startswith("tilt: ")


def test_a_travel_of_zero_is_not_stated_and_the_yaml_may_state_it(tmp_path: Path) -> None:
    text = (data_folder() / "turret.urdf").read_text()
    path = tmp_path / "rig.urdf"
    path.write_text(re.sub('lower="[^"]*" upper="[^"]*"', 'lower="0.0" upper="-0"', text))
    rig = Rig.load(path, "none")
    assert [(limit.lower, limit.upper) for limit in rig.limits] == [(-inf, inf)] * 2
    assert sum("pan, tilt" in note for note in rig.notes) == 1
    travel = "{lower: -1, upper: 1}"
    (tmp_path / "rig.yaml").write_text(f"limits: {{pan: {travel}, tilt: {travel}}}")
    assert not Rig.load(path, "none").notes


@pytest.mark.parametrize(
    "inertial",
    [
        '<mass value="0"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>',
        '<mass value="0"/><inertia ixx="1" iyy="0" izz="0" ixy="2" ixz="0" iyz="0"/>',
        '<mass value="0"/>',
        '<origin xyz="0 0 1"/>',
    ],
)
def test_a_fixed_frame_without_mass_changes_nothing_and_is_noted(
    tmp_path: Path, run: Run, inertial: str
) -> None:
    """On the base, on the last link, and below the root of a payload; mended, nothing is noted."""
    frame = (
        f'<link name="{{0}}"><inertial>{inertial}</inertial></link>'
        '<joint name="{0}_at" type="fixed"><parent link="{1}"/><child link="{0}"/></joint>'
    )
    plain = bundled("turret", "cinema")
    frames = frame.format("tool", plain.links[-1]) + frame.format("ground", plain.base)
    ends = {"turret": frames, "payloads/cinema": frame.format("plate", plain.payload_link)}
    rig, payload = (tmp_path / f"{Path(name).name}.urdf" for name in ends)
    for path, (name, added) in zip((rig, payload), ends.items()):
        text = (data_folder() / f"{name}.urdf").read_text()
        path.write_text(text.replace("</robot>", f"{added}</robot>"))
    loaded = Rig.load(rig, payload)
    np.testing.assert_array_equal(loaded.phi, plain.phi)
    assert any("plate" in note for note in loaded.notes)
    mended = tmp_path / "mended.urdf"
    assert run("check", rig, "--payload", payload, "--mend", mended)[0] == 0
    again = Rig.load(mended)
    assert again.notes == ()
    np.testing.assert_allclose(again.phi, plain.phi)
