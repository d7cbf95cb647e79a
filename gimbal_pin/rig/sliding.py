"""Units of joints that slide."""

from __future__ import annotations

import re

SLIDING = {r"\(N m\)": "N", r"N m\b": "N", r"kg m(\^2|²)": "kg", r"\brad\b": "m", r"per turn\b": "per 2π m"}
"""What stands in units of joints that turn → what stands there of joints that slide."""


def to_sliding(text: str) -> str:
    """Return units of a joint that turns as those of one that slides: ``N m s/rad`` as ``N s/m``."""
    for turning, sliding in SLIDING.items():
        text = re.sub(turning, sliding, text)
    return text
