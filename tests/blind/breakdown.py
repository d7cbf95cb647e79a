"""Where the table's figures come from: who was taken for whom, and from what size on each cause is told."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .judge import Json, Judged, judge, snr, tells
from .table import wilson

SNR_EDGES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
SHARE_EDGES = (0.0017, 0.0055, 0.017, 0.055, 0.17)
RELIABLE = 0.9


def _said(case: Judged) -> str:
    """The first name, or the verdict where there is none."""
    return str(case.findings[0]["cause"]) if case.findings else case.verdict


def _was(case: Judged) -> str:
    """What was hidden: a cause, one from outside (marked ~), a fault of the data, or nothing."""
    if case.causes:
        mark = "~" if case.causes[0]["outside"] else ""
        return mark + str(case.causes[0]["cause"])
    return str(case.truth["data"]["cause"]) if case.truth["data"] else "nothing"


def confusion(pairs: Iterable[tuple[Json, Json]]) -> str:
    """Rows: what was hidden (logs with one thing or nothing in them); columns: the first name, or the verdict."""
    cases = [judge(truth, diagnosis) for truth, diagnosis in pairs]
    alone = [case for case in cases if len(case.causes) + bool(case.truth["data"]) <= 1]
    cells = Counter((_was(case), _said(case)) for case in alone)
    rows, columns = sorted({row for row, _ in cells}), sorted({column for _, column in cells})
    width = max((len(row) for row in rows), default=0)
    lines = [f"{'':{width}}  " + " ".join(f"{i:>3}" for i in range(1, len(columns) + 1))]
    for row in rows:
        counts = " ".join(f"{cells[row, column] or '.':>3}" for column in columns)
        lines.append(f"{row:{width}}  {counts}")
    legend = [f"{i:>3} {column}" for i, column in enumerate(columns, 1)]
    return "\n".join([*lines, "", *legend]) + "\n"


@dataclass(frozen=True)
class Limit:
    """How often a cause is told, by size: (lowest edge of the bin, told, cases); `reliable`: the smallest edge from
    which on nine in ten are told in every bin, or None."""

    cause: str
    bins: tuple[tuple[float, int, int], ...]
    reliable: float | None


def _binned(sizes: Sequence[tuple[float, bool]], edges: Sequence[float]) -> tuple[tuple[float, int, int], ...]:
    lows, highs = (0.0, *edges), (*edges, float("inf"))
    bins = []
    for low, high in zip(lows, highs, strict=True):
        inside = [told for size, told in sizes if low <= size < high]
        bins.append((low, sum(inside), len(inside)))
    return tuple(bins)


def _reliable(bins: Sequence[tuple[float, int, int]]) -> float | None:
    edge = None
    for low, told, count in reversed([item for item in bins if item[2]]):
        if told < RELIABLE * count:
            break
        edge = low
    return edge


def detection_limits(pairs: Iterable[tuple[Json, Json]], by: str = "snr") -> list[Limit]:
    """Of every published cause alone in a log, how often it is told by size: "snr" or "share" of the torque rms."""
    cases = [judge(truth, diagnosis) for truth, diagnosis in pairs]
    sizes: dict[str, list[tuple[float, bool]]] = {}
    for case in (c for c in cases if c.stratum == "single"):
        cause = case.causes[0]
        told = any(tells(found, cause) for found in case.findings)
        size = snr(cause) if by == "snr" else float(cause["share"])
        sizes.setdefault(str(cause["cause"]), []).append((size, told))
    edges = SNR_EDGES if by == "snr" else SHARE_EDGES
    limits = []
    for name, pairs_of in sorted(sizes.items()):
        bins = _binned(pairs_of, edges)
        limits.append(Limit(name, bins, _reliable(bins)))
    return limits


def limits_text(limits: Sequence[Limit]) -> str:
    """The limits as a Markdown table, told/cases in each bin."""
    if not limits:
        return ""
    heads = [f"≥ {low:g}" for low, _, _ in limits[0].bins]
    lines = ["| cause | " + " | ".join(heads) + " | nine in ten from |", "|---" * (len(heads) + 2) + "|"]
    for limit in limits:
        cells = [f"{told}/{count}" if count else "" for _, told, count in limit.bins]
        edge = "–" if limit.reliable is None else f"{limit.reliable:g}"
        lines.append(f"| {limit.cause} | " + " | ".join(cells) + f" | {edge} |")
    lines.append("| all (95 % bounds) | " + " | ".join(_pooled(limits)) + " | |")
    return "\n".join(lines) + "\n"


def _pooled(limits: Sequence[Limit]) -> list[str]:
    """The bounds of the share told in each bin, over all causes."""
    cells = []
    for same_bin in zip(*(limit.bins for limit in limits), strict=True):
        told, count = sum(bin_[1] for bin_ in same_bin), sum(bin_[2] for bin_ in same_bin)
        low, high = wilson(told, count)
        cells.append(f"{100 * low:.0f}–{100 * high:.0f} %" if count else "")
    return cells
