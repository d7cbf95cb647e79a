"""Models and controllers serve the rig that they were made for: it is compared by its joints, not by a file's path."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from gimbal_pin.control import tune
from gimbal_pin.control.experiment import bench_run
from gimbal_pin.dynamics import nominal
from gimbal_pin.identification import identify
from gimbal_pin.rig import bundled as data_folder
from tests.command_line import Run, refused
from tests.rigs import bundled

TEXT = (data_folder() / "turret.urdf").read_text()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model and a controller of the turret with the cinema camera."""
    folder = tmp_path_factory.mktemp("made")
    rig = bundled("turret", "cinema")
    identify(rig, [bench_run(nominal(rig), rng=0, seconds=12)]).save(folder / "model.yaml")
    tune(nominal(rig)).save(folder / "controller.yaml")
    return folder


def list_calls(rig: object, made: Path, out: Path) -> list[tuple[object, ...]]:
    """Return calls of every verb that takes a model or a controller beside a rig."""
    model = made / "model.yaml"
    controller = made / "controller.yaml"
    short = ("--seconds", 1)
    camera = ("--payload", "cinema")
    return [
        ("tune", rig, model, "-o", out / "again.yaml", "--plants", 1, *camera),
        ("simulate", rig, "-o", out / "log.csv", "--model", model, *short, *camera),
        ("simulate", rig, "-o", out / "log.csv", "--controller", controller, *short, *camera),
        ("track", rig, controller, "--plants", 1, *camera),
        ("export", controller, "--rig", rig, "--odrive", out / "drive.json", *camera),
    ]


OTHERS = {
    "a higher axis": ('<origin xyz="0 0 0.3" ', '<origin xyz="0 0 0.35" '),
    "a turned axis": ('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>'),
    "a turned frame": (
        '<origin xyz="0 0 0.12" rpy="0 0 0"/>',
        '<origin xyz="0 0 0.12" rpy="0 0 0.1"/>',
    ),
}


@pytest.mark.parametrize("other", OTHERS)
def test_a_file_of_another_rig_with_the_same_joints_is_refused_by_name(
    other: str, made: Path, tmp_path: Path, run: Run
) -> None:
    """By every verb, in one line that names both rigs."""
    path = tmp_path / "lookalike.urdf"
    path.write_text(TEXT.replace(*OTHERS[other], 1))
    assert path.read_text() != TEXT
    for call in list_calls(path, made, tmp_path):
        refused(run(*call), 2, "turret", "lookalike")


def test_a_file_serves_its_rig_in_another_place_and_with_other_masses(
    made: Path, tmp_path: Path, run: Run
) -> None:
    """A copy of the URDF under another name, with the masses that somebody weighed and rounded origins."""
    path = tmp_path / "copy.urdf"
    path.write_text(
        TEXT.replace('mass value="', 'mass value="1').replace('xyz="0 0 0.3"', 'xyz="0.0001 0 0.3"')
    )
    for call in list_calls(path, made, tmp_path):
        code, _, err = run(*call)
        assert code == 0, (call, err)


@pytest.mark.parametrize("schema", [99, 0, "one"])
def test_another_schema_is_refused(schema: object, made: Path, tmp_path: Path, run: Run) -> None:
    """Of models and of controllers."""
    for name in ("model.yaml", "controller.yaml"):
        data = yaml.safe_load((made / name).read_text())
        (tmp_path / name).write_text(yaml.safe_dump({**data, "schema": schema}))
    for call in list_calls("turret", tmp_path, tmp_path):
        refused(run(*call), 2, "schema", str(schema))


def test_a_controller_of_another_payload_is_simulated_with_a_note_and_not_exported(
    made: Path, tmp_path: Path, run: Run
) -> None:
    """To see what a swapped camera does to old gains is an ordinary experiment."""
    code, _, err = run(
        *(
            "simulate",
            "turret",
            "-o",
            tmp_path / "log.csv",
            "--controller",
            made / "controller.yaml",
        ),
        *("--seconds", 1, "--payload", "mirrorless"),
    )
    assert code == 0 and "cinema" in err and "mirrorless" in err
    call = (
        "export",
        made / "controller.yaml",
        "--odrive",
        tmp_path / "drive.json",
        "--payload",
        "mirrorless",
    )
    refused(run(*call), 2, "cinema", "mirrorless")


def spoil_value(data: dict[str, Any]) -> None:
    """Move a base parameter by a tenth."""
    data["base_parameters"][0]["value"] *= 1.1


def spoil_bodies(data: dict[str, Any]) -> None:
    """Double the inertia of the last body."""
    data["phi"][-1] *= 2.0


def clear_covariance(data: dict[str, Any]) -> None:
    """Leave no uncertainty."""
    data["covariance"] = [[0.0] * len(row) for row in data["covariance"]]


def clear_variance(data: dict[str, Any]) -> None:
    """Leave no uncertainty of one parameter."""
    for row in data["covariance"]:
        row[1] = 0.0
    data["covariance"][1] = [0.0] * len(data["covariance"])


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (spoil_value, "base parameter"),
        (spoil_bodies, "base parameter"),
        (clear_covariance, "covariance"),
        (clear_variance, "covariance"),
    ],
)
def test_a_model_that_contradicts_itself_is_refused(
    spoil: Callable[[dict[str, Any]], None], word: str, made: Path, tmp_path: Path, run: Run
) -> None:
    """Its base parameters are sums of its bodies' parameters, and no estimate is exact."""
    data = yaml.safe_load((made / "model.yaml").read_text())
    spoil(data)
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(data))
    refused(run("tune", "turret", tmp_path / "model.yaml", "--payload", "cinema"), 2, word)
