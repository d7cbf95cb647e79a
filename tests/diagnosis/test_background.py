"""Laws of what no cause explains: it has no name, and is carried as far as it is known, where the log went."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.control import bench_run, track, tune
from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.dynamics import Model, nominal
from gimbal_pin.effects import CAUSES, Sample, Term, TorqueTable
from gimbal_pin.identification import read_model, write_extended
from gimbal_pin.log import Array
from gimbal_pin.rig import Rig

NOTCH = np.radians(np.arange(10.0, 20.1, 0.5))
DETENT = Term(
    TorqueTable("pan", "angle", tuple(NOTCH)),
    tuple(0.05 * np.sin(np.pi * np.linspace(0, 1, 21)) ** 2),
)


def torque(term: Term, angles: Array) -> Array:
    zero = np.zeros(len(angles))
    return np.asarray(term.torque(Sample(zero, angles, zero, zero, zero, zero)))


@pytest.fixture(scope="module")
def plant() -> Model:
    """A turret whose pan goes over a detent between 10° and 20°."""
    model = nominal(Rig.load("turret"))
    return replace(model, terms=(*model.terms, DETENT))


@pytest.fixture(scope="module")
def found(plant: Model) -> Diagnosis:
    log = bench_run(plant, rng=np.random.default_rng(0), seconds=40)
    return diagnose(plant.rig, [log], {"cogging": CAUSES["cogging"]}, rng=1)


def test_a_detent_has_no_name_and_its_curve_lies_within_its_band(found: Diagnosis) -> None:
    curve = found.residual["pan"].curve
    assert found.verdict == "unknown" and curve is not None and curve.over == "angle"
    size = np.array(curve.torque)
    knots = np.array(curve.knots)
    assert NOTCH[0] < knots[np.argmax(np.abs(size))] < NOTCH[-1]
    assert any(low < NOTCH[10] < high for low, high in curve.acts)
    inside = np.abs(size - torque(DETENT, knots)) < 2 * np.array(curve.std)
    assert np.mean(inside) > 0.85
    assert found.residual["tilt"].curve is None


def test_a_table_says_nothing_where_the_log_did_not_go(found: Diagnosis) -> None:
    (carried,) = (term for term in found.after.terms if isinstance(term.effect, TorqueTable))
    knots = np.array(carried.effect.knots)
    assert knots[0] < NOTCH[0] and NOTCH[-1] < knots[-1]
    step = knots[1] - knots[0]
    assert not torque(carried, np.array([knots[0] - step, knots[-1] + step, -9.0, 9.0])).any()
    assert np.abs(torque(carried, np.linspace(-9.0, 9.0, 500))).max() < 0.1


def test_a_model_with_a_table_is_read_as_it_was_written(found: Diagnosis, tmp_path: Path) -> None:
    write_extended(found.after, tmp_path / "extended.yaml")
    again = read_model(tmp_path / "extended.yaml", found.after.rig)
    assert again.terms == found.after.terms
    assert again.estimated is not None and found.after.estimated is not None
    np.testing.assert_allclose(again.estimated.std, found.after.estimated.std)
    assert again.estimated.dt == found.after.estimated.dt == 0.001


def test_a_controller_with_a_table_follows_as_one_that_knows_the_detent(
    found: Diagnosis, plant: Model
) -> None:
    models = {"table": found.after, "known": plant}
    laws = {
        name: tune(model, bandwidth_hz=4.0, dt=0.004).controller for name, model in models.items()
    }
    laws["pid"] = tune(found.after, bandwidth_hz=4.0, dt=0.004, kind="pid").controller
    done = dict.fromkeys(laws, 0.0)
    for one in track(plant, laws, rng=np.random.default_rng(0)).experiments:
        done[one.controller] += one.joints["pan"].rms_error
    assert done["table"] < 1.1 * done["known"] and done["table"] < 0.5 * done["pid"]


def test_a_table_of_the_load_reads_the_load_and_one_within_a_turn_closes() -> None:
    ring = Term(
        TorqueTable("pan", "angle", tuple(np.arange(8) * np.pi / 4), cyclic=True), tuple(range(8))
    )
    turn = np.linspace(-20.0, 20.0, 300)
    np.testing.assert_allclose(torque(ring, turn), torque(ring, turn + 2 * np.pi), atol=1e-6)
    load = Term(TorqueTable("pan", "load", (-1.0, 0.0, 1.0)), (2.0, 0.0, 4.0))
    assert load.effect.loaded and not ring.effect.loaded
    assert [load.torque(Sample(0.0, 9.0, 9.0, 9.0, 1.0, tau)) for tau in (-0.5, 0.25, 5.0)] == [
        1.0,
        1.0,
        0.0,
    ]
