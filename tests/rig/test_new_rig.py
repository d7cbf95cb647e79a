"""`new-rig`: the YAML that it writes is the rig that it was given, and every entry in its comments is one."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from gimbal_pin.rig import Rig
from tests.command_line import Run, refused
from tests.rig.test_rig_formats import RIG, SENSORS, TRANSMISSIONS, torques

OPTICAL = RIG.format(
    '<link name="imu_link"/><link name="cam_optical_frame"/><link name="tool plate"/>'
    + "".join(
        f'<joint name="at {link}" type="fixed"><parent link="arm"/><child link="{link}"/></joint>'
        for link in ("imu_link", "cam_optical_frame", "tool plate")
    )
)
FILES = {"sdf": SENSORS, "gears": RIG.format(TRANSMISSIONS["Drake"]), "optical": OPTICAL}


def write(folder: Path, name: str) -> Path | str:
    """Return the path of one of the files, or a bundled rig's name."""
    if name not in FILES:
        return name
    path = folder / f"{name}.xml"
    path.write_text(FILES[name], encoding="utf-8")
    return path


def uncommented(text: str) -> str:
    """Every example as an entry: # before a key without a blank, or behind the braces that it fills."""
    text = re.sub(r"^#(?=\w+:)", "", text, flags=re.M)
    text = re.sub(r"\{\}  # (.*)$", r"{\1}", text, flags=re.M)
    return text.replace("payload: mirrorless\n", "")  # whose root link may be there already


@pytest.mark.parametrize("name", ["thesis", *FILES])
def test_what_it_writes_is_the_rig_and_what_it_suggests_is_understood(
    tmp_path: Path, run: Run, name: str
) -> None:
    source = write(tmp_path, name)
    path = tmp_path / "mine.yaml"
    rig = Rig.load(source)
    code, out, err = run("new-rig", source, "-o", path)
    assert code == 0 and "mine.yaml" in out, err
    again = Rig.load(path)
    np.testing.assert_array_equal(torques(again), torques(rig))
    assert (again.motors, again.limits, again.payload) == (rig.motors, rig.limits, rig.payload)
    path.write_text(uncommented(path.read_text(encoding="utf-8")), encoding="utf-8")
    full = Rig.load(path)
    assert full.config.inertia == "trusted" and full.config.noise.gyro > 0 and full.config.mount
    assert all(np.isfinite(limit.acceleration) for limit in full.limits)


def test_it_guesses_by_names_and_tags(tmp_path: Path, run: Run) -> None:
    sdf, gears, optical = (
        yaml.safe_load(run("new-rig", write(tmp_path, name))[1]) for name in FILES
    )
    assert (sdf["camera_frame"], sdf["optical_axis"], sdf["imus"]) == ("eye", "x", ["gyro"])
    assert gears["motors"]["tilt"] == {"gear_ratio": 50.0, "rotor_inertia": "2e-05"}
    assert (optical["camera_frame"], optical["optical_axis"]) == ("cam_optical_frame", "z")
    assert (optical["mount"], optical["imus"]) == ("tool plate", ["imu_link"])


def test_it_writes_the_yaml_beside_a_urdf_and_over_no_file_of_the_rig(
    tmp_path: Path, run: Run
) -> None:
    path = tmp_path / "own.urdf"
    path.write_text(RIG.format(""), encoding="utf-8")
    beside = tmp_path / "own.yaml"
    assert run("new-rig", path, "-o", beside)[0] == 0
    assert Rig.load(path).config.motors == Rig.load(beside).config.motors
    for taken in (beside, path):
        refused(run("new-rig", path, "-o", taken), 2, "write over")
