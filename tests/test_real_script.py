"""`scripts/real`: what it requires holds for a good diagnosis and not for a bad one, and its runs are kept."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import real
from real_data import cases, checks, running
from real_data.cases import Case
from real_data.judging import Class, judge
from real_data.known import DEVICES, Known, Size, known_of
from real_data.running import Outcome
from real_data.samples import errors

from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.identification import write_extended
from gimbal_pin.log import Log, files_of, read_log, read_mapping, write_log
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.rigs import bundled, chain

URDF = cases.CAMERA.replace("tilt", "motor")
SOUND = Outcome(0, 1.0, "", "", {"held_out": None})
DATA = (
    "acceleration-noise",
    "clock",
    "commanded-torque",
    "controller-formula",
    "filtered-velocity",
    "logs-disagree",
)
COLUMNS = ("t=t", "q_motor=q", "tau_motor=tau")


def found(
    cause: str, joint: str, status: str = "named", **sizes: tuple[float, float | None]
) -> dict[str, Any]:
    told = {name: {"value": value, "std": std, "unit": ""} for name, (value, std) in sizes.items()}
    return {"cause": cause, "joint": joint, "status": status, "parameters": told}


def diagnosed(*findings: dict[str, Any], left: float = 0.1, **more: Any) -> Outcome:
    """A diagnosis of one motor, whose held-out error was 1 and is `left`."""
    parts = {
        "baseline": {"torque_rmse": {"motor": 1.0}},
        "extended": {"torque_rmse": {"motor": left}},
    }
    told = {"verdict": "named" if findings else "nothing", "findings": list(findings), **parts}
    return Outcome(0, 2.0, "", "", told | {"residual": {"motor": {"state": "noise"}}} | more)


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """A folder of data with one motor, which moved for 2 s with 1 N m at most."""
    place = tmp_path / "data" / "odrive_cogging"
    place.mkdir(parents=True)
    (place / "rotor.urdf").write_text(URDF)
    t = np.arange(0.0, 2.0, 0.01)
    table = np.column_stack([t, t, np.sin(t)])
    np.savetxt(place / "log.csv", table, delimiter=",", header="t,q,tau", comments="")
    return tmp_path / "data"


def test_every_named_log_is_asked_about(tmp_path: Path) -> None:
    """No data at all: every line of the list is there and is skipped, the public logs' two included."""
    every = cases.measured(tmp_path, tmp_path)
    lines = checks.judged(checks.required(every, tmp_path), {})
    assert all(line.passed is None and "not run" in line.figure for line in lines)
    assert real.count(lines) == f"0 passed, 0 failed, {len(lines)} skipped"
    titles = " ".join(line.title for line in lines)
    for word in (
        "odrive",
        "laas",
        "simple",
        "double_061157",
        "UR10e",
        "rub_gimbal",
        "phantom4_motion",
    ):
        assert word in titles
    assert cases.public(tmp_path) == []


def test_a_runs_words_name_logs_and_maps() -> None:
    case = Case(
        "two",
        "turret",
        (Path("a.csv"), Path("b.csv")),
        cases.joints({"q": "pos{}"}, ("pan", "tilt")),
    )
    words = case.arguments("diagnose", Path("out"))
    maps = ["--map", "q_pan=pos1", "--map", "q_tilt=pos2"]
    assert words == ["diagnose", "turret", "a.csv", "b.csv", *maps, "--json", "out/told/run.json"]


def test_three_files_are_one_log_of_some_joints(tmp_path: Path) -> None:
    clone = tmp_path / "figaroh-examples" / "examples" / "tiago"
    (clone / "urdf").mkdir(parents=True)
    (clone / "urdf" / "tiago_schunk.urdf").write_text(URDF)
    (case,) = cases.public(tmp_path)
    assert not case.there and sorted(read_mapping(case.maps))[:2] == [
        "dq_arm_1_joint",
        "dq_arm_2_joint",
    ]
    for path in files_of(case.logs[0]):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    assert case.there


def test_currents_in_a_file_without_a_header(tmp_path: Path) -> None:
    """Time, six angles, six rates, six currents from the fourteenth column on."""
    clone = tmp_path / "dynamic_calibration"
    urdf = clone / "URe/urdf/ur10e.urdf"
    log = clone / "dataset_ur10e/identification_data" / cases.UR10E["12"]
    for path in (urdf, log):
        path.parent.mkdir(parents=True)
    urdf.write_text(chain(6).urdf)
    table = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 20))
    table[:, 0] = np.arange(50) * 0.008
    np.savetxt(log, table, delimiter=",")
    case = cases.public(tmp_path)[0]
    read = read_log(log, Rig.load(urdf), case.maps)
    assert read.v is not None and read.tau is not None
    np.testing.assert_allclose(np.hstack([read.q, read.v]), table[:, 1:13])
    np.testing.assert_allclose(read.tau, table[:, 13:19] * cases.UR10E_CONSTANTS)


