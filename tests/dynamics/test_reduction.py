"""Base parameters: the thesis's table, and the laws that any reduction obeys."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import (
    Reduction,
    build_friction_effects,
    compute_regressor,
    compute_rnea,
    name_columns,
    reduce_parameters,
    scan_columns,
    spread_states,
    stack_regressors,
)
from gimbal_pin.rig import Rig, bundled_payloads, bundled_rigs
from tests.rigs import BODY, bundled, spelled

TABLE = (
    {"spine.Iyy": 1, "fork.Izz": 1},
    {"fork.Ixx": 1, "fork.Izz": -1, "cradle.Izz": 1},
    {"fork.Iyy": 1, "cradle.Izz": 1},
    {"fork.mx": 1},
    {"fork.mz": 1, "cradle.my": 1},
    {"cradle.Ixx": 1, "cradle.Izz": -1},
    {"cradle.Iyy": 1},
    {"cradle.mx": 1},
    {"cradle.mz": 1},
)
"""Bodies 1, 2, 3 are spine, fork, cradle; friction stands by itself."""

ZERO = ("spine.Ixx", "spine.Izz", "spine.mx", "spine.my", "spine.mz", "fork.my")
"""(4.33)."""

JOINT = (
    '<joint name="to_{2}" type="{0}"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/><axis xyz="{4}"/>'
    '<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'
)
ODD = {
    "slide": (("prismatic", "base", "a", "0 0 0", "0 0 1"),),
    "wheel": (("continuous", "base", "a", "0 0 0", "0 0 1"),),
    "pendulum": (("revolute", "base", "a", "0 0 0", "0 1 0"),),
    "double-pendulum": (
        ("revolute", "base", "a", "0 0 0", "0 1 0"),
        ("revolute", "a", "b", "0 0 -0.3", "0 1 0"),
    ),
    "crane": (
        ("revolute", "base", "a", "0 0 0", "0 0 1"),
        ("prismatic", "a", "b", "0 0 0.4", "1 0 0"),
        ("continuous", "b", "c", "0.2 0 0", "0 1 1"),
    ),
    "tree": (
        ("revolute", "base", "a", "0 0 0", "0 0 1"),
        ("revolute", "a", "b", "0.3 0 0", "1 1 0"),
        ("revolute", "a", "c", "-0.3 0 0", "0 1 0"),
        ("prismatic", "c", "d", "0 0.1 0", "0.3 0.4 0.5"),
    ),
}
"""Rigs that are no gimbals."""


def odd(name: str) -> Rig:
    links = "".join(
        BODY.format(child, mass) for mass, (_, _, child, _, _) in enumerate(ODD[name], start=1)
    )
    body = "".join(JOINT.format(*joint) for joint in ODD[name])
    return spelled(f'<robot name="{name}"><link name="base"/>{links}{body}</robot>')


# --- the thesis's table ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("payload", bundled_payloads())
def test_thesis_table_exactly_whatever_the_payload(payload: str) -> None:
    rig = bundled("thesis", payload)
    reduction = reduce_parameters(rig, diagonal=True)
    assert reduction.unidentifiable == ZERO
    assert tuple(dict(terms) for terms in reduction.terms) == TABLE
    friction = sum(len(effect.coefficients) for effect in build_friction_effects(rig.joints))
    assert len(reduction.names) + friction == 24
    assert len(reduction.independent) + friction == 15


def test_full_inertias_regroup_the_diagonal_ones_alike() -> None:
    """The products of inertia join the table; they change nothing of what stands in it."""
    diagonal, full = (reduce_parameters(bundled("thesis"), d) for d in (True, False))
    kept = [
        {name: x for name, x in terms.items() if name in diagonal.names} for terms in full.terms
    ]
    assert [terms for terms in kept if terms] == list(TABLE)


@pytest.mark.parametrize(
    ("gravity", "full", "diagonal"), [((0, 0, -9.81), 15, 9), ((3, -4, -8), 17, 11)]
)
def test_counts_of_the_thesis_rig_upright_and_tilted(
    gravity: tuple[float, float, float], full: int, diagonal: int
) -> None:
    """15 / 9 on an upright base; one static tilt adds 2, for gravity then reaches the first axis."""
    rig = bundled("thesis")
    model = rig.model.copy()
    model.gravity.linear = np.array(gravity, dtype=float)
    tilted = replace(rig, model=model)
    assert len(reduce_parameters(tilted).independent) == full
    assert len(reduce_parameters(tilted, diagonal=True).independent) == diagonal


def test_textbook_counts_and_levers() -> None:
    """A body on a vertical rail shows its mass, on a vertical axle its inertia; a pendulum its gravity too."""
    assert reduce_parameters(odd("slide")).base_names == ("a.m",)
    assert reduce_parameters(odd("wheel")).base_names == ("a.Izz",)
    assert reduce_parameters(odd("pendulum")).base_names == ("a.Iyy", "a.mx", "a.mz")
    first, _, third, *second = reduce_parameters(odd("double-pendulum")).terms
    assert first == pytest.approx({"a.Iyy": 1, "b.m": 0.3**2}, abs=1e-9)
    assert third == pytest.approx({"a.mz": 1, "b.m": -0.3}, abs=1e-9)
    assert second == [{"b.Iyy": 1}, {"b.mx": 1}, {"b.mz": 1}]


# --- every rig ------------------------------------------------------------------------------------------------------


def all_rigs() -> list[Rig]:
    return [*(bundled(name) for name in bundled_rigs()), *map(odd, ODD)]


def fresh(rig: Rig, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States that no reduction has seen."""
    draw = np.random.default_rng(seed).uniform(-1, 1, (3, 40, rig.n))
    return np.pi * draw[0], 4 * draw[1], 30 * draw[2]


