"""Laws of logs beside each other: those of one rig agree within chance; of others the planted reason comes back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.dynamics import Model, nominal, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.identification import Agreement, DriftReason, LogVerdict, compare_payload, identify
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
    """Of N honest p-values at most ``N c + 3 √(N c)`` are under c; none is called a drift, and no reason is given."""
    each = [compare(rig, record([nominal(rig)] * 3, seed)) for seed in range(SEEDS)]
    assert all(one.reason is None and not one.drifting for one in each)
    p_values = np.array([x.p_value for one in each for x in one.parameters])
    expected = CHANCE * len(p_values)
    assert np.sum(p_values < CHANCE) <= expected + 3 * np.sqrt(expected)


@pytest.mark.parametrize("seed", range(3))
def test_friction_that_falls_everywhere_is_heat(rig: Rig, seed: int) -> None:
    shares = [1.0, 0.8, 0.6]
    models = [nominal(replace(rig, friction=rig.friction * np.array([1.0, share]))) for share in shares]
    found = compare(rig, record(models, seed))
    assert found.reason is DriftReason.HEAT and {one.name for one in found.drifting} <= {"pan.Fv", "tilt.Fv"}
    drifting = next(one for one in found.drifting if one.name == "tilt.Fv")
    assert np.all(np.diff(drifting.values) < 0)
    np.testing.assert_allclose(1 + found.sizes, [(1.0, share) for share in shares], atol=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_friction_of_one_joint_alone_is_wear(rig: Rig, seed: int) -> None:
    worn = nominal(replace(rig, friction=rig.friction * np.array([[1.0], [1.6]])))
    found = compare(rig, record([nominal(rig), nominal(rig), worn], seed))
    assert (found.reason, found.joint) == (DriftReason.WEAR, "tilt")
    assert {one.name for one in found.drifting} == {"tilt.Fs", "tilt.Fv"}
    np.testing.assert_allclose(found.sizes[2], 0.6 * rig.friction[1], rtol=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_a_torque_that_is_scaled_is_a_gain(rig: Rig, seed: int) -> None:
    logs = record([nominal(rig)] * 3, seed)
    logs[2] = replace(logs[2], tau=np.asarray(logs[2].tau) * [1.0, 1.1])
    found = compare(rig, logs)
    assert (found.reason, found.joint) == (DriftReason.GAIN, "tilt") and found.drifting
    np.testing.assert_allclose(found.sizes[:, 0], [0.0, 0.0, 0.1], atol=0.01)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_stand_that_leans_is_told_with_its_angle(rig: Rig, axis: str) -> None:
    lean = np.radians(3.0)
    found = compare(rig, record([nominal(rig), nominal(rig), plant(rig, f"base-tilt:{axis}={lean}")]))
    assert found.reason is DriftReason.LEAN
    planted = [lean, 0.0] if axis == "roll" else [0.0, lean]
    np.testing.assert_allclose(found.sizes, [(0.0, 0.0), (0.0, 0.0), planted], atol=np.radians(0.3))


def test_a_camera_that_was_moved_is_the_payload(rig: Rig) -> None:
    found = compare(rig, record([nominal(rig), nominal(rig), plant(rig, "payload-shift:x=0.02")]))
    assert found.reason is DriftReason.PAYLOAD and found.drifting
    assert not any(one.name.endswith((".Fs", ".Fv")) for one in found.drifting)


def test_what_was_changed_in_several_ways_has_no_single_reason(rig: Rig) -> None:
    logs = record([nominal(rig), nominal(rig), plant(rig, "payload-shift:x=0.02")])
    logs[2] = replace(logs[2], tau=np.asarray(logs[2].tau) + 0.3 * np.abs(logs[2].tau).max(axis=0) * np.sign(logs[2].v))
    assert compare(rig, logs).reason is DriftReason.UNKNOWN


def test_the_order_of_logs_changes_no_verdict(rig: Rig) -> None:
    logs = record([nominal(rig), nominal(rig), plant(rig, "payload-shift:x=0.02")])
    one, other = (compare(rig, several) for several in (logs, logs[::-1]))
    assert one.reason is other.reason
    for x, y in zip(one.parameters, other.parameters):
        np.testing.assert_allclose((x.values, x.std), (y.values[::-1], y.std[::-1]), rtol=1e-6)
        assert x.verdict is y.verdict


def test_what_drifts_is_printed_and_what_agrees_is_counted(rig: Rig) -> None:
    logs = record([nominal(rig)] * 3)
    logs[2] = replace(logs[2], tau=np.asarray(logs[2].tau) * [1.0, 1.1])
    found = identify(rig, logs, filtering=EXACT, examined="noisy")
    assert found.agreement is not None
    said = show_parameters(found, compare_payload(found)).to_text()
    assert found.agreement.sentence in said and "3 logs: " in said and "torque of tilt is scaled" in said
    saved = found.to_dict()["agreement"]
    assert (saved["reason"], saved["joint"]) == ("gain", "tilt")
    verdicts = [one["verdict"] for one in saved["parameters"]]
    lines = said.split("Drifts")[1].count("< 0.001")
    assert verdicts.count(LogVerdict.DRIFTS) == len(found.agreement.drifting) == lines > 0
    assert identify(rig, logs[:1], filtering=EXACT, examined="noisy").agreement is None
