"""From wishes to gains: how much bandwidth the delay leaves, and how much gain the boundary layer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, inf, isfinite, log2
from typing import Any

import numpy as np

from gimbal_pin.control.laws.base import Pid
from gimbal_pin.control.laws.computed_torque import Robust, lyapunov, stiffened
from gimbal_pin.control.laws.loop import Margins, compute_margins, find_worst_margins, smallest_disk
from gimbal_pin.control.laws.uncertainty import (
    VARIED,
    ModelErrorBounds,
    compute_inertia,
    home,
    sample_poses,
)
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Signal
from gimbal_pin.errors import UsageError, digits
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig

KINDS = ("computed-torque", "pid")
SMALLEST_GAIN, LARGEST_GAIN = 0.1, 100.0
"""Of the boundary layer: a thicker one does nothing, a thinner one is a relay."""

DEFAULT_BANDWIDTH = 8.0
"""Of the error's dynamics where neither a bandwidth nor a disk margin is asked for, Hz."""
LEAST_DISK_MARGIN = 0.5
"""Smallest disk margin accepted where none is asked for; the bandwidth gives way to it."""
LAYERED = 0.4
"""Share of the bandwidth that Lyapunov redesign leaves to the linear loop, before its layer takes up the rest."""
BRAKES = 0.7
"""Share of a motor's spare torque that an approach from far away counts on: the rest corrects."""

FASTEST, SLOWEST = 1e-6, 1.0
"""Sampling intervals, s: a megahertz is beyond any drive's current loop; what moves in a second no loop holds."""
LONGEST_DELAY = 50
"""Largest delay, in samples."""


@dataclass(frozen=True)
class Wish:
    """What is asked of `tune`.

    Attributes:
        bandwidth_hz: Natural frequency of the error's dynamics, Hz: one for all joints, or joint → Hz. None: the
            highest that keeps `disk_margin`, or 8 Hz where that is None too.
        damping: Their damping ζ.
        delay: Time from measurement to torque, s, at most; the hold of the torque comes on top.
        dt: Sampling interval, s.
        kind: "computed-torque" or "pid".
        integral: Speed of the integral action in shares of the bandwidth; 0: none.
        disk_margin: Disk margin that every joint's loop keeps; the bandwidth gives way to it. None: 0.5.
        robust: True adds Lyapunov redesign (computed torque only).
    """

    bandwidth_hz: float | Mapping[str, float] | None = None
    damping: float = 1.0
    delay: float = 0.001
    dt: float = 0.001
    kind: str = "computed-torque"
    integral: float = 0.2
    disk_margin: float | None = None
    robust: bool = False

    @staticmethod
    def of(model: Model, dt: float | None = None, delay: float | None = None, **asked: Any) -> Wish:
        """Return what is asked for a model: sampled as its logs were, or every millisecond where nobody knows that.

        Where no delay is stated it is one sample, or as late as the logs show a drive to act.
        """
        known = model.estimated
        dt = dt or (None if known is None else known.dt) or Wish.dt
        late = min(max((dt, *(() if known is None else known.lags))), LONGEST_DELAY * dt)
        return Wish(dt=dt, delay=late if delay is None else delay, **asked)

    @property
    def samples(self) -> int:
        """Whole samples that are nearest to `delay`: a simulation with more would not be of the loop that was tuned."""
        return round(self.delay / self.dt)

    @property
    def holding_samples(self) -> int:
        """The same of the controllers that hold a camera, which run at 1 kHz; at least one."""
        return max(1, round(self.delay / Wish.dt))

    def __post_init__(self) -> None:
        """Refuse what no loop can be made of."""
        if self.kind not in KINDS:
            raise UsageError("kind", f"is '{self.kind}'", f"use {' or '.join(KINDS)}")
        if self.robust and self.kind == "pid":
            raise UsageError(
                "robust", "needs a model that it could be wrong about", "use kind='computed-torque'"
            )
        positive("damping", self.damping)
        if not FASTEST <= self.dt <= SLOWEST:
            raise UsageError("dt", f"is {self.dt:g} s", f"give {FASTEST:g} to {SLOWEST:g}")
        if not 0 <= self.delay <= LONGEST_DELAY * self.dt:
            mend = f"give 0 to {LONGEST_DELAY * self.dt:g}: a gimbal cannot be held with more"
            raise UsageError("delay", f"is {self.delay:g} s", mend)
        if not (isfinite(self.integral) and self.integral >= 0):
            raise UsageError(
                "integral", f"is {self.integral}", "give a number that is not negative"
            )
        if not 0 < self.disk < 2:
            raise UsageError(
                "disk_margin", f"is {self.disk:g}", "a disk margin lies between 0 and 2"
            )

    @property
    def disk(self) -> float:
        """Smallest disk margin accepted."""
        return LEAST_DISK_MARGIN if self.disk_margin is None else self.disk_margin

    def kept(self, margin: float) -> bool:
        """Whether a disk margin is as large as asked for, but for rounding: what was once reported can be asked for."""
        return margin >= self.disk * (1 - 1e-9)

    def per_joint(self, rig: Rig) -> tuple[float, ...]:
        """Return the wanted bandwidth of each joint, Hz; infinite: the highest that keeps the disk margin."""
        wanted = self.bandwidth_hz
        if wanted is None:
            return (DEFAULT_BANDWIDTH if self.disk_margin is None else inf,) * rig.n
        if not isinstance(wanted, Mapping):
            return (positive("bandwidth_hz", wanted),) * rig.n
        for joint in wanted:
            rig.joint_index(joint)
        missing = [joint for joint in rig.joints if joint not in wanted]
        if missing:
            raise UsageError(
                "bandwidth_hz", f"has no entry for {', '.join(missing)}", "give all, or one number"
            )
        return tuple(positive(f"bandwidth_hz of {joint}", wanted[joint]) for joint in rig.joints)

    def gains(self, hz: float) -> Pid:
        """The outer loop of a bandwidth, Hz."""
        return Pid.placed(hz, self.damping, self.integral)

    @property
    def delays(self) -> tuple[float, ...]:
        """The delays that a loop must bear, s: no margin may come from being late.

        Less than half a sample of delay weakens a sampled loop at half the sampling rate, where a fast one ends.
        """
        return (0.0, self.delay) if 0 < self.delay < self.dt / 2 else (self.delay,)

    def margins(
        self, gains: Pid, ratios: Sequence[float] = (1.0,), drive: tuple[Signal, ...] = ()
    ) -> Margins:
        """Return the worst margins of an outer loop over the plant's gains `ratios`, with the drive's signals in it."""
        return find_worst_margins(
            [
                compute_margins(gains, self.dt, late, ratio, drive)
                for late in self.delays
                for ratio in ratios
            ]
        )

    def smallest(self, gains: Pid, ratios: Sequence[float], drive: tuple[Signal, ...]) -> float:
        """Return the disk margin of `margins` alone, which is quicker."""
        return min(
            smallest_disk(gains, self.dt, late, tuple(ratios), drive) for late in self.delays
        )