def test_a_run_is_kept_and_not_repeated(tiny: Path, tmp_path: Path) -> None:
    """A log that is too slow for its limit is killed; what was kept stays until it is asked for again."""
    place = tiny / "odrive_cogging"
    case = Case(
        "odrive_tiny",
        place / "rotor.urdf",
        (place / "log.csv",),
        COLUMNS,
        {"diagnose": ("--help",)},
    )
    lost = replace(case, name="lost", logs=(place / "none.csv",))
    folder = tmp_path / "results"
    real.run_missing([case, lost], folder, 60.0)
    (key,) = kept = running.kept(folder)
    assert key == ("odrive_tiny", "diagnose") and kept[key].exit == 0 and kept[key].sound
    assert not (folder / "lost").exists()
    running.keep(SOUND, folder / "odrive_tiny" / "diagnose.json")
    real.run_missing([case], folder, 60.0)
    assert running.kept(folder) == {key: SOUND}
    late = running.run(["--help"], tmp_path, 0.001)
    assert late.exit is None and not late.sound and late.said == "over the time limit"


@pytest.mark.parametrize(
    ("code", "error", "sound"),
    [(0, "", True), (0, "note\n", True), (2, "one line\n", True), (3, "one line\n", True), (3, "two\nlines\n", False),
     (1, "one line\n", False), (2, "", False), (0, "Traceback\n", False), (None, "", False)],
)  # fmt: skip
def test_what_an_error_of_ours_is(code: int | None, error: str, sound: bool) -> None:
    assert replace(SOUND, exit=code, error=error).sound == sound


KNOWN = Known(
    "motor", ("tiny",), ("cogging|torque-ripple",), ("backlash", "*@tilt"),
    (Size("armature", "inertia", 0.0, 0.003), Size("delay", "time", 0.0, 0.043)), frozenset({72}), 0.3,
)  # fmt: skip


@pytest.mark.parametrize(
    ("finding", "left", "judged"),
    [
        (
            found("cogging", "motor", harmonic=(72.0, None), harmonic2=(18.0, None)),
            0.1,
            Class.RIGHT,
        ),
        (found("cogging", "motor", harmonic=(18.0, None)), 0.1, Class.HONEST),
        (found("cogging", "motor", harmonic=(72.0, None)), 0.31, Class.HONEST),
        (found("cogging", "motor", "ambiguous", harmonic=(72.0, None)), 0.1, Class.HONEST),
        (found("cogging", "motor", harmonic=(72.0, None)), 1.2, Class.WRONG),
        (found("cogging", "motor", amplitude=(0.1, 0.06)), 0.1, Class.WRONG),
        (found("stribeck", "motor", speed=(0.1, 0.01)), 0.9, Class.HONEST),
        (found("backlash", "motor"), 0.9, Class.WRONG),
        (found("backlash", "motor", "ambiguous"), 0.9, Class.HONEST),
        (found("stribeck", "tilt"), 0.9, Class.WRONG),
        (found("armature", "motor", inertia=(0.0035, 0.001)), 0.9, Class.HONEST),
        (found("armature", "motor", inertia=(0.013, 0.001)), 0.9, Class.WRONG),
        (found("armature", "motor", inertia=(-0.1, 0.01)), 0.9, Class.WRONG),
        (found("delay", "motor", time=(0.154, 0.01)), 0.9, Class.WRONG),
        (found("delay", "motor", time=(0.02, 0.01)), 0.9, Class.HONEST),
    ],
)
def test_classes_of_a_finding(finding: dict[str, Any], left: float, judged: Class) -> None:
    assert judge("tiny", KNOWN, diagnosed(finding, left=left), lambda: 1.0).judged == judged


@pytest.mark.parametrize(
    ("note", "judged"),
    [
        ("the inertia about its axis is 140 ± 7 % less than the URDF's", Class.WRONG),
        ("the inertia about its axis is 40 ± 7 % less than the URDF's", Class.HONEST),
        ("664 ± 7 g lighter than the stated 625.6 g", Class.WRONG),
        ("64 ± 7 g lighter than the stated 625.6 g", Class.HONEST),
    ],
)
def test_a_body_that_cannot_be_is_wrong(note: str, judged: Class) -> None:
    assert judge("tiny", KNOWN, diagnosed(notes=[note]), lambda: 1.0).judged == judged


@pytest.mark.parametrize(
    ("code", "error", "share", "judged"),
    [(3, "no\n", 0.9, Class.REFUSED), (3, "no\n", 0.1, Class.HONEST), (1, "no\n", 0.1, Class.ERROR),
     (None, "", 0.1, Class.ERROR)],
)  # fmt: skip
def test_classes_of_a_log_without_an_answer(
    code: int | None, error: str, share: float, judged: Class
) -> None:
    outcome = replace(SOUND, exit=code, error=error, result=None)
    assert judge("tiny", KNOWN, outcome, lambda: share).judged == judged


