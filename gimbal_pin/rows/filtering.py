"""How a log becomes rows: cutoffs, alignment, and how far a row reaches."""

from __future__ import annotations

from dataclasses import dataclass

from gimbal_pin import signals


@dataclass(frozen=True)
class Filtering:
    """How a log becomes rows.

    Attributes:
        cutoff: Low-pass on every column and on the torque, Hz.
        smoothing: Low-pass on the channels before they are differentiated, in multiples of the cutoff.
        alignment: Time by which the torque acts later than its stamp, s; None: half a sample, for a torque that is
            held from its sample to the next.
    """

    cutoff: float = 4.0
    smoothing: float = 8.0
    alignment: float | None = None


def settling(filtering: Filtering) -> float:
    """Time around a sample that its row depends on, s: both filters' memory."""
    return signals.settling(filtering.cutoff) + signals.settling(filtering.cutoff * filtering.smoothing)
