"""Values in another unit are noted when a rig is loaded, and travel of zero is none that anybody stated."""

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
    "g cm²": ("inertia", ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1e7, "link"),
    "mm": ("origin", ("xyz",), 1e3, "joint"),
    "degrees": ("limit", ("lower", "upper"), 57.3, "joint"),
    "N mm": ("limit", ("effort",), 1e3, "joint"),
}
"""Unit → the tag and the attributes that are in it, by what they are too large, and of what they are."""


def scale(folder: Path, rig: str, slip: str, is_everywhere: bool = False) -> tuple[Path, str]:
    """Write a bundled rig with the values of one or of every link or joint in another unit; return file and name."""
    tag, attributes, factor, owner = SLIPS[slip]
    loaded = bundled(rig, "cinema")
    robot = etree.fromstring((data_folder() / f"{rig}.urdf").read_bytes())
    farthest = max(
        range(loaded.n),
        key=lambda j: float(np.linalg.norm(loaded.model.jointPlacements[j + 1].translation)),
    )
    place = (loaded.links if owner == "link" else loaded.joints)[farthest]
    which = "" if is_everywhere else "[@name=$name]"
    for element in robot.xpath(f"{owner}{which}//{tag}", name=place):
        for attribute in attributes:
            values = [factor * float(x) for x in element.get(attribute).split()]
            element.set(attribute, " ".join(map(repr, values)))
    path = folder / "rig.urdf"
    path.write_bytes(etree.tostring(robot))
    return path, place


@pytest.mark.parametrize("rig", ["turret", "thesis"])
@pytest.mark.parametrize("slip", SLIPS)
def test_a_value_in_another_unit_is_noted_where_it_stands(
    slip: str, rig: str, tmp_path: Path, run: Run
) -> None:
    """`check` names the place, and so does every load."""
    path, place = scale(tmp_path, rig, slip)
    said = result(run, "check", path, "--payload", "none")["warnings"]
    assert any(place in note for note in said), said
    assert set(Rig.load(path, "none").notes) <= set(said)


@pytest.mark.parametrize("rig", ["turret", "thesis", "drone"])
@pytest.mark.parametrize("slip", ["grams", "kg mm²", "g cm²", "mm"])
def test_a_unit_that_all_values_share_is_noted(slip: str, rig: str, tmp_path: Path) -> None:
    """Then no other link or joint shows it: the motors, the densest material and the size of gimbals do."""
    path, place = scale(tmp_path, rig, slip, is_everywhere=True)
    assert any(place in note for note in Rig.load(path, "none").notes)


@pytest.mark.parametrize(("name", "payload"), COMBINATIONS)
def test_nothing_is_noted_of_the_bundled_rigs(name: str, payload: str) -> None:
    """Their notes are empty, whatever they carry."""
    assert bundled(name, payload).notes == ()


def test_nothing_is_noted_of_long_chains() -> None:
    """Nor of arms of any number of joints."""
    assert all(chain(n).notes == () for n in (1, 2, 4, 7))


@pytest.mark.parametrize("ends", [("0", "0"), ("0.0", "-0"), ("0.5", "0.5")])
def test_a_travel_of_zero_is_not_stated(ends: tuple[str, str], tmp_path: Path, run: Run) -> None:
    """Motions are designed as for a joint without stops, and the YAML may state the travel."""
    text = (data_folder() / "turret.urdf").read_text()
    path = tmp_path / "rig.urdf"
    path.write_text(
        re.sub(r'lower="[^"]*" upper="[^"]*"', f'lower="{ends[0]}" upper="{ends[1]}"', text)
    )
    rig = Rig.load(path, "none")
    assert [(limit.lower, limit.upper) for limit in rig.limits] == [(-inf, inf)] * 2
    assert sum("pan, tilt" in note for note in rig.notes) == 1
    code, _, err = run(
        "excite", path, "--payload", "none", "-o", tmp_path / "x.csv", "--starts", 1, "--seconds", 4
    )
    assert code == 0 and "pan, tilt" in err
    (tmp_path / "rig.yaml").write_text(
        "limits: {pan: {lower: -1, upper: 1}, tilt: {lower: -1, upper: 1}}\n"
    )
    assert not Rig.load(path, "none").notes


INERTIALS = {
    "no inertia": '<mass value="0"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>',
    "a token inertia": '<mass value="0"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>',
    "an inertia of no body": '<mass value="0"/><inertia ixx="1" iyy="0" izz="0" ixy="2" ixz="0" iyz="0"/>',
    "a mass alone": '<mass value="0"/>',
    "a place alone": '<origin xyz="0 0 1"/>',
}


def write_frames(folder: Path, inertial: str) -> tuple[Path, Path]:
    """Write a bundled rig and payload with fixed frames of an inertial: on base, last link, and below the payload."""
    frame = '<link name="{0}"><inertial>' + inertial + "</inertial></link>"
    joint = '<joint name="{0}_at" type="fixed"><parent link="{1}"/><child link="{0}"/></joint>'
    plain = bundled("turret", "cinema")
    places = {"tool": plain.links[-1], "ground": plain.base}
    added = "".join(
        frame.format(name) + joint.format(name, place) for name, place in places.items()
    )
    path = folder / "rig.urdf"
    payload = folder / "cinema.urdf"
    path.write_text(
        (data_folder() / "turret.urdf").read_text().replace("</robot>", f"{added}</robot>")
    )
    added = frame.format("plate") + joint.format(plain.payload_link, "plate")
    text = (data_folder() / "payloads" / "cinema.urdf").read_text()
    payload.write_text(text.replace("</robot>", f"{added}</robot>"))
    return path, payload


@pytest.mark.parametrize("inertial", INERTIALS.values(), ids=INERTIALS)
def test_a_fixed_frame_without_mass_changes_nothing(
    inertial: str, tmp_path: Path, run: Run
) -> None:
    """On the base, on a link, and as the root of a payload; --mend writes a file without it, and a note names it."""
    path, payload = write_frames(tmp_path, inertial)
    rig = Rig.load(path, payload)
    plain = bundled("turret", "cinema")
    assert np.array_equal(rig.phi, plain.phi) and any("plate" in note for note in rig.notes)
    code, _, err = run("check", path, "--payload", payload, "--mend", tmp_path / "mended.urdf")
    assert code == 0, err
    assert np.allclose(Rig.load(tmp_path / "mended.urdf").phi, plain.phi)


def test_every_verb_loads_a_fixed_frame_without_mass(tmp_path: Path, run: Run) -> None:
    """From the check to the controller."""
    path, payload = write_frames(tmp_path, INERTIALS["a token inertia"])
    log, model, controller = (
        tmp_path / name for name in ("log.csv", "model.yaml", "controller.yaml")
    )
    for call in (
        ("base", path),
        ("new-rig", path, "-o", tmp_path / "new.yaml"),
        ("simulate", path, "-o", log, "--seconds", 10, "--payload", payload),
        (
            "identify",
            path,
            log,
            "-o",
            model,
            "--urdf",
            tmp_path / "found.urdf",
            "--payload",
            payload,
        ),
        ("tune", path, model, "-o", controller, "--plants", 1, "--payload", payload),
        ("export", controller, "--mjcf", tmp_path / "m.xml", "--payload", payload),
    ):
        code, _, err = run(*call)
        assert code == 0, (call, err)
