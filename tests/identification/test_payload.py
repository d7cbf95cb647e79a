"""The payload against its URDF, and its balance: what is planted is found, to its deviation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin.control import perturbed
from gimbal_pin.dynamics import compute_rnea, nominal, reduce_parameters
from gimbal_pin.dynamics.checking import spread_poses
from gimbal_pin.effects import PayloadMass, PayloadShift, get_payload
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import (
    Balance,
    BaseDifference,
    Identified,
    PayloadDiscrepancy,
    compare_payload,
    explain_by_payload,
    identify,
)
from gimbal_pin.log import Array
from gimbal_pin.regression import TRUST, compute_deformation_root
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed
from tests.identification.logs import record
from tests.rigs import bundled

RIGS = ("thesis", "handheld", "turret")
SHIFT = (0.0042, 0.002, -0.001)
"""Of the payload, m."""
HEAVIER = 0.1
"""Additional mass, kg."""


@cache
def trust(name: str) -> Rig:
    """Return a rig whose YAML says that its bodies are as the URDF says."""
    rig = bundled(name)
    return replace(rig, config=replace(rig.config, inertia="trusted"))


def shift(rig: Rig, way: Array | tuple[float, ...] = SHIFT) -> Rig:
    """Return the rig with its payload moved, m."""
    return PayloadShift(*np.asarray(way).tolist()).apply(rig)


def compare(rig: Rig, true: Rig, seed: int = 1) -> PayloadDiscrepancy:
    """Return what a log of the true rig shows of the payload of a given one."""
    found = compare_payload(identify(rig, [record(true, seed)], filtering=EXACT)).apart
    assert found is not None
    return found


def score(found: PayloadDiscrepancy, way: tuple[float, ...] = SHIFT) -> Array:
    """Return the errors of the place in deviations, along the axes that show."""
    shown = np.array(found.shift.axes)
    return np.asarray((found.shift.change - way)[shown] / found.shift.std[shown])


@pytest.mark.parametrize("way", [(0.0, 0.0, 0.0), SHIFT])
@pytest.mark.parametrize("name", RIGS)
def test_planted_shift_is_recovered_within_its_deviation(name: str, way: tuple[float, ...]) -> None:
    """Neither mass nor products of inertia are found that were not planted."""
    rig = trust(name)
    z = []
    for seed in range(3):
        found = compare(rig, shift(rig, way), seed)
        assert list(found.shift.axes) == [True, name != "turret", True]
        assert found.is_sufficient
        z += score(found, way).tolist()
        for none in (found.mass, found.products):
            z += (none.value / np.sqrt(np.diag(none.covariance))).tolist()
    assert np.abs(z).max() < 4.0
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6


@pytest.mark.parametrize(("name", "shows"), [("handheld", True), ("thesis", False), ("ptu", False)])
def test_mass_shows_where_an_arm_carries_it(name: str, shows: bool) -> None:
    """Elsewhere the first moment is that of the stated mass, and the place a function of it."""
    rig = trust(name)
    found = compare(rig, PayloadMass(HEAVIER).apply(shift(rig)))
    row = found.to_dict()["camera"]
    assert (row["mass"] is not None) == shows
    if shows:
        assert row["mass"] == pytest.approx(1e3 * HEAVIER, abs=4 * row["mass_std"])
        assert np.abs(score(found)).max() < 4
        return
    share = found.stated / (found.stated + HEAVIER)
    change = found.shift.change + found.per_mass * HEAVIER * share
    error = (change - SHIFT)[list(found.shift.axes)]
    assert np.all(np.abs(error) < 4 * found.shift.std[list(found.shift.axes)])


@pytest.mark.parametrize("name", ["handheld", "turret"])
def test_weighed_mass_leaves_the_place_alone_open(name: str) -> None:
    rig = trust(name)
    true = PayloadMass(HEAVIER).apply(shift(rig))
    found = identify(rig, [record(true, 1)], filtering=EXACT)
    mass = float(get_payload(true)[1].mass)
    weighed = compare_payload(found, mass)
    alone = compare_payload(found)
    assert weighed.apart is not None and weighed.balance is not None and alone.balance is not None
    assert weighed.apart.mass.change == pytest.approx(HEAVIER)
    assert np.abs(score(weighed.apart)).max() < 3
    assert weighed.balance.mass == pytest.approx(mass)
    assert np.all(weighed.balance.std <= alone.balance.std)
    with pytest.raises(UsageError, match="give it in kilograms"):
        compare_payload(found, 1000.0 * mass)


@pytest.mark.parametrize("seed", range(3))
def test_other_bodies_are_not_laid_on_the_payload(seed: int) -> None:
    """All bodies are 15 % off: place and mass are true to their deviations."""
    rig = bundled("handheld")
    true = shift(perturbed(rig, 0.15, np.random.default_rng(seed)).rig)
    found = compare(rig, true, seed)
    assert np.all(np.abs(score(found)) < 3)
    assert not found.is_sufficient
    row = found.to_dict()["camera"]
    assert row["mass"] is None or abs(row["mass"]) < 3 * row["mass_std"]


@cache
def build_exact(name: str) -> BaseDifference:
    """Return a difference of a rig whose base parameters are known almost exactly."""
    rig = bundled(name)
    reduction = reduce_parameters(rig)
    noise = 1e-10 * np.eye(len(reduction.independent))
    return BaseDifference(rig, reduction, np.zeros(len(noise)), noise, noise)


@pytest.mark.parametrize("name", ["drone", "handheld"])
def test_place_is_calibrated_for_bodies_as_far_off_as_the_trust(name: str) -> None:
    """Each is stretched and sheared by `TRUST`, the payload is not."""
    exact = build_exact(name)
    body, inertia, _ = get_payload(exact.rig)
    bare = exact.rig.phi.copy()
    bare[10 * body : 10 * body + 10] -= inertia.toDynamicParameters()
    bodies = TRUST * exact.responses @ compute_deformation_root(bare)
    rng = np.random.default_rng(2)
    z = []
    for _ in range(100):
        change = bodies @ rng.standard_normal(bodies.shape[1])
        found = explain_by_payload(replace(exact, change=change))
        assert found is not None
        z += score(found, (0.0, 0.0, 0.0)).tolist()
    assert len(z) >= 100
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.2)


# --- Balance -----------------------------------------------------------------------------------------


@cache
def find(name: str, way: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Identified:
    """Identify a rig from a log with its payload moved, m."""
    rig = bundled(name)
    log = prescribed(nominal(shift(rig, way)), 1, seconds=14.0, torque_noise=0.01, dt=4e-3)
    return identify(rig, [log], filtering=EXACT)


def balance(found: Identified, mass: float | None = None) -> Balance:
    """Return how to balance the payload."""
    out = compare_payload(found, mass).balance
    assert out is not None
    return out


def compute_load(rig: Rig, way: Array) -> float:
    """Return gravity over the motors' torque, mean square over poses, with the payload moved."""
    q = spread_poses(rig, 200)
    torque = compute_rnea(shift(rig, way), q, np.zeros_like(q), np.zeros_like(q))
    return float(np.mean((torque / rig.tau_max) ** 2))


