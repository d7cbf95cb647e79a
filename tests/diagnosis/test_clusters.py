"""Laws of deviations by time, angle and rate: unbiased for white noise, wide where a formula errs with the state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin import bench_run
from gimbal_pin.diagnosis import DIAGNOSIS_BAND, Problem, State, gather, solve_causes
from gimbal_pin.diagnosis.uncertainty import bin_rows, cluster_covariance, estimate_figures
from gimbal_pin.dynamics import nominal, plant_with, reduce_parameters
from gimbal_pin.effects import (
    AsymmetricFriction,
    Backlash,
    CableSpring,
    Cause,
    Cogging,
    Parameter,
    parse_effect,
)
from gimbal_pin.log import Array, Log
from gimbal_pin.rig import Rig

SEEDS = st.integers(0, 10**6)


def orthonormal(seed: int, rows: int, width: int) -> Array:
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(rows, width)))[0]


RIG = Rig.load("turret")
COGGING = Cogging("pan", (6.0,))
UNEVEN = AsymmetricFriction("pan")
PLANTED = {"amplitude": 0.05, "coulomb": 0.02}


@pytest.fixture(scope="module")
def log() -> Log:
    """A tower with three things planted."""
    texts = (
        "cogging:pan:amplitude=0.05,harmonic=6",
        "asymmetric-friction:pan:coulomb=0.02,viscous=0.0",
    )
    spring = "cable-spring:tilt:stiffness=0.05,rest=0.1,cubic=0.02"
    plant = plant_with(nominal(RIG), [parse_effect(text, RIG) for text in (*texts, spring)]).plant
    return bench_run(plant, rng=np.random.default_rng(4), seconds=9)


def fitted(log: Log, *causes: Cause) -> State:
    """Causes fitted without any search."""
    problem = Problem.of(gather(RIG, [log], DIAGNOSIS_BAND), reduce_parameters(RIG))
    return solve_causes(problem, causes, solve_causes(problem, causes))


def told(state: State) -> dict[str, Parameter]:
    return {p.name: p for cause in state.causes for p in estimate_figures(state, cause)}


@given(SEEDS)
def test_a_further_clustering_only_adds_doubt_and_the_order_of_rows_says_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    basis = orthonormal(seed, 60, 4)
    residual = rng.normal(size=60)
    labels = [rng.permutation(60) % 6 for _ in range(3)]
    first = cluster_covariance(basis, residual, labels[:1], 2)
    every = cluster_covariance(basis, residual, labels, 2)
    assert np.linalg.eigvalsh(every - first).min() > -1e-9 * np.trace(every)
    turn = rng.permutation(60)
    turned = cluster_covariance(basis[turn], residual[turn], [label[turn] for label in labels], 2)
    assert turned == pytest.approx(every, rel=1e-9)


def test_an_error_that_comes_back_with_the_angle_is_in_the_interval_of_bins_and_not_of_blocks() -> (
    None
):
    held = {"blocks": 0, "bins": 0}
    for seed in range(100):
        rng = np.random.default_rng(seed)
        angle = np.sin(2 * np.pi * np.arange(800) / 80 + rng.uniform(0, 6)) + 0.01 * rng.normal(
            size=800
        )
        waves = np.cos(np.outer(np.arange(3, 7), angle) + rng.uniform(0, 6, size=(4, 1)))
        target = rng.normal(size=4) @ waves + 0.1 * rng.normal(
            size=800
        )  # the slope's true value is zero
        basis = np.linalg.qr(np.stack([angle, np.ones(800)], axis=1))[0]
        slope = basis[:, 0] @ target
        residual = target - basis @ (basis.T @ target)
        block = np.arange(800) // 20
        bins = bin_rows(angle[:, None])
        for name, labels in (("blocks", [block]), ("bins", [block, bins])):
            held[name] += abs(slope) < 1.96 * np.sqrt(
                cluster_covariance(basis, residual, labels, 1)[0, 0]
            )
    assert held["blocks"] < 60 and held["bins"] > 75


def test_planted_figures_lie_in_their_intervals_over_several_seeds(log: Log) -> None:
    off = []
    width = []
    for seed in range(16):
        assert log.tau is not None
        noise = 0.02 * np.random.default_rng(seed).normal(size=log.tau.shape)
        said = told(
            fitted(
                replace(log, tau=log.tau + noise),
                COGGING,
                UNEVEN,
                CableSpring("tilt", stiffening=True),
            )
        )
        off += [abs(said[name].value - true) / said[name].std for name, true in PLANTED.items()]
        width += [said[name].std / true for name, true in PLANTED.items()]
    assert np.mean(np.array(off) < 1.96) > 0.9 and max(width) < 0.1


def test_of_two_shapes_of_which_only_the_product_matters_neither_has_a_deviation(log: Log) -> None:
    said = told(fitted(log, Backlash("pan", 0.01, 1e-3, 0.2)))
    assert (
        np.isnan(said["gap"].std) and np.isnan(said["inertia"].std) and said["rotor_share"].std > 0
    )
