"""Models and controllers serve the rig that they were made for, from any folder.

A rig is compared by its joints, not by a file's path.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from gimbal_pin.rig import bundled as data_folder
from tests.command_line import Run, refused

TEXT = (data_folder() / "turret.urdf").read_text()


def list_calls(rig: object, made: Path, out: Path) -> list[list[str]]:
    """Return calls of every verb that takes a model or a controller beside a rig."""
    model = made / "model.yaml"
    controller = made / "controller.yaml"
    calls = (
        f"tune {rig} {model} -o {out}/again.yaml --plants 1",
        f"simulate {rig} -o {out}/log.csv --seconds 1 --model {model}",
        f"simulate {rig} -o {out}/log.csv --seconds 1 --controller {controller}",
        f"track {rig} {controller} --plants 1",
        f"export {controller} --rig {rig} --odrive {out}/drive.json",
    )
    return [[*call.split(), "--payload", "cinema"] for call in calls]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<origin xyz="0 0 0.3" ', '<origin xyz="0 0 0.35" '),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>'),
        ('xyz="0 0 0.12" rpy="0 0 0"', 'xyz="0 0 0.12" rpy="0 0 0.1"'),
    ],
)
def test_a_file_of_another_rig_with_the_same_joints_is_refused_by_name(
    old: str, new: str, made: Path, tmp_path: Path, run: Run
) -> None:
    """Of a higher axis, a turned one, a turned frame; by every verb."""
    path = tmp_path / "lookalike.urdf"
    path.write_text(TEXT.replace(old, new, 1))
    for call in list_calls(path, made, tmp_path):
        refused(run(*call), 2, "turret", "lookalike")


def test_a_file_serves_its_rig_in_another_place_and_with_other_masses(
    made: Path, tmp_path: Path, run: Run
) -> None:
    """A copy of the URDF under another name, with weighed masses and rounded origins."""
    path = tmp_path / "copy.urdf"
    weighed = TEXT.replace('mass value="', 'mass value="1')
    path.write_text(weighed.replace('xyz="0 0 0.3"', 'xyz="0.0001 0 0.3"'))
    for call in list_calls(path, made, tmp_path):
        code, _, err = run(*call)
        assert code == 0, (call, err)


def test_a_controller_of_another_payload_is_simulated_with_a_note_and_not_exported(
    made: Path, tmp_path: Path, run: Run
) -> None:
    """To see what a swapped camera does to old gains is an ordinary experiment."""
    law = made / "controller.yaml"
    camera = ("--payload", "mirrorless")
    call = ("simulate", "turret", "-o", tmp_path / "log.csv", "--seconds", 1)
    code, _, err = run(*call, "--controller", law, *camera)
    assert code == 0
    assert "cinema" in err
    call = ("export", law, "--odrive", tmp_path / "drive.json")
    refused(run(*call, *camera), 2, "cinema", "mirrorless")


def test_a_rig_with_a_payload_of_its_own_is_used_from_any_folder(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its YAML names the payload's file by its place beside it, a log is named from the folder."""
    rig = tmp_path / "made" / "rig.yaml"
    other = tmp_path / "other"
    rig.parent.mkdir()
    other.mkdir()
    shutil.copy(data_folder() / "payloads" / "infrared.urdf", tmp_path / "cam.urdf")
    rig.write_text(
        "urdf: turret\npayload: ../cam.urdf\nimus: [base, camera]\n"
        "noise: {gyro: 1.0e-5, accelerometer: 1.0e-3}\n"
    )
    monkeypatch.chdir(other)
    for call in (
        "simulate {} --platform S --imus --seconds 8 -o shaken.csv",
        "tune {} shaken.csv -o c.yaml --plants 1",
        "track {} c.yaml --platform-log shaken.csv --learn shaken.csv --plants 1 --seeds 1 "
        "--seconds 1",
    ):
        code, _, err = run(*call.format(rig).split())
        assert code == 0, err
