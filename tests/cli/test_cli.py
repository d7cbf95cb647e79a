"""The command line: verbs, JSON keys and exit codes, on real files, through the parser."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.cli import VERBS
from gimbal_pin.control import tune
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import CAUSES, parse_effect
from gimbal_pin.log import read_log, write_log
from gimbal_pin.rig import Rig, bundled, bundled_rigs
from tests.bench_logs import prescribed
from tests.command_line import Run, refused, result, whole

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def log_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "log.csv"
    write_log(prescribed(nominal(Rig.load("turret")), seconds=15.0, torque_noise=0.01), path)
    return path


def test_help_loads_no_heavy_library() -> None:
    """What `--help` takes stays under half a second as long as none of these is loaded at the top of a module."""
    code = "import sys; from gimbal_pin.cli import main; main(['--help']); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=ROOT
    )
    heavy = {
        "scipy",
        "pandas",
        "pinocchio",
        "control",
        "matplotlib",
        "yourdfpy",
        "meshcat",
        "lxml",
        "jinja2",
    }
    assert not heavy & set(done.stderr.split()) and "gimbal_pin.cli" in done.stderr


FEW = ("--plants", "2")
"""A judgement that takes no time."""


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(run: Run, verb: str) -> None:
    code, out, _ = run(verb, "--help")
    assert code == 0 and "usage" in out.lower()


def test_rigs_and_check(run: Run) -> None:
    assert {"thesis", "handheld", "turret"} <= set(result(run, "rigs")["rigs"])
    checked = result(run, "check", "turret")
    assert checked["camera_frame"] == "camera" and "q_pan" in checked["columns"]
    code, out, _ = run("check", "turret")
    assert code == 0 and "tau_pan" in out


def test_base_is_the_thesis_table(run: Run) -> None:
    found = result(run, "base", "thesis", "--diagonal")
    assert (found["parameters"], found["identifiable"]) == (24, 15)
    zero = {"spine.Ixx", "spine.Izz", "spine.mx", "spine.my", "spine.mz", "fork.my"}
    assert set(found["unidentifiable"]) == zero
    assert {"name": "spine.Iyy + fork.Izz", "terms": {"spine.Iyy": 1.0, "fork.Izz": 1.0}} in found[
        "base"
    ]


def test_a_log_without_rates_can_be_simulated(run: Run, tmp_path: Path) -> None:
    """What least squares is biased on; every other column is there."""
    motion = tmp_path / "motion.csv"
    log = tmp_path / "log.csv"
    write_log(prescribed(nominal(Rig.load("turret")), seconds=1.0), motion)
    for option, rates in (("--no-rates", False), ("--rates", True)):
        assert run("simulate", "turret", "--reference", motion, "-o", log, option)[0] == 0
        found = read_log(log, Rig.load("turret"))
        assert (found.v is not None) is rates and found.tau is not None and found.q_ref is not None


def test_a_controllers_log_is_as_late_as_it_was_tuned_for_and_its_error_is_told(
    run: Run, tmp_path: Path
) -> None:
    rig = Rig.load("turret")
    motion = tmp_path / "motion.csv"
    law = tmp_path / "law.yaml"
    write_log(prescribed(nominal(rig), seconds=1.0), motion)
    tune(nominal(rig), delay=0.004, dt=0.001).save(law)
    told = []
    logs = []
    for late in ((), ("--delay-samples", 4), ("--delay-samples", 1)):
        log = tmp_path / f"{len(logs)}.csv"
        code, out, _ = run(
            "simulate", "turret", "--controller", law, "--reference", motion, "-o", log, *late
        )
        assert code == 0
        logs.append(read_log(log, rig))
        told.append(out.splitlines()[-1])
    np.testing.assert_array_equal(logs[0].q, logs[1].q)
    assert np.any(logs[0].q != logs[2].q) and told[0] == told[1]
    assert logs[0].q_ref is not None
    rms = np.degrees(np.sqrt(np.mean((logs[0].q_ref - logs[0].q) ** 2, axis=0)))
    assert [float(x) for x in re.findall(r"([\d.]+)°", told[0])] == pytest.approx(
        rms.tolist(), rel=1e-2
    )


def test_identify_writes_model_urdf_and_json(run: Run, log_file: Path, tmp_path: Path) -> None:
    model = tmp_path / "model.yaml"
    urdf = tmp_path / "model.urdf"
    found = result(
        run, "identify", "turret", log_file, "-o", model, "--urdf", urdf, "--alignment", "0"
    )
    assert (
        found["estimator"] == "weighted"
        and found["held_out"]["how"] == "last third"
        and found["physical"] is True
    )
    for row in found["base_parameters"]:
        assert {"name", "value", "std", "unit"} <= set(row)
        assert (
            row["deviations"] == pytest.approx((row["value"] - row["urdf"]) / row["std"])
            and abs(row["urdf"]) > 0
        )
    assert min(found["held_out"]["fit_percent"].values()) > 99
    assert Rig.load(urdf).joints == ("pan", "tilt")
    tuned = result(
        run, "tune", "turret", model, "-o", tmp_path / "c.yaml", "--plot", tmp_path / "c.svg", *FEW
    )
    assert {"kp", "ki", "kd", "phase_margin_deg", "disk_margin"} <= set(tuned["joints"]["pan"])
    assert (tmp_path / "c.svg").stat().st_size > 1000
    asked = result(run, "tune", "turret", model, "--disk-margin", "0.9", "--delay", "0.002", *FEW)
    for row in asked["joints"].values():
        assert 0.9 - 1e-6 <= row["worst_of_draws"]["disk_margin"] < 0.92 and row["bandwidth_hz"] > 8
    assert (asked["draws"], asked["wish"]["delay"], asked["wish"]["bandwidth_hz"]) == (
        200,
        0.002,
        None,
    )
    tracked = result(run, "track", "turret", tmp_path / "c.yaml", *FEW)
    assert tracked["judged"] == tuned["judged"] and tracked["judged"]["plants"] == 2
    ratios = tracked["judged"]["ratios"]["computed-torque"]
    assert all(
        1 < ratios["worst"][place] <= ratios["median"][place] for place in ("pan", "tilt", "all")
    )


def test_export_finds_the_rig_that_a_controller_was_tuned_for(
    run: Run, log_file: Path, tmp_path: Path
) -> None:
    """Beside the controller's file, wherever the two are moved together; without it the rig has to be named."""
    first = tmp_path / "first"
    (first / "made").mkdir(parents=True)
    (first / "mine.yaml").write_text("urdf: turret\npayload: cinema\n")
    (first / "mine.urdf").write_text((bundled() / "turret.urdf").read_text())
    assert run("tune", first / "mine.urdf", log_file, "-o", first / "made" / "c.yaml", *FEW)[0] == 0
    moved = first.rename(tmp_path / "moved")
    assert run("export", moved / "made" / "c.yaml", "--odrive", moved / "map.json")[0] == 0
    (moved / "mine.urdf").unlink()
    refused(
        run("export", moved / "made" / "c.yaml", "--odrive", moved / "map.json"), 2, "--rig", "mine"
    )
    assert run("tune", moved / "mine.yaml", log_file, "-o", moved / "c.yaml", *FEW)[0] == 0
    assert run("export", moved / "c.yaml", "--odrive", moved / "map.json")[0] == 0


