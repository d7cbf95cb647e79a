"""What a person at a Python prompt meets: the names of the package itself, what they take, and what they print."""

from __future__ import annotations

import copy
import inspect
import pickle
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gimbal_pin
from gimbal_pin import GimbalPinError, Log, Rig
from gimbal_pin.control import judge_controllers, pair_rivals
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.dynamics import check
from gimbal_pin.identification import identify_several
from gimbal_pin.log import Imu, write_yaml
from gimbal_pin.report import Auto, summary
from tests.bench_logs import prescribed
from tests.command_line import Run
from tests.rigs import chain


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return prescribed(gimbal_pin.nominal(rig), seconds=12.0, torque_noise=0.01)


@pytest.fixture(scope="module")
def diagnosis(rig: Rig, log: Log) -> Diagnosis:
    return gimbal_pin.diagnose(rig, [log])


# --- logs -----------------------------------------------------------------------------------------------------------


def turned(log: Log) -> Log:
    """The same log with its columns, and their names, the other way round."""
    return replace(
        log,
        joints=log.joints[::-1],
        **{name: getattr(log, name)[:, ::-1] for name in ("q", "v", "tau")},
    )


def test_columns_are_found_by_their_joints_names(rig: Rig, log: Log) -> None:
    straight, other = (
        gimbal_pin.identify(rig, [one], holdout="none") for one in (log, turned(log))
    )
    np.testing.assert_allclose(other.estimate.theta, straight.estimate.theta, rtol=1e-9)
    assert min(other.train.fit_percent.values()) > 90


def test_a_log_of_another_rig_is_refused_by_all_that_take_both(rig: Rig, log: Log) -> None:
    strange = replace(log, joints=("pan", "nod"))
    online = gimbal_pin.Online.of(rig)
    for asked in (
        lambda: gimbal_pin.identify(rig, [strange]),
        lambda: gimbal_pin.diagnose(rig, [strange], rng=np.random.default_rng(0)),
        lambda: gimbal_pin.auto(rig, [strange], "nowhere", rng=np.random.default_rng(0)),
        lambda: online.advance(online.start(), strange),
    ):
        with pytest.raises(
            GimbalPinError,
            match=f"{log.name}: has no joint '{rig.joints[1]}' of rig turret; it has",
        ):
            asked()


GIVEN: dict[str, Any] = {"t": [0.0, 0.1, 0.2], "q": [[0.0], [0.1], [0.2]]}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"t": None}, "run: t: is None"),
        ({"q": None}, "run: q: is None"),
        ({"q": [[0.0], [0.1]]}, r"run: q: has shape \(2, 1\), expected \(3, 1\)"),
        ({"q": [0.0, 0.1, 0.2]}, r"run: q: has shape \(3,\), expected \(3, 1\)"),
        ({"tau": [[0.0], [0.1, 0.2], [0.3]]}, "run: tau: is no array of numbers"),
        ({"v": [["fast"], [0.1], [0.2]]}, "run: v: is no array of numbers"),
        ({"tau": np.ma.array(GIVEN["q"], mask=[[0], [1], [0]])}, "run: tau: has masked samples"),
        ({"imus": {"arm": Imu(gyro=np.zeros((2, 3)))}}, "run: gyro of arm: has shape"),
        ({"joints": ("pan", "pan"), "q": np.zeros((3, 2))}, "run: joints: are pan, pan"),
    ],
)
def test_a_log_says_in_one_line_what_it_cannot_be_made_of(
    wrong: dict[str, Any], words: str
) -> None:
    with pytest.raises(GimbalPinError, match=words) as refusal:
        Log(**{"name": "run", "joints": ("pan",), **GIVEN, **wrong})
    assert "\n" not in str(refusal.value)


def test_a_log_is_made_of_plain_lists() -> None:
    made = Log("run", ["pan"], **GIVEN)  # type: ignore[arg-type]
    assert made.joints == ("pan",) and made.q.dtype == np.float64 and made.q.shape == (3, 1)


