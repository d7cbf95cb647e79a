"""Laws of the inner products of columns without what free columns and a background explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.regression import Gram, JointRows, project_rows

SIZE = 0.3
WIDTH = 7
PLACES = ([0, 1, 6], [2, 0], [3, 4, 5, 0])
"""Which columns are not zero at each of three joints: the first is felt by all."""


@pytest.fixture(scope="module")
def rows() -> list[JointRows]:
    """Rows of three joints of different lengths and with different backgrounds."""
    rng = np.random.default_rng(1)
    out = []
    for n, z, places in zip((40, 50, 60), (8, 0, 12), PLACES):
        torque, *parts = (rng.normal(size=(n, width)) for width in (1, len(places), 4, z, 2))
        out.append(JointRows(torque[:, 0], parts[0], np.array(places), *parts[1:]))
    return out


def stack(rows: list[JointRows]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns with the torque at their end, free columns, and background of all joints as dense matrices."""
    ends = np.cumsum([0, *(row.background.shape[1] for row in rows)])
    columns, backgrounds = [], []
    for row, begin in zip(rows, ends):
        columns.append(np.zeros((len(row.torque), WIDTH + 1)))
        columns[-1][:, [*row.places, WIDTH]] = np.column_stack([row.columns, row.torque])
        own = np.zeros((len(row.torque), ends[-1]))
        own[:, begin : begin + row.background.shape[1]] = row.background
        backgrounds.append(np.column_stack([own, row.common]))
    return np.concatenate(columns), np.concatenate([row.free for row in rows]), np.concatenate(backgrounds)


def join(gram: Gram) -> np.ndarray:
    """K, c and S in one matrix, (k + 1, k + 1)."""
    c = gram.correlations
    return np.block([[gram.compute_rows(np.arange(gram.width)), c[:, None]], [c, np.array(gram.power)]])


