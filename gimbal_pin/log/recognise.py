"""What a log's columns are: by what their names say, and by what their values do to each other.

A rate is what adds up to an angle: over a few hundred intervals ``x(b) - x(a) = k sum v dt``, and k tells their units.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf, isfinite, pi
from typing import NamedTuple

import numpy as np

from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array
from gimbal_pin.rig import urdf
from gimbal_pin.rig.naming import ROW, words
from gimbal_pin.rig.rig import Rig

WORDS = {
    "temperature": "temp temps temperature celsius",
    "gyro": "gyr gyro gyros angvel",
    "accel": "acc accel accelerometer",
    "quaternion": "quat quaternion orientation",
    "attitude": "euler rpy attitude",
    "torque": "tau torque torques effort trq moment",
    "current": "iq current currents curr amps amp ampere",
    "voltage": "uq ud vsupply voltage volt volts vbus",
    "rate": "vel velocity velocities dq qd qdot speed omega rate velo rpm dps",
    "position": "pos position positions angle angles theta q ang encoder enc winkel counts ticks",
}
KINDS: Mapping[str, frozenset[str]] = {kind: frozenset(text.split()) for kind, text in WORDS.items()}
"""Kind of channel → words of which one stands in its name; the first kind that has one."""
WANTED = {"des", "desired", "ref", "reference", "cmd", "command", "commanded", "target", "setpoint", "sp", "goal"}
"""Words of what was asked for, which nobody measured."""
MEASURED, PLAIN, DERIVED, CONTROLLER = 0, 1, 2, 3
RANK = {
    **dict.fromkeys(("meas", "measured", "actual", "raw"), MEASURED),
    **dict.fromkeys(("filt", "filtered", "filter", "est", "estimated", "smooth", "lp"), DERIVED),
    **dict.fromkeys(("con", "control", "ctrl", "fric", "friction", "ff", "feedforward", "ext", "int"), CONTROLLER),
}
"""Words beside a kind's → which of several columns of one joint is taken: the lowest."""
UNITS: Mapping[str, Mapping[str, str]] = {
    "position": {"rad": "rad", "deg": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "counts": "counts",
                 "ticks": "counts", "turns": "turns", "rev": "turns", "revs": "turns", "mrad": "mrad"},
    "gyro": {"rad": "rad", "deg": "deg", "dps": "deg"},
    "current": {"ma": "mA", "milliamps": "mA"},
    "rate": {"rad": "rad", "deg": "deg", "dps": "deg", "rpm": "rpm", "rps": "turns", "turns": "turns"},
}  # fmt: skip
"""Words in a name that say its unit."""
FACTORS = {"rad": "", "deg": "pi/180", "turns": "2*pi", "mrad": "1e-3", "rpm": "pi/30", "mA": "1e-3"}
"""Unit → its radians or amperes, as a mapping writes it."""
VALUES = {"rad": 1.0, "deg": pi / 180, "turns": 2 * pi, "mrad": 1e-3, "rpm": pi / 30}
TIME_UNITS = (("s", 1.0, ""), ("ms", 1e-3, "1e-3"), ("µs", 1e-6, "1e-6"), ("ns", 1e-9, "1e-9"))
TIME_WORDS = {"s": 0, "sec": 0, "secs": 0, "seconds": 0, "ms": 1, "msec": 1, "millis": 1, "us": 2, "usec": 2,
              "micros": 2, "ns": 3, "nsec": 3, "nanos": 3}  # fmt: skip
SLOWEST = 5.0
"""Samples a second below which nobody logs a joint: the coarsest unit of time that makes it faster is the clock's."""
INTERVALS = 300
"""Over so many intervals rates are added up: each holds noise of the angle twice only."""
ALIKE = 0.9
"""Least correlation of an angle's ways with its rate's sums: in the measured logs of the tests it is over 0.97."""
NEAR = 0.1
"""Relative error of k up to which it is a ratio of units: slow filters of a rate take some of its size."""
EXPLAINED = 0.5
"""Least share of a column that the joints' motion explains for it to be a torque: in the measured logs of the tests,
names taken away, torques and currents have 0.79 to 1 (two have 0.45), references and supply voltages 0.36 at most."""
OFF = 3.0
"""Ratio from which a rate in no known unit is given what makes it its angle's rate: readers refuse it otherwise."""
FAST = 6.0
"""A platform that turns faster, rad/s rms, is most likely given in degrees (as `platform_log` refuses it)."""
AVERAGED = 0.05
"""Time over which motion and torque are averaged before they are compared, s: differentiated steps of encoders go."""
POWERS = range(6, 25)
"""Powers of two that encoders count in a turn: 64 to 16 million."""


