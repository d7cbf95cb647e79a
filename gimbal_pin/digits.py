"""Numbers within sentences and tables: so many digits, and powers of ten only where zeros would have to be counted."""

from __future__ import annotations

LARGEST = 1e7
"""From here on a power of ten; below 1e-4, too."""


def digits(value: float, count: int = 3) -> str:
    """Return a value with so many significant digits, and all of those before the point: ``0.021``, ``2.1``, ``213``.

    Zeros behind the point go; ``1.2e-05`` and ``2.1e+07`` have their powers.
    """
    text = f"{value:.{count}g}"
    return f"{value:.0f}" if "e+" in text and abs(value) < LARGEST else text
