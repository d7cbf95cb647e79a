"""Physical consistency: every parameter set that comes out can exist, and is the nearest that does."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import perturbed
from gimbal_pin.dynamics import reduce_parameters
from gimbal_pin.errors import ModelError
from gimbal_pin.regression import find_nearest_bodies, map_phi_to_base
from gimbal_pin.rig import (
    Rig,
    bundled_rigs,
    is_physical,
    thicken_flat_body,
    to_pinocchio,
    to_urdf,
    urdf,
)
from tests.rigs import VARIETY, taken_by_all


def body(seed: int) -> np.ndarray:
    """A random cloud of ten point masses."""
    rng = np.random.default_rng(seed)
    mass = rng.uniform(0.1, 1.0, 10)
    at = 0.2 * rng.standard_normal((10, 3))
    whole = sum(
        (pin.Inertia(m, x, np.zeros((3, 3))).toDynamicParameters() for m, x in zip(mass, at)),
        np.zeros(10),
    )
    return np.array(whole)


@given(st.integers(0, 10**6))
def test_physical_is_what_the_triangle_inequality_says(seed: int) -> None:
    """At the centre of mass, the pseudo-inertia is positive exactly if the principal inertias obey the triangle."""
    phi = body(seed)
    inertia = pin.Inertia.FromDynamicParameters(phi)
    axes = np.linalg.eigh(inertia.inertia)[1]
    for third, expected in ((1.9, True), (2.1, False)):
        wrong = pin.Inertia(inertia.mass, inertia.lever, axes @ np.diag([1.0, 1.0, third]) @ axes.T)
        assert is_physical(np.array(wrong.toDynamicParameters())) is expected


def test_a_flat_plate_is_thickened_and_nonsense_refused() -> None:
    plate = np.array(pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 2.0])).toDynamicParameters())
    assert not is_physical(plate) and is_physical(thicken_flat_body(plate))
    assert np.abs(thicken_flat_body(plate) - plate).max() < 1e-5
    with pytest.raises(ModelError):
        thicken_flat_body(-body(0))


@pytest.mark.parametrize("name", bundled_rigs())
def test_what_is_physical_stays(name: str) -> None:
    """The true base parameters of another physical rig are reached to a billionth of their deviations."""
    rig = Rig.load(name)
    mixing = map_phi_to_base(Rig.load(name), reduce_parameters(Rig.load(name)))
    other = perturbed(rig, 0.1, np.random.default_rng(1)).rig.phi
    beta = mixing @ other
    found = find_nearest_bodies(rig.phi, mixing, beta, np.diag((1e-3 * np.abs(beta) + 1e-6) ** 2))
    assert is_physical(found.phi) and found.distance < 1e-3


@pytest.mark.parametrize(("name", "payload"), VARIETY)
def test_the_urdf_lumps_to_what_was_identified(name: str, payload: str) -> None:
    """Pinocchio, yourdfpy and MuJoCo read it; every tag but the inertials is as it was."""
    rig = Rig.load(name, payload)
    wanted = perturbed(rig, 0.2, np.random.default_rng(2)).rig.phi
    text = to_urdf(rig, wanted)
    model = to_pinocchio(text, "written")
    lumped = np.concatenate([inertia.toDynamicParameters() for inertia in model.inertias[1:]])
    assert np.allclose(lumped, wanted, rtol=1e-9, atol=1e-12)
    urdf.load_checked(text, "written")
    assert taken_by_all(text, rig.n)

    def outline(source: str) -> list[tuple[str, tuple[tuple[str, str], ...]]]:
        tree = urdf.parse_robot(source, "outline")
        kept = [
            e
            for e in tree.iter()
            if not any(up.tag == "inertial" for up in (e, *e.iterancestors()))
        ]
        return [(str(e.tag), tuple(e.attrib.items())) for e in kept]

    assert outline(text) == outline(rig.urdf)
