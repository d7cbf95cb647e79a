"""Files of controllers: what was found and tuned comes back from them; what is none is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimbal_pin.control import read_controller, stored, tune
from gimbal_pin.dynamics import Estimated, Model, Reference, nominal, plant_with, read_model_data
from gimbal_pin.effects import CableSpring, parse_effect
from gimbal_pin.errors import ModelError
from tests.rigs import bundled

FOUND = (
    "cogging:pan:amplitude=0.05,harmonic=12",
    "delay:tilt:time=0.004",
    "dead-zone:pan:width=0.02",
)


def find() -> Model:
    """Return a model with a cause of every kind, and with an uncertainty."""
    rig = bundled("turret")
    plant, drive = plant_with(nominal(rig), [parse_effect(text, rig) for text in FOUND])
    tilt = parse_effect("base-tilt:roll=0.2", rig)
    covariance = np.array([[4.0, 1.0], [1.0, 9.0]])
    known = Estimated(("a", "b"), ("kg", "N m"), np.array([1.0, 2.0]), covariance, dt=0.002)
    return replace(plant, rig=tilt.apply(rig), drive=drive, changes=(tilt,), estimated=known)


@pytest.mark.parametrize(
    "wish", [{"kind": "pid"}, {"robust": True}, {"bandwidth_hz": {"pan": 5.0, "tilt": 4.0}}]
)
def test_a_controller_comes_back_from_its_file(tmp_path: Path, wish: dict[str, Any]) -> None:
    """The same wish, the same torques sample by sample, what it compensates included."""
    tuning = tune(find(), **wish)
    tuning.save(tmp_path / "controller.yaml")
    back = read_controller(tmp_path / "controller.yaml", bundled("turret"))
    assert back.wish == tuning.wish
    assert back.model.estimated.covariance.tolist() == [[4.0, 1.0], [1.0, 9.0]]
    rng = np.random.default_rng(0)
    memory = again = back.law.start()
    for _ in range(5):
        q, v, e, a = 0.1 * rng.standard_normal((4, 2))
        reference = Reference(q + 0.1 * e, v + 0.1, a)
        torque, memory = tuning.controller.torque(0.0, q, v, reference, memory)
        repeated, again = back.law.torque(0.0, q, v, reference, again)
        np.testing.assert_array_equal(repeated, torque)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"wish": None}, "holds no controller"),
        ({"wish": {"bandwith": 3}}, "bandwith"),
        ({"controller": "pid"}, "the wish is for"),
        ({"joints": {"yaw": {}}}, "pan, tilt"),
        ({"model": {"phi": [1.0]}}, "model"),
        ({"kp": 1e-3, "ki": 1e6}, "unstable"),
    ],
)
def test_a_file_that_is_no_controller_is_refused(change: dict[str, Any], said: str) -> None:
    data = tune(nominal(bundled("turret"))).to_dict()
    if "kp" in change:
        change = {"joints": {**data["joints"], "pan": {**data["joints"]["pan"], **change}}}
    with pytest.raises(ModelError, match=said):
        stored({**data, **change}, bundled("turret"))


def test_a_model_whose_drive_holds_a_torque_effect_is_refused() -> None:
    data = {**find().to_dict(), "drive": [CableSpring("pan").to_dict()]}
    with pytest.raises(ModelError, match="belongs to the terms"):
        read_model_data(data, bundled("turret"))
