"""Rows computed once and kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

from tqdm import tqdm

from gimbal_pin.errors import UsageError
from gimbal_pin.estimation.rows.blocks import Block, Rows


@dataclass(frozen=True, eq=False)
class Regression(Sequence[Block]):
    """Blocks, computed once, and the rows that they are: for estimators that must know what the columns stand for.

    Attributes:
        rows: What they were computed from.
        blocks: The blocks.
    """

    rows: Rows
    blocks: tuple[Block, ...]

    @overload
    def __getitem__(self, at: int) -> Block: ...

    @overload
    def __getitem__(self, at: slice) -> tuple[Block, ...]: ...

    def __getitem__(self, at: int | slice) -> Block | tuple[Block, ...]:
        """Return a block, or some."""
        return self.blocks[at]

    def __len__(self) -> int:
        """Number of blocks."""
        return len(self.blocks)


def standing_for(blocks: Sequence[Block]) -> Rows:
    """Return the rows that blocks are; `UsageError` where they are mixed from several."""
    if not isinstance(blocks, Regression):
        what = "needs to know the rig behind its rows, and these are mixed from several payloads'"
        raise UsageError("this estimator", what, "use weighted, ols or robust, or identify each payload alone")
    return blocks.rows


def kept(rows: Rows) -> Regression:
    """Compute every block once and keep them: after decimation even a million samples are some 20 MB."""
    return Regression(rows, tuple(tqdm(rows, "rows", unit="block", disable=None, leave=False, delay=2)))
