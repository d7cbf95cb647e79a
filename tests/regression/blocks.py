"""Blocks of rows for tests."""

from __future__ import annotations

import numpy as np

from gimbal_pin.log import Array
from gimbal_pin.regression import Block


def make_block(A: Array, b: Array, share: Array | None = None) -> Block:
    """Return rows ``A θ = b`` at 8 Hz, of which each counts by its share."""
    weight = np.ones_like(b) if share is None else share
    unused = np.zeros_like(b)
    return Block(
        t=np.arange(len(b)) / 8,
        A=A * weight[:, :, None],
        b=b * weight,
        q=unused,
        v=unused,
        share=weight,
        slope=unused,
        known=unused,
    )


def draw_block(
    rng: np.random.Generator, rows: int, theta: Array, noise: float = 0.01, shared: bool = False
) -> Block:
    """Return rows of two joints with white noise, which count in part if they are shared."""
    A = rng.standard_normal((rows, 2, len(theta)))
    b = A @ theta + noise * rng.standard_normal((rows, 2))
    return make_block(A, b, rng.uniform(0.2, 1.0, b.shape) if shared else None)


def select(block: Block, rows: slice | Array) -> Block:
    """Return some rows of a block."""
    return Block(*(x[rows] for x in block))


def cut(block: Block, parts: int) -> list[Block]:
    """Return a block in parts."""
    return [select(block, rows) for rows in np.array_split(np.arange(len(block.t)), parts)]
