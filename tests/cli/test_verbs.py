"""Every verb does its work on real files, through the parser, and prints what the library found."""

from __future__ import annotations

import re
import shutil
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import Plant, State, compute_regressor, compute_rnea, nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.identification import read_model
from gimbal_pin.log import read_log, write_log, write_motion
from gimbal_pin.rig import GRAVITY, Rig
from gimbal_pin.rig import bundled as data_folder
from tests.bench_logs import fourier, prescribed
from tests.command_line import Run, refused, result, whole
from tests.rigs import bundled, spelled, states

CINEMA = ("turret", "--payload", "cinema")
FEW = ("--plants", "2")
"""A judgement that takes no time."""


def test_base_is_the_thesis_table(run: Run) -> None:
    found = result(run, "base", "thesis", "--diagonal")
    assert (found["parameters"], found["identifiable"]) == (24, 15)
    zero = {"spine.Ixx", "spine.Izz", "spine.mx", "spine.my", "spine.mz", "fork.my"}
    assert set(found["unidentifiable"]) == zero
    terms = {"spine.Iyy": 1.0, "fork.Izz": 1.0}
    assert {"name": "spine.Iyy + fork.Izz", "terms": terms} in found["base"]


def test_cutoff_and_alignment_count_together(run: Run, tmp_path: Path) -> None:
    """What is left of a log in order is small, and told in mN m."""
    rig = bundled("turret")
    path = tmp_path / "log.csv"
    write_log(prescribed(nominal(rig), seconds=6.0, torque_noise=0.01, dt=4e-3), path)
    call = ("identify", "turret", path, "--cutoff", 5, "--alignment")
    found, late = (result(run, *call, delay) for delay in (0.0, 0.05))
    errors = [fit["train"]["torque_rmse"]["pan"] for fit in (found, late)]
    assert errors[1] > 2 * errors[0]
    code, out, _ = run(*call, 0.0)
    assert code == 0
    (row,) = re.findall(r"mN m rms.*\n(?:.*\n)*?pan +([\d.]+)", out)
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
    for k, late in enumerate(((), ("--delay-samples", 4), ("--delay-samples", 1))):
        path = tmp_path / f"{k}.csv"
        code, out, err = run(*call, "--reference", tmp_path / "motion.csv", "-o", path, *late)
        assert code == 0, err
        logs.append(read_log(path, rig))
        assert logs[k].v is None
        assert logs[k].q_ref is not None
        rms = np.degrees(np.sqrt(np.mean((logs[k].q_ref - logs[k].q) ** 2, axis=0)))
        told = re.findall(r"([\d.]+)°", out.splitlines()[-1])
        np.testing.assert_allclose([float(x) for x in told], rms, rtol=1e-2)
    assert logs[0].dt == pytest.approx(1e-3)
    shared = np.isin(np.round(1e6 * motion.t), np.round(1e6 * logs[0].t))
    own = np.isin(np.round(1e6 * logs[0].t), np.round(1e6 * motion.t))
    np.testing.assert_allclose(logs[0].q_ref[own], motion.q[shared], atol=1e-9)  # type: ignore[index]
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
    tracked = result(run, "track", *CINEMA, law, *FEW)
    assert tracked["judged"] == tuned["judged"]
    ratios = tracked["judged"]["ratios"]["computed-torque"]
    assert all(1 < ratios["worst"][place] <= ratios["median"][place] for place in ("pan", "tilt"))


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
    found = result(run, "track", *CINEMA, *options)
    rows = {row["controller"]: row for row in found["pointing"]}
    assert list(rows) == ["pid", "computed-torque"]
    for row in rows.values():
        assert 0 < row["jitter_rms_deg"] < row["jitter_max_deg"]
    assert rows["computed-torque"]["jitter_rms_deg"] < 0.5 * rows["pid"]["jitter_rms_deg"]


