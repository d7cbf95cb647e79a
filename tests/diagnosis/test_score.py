"""Laws of a cause's score and of its deviations: by blocks, by bins, whatever a column's size, joint and friction."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import perturbed
from gimbal_pin.diagnosis import Columns, Fit, diagnose, fit, gained, solve_causes
from gimbal_pin.diagnosis.uncertainty import estimate_figures
from gimbal_pin.dynamics import plant_with, reduce_parameters
from gimbal_pin.effects import (
    Backlash,
    Coulomb,
    parse_effect,
)
from gimbal_pin.identification import given_beta
from gimbal_pin.log import Array
from gimbal_pin.rig import make_generator
from tests.diagnosis.cases import few, log_of
from tests.refitted import ALIGNED, RIG, record, refit

ROWS = 1200
SEEDS = st.integers(0, 2**32 - 1)
BLOCK = np.arange(ROWS) * 40 // ROWS


def column(values: Array, joint: int | None = 0, shared: Array | None = None) -> Columns:
    """Columns without bounds, (rows, c) at a joint, or (rows, n, c) at all, of some cause."""
    wide = np.full(values.shape[-1], np.inf)
    count = 1 if joint is not None else values.shape[1]
    return Columns(Coulomb("any"), count, joint, values, -wide, wide, shared=shared)


@given(SEEDS, st.integers(1, 3), st.floats(-320.0, 5.0))
def test_a_columns_size_is_nothing_to_its_gain(seed: int, width: int, power: float) -> None:
    """Down to where it is none, and never with a warning: friction that dies away with speed leaves any size."""
    rng = np.random.default_rng(seed)
    now = fit(np.ones((ROWS, 1, 1)), rng.normal(size=(ROWS, 1)), np.ones(1), BLOCK)
    values = rng.normal(size=(ROWS, width))
    size = 10.0**power
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        scaled = gained(now, column(size * values), False)
    if size**2 * ROWS < 5e-25:
        assert scaled.gain == 0.0 and scaled.visible == 0.0
    elif size**2 * ROWS > 2e-24:
        whole = gained(now, column(values), False)
        assert scaled.gain == pytest.approx(whole.gain, rel=1e-6)


@given(SEEDS, st.integers(1, 4), st.integers(0, 1))
def test_a_column_at_one_joint_is_one_that_is_zero_at_the_others(
    seed: int, width: int, joint: int
) -> None:
    """Its gain is what least squares beside the fitted columns takes off the weighted sum of squares."""
    rng = np.random.default_rng(seed)
    base = rng.normal(size=(ROWS, 2, 3))
    own = rng.normal(size=(ROWS, width))
    now = fit(base, rng.normal(size=(ROWS, 2)) * [1.0, 3.0], np.ones(2), BLOCK)
    everywhere = np.zeros((ROWS, 2, width))
    everywhere[:, joint] = own
    here, all_over = (
        gained(now, one, False) for one in (column(own, joint), column(everywhere, None))
    )
    assert here.gain == pytest.approx(all_over.gain)
    assert here.visible == pytest.approx(all_over.visible)
    both = np.concatenate([now.stack, now.stacked(everywhere)], axis=1)
    theta, left, *_ = np.linalg.lstsq(both, now.target)
    assert here.gain == pytest.approx(now.cost - left[0])
    np.testing.assert_allclose(here.beta, theta[3:], rtol=1e-6)


# friction over part of a turn


@pytest.mark.parametrize("held", [10.0, -15.0])
def test_friction_over_the_angle_gains_the_same_however_much_coulomb_friction_it_holds(
    held: float,
) -> None:
    t = np.linspace(0.0, 60.0, ROWS)
    q = 0.8 * np.sin(t)
    slide = np.sign(np.cos(t))
    noise = 0.01 * np.random.default_rng(0).standard_normal(ROWS)
    torque = slide * (0.3 + 0.1 * np.cos(6 * q)) + noise
    base = np.stack([slide, 0.8 * np.cos(t)], axis=1)
    now: Fit = fit(base[:, None], torque[:, None], np.ones(1), BLOCK)

    def gain(more: float, shared: Array | None) -> float:
        own = (slide * (np.cos(6 * q) + more))[:, None]
        return gained(now, column(own, shared=shared), False).gain

    assert gain(held, slide) == pytest.approx(gain(0.0, slide)) == pytest.approx(gain(0.0, None))
    assert gain(held, None) == 0.0, "a torque of its own of that size works but against the model"


# deviations


def test_of_two_shapes_of_which_only_the_product_matters_neither_has_a_deviation() -> None:
    state = refit(log_of("nothing"))
    loose = solve_causes(state.problem, (Backlash("pan", 0.01, 1e-3, 0.2),), state)
    sizes = {p.name: p.std for p in estimate_figures(loose, loose.causes[0])}
    assert np.isnan(sizes["gap"]) and np.isnan(sizes["inertia"]) and sizes["rotor_share"] > 0


def test_the_extended_model_is_as_far_off_as_it_says() -> None:
    """Off by 1.5 of its deviations at most, root mean square; these are no less than the noise alone makes them."""
    true = perturbed(RIG, 0.1, make_generator(2)[0])
    cogging = parse_effect("cogging:pan:amplitude=0.03,harmonic=12", RIG)
    log = record(plant_with(true, [cogging]).plant, 2, 12.0, 5e-3, 4e-3)
    found = diagnose(RIG, log, few("cogging", "stribeck"), filtering=ALIGNED)
    known = found.after.estimated
    assert known is not None and found.state is not None
    friction = [x for term in true.terms for x in term.values]
    truth = np.concatenate([given_beta(true.rig, reduce_parameters(RIG)), friction])
    off = (known.theta[: len(truth)] - truth) / known.std[: len(truth)]
    assert np.sqrt(np.mean(off**2)) < 1.5
    assert np.all(known.std >= np.sqrt(np.diag(found.state.fit.covariance))[: len(known.std)])