def test_track_on_a_platform_that_moves(run: Run, log_file: Path, tmp_path: Path) -> None:
    options = ("--platform", "S", "--learn", log_file, "--seeds", "1", "--seconds", "0.8")
    plot = ("--plot", tmp_path / "p.svg")
    found = result(run, "track", "turret", *options, *plot)
    assert found["schema"] == 1 and found["experiments"] == []
    rows = {row["controller"]: row for row in found["pointing"]}
    assert list(rows) == ["pid", "computed-torque"]
    for row in rows.values():
        assert (
            row["platform"] == "S"
            and row["seeds"] == 1
            and set(row["torque_rms"]) == {"pan", "tilt"}
        )
        assert 0 < row["jitter_rms_deg"] < row["jitter_max_deg"] and row["drift_deg"] is None
    assert rows["computed-torque"]["jitter_rms_deg"] < 0.5 * rows["pid"]["jitter_rms_deg"]
    assert found["pointing_loops"]["pid"] == found["pointing_loops"]["computed-torque"]
    assert (tmp_path / "p.svg").stat().st_size > 1000
    refused(run("track", "turret"), 2, "CONTROLLER", "--platform S")
    refused(
        run("track", "turret", "c.yaml", "--animation", tmp_path / "a.html"),
        2,
        "--animation",
        "--platform S",
    )
    refused(
        run("track", "turret", *options, "--platform-log", log_file),
        2,
        "--platform: is given beside",
    )
    for option, value in (("--fault", "clock:3:-1"), ("--compiled", "controller.so")):
        refused(run("track", "turret", *options, option, value), 2, option)


def test_animate_takes_a_bare_trajectory(run: Run, tmp_path: Path) -> None:
    traj = tmp_path / "traj.csv"
    page = tmp_path / "traj.html"
    code, _, err = run(
        "excite", "turret", "-o", traj, "--starts", 1, "--seconds", 4, "--harmonics", 3
    )
    assert code == 0, err
    code, said, err = run("animate", "turret", traj, "-o", page)
    assert code == 0 and page.stat().st_size > 100_000, err
    assert f"121 frames, {page.stat().st_size / 1e6:.1f} MB, " in said + err  # 4 s, 30 a second