@dataclass(frozen=True, eq=False)
class Channel:
    """One column.

    Attributes:
        column: Its name.
        kind: One of `KINDS`, "time", "constant", "copy" or "unknown"; "reference" is a position that was asked for.
        unit: rad, deg, turns, counts, rpm, s, ms, …, "A", "N m"; empty where nothing tells.
        factor: What it is multiplied by to be in SI units, as a mapping writes it.
        joint: The rig's joint that it is of, or None.
        reasons: Why.
        low: Least value.
        high: Largest value.
        step: Its quantum; 0 where it has none.
    """

    column: str
    kind: str
    unit: str
    factor: str
    reasons: tuple[str, ...]
    low: float
    high: float
    step: float
    joint: str | None = None


@dataclass(eq=False)
class Guess:
    """What is thought of a column so far."""

    column: str
    values: Array
    kind: str = "unknown"
    unit: str = ""
    factor: str = ""
    wanted: bool = False
    rate_of: str = ""
    scale: float = 1.0
    reasons: list[str] = field(default_factory=list)

    def say(self, reason: str) -> None:
        """Add a reason."""
        self.reasons.append(reason)

    @property
    def still(self) -> bool:
        """Whether it never changes."""
        return bool(np.ptp(self.values) == 0)


@dataclass(frozen=True, eq=False)
class Recognised:
    """What a log holds for a rig.

    Attributes:
        channels: Every column.
        mapping: Target → (column, factor, remark) for the rig, in the CONTRACT's order; empty without a rig.
        missing: Targets that a log of the rig needs and that nothing here is.
        t: Times, s, of the samples that are later than all before them, (M,).
        guesses: What is thought of each column at these times.
        scale: Seconds of one unit of the times.
    """

    channels: tuple[Channel, ...]
    mapping: Mapping[str, tuple[str, str, str]]
    missing: tuple[str, ...]
    t: Array
    guesses: Mapping[str, Guess]
    scale: float


def recognise(time: str, data: Mapping[str, Array], rig: Rig | None = None) -> Recognised:
    """Return what the columns of one stream are, for a rig if one is given.

    Args:
        time: Name of the column of times, or `ROW`: how far two samples are apart then shows where a rate's name says
            so and it adds up to an angle.
        data: Column → values, (N,) each.
        rig: Whose joints they may be of.
    """
    unit, scale, factor, why = time_unit(time, data[time])
    later = np.diff(np.maximum.accumulate(data[time]), prepend=-inf) > 0
    t = data[time][later] * scale
    guesses = {name: named(name, values[later]) for name, values in data.items() if name != time}
    copies(guesses.values())
    moving = [guess for guess in guesses.values() if not guess.still]
    kinds = ("position", "rate") if time == ROW else ("position", "rate", "unknown", "attitude", "gyro")
    ties = relations(t, [guess for guess in moving if guess.kind in kinds])
    by_motion(ties, guesses)
    if time == ROW and (known := interval(ties, guesses)) is not None:
        scale, factor, why = known, f"{known:.4g}", "the rates add up to the angles with so many seconds a sample"
        t, ties = t * scale, [tie._replace(ratio=tie.ratio / scale) for tie in ties]
    limits = [] if rig is None else [limit.upper - limit.lower for limit in rig.limits]
    units(ties, guesses, [room for room in limits if isfinite(room)], bool(limits))
    for guess in guesses.values():
        if guess.kind in ("rate", "gyro") and guess.unit in ("rad", "deg", "turns"):
            guess.unit += "/s"
    mapping: dict[str, tuple[str, str, str]] = {}
    if rig is not None:
        mapping = {"t": (time, factor, why), **assigned(t, guesses, rig)}
        if time == ROW and not factor:
            del mapping["t"]
    owner = {column: target.partition("_")[2] for target, (column, _, _) in mapping.items() if target != "t"}
    channels = [Channel(time, "time", unit, factor, (why,), float(data[time].min()), float(data[time].max()), 0.0)]
    for guess in guesses.values():
        joint = owner.get(guess.column, "").removeprefix("ref_")
        channels.append(Channel(
            guess.column, "reference" if guess.wanted and guess.kind == "position" else guess.kind,
            guess.unit, guess.factor, tuple(guess.reasons), float(guess.values.min()), float(guess.values.max()),
            quantum(guess.values), joint if rig is not None and joint in rig.joints else None))  # fmt: skip
    needed = [] if rig is None else [f"{prefix}_{joint}" for prefix in ("q", "tau") for joint in rig.joints]
    missing = tuple(target for target in needed if target not in mapping)
    return Recognised(tuple(channels), mapping, missing, t, guesses, scale)