def subspace(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the identifiable combinations by SVD (Gautier 1991), (p, rank)."""
    scale = np.linalg.norm(matrix, axis=0).max() or 1.0
    _, values, right = np.linalg.svd(matrix / scale, full_matrices=False)
    return np.asarray(right[values > 1e-8 * values[0]].T)


def spans_agree(reduction: Reduction, matrix: np.ndarray) -> None:
    """The rows of the mixing and the SVD's right vectors span one space, of one dimension."""
    basis = subspace(matrix)
    assert basis.shape[1] == len(reduction.independent)
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-10)
    mixing = reduction.mixing / np.linalg.norm(reduction.mixing, axis=1, keepdims=True)
    np.testing.assert_allclose(mixing @ basis @ basis.T, mixing, atol=1e-6)


def test_regressor_times_parameters_is_rnea() -> None:
    for rig in all_rigs():
        at = fresh(rig, 1)
        torque = compute_rnea(rig, *at)
        np.testing.assert_allclose(
            compute_regressor(rig, *at) @ rig.phi, torque, atol=1e-10 * np.abs(torque).max()
        )


@pytest.mark.parametrize("diagonal", [False, True])
def test_base_parameters_predict_the_same_torque_for_any_bodies(diagonal: bool) -> None:
    for rig in all_rigs():
        reduction = reduce_parameters(rig, diagonal)
        names, places = name_columns(rig, diagonal)
        Y = compute_regressor(rig, *fresh(rig, 2))[:, :, places]
        assert reduction.names == names
        for phi in np.random.default_rng(3).normal(size=(5, len(places))):
            expected = Y @ phi
            kept = Y[:, :, list(reduction.independent)] @ (reduction.mixing @ phi)
            np.testing.assert_allclose(kept, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("diagonal", [False, True])
def test_qr_and_svd_see_the_same_space(diagonal: bool) -> None:
    for rig in all_rigs():
        spans_agree(reduce_parameters(rig, diagonal), stack_regressors(rig, diagonal)[0])


def test_reduction_depends_on_the_rig_alone() -> None:
    for name in bundled_rigs():
        first, *others = [
            reduce_parameters(bundled(name, payload)) for payload in (*bundled_payloads(), None)
        ]
        for other in others:
            assert (other.names, other.independent, other.zero) == (
                first.names,
                first.independent,
                first.zero,
            )
            np.testing.assert_array_equal(other.mixing, first.mixing)


@pytest.mark.parametrize("name", bundled_rigs())
def test_reduction_holds_on_motions_that_it_was_not_made_from(name: str) -> None:
    rig = bundled(name)
    names, places = name_columns(rig)
    matrix = compute_regressor(rig, *fresh(rig, 4))[:, :, places].reshape(-1, len(places))
    ours = reduce_parameters(rig)
    other = scan_columns(matrix, names)
    assert (ours.independent, ours.zero) == (other.independent, other.zero)
    np.testing.assert_allclose(ours.mixing, other.mixing, atol=1e-7)


def test_samples_fill_the_state_space() -> None:
    """Kronecker points are even: any box holds about its share, so no channel follows another."""
    q, v, a = spread_states(bundled("thesis"), 1000)
    unit = np.column_stack([q / (2 * np.pi), v / 10, a / 50])
    assert np.abs(unit).max() <= 0.5
    np.testing.assert_allclose(unit.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose(np.corrcoef(unit.T), np.eye(unit.shape[1]), atol=0.1)


@pytest.mark.parametrize("diagonal", [False, True])
def test_no_factor_is_left_over_from_rounding(diagonal: bool) -> None:
    """Levers are centimetres and more: a factor of a millionth, or one that misses 1 by a millionth, is noise."""
    for rig in all_rigs():
        sizes = np.abs(reduce_parameters(rig, diagonal).mixing)
        assert not ((sizes > 0) & (sizes < 1e-6)).any()
        assert not ((sizes != 1) & (np.abs(sizes - 1) < 1e-6)).any()


def test_names_say_the_mixing() -> None:
    """Read back as sums, the names give the base parameters' values."""
    for rig in all_rigs():
        reduction = reduce_parameters(rig)
        phi = rig.phi[name_columns(rig)[1]]
        values = dict(zip(reduction.names, phi))
        for name, beta in zip(reduction.base_names, reduction.mixing @ phi):
            words = re.findall(r"(-?)\s?(?:([\d.e+-]+)\*)?([a-z_]+\.\w+)", name)
            read = sum(
                (-1 if sign else 1) * float(factor or 1) * values[of] for sign, factor, of in words
            )
            assert read == pytest.approx(beta, rel=1e-4, abs=1e-5)


# --- any matrix -----------------------------------------------------------------------------------------------------


@st.composite
def planted(draw: st.DrawFn) -> tuple[np.ndarray, list[int], list[int], np.ndarray]:
    """A matrix whose dependent columns are sums of independent ones to their left; the truth beside it."""
    kinds = draw(
        st.lists(st.sampled_from(["free", "free", "sum", "zero"]), min_size=1, max_size=12)
    )
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rows = 4 * len(kinds) + 8
    free = [j for j, kind in enumerate(kinds) if kind == "free"]
    mixing = np.zeros((len(free), len(kinds)))
    for j, kind in enumerate(kinds):
        if kind == "free":
            mixing[free.index(j), j] = 1.0
        elif kind == "sum":
            earlier = [row for row, column in enumerate(free) if column < j]
            mixing[earlier, j] = rng.choice([-1, 1], len(earlier)) * rng.uniform(
                0.1, 10, len(earlier)
            )
    zero = [j for j in range(len(kinds)) if not mixing[:, j].any()]
    return rng.normal(size=(rows, len(free))) @ mixing, free, zero, mixing


@given(planted())
def test_planted_dependence_is_found(
    case: tuple[np.ndarray, list[int], list[int], np.ndarray],
) -> None:
    matrix, free, zero, mixing = case
    reduction = scan_columns(matrix, tuple(f"x{j}" for j in range(matrix.shape[1])))
    assert reduction.independent == tuple(free)
    assert reduction.zero == tuple(zero)
    np.testing.assert_allclose(reduction.mixing, mixing, atol=1e-6)
    np.testing.assert_allclose(matrix[:, free] @ reduction.mixing, matrix, atol=1e-6)
    if free:
        spans_agree(reduction, matrix)


@given(st.integers(1, 15), st.integers(0, 2**32 - 1))
def test_full_rank_reduces_to_itself(p: int, seed: int) -> None:
    matrix = np.random.default_rng(seed).normal(size=(3 * p + 5, p))
    reduction = scan_columns(matrix, tuple(f"x{j}" for j in range(p)))
    assert reduction.independent == tuple(range(p))
    assert reduction.zero == ()
    np.testing.assert_array_equal(reduction.mixing, np.eye(p))
    assert reduction.base_names == reduction.names
    assert subspace(matrix).shape == (p, p)


@given(st.integers(0, 2**32 - 1))
def test_units_of_the_columns_do_not_choose_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, names = stack_regressors(bundled("thesis"))
    scale = 10.0 ** rng.uniform(-2, 2, len(names))
    ours = scan_columns(matrix, names)
    scaled = scan_columns(matrix * scale, names)
    assert (ours.independent, ours.zero) == (scaled.independent, scaled.zero)
    free = list(ours.independent)
    np.testing.assert_allclose(scaled.mixing * scale[free, None] / scale, ours.mixing, atol=1e-4)


@pytest.mark.parametrize("name", bundled_rigs())
def test_a_reduced_regressor_is_its_own_reduction(name: str) -> None:
    matrix, names = stack_regressors(bundled(name))
    free = list(reduce_parameters(bundled(name)).independent)
    again = scan_columns(matrix[:, free], tuple(names[j] for j in free))
    assert again.independent == tuple(range(len(free)))
    np.testing.assert_array_equal(again.mixing, np.eye(len(free)))