@pytest.mark.parametrize(
    "through", [lambda x: pickle.loads(pickle.dumps(x)), copy.copy, copy.deepcopy]
)
def test_a_log_passes_between_processes(through: Any, log: Log) -> None:
    carried = replace(log, imus={"arm": Imu(gyro=np.ones((len(log), 3)))}, events=("said",))
    same = through(carried)
    assert (same.name, same.joints, same.events, same.payload) == (
        carried.name,
        carried.joints,
        ("said",),
        None,
    )
    np.testing.assert_array_equal(same.q, carried.q)
    np.testing.assert_array_equal(same.imus["arm"].gyro, np.ones((len(log), 3)))
    assert not same.q.flags.writeable


# --- random numbers -------------------------------------------------------------------------------------------------


def test_every_name_that_draws_can_be_called_without_a_generator() -> None:
    takers = {
        name
        for name in gimbal_pin.__all__
        if inspect.isfunction(value := getattr(gimbal_pin, name))
        and "rng" in inspect.signature(value).parameters
    }
    assert takers >= {"auto", "bench_run", "diagnose", "excite", "profile_s", "simulate", "track"}
    for name in takers:
        assert inspect.signature(getattr(gimbal_pin, name)).parameters["rng"].default is None, name


DRAWN: dict[str, tuple[Callable[..., Any], Callable[[Any], Any]]] = {
    "profile_s": (
        lambda rig, **rng: gimbal_pin.profile_s(np.linspace(0, 1, 20), **rng),
        lambda platform: platform.f,
    ),
    "excite": (
        lambda rig, **rng: gimbal_pin.excite(rig, seconds=2, starts=1, **rng),
        lambda found: found.coefficients,
    ),
    "bench_run": (
        lambda rig, **rng: gimbal_pin.bench_run(
            gimbal_pin.nominal(rig), seconds=0.2, period=2, **rng
        ),
        lambda log: log.tau,
    ),
    "track": (
        lambda rig, **rng: gimbal_pin.track(
            gimbal_pin.nominal(rig),
            {"mine": gimbal_pin.tune(gimbal_pin.nominal(rig), bandwidth_hz=4).controller},
            seconds=0.7,
            one_by_one=False,
            **rng,
        ),
        lambda tracking: tracking.experiments[0].log.tau,
    ),
}


@pytest.mark.parametrize("name", DRAWN)
def test_the_seed_in_a_result_repeats_it(name: str, rig: Rig) -> None:
    run, drawn = DRAWN[name]
    first = run(rig)
    np.testing.assert_array_equal(drawn(run(rig, rng=first.seed)), drawn(first))
    assert not np.array_equal(drawn(run(rig, rng=first.seed + 1)), drawn(first))
    assert run(rig, rng=np.random.default_rng(first.seed)).seed is None


@pytest.mark.parametrize("wrong", ["mine", -1, 0.5])
def test_what_is_no_seed_is_refused(wrong: Any) -> None:
    with pytest.raises(GimbalPinError, match="rng: is"):
        gimbal_pin.profile_s(np.linspace(0, 1, 20), wrong)


# --- names ----------------------------------------------------------------------------------------------------------


def test_dir_lists_the_public_names_alone() -> None:
    assert {name for name in dir(gimbal_pin) if not name.startswith("__")} == set(
        gimbal_pin.__all__
    )
    assert {"animate", "check", "export_controller"} <= set(gimbal_pin.__all__)
    assert all(callable(getattr(gimbal_pin, name)) for name in gimbal_pin.__all__)


