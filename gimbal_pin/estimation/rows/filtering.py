"""How a log becomes rows: cutoffs, alignment, and how far a row reaches."""

from __future__ import annotations

from dataclasses import dataclass

from gimbal_pin.log import signals

FINE = 200.0
"""Least rate of decimated channels, samples per second."""
CLEAR = 6.0
"""The same in corners of the smoother."""


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


def thinning(filtering: Filtering, dt: float) -> int:
    """Return the whole factor by which smoothed channels can be decimated: to `CLEAR` corners of the smoother, Hz.

    Of what folds back into the band the noise of the acceleration, which rises with f², is the largest. At a rate of r
    corners c of a smoother of `signals.ORDER` 3, run twice, it comes from near r c and has ``r² / (1 + r⁶)`` of what it
    has at the corner: 1/1300 at 6. Columns that jump are smoothed before, at the full rate. Beside it, `FINE`.
    """
    return max(1, int(1.000001 / (max(FINE, CLEAR * filtering.cutoff * filtering.smoothing) * dt)))