@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_no_other_way_loads_the_motors_less(name: str) -> None:
    """On the fitted model, for ways on a grid and at random."""
    found = find(name, (0.012, -0.006, 0.009))
    way = balance(found).way
    best = compute_load(found.model.rig, way)
    assert best < compute_load(found.model.rig, np.zeros(3))
    random = 0.05 * np.random.default_rng(0).standard_normal((20, 3))
    steps = 1e-3 * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [5, -5, 5]])
    for other in (*steps, *-steps, *random):
        assert compute_load(found.model.rig, way + other) >= best * (1 - 1e-9) - 1e-15


@pytest.mark.parametrize("name", RIGS)
def test_camera_that_was_moved_is_to_be_moved_back(name: str) -> None:
    moved = (0.012, -0.006, 0.009)
    before = balance(find(name))
    after = balance(find(name, moved))
    shown = np.abs(before.way) > 0
    assert shown.tolist() == [True, name != "turret", True]
    error = (after.way - before.way + moved)[shown]
    assert np.all(np.abs(error) < 4 * np.hypot(before.std, after.std)[shown] + 1e-6)


def test_rig_without_payload_has_no_statement() -> None:
    rig = bundled("turret", "none")
    found = compare_payload(identify(rig, [record(rig, 0)], filtering=EXACT))
    assert found.apart is None
    assert found.balance is None
