"""Every verb does its work on real files, through the parser, and prints what the library found."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.identification import read_model
from gimbal_pin.log import read_log, write_log, write_motion
from gimbal_pin.rig import Rig
from gimbal_pin.rig import bundled as data_folder
from tests.bench_logs import fourier, prescribed
from tests.command_line import Run, refused, result, whole
from tests.rigs import bundled

CINEMA = ("turret", "--payload", "cinema")
FEW = ("--plants", "2")
"""A judgement that takes no time."""


def test_cutoff_and_alignment_count_together(run: Run, made: Path) -> None:
    """The residual of a sound log is small, and stated in mN m."""
    call = ("identify", *CINEMA, made / "log.csv", "--cutoff", 5, "--alignment")
    found, late = (result(run, *call, delay) for delay in (0.0, 0.05))
    assert late["train"]["torque_rmse"]["pan"] > 2 * found["train"]["torque_rmse"]["pan"]
    (row,) = re.findall(r"mN m rms.*\n(?:.*\n)*?pan +([\d.]+)", run(*call, 0.0)[1])
    assert float(row) == pytest.approx(1e3 * found["held_out"]["torque_rmse"]["pan"], rel=1e-2)


@pytest.mark.parametrize("step", [2e-3, 5e-4])
def test_a_simulated_log_is_as_late_as_its_controller_is_tuned_for(
    step: float, run: Run, made: Path, tmp_path: Path
) -> None:
    """A motion of another rate is interpolated; the error that is told is that of the log."""
    rig = bundled("turret", "cinema")
    motion = fourier(rig, 0, 1.0, step)
    write_motion(motion, rig.joints, tmp_path / "motion.csv")
    call = ("simulate", *CINEMA, "--controller", made / "controller.yaml", "--no-rates")
    logs = []
    for late in ((), ("--delay-samples", 4), ("--delay-samples", 1)):
        path = tmp_path / f"{len(logs)}.csv"
        code, out, err = run(*call, "--reference", tmp_path / "motion.csv", "-o", path, *late)
        assert code == 0, err
        log = read_log(path, rig)
        assert log.v is None
        assert log.q_ref is not None
        rms = np.degrees(np.sqrt(np.mean((log.q_ref - log.q) ** 2, axis=0)))
        told = re.findall(r"([\d.]+)°", out.splitlines()[-1])
        np.testing.assert_allclose(np.array(told, float), rms, rtol=1e-2)
        shared = np.isin(np.round(1e6 * motion.t), np.round(1e6 * log.t))
        own = np.isin(np.round(1e6 * log.t), np.round(1e6 * motion.t))
        np.testing.assert_allclose(log.q_ref[own], motion.q[shared], atol=1e-9)
        logs.append(log)
    assert logs[0].dt == pytest.approx(1e-3)
    np.testing.assert_array_equal(logs[0].q, logs[1].q)
    assert np.any(logs[0].q != logs[2].q)


def test_a_log_becomes_a_model_a_controller_and_a_judgement(
    run: Run, made: Path, tmp_path: Path
) -> None:
    model = tmp_path / "model.yaml"
    urdf = tmp_path / "model.urdf"
    call = ("identify", *CINEMA, "--alignment", "0", made / "log.csv")
    found = result(run, *call, "-o", model, "--urdf", urdf)
    for row in found["base_parameters"]:
        deviations = (row["value"] - row["urdf"]) / row["std"]
        assert row["deviations"] == pytest.approx(deviations)
        assert abs(deviations) < 5
    assert min(found["held_out"]["fit_percent"].values()) > 95
    assert Rig.load(urdf).joints == ("pan", "tilt")
    law = tmp_path / "c.yaml"
    tuned = result(run, "tune", *CINEMA, model, "-o", law, "--disk-margin", "0.9", *FEW)
    for row in tuned["joints"].values():
        assert 0.9 - 1e-6 <= row["worst_of_draws"]["disk_margin"] < 0.92
    assert result(run, "track", *CINEMA, law, *FEW)["judged"] == tuned["judged"]
    assert all(
        ratio > 1 for ratio in tuned["judged"]["ratios"]["computed-torque"]["worst"].values()
    )


def test_export_finds_the_rig_that_a_controller_was_tuned_for(
    run: Run, made: Path, tmp_path: Path
) -> None:
    """Beside the controller's file, wherever the two are moved together; or it has to be named."""
    first = tmp_path / "first"
    first.mkdir()
    shutil.copy(data_folder() / "turret.urdf", first / "mine.urdf")
    call = ("tune", first / "mine.urdf", made / "log.csv", "-o", first / "c.yaml", *FEW)
    assert run(*call)[0] == 0
    moved = first.rename(tmp_path / "moved")
    export = ("export", moved / "c.yaml", "--odrive", moved / "map.json")
    assert run(*export)[0] == 0
    (moved / "mine.urdf").unlink()
    refused(run(*export), 2, "--rig", "mine")