def assigned(t: Array, guesses: Mapping[str, Guess], rig: Rig) -> dict[str, tuple[str, str, str]]:
    """Return target → (column, factor, remark) of what columns are thought to be, those of several streams together."""
    return Assignment(t, guesses, rig, urdf.names(urdf.parse(rig.urdf, str(rig.path)), "link")).mapping()


def interval(ties: Sequence[Tie], guesses: Mapping[str, Guess]) -> float | None:
    """Return the seconds from row to row by which rates add up to angles; of units that no name says, the same."""
    for tie in ties:
        x, v = guesses[tie.x], guesses[tie.v]
        if v.rate_of == tie.x:
            return abs(tie.ratio) * VALUES.get(x.unit, 1.0) / VALUES.get(v.unit, VALUES.get(x.unit, 1.0))
    return None


def time_unit(name: str, t: Array) -> tuple[str, float, str, str]:
    """Return unit, its seconds, the mapping's factor and why: by the name's last word, or by the usual interval."""
    if name == ROW:
        return ROW, 1.0, "", "the sample's number"
    split = words(name)
    step = float(np.median(np.abs(np.diff(t)))) if len(t) > 1 else 0.0
    if split and split[-1] in TIME_WORDS:
        unit, scale, factor = TIME_UNITS[TIME_WORDS[split[-1]]]
        return unit, scale, factor, f"its name says {unit}"
    for unit, scale, factor in TIME_UNITS:
        if 0 < step * scale <= 1 / SLOWEST:
            return unit, scale, factor, f"increases by {digits(step, 3)}: {digits(1 / (step * scale), 3)} Hz in {unit}"
    return "s", 1.0, "", "nothing tells its unit"


def named(column: str, values: Array) -> Guess:
    """Return what a name says of a column."""
    guess, split = Guess(column, values), words(column)
    kind = next((kind for kind, known in KINDS.items() if known & set(split)), None)
    if {"angular", "velocity"} <= set(split):
        kind = "gyro"
    elif {"linear", "acceleration"} <= set(split):
        kind = "accel"
    if kind is not None:
        guess.kind = kind
        guess.say(f"its name says {kind}")
    guess.wanted = bool(WANTED & set(split))
    if guess.still:
        guess.say("never changes")
        guess.kind = guess.kind if kind is not None else "constant"
    if (
        kind is not None
        and kind in UNITS
        and (unit := next((UNITS[kind][word] for word in split if word in UNITS[kind]), ""))
    ):
        guess.unit = unit
        guess.say(f"its name says {unit}")
    return guess


def measured_motion(column: str, values: Array) -> bool:
    """Tell whether a column is an angle or a rate that was measured, by its name."""
    guess = named(column, values)
    return guess.kind in ("position", "rate", "gyro", "attitude") and not guess.wanted


def copies(guesses: Iterable[Guess]) -> None:
    """Say of columns that they are another once more."""
    known: dict[bytes, str] = {}
    for guess in guesses:
        if not guess.still and (first := known.setdefault(guess.values.tobytes(), guess.column)) != guess.column:
            guess.say(f"the same as '{first}'")
            guess.kind = "copy" if guess.kind == "unknown" else guess.kind


