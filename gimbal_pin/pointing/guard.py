"""What stands between failing sensors and a controller: every reading is checked, replaced or given up, and told of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import dist, hypot, isfinite
from operator import eq
from typing import NamedTuple

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.pointing.measurement import Measurement

NONE = (0, 0, 0, 0, 0)
KEPT = (None, None, None, None, None)
"""Of the channels, that none fails or repeats, and that none is lost."""
CHANNELS = ("q", "gyro", "w", "f", "links")
NAMES = {
    "q": "the encoders",
    "gyro": "the camera's gyro",
    "w": "the platform's gyro",
    "f": "the platform's accelerometer",
    "links": "a gyro between platform and camera",
}
HELD = 20
"""Samples over which a reading that fails is bridged; then the sensor counts as lost."""
REPEATS = 5
"""A noisy reading that repeats itself so often is frozen."""
MOVED = 2e-3
"""An angle that stays the same while the gyros say that the joint moved by this is frozen, rad."""
BACK = 100
"""Good samples after which a lost sensor is believed again."""
GAP = 0.2
"""A longer step of the clock is the clock's own, s."""
FASTEST = 100.0
"""No gyro of a gimbal reads more, rad/s."""
FARTHEST = 1e5
"""No encoder of a gimbal reads more, rad: single precision steps by 8 mrad there, with which no camera is held."""
STRONGEST = 2000.0
"""No accelerometer reads more, m/s²: those of the widest range end at 200 g."""
MOST_OF = {"q": FARTHEST, "f": STRONGEST}
"""Largest readings of the channels that are no gyros."""
SMOOTHING = 0.003
"""Time constant of the encoders' rates, which stand in for a lost gyro, s."""
MOST = 50
"""Events that are kept."""


class Watch(NamedTuple):
    """What the guard remembers.

    Attributes:
        raw: The readings of the last sample, as they came.
        good: The same, checked.
        before: That of the sample before it.
        failing: Failing samples in a row, per channel.
        repeating: Equal samples in a row, per channel.
        healthy: Good samples in a row since it was lost, per channel; None for a channel that is not lost.
        moved: What the gyros say that each joint has moved since its angle last changed, rad, (n,).
        rates: Joint rates, rad/s, (n,): from the encoders where something fails, else the gyros'.
        swings: Largest changes from sample to sample of late, per channel, rad, rad/s or m/s².
        clock: What to add to a stamp for an even clock, s.
        events: What happened, in sentences.
    """

    raw: Measurement
    good: Measurement
    before: Measurement
    failing: tuple[int, ...]
    repeating: tuple[int, ...]
    healthy: tuple[int | None, ...]
    moved: Array
    rates: Array
    swings: tuple[float, ...]
    clock: float = 0.0
    events: tuple[str, ...] = ()

    @property
    def lost(self) -> frozenset[str]:
        """Channels that are given up."""
        return frozenset(
            name for name, healthy in zip(CHANNELS, self.healthy) if healthy is not None
        )

    @property
    def calm(self) -> bool:
        """Whether nothing fails, nothing repeats, and nothing is lost."""
        return self.failing == NONE == self.repeating and self.healthy == KEPT

    @property
    def doubtful(self) -> frozenset[str]:
        """Channels that are given up, or whose last reading was not used."""
        return self.lost | {name for name, failing in zip(CHANNELS, self.failing) if failing}

    def with_event(self, event: str) -> Watch:
        """Return the memory with one event more, unless it is full."""
        return self._replace(events=(*self.events, event)) if len(self.events) < MOST else self