def test_track_on_a_platform_that_moves(run: Run, made: Path) -> None:
    options = ("--platform", "S", "--learn", made / "log.csv", "--seeds", "1", "--seconds", "0.8")
    found = result(run, "track", *CINEMA, *options)["pointing"]
    assert [row["controller"] for row in found] == ["pid", "computed-torque"]
    slow, fast = (row["jitter_rms_deg"] for row in found)
    assert 0 < fast < 0.5 * slow
    assert all(row["jitter_rms_deg"] < row["jitter_max_deg"] for row in found)


def test_auto_walks_from_a_log_to_a_report(run: Run, made: Path, tmp_path: Path) -> None:
    """Of the bodies all its parts state one thing, and `identify` alone the same within its deviation."""
    out = tmp_path / "out"
    call = (*CINEMA, made / "log.csv", "--mass", "2.197")
    found = result(run, "auto", *call, "--kind", "pid", "--damping", "0.9", "-o", out, *FEW)
    alone = result(run, "identify", *call)
    for key in ("given_model", "balance"):
        assert found["identify"][key] == found["diagnose"][key]
    slides = (x["balance"]["slide_mm"] for x in (found["identify"], alone))
    np.testing.assert_allclose(*slides, atol=2 * max(alone["balance"]["std_mm"]))
    assert (found["tune"]["controller"], found["tune"]["wish"]["damping"]) == ("pid", 0.9)
    whole(out)


def test_data_that_cannot_answer_leave_with_another_code(
    run: Run, made: Path, tmp_path: Path
) -> None:
    """Ten samples: code 3 and some parameters that do not show."""
    lines = (made / "log.csv").read_text().splitlines(keepends=True)
    (tmp_path / "x.csv").write_text("".join(lines[:11]))
    refused(run("identify", *CINEMA, tmp_path / "x.csv"), 3, "head_mount.Iyy", "more;")


def test_a_joint_at_rest_is_held_and_a_dead_encoder_is_a_fault(run: Run, tmp_path: Path) -> None:
    """A log without references: a still angle beside a moving rate is an encoder that is dead."""
    rig = bundled("turret")
    log = prescribed(nominal(rig), 1, 8.0, 2e-3, 2e-3)
    q = log.q.copy()
    q[:, 0] = 0.3
    still = log.v.copy()
    still[:, 0] = 0.0
    for name, rate in (("rest", still), ("dead", log.v)):
        write_log(replace(log, q=q, v=rate, q_ref=None), tmp_path / f"{name}.csv")
    assert set(result(run, "diagnose", "turret", tmp_path / "rest.csv")["residual"]) == {"tilt"}
    assert result(run, "diagnose", "turret", tmp_path / "dead.csv")["verdict"] == "data"


# --- A rotor's inertia that a rig states --------------------------------------------------------

