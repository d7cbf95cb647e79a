"""Laws of the selection of groups by their marginal likelihood."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gimbal_pin.regression import Gram, Group, JointRows, select_groups

ROWS = 60
WIDTHS = (1, 2, 3, 2)
"""Columns of the four groups of most laws."""


def draw(seed: int) -> tuple[np.ndarray, tuple[Group, ...], np.random.Generator]:
    """Return columns and groups of several widths, means and variances."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum((0, *WIDTHS))
    spans = [slice(int(a), int(b)) for a, b in pairwise(ends)]
    variances = ((0.5,), (0.2, 2.0), (1.0, 0.1), (0.3, 3.0, 30.0))
    groups = tuple(Group(f"g{i}", span, -2.0, v) for i, (span, v) in enumerate(zip(spans, variances)))
    groups = (replace(groups[0], mean=1.0), *groups[1:])
    return rng.normal(size=(ROWS, ends[-1])), groups, rng


def gram_of(X: np.ndarray, y: np.ndarray, free: np.ndarray | None = None) -> Gram:
    """Gram matrix of dense rows of one joint, without a background."""
    none = np.zeros((len(y), 0))
    return Gram.of([JointRows(y, X, np.arange(X.shape[1]), none if free is None else free, none, none)], 0.0)


def evidence_of(X: np.ndarray, y: np.ndarray, chosen: list[tuple[Group, float]]) -> float:
    """``log N(y; X m, I + Σ v X_g X_gᵀ)``."""
    mean, covariance = np.zeros(len(y)), np.eye(len(y))
    for group, v in chosen:
        own = X[:, group.columns]
        mean, covariance = mean + own.sum(axis=1) * group.mean, covariance + v * own @ own.T
    return float(multivariate_normal(mean, covariance).logpdf(y))


def test_the_evidence_of_every_set_is_that_of_the_normal_distribution() -> None:
    X, groups, rng = draw(1)
    groups = tuple(replace(group, variances=group.variances[:1]) for group in groups)
    y = rng.normal(size=ROWS)
    found = {
        one.groups: one.log_posterior for one in select_groups(gram_of(X, y), groups, beam=99, negligible=np.inf).sets
    }
    empty = evidence_of(X, y, [])
    for size in range(len(groups) + 1):
        for members in combinations(range(len(groups)), size):
            expected = evidence_of(X, y, [(groups[g], groups[g].variances[0]) for g in members]) - empty
            assert found[members] == pytest.approx(expected + sum(groups[g].log_odds for g in members), abs=1e-8)


def test_the_evidence_of_a_group_is_averaged_over_its_variances() -> None:
    X, groups, rng = draw(8)
    y = X @ rng.normal(size=X.shape[1]) + rng.normal(size=ROWS)
    found = {one.groups: one for one in select_groups(gram_of(X, y), groups, beam=99, negligible=np.inf).sets}
    empty = evidence_of(X, y, [])
    for g, group in enumerate(groups):
        each = [evidence_of(X, y, [(group, v)]) - empty + group.log_odds for v in group.variances]
        one = found[(g,)]
        assert one.log_posterior == pytest.approx(np.logaddexp.reduce(each) - np.log(len(each)), abs=1e-8)
        assert one.variances == (group.variances[int(np.argmax(each))],)


def test_what_free_columns_explain_changes_nothing() -> None:
    X, groups, rng = draw(3)
    free, y = rng.normal(size=(ROWS, 3)), rng.normal(size=ROWS)
    answers = []
    for moved in (0.0, 100.0):
        gram = gram_of(X + moved * free[:, :1], y + moved * free[:, 1], free)
        answers.append(select_groups(gram, groups).compute_inclusion())
    assert answers[0] == pytest.approx(answers[1], abs=1e-9)


def test_a_column_that_free_columns_explain_adds_nothing() -> None:
    """Were K or c of it rounding errors of the whole column's, a mean or a wide variance would amplify them."""
    rng = np.random.default_rng(10)
    free, y = rng.normal(size=(ROWS, 3)), rng.normal(size=ROWS)
    x = free @ [1.0, 2.0, -1.0] + 1e-9 * rng.normal(size=ROWS)
    for mean in (0.0, 1.0):
        group = Group("x", slice(0, 1), 0.0, (1e8,), mean)
        found = select_groups(gram_of(x[:, None], y + 100.0 * free[:, 0], free), [group])
        assert found.compute_inclusion()["x"] == pytest.approx(0.5, abs=1e-6)


