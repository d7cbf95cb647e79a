"""What a log of a rig that was shaken by hand teaches."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin.dynamics import Model, name_columns, nominal, reduce_parameters
from gimbal_pin.identification import compare_payload, identify
from gimbal_pin.log import Log
from gimbal_pin.pointing import simulate_shaken_log, unbalance_payload
from gimbal_pin.report import show_parameters
from gimbal_pin.rig import Rig

DT = 1e-3


@pytest.fixture(scope="module")
def shaken() -> tuple[Rig, Model, Log]:
    """A rig, its plant, and 12 s of it on a base that is shaken by hand."""
    rig = Rig.load("thesis")
    plant = nominal(unbalance_payload(rig))
    return rig, plant, simulate_shaken_log(plant, seconds=12.0)


def test_a_shaken_log_is_used_as_far_as_it_tells(shaken: tuple[Rig, Model, Log]) -> None:
    """Every deviation is within 1.5 times the bound, by the filter that such a log gets; and none is surely under it.

    Deviations scatter as those of a joint's noise, which its share of the rows' degrees of freedom tells: 1/√(2 ν).
    """
    rig, _, log = shaken
    found = identify(rig, [log], holdout="none", examined="noisy")
    assert found.filtering.cutoff == 12.0 and found.bound is not None
    assert (found.estimate.std < 1.5 * found.bound).all()
    freedom = (found.estimate.rows - len(found.names)) / rig.n
    assert (found.estimate.std > (1 - 3 / np.sqrt(2 * freedom)) * found.bound).all()
    told = show_parameters(found, compare_payload(found)).to_text()
    assert "± at best" in told and "for they are small: " in told
    assert found.to_dict()["least_std"][found.names[0]] == found.bound[0]


def test_a_shaken_log_shows_what_a_base_at_rest_hides(shaken: tuple[Rig, Model, Log]) -> None:
    """The six parameters that only a moving base shows, from 12 s of profile S at half size.

    As a group they are within 10 % of their norm. One by one, 10 % is asked of those alone that such a log shows to a
    twentieth: half of them are near zero on a rig drawn symmetric; all are told to within their own deviations.
    """
    rig, plant, log = shaken
    model = identify(rig, [log], holdout="none").model
    shows = reduce_parameters(rig, base="rotating")
    fixed = reduce_parameters(rig, base="fixed").mixing
    (_, places) = name_columns(rig)
    true = shows.mixing @ plant.rig.phi[places]
    found = shows.mixing @ model.rig.phi[places]
    seen = np.linalg.pinv(fixed) @ fixed
    new = [k for k, row in enumerate(shows.mixing) if np.linalg.norm(row - row @ seen) > 1e-6]
    assert len(new) == 6
    std = model.estimated.std[: len(true)]
    assert np.abs((found - true)[new] / std[new]).max() < 4
    clear = [k for k in new if std[k] < 0.05 * abs(true[k])]
    assert clear and np.abs(found[clear] / true[clear] - 1).max() < 0.1
    change = np.linalg.pinv(shows.mixing) @ (found - true)
    whole = np.linalg.pinv(shows.mixing) @ true
    hidden = np.eye(len(seen)) - seen
    assert np.linalg.norm(hidden @ change) < 0.1 * np.linalg.norm(hidden @ whole)