class Tie(NamedTuple):
    """One column adds up to another: ``x = k sum v dt`` with that correlation."""

    correlation: float
    ratio: float
    x: str
    v: str


def relations(t: Array, guesses: Sequence[Guess]) -> list[Tie]:
    """Return every pair of which one is the other's rate, the surest first."""
    ends = np.unique(np.linspace(0, len(t) - 1, INTERVALS + 1).astype(int))
    if len(ends) < 10:
        return []
    steps = np.diff(t)
    ways = {guess.column: np.diff(guess.values[ends]) for guess in guesses}
    sums = {
        guess.column: np.diff(
            np.concatenate([[0.0], np.cumsum((guess.values[1:] + guess.values[:-1]) / 2 * steps)])[ends]
        )
        for guess in guesses
    }
    found = []
    for x, way in ways.items():
        for v, total in sums.items():
            size, other, both = float(way @ way), float(total @ total), float(way @ total)
            if x != v and size and other and abs(both) > ALIKE * (size * other) ** 0.5:
                ratio = np.sign(both) * (size / other) ** 0.5
                found.append(Tie(abs(both) / (size * other) ** 0.5, float(ratio), x, v))
    return sorted(found, reverse=True)


def by_motion(ties: Sequence[Tie], guesses: Mapping[str, Guess]) -> None:
    """Say of columns that their names leave open which are angles and which rates; and of rates, whose.

    Of two that their names call angle and rate, those first that differ in nothing else.
    """
    for strict in (True, False):
        for tie in ties:
            x, v = guesses[tie.x], guesses[tie.v]
            free = x.kind == "unknown" or v.kind == "unknown"
            taken = x.rate_of or v.rate_of or x.column in {guess.rate_of for guess in guesses.values()}
            if taken or x.kind not in ("position", "unknown") or v.kind not in ("rate", "unknown"):
                continue
            if same_unit(tie.ratio) is not None if free else x.wanted == v.wanted and alike(x.column, v.column, strict):
                x.kind, v.kind, v.rate_of = "position", "rate", x.column


def alike(one: str, other: str, strict: bool) -> bool:
    """Tell whether names have the same numbers and joints, and if that is asked for say the same way to know it."""
    strip = KINDS["position"] | KINDS["rate"] | (frozenset() if strict else RANK.keys())
    return set(words(one)) - strip == set(words(other)) - strip


def same_unit(ratio: float) -> tuple[str, str] | None:
    """Return the units of an angle and a rate whose ratio is k, the plainest; None where it is of none."""
    pairs = [("rad", "rad"), ("rad", "deg"), ("deg", "rad"), ("rad", "rpm"), ("deg", "rpm"), ("turns", "rpm"),
             ("turns", "rad"), ("rad", "turns")]  # fmt: skip
    return next((p for p in pairs if abs(abs(ratio) * VALUES[p[0]] / VALUES[p[1]] - 1) < NEAR), None)


def units(ties: Sequence[Tie], guesses: Mapping[str, Guess], rooms: Sequence[float], with_rig: bool) -> None:
    """Say in which units angles and rates are, and by what they are multiplied."""
    for guess in guesses.values():
        if guess.kind in ("position", "attitude"):
            unit_of_angle(guess, max(rooms, default=inf), with_rig)
    for guess in guesses.values():
        if guess.kind == "rate" and guess.rate_of:
            x = guesses[guess.rate_of]
            tie = next(tie for tie in ties if (tie.x, tie.v) == (guess.rate_of, guess.column))
            true = tie.ratio * x.scale  # rad/s in a unit of the column
            guess.unit = guess.unit or next((u for u, v in VALUES.items() if abs(abs(true) / v - 1) < NEAR), "")
            guess.say(f"adds up to '{x.column}' (factor {digits(tie.ratio, 3)}, correlation {tie.correlation:.3f})")
            guess.factor = ("-" if true < 0 else "") + FACTORS.get(guess.unit, "")
            if not guess.unit and not 1 / OFF < abs(true) < OFF:
                guess.factor = f"{true:.4g}"
        elif guess.kind == "rate":
            guess.unit = guess.unit or "rad"
            guess.factor = FACTORS.get(guess.unit, "")
        elif guess.kind == "gyro":
            unit_of_gyro(guess, ties, guesses)
        elif guess.kind == "accel":
            unit_of_accel(guess, guesses)
        elif guess.kind == "torque":
            guess.unit = "N m"
        elif guess.kind == "current":
            guess.unit = guess.unit or "A"
            guess.factor = FACTORS.get(guess.unit, "")