def test_a_tuning_is_exported_as_its_file_is(rig: Rig, run: Run, tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    tuning = gimbal_pin.tune(gimbal_pin.nominal(rig))
    gimbal_pin.export_controller(tuning).write(tmp_path / "python")
    write_yaml(tuning.to_dict(), tmp_path / "controller.yaml")
    assert run("export", tmp_path / "controller.yaml", "--c", tmp_path / "verb")[0] == 0
    for file in (tmp_path / "verb").glob("*.[ch]"):
        assert file.read_text() == (tmp_path / "python" / file.name).read_text()
    assert (tmp_path / "python" / "gimbal_controller.h").exists()


def test_check_and_animate_do_what_the_verbs_do(rig: Rig, log: Log, tmp_path: Path) -> None:
    assert tuple(gimbal_pin.check(rig).joints) == rig.joints
    gimbal_pin.animate(rig, log.part(slice(0, 1000)), tmp_path / "seen.html")
    assert (tmp_path / "seen.html").read_text(encoding="utf-8").startswith("<!")


# --- at a prompt ----------------------------------------------------------------------------------------------------


def within(value: Any, seen: dict[int, Any]) -> dict[int, Any]:
    """Everything of the package that a value holds, itself first, and the containers that hold it."""
    own = type(value).__module__.startswith("gimbal_pin") and hasattr(value, "__dict__")
    if id(value) in seen or not (own or isinstance(value, (Mapping, tuple, list))):
        return seen
    seen[id(value)] = value
    inside = vars(value) if own else value
    for part in list(inside.values() if isinstance(inside, Mapping) else inside):
        within(part, seen)
    return seen


def test_whatever_a_name_returns_prints_as_a_few_lines(
    rig: Rig, log: Log, diagnosis: Diagnosis
) -> None:
    found = gimbal_pin.identify(rig, [log])
    tuning = gimbal_pin.tune(found.model, bandwidth_hz=4, robust=True)
    tracking = gimbal_pin.track(found.model, {"mine": tuning.controller}, seconds=0.7)
    online = gimbal_pin.Online.of(rig)
    memory = online.advance(online.start(), log)
    read = summary(rig, found, tuning, tracking, [log], "the plant", diagnosis)
    judged = judge_controllers(found.model, pair_rivals(tuning.stored), plants=1)
    auto = Auto(
        found,
        diagnosis,
        found.model,
        tuning,
        tracking,
        judged,
        log,
        {},
        "the plant",
        read,
        diagnosis.given,
    )
    many = chain(32)
    wide = Log("run", many.joints, [0.0, 1.0], np.zeros((2, 32)))
    carried = gimbal_pin.profile_s(log.t)
    several = identify_several({"infrared": rig}, {"infrared": [log]})
    excitation = gimbal_pin.excite(rig, seconds=2, starts=1)
    results = [
        auto,
        several,
        online,
        memory,
        online.model(memory),
        excitation,
        carried,
        check(rig),
        many,
        wide,
    ]
    held = within([*results, gimbal_pin.nominal(many)], {}).values()
    everything = [one for one in held if type(one).__module__.startswith("gimbal_pin")]
    assert {"Diagnosis", "Tracking", "Estimate", "Evidence", "Rig", "Log"} <= {
        type(one).__name__ for one in everything
    }
    long = {type(one).__name__: len(repr(one)) for one in everything}
    assert not {name: size for name, size in long.items() if size > 400}
    assert repr(tracking).startswith(
        "Tracking(rig=Rig 'turret', steps={pan, tilt}, experiments=3 Exp"
    )
    assert repr(diagnosis).startswith("Diagnosis(rig='turret', logs=('prescribed 0'), verdict=")
    assert repr(carried).startswith("Platform(t=12001 array, f=12001 × 3 array")
    assert str(tuning).startswith(repr(tuning)[:-1]) and len(str(tuning)) > len(repr(tuning))


# --- files ----------------------------------------------------------------------------------------------------------


def test_one_mapping_is_a_text_a_path_or_a_table(rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time,a,b\n0,0,1\n0.1,2,3\n0.2,4,5\n", encoding="utf-8")
    table = {"t": "time", "q_pan": "a*pi/180", "q_tilt": "b*pi/180"}
    written = tmp_path / "map.yaml"
    written.write_text(
        "".join(f"{target}: {source}\n" for target, source in table.items()), encoding="utf-8"
    )
    several = [f"{target}={source}" for target, source in table.items()]
    given: list[Any] = [str(written), written, table, several, [written]]
    for mapping in given:
        read = gimbal_pin.read_log(tmp_path / "log.csv", rig, mapping, need_tau=False)
        np.testing.assert_allclose(read.q, np.deg2rad([[0, 1], [2, 3], [4, 5]]))
    with pytest.raises(GimbalPinError, match=r"mapping: q_pan: maps to 3"):
        gimbal_pin.read_log(tmp_path / "log.csv", rig, {**table, "q_pan": 3})  # type: ignore[dict-item]
