"""What a person at a Python prompt meets: names, what they take, refuse, draw and print."""

from __future__ import annotations

import copy
import inspect
import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, get_args, get_type_hints

import numpy as np
import pandas as pd
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
    "cog": lambda: gp.identify(RIG, recorded(), ["cog:tilt"]),
    "cutoff": lambda: gp.identify(RIG, recorded(), cutoff=4.0),  # type: ignore[call-arg]
    "tune: model.*identify": lambda: gp.tune(RIG),  # type: ignore[arg-type]
    "animate: log": lambda: gp.animate(RIG, recorded()),  # type: ignore[arg-type]
    "write_log: log": lambda: gp.write_log("log.csv", recorded()),  # type: ignore[arg-type]
    "Rig.load: rig": lambda: Rig.load(5),  # type: ignore[arg-type]
    r"\(N, 2\)": lambda: MODEL.inverse_dynamics(*np.zeros((3, 4, 3))),
    r"v: has shape \(3, 2\)": lambda: MODEL.inverse_dynamics(
        *map(np.zeros, ((4, 2), (3, 2), (4, 2)))
    ),
    r"t: has shape \(3,\)": lambda: MODEL.inverse_dynamics(*np.zeros((3, 4, 2)), t=np.zeros(3)),
    "platform: has shape": lambda: MODEL.inverse_dynamics(*np.zeros((3, 4, 2)), platform=shaken()),
    "platform: is 'drone'": lambda: MODEL.inverse_dynamics(
        *np.zeros((3, 4, 2)),
        platform="drone",  # type: ignore[arg-type]
    ),
    "numbers": lambda: MODEL.inverse_dynamics("a", "b", "c"),  # type: ignore[arg-type]
    "profile_s: t: is no": lambda: gp.profile_s("now"),  # type: ignore[arg-type]
    r"profile_s: t: has shape \(\)": lambda: gp.profile_s(0.5),  # type: ignore[arg-type]
    "Online.of: rig": lambda: gp.Online.of("turret"),  # type: ignore[arg-type]
    "Online.advance: log": lambda: gp.Online.of(RIG).advance(
        gp.Online.of(RIG).start(),
        "log.csv",  # type: ignore[arg-type]
    ),
    "save: path: is 5": lambda: gp.identify(RIG, recorded()).save(5),  # type: ignore[arg-type]
    "report: path: is 5": lambda: recorded().report(5),  # type: ignore[arg-type]
    "rng: is": lambda: gp.profile_s(np.linspace(0, 1, 20), -1),
    "no joint 'tilt'": lambda: gp.identify(RIG, renamed()),
    "'tilt' of rig": lambda: gp.Online.of(RIG).advance(gp.Online.of(RIG).start(), renamed()),
}
"""Words of the refusal, which name the argument → the call."""


