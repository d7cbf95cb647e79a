"""What a person at a Python prompt meets: names, what they take, refuse, draw and print."""

from __future__ import annotations

import copy
import inspect
import pickle
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import gimbal_pin as gp
from gimbal_pin import GimbalPinError, Log, Rig
from gimbal_pin.effects import Cogging
from gimbal_pin.log import Imu
from gimbal_pin.regression import fit_ordinary
from tests.bench_logs import EXACT, prescribed
from tests.rigs import bundled, chain

RIG = bundled("turret")
MODEL = gp.nominal(RIG)


@cache
def recorded() -> Log:
    return prescribed(MODEL, seconds=8.0, torque_noise=0.01, dt=4e-3)


WRONG: Mapping[str, Callable[[], Any]] = {
    "identify: logs": lambda: gp.identify(RIG, ["log.csv"]),  # type: ignore[list-item]
    "identify: rig": lambda: gp.identify("turret", recorded()),  # type: ignore[arg-type]
    "estimator.*weighted": lambda: gp.identify(RIG, recorded(), estimator="least"),
    "identify: trust": lambda: gp.identify(RIG, recorded(), trust="much"),  # type: ignore[arg-type]
    "cog": lambda: gp.identify(RIG, recorded(), ["cog:tilt"]),
    "torque-gain": lambda: gp.identify(RIG, recorded(), ["torque-gain:tilt"]),
    "cutoff": lambda: gp.identify(RIG, recorded(), cutoff=4.0),  # type: ignore[call-arg]
    "diagnose: rig": lambda: gp.diagnose(recorded(), RIG),  # type: ignore[arg-type]
    "tune: model.*identify": lambda: gp.tune(RIG),  # type: ignore[arg-type]
    "check: rig": lambda: gp.check(None),  # type: ignore[arg-type]
    "read_log: path": lambda: gp.read_log(RIG, "log.csv"),  # type: ignore[arg-type]
    "write_log: log": lambda: gp.write_log("log.csv", recorded()),  # type: ignore[arg-type]
    "track: controllers": lambda: gp.track(MODEL, 3),  # type: ignore[arg-type]
    "Rig.load: rig": lambda: Rig.load(5),  # type: ignore[arg-type]
    r"\(N, 2\)": lambda: MODEL.inverse(*np.zeros((3, 4, 3))),
    "numbers": lambda: MODEL.inverse("a", "b", "c"),  # type: ignore[arg-type]
    "rng: is": lambda: gp.profile_s(np.linspace(0, 1, 20), -1),
    "no joint 'tilt'": lambda: gp.identify(RIG, renamed()),
    "'tilt' of rig": lambda: gp.Online.of(RIG).advance(gp.Online.of(RIG).start(), renamed()),
}
"""Words of the refusal, which name the argument → the call."""


def renamed() -> Log:
    """Return a log of another rig."""
    return replace(recorded(), joints=("pan", "nod"))


@pytest.mark.parametrize("said", WRONG)
def test_a_wrong_argument_is_one_line_that_names_it(said: str) -> None:
    with pytest.raises(GimbalPinError, match=said) as caught:
        WRONG[said]()
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


# --- Logs ---------------------------------------------------------------------------------------

GIVEN: dict[str, Any] = {"t": [0.0, 0.1, 0.2], "q": [[0.0], [0.1], [0.2]]}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"t": None}, "run: t: is None"),
        ({"q": [[0.0], [0.1]]}, r"run: q: has shape \(2, 1\), expected \(3, 1\)"),
        ({"q": [0.0, 0.1, 0.2]}, r"run: q: has shape \(3,\), expected \(3, 1\)"),
        ({"tau": [[0.0], [0.1, 0.2], [0.3]]}, "run: tau: is no array of numbers"),
        ({"v": [["fast"], [0.1], [0.2]]}, "run: v: is no array of numbers"),
        ({"tau": np.ma.array(GIVEN["q"], mask=[[0], [1], [0]])}, "run: tau: has masked samples"),
        ({"imus": {"arm": Imu(gyro=np.zeros((2, 3)))}}, "run: gyro of arm: has shape"),
        ({"joints": ("pan", "pan"), "q": np.zeros((3, 2))}, "run: joints: are pan, pan"),
        ({"q": [[0.0], [np.nan], [0.2]]}, "q.*sample 1"),
        ({"q": np.broadcast_to(np.nan, (3, 1))}, "q.*sample 0"),
        ({"tau": np.broadcast_to(1e12, (3, 1))}, "tau.*sample 0"),
        ({"v": [[0.0], [0.1], [np.inf]]}, "v.*sample 2"),
        ({"tau": [[0.0], [0.1], [1e12]]}, "tau.*sample 2"),
    ],
)
def test_a_log_says_in_one_line_what_it_cannot_be_made_of(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(GimbalPinError, match=said) as caught:
        Log(**{"name": "run", "joints": ("pan",), **GIVEN, **wrong})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "pass_on", [lambda x: pickle.loads(pickle.dumps(x)), copy.copy, copy.deepcopy]
)
def test_a_log_of_plain_lists_passes_between_processes(pass_on: Callable[[Log], Log]) -> None:
    imus = {"arm": Imu(gyro=np.ones((3, 3)))}
    log = pass_on(Log("run", ["pan"], **GIVEN, imus=imus, events=("said",)))  # type: ignore[arg-type]
    assert (log.name, log.joints, log.events, log.payload) == ("run", ("pan",), ("said",), None)
    np.testing.assert_array_equal(log.q, GIVEN["q"])
    np.testing.assert_array_equal(log.imus["arm"].gyro, imus["arm"].gyro)
    assert not log.q.flags.writeable


