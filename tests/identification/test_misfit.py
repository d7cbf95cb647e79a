"""Deviations hold what the model misses, and what a log does not show of the bodies."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from gimbal_pin.control import tune
from gimbal_pin.dynamics import nominal, plant_with, reduce_parameters
from gimbal_pin.effects import Cogging, parse_effect
from gimbal_pin.identification import (
    Opinion,
    identify,
    read_model,
    write_model,
)
from gimbal_pin.identification.bodies import estimate_bodies
from gimbal_pin.log import Log
from gimbal_pin.regression import (
    GROUPS,
    Block,
    add_misfit,
    compute_blocks,
    compute_deformation_root,
    find_likeliest_bodies,
    fit_misfit,
    fit_weighted,
    map_phi_to_base,
    measure_pure_error,
)
from gimbal_pin.rig import is_physical
from tests.bench_logs import EXACT, prescribed, rows_of, true_theta
from tests.rigs import bundled

RIG = bundled("turret")


@cache
def record(teeth: float = 0.0, noise: float = 0.01) -> Log:
    """Return a log of the turret with seven teeth per turn at tilt, N m."""
    effect = parse_effect(f"cogging:tilt:amplitude={teeth},harmonic=7", RIG)
    plant = plant_with(nominal(RIG), [effect] if teeth else []).plant
    return prescribed(plant, 1, 16.0, torque_noise=noise, dt=4e-3)


def ripple(log: Log, size: float) -> Log:
    """Return the log with 14 waves per turn at its first joint, as a share of its torque."""
    tau = np.array(log.tau)
    tau[:, 0] += size * np.std(tau[:, 0]) * np.sin(14 * log.q[:, 0] + 0.7)
    return replace(log, tau=tau)


# --- What the model misses --------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_not_missed_and_a_function_of_the_motion_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((600, 5))
    X = rng.standard_normal((600, len(GROUPS)))
    noise = rng.standard_normal(600)
    assert fit_misfit(A, X, A.sum(axis=1) + noise, 600.0).size < 0.25
    missed = 2.0 * X[:, GROUPS == 1] @ rng.standard_normal(int(np.sum(GROUPS == 1)))
    found = fit_misfit(A, X, A.sum(axis=1) + missed + noise, 600.0)
    assert found.size == pytest.approx(np.std(missed), rel=0.15)
    assert found.noise == pytest.approx(1.0, rel=0.15)


def test_pure_error_is_what_does_not_come_back_with_the_motion() -> None:
    """Functions of a periodic motion drop out exactly; noise remains, joint by joint."""
    phase = np.tile(2 * np.pi * np.arange(80) / 80, 5)[:, None] + np.array([0.0, 1.0])
    q = np.sin(phase) + 0.3 * np.cos(2 * phase)
    v = np.cos(phase) - 0.6 * np.sin(2 * phase)
    missed = np.tanh(9 * v) + np.cos(14 * q)
    none = np.zeros_like(q)
    rows = np.zeros((*q.shape, 0))
    block = Block(np.arange(400) / 8, rows, missed, q, v, none + 1, none, none)
    assert measure_pure_error([block], np.zeros(0)).max() < 1e-9
    size = np.array([0.1, 3.0])
    noise = size * np.random.default_rng(0).standard_normal(q.shape)
    noisy = block._replace(b=missed + noise)
    np.testing.assert_allclose(measure_pure_error([noisy], np.zeros(0)), size, rtol=0.12)


def test_deviations_hold_a_ripple() -> None:
    blocks = compute_blocks(rows_of(RIG, ripple(record(), 1.0)))
    plain = fit_weighted(blocks)
    wide, _ = add_misfit(blocks, plain)
    np.testing.assert_array_equal(wide.theta, plain.theta)
    error = plain.theta - true_theta(RIG)
    assert np.sqrt(np.mean((error / wide.std) ** 2)) < 1.25
    assert np.all(wide.std >= plain.std)


@pytest.mark.parametrize(
    ("size", "noise", "pan"),
    [
        (1.0, 0.01, Opinion.NOT_EXPLAINED),
        (0.05, 1e-3, Opinion.STRUCTURE_LEFT),
        (0.0, 0.1, Opinion.EXPLAINED),
    ],
)
def test_opinion_tells_structure_from_noise(size: float, noise: float, pan: Opinion) -> None:
    found = identify(RIG, [ripple(record(noise=noise), size)], filtering=EXACT)
    assert found.opinions == {"pan": pan, "tilt": Opinion.EXPLAINED}
    is_first = [said.startswith("pan is not explained: ") for said in found.warnings[:1]]
    assert any(is_first) == (pan is Opinion.NOT_EXPLAINED)


# --- What holds for the training part alone ------------------------------------------------------------


def join(first: Log, second: Log) -> Log:
    """Return the first log's torque for two thirds of the time, the second's for the rest."""
    early = np.arange(len(first)) < 2 * len(first) / 3
    return replace(first, tau=np.where(early[:, None], first.tau, second.tau))


def test_refit_that_is_worse_than_the_urdf_is_not_explained() -> None:
    """A hand pushed slowly in the training part alone."""
    log = record()
    tau = np.array(log.tau)
    push = np.sin(1.3 * log.t) + np.sin(2.9 * log.t + 1.0)
    tau[:, 1] += 0.45 * np.std(tau[:, 1]) * push
    found = identify(RIG, [join(replace(log, tau=tau), log)], filtering=EXACT)
    fits = [one.fit_percent["tilt"] for one in (found.held_out, found.simpler[0])]
    assert 50 < fits[0] < 90 < 95 < fits[1]
    assert found.opinions == {"pan": Opinion.EXPLAINED, "tilt": Opinion.NOT_EXPLAINED}


def test_effect_of_the_training_part_alone_is_left_out() -> None:
    teeth = [Cogging("tilt", (7.0,))]
    found = identify(RIG, [join(record(0.05), record())], teeth, filtering=EXACT)
    assert found.warnings[0].startswith("tilt: cogging left out: ")
    assert not any("cos_7" in name for name in found.names)
    kept = identify(RIG, [record(0.05)], teeth, filtering=EXACT)
    assert not kept.model.doubts
    assert any("cos_7" in name for name in kept.names)


def test_model_of_the_training_part_alone_is_doubted_by_tuning(tmp_path: Path) -> None:
    """Teeth that only the held-out part has; the file of the model keeps the doubt."""
    log = join(record(), record(0.05))
    found = identify(RIG, [log], [Cogging("tilt", (7.0,))], filtering=EXACT)
    write_model(found, tmp_path / "model.yaml")
    tuning = tune(read_model(tmp_path / "model.yaml", RIG))
    assert tuning.warnings == found.warnings[:1]
    assert "tilt: not to be run" in tuning.doubts[-1]
    assert not tune(identify(RIG, [record()], filtering=EXACT).model).doubts


# --- Bodies --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trust", [0.1, 0.3])
def test_intervals_of_bodies_hold_the_truth(trust: float) -> None:
    """Bodies drawn as far from the URDF's as the trust says, base parameters with noise."""
    rig = bundled("turret", "cinema")
    rng = np.random.default_rng(3)
    mixing = map_phi_to_base(rig, reduce_parameters(rig))
    root = trust * compute_deformation_root(rig.phi)
    std = 1e-3 * np.abs(mixing @ rig.phi) + 1e-5
    noise = np.diag(std**2)
    hits = []
    for _ in range(12):
        true = rig.phi + root @ rng.standard_normal(root.shape[1])
        if not is_physical(true):
            continue
        beta = mixing @ true + std * rng.standard_normal(len(std))
        phi = find_likeliest_bodies(rig.phi, mixing, beta, noise, trust)
        stated = estimate_bodies(rig.links, rig.phi, phi, mixing, beta, noise, trust)
        for body, own in zip(stated, true.reshape(-1, 10)):
            inertia = pin.Inertia.FromDynamicParameters(own)
            expected = (inertia.mass, *inertia.lever, *inertia.inertia[np.tril_indices(3)])
            figures = (body.mass, *body.com, *body.inertia)
            hits += [
                abs(figure.value - x) <= 1.96 * figure.std
                for figure, x in zip(figures, expected)
                if figure.std > 1e-12
            ]
    assert len(hits) > 150
    assert 0.90 < np.mean(hits) < 0.99


# --- The controller's bound ------------------------------------------------------------------------------
