"""Laws of logs beside each other: those of one rig agree within chance; of others the planted parameter drifts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.dynamics import Model, nominal, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.identification import Agreement, LogVerdict, compare_payload, identify
from gimbal_pin.log import Log
from gimbal_pin.report import show_parameters
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed

CHANCE = 0.01
SEEDS = 20


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


def record(models: Sequence[Model], seed: int = 0) -> list[Log]:
    """A log of each model, its motion and noise its own."""
    logs = (prescribed(model, 10 * seed + k, 12.0, 0.02, 2e-3) for k, model in enumerate(models))
    return [replace(log, name=f"log {k}") for k, log in enumerate(logs, start=1)]


def compare(rig: Rig, logs: Sequence[Log]) -> Agreement:
    found = identify(rig, logs, filtering=EXACT, examined="noisy").agreement
    assert found is not None and found.logs == tuple(log.name for log in logs)
    return found


def plant(rig: Rig, effect: str) -> Model:
    return plant_with(nominal(rig), [parse_effect(effect, rig)]).plant


def test_logs_of_one_rig_agree_as_often_as_chance_has_it(rig: Rig) -> None:
    """Of N honest p-values at most ``N c + 3 √(N c)`` are under c; none is called a drift."""
    each = [compare(rig, record([nominal(rig)] * 3, seed)) for seed in range(SEEDS)]
    assert not any(one.drifting for one in each)
    p_values = np.array([x.p_value for one in each for x in one.parameters])
    expected = CHANCE * len(p_values)
    assert np.sum(p_values < CHANCE) <= expected + 3 * np.sqrt(expected)


@pytest.mark.parametrize("seed", range(3))
def test_friction_that_falls_everywhere_drifts(rig: Rig, seed: int) -> None:
    shares = [1.0, 0.8, 0.6]
    models = [
        nominal(replace(rig, friction=rig.friction * np.array([1.0, share]))) for share in shares
    ]
    found = compare(rig, record(models, seed))
    assert {one.name for one in found.drifting} <= {"pan.Fv", "tilt.Fv"}
    drifting = next(one for one in found.drifting if one.name == "tilt.Fv")
    assert np.all(np.diff(drifting.values) < 0)


@pytest.mark.parametrize("seed", range(3))
def test_friction_of_one_joint_alone_drifts(rig: Rig, seed: int) -> None:
    worn = nominal(replace(rig, friction=rig.friction * np.array([[1.0], [1.6]])))
    found = compare(rig, record([nominal(rig), nominal(rig), worn], seed))
    assert {one.name for one in found.drifting} == {"tilt.Fs", "tilt.Fv"}


def test_a_moved_camera_changes_no_friction(rig: Rig) -> None:
    found = compare(rig, record([nominal(rig), nominal(rig), plant(rig, "payload-shift:x=0.02")]))
    assert found.drifting
    assert not any(one.name.endswith((".Fs", ".Fv")) for one in found.drifting)


def test_the_order_of_logs_changes_no_verdict(rig: Rig) -> None:
    logs = record([nominal(rig), nominal(rig), plant(rig, "payload-shift:x=0.02")])
    one, other = (compare(rig, several) for several in (logs, logs[::-1]))
    for x, y in zip(one.parameters, other.parameters):
        np.testing.assert_allclose((x.values, x.std), (y.values[::-1], y.std[::-1]), rtol=1e-6)
        assert x.verdict is y.verdict


def test_what_drifts_is_printed_and_what_agrees_is_counted(rig: Rig) -> None:
    logs = record([nominal(rig)] * 3)
    logs[2] = replace(logs[2], tau=np.asarray(logs[2].tau) * [1.0, 1.1])
    found = identify(rig, logs, filtering=EXACT, examined="noisy")
    assert found.agreement is not None
    said = show_parameters(found, compare_payload(found)).to_text()
    assert found.agreement.sentence in said and "3 logs: " in said
    saved = found.to_dict()["agreement"]
    verdicts = [one["verdict"] for one in saved["parameters"]]
    lines = said.split("Drifts")[1].count("< 0.001")
    assert verdicts.count(LogVerdict.DRIFTS) == len(found.agreement.drifting) == lines > 0
    assert identify(rig, logs[:1], filtering=EXACT, examined="noisy").agreement is None
