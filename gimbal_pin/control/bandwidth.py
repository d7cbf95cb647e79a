"""The search for the highest bandwidth whose sampled, delayed loop keeps a disk margin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import floor, isfinite, log2

from gimbal_pin.control.design import LAYERED, Wish
from gimbal_pin.effects import Signal
from gimbal_pin.errors import UsageError

FINE, COARSE = 128, 64
"""Bandwidths tried per octave (0.54 % apart), and how many of them a search from below steps over at once."""
SLOW = 1e-5
"""Bandwidth times sampling interval at which a search begins: such a loop hardly feels that it is late."""


def allowed(
    wish: Wish, hz: float, believed: Sequence[float], ratios: Sequence[float], drive: tuple[Signal, ...]
) -> tuple[float, Sequence[float]]:
    """Return a joint's bandwidth, Hz, and the plant's gains with which it keeps the disk margin.

    Raises:
        UsageError: There is none.
    """
    # A margin that nobody asked for is not worth refusing a doubtful model for: then that of the believed one counts.
    for of in (ratios, believed) if wish.disk_margin is None else (ratios,):
        found = lowered(hz, wish, of, drive)
        if found is not None:
            return found, of
    what = f"is {wish.disk:g}, which no bandwidth keeps with damping {wish.damping:g}"
    if len(ratios) > 1:
        what += f" and {min(ratios):.2g} to {max(ratios):.2g} times the believed gain"
    mend = "ask for less margin, more damping or less integral action, or identify the inertias better"
    raise UsageError("disk_margin", what, mend)


def lowered(hz: float, wish: Wish, ratios: Sequence[float], drive: tuple[Signal, ...] = ()) -> float | None:
    """Return `hz`, or else the highest bandwidth below it whose worst disk margin is at least the one wished for, Hz.

    None where no bandwidth has it: delay then is not what costs the margin.

    Args:
        hz: What is asked for, Hz; infinite: as much as the disk margin lets.
        wish: The rest of what is asked for.
        ratios: Gains of the plant over what the law believes.
        drive: What stands between command and torque.
    """

    def enough(bandwidth: float) -> bool:
        return wish.kept(wish.smallest(wish.gains(bandwidth), ratios, drive))

    if isfinite(hz) and enough(hz):
        return hz
    found = fastest(lambda bandwidth: bandwidth < hz and enough(bandwidth), SLOW / wish.dt)
    return None if found is None else found * (LAYERED if wish.robust and not isfinite(hz) else 1.0)


def fastest(enough: Callable[[float], bool], start: float) -> float | None:
    """Return the highest bandwidth up to which, from about `start` on, all tried are enough, Hz; None: not `start`.

    The bandwidths tried are the same whatever is asked for: what is enough for less never gets a lower answer.
    """
    low = COARSE * floor(FINE * log2(start) / COARSE)
    if not enough(2 ** (low / FINE)):
        return None
    while enough(2 ** ((low + COARSE) / FINE)):
        low += COARSE
    high = low + COARSE
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if enough(2 ** (middle / FINE)) else (low, middle)
    return float(2 ** (low / FINE))