def test_inner_products_are_those_of_the_whole_model(rows: list[JointRows]) -> None:
    columns, free, background = stack(rows)
    weight = np.linalg.inv(np.eye(len(columns)) + SIZE**2 * background @ background.T)
    off = weight - weight @ free @ np.linalg.solve(free.T @ weight @ free, free.T @ weight)
    np.testing.assert_allclose(join(Gram.of(rows, SIZE)), columns.T @ off @ columns, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("size", [1.0, 300.0])
def test_what_is_nearly_explained_keeps_its_digits(rows: list[JointRows], size: float) -> None:
    """Free columns that nearly depend on each other, one twice, smooth features, and columns a millionth beside them.

    With the normal matrix in place of the orthonormal bases K would be wrong in its first digits here.
    """
    mix = np.linalg.qr(np.random.default_rng(2).normal(size=(4, 4)))[0] @ np.diag([100.0, 1.0, 1e-2, 1e-4])
    near = []
    for row in rows:
        free, z = row.free @ mix, row.background.shape[1]
        times = np.linspace(0.0, 1.0, len(row.torque))[:, None]
        smooth = np.exp(-50.0 * (times - np.linspace(0.0, 1.0, z)) ** 2)
        columns = 1e-4 * row.columns
        columns[:, list(row.places).index(0)] += free @ [1.0, -1.0, 2.0, 1.0]
        torque = row.torque + free @ [3.0, 1.0, 1.0, 1.0]
        free = np.column_stack([free, free[:, 0]])
        near.append(replace(row, columns=columns, torque=torque, free=free, background=smooth))
    columns, free, background = stack(near)
    z = background.shape[1]
    padded = np.concatenate([columns, np.zeros((z, WIDTH + 1))])
    known = np.block([[free, size * background], [np.zeros((z, free.shape[1])), np.eye(z)]])
    dense = project_rows(padded, known)
    expected = dense.T @ dense
    norms = np.sqrt(np.diag(expected))
    assert norms[0] < 1e-5 * np.linalg.norm(columns[:, 0])
    np.testing.assert_allclose(
        join(Gram.of(near, size)) / np.outer(norms, norms), expected / np.outer(norms, norms), atol=1e-8
    )


def test_rows_and_blocks_are_parts_of_the_whole(rows: list[JointRows]) -> None:
    gram = Gram.of(rows, SIZE)
    K = gram.compute_rows(np.arange(WIDTH))
    np.testing.assert_allclose(gram.compute_rows([4, 0, 2]), K[[4, 0, 2]], rtol=1e-12, atol=1e-12)
    places = np.array([[0, 1], [3, 2], [6, 5]])
    expected = [K[np.ix_(own, own)] for own in places]
    np.testing.assert_allclose(gram.compute_blocks(places), expected, rtol=1e-12, atol=1e-12)


def test_columns_that_are_added_later_are_as_those_from_the_start(rows: list[JointRows]) -> None:
    early, later = [], []
    for row in rows:
        old = row.places < 3
        early.append(replace(row, columns=row.columns[:, old], places=row.places[old]))
        later.append(np.zeros((len(row.torque), WIDTH - 3)))
        later[-1][:, row.places[~old] - 3] = row.columns[:, ~old]
    gram = Gram.of(early, SIZE).extend([x[:, :1] for x in later]).extend([x[:, 1:] for x in later])
    whole = Gram.of(rows, SIZE)
    assert gram.width == whole.width == WIDTH
    np.testing.assert_allclose(join(gram), join(whole), rtol=1e-12, atol=1e-12)
    places = np.array([[0, 3], [1, 6]])
    np.testing.assert_allclose(gram.compute_blocks(places), whole.compute_blocks(places), rtol=1e-12, atol=1e-12)


def repeat_rows(row: JointRows) -> JointRows:
    """The same rows twice."""
    parts = (row.torque, row.columns, row.free, row.background, row.common)
    torque, columns, free, background, common = (np.concatenate([x, x]) for x in parts)
    return JointRows(torque, columns, row.places, free, background, common)


def test_rows_twice_are_twice_the_inner_products(rows: list[JointRows]) -> None:
    """``2 Zᵀ Z τ²`` is what one copy has with √2 τ: the number of rows counts in the sums alone."""
    twice = Gram.of([repeat_rows(row) for row in rows], SIZE)
    once = Gram.of(rows, np.sqrt(2.0) * SIZE)
    np.testing.assert_allclose(join(twice), 2.0 * join(once), rtol=1e-10, atol=1e-10)


def test_where_rows_are_cut_and_their_order_change_nothing(rows: list[JointRows]) -> None:
    """With a background that all share, rows may be given as those of one joint or of several, in any order."""
    shared = [replace(row, background=np.zeros((len(row.torque), 0))) for row in rows]
    cut = []
    for row in shared:
        parts = (row.torque, row.columns, row.free, row.background, row.common)
        for part in (slice(None, 3), slice(3, None)):
            torque, columns, free, background, common = (x[part] for x in parts)
            cut.append(JointRows(torque, columns, row.places, free, background, common))
    np.testing.assert_allclose(join(Gram.of(cut[::-1], SIZE)), join(Gram.of(shared, SIZE)), rtol=1e-10, atol=1e-10)


def test_a_fit_is_least_squares_with_the_prior_as_rows(rows: list[JointRows]) -> None:
    columns, free, background = stack(rows)
    chosen, variances, means = [0, 4, 5], np.array([0.5, 0.1, 4.0]), np.array([1.0, 0.0, 0.0])
    coefficients, covariance = Gram.of(rows, SIZE).fit(chosen, variances, means)
    data = np.column_stack([columns[:, chosen], free, background])
    spread = np.concatenate([1.0 / np.sqrt(variances), np.zeros(4), np.full(background.shape[1], 1.0 / SIZE)])
    wanted = np.concatenate([columns[:, -1], means / np.sqrt(variances), np.zeros(len(spread) - 3)])
    whole = np.linalg.lstsq(np.concatenate([data, np.diag(spread)]), wanted, rcond=None)[0]
    np.testing.assert_allclose(coefficients, whole[:3], rtol=1e-9, atol=1e-9)
    information = data.T @ data + np.diag(spread**2)
    np.testing.assert_allclose(covariance, np.linalg.inv(information)[:3, :3], rtol=1e-9, atol=1e-12)
