"""Laws of the public functions' arguments: a wrong type or number of them is one line that names the argument."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import gimbal_pin
from gimbal_pin import GimbalPinError, Log, Rig
from gimbal_pin.effects import Cogging, TorqueGain
from gimbal_pin.regression import fit_ordinary
from tests.bench_logs import EXACT, prescribed


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return prescribed(gimbal_pin.nominal(rig), 1, 8.0, torque_noise=0.01, dt=4e-3)


WRONG: dict[str, tuple[Callable[[Rig, Log], Any], str]] = {
    "identify, a path": (lambda rig, log: gimbal_pin.identify(rig, "log.csv"), "identify: logs"),
    "identify, a rig's name": (
        lambda rig, log: gimbal_pin.identify("turret", log),
        "identify: rig",
    ),
    "identify, a list of paths": (
        lambda rig, log: gimbal_pin.identify(rig, ["log.csv"]),
        "identify: logs",
    ),
    "identify, an estimator": (
        lambda rig, log: gimbal_pin.identify(rig, log, estimator="least"),
        "estimator.*weighted",
    ),
    "identify, a number": (
        lambda rig, log: gimbal_pin.identify(rig, log, trust="much"),
        "identify: trust",
    ),
    "identify, an effect": (lambda rig, log: gimbal_pin.identify(rig, log, ["cog:tilt"]), "cog"),
    "identify, an effect's shape": (
        lambda rig, log: gimbal_pin.identify(rig, log, ["cogging:tilt"]),
        "harmonic",
    ),
    "identify, a delay": (
        lambda rig, log: gimbal_pin.identify(rig, log, ["delay:tilt:time=0.01"]),
        "delay",
    ),
    "identify, an option": (lambda rig, log: gimbal_pin.identify(rig, log, cutoff=4.0), "cutoff"),
    "diagnose": (lambda rig, log: gimbal_pin.diagnose(rig, 3.0), "diagnose: logs"),
    "diagnose, the order": (lambda rig, log: gimbal_pin.diagnose(log, rig), "diagnose: rig"),
    "tune": (lambda rig, log: gimbal_pin.tune(rig), "tune: model.*identify"),
    "animate": (lambda rig, log: gimbal_pin.animate(log, rig), "animate: rig"),
    "bench_run": (lambda rig, log: gimbal_pin.bench_run(rig), "bench_run: plant"),
    "bench_run, a time": (
        lambda rig, log: gimbal_pin.bench_run(gimbal_pin.nominal(rig), seconds="20"),
        "seconds",
    ),
    "nominal": (lambda rig, log: gimbal_pin.nominal("turret"), "nominal: rig"),
    "nominal, nothing": (lambda rig, log: gimbal_pin.nominal(), "rig"),
    "check": (lambda rig, log: gimbal_pin.check(None), "check: rig"),
    "read_log": (lambda rig, log: gimbal_pin.read_log(rig, "log.csv"), "read_log: path"),
    "write_log": (lambda rig, log: gimbal_pin.write_log("log.csv", log), "write_log: log"),
    "excite": (lambda rig, log: gimbal_pin.excite(rig, seconds=None), "excite: seconds"),
    "track": (lambda rig, log: gimbal_pin.track(gimbal_pin.nominal(rig), 3), "track: controllers"),
    "Rig.load": (lambda rig, log: Rig.load(5), "Rig.load: rig"),
    "Log, joints": (lambda rig, log: Log("log", 5, log.t, log.q), "joints"),
    "Model.inverse": (
        lambda rig, log: gimbal_pin.nominal(rig).inverse(*np.zeros((3, 2))),
        r"inverse: q.*\(N, 2\)",
    ),
    "Model.inverse, a column": (
        lambda rig, log: gimbal_pin.nominal(rig).inverse(*np.zeros((3, 4, 3))),
        r"\(N, 2\)",
    ),
    "Model.inverse, words": (
        lambda rig, log: gimbal_pin.nominal(rig).inverse("a", "b", "c"),
        "numbers",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_argument_is_one_line_that_names_it(name: str, rig: Rig, log: Log) -> None:
    call, named = WRONG[name]
    with pytest.raises(GimbalPinError, match=named) as raised:
        call(rig, log)
    assert "\n" not in str(raised.value) and raised.value.exit_code == 2


@pytest.mark.parametrize("effect", [TorqueGain("tilt"), "torque-gain:tilt"])
def test_an_effect_that_reads_the_torque_itself_is_no_column(
    effect: Any, rig: Rig, log: Log
) -> None:
    with pytest.raises(GimbalPinError, match="torque-gain"):
        gimbal_pin.identify(rig, log, [effect])


def test_one_log_names_and_words_do_as_lists_and_objects(rig: Rig, log: Log) -> None:
    one = gimbal_pin.identify(
        rig, log, ["cogging:tilt:harmonic=7"], estimator="ols", filtering=EXACT
    )
    other = gimbal_pin.identify(
        rig, [log], [Cogging("tilt", (7.0,))], estimator=fit_ordinary, filtering=EXACT
    )
    np.testing.assert_array_equal(one.estimate.theta, other.estimate.theta)
    assert one.names == other.names and any("cos7" in name or "7" in name for name in one.names)


def test_the_default_checks_the_data_as_the_command_line_does(rig: Rig, log: Log) -> None:
    assert log.tau is not None
    tau = log.tau.copy()
    tau[::50] += 20 * np.abs(tau).max()
    spiky = Log("spiky", log.joints, log.t, log.q, log.v, tau)
    found = gimbal_pin.identify(rig, spiky, filtering=EXACT)
    assert (
        found.bias is not None
        and found.faults
        == gimbal_pin.identify(rig, spiky, filtering=EXACT, examined="noisy").faults
    )


@pytest.mark.parametrize("channel", ["t", "q", "v", "tau"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e12])
def test_a_read_only_array_is_checked_as_any(
    channel: str, value: float, rig: Rig, log: Log
) -> None:
    arrays = {name: np.array(getattr(log, name)) for name in ("t", "q", "v", "tau")}
    arrays[channel][5] = value
    for array in arrays.values():
        array.setflags(write=False)
    with pytest.raises(GimbalPinError, match=f"{channel}.*sample 5"):
        Log("read-only", rig.joints, **arrays)
