"""What a log's file holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gimbal_pin.report.text.cells import number, table

if TYPE_CHECKING:
    from gimbal_pin.log.io.inspection import Inspected


def inspected(found: Inspected) -> str:
    """A file's streams and channels, and the mapping that is proposed."""
    from gimbal_pin.log.io.inspection import summary

    lines = [found.name]
    for stream in found.streams:
        rows = [
            (c.column, c.kind, c.joint or "", c.unit, number(c.low), number(c.high),
             number(c.step, 3) if c.step else "", "; ".join(c.reasons))
            for c in stream.channels
        ]  # fmt: skip
        lines += [*summary(stream), table("column", "is", "of", "in", "from", "to", "step", "because", rows=rows), ""]
    lines += [f"note  {note}" for note in found.notes]
    return "\n".join(lines + ([found.yaml] if found.rig is not None else [])).rstrip("\n")
