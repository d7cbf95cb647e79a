"""What every text is made of: tables in aligned columns, and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from gimbal_pin.errors import digits


def table(*heads: str, rows: Sequence[Sequence[str]]) -> str:
    """Return rows under heads in aligned columns; numbers to the right, words to the left."""
    everything = [heads, *rows]
    widths = [max(len(row[k]) for row in everything) for k in range(len(heads))]
    right = [all(is_number(row[k]) for row in rows) and bool(rows) for k in range(len(heads))]
    lines = [
        "  ".join(
            cell.rjust(width) if to_right else cell.ljust(width) for cell, width, to_right in zip(row, widths, right)
        )
        for row in everything
    ]
    return "\n".join(line.rstrip() for line in lines)


def percent(share: float) -> str:
    """Return a share in per cent: whole ones, two digits of a small one."""
    return f"{100 * share:.0f}" if abs(share) >= 0.1 else number(100 * share, 2)


def is_number(cell: str) -> bool:
    """Whether a cell starts like a number, or stands for one that is missing."""
    return cell[:1] in "-+.0123456789∞–" or cell == ""


def number(value: float | None, count: int = 4) -> str:
    """Return a value with so many significant digits; – for none, ∞ for no limit."""
    if value is None or value != value:
        return "–"
    return ("∞" if value > 0 else "-∞") if abs(value) == inf else digits(value, count)