def test_auto_walks_from_a_log_to_a_report(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its diagnosis looks for two causes here, for all of them in README's, which `scripts/docs --run` runs.

    Of a payload that sits 5 mm off and was weighed it states what `identify` does, in all its parts, and the truth.
    """
    few = {name: CAUSES[name] for name in ("cogging", "stribeck")}
    monkeypatch.setattr("gimbal_pin.report.pipeline.diagnose", partial(diagnose, causes=few))
    log = tmp_path / "log.csv"
    out = tmp_path / "out"
    rig = Rig.load("turret")
    weighed = ("--mass", "2.197")
    planted = [
        parse_effect(one, rig) for one in ("payload-shift:x=0.005", "payload-mass:extra=0.2")
    ]
    write_log(
        prescribed(
            plant_with(nominal(rig), planted).plant, seconds=6.0, torque_noise=0.01, dt=4e-3
        ),
        log,
    )
    found = result(
        run, "auto", "turret", log, *weighed, "--kind", "pid", "--damping", "0.9", "-o", out, *FEW
    )
    alone = result(run, "identify", "turret", log, *weighed)
    for key in ("given_model", "balance"):
        assert found["identify"][key] == found["diagnose"][key] == alone[key]
    row = alone["given_model"]["camera"]
    std = alone["given_model"]["camera"]["com_std_mm"]
    assert row["com_mm"][0] == pytest.approx(5.0, abs=3 * std[0])
    assert alone["balance"]["std_mm"][0] < 0.1, (
        "link and payload together are known to what the log shows"
    )
    refused(run("identify", "turret", log, "--mass", "-1"), 2, "--mass", "0.0001 to")
    assert (found["tune"]["controller"], found["tune"]["wish"]["damping"]) == ("pid", 0.9)
    whole(out)


def test_a_mapping_is_that_of_the_recorded_motion_where_there_is_one(
    run: Run, log_file: Path
) -> None:
    asked = ("track", "turret", "--learn", log_file, "--map", "t=elsewhere")
    refused(run(*asked, "--platform", "S"), 2, "log.csv", "elsewhere")
    refused(run(*asked, "--platform-log", "motion.csv"), 2, "motion.csv: ")


URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="{mass}"/>
<inertia ixx="{ixx}" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axis" type="{kind}"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="5" velocity="9"/></joint>{more}</robot>"""
GOOD = {"mass": "1", "ixx": "0.01", "kind": "revolute", "more": ""}


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"mass": "-1"}, "arm"),
        ({"kind": "fixed"}, "movable"),
        (
            {
                "more": '<joint name="back" type="fixed"><parent link="arm"/><child link="base"/></joint>'
            },
            "loop",
        ),
    ],
)
def test_bad_urdfs(run: Run, tmp_path: Path, change: dict[str, str], place: str) -> None:
    path = tmp_path / "bad.urdf"
    path.write_text(URDF.format(**{**GOOD, **change}))
    refused(run("check", path), 2, place)


def test_bad_usage_is_one_line(run: Run) -> None:
    for arguments in (
        ["nonsense"],
        ["base"],
        ["base", "thesis", "--nope"],
        ["excite", "turret", "-o", "x", "--starts", "x"],
    ):
        refused(run(*arguments), 2)
    refused(run("base", "nowhere.urdf"), 2, "nowhere.urdf", ", ".join(bundled_rigs()))


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda text: text.replace("tau_tilt", "other"), ["tau_tilt", "--map"]),
        (lambda text: text.replace("q_pan", "q_nose", 1), ["q_pan"]),
        (lambda text: re.sub(r"\n([\d.]+,)[^,]+", r"\n\1nan", text), ["q_pan"]),
        (lambda text: re.sub(r"\n(0\.01,)[^,]+", r"\n\1abc", text), ["q_pan", "abc"]),
        (lambda text: re.sub(r"\n[\d.]+(,[^\n]*\n)\Z", r"\n0.001\1", text), ["log.csv:"]),
    ],
)
def test_bad_logs(
    run: Run, log_file: Path, tmp_path: Path, edit: Callable[[str], str], words: list[str]
) -> None:
    text = log_file.read_text()
    assert edit(text) != text
    (tmp_path / "log.csv").write_text(edit(text))
    refused(run("identify", "turret", tmp_path / "log.csv", "-o", tmp_path / "m.yaml"), 2, *words)
    refused(run("auto", "turret", tmp_path / "log.csv", "-o", tmp_path / "out"), 2, *words)
    assert {path.name for path in tmp_path.iterdir()} == {"log.csv"}


def test_missing_file_and_bad_yaml(run: Run, tmp_path: Path) -> None:
    refused(run("identify", "turret", tmp_path / "none.csv"), 2, "none.csv")
    (tmp_path / "rig.yaml").write_text("urdf: turret\nmoters: {}\n")
    refused(run("check", tmp_path / "rig.yaml"), 2, "moters", "motors")


def test_data_that_cannot_answer(run: Run, log_file: Path, tmp_path: Path) -> None:
    """Ten samples, and a rig that stood still: exit code 3 and some of the parameters that do not show."""
    rig = Rig.load("turret")
    log = read_log(log_file, rig)
    write_log(log.part(slice(0, 10)), tmp_path / "short.csv")
    refused(
        run("identify", "turret", tmp_path / "short.csv", "-o", tmp_path / "m.yaml"),
        3,
        "head_mount.Iyy",
        "more;",
    )
    still = prescribed(nominal(rig), seconds=15.0)
    frozen = type(still)(
        "still", still.joints, still.t, np.zeros_like(still.q), None, np.ones_like(still.q)
    )
    write_log(frozen, tmp_path / "still.csv")
    refused(run("identify", "turret", tmp_path / "still.csv"), 3, "head_mount.Iyy", " more; ")
    assert not (tmp_path / "m.yaml").exists()
