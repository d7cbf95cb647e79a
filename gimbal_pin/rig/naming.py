"""Names of columns as the words in them."""

from __future__ import annotations

import re

ROW = "row"
"""Column that every log has beside its own: the sample's number from 0, for files of a known rate without times."""
WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+|[^\W\d_]+")


def words(name: str) -> tuple[str, ...]:
    """Return the words and numbers of a name in lower case: ``posMeas_1`` and ``pos meas 1`` are pos, meas, 1."""
    return tuple(word.lower() for word in WORD.findall(name[:400]))