def shaken() -> gp.Platform:
    """Return a motion of the base of seven samples."""
    return gp.profile_s(np.linspace(0, 1, 7), 0)


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
        ({"q": [[0.0], [0.1]]}, r"run: q: has shape \(2, 1\), expected \(3, 1\)"),
        ({"tau": [[0.0], [0.1, 0.2], [0.3]]}, "run: tau: is no array of numbers"),
        ({"tau": np.ma.array(GIVEN["q"], mask=[[0], [1], [0]])}, "run: tau: has masked samples"),
        ({"imus": {"arm": Imu(gyro=np.zeros((2, 3)))}}, "run: gyro of arm: has shape"),
        ({"joints": ("pan", "pan"), "q": np.zeros((3, 2))}, "run: joints: are pan, pan"),
        ({"q": [[0.0], [np.nan], [0.2]]}, "q.*sample 1"),
        ({"q": np.broadcast_to(np.nan, (3, 1))}, "q.*sample 0"),
        ({"v": [[0.0], [0.1], [np.inf]]}, "v.*sample 2"),
    ],
)
def test_a_log_says_in_one_line_what_it_cannot_be_made_of(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(GimbalPinError, match=said) as caught:
        Log(**{"name": "run", "joints": ("pan",), **GIVEN, **wrong})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("pass_on", [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy])
def test_a_log_of_plain_lists_passes_between_processes(pass_on: Callable[[Log], Log]) -> None:
    imus = {"arm": Imu(gyro=np.ones((3, 3)))}
    log = pass_on(Log("run", ["pan"], **GIVEN, imus=imus, events=("said",)))  # type: ignore[arg-type]
    assert (log.name, log.joints, log.events) == ("run", ("pan",), ("said",))
    np.testing.assert_array_equal(log.q, GIVEN["q"])
    np.testing.assert_array_equal(log.imus["arm"].gyro, 1.0)
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
    assert found.faults == asked.faults != ()


def test_a_fit_is_tuned_as_its_model_is() -> None:
    fit = gp.identify(RIG, recorded())
    tuned, same = (gp.tune(one, bandwidth_hz=4.0) for one in (fit, fit.model))
    assert tuned.model is fit.model
    assert tuned.to_dict() == same.to_dict()


# --- Random numbers -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "part"),
    [
        (lambda rng: gp.profile_s(np.linspace(0, 1, 20), rng), "f"),
        (lambda rng: gp.bench_run(MODEL, seconds=0.2, rng=rng), "tau"),
    ],
)
def test_the_seed_in_a_result_repeats_it(call: Callable[[Any], Any], part: str) -> None:
    first = call(None)
    drawn = getattr(first, part)
    np.testing.assert_array_equal(getattr(call(first.seed), part), drawn)
    assert not np.array_equal(getattr(call(first.seed + 1), part), drawn)
    assert call(np.random.default_rng(first.seed)).seed is None


def test_every_name_is_listed_and_can_be_called_without_a_generator() -> None:
    assert {name for name in dir(gp) if not name.startswith("__")} == set(gp.__all__)
    for name in gp.__all__:
        found = getattr(gp, name)
        assert callable(found)
        if inspect.isfunction(found) and "rng" in inspect.signature(found).parameters:
            assert inspect.signature(found).parameters["rng"].default is None


def list_types(hint: Any) -> Iterator[type]:
    """Yield the classes of the package in an annotation."""
    for inner in get_args(hint):
        yield from list_types(inner)
    if isinstance(hint, type) and hint.__module__.startswith("gimbal_pin"):
        yield hint


def list_signatures() -> Iterator[Any]:
    """Yield the public functions, and the methods of a fit and a model that are asked for torques."""
    for name in gp.__all__:
        if inspect.isfunction(found := getattr(gp, name)):
            yield pytest.param(inspect.unwrap(found), id=name)
    fit = gp.IdentificationResult
    for method in (gp.Model.inverse_dynamics, fit.predict, fit.residual):
        yield pytest.param(inspect.unwrap(method), id=method.__qualname__)


@pytest.mark.parametrize("function", [*list_signatures()])
def test_every_type_in_a_public_signature_is_public(function: Callable[..., Any]) -> None:
    names = {"DataFrame": pd.DataFrame, **function.__globals__}
    hints = get_type_hints(function, names)
    for part, hint in hints.items():
        assert hint is not Any, part
        for kind in list_types(hint):
            assert getattr(gp, kind.__name__, None) is kind, f"{part}: {kind.__name__}"
    assert "return" in hints


# --- At a prompt --------------------------------------------------------------------------------


def test_whatever_a_name_returns_prints_as_a_few_lines() -> None:
    log = recorded()
    found = gp.identify(RIG, [log])
    tuning = gp.tune(found, bandwidth_hz=4, robust=True)
    online = gp.Online.of(RIG)
    many = chain(32)
    wide = Log("run", many.joints, np.array([0.0, 1.0]), np.zeros((2, 32)))
    for one in (
        *(log, RIG, many, wide, MODEL, gp.nominal(many), found, found.estimate, found.model),
        *(tuning, gp.track(found.model, {"mine": tuning.controller}, seconds=0.7), online),
        *(online.advance(online.start(), log), gp.diagnose(RIG, log), gp.check(RIG)),
        *(gp.excite(RIG, seconds=2, starts=1), gp.profile_s(log.t)),
    ):
        assert 10 < len(repr(one)) < 400
    assert len(str(tuning)) > len(repr(tuning))