def unit_of_angle(guess: Guess, room: float, with_rig: bool) -> None:
    """Say in which unit an angle is: by its name, a quantum that parts a turn, how far it goes, and the rig's room."""
    x = guess.values
    way = float(np.ptp(x))
    step = quantum(x)
    if guess.unit == "counts":
        turn = next((2**k for k in POWERS if 0.98 * 2**k <= np.abs(x).max() <= 1.001 * 2**k), None)
        guess.factor, guess.scale = (f"2*pi/{turn}", 2 * pi / turn) if turn else ("", 1.0)
        guess.say(f"goes to {digits(float(np.abs(x).max()), 4)}: {turn} counts a turn" if turn
                  else "how many counts a turn has does not show: multiply by 2*pi/(counts per turn)")  # fmt: skip
        return
    if not guess.unit:
        parts = {unit: turn / step for unit, turn in (("rad", 2 * pi), ("deg", 360.0)) if step}
        # By chance a step is that near to one of the 19 powers of two in 1 of 3500 logs (2e-4 / log 2).
        exact = [unit for unit, n in parts.items() if any(abs(n / 2**k - 1) < 1e-4 for k in POWERS)]
        goes_on = abs(x[-1] - x[0]) > 0.5 * way
        if exact:
            guess.unit = exact[0]
            guess.say(f"its step of {digits(step, 3)} {exact[0]} parts a turn into {parts[exact[0]]:.0f}")
        elif isfinite(room) and way > 1.5 * room:
            guess.unit = "deg"
            guess.say(f"goes {digits(way, 3)}, more than the {digits(room, 3)} rad that the rig leaves")
        elif not with_rig and way > 4 * pi and not goes_on and np.abs(x).max() < 400:
            guess.unit = "deg"
            guess.say(f"goes to and fro over {digits(way, 3)}, more than two turns in radians")
        elif guess.kind == "attitude" and np.abs(x).max() > 2 * pi:
            guess.unit = "deg"
            guess.say(f"an attitude reaches {digits(float(np.abs(x).max()), 3)}, which no radians do")
        else:
            guess.unit = "rad"
            guess.say(f"goes {digits(way, 3)}" + (" and on: it turns" if way > 4 * pi else ", as radians do"))
    guess.factor, guess.scale = FACTORS.get(guess.unit, ""), VALUES.get(guess.unit, 1.0)


def unit_of_gyro(guess: Guess, ties: Sequence[Tie], guesses: Mapping[str, Guess]) -> None:
    """Say in which unit a gyro is: that of an attitude that it adds up to, or by its size."""
    tie = next((tie for tie in ties if tie.v == guess.column and guesses[tie.x].kind == "attitude"), None)
    beside = [other for other in guesses.values() if other.kind == "gyro"]
    most = max(float(np.sqrt(np.mean(other.values**2))) for other in beside)
    if not guess.unit and tie is not None and same_unit(tie.ratio) == ("rad", "rad"):
        guess.unit = guesses[tie.x].unit
        guess.say(f"adds up to '{tie.x}' (factor {digits(tie.ratio, 3)}, correlation {tie.correlation:.3f})")
    elif not guess.unit:
        guess.unit = "deg" if most > FAST else "rad"
        fast = ", too fast for rad/s" if most > FAST else ""
        guess.say(f"the gyro's largest axis has {digits(most, 3)} rms{fast}")
    guess.factor = FACTORS[guess.unit]