GEAR = "urdf: turret\nmotors:\n  tilt: {rotor_inertia: 2.0e-5, gear_ratio: -30}\n"
CALLS = """check rig.yaml
base rig.yaml
inspect log.csv --rig rig.yaml
excite rig.yaml -o x.csv --starts 1 --seconds 6
simulate rig.yaml --seconds 2 -o s.csv
rehearse rig.yaml x.csv
identify rig.yaml log.csv -o m.yaml --urdf identified.urdf
tune rig.yaml m.yaml -o c.yaml --plants 1
track rig.yaml c.yaml --plants 1
export c.yaml --rig rig.yaml --c c --mjcf m.xml --ros2 ros
animate rig.yaml log.csv -o log.html
studio rig.yaml log.csv --check -o studio
auto rig.yaml log.csv -o all --plants 1
montecarlo rig.yaml m.yaml -o rigs --count 2 --seconds 1 --workers 1"""


def test_every_verb_takes_a_stated_rotor(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bodies are identified beside it, and it is in every file that states the rig."""
    monkeypatch.chdir(tmp_path)
    Path("rig.yaml").write_text(GEAR)
    rig = Rig.load("rig.yaml")
    write_log(prescribed(nominal(rig), 1, 8.0, 1e-3, 2e-3), "log.csv")
    for call in CALLS.splitlines():
        code, _, err = run(*call.split())
        assert code == 0, (call, err)
    armature = [0.0, 0.018]
    np.testing.assert_allclose(read_model("m.yaml", rig).rig.armature, armature)
    peer = mujoco.MjModel.from_xml_path("m.xml")
    found = [float(peer.joint(joint).armature[0]) for joint in rig.joints]
    np.testing.assert_allclose(found, armature)
    checked = result(run, "check", "rig.yaml")["joints"]
    assert [checked[joint]["armature"] for joint in rig.joints] == pytest.approx(armature)
    for row in result(run, "identify", "rig.yaml", "log.csv")["base_parameters"]:
        assert abs(row["value"] - row["urdf"]) < 4 * row["std"] + 1e-4 * abs(row["urdf"]) + 1e-6


def test_a_rotor_larger_than_all_inertia_is_refused_by_its_name(
    run: Run, made: Path, tmp_path: Path
) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text("urdf: turret\nmotors:\n  pan: {rotor_inertia: 1e-4, gear_ratio: 100}\n")
    refused(run("identify", path, made / "log.csv"), 2, "pan", "rotor_inertia")


# --- A diagnosis ----------------------------------------------------------------------------------


def test_a_diagnosis_is_the_same_in_its_folder_and_in_json(run: Run, tmp_path: Path) -> None:
    """Its bodies stand in a URDF and in a file for MuJoCo; each finding has a sentence."""
    rig = bundled("turret")
    log = prescribed(nominal(rig), seconds=12.0, torque_noise=0.01, dt=4e-3)
    spring = 0.3 * log.q * np.array([0.0, 1.0])
    write_log(replace(log, tau=log.tau + spring), tmp_path / "log.csv")
    files = ("--urdf", tmp_path / "fitted.urdf", "--mjcf", tmp_path / "fitted.xml")
    told = ("--json", tmp_path / "told.json")
    code, _, err = run(
        "diagnose", "turret", tmp_path / "log.csv", "-o", tmp_path / "out", *files, *told
    )
    assert code == 0, err
    found, stored = (
        json.loads((tmp_path / path).read_text()) for path in ("told.json", "out/diagnosis.json")
    )
    assert found == stored
    assert found["schema"] == 2
    assert found["verdict"] in ("named", "ambiguous")
    assert all(row["sentence"] for row in found["findings"])
    assert set(found["held_out"]) == {"how", "cutoff_hz", "urdf", "refitted", "extended"}
    fitted = Rig.load(tmp_path / "fitted.urdf")
    assert fitted.joints == rig.joints
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "fitted.xml")).njnt == rig.n
    again = run("diagnose", "turret", tmp_path / "log.csv", "--cutoff", 5, "--json", "-")[1]
    assert json.loads(again)["held_out"]["cutoff_hz"] == 5.0
