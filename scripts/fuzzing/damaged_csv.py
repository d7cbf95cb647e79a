"""Logs and trajectories that are tables, and wrong."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fuzzing.junk import number, one, text

Rows = list[list[str]]
"""The header, then the samples."""


def cells(rng: np.random.Generator, rows: Rows) -> None:
    """Some values are odd: one, or some of one column, or all of it."""
    column, count = int(rng.integers(len(rows[0]))), int(rng.choice([1, 1, 3, 50, len(rows)]))
    value = number(rng)
    for k in rng.integers(1, len(rows), size=count) if len(rows) > 1 else ():
        rows[k][column] = value
    if count == len(rows):
        for row in rows[1:]:
            row[column] = value


def dropped(rng: np.random.Generator, rows: Rows) -> None:
    """Rows are missing: a stretch, many, or all but the first few."""
    kind, start = rng.random(), int(rng.integers(1, len(rows) + 1))
    if kind < 0.4:
        del rows[start : start + int(rng.integers(1, 400))]
    elif kind < 0.6:
        rows[1:] = [row for row in rows[1:] if rng.random() < rng.choice([0.02, 0.5, 0.95])]
    else:
        del rows[1 + int(rng.choice([0, 1, 2, 3, 5, 10, 30, 100])) :]


def repeated(rng: np.random.Generator, rows: Rows) -> None:
    """Rows stand twice, or in another order."""
    start = int(rng.integers(1, len(rows) + 1))
    block = [list(row) for row in rows[start : start + int(rng.integers(1, 100))]]
    if rng.random() < 0.5:
        rows[start:start] = block
    else:
        there = int(rng.integers(1, len(rows) + 1))
        rows[there : there + len(block)] = block


def ragged(rng: np.random.Generator, rows: Rows) -> None:
    """A row has more or fewer cells than the header."""
    row = one(rng, rows)
    if rng.random() < 0.5 and row:
        row.pop()
    else:
        row.extend(["1"] * int(rng.choice([1, 2, 10_000])))


def headers(rng: np.random.Generator, rows: Rows) -> None:
    """A column is renamed, removed, duplicated or exchanged with another."""
    column, other, kind = *(int(k) for k in rng.integers(len(rows[0]), size=2)), rng.random()
    if kind < 0.35:
        rows[0][column] = text(rng) if rng.random() < 0.7 else rows[0][other]
    elif kind < 0.6 and len(rows[0]) > 1:
        for row in rows:
            del row[column]
    elif kind < 0.8:
        rows[0][column], rows[0][other] = rows[0][other], rows[0][column]
    elif kind < 0.9:
        for row in rows:
            row.append(row[column])
    else:
        del rows[0]


def values(rng: np.random.Generator, rows: Rows) -> None:
    """A column is scaled, shifted, frozen, noisy, rounded or reversed; time goes wrong as clocks do."""
    column = 0 if rng.random() < 0.4 else int(rng.integers(len(rows[0])))
    try:
        x = np.array([float(row[column]) for row in rows[1:]])
    except ValueError:
        return
    if len(x) == 0:
        return
    size = float(10.0 ** rng.uniform(-12, 12)) if rng.random() < 0.7 else float(rng.choice([1e-300, 1e150, 1e300]))
    with np.errstate(all="ignore"):
        ways: tuple[Callable[[], np.ndarray], ...] = (
            lambda: x * size,
            lambda: x + size,
            lambda: np.full_like(x, x[0]),
            lambda: np.zeros_like(x),
            lambda: np.full_like(x, size),
            lambda: x[::-1],
            lambda: x + rng.standard_normal(len(x)) * np.ptp(x),
            lambda: x + rng.uniform(0, 1, len(x)) * np.median(np.diff(x)) if len(x) > 1 else x,
            lambda: np.where(np.arange(len(x)) < rng.integers(len(x)), x, x + size),
            lambda: np.round(x, int(rng.integers(0, 4))),
            lambda: x[np.minimum(np.arange(len(x)), rng.integers(len(x)))],
            lambda: np.sign(x) * np.abs(x) ** 3,
        )
        y = one(rng, ways)()
    for row, value in zip(rows[1:], y):
        row[column] = repr(float(value))


def late(rng: np.random.Generator, rows: Rows) -> None:
    """Torques come some samples after the motion, or before it: a quarter of a second at 100 samples per second."""
    by = int(rng.integers(-25, 26))
    source = [list(row) for row in rows]
    for column in (k for k, name in enumerate(rows[0]) if name.startswith("tau_")):
        for k, row in enumerate(rows[1:], 1):
            row[column] = source[min(max(k - by, 1), len(rows) - 1)][column]


def permuted(rng: np.random.Generator, rows: Rows) -> None:
    """Joints exchange all of their columns, each with the next."""
    joints = [name[4:] for name in rows[0] if name.startswith("tau_")]
    following = dict(zip(joints, joints[1:] + joints[:1]))
    for k, name in enumerate(rows[0]):
        kind, _, joint = name.rpartition("_")
        rows[0][k] = f"{kind}_{following[joint]}" if joint in following else name


MUTATIONS = (cells, cells, dropped, repeated, ragged, headers, values, values, late, permuted)


def damaged(rng: np.random.Generator, data: bytes) -> bytes:
    """Return a table with one to three things wrong, perhaps with other separators."""
    rows = [line.split(",") for line in data.decode().splitlines()]
    for _ in range(int(rng.integers(1, 4))):
        try:
            one(rng, MUTATIONS)(rng, rows)
        except IndexError:  # an earlier one left a table that is ragged or empty
            break
    separator = one(rng, (",",) * 9 + (";", "\t", " ", ", "))
    return "".join(separator.join(row) + "\n" for row in rows).encode("utf-8", errors="surrogatepass")


def shown(data: bytes) -> dict[str, np.ndarray]:
    """Return the columns of a valid table."""
    lines = data.decode().splitlines()
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    return dict(zip(lines[0].split(","), table.T))
