"""Laws of what is told: one state of a joint everywhere, and faults of the data before all physics."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis.pipeline import find_kept_log
from gimbal_pin.effects import Cogging
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import Opinion, judge_joint
from gimbal_pin.report.diagnosis_text import state_sizes
from tests.diagnosis.cases import TEETH, find, log_of


def test_no_poor_or_degraded_fit_is_explained() -> None:
    for fit, structured, lacks, worse in product(np.linspace(-50, 100, 61), *[(False, True)] * 3):
        state = judge_joint(float(fit), 0.9, structured, lacks, worse)
        if state in (Opinion.EXPLAINED, Opinion.NOISE_LEFT):
            assert fit > 50 and not structured and not worse
        assert state is not Opinion.EXPLAINED or fit > 90
        assert state.is_open == (state in (Opinion.STRUCTURE_LEFT, Opinion.NOT_EXPLAINED))
    for lost in ((np.nan, 0.9), (99.0, 0.0)):
        assert judge_joint(*lost, True, True, True) is Opinion.NOT_JUDGED


@pytest.mark.parametrize(
    ("urdf", "refitted", "extended", "better"),
    [(75, 60, 60, "URDF"), (75, 60, 95, ""), (30, 45, 45, ""), (40, 75, 60, "refitted")],
)
def test_a_joint_that_fitting_made_worse_is_open(
    urdf: float, refitted: float, extended: float, better: str
) -> None:
    clean = find("turret")
    held = clean.held_out
    assert held is not None
    fits = dict(urdf=urdf, refitted=refitted, extended=extended)
    errors = {
        name: replace(getattr(held, name), fit_percent={"pan": float(fit), "tilt": 99.0})
        for name, fit in fits.items()
    }
    found = replace(clean, held_out=replace(held, **errors))
    assert found.deteriorations.get("pan", "") == better
    assert found.opinions["pan"] is not Opinion.EXPLAINED or extended > 90


def test_the_errors_are_a_table_of_the_three_models() -> None:
    found = find("turret", *TEETH)
    told = found.to_dict()["held_out"]
    rows = found.errors.to_dict("records")
    models = ("urdf", "refitted", "extended")
    assert {(row["joint"], row["model"]) for row in rows} == {*product(("pan", "tilt"), models)}
    for row in rows:
        for name in ("torque_rmse", "fit_percent"):
            assert row[name] == told[row["model"]][name][row["joint"]]
    spoilt = replace(found, held_out=None).errors
    assert spoilt.empty and list(spoilt) == list(found.errors)


def test_a_joint_is_of_one_state_everywhere() -> None:
    for found in (find("turret"), find("turret", *TEETH)):
        stated = {joint: state.value for joint, state in found.opinions.items()}
        told = found.to_dict()["residual"]
        assert {joint: row["opinion"] for joint, row in told.items()} == stated
        assert found.unexplained == [j for j, x in found.opinions.items() if x.is_open]


def test_a_fault_of_the_data_comes_before_all_findings() -> None:
    fault = Fault("acceleration-noise", "tilt", "tilt: noise", (), 2.0, True, "record again")
    spoilt = replace(find("turret", *TEETH), faults=(fault,))
    causes = [one["cause"] for one in spoilt.to_dict()["findings"]]
    assert causes[0] == fault.cause and set(causes[1:]) == {"cogging", "stribeck"}


def test_a_held_out_log_is_the_one_that_was_asked_for() -> None:
    """Logs that are left out keep their numbers."""
    given = [replace(log_of(), name=f"{k}.csv") for k in range(3)]
    assert find_kept_log("log:3", given, given) == "log:3"
    assert find_kept_log("log:3", given, given[1:]) == "log:2"
    with pytest.raises(UsageError, match="left out"):
        find_kept_log("log:1", given, given[1:])


def test_of_several_harmonics_the_amplitudes_are_told() -> None:
    teeth = Cogging("pan", (7.0, 14.0))
    assert (
        state_sizes(teeth.shown([0.1, 0.0, 0.3, 0.0]))
        == "amplitude 0.3 N m at 14, 0.1 N m at 7 per turn"
    )
