"""Physical consistency: parameters that a body can have stay, others are refused or mended to the nearest that can."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from gimbal_pin.control import perturbed
from gimbal_pin.errors import ModelError
from gimbal_pin.rig import is_physical, thicken_flat_body, to_pinocchio, to_urdf
from tests.rigs import bundled, taken_by_all


def test_physical_is_what_the_triangle_inequality_says_and_a_flat_plate_is_thickened() -> None:
    """At the centre of mass the pseudo-inertia is positive exactly if the principal inertias obey the triangle."""
    axes = pin.exp3(np.array([0.3, -0.5, 0.7]))
    for third, expected in ((1.9, True), (2.0, False), (2.1, False)):
        inertia = axes @ np.diag([1.0, 1.0, third]) @ axes.T
        phi = pin.Inertia(0.7, np.array([0.1, -0.2, 0.3]), inertia).toDynamicParameters()
        assert is_physical(phi) is expected
        if third <= 2:
            thick = thicken_flat_body(phi)
            assert is_physical(thick) and np.abs(thick - phi).max() < 1e-5
    with pytest.raises(ModelError):
        thicken_flat_body(-phi)


@pytest.mark.parametrize(("name", "payload"), [("thesis", "cinema"), ("drone", "infrared")])
def test_a_written_urdf_lumps_to_what_was_identified(name: str, payload: str) -> None:
    """Pinocchio, yourdfpy and MuJoCo read it."""
    rig = bundled(name, payload)
    wanted = perturbed(rig, 0.2, np.random.default_rng(2)).rig.phi
    text = to_urdf(rig, wanted)
    lumped = [body.toDynamicParameters() for body in to_pinocchio(text, "written").inertias[1:]]
    np.testing.assert_allclose(np.concatenate(lumped), wanted, rtol=1e-9, atol=1e-12)
    assert taken_by_all(text, rig.n)