def positive(name: str, value: float) -> float:
    """Return `value`, or raise `UsageError` if it is not a positive number."""
    if not (isfinite(value) and value > 0):
        raise UsageError(name, f"is {value}", "give a positive number")
    return float(value)


def seen_inertia(
    model: Model, kind: str
) -> tuple[tuple[float, ...], tuple[tuple[float, ...], ...]]:
    """Return each joint's inertia at home, kg m², and nominal over true inertia: lowest, one, highest over the poses.

    Computed torque divides the inertia out: its ratio is one at any pose.
    """
    nominal = np.diagonal(compute_inertia(model, home(model.rig)[None])[0])
    if kind != "pid":
        return tuple(nominal.tolist()), ((1.0,),) * model.rig.n
    ratios = nominal / np.diagonal(
        compute_inertia(model, sample_poses(model.rig, VARIED)[0]), axis1=1, axis2=2
    )
    ends = zip(ratios.min(axis=0).round(6).tolist(), ratios.max(axis=0).round(6).tolist())
    return tuple(nominal.tolist()), tuple(tuple(sorted({low, 1.0, high})) for low, high in ends)


def braking(model: Model) -> tuple[float, ...]:
    """Deceleration that each motor surely has, rad/s²: `BRAKES` of what gravity and friction leave at the worst pose.

    No bound for a motor without a limit, or one that cannot even hold its load at some pose.
    """
    q = sample_poses(model.rig)[0]
    worst_pose = (
        spare_torque(model, q) / np.diagonal(compute_inertia(model, q), axis1=1, axis2=2)
    ).min(axis=0)
    return tuple(np.where(worst_pose > 0, BRAKES * worst_pose, np.inf).tolist())


def spare_torque(model: Model, q: Array) -> Array:
    """Return what gravity and friction leave of every motor's torque at some poses, N m, (N, n)."""
    zero = np.zeros_like(q)
    return (
        model.tau_max
        - np.abs(model.inverse_dynamics(q, zero, zero, slide=zero))
        - model.level(q, zero, zero, zero)
    )


def bisected(enough: Callable[[float], bool], low: float, high: float) -> float:
    """Return the largest value between `low`, which is enough, and `high`, which is not, to half a per cent."""
    while high - low > 5e-3 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if enough(middle) else (low, middle)
    return low