@dataclass(frozen=True)
class Guard:
    """Checks every reading: finite, plausible, no spike, not frozen, in time.

    A reading that fails is replaced by the last good one, for at most `HELD` samples (encoders go on with the joint
    rates); then the sensor counts as lost, until `BACK` samples were good in a row.

    A spike is a change `times` as large as any of late, from both samples before it: where a smaller wrong reading
    went through, the next right one does. The sample after a spike is believed whatever it says: a blow to the
    platform is held up by a sample, and from then on its changes are those of late.

    Attributes:
        dt: Sampling interval, s.
        noisy: Whether the gyros and the accelerometer have noise: readings that repeat are then frozen.
        times: How many times as large as those of late a change is a spike.
        lasting: Time constant with which the changes of late are forgotten, s.
        least: Changes that are none, per channel, rad, rad/s or m/s²: they move no camera.
        first: Changes of late before there were any, in `least`.
    """

    dt: float
    noisy: bool = True
    times: float = 1.5
    lasting: float = 1.0
    least: tuple[float, ...] = (0.01, 0.03, 0.03, 3.0, 0.03)
    first: float = 3.0

    def start(self, seen: Measurement) -> Watch:
        """Memory at the first sample; readings that fail there count as zero."""
        zero = {
            name: np.zeros_like(getattr(seen, name))
            for name in CHANNELS
            if not self.plausible(name, seen)
        }
        good = seen._replace(t=seen.t - self.dt, **zero)
        still = np.zeros(len(seen.q))
        return Watch(
            seen,
            good,
            good,
            NONE,
            NONE,
            KEPT,
            still,
            still,
            tuple([self.first * most for most in self.least]),
        )

    def step(
        self, seen: Measurement, watch: Watch, v: Array, steep: bool = False
    ) -> tuple[Measurement, Watch]:
        """Return the sample as it may be used, and the next memory.

        Args:
            seen: The sample.
            watch: The memory.
            v: Joint rates so far, by the gyros, rad/s, (n,).
            steep: Whether that was near a singular pose: there gyros tell that joints move, and not which.
        """
        t, watch = self.timed(seen.t, watch)
        same = seen.q == watch.raw.q
        moved = (watch.moved + (t - watch.good.t) * v) * (same.all() if steep else same)
        changes = self.changes(t, seen, watch.good)
        steady = [change <= bound for change, bound in zip(changes, self.bounds(watch))]
        if watch.calm and all(steady) and self.sound(seen, watch.raw, moved):
            good = seen if t == seen.t else Measurement(t, *seen[1:])
            swings = self.swung(watch.swings, changes)
            return good, Watch(
                seen,
                good,
                watch.good,
                NONE,
                NONE,
                KEPT,
                moved,
                v,
                swings,
                watch.clock,
                watch.events,
            )
        return self.sifted(t, seen, watch, v, moved)

    def changes(self, t: float, seen: Measurement, good: Measurement) -> list[float]:
        """Changes of every channel since the last sample; none where samples are missing between."""
        if t - good.t > 1.5 * self.dt:
            return [0.0] * len(CHANNELS)
        # Unlike numpy's these do not warn of numbers whose squares are none.
        return [dist(now.tolist(), old.tolist()) for now, old in zip(seen[1:6], good[1:6])]

    def bounds(self, watch: Watch) -> list[float]:
        """Largest changes that are no spikes."""
        return [max(self.times * swing, most) for swing, most in zip(watch.swings, self.least)]

    def swung(self, swings: Sequence[float], changes: Sequence[float]) -> tuple[float, ...]:
        """Changes of late with those of a sample."""
        kept = 1 - self.dt / self.lasting
        return tuple([max(kept * old, new) for old, new in zip(swings, changes)])

    def sound(self, seen: Measurement, before: Measurement, moved: Array) -> bool:
        """Whether all readings are plausible, none is frozen, and none repeats: the quick way through.

        Sizes are looked at instead of entries, which is stricter; whatever is not quite sound is sifted.
        """
        gyro = seen.gyro
        w = seen.w
        f = seen.f
        links = seen.links
        slow = hypot(*gyro.tolist(), *w.tolist(), *links.tolist()) < FASTEST
        near = hypot(*seen.q.tolist()) < FARTHEST and hypot(*f.tolist()) < STRONGEST
        if not (slow and near and hypot(*moved.tolist()) < MOVED):
            return False
        return not self.noisy or not (
            gyro.item(0) == before.gyro.item(0)
            or w.item(0) == before.w.item(0)
            or f.item(0) == before.f.item(0)
            or any(map(eq, links.tolist()[::3], before.links.tolist()[::3]))
        )

    def smoothed(self, good: Measurement, watch: Watch) -> Array:
        """Joint rates from the encoders, rad/s, (n,)."""
        elapsed = good.t - watch.good.t
        share = min(1.0, elapsed / SMOOTHING)
        return np.asarray(watch.rates + share * ((good.q - watch.good.q) / elapsed - watch.rates))

    def sifted(
        self, t: float, seen: Measurement, watch: Watch, v: Array, moved: Array
    ) -> tuple[Measurement, Watch]:
        """Look at every channel by itself."""
        elapsed = t - watch.good.t
        replaced = {}
        failing = list(watch.failing)
        repeating = list(watch.repeating)
        healthy = list(watch.healthy)
        bounds = self.bounds(watch)
        before = watch.before._replace(t=watch.good.t)
        rows = zip(self.changes(t, seen, watch.good), self.changes(t, seen, before), bounds)
        changes = [back if change > most >= back else change for change, back, most in rows]
        for i, name in enumerate(CHANNELS):
            fine = self.plausible(name, seen) and (failing[i] > 0 or changes[i] <= bounds[i])
            if name == "q":
                fine = fine and (any(failing[1:3]) or float(np.abs(moved).max()) < MOVED)
            elif self.noisy:
                now = getattr(seen, name)
                old = getattr(watch.raw, name)
                same = fine and len(now) > 0 and bool((now == old).reshape(-1, 3).all(axis=1).any())
                repeating[i] = repeating[i] + 1 if same else 0
                fine = fine and repeating[i] < REPEATS
            failing[i] = 0 if fine else failing[i] + 1
            if not fine:
                changes[i] = 0.0
                replaced[name] = getattr(watch.good, name)
                if name == "q":
                    replaced[name] = replaced[name] + np.where(
                        (moved != 0) & (failing[i] == 1), moved, elapsed * v
                    )
            healthy[i], watch = self.judged(t, name, failing[i], healthy[i], watch)
        good = seen._replace(t=t, **replaced)
        rates = self.smoothed(good, watch)
        counts = (tuple(failing), tuple(repeating), tuple(healthy))
        swings = self.swung(watch.swings, changes)
        return good, Watch(
            seen, good, watch.good, *counts, moved, rates, swings, watch.clock, watch.events
        )

    def timed(self, stamp: float, watch: Watch) -> tuple[float, Watch]:
        """Return an even time for a stamp, s: a gap is real, a jump is the clock's."""
        elapsed = stamp + watch.clock - watch.good.t
        if not isfinite(stamp) or not 0 < elapsed <= GAP:
            t = watch.good.t + self.dt
            said = f"{t:.3f} s: the clock stepped by {elapsed - self.dt:.3g} s, it is taken as even"
            clock = t - stamp if isfinite(stamp) else watch.clock
            return t, watch._replace(clock=clock).with_event(said)
        if elapsed > 1.5 * self.dt:
            lost = round(elapsed / self.dt) - 1
            watch = watch.with_event(
                f"{watch.good.t + elapsed:.3f} s: {lost} sample{'s' * (lost > 1)} never came"
            )
        return stamp + watch.clock, watch

    def plausible(self, name: str, seen: Measurement) -> bool:
        """Whether a reading is one at all."""
        most = MOST_OF.get(name, FASTEST)
        return all(-most < value < most for value in getattr(seen, name).tolist())

    def judged(
        self, t: float, name: str, failing: int, healthy: int | None, watch: Watch
    ) -> tuple[int | None, Watch]:
        """Return for how long a lost channel has been good, None if it is not lost, and the memory."""
        if healthy is None:
            if failing == 1:
                watch = watch.with_event(
                    f"{t:.3f} s: {NAMES[name]} failed, the last reading is held"
                )
            if failing > HELD:
                return 0, watch.with_event(f"{t:.3f} s: {NAMES[name]} given up: {FALLBACK[name]}")
            return None, watch
        if failing:
            return 0, watch
        if healthy + 1 >= BACK:
            return None, watch.with_event(f"{t:.3f} s: {NAMES[name]} believed again")
        return healthy + 1, watch


FALLBACK = {
    "q": "angles go on from the gyros",
    "gyro": "the camera's rate comes from the platform's gyro and the encoders, PID at half the bandwidth",
    "w": "PID on the camera's attitude, without feed-forward",
    "f": "PID on the camera's attitude, without feed-forward",
    "links": "the camera's own gyro alone",
}
"""What happens without a sensor."""