def test_names_and_words_do_as_lists_and_objects_in_any_order_of_the_joints() -> None:
    log = recorded()
    one = gp.identify(RIG, log, ["cogging:tilt:harmonic=7"], estimator="ols", filtering=EXACT)
    channels = {name: getattr(log, name)[:, ::-1] for name in ("q", "v", "tau")}
    turned = replace(log, joints=log.joints[::-1], **channels)
    effects = [Cogging("tilt", (7.0,))]
    other = gp.identify(RIG, [turned], effects, estimator=fit_ordinary, filtering=EXACT)
    np.testing.assert_allclose(one.estimate.theta, other.estimate.theta, rtol=1e-9)
    assert one.names == other.names


def test_the_default_checks_the_data_as_the_command_line_does() -> None:
    q = np.array(recorded().q)
    q[::500] += 0.3
    spiky = replace(recorded(), q=q)
    found, asked = (
        gp.identify(RIG, spiky, filtering=EXACT, **wish) for wish in ({}, {"examined": "noisy"})
    )
    assert found.bias is not None
    assert found.faults
    assert found.faults == asked.faults


# --- Random numbers -----------------------------------------------------------------------------

DRAWN: Mapping[str, Callable[[Any], tuple[Any, Any]]] = {
    "profile_s": lambda rng: (drawn := gp.profile_s(np.linspace(0, 1, 20), rng), drawn.f),
    "bench_run": lambda rng: (drawn := gp.bench_run(MODEL, seconds=0.2, rng=rng), drawn.tau),
}
"""Name → what it returns for a generator or seed, and a part that is drawn."""


@pytest.mark.parametrize("name", DRAWN)
def test_the_seed_in_a_result_repeats_it(name: str) -> None:
    first, drawn = DRAWN[name](None)
    np.testing.assert_array_equal(DRAWN[name](first.seed)[1], drawn)
    assert not np.array_equal(DRAWN[name](first.seed + 1)[1], drawn)
    assert DRAWN[name](np.random.default_rng(first.seed))[0].seed is None


def test_every_name_can_be_called_without_a_generator_and_is_listed() -> None:
    listed = {name for name in dir(gp) if not name.startswith("__")}
    assert listed == set(gp.__all__)
    found = [getattr(gp, name) for name in gp.__all__]
    assert all(map(callable, found))
    parameters = [inspect.signature(x).parameters for x in found if inspect.isfunction(x)]
    drawing = [of["rng"] for of in parameters if "rng" in of]
    assert len(drawing) >= 7
    assert all(parameter.default is None for parameter in drawing)


# --- At a prompt --------------------------------------------------------------------------------


def test_whatever_a_name_returns_prints_as_a_few_lines() -> None:
    log = recorded()
    found = gp.identify(RIG, [log])
    tuning = gp.tune(found.model, bandwidth_hz=4, robust=True)
    tracking = gp.track(found.model, {"mine": tuning.controller}, seconds=0.7)
    online = gp.Online.of(RIG)
    many = chain(32)
    results = [
        *(log, RIG, many, MODEL, found, found.estimate, found.model, tuning, tracking, online),
        *(online.advance(online.start(), log), gp.diagnose(RIG, log), gp.check(RIG)),
        *(gp.excite(RIG, seconds=2, starts=1), gp.profile_s(log.t), gp.nominal(many)),
        Log("run", many.joints, [0.0, 1.0], np.zeros((2, 32))),  # type: ignore[arg-type]
    ]
    for one in results:
        assert 10 < len(repr(one)) < 400
    assert len(str(tuning)) > len(repr(tuning))
