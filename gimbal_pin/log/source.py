"""Where a log's columns come from: ``value = factor * column`` of a file, read and written as text."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass

FACTOR = r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|pi)"
"""A number of an expression."""
PLAIN = re.compile(r"[^\W\d][\w .\[\]]*")
"""Names that an expression of a mapping holds without quotes."""


@dataclass(frozen=True)
class Source:
    """``value = factor * column``.

    Attributes:
        column: Header in the file.
        factor: What one unit of it is in SI units; finite and not zero.
        place: Where the mapping was stated; empty for a column that bears its name already, or another joint's.
    """

    column: str
    factor: float = 1.0
    place: str = ""

    def times(self, factor: float | str) -> str:
        """Return the expression of this times a number, or a product as text: ``-pos1*0.5``, ``pos1*0.5*pi/180``."""
        value, rest = (self.factor, factor) if isinstance(factor, str) else (self.factor * factor, "")
        numbers = [text for text in (f"{abs(value):.12g}", rest) if text not in ("", "1")]
        return expression(self.column, "-" * (value < 0) + "*".join(numbers))


def expression(column: str, factor: str) -> str:
    """Return what a mapping writes for a column times a factor, such as ``pos1*pi/180``."""
    sign, rest = ("-", factor[1:]) if factor.startswith("-") else ("", factor)
    bare = PLAIN.fullmatch(column) and not re.fullmatch(FACTOR, column)
    quote = "'" if '"' in column else '"'
    shown = column if bare else f"{quote}{column}{quote}"
    return f"{sign}{shown}" + (f"*{rest}" if rest else "")


def remapped(sources: Mapping[str, Source], changes: Mapping[str, tuple[str, float | str]]) -> str:
    """Return the ``--map`` entries, as a shell takes them, that mend a log read from these sources.

    Args:
        sources: Target → what it was read from; one that is missing bears its name in the file.
        changes: Target → (what is read as now, times which number or product), such as ``{"tau_a": ("tau_b", -1.0)}``.
    """
    entries = (f"{to}={sources.get(of, Source(of)).times(factor)}" for to, (of, factor) in changes.items())
    return " ".join(f"--map {shlex.quote(entry)}" for entry in entries)