def test_units_and_order_of_the_groups_change_nothing() -> None:
    X, groups, rng = draw(4)
    y = X[:, 1:3] @ [1.0, -0.5] + rng.normal(size=ROWS)
    plain = select_groups(gram_of(X, y), groups).compute_inclusion()
    scales = np.array([2.0, 1e3, 1e-3, 5.0])
    scaled = X / np.repeat(scales, WIDTHS)
    other = tuple(
        replace(g, variances=tuple(v * s**2 for v in g.variances), mean=g.mean * s) for g, s in zip(groups, scales)
    )
    assert select_groups(gram_of(scaled, y), other).compute_inclusion() == pytest.approx(plain, abs=1e-9)
    assert select_groups(gram_of(X, y), groups[::-1]).compute_inclusion() == pytest.approx(plain, abs=1e-9)


def plant(seed: int, planted: tuple[int, ...], size: float = 1.0) -> dict[object, float]:
    """Return the inclusion of thirty groups of two columns, some of which act with coefficients of a size."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(300, 60))
    y = rng.normal(size=300)
    for g in planted:
        y += size * X[:, 2 * g : 2 * g + 2] @ np.sign(rng.normal(size=2))
    groups = [Group(g, slice(2 * g, 2 * g + 2), float(np.log(0.02)), (0.01, 0.1, 1.0)) for g in range(30)]
    return dict(select_groups(gram_of(X, y), groups).compute_inclusion())


@pytest.mark.parametrize("planted", [(), (7,), (3, 21), (2, 11, 29)])
def test_what_was_planted_is_found_and_nothing_else(planted: tuple[int, ...]) -> None:
    for seed in range(5):
        inclusion = plant(seed, planted)
        assert {g for g, p in inclusion.items() if p > 0.5} == set(planted)
        assert all(inclusion[g] > 0.99 for g in planted)


def test_probabilities_are_calibrated() -> None:
    """Of groups that act with probability .2 and a drawn size, those given p are in for a share of p."""
    rng, said, true = np.random.default_rng(5), [], []
    for _ in range(60):
        X = rng.normal(size=(40, 6))
        acts = rng.random(6) < 0.2
        y = X @ np.where(acts, rng.normal(0.0, 0.4, 6), 0.0) + rng.normal(size=40)
        groups = [Group(g, slice(g, g + 1), float(np.log(0.25)), (0.16,)) for g in range(6)]
        inclusion = select_groups(gram_of(X, y), groups, beam=20).compute_inclusion()
        said += [inclusion.get(g, 0.0) for g in range(6)]
        true += acts.tolist()
    said, true = np.array(said), np.array(true, float)
    spread = np.sqrt(np.sum(said * (1 - said)))
    for low, high in ((0.0, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, 1.01)):
        inside = (said >= low) & (said < high)
        deviation = np.sqrt(np.sum(said[inside] * (1 - said[inside])))
        assert abs(np.sum(said[inside]) - np.sum(true[inside])) < 3.3 * max(deviation, 1.0)
    assert abs(said.sum() - true.sum()) < 3.3 * spread


def test_what_no_rows_can_part_shares_its_probability() -> None:
    rng = np.random.default_rng(6)
    x = rng.normal(size=(100, 1))
    y = x[:, 0] + rng.normal(size=100)
    groups = [Group(name, slice(i, i + 1), -3.0, (1.0,)) for i, name in enumerate("ab")]
    found = select_groups(gram_of(np.hstack([x, x]), y), groups)
    inclusion = found.compute_inclusion()
    assert inclusion["a"] == pytest.approx(inclusion["b"])
    assert found.probabilities[0] + found.probabilities[1] > 0.9


def test_a_set_holds_one_group_of_a_key() -> None:
    rng = np.random.default_rng(7)
    X = rng.normal(size=(80, 4))
    y = X @ [3.0, 3.0, 3.0, 0.0] + rng.normal(size=80)
    groups = [Group(k, slice(i, i + 1), -3.0, (1.0, 9.0)) for i, k in enumerate(("a", "a", "b", "c"))]
    found = select_groups(gram_of(X, y), groups)
    assert all(len(found.keys(one)) == len(one.groups) for one in found.sets)
    assert found.compute_inclusion()["a"] > 0.99


def test_a_further_group_of_a_family_pays_the_lesser_price() -> None:
    X, groups, rng = draw(9)
    y = rng.normal(size=ROWS)
    alone = tuple(replace(g, variances=g.variances[:1]) for g in groups)
    related = (alone[0], *(replace(g, family="kin", log_odds_beside=-0.5) for g in alone[1:]))
    plain, kin = (
        {one.groups: one.log_posterior for one in select_groups(gram_of(X, y), each, beam=99, negligible=np.inf).sets}
        for each in (alone, related)
    )
    for members, value in plain.items():
        further = max(sum(g > 0 for g in members) - 1, 0)
        assert kin[members] == pytest.approx(value + 1.5 * further, abs=1e-8)
