"""Types that every room uses: arrays of numbers, and generators of random ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.errors import UsageError

Array = NDArray[np.floating[Any]]
Rng = np.random.Generator | int | None
"""A generator; or the seed of one, such as a result holds; None: any."""


def make_generator(rng: Rng) -> tuple[np.random.Generator, int | None]:
    """Return a generator and the seed that repeats it; None of a generator that was given, which may be under way."""
    if isinstance(rng, np.random.Generator):
        return rng, None
    seed = np.random.default_rng().integers(2**32) if rng is None else rng
    try:
        return np.random.default_rng(seed), int(seed)
    except (TypeError, ValueError) as error:
        raise UsageError(
            "rng", f"is {rng!r}", "give a numpy.random.Generator, a whole number, or nothing"
        ) from error