def unit_of_accel(guess: Guess, guesses: Mapping[str, Guess]) -> None:
    """Say in which unit an accelerometer is, by the size of what its axes feel together."""
    size = float(np.median(np.sqrt(sum(other.values**2 for other in guesses.values() if other.kind == "accel"))))
    guess.unit = "g" if 0.5 < size < 2.0 else "m/s²"
    guess.factor = "9.80665" if guess.unit == "g" else ""
    guess.say(f"its axes' size is {digits(size, 3)} most of the time")


def quantum(x: Array) -> float:
    """Return the step of which nearly all differences between values are multiples; 0 where there is none."""
    distinct = np.unique(x)
    steps = np.diff(distinct)
    steps = steps[steps > 1e-9 * max(np.abs(distinct).max(), 1e-300)]
    if len(steps) < 5 or len(distinct) > 0.98 * len(x):  # nearly all values differ: no step shows
        return 0.0
    one = float(np.median(steps[steps <= 1.5 * np.quantile(steps, 0.05)]))
    count = np.round(steps / one)
    one = float(np.sum(steps * count) / np.sum(count**2)) if count.any() else one
    off = np.abs(steps / one - np.round(steps / one))
    return one if np.mean(off < 0.05) > 0.95 else 0.0


@dataclass(frozen=True, eq=False)
class Assignment:
    """Which column is which joint's.

    Attributes:
        t: Time, s, (N,).
        guesses: What the columns are.
        rig: Whose joints.
        links: The rig's links.
    """

    t: Array
    guesses: Mapping[str, Guess]
    rig: Rig
    links: Sequence[str]

    def mapping(self) -> dict[str, tuple[str, str, str]]:
        """Return target → (column, factor, remark), in the CONTRACT's order."""
        found: dict[str, tuple[str, str, str]] = {}
        q = self.joints("position", wanted=False)
        v = self.rates(q)
        tau = self.joints("torque", wanted=False) or self.joints("current", wanted=False) or self.torques(q, v)
        kinds = {"q": q, "dq": v, "tau": tau, "q_ref": self.joints("position", wanted=True),
                 "temp": self.joints("temperature", wanted=False)}  # fmt: skip
        for prefix, columns in kinds.items():
            for joint, column in columns.items():
                guess = self.guesses[column]
                remark = guess.reasons[-1] if guess.reasons else ""
                if prefix == "tau" and guess.kind == "current":
                    remark = "a current, A: multiply it by the motor's torque constant, N m per A"
                found[f"{prefix}_{joint}"] = (column, guess.factor, remark)
        for kind, prefix, axes in (("gyro", "gyro", "xyz"), ("accel", "accel", "xyz"), ("quaternion", "quat", "wxyz")):
            found |= self.imu(kind, prefix, axes)
        return found

    def joints(self, kind: str, wanted: bool) -> dict[str, str]:
        """Return joint → column of a kind: of the columns that differ by joint alone, the best that all joints have."""
        sets: dict[tuple[str, ...], dict[str, str]] = {}
        several = [g for g in self.guesses.values() if g.kind == kind and g.wanted == wanted and not g.still]
        for guess in several:
            split = words(guess.column)
            joint = self.joint_of(split)
            rest = tuple(word for word in split if not word.isdigit() and word not in KINDS[kind]
                         and (joint is None or word not in words(joint)))  # fmt: skip
            key = joint or next((word for word in reversed(split) if word.isdigit()), "")
            sets.setdefault(rest, {}).setdefault(key, guess.column)
        complete = [(self.rank(rest), k, self.ordered(each)) for k, (rest, each) in enumerate(sets.items())]
        best = min((one for one in complete if one[2]), default=None, key=lambda one: one[:2])
        if best is None and len(several) == self.rig.n:
            return dict(zip(self.rig.joints, (guess.column for guess in several)))
        return best[2] if best is not None else {}

    def ordered(self, each: Mapping[str, str]) -> dict[str, str]:
        """Return joint → column of columns by joint or by number; empty unless every joint has one."""
        if set(self.rig.joints) <= each.keys():
            return {joint: each[joint] for joint in self.rig.joints}
        numbered = sorted((int(key), column) for key, column in each.items() if key.isdigit())
        if len(numbered) == self.rig.n and all(b - a == 1 for (a, _), (b, _) in pairwise(numbered)):
            return dict(zip(self.rig.joints, (column for _, column in numbered)))
        return dict(zip(self.rig.joints, each.values())) if len(each) == self.rig.n == 1 else {}

    def joint_of(self, split: Sequence[str]) -> str | None:
        """Return the joint whose whole name stands in a column's, of several the longest."""
        inside = [joint for joint in self.rig.joints if set(words(joint)) <= set(split)]
        return max(inside, key=lambda joint: len(words(joint)), default=None)

    @staticmethod
    def rank(rest: Sequence[str]) -> int:
        """Return how far from a measurement the words of a name are."""
        return max((RANK.get(word, PLAIN) for word in rest), default=PLAIN) if not {
            word for word in rest if RANK.get(word) == MEASURED} else MEASURED  # fmt: skip

    def rates(self, q: Mapping[str, str]) -> dict[str, str]:
        """Return joint → rate: by their names, or those that add up to the angles."""
        found = self.joints("rate", wanted=False)
        by_angle = {guess.rate_of: guess.column for guess in self.guesses.values() if guess.rate_of}
        return found or {joint: by_angle[column] for joint, column in q.items() if column in by_angle}

    def torques(self, q: Mapping[str, str], v: Mapping[str, str]) -> dict[str, str]:
        """Return joint → a column without a name that the joints' motion explains; empty unless there are just n.

        Explained by a constant, all accelerations, rates and their signs, and sines and cosines of the angles' sums
        from the base on (what gravity pulls at), all averaged over `AVERAGED`. The joints are taken in the columns'
        order: what moves one axis of several moves all, so that the share that is explained does not tell them apart.
        """
        free = [guess for guess in self.guesses.values() if guess.kind == "unknown" and not guess.still]
        if not (len(q) == len(v) == self.rig.n and len(free) >= self.rig.n):
            return {}
        if {len(self.guesses[column].values) for column in (*q.values(), *v.values())} != {len(self.t)}:
            return {}
        width = min(max(round(AVERAGED / float(np.median(np.diff(self.t)))), 1), len(self.t) // 4)

        def averaged(x: Array) -> Array:
            return np.convolve(x, np.ones(width) / width, "valid")

        rates = [averaged(self.guesses[v[joint]].values) for joint in self.rig.joints]
        angles = [self.guesses[q[joint]].values * self.guesses[q[joint]].scale for joint in self.rig.joints]
        sums = [averaged(x) for x in np.cumsum(angles, axis=0)]
        at = averaged(self.t)
        parts = [np.ones_like(at), *(np.gradient(x, at) for x in rates), *rates, *map(np.sign, rates)]
        basis = np.column_stack([*parts, *map(np.sin, sums), *map(np.cos, sums)])
        explained = []
        for guess in free:
            y = averaged(guess.values)
            left = y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
            if (share := 1 - float(np.var(left) / max(np.var(y), 1e-300))) > EXPLAINED:
                explained.append(guess)
                guess.say(f"{100 * share:.0f} % of it follow from the joints' motion")
        if len(explained) != self.rig.n:
            return {}
        for guess in explained:
            guess.kind = "torque"
        return dict(zip(self.rig.joints, (guess.column for guess in explained)))

    def imu(self, kind: str, prefix: str, axes: str) -> dict[str, tuple[str, str, str]]:
        """Return target → column of a sensor of three axes, of the link that its name holds or of the base."""
        found: dict[str, tuple[str, str, str]] = {}
        for guess in self.guesses.values():
            split = words(guess.column)
            last = split[-1] if split else ""
            axis = axes[int(last)] if last in ("0", "1", "2") and len(axes) == 3 else last
            if guess.kind == kind and axis in (*axes,):
                links = [link for link in self.links if set(words(link)) <= set(split)]
                link = max(links, key=len, default=self.rig.base)
                found.setdefault(f"{prefix}_{link}_{axis}", (guess.column, guess.factor, guess.reasons[-1]))
        ends = {target[:-2] for target in found}
        whole = {end for end in ends if all(f"{end}_{axis}" in found for axis in axes)}
        return {target: found[target] for target in sorted(found) if target[:-2] in whole}