def test_the_table_knows_causes_and_parameters_that_there_are(tmp_path: Path) -> None:
    """Else a renamed cause or parameter would pass whatever is named; and every log with torque has a device."""
    for device in DEVICES:
        for cause in (
            *(c for one in device.found for c in one.split("|")),
            *device.denied,
            *device.faults,
        ):
            assert cause.partition("@")[0] in {"*", *CAUSES, *DATA}, cause
        for size in device.sizes:
            kind = CAUSES[size.cause]
            coefficients = kind("motor").coefficients if size.cause == "armature" else ()
            assert size.parameter in {
                parameter.name for parameter in (*kind.shapes, *coefficients)
            }, size
    every = [*cases.measured(tmp_path, tmp_path), *cases.benchmarks(tmp_path)]
    assert not [case.name for case in every if known_of(case.name) is None]


def test_a_device_of_which_nothing_is_known_fails() -> None:
    for outcome in (
        diagnosed(),
        diagnosed(found("cogging", "motor")),
        replace(SOUND, exit=3, result=None),
    ):
        assert judge("tiny", None, outcome, lambda: 0.0).judged == Class.UNKNOWN


@pytest.mark.parametrize(
    ("cause", "unreliable", "judged"),
    [("clock", True, Class.WRONG), ("outliers", True, Class.WRONG), ("clock", False, Class.HONEST),
     ("filtered-velocity", True, Class.HONEST)],
)  # fmt: skip
def test_a_fault_that_the_data_do_not_have_is_wrong(
    cause: str, unreliable: bool, judged: Class
) -> None:
    fault = found(cause, "motor", "data") | {"makes_physics_unreliable": unreliable}
    known = replace(KNOWN, faults=("filtered-velocity",))
    assert judge("tiny", known, diagnosed(fault), lambda: 1.0).judged == judged


def test_a_log_without_torque_is_rightly_refused_and_never_diagnosed() -> None:
    known = Known("gimbal", ("tiny",), has_torque=False)
    assert (
        judge("tiny", known, replace(SOUND, exit=3, error="no\n", result=None), lambda: 1.0).judged
        == Class.HONEST
    )
    assert judge("tiny", known, diagnosed(), lambda: 1.0).judged == Class.WRONG


def test_a_probability_is_printed_where_there_is_one() -> None:
    finding = found("cogging", "motor") | {"probability": 0.98}
    assert "p 0.98" in str(judge("tiny", KNOWN, diagnosed(finding), lambda: 1.0))


def test_an_inertia_and_a_formula_of_identify() -> None:
    rows = [{"name": "rotor.Izz", "value": -1e-6, "std": 1e-8, "unit": "kg m^2"}]
    negative = replace(SOUND, result={"base_parameters": rows, "notes": []})
    said = replace(
        SOUND, result={"base_parameters": rows, "notes": ["the inertia of motor is undetermined"]}
    )
    assert (
        not checks.inertia_is_positive(negative, diagnosed())[0]
        and checks.inertia_is_positive(said, diagnosed())[0]
    )
    assert not checks.formula_in_identify(negative)[0]


def test_logs_that_name_different_sizes() -> None:
    spring, other = (found("cable-spring", "motor", stiffness=(x, 0.1)) for x in (1.0, 2.0))
    assert checks.agreeing(diagnosed(spring), diagnosed(spring))[0]
    assert not checks.agreeing(diagnosed(spring), diagnosed(), diagnosed(other))[0]


def test_two_engines_side_by_side() -> None:
    key = ("tiny", "diagnose")
    verb = ("tiny", "identify")
    spring = diagnosed(found("cable-spring", "motor", stiffness=(1.0, 0.1)))
    told = real.side_by_side({key: diagnosed(), verb: SOUND}, {key: spring, verb: SOUND})
    assert re.findall(r"^  [AB] .*", told, re.M) == [
        "  A     2.0 s  nothing: no finding | motor noise",
        "  B     2.0 s  named: cable-spring at motor (stiffness 1 ± 0.1) | motor noise",
    ]
    assert "identify" in real.side_by_side({verb: SOUND}, {verb: replace(SOUND, exit=3)})


def test_the_true_model_is_as_good_as_least_squares_and_a_wrong_one_is_worse(
    tmp_path: Path,
) -> None:
    """Of a log without noise, on the same held-out samples."""
    true = nominal(bundled("turret"))
    log: Log = prescribed(true, seconds=6.0, dt=0.005)
    write_log(log, tmp_path / "log.csv")
    case = Case("turret", "turret", (tmp_path / "log.csv",), ())
    write_extended(true, tmp_path / "true.yaml")
    write_extended(replace(true, terms=()), tmp_path / "frictionless.yaml")
    scale = np.sqrt(np.mean(log.tau**2, axis=0)) if log.tau is not None else np.nan
    mine, plain = errors(case, tmp_path / "true.yaml", 4.0)
    assert np.all(mine < 0.02 * scale) and np.all(plain < 0.02 * scale)
    wrong, same = errors(case, tmp_path / "frictionless.yaml", 4.0)
    assert np.all(wrong > 3 * mine) and np.array_equal(same, plain)
