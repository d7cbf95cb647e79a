"""Values that no reader should trip over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")

ABSURD = (
    "nan", "inf", "-inf", "1e300", "-1e300", "1e160", "1e-320", "5e-324", "1e308", "1.8e308", "-0", "0", "-1", "1e18",
    "9" * 400, "-" + "9" * 400, "0." + "0" * 400 + "1", "1e" + "9" * 30,
)  # fmt: skip
"""Numbers, of a kind."""

NO_NUMBERS = (
    "", " ", "text", "1_0", "0x1", "0b11", "1,5", "1e", "e5", "--1", "+", "1 2", "1.2.3", "١٢", "1\u00a0", "null",
    "None",
    "true", "NaN!", "=1+1", "1;2",
)  # fmt: skip
"""What stands where a number should."""

TEXTS = (
    "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "a\rb", "a\nb", "tab\there", "\x7f", "\x9b31m", "\u202egnp.exe",
    "\u2028", "\ufeff", "é" * 200,
    "x" * 5000, "../../x", "a,b", 'a"b', "a=b*2", "a@b", "%s%n{0}", "-o", "😀", "'; drop", "<b>&amp;</b>", "q_", "nan",
)  # fmt: skip
"""Names and texts that are odd, all of them without NUL."""


def one(rng: np.random.Generator, choices: Sequence[T]) -> T:
    """Return one of the choices."""
    return choices[int(rng.integers(len(choices)))]


def number(rng: np.random.Generator) -> str:
    """Return what may be written where a number belongs."""
    kind = rng.random()
    if kind < 0.5:
        return one(rng, ABSURD)
    if kind < 0.7:
        return one(rng, NO_NUMBERS)
    if kind < 0.75:
        return one(rng, TEXTS)
    return repr(float(rng.choice([-1, 1]) * 10 ** rng.uniform(-12, 12)))


def text(rng: np.random.Generator) -> str:
    """Return an odd text."""
    return one(rng, (*TEXTS, *NO_NUMBERS, *ABSURD[:4]))
