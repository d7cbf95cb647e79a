"""Laws of the base parameters.

They are the thesis's table and the textbook's; they span what the SVD of the regressor spans, whatever the motion and
the payload; they predict the torque of any bodies; and what is planted in a matrix is found.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import (
    compute_base,
    compute_regressor,
    name_columns,
    reduce_parameters,
    scan_columns,
    stack_regressors,
)
from gimbal_pin.log import Array, BaseMotion, Platform
from gimbal_pin.log.platform import BASE_MOTIONS
from tests.dynamics.odd_rigs import known, odd
from tests.rigs import bundled

TABLE = (
    "spine.Iyy + fork.Izz",
    "fork.Ixx - fork.Izz + cradle.Izz",
    "fork.Iyy + cradle.Izz",
    "fork.mx",
    "fork.mz + cradle.my",
    "cradle.Ixx - cradle.Izz",
    "cradle.Iyy",
    "cradle.mx",
    "cradle.mz",
)
"""Bodies 1, 2, 3 are spine, fork, cradle; friction stands by itself."""
ZERO = ("spine.Ixx", "spine.Izz", "spine.mx", "spine.my", "spine.mz", "fork.my")
"""(4.33)."""


def measure_subspace(matrix: Array) -> Array:
    """Return the projector on the identifiable combinations by SVD (Gautier 1991), (p, p)."""
    _, values, right = np.linalg.svd(matrix, full_matrices=False)
    basis = right[values > 1e-8 * values[0]]
    return basis.T @ basis


def test_thesis_table_and_its_count_with_friction_whatever_the_payload() -> None:
    for payload in ("none", "cinema"):
        base = compute_base(bundled("thesis", payload), diagonal=True)
        assert base.unidentifiable == ZERO
        assert base.names[:9] == TABLE
        assert (base.parameters, len(base.terms)) == (24, 15)


def test_textbook_base_parameters_and_levers() -> None:
    """A body on a vertical rail shows its mass, on a vertical axle its inertia; a pendulum its gravity too."""
    assert reduce_parameters(odd("slide")).base_names == ("a.m",)
    assert reduce_parameters(odd("wheel")).base_names == ("a.Izz",)
    assert reduce_parameters(odd("pendulum")).base_names == ("a.Iyy", "a.mx", "a.mz")
    two = ("a.Iyy + 0.09*b.m", "a.mx", "a.mz - 0.3*b.m", "b.Iyy", "b.mx", "b.mz")
    assert reduce_parameters(odd("double-pendulum")).base_names == two


@pytest.mark.parametrize("base", BASE_MOTIONS)
@pytest.mark.parametrize(
    ("name", "diagonal"),
    [("thesis", True), ("turret", False), ("handheld", False), ("crane", False), ("tree", False)],
)
def test_base_parameters_span_what_the_svd_does_and_predict_the_torque_of_any_bodies(
    name: str, base: BaseMotion, diagonal: bool
) -> None:
    """On other motions than they were made from; one lean and turning in place show as much as any."""
    rig = known(name)
    reduction = reduce_parameters(rig, diagonal, base)
    mixing = reduction.mixing
    matrix, names = stack_regressors(rig, diagonal, base)
    projector = measure_subspace(matrix)
    np.testing.assert_array_equal(mixing[:, list(reduction.independent)], np.eye(len(mixing)))
    assert np.trace(projector) == pytest.approx(len(reduction.independent))
    np.testing.assert_allclose(mixing @ projector, mixing, atol=1e-6 * np.abs(mixing).max())

    rng = np.random.default_rng(2)
    draw = rng.uniform(-3, 3, (3, 200, rig.n))
    t = np.arange(200.0)
    zero = np.zeros((200, 3))
    lean = Platform.still(t, 0.4, 0.3)
    turning = Platform.turning(t, *rng.uniform(-1, 1, (3, 200, 3)), zero)
    platform = {"fixed": None, "tilted": lean, "rotating": turning}[base]
    places = name_columns(rig, diagonal)[1]
    Y = compute_regressor(rig, *draw, platform, places)
    for phi in rng.normal(size=(3, len(places))):
        expected = Y @ phi
        kept = Y[:, :, list(reduction.independent)] @ (mixing @ phi)
        np.testing.assert_allclose(kept, expected, rtol=0, atol=1e-7 * np.abs(expected).max())
    again = scan_columns(Y.reshape(-1, len(places)), names)
    assert (again.independent, again.zero) == (reduction.independent, reduction.zero)


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_planted_dependence_is_found_whatever_the_units(seed: int, width: int) -> None:
    """Dependent columns are sums of independent ones to their left; units scale all columns."""
    rng = np.random.default_rng(seed)
    kinds = rng.choice(["free", "free", "sum", "zero"], width)
    free = np.flatnonzero(kinds == "free")
    mixing = (kinds == "sum") * (free[:, None] < np.arange(width)) * rng.uniform(-3, 3, width)
    mixing[:, free] = np.eye(len(free))
    units = 10.0 ** rng.uniform(-2, 2, width)
    matrix = rng.normal(size=(4 * width + 8, len(free))) @ mixing * units
    found = scan_columns(matrix, tuple(map(str, range(width))))
    assert found.independent == tuple(free)
    assert found.zero == tuple(np.flatnonzero(~mixing.any(axis=0)))
    planted = mixing * units / units[free, None]
    np.testing.assert_allclose(found.mixing, planted, rtol=1e-6, atol=1e-10)