def test_auto_walks_from_a_log_to_a_report(
    run: Run, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its diagnosis looks for two causes; of the bodies all its parts state what `identify` does."""
    few = {name: CAUSES[name] for name in ("cogging", "stribeck")}
    monkeypatch.setattr("gimbal_pin.report.pipeline.diagnose", partial(diagnose, causes=few))
    out = tmp_path / "out"
    call = (*CINEMA, made / "log.csv", "--mass", "2.197")
    found = result(run, "auto", *call, "--kind", "pid", "--damping", "0.9", "-o", out, *FEW)
    alone = result(run, "identify", *call)
    for key in ("given_model", "balance"):
        assert found["identify"][key] == found["diagnose"][key] == alone[key]
    assert (found["tune"]["controller"], found["tune"]["wish"]["damping"]) == ("pid", 0.9)
    whole(out)


@pytest.mark.parametrize("verb", ["identify", "auto"])
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [("tau_tilt", "other", "tau_tilt"), (r"\n(0\.04,)[^,]+", r"\n\1abc", "abc")],
)
def test_a_bad_log_leaves_nothing_behind(
    verb: str, old: str, new: str, said: str, run: Run, made: Path, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(re.sub(old, new, (made / "log.csv").read_text()))
    out = tmp_path / ("m.yaml" if verb == "identify" else "out")
    refused(run(verb, "turret", path, "-o", out), 2, "log.csv", said)
    assert list(tmp_path.iterdir()) == [path]


def test_data_that_cannot_answer_leave_with_another_code(
    run: Run, made: Path, tmp_path: Path
) -> None:
    """Ten samples, and a rig that stood still: code 3 and some parameters that do not show."""
    rig = bundled("turret", "cinema")
    log = read_log(made / "log.csv", rig)
    still = type(log)("still", rig.joints, log.t, 0 * log.q, None, 0 * log.q + 1)
    for one in (log.part(slice(0, 10)), still):
        write_log(one, tmp_path / "x.csv")
        refused(run("identify", *CINEMA, tmp_path / "x.csv"), 3, "head_mount.Iyy", "more;")


# --- A rotor's inertia that a rig states --------------------------------------------------------

MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="fork">
<inertial pos="0.01 0 0.05" mass="0.6" diaginertia="0.004 0.003 0.002"/>
<joint name="pan" axis="0 0 1" armature="0.006" range="-2 2"/>
<body name="head" pos="0 0 0.1">
<inertial pos="0.02 0 0.01" mass="0.4" diaginertia="0.001 0.002 0.0015"/>
<joint name="tilt" axis="0 1 0" armature="0.003" range="-1 1"/>
</body></body></worldbody><actuator><motor joint="pan" ctrlrange="-2 2"/>
<motor joint="tilt" ctrlrange="-2 2"/></actuator></mujoco>"""
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
    few = {"armature": CAUSES["armature"]}
    monkeypatch.setattr("gimbal_pin.report.pipeline.diagnose", partial(diagnose, causes=few))
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
    turned = ("--map", "tau_pan=-tau_pan")
    refused(run("identify", "rig.yaml", "log.csv", *turned), 2, "tau_pan has the wrong sign")
    told = result(run, "diagnose", "rig.yaml", "log.csv")
    assert (told["verdict"], told["findings"]) == ("nothing", [])


def test_a_stated_rotor_is_inertia_of_its_joint_alone() -> None:
    """``tau = Y phi + I_a a``, as MuJoCo has it; the plant moves as the inverse dynamics ask."""
    rig = spelled(MJCF)
    q, v, a = states(rig.n, 3, 5)
    tau = compute_rnea(rig, q, v, a)
    expected = compute_regressor(rig, q, v, a) @ rig.phi + a * [0.006, 0.003]
    np.testing.assert_allclose(tau, expected, atol=1e-12)
    peer = mujoco.MjModel.from_xml_string(MJCF)
    peer.opt.gravity[2] = -GRAVITY
    peer.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(peer)
    model = nominal(rig)
    for k, torque in enumerate(model.inverse(q, v, a)):
        data.qpos[:] = q[k]
        data.qvel[:] = v[k]
        data.qacc[:] = a[k]
        mujoco.mj_inverse(peer, data)
        np.testing.assert_allclose(data.qfrc_inverse, tau[k], atol=1e-9)
        moved = Plant(model).acceleration(0.0, State(q[k], v[k]), torque)
        np.testing.assert_allclose(moved, a[k], atol=1e-9)


@pytest.mark.parametrize("motor", ["{rotor_inertia: 1}", "{rotor_inertia: 1e-4, gear_ratio: 100}"])
def test_a_rotor_larger_than_all_inertia_is_refused_by_its_name(
    motor: str, run: Run, made: Path, tmp_path: Path
) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(f"urdf: turret\nmotors:\n  pan: {motor}\n")
    refused(run("identify", path, made / "log.csv"), 2, "pan", "rotor_inertia")
