"""Logs beside each other: those of one rig agree within chance; of others what differs is found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import PayloadShift
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import (
    Agreement,
    identify,
    identify_new,
    read_known,
    write_model,
)
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed
from tests.identification.logs import record
from tests.rigs import bundled

RIG = bundled("turret")
CHANCE = 0.01
MOVED = PayloadShift(0.02, 0.0, 0.0).apply(RIG)


def rub(factors: Sequence[Sequence[float]]) -> Rig:
    """Return the rig with each joint's Coulomb and viscous friction times a factor."""
    return replace(RIG, friction=RIG.friction * np.array(factors))


def record_each(rigs: Sequence[Rig], seed: int = 0) -> list[Log]:
    """Return a log of each rig with a motion and noise of its own."""
    return [record(rig, 10 * seed + k) for k, rig in enumerate(rigs)]


def compare(logs: Sequence[Log]) -> Agreement:
    """Return how far the logs of a rig agree."""
    found = identify(RIG, logs, filtering=EXACT, examined="noisy").agreement
    assert found is not None
    assert found.logs == tuple(log.name for log in logs)
    return found


def test_logs_of_one_rig_agree_as_often_as_chance_has_it() -> None:
    each = [compare(record_each([RIG] * 3, seed)) for seed in range(10)]
    assert not any(one.drifting for one in each)
    p_values = np.array([x.p_value for one in each for x in one.parameters])
    expected = CHANCE * len(p_values)
    assert np.sum(p_values < CHANCE) <= expected + 3 * np.sqrt(expected)
    assert 0.3 < np.mean(p_values) < 0.7


def test_friction_of_one_joint_drifts_alone() -> None:
    falling = compare(record_each([rub([[1, 1], [1, share]]) for share in (1.0, 0.7, 0.4)]))
    (drifting,) = falling.drifting
    assert drifting.name == "tilt.Fv"
    assert np.all(np.diff(drifting.values) < 0)
    worn = compare(record_each([RIG, RIG, rub([[1, 1], [1.6, 1.6]])]))
    assert {one.name for one in worn.drifting} == {"tilt.Fs", "tilt.Fv"}


def test_moved_camera_changes_no_friction_in_any_order_of_logs() -> None:
    logs = record_each([RIG, RIG, MOVED])
    found = compare(logs)
    assert found.drifting
    assert not any(one.name.endswith((".Fs", ".Fv")) for one in found.drifting)
    for x, y in zip(found.parameters, compare(logs[::-1]).parameters, strict=True):
        np.testing.assert_allclose((x.values, x.std), (y.values[::-1], y.std[::-1]), rtol=1e-6)
        assert x.verdict is y.verdict


@pytest.mark.parametrize(("second", "is_swapped"), [("cinema", False), ("zoom-lens", True)])
def test_payload_swapped_within_a_log_is_suspected(second: str, is_swapped: bool) -> None:
    rigs = [bundled("turret", payload) for payload in ("cinema", second)]
    before, after = (prescribed(nominal(one), 1, 12.0, 0.02, 2e-3) for one in rigs)
    tau = np.where(before.t[:, None] < 6.0, before.tau, after.tau)
    found = identify(rigs[0], [replace(before, tau=tau)], filtering=EXACT, examined="noisy")
    assert found.parting is not None
    assert found.is_of_two_rigs == is_swapped
    assert found.parting > 2.0 if is_swapped else 0.0 < found.parting < 0.5


def test_clean_log_whose_halves_differ_by_no_torque_is_of_one_rig() -> None:
    """An encoder that drifts by half a milliradian is far beyond the noise."""
    rig = bundled("thesis")
    log = prescribed(nominal(rig), 4, 12.0)
    drift = 1e-4 * (log.t[:, None] - 6.0)
    found = identify(rig, [replace(log, q=log.q + drift)], filtering=EXACT, examined="noisy")
    assert found.parting is not None
    assert not found.is_of_two_rigs


def test_log_counts_once_whatever_its_name(tmp_path: Path) -> None:
    """Twice in one call, or beside a model that was identified from it."""
    first, other = record_each([RIG, RIG])
    copy = replace(first, name="copy")
    once, twice = (
        identify(RIG, logs, filtering=EXACT, holdout="none") for logs in ([first], [first, copy])
    )
    np.testing.assert_array_equal(once.estimate.covariance, twice.estimate.covariance)
    assert len(twice.logs) == 1
    write_model(once, tmp_path / "once.yaml")
    known = read_known(tmp_path / "once.yaml", RIG)
    with pytest.raises(UsageError, match=r"copy.*twice"):
        identify_new(RIG, [copy], known, filtering=EXACT)
    identify_new(RIG, [other], known, filtering=EXACT)


def test_difference_that_moves_no_torque_is_no_drift() -> None:
    """Friction a thousandth greater is significant without noise, and immaterial."""
    rigs = [RIG, RIG, rub([[1.0, 1.0], [1.001, 1.001]])]
    logs = [prescribed(nominal(rig), k, 10.0, 1e-5, 4e-3) for k, rig in enumerate(rigs)]
    found = compare(logs)
    assert min(one.p_value for one in found.parameters) < CHANCE / len(found.parameters)
    assert not found.drifting
