"""Laws of the extended model's deviations: they hold the truth, and more than what is left over looks like."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin import bench_run, diagnose
from gimbal_pin.control import perturbed
from gimbal_pin.dynamics import plant_with, reduce_parameters
from gimbal_pin.effects import parse_effect
from gimbal_pin.identification import given_beta
from gimbal_pin.rig import Rig, make_generator


@pytest.mark.parametrize("rig", ["turret", "thesis"])
def test_the_extended_model_is_as_far_off_as_it_says(rig: str) -> None:
    """Off by 1.5 of its deviations at most, root mean square; these are no less than the noise alone makes them."""
    given = Rig.load(rig)
    joint, *_ = given.joints
    true = perturbed(given, 0.1, make_generator(2)[0])
    plant = plant_with(
        true, [parse_effect(f"cogging:{joint}:amplitude=0.03,harmonic=12", given)]
    ).plant
    found = diagnose(given, [bench_run(plant, rng=2, seconds=25.0)], rng=0)
    known = found.after.estimated
    fit = found.state
    assert known is not None and fit is not None
    reduction = reduce_parameters(given)
    friction = [x for term in true.terms for x in term.values]
    truth = np.concatenate([given_beta(true.rig, reduction), friction])
    off = (known.theta[: len(truth)] - truth) / known.std[: len(truth)]
    assert np.sqrt(np.mean(off**2)) < 1.5
    assert np.all(known.std >= np.sqrt(np.diag(fit.fit.covariance))[: len(known.std)])
    assert len(known.lag_std) == given.n and min(known.lag_std) > 0 and max(known.lag_std) < 1e-3
