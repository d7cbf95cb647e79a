"""Times that are written as a date, a time of day, or both."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from gimbal_pin.log.log import Array

SECONDS_PER_DAY = 86400.0
_DATE = (
    r"(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)"
    r"|(?P<first>\d\d?)[/.](?P<second>\d\d?)[/.](?P<last>\d{4}))"
)
_CLOCK = r"(?:(?P<h>\d\d?):)?(?P<m>\d\d?):(?P<s>\d\d?(?:[.,]\d*)?)\s*(?P<half>[AaPp][Mm])?"
_ZONE = r"\s*(?:[Zz]|UTC|GMT|(?P<sign>[+-])(?P<zh>\d\d):?(?P<zm>\d\d))?"
_STAMP = re.compile(rf"(?:{_DATE}(?:[T ]\s*|$))?(?:{_CLOCK}{_ZONE})?", re.ASCII)
"""A date, a time of day (``h:m:s`` or ``m:s``), or both, then a zone: ISO 8601, and the order of days and months that
goes with points (31.01.2026) or slashes (1/31/2026)."""


def is_stamp(text: str) -> bool:
    """Whether a text is a date, a time of day or both."""
    return len(text) >= 4 and _STAMP.fullmatch(text) is not None


def is_date(text: str) -> bool:
    """Whether a text is a date without a time of day."""
    return ":" not in text and is_stamp(text)


def parse_stamps(texts: Sequence[str]) -> Array:
    """Return seconds since 1970 of texts with a date, since midnight of others, (N,); nan of an empty text.

    Raises:
        ValueError: A text is no time.
    """
    import pandas

    series = pandas.Series(texts, dtype=object).fillna("").str.strip()
    parts = series.str.extract(rf"^{_STAMP.pattern}$", flags=re.ASCII)
    empty = series == ""
    dated = parts["year"].notna() | parts["first"].notna()
    timed = parts["m"].notna()
    if (~(empty | dated | timed)).any():
        raise ValueError("a value is no time")
    pointed = series.str.contains(r"^\d\d?\.", regex=True)
    first, second = (pandas.to_numeric(parts[name]) for name in ("first", "second"))
    day_first = pointed | (first > 12)
    month = pandas.to_numeric(parts["month"]).fillna(second.where(day_first, first))
    day = pandas.to_numeric(parts["day"]).fillna(first.where(day_first, second))
    date = pandas.DataFrame(
        {"year": pandas.to_numeric(parts["year"].fillna(parts["last"])), "month": month, "day": day}
    )
    days = np.zeros(len(series))
    if dated.any():
        at = pandas.to_datetime(date[dated]).to_numpy().astype("datetime64[D]")
        days[dated.to_numpy()] = at.astype(np.int64)
    h, m, zh, zm = (
        pandas.to_numeric(parts[name]).fillna(0).to_numpy(float) for name in ("h", "m", "zh", "zm")
    )
    s = pandas.to_numeric(parts["s"].str.replace(",", ".")).fillna(0.0).to_numpy(float)
    half = parts["half"].str.lower()
    h = np.where(half.notna(), h % 12 + 12 * (half == "pm"), h)
    zone = np.where(parts["sign"] == "-", -60.0, 60.0) * (60 * zh + zm)
    return np.where(empty, np.nan, days * SECONDS_PER_DAY + 3600 * h + 60 * m + s - zone)


def unwrap_midnight(seconds: Array) -> Array:
    """Return times that go on where they fall by more than half a day: the day is not written."""
    return seconds + SECONDS_PER_DAY * np.cumsum(
        np.diff(seconds, prepend=seconds[:1]) < -SECONDS_PER_DAY / 2
    )
