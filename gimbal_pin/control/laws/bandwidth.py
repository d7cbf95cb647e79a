"""The search for the highest bandwidth whose sampled, delayed loop keeps a disk margin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import floor, isfinite, log2

from gimbal_pin.control.laws.design import LAYERED, Wish
from gimbal_pin.effects import Signal
from gimbal_pin.errors import UsageError, digits

FINE, COARSE = 128, 64
"""Bandwidths tried per octave (0.54 % apart), and how many of them a search from below steps over at once."""
OCTAVES = 15
"""From the slowest bandwidth on, among which the largest disk margin is looked for."""
DAMPED = 2.0
"""Damping that is named where less leaves too little margin."""
SLOW = 1e-5
"""Bandwidth times sampling interval at which a search begins: such a loop hardly feels that it is late."""


Row = tuple[float, Sequence[float], Sequence[float], tuple[Signal, ...]]
"""One joint's wish, Hz, the plant's gains of the believed model and of all drawn ones, and its drive."""


def granted(wish: Wish, rows: Sequence[Row]) -> list[tuple[float, Sequence[float]]]:
    """Return each joint's bandwidth, Hz, and the plant's gains with which it keeps the disk margin.

    Raises:
        UsageError: One has none; the message says which margin all joints have, and what gives more.
    """
    found = [allowed(wish, *row) for row in rows]
    if any(one is None for one in found):
        raise UsageError("disk_margin", *refused(wish, rows))
    return [one for one in found if one is not None]


def allowed(
    wish: Wish, hz: float, believed: Sequence[float], ratios: Sequence[float], drive: tuple[Signal, ...]
) -> tuple[float, Sequence[float]] | None:
    """Return a joint's bandwidth, Hz, and the plant's gains with which it keeps the margin; None: there is none."""
    # A margin that nobody asked for is not worth refusing a doubtful model for: then that of the believed one counts.
    for of in (ratios, believed) if wish.disk_margin is None else (ratios,):
        found = lowered(hz, wish, of, drive)
        if found is not None:
            return found, of
    return None


def refused(wish: Wish, rows: Sequence[Row]) -> tuple[str, str]:
    """Return what is wrong with a disk margin that no bandwidth keeps, and the mend: what there is, what gives more."""
    shape = f"damping {wish.damping:g}, integral {wish.integral:g}"
    what = f"is {wish.disk:g}, and the most that any bandwidth keeps with {shape}"
    every = [ratio for _, _, ratios, _ in rows for ratio in ratios]
    unsure = min(every) < max(every)
    what += f" and {digits(min(every), 2)} to {digits(max(every), 2)} times the believed gain" if unsure else ""
    most, other = largest(wish, rows), replace(wish, damping=max(DAMPED, wish.damping), integral=0.0)
    more = largest(other, rows)
    mend = f"ask for that, or with damping={other.damping:g}, integral=0 for up to {floored(more)}"
    mend += ", or identify the inertias better" if unsure else ""
    return f"{what} is {floored(most)}", mend if more > most else "ask for that"


def largest(wish: Wish, rows: Sequence[Row]) -> float:
    """Return the largest disk margin that every joint has at some bandwidth, of those an octave apart."""
    tried = [wish.gains(SLOW / wish.dt * 2**k) for k in range(OCTAVES)]
    return min(max(wish.smallest(gains, ratios, drive) for gains in tried) for _, _, ratios, drive in rows)


def floored(margin: float) -> str:
    """Return a margin that can be asked for, rounded down."""
    return f"{floor(100 * margin) / 100:g}"


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