def layered(
    gains: tuple[Pid, ...],
    known: ModelErrorBounds,
    wish: Wish,
    ratios: Sequence[Sequence[float]],
    between: Sequence[tuple[Signal, ...]],
) -> Robust | None:
    """Return Lyapunov redesign with the thinnest boundary layer whose gain leaves the disk margin wished for.

    None where the outer loop has used up the margin already.
    """
    law = Robust(lyapunov(gains), known, 1.0)

    def enough(gain: float) -> bool:
        loops = zip(small_error_gains(gains, replace(law, gain=gain)), ratios, between)
        return all(wish.kept(wish.smallest(*loop)) for loop in loops)

    high = SMALLEST_GAIN
    while enough(high) and high < LARGEST_GAIN:
        high *= 2
    return replace(law, gain=bisected(enough, high / 2, high)) if high > SMALLEST_GAIN else None


def small_error_gains(gains: tuple[Pid, ...], law: Robust | None) -> tuple[Pid, ...]:
    """The gains that small errors see: the boundary layer's on top."""
    if law is None:
        return gains
    return tuple(stiffened(pid, row, law.gain) for pid, row in zip(gains, law.rows))


TRIED_PER_OCTAVE, SKIPPED_AT_ONCE = 128, 64
"""Bandwidths tried per octave (0.54 % apart), and how many of them a search from below steps over at once."""
SEARCHED_OCTAVES = 15
"""From the slowest bandwidth on, among which the largest disk margin is looked for."""
DAMPED = 2.0
"""Damping that is named where less leaves too little margin."""
SLOWEST_SEARCHED = 1e-5
"""Bandwidth times sampling interval at which a search begins: such a loop hardly feels that it is late."""


JointWish = tuple[float, Sequence[float], Sequence[float], tuple[Signal, ...]]
"""One joint's wish, Hz, the plant's gains of the believed model and of all drawn ones, and its drive."""


def granted(wish: Wish, rows: Sequence[JointWish]) -> list[tuple[float, Sequence[float]]]:
    """Return each joint's bandwidth, Hz, and the plant's gains with which it keeps the disk margin.

    Raises:
        UsageError: One has none; the message says which margin all joints have, and what gives more.
    """
    found = []
    for hz, believed, ratios, drive in rows:
        # A margin that nobody asked for is no reason to refuse a doubtful model: then that of the believed one counts.
        for of in (ratios, believed) if wish.disk_margin is None else (ratios,):
            bandwidth = lowered(hz, wish, of, drive)
            if bandwidth is not None:
                found.append((bandwidth, of))
                break
        else:
            raise UsageError("disk_margin", *refused(wish, rows))
    return found


def refused(wish: Wish, rows: Sequence[JointWish]) -> tuple[str, str]:
    """Return what is wrong with a disk margin that no bandwidth keeps, and the mend: what there is, what gives more."""

    def most(other: Wish) -> float:
        """The largest disk margin that every joint has at some bandwidth, of those an octave apart."""
        tried = [other.gains(SLOWEST_SEARCHED / other.dt * 2**k) for k in range(SEARCHED_OCTAVES)]
        return min(
            max(other.smallest(gains, ratios, drive) for gains in tried)
            for _, _, ratios, drive in rows
        )

    what = f"is {wish.disk:g}, and the most that any bandwidth keeps with damping {wish.damping:g}"
    what += f", integral {wish.integral:g}"
    every = [ratio for _, _, ratios, _ in rows for ratio in ratios]
    unsure = min(every) < max(every)
    what += (
        f" and {digits(min(every), 2)} to {digits(max(every), 2)} times the believed gain"
        if unsure
        else ""
    )
    other = replace(wish, damping=max(DAMPED, wish.damping), integral=0.0)
    here = most(wish)
    there = most(other)
    mend = f"ask for that, or with damping={other.damping:g}, integral=0 for up to {floor(100 * there) / 100:g}"
    mend += ", or identify the inertias better" if unsure else ""
    return f"{what} is {floor(100 * here) / 100:g}", mend if there > here else "ask for that"


def lowered(
    hz: float, wish: Wish, ratios: Sequence[float], drive: tuple[Signal, ...] = ()
) -> float | None:
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
    found = fastest(
        lambda bandwidth: bandwidth < hz and enough(bandwidth), SLOWEST_SEARCHED / wish.dt
    )
    return None if found is None else found * (LAYERED if wish.robust and not isfinite(hz) else 1.0)


def fastest(enough: Callable[[float], bool], start: float) -> float | None:
    """Return the highest bandwidth up to which, from about `start` on, all tried are enough, Hz; None: not `start`.

    The bandwidths tried are the same whatever is asked for: what is enough for less never gets a lower answer.
    """
    low = SKIPPED_AT_ONCE * floor(TRIED_PER_OCTAVE * log2(start) / SKIPPED_AT_ONCE)
    if not enough(2 ** (low / TRIED_PER_OCTAVE)):
        return None
    while enough(2 ** ((low + SKIPPED_AT_ONCE) / TRIED_PER_OCTAVE)):
        low += SKIPPED_AT_ONCE
    high = low + SKIPPED_AT_ONCE
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if enough(2 ** (middle / TRIED_PER_OCTAVE)) else (low, middle)
    return float(2 ** (low / TRIED_PER_OCTAVE))
