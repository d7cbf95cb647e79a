"""The plants of scripts/plants.py: their inverse dynamics are the package's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from plants import PLANTS

from gimbal_pin.dynamics import nominal
from gimbal_pin.rig import Rig
from tests.mujoco_peer import rigid_bodies, torque


@pytest.mark.parametrize("name", PLANTS)
def test_inverse_dynamics_of_a_plant_are_those_of_its_urdf(name: str, tmp_path: Path) -> None:
    gimbal = PLANTS[name]
    rng = np.random.default_rng(0)
    (tmp_path / "plant.urdf").write_text(gimbal.write_urdf(payload=True))
    rig = Rig.load(str(tmp_path / "plant.urdf"))
    q, v, a = rng.uniform(-1, 1, (3, 20, len(gimbal.axes)))
    plant = rigid_bodies(etree.fromstring(gimbal.write_urdf(payload=True)))
    names = [each.name for each in gimbal.axes]
    assert list(rig.joints) == names
    np.testing.assert_allclose(
        torque(plant, names, q, v, a), nominal(rig).inverse(q, v, a), atol=1e-6
    )
