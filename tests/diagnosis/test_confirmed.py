"""Laws of the reporting part: a cause that it speaks against is left out, and what it stood for is unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.control import bench_run
from gimbal_pin.diagnosis import DIAGNOSIS_BAND, confirm_causes, explain, gather
from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.effects import CAUSES, Cogging, Term
from gimbal_pin.rig import Rig


def test_a_cause_that_unseen_data_deny_is_left_out_and_its_joint_is_unknown() -> None:
    rig = Rig.load("turret")
    smooth = nominal(rig)
    cogging = replace(smooth, terms=(*smooth.terms, Term(Cogging("pan", (7.0,)), (0.05, 0.0))))
    train, alike, other = (
        gather(rig, [bench_run(plant, rng=np.random.default_rng(seed), seconds=30)], DIAGNOSIS_BAND)
        for seed, plant in enumerate((cogging, cogging, smooth))
    )
    found = explain(train, reduce_parameters(rig), {"cogging": CAUSES["cogging"]})
    kept = confirm_causes(found, alike)
    assert kept.found is found and not kept.denied
    assert kept.figures["torque_rmse"]["pan"] < 0.1 * kept.baseline["torque_rmse"]["pan"]
    refuted = confirm_causes(found, other)
    assert refuted.found.final.causes == () and refuted.found.structured == (True, False)
    assert refuted.figures == refuted.baseline
    (said,) = refuted.denied
    assert said.startswith("pan: cogging") and "is left out" in said


@pytest.mark.parametrize(("amplitude", "is_left"), [(0.0015, False), (0.004, True)])
def test_what_a_denied_cause_leaves_is_unknown_if_it_is_more_than_an_error_of_form(
    amplitude: float, is_left: bool
) -> None:
    """Half a per cent of the torque, as every rigid model is off by: nothing is left of a cause that holds less."""
    smooth = nominal(Rig.load("turret"))
    cogging = replace(smooth, terms=(*smooth.terms, Term(Cogging("pan", (7.0,)), (amplitude, 0.0))))
    train, other = (
        gather(
            smooth.rig,
            [bench_run(plant, rng=np.random.default_rng(seed), seconds=30)],
            DIAGNOSIS_BAND,
        )
        for seed, plant in enumerate((cogging, smooth))
    )
    found = explain(train, reduce_parameters(smooth.rig), {"cogging": CAUSES["cogging"]})
    refuted = confirm_causes(found, other).found
    assert [cause.name for cause in found.final.causes] == [
        "cogging"
    ] and refuted.final.causes == ()
    assert refuted.structured == (is_left, False)
