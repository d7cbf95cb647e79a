"""The payload against its URDF, and its balance: what is planted is found, to its deviation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from gimbal_pin.control import perturbed
from gimbal_pin.dynamics import compute_rnea, nominal, reduce_parameters
from gimbal_pin.dynamics.checking import compute_gravity_load, spread_poses
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
from gimbal_pin.log import Array, Log
from gimbal_pin.regression import TRUST, compute_deformation_root
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed
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


def record(rig: Rig, seed: int) -> Log:
    """Return a log of a rig as it truly is."""
    return prescribed(nominal(rig), seed, seconds=14.0, torque_noise=0.02, dt=4e-3)


def compare(rig: Rig, true: Rig, seed: int = 1) -> PayloadDiscrepancy:
    """Return what a log of the true rig shows of the payload of a given one."""
    found = compare_payload(identify(rig, [record(true, seed)], filtering=EXACT)).apart
    assert found is not None
    return found


def score(found: PayloadDiscrepancy, way: tuple[float, ...] = SHIFT) -> Array:
    """Return the errors of the place in deviations, along the axes that show."""
    shown = np.array(found.shift.axes)
    return np.asarray((found.shift.change - way)[shown] / found.shift.std[shown])


@pytest.mark.parametrize("name", RIGS)
def test_planted_shift_is_recovered_within_its_deviation(name: str) -> None:
    rig = trust(name)
    found = [compare(rig, shift(rig), seed) for seed in range(2)]
    shown = [True, False, True] if name == "turret" else [True] * 3
    np.testing.assert_array_equal([list(one.shift.axes) for one in found], [shown] * 2)
    z = np.concatenate([score(one) for one in found])
    assert np.abs(z).max() < 4.0
    assert np.sqrt(np.mean(z**2)) < 1.8


@pytest.mark.parametrize("name", RIGS)
def test_payload_as_its_urdf_says_is_found_there(name: str) -> None:
    rig = trust(name)
    z = []
    for seed in range(3):
        found = compare(rig, rig, seed)
        assert found.is_sufficient
        assert len(found.lines) == 1
        for shown in (found.shift, found.mass, found.products):
            z += (shown.value / np.sqrt(np.diag(shown.covariance))).tolist()
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6


@pytest.mark.parametrize(("name", "shows"), [("handheld", True), ("thesis", False), ("ptu", False)])
def test_mass_shows_where_an_arm_carries_it(name: str, shows: bool) -> None:
    """Elsewhere the place is a function of the mass: at the planted one it is where it was."""
    rig = trust(name)
    found = compare(rig, PayloadMass(HEAVIER).apply(rig))
    row = found.to_dict()["camera"]
    if shows:
        assert row["mass"] == pytest.approx(1e3 * HEAVIER, abs=4 * row["mass_std"])
        return
    assert row["mass"] is None
    per_mass = found.per_mass + found.shift.change / found.stated
    at_mass = (found.shift.change + HEAVIER * per_mass)[list(found.shift.axes)]
    np.testing.assert_allclose(at_mass, 0.0, atol=4 * np.nanmax(found.shift.std))


@pytest.mark.parametrize("name", ["handheld", "turret"])
def test_weighed_mass_leaves_the_place_alone_open(name: str) -> None:
    rig = trust(name)
    true = PayloadMass(HEAVIER).apply(shift(rig))
    found = identify(rig, [record(true, 1)], filtering=EXACT)
    mass = float(get_payload(true)[1].mass)
    weighed = compare_payload(found, mass)
    alone = compare_payload(found)
    assert weighed.apart is not None and alone.balance is not None and weighed.balance is not None
    row = weighed.apart.to_dict()["camera"]
    assert (row["weighed"], row["mass_std"]) == (True, 0.0)
    assert row["mass"] == pytest.approx(1e3 * HEAVIER)
    assert np.abs(score(weighed.apart)).max() < 3
    assert weighed.balance.mass == pytest.approx(mass)
    if name == "handheld":
        away = np.abs(weighed.balance.way - alone.balance.way)
        assert np.all(away < 3 * alone.balance.std)
        assert np.all(weighed.balance.std < alone.balance.std)
    with pytest.raises(UsageError, match="give it in kilograms"):
        compare_payload(found, 1000.0 * mass)


def change_bodies(rig: Rig, seed: int) -> Rig:
    """Return the rig with bodies 15 % off and the payload moved."""
    body, inertia, frame = get_payload(rig)
    phi = perturbed(rig, 0.15, np.random.default_rng(seed)).rig.phi.copy()
    there = pin.SE3(np.eye(3), frame.rotation @ SHIFT).act(inertia)
    moved = there.toDynamicParameters() - inertia.toDynamicParameters()
    phi[10 * body : 10 * body + 10] += moved
    return rig.with_phi(phi)


@pytest.mark.parametrize("seed", range(3))
def test_other_bodies_are_not_laid_on_the_payload(seed: int) -> None:
    """Place and mass are true to their deviations."""
    rig = bundled("handheld")
    found = compare(rig, change_bodies(rig, seed), seed)
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


@pytest.mark.parametrize("share", [-1.05, [0, 0, 0, 0, -9, -9, -9, -9, -9, -9]])
def test_impossible_body_is_no_figure(share: float | list[float]) -> None:
    """A mass under zero; an inertia under that of the mass at its centre."""
    exact = build_exact("handheld")
    body, inertia, _ = get_payload(exact.rig)
    own = exact.responses[:, 10 * body : 10 * body + 10]
    change = own @ (np.array(share) * inertia.toDynamicParameters())
    found = explain_by_payload(replace(exact, change=change), trust=0.0)
    assert found is not None and not found.found_mass
    assert found.to_dict()["camera"]["com_mm"] == [None] * 3


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


@pytest.mark.parametrize("name", RIGS)
def test_balanced_payload_loads_the_motors_as_stated(name: str) -> None:
    rig = bundled(name)
    found = balance(find(name))
    load = compute_gravity_load(shift(rig, found.way))
    atol = 0.02 * max(found.before.values())
    np.testing.assert_allclose(load, [found.after[joint] for joint in rig.joints], atol=atol)


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


@pytest.mark.parametrize("mass", [0.4, 3.0])
def test_way_is_in_inverse_proportion_to_the_mass(mass: float) -> None:
    stated = balance(find("turret"))
    weighed = balance(find("turret"), mass)
    assert (stated.source, weighed.source) == ("stated", "weighed")
    np.testing.assert_allclose(mass * weighed.way, stated.mass * stated.way, atol=1e-12)
    assert weighed.after == pytest.approx(stated.after)


def test_rig_without_payload_has_no_statement() -> None:
    rig = bundled("turret", "none")
    found = compare_payload(identify(rig, [record(rig, 0)], filtering=EXACT))
    assert found.apart is None
    assert found.balance is None
