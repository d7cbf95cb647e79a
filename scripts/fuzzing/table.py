"""The report: a row per reader, and each distinct failure once."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

from fuzzing.kept import repeated
from fuzzing.workers import Result

KINDS = (
    "exception", "exit code", "died", "slow", "memory", "partial file", "input changed", "control bytes",
    "long message", "foreign line", "message", "foreign element",
)  # fmt: skip
"""Laws, in the order of the table's columns."""
SHOWN = 100
"""Most distinct failures that are printed; JSON has all."""


def text(results: Sequence[Result]) -> str:
    """Return the table, and each distinct failure with one case that shows it."""
    readers = list(dict.fromkeys(result.place.reader for result in results))
    head = ["reader", "cases", "failed", *KINDS, "per s", "slowest"]
    rows = [head, *([reader, *cells([r for r in results if r.place.reader == reader])] for reader in readers)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(head))]
    lines = [
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width) for k, (cell, width) in enumerate(zip(row, widths))
        )
        for row in rows
    ]
    found = distinct(results)
    lines += [
        "",
        *(
            f"{entry['count']:6d}  {entry['kind']}: {entry['signature']}  [{entry['repeat']}]"
            for entry in found[:SHOWN]
        ),
    ]
    return "\n".join(lines + ([f"… and {len(found) - SHOWN} more kinds"] if len(found) > SHOWN else []))


def cells(results: Sequence[Result]) -> list[str]:
    """Return a reader's row."""
    kinds = Counter(kind for result in results for kind in {failure.kind for failure in result.failures})
    seconds = [result.seconds for result in results]
    failed = sum(bool(result.failures) for result in results)
    rate = f"{len(results) / max(sum(seconds), 1e-9):.0f}"
    return [str(len(results)), str(failed), *(str(kinds[kind] or "-") for kind in KINDS), rate, f"{max(seconds):.2f}"]


def distinct(results: Iterable[Result]) -> list[dict[str, Any]]:
    """Return each failure once: kind, signature, how often, of which readers, one case that shows it."""
    found: dict[tuple[str, str], list[tuple[Result, str]]] = defaultdict(list)
    for result in sorted(results, key=lambda result: result.place):
        for failure in result.failures:
            found[failure.kind, failure.signature].append((result, failure.detail))
    order = sorted(found, key=lambda key: (KINDS.index(key[0]) if key[0] in KINDS else len(KINDS), -len(found[key])))
    return [
        {
            "kind": kind,
            "signature": signature,
            "count": len(found[kind, signature]),
            "readers": sorted({result.place.reader for result, _ in found[kind, signature]}),
            "repeat": repeated(found[kind, signature][0][0].place),
            "detail": found[kind, signature][0][1],
        }
        for kind, signature in order
    ]
