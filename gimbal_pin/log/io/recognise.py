"""What a log's columns are: by their names, and by how their values depend on each other.

A rate is what adds up to an angle: over a few hundred intervals ``x(b) - x(a) = k sum v dt``, and k gives their units.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product
from math import inf, isfinite, pi
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array
from gimbal_pin.log.mapping import ROW_COLUMN
from gimbal_pin.rig import urdf
from gimbal_pin.rig.reading import split_words
from gimbal_pin.rig.rig import Rig

_KINDS: Mapping[str, frozenset[str]] = {
    kind: frozenset(text.split())
    for kind, text in {
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
    }.items()
}
"""Kind of channel → words of which one stands in its name; the first kind that has one."""
COMMAND_WORDS = frozenset((
    "des", "desired", "ref", "reference", "references", "cmd", "cmds", "command", "commands", "commanded", "target",
    "targets", "setpoint", "setpoints", "sp", "goal", "goals",
))  # fmt: skip
"""Words in the names of what was asked for, not measured."""
_RANKED = ("meas measured actual raw", "", "filt filtered filter est estimated smooth lp",
           "con control ctrl fric friction ff feedforward ext int")  # fmt: skip
_RANK = {word: rank for rank, text in enumerate(_RANKED) for word in text.split()}
"""Words beside a kind's → which of several columns of one joint is taken: the lowest; 1 is plain."""
_UNITS: Mapping[str, Mapping[str, str]] = {
    "position": {"rad": "rad", "deg": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "counts": "counts",
                 "count": "counts", "cnt": "counts", "cnts": "counts", "inc": "counts", "lsb": "counts",
                 "ticks": "counts", "turns": "turns", "rev": "turns", "revs": "turns", "mrad": "mrad", "mdeg": "mdeg"},
    "gyro": {"rad": "rad", "deg": "deg", "dps": "deg", "mrad": "mrad", "mdps": "mdeg", "mdeg": "mdeg"},
    "current": {"ma": "mA", "milliamps": "mA", "milliamperes": "mA"},
    "rate": {"rad": "rad", "deg": "deg", "dps": "deg", "hz": "turns",
             "counts": "counts", "cnt": "counts", "rpm": "rpm", "rps": "turns", "turns": "turns", "rev": "turns",
             "mrad": "mrad", "mdps": "mdeg", "mdeg": "mdeg"},
    "torque": {"nm": "N m", "mnm": "mN m", "nmm": "N mm", "ncm": "N cm"},
}  # fmt: skip
"""Words in a name that say its unit, as `_read_units` reads them."""
_FACTORS = {"rad": "", "deg": "pi/180", "turns": "2*pi", "mrad": "1e-3", "mdeg": "1e-3*pi/180", "rpm": "pi/30",
           "mA": "1e-3", "N m": "", "mN m": "1e-3", "N mm": "1e-3", "N cm": "1e-2"}  # fmt: skip
"""Unit → its radians, amperes or N m, as a mapping writes it."""
_UNKNOWN = {"rad": "RAD_PER_SECOND", "A": "AMPERES", "N m": "NM"}
"""SI unit → its name in a factor that is to be filled in."""
_VALUES = {
    "rad": 1.0,
    "deg": pi / 180,
    "turns": 2 * pi,
    "mrad": 1e-3,
    "mdeg": 1e-3 * pi / 180,
    "rpm": pi / 30,
}
_TIME_UNITS = (("s", 1.0, ""), ("ms", 1e-3, "1e-3"), ("µs", 1e-6, "1e-6"), ("ns", 1e-9, "1e-9"))
_TIME_WORDS = {"s": 0, "sec": 0, "secs": 0, "seconds": 0, "ms": 1, "msec": 1, "millis": 1, "us": 2, "usec": 2,
              "micros": 2, "µs": 2, "μs": 2, "ns": 3, "nsec": 3, "nanos": 3}  # fmt: skip
_NEAR = 0.1
"""Relative error of k up to which it is a ratio of units: slow filters of a rate take some of its size."""
_ROOM_TOLERANCE = 1.1
"""Travel of a joint, over the room that the rig's limits leave it, up to which a unit is believed: limits are rounded,
and stops give way. Doubling it takes a range of -100 to 100 for degrees at stops of ± 50°."""
OTHER_UNIT = 3.0
"""Ratio from which a rate in no known unit is given what makes it its angle's rate: readers refuse it otherwise."""
_AMPERES = re.compile(r"[\[(]\s*A\s*[\])]")
"""The unit ampere in a name, which is no word there."""
_TRAILING_UNIT = re.compile(r"\s*[\[(][^\])\d]+[\])]\s*$|_(m?A|m?Nm|deg|rad|dps)$")
"""The unit at the end of a name: in brackets, or after an underscore."""
_ANGLE_AXES = re.compile(r"(.*?)(?:^|(?<![a-z])|(?<=[gaw]))([xyz])$", re.IGNORECASE)
"""A name that ends in an axis of space: ``rate_x``, ``gx``; what stands before it, and the axis."""
_CAMERA_WORDS = frozenset(("cam", "camera", "payload", "lens"))
"""Words in the name of a sensor that is fixed to the payload."""
_PLACEHOLDER = re.compile(r"[A-Z]{2,}")
"""A factor's part that a person has to fill in, such as ``COUNTS_PER_TURN``."""
_POWERS = range(6, 25)
"""Powers of two that encoders count in a turn: 64 to 16 million."""


@dataclass(eq=False)
class Channel:
    """What is thought of one column.

    Attributes:
        column: Its name.
        values: Its values, (N,).
        quantity: One of `_KINDS`, "time", "constant", "copy" or "unknown".
        unit: rad, deg, turns, counts, rpm, s, ms, …, "A", "N m"; empty where it is unknown.
        factor: What it is multiplied by to be in SI units, as a mapping writes it; in capitals what is not known of it.
        guessed: Whether only its size tells its unit.
        wanted: Whether it is a reference or command, not a measurement.
        rate_of: The column of whose angle it is the rate; empty where none is known.
        scale: Radians in one unit of an angle.
        reasons: Why.
        joint: The rig's joint that it is of, or None.
    """

    column: str
    values: Array
    quantity: str = "unknown"
    unit: str = ""
    factor: str = ""
    guessed: bool = False
    wanted: bool = False
    rate_of: str = ""
    scale: float = 1.0
    reasons: list[str] = field(default_factory=list)
    joint: str | None = None

    @property
    def kind(self) -> str:
        """Its quantity; "reference" for an angle that was commanded."""
        return "reference" if self.wanted and self.quantity == "position" else self.quantity

    @property
    def still(self) -> bool:
        """Whether it never changes."""
        return bool(np.ptp(self.values) == 0)

    @property
    def whole(self) -> bool:
        """Whether its values are whole numbers and their quantum is one, as of registers and counters."""
        return abs(self.step - 1.0) < 1e-9 and bool(np.all(self.values == np.round(self.values)))

    @property
    def low(self) -> float:
        """Its least value."""
        return float(self.values.min())

    @property
    def high(self) -> float:
        """Its largest value."""
        return float(self.values.max())

    @cached_property
    def step(self) -> float:
        """Its quantum; 0 where it has none."""
        return 0.0 if self.quantity == "time" else _find_quantum(self.values)

    def to_dict(self) -> dict[str, Any]:
        """Return what ``--json`` writes of a column."""
        names = ("column", "kind", "unit", "factor", "reasons", "low", "high", "step", "joint")
        return {name: getattr(self, name) for name in names}


def is_complete(factor: str) -> bool:
    """Whether nothing of a factor has to be filled in."""
    return _PLACEHOLDER.search(factor) is None


class Recognised(NamedTuple):
    """What a stream holds for a rig.

    Attributes:
        channels: Every column, that of the times first.
        mapping: Target → (column, factor, remark) for the rig, in the order of files; empty without a rig.
        t: Times, s, of the samples that are later than all before them, (M,).
        scale: Seconds of one unit of the times.
    """

    channels: tuple[Channel, ...]
    mapping: Mapping[str, tuple[str, str, str]]
    t: Array
    scale: float


def recognise(time: str, data: Mapping[str, Array], rig: Rig | None = None) -> Recognised:
    """Return what the columns of one stream are, for a rig if one is given.

    Args:
        time: Name of the column of times, or `ROW_COLUMN`: the interval between samples is then found where a rate
            whose name gives its unit adds up to an angle.
        data: Column → values, (N,) each.
        rig: Whose joints they may be of.
    """
    unit, scale, factor, why = find_time_unit(time, data[time])
    later = np.diff(np.maximum.accumulate(data[time]), prepend=-inf) > 0
    t = data[time][later] * scale
    joints = () if rig is None else rig.joints
    channels = {
        name: _read_name(name, values[later], joints)
        for name, values in data.items()
        if name != time
    }
    known: dict[bytes, str] = {}
    _mark_sensor_axes(channels, joints)
    for channel in channels.values():
        first = (
            channel.column
            if channel.still
            else known.setdefault(channel.values.tobytes(), channel.column)
        )
        if first != channel.column:
            channel.reasons.append(f"the same as '{first}'")
            channel.quantity = "copy" if channel.quantity == "unknown" else channel.quantity
    kinds = (
        ("position", "rate")
        if time == ROW_COLUMN
        else ("position", "rate", "unknown", "attitude", "gyro")
    )
    ties = _find_ties(
        t, [one for one in channels.values() if not one.still and one.quantity in kinds]
    )
    _pair_rates(ties, channels)
    if time == ROW_COLUMN and (step := _find_interval(ties, channels)) is not None:
        scale = step
        factor = f"{step:.4g}"
        why = "the rates add up to the angles with so many seconds a sample"
        t = t * scale
        ties = [tie._replace(ratio=tie.ratio / scale) for tie in ties]
    rooms = [] if rig is None else np.subtract(*rig.stops[::-1]).tolist()
    _set_units(ties, channels, max(filter(isfinite, rooms), default=inf), bool(rooms))
    mapping: dict[str, tuple[str, str, str]] = {}
    if rig is not None:
        mapping = {"t": (time, factor, why), **assign_columns(channels, rig)}
        if time == ROW_COLUMN and not factor:
            del mapping["t"]
    first_one = Channel(time, data[time], "time", unit, factor, reasons=[why])
    return Recognised((first_one, *channels.values()), mapping, t, scale)


def required_columns(rig: Rig, mapping: Iterable[str]) -> list[str]:
    """Return the columns that a log of a rig needs, of the joints of which a mapping holds any, or of all."""
    held = [
        joint for joint in rig.joints if any(target.endswith(f"_{joint}") for target in mapping)
    ]
    return ["t", *(f"{prefix}_{joint}" for prefix in ("q", "tau") for joint in held or rig.joints)]


def _find_interval(ties: Sequence[_Tie], channels: Mapping[str, Channel]) -> float | None:
    """Return the seconds from row to row by which rates add up to angles; units that no name gives are the same."""
    for tie in ties:
        x = channels[tie.x]
        v = channels[tie.v]
        if v.rate_of == tie.x:
            return (
                abs(tie.ratio)
                * _VALUES.get(x.unit, 1.0)
                / _VALUES.get(v.unit, _VALUES.get(x.unit, 1.0))
            )
    return None


def find_time_unit(name: str, t: Array) -> tuple[str, float, str, str]:
    """Return unit, its seconds, the mapping's factor and why: by the name's last word, or by the usual interval.

    No joint is logged at less than 5 Hz: the coarsest unit that makes it faster is the clock's.
    """
    if name == ROW_COLUMN:
        return ROW_COLUMN, 1.0, "", "the sample's number"
    split = split_words(name)
    step = float(np.median(np.abs(np.diff(t)))) if len(t) > 1 else 0.0
    if split and split[-1] in _TIME_WORDS:
        unit, scale, factor = _TIME_UNITS[_TIME_WORDS[split[-1]]]
        return unit, scale, factor, f"its name says {unit}"
    for unit, scale, factor in _TIME_UNITS:
        if 0 < step * scale <= 0.2:
            return (
                unit,
                scale,
                factor,
                f"increases by {digits(step, 3)}: {digits(1 / (step * scale), 3)} Hz in {unit}",
            )
    return "s", 1.0, "", "nothing tells its unit"


def _read_name(column: str, values: Array, joints: Sequence[str] = ()) -> Channel:
    """Return what a name says of a column: by a word of its kind, by its unit, or as the name of one of the joints."""
    text = column.replace("°C", " celsius ").replace("°", " deg ").replace("µ", "u")
    channel = Channel(column, values)
    split = split_words(text)
    written = _read_units(text)
    kind = next((kind for kind, known in _KINDS.items() if known & set(split)), None)
    if {"angular", "velocity"} <= set(split):
        kind = "gyro"
    elif {"linear", "acceleration"} <= set(split):
        kind = "accel"
    elif kind is None:
        angle, torque, current = (
            {*written} & _UNITS[kind].keys() for kind in ("position", "torque", "current")
        )
        rate = angle and split[-1] in ("s", "sec")
        own = any(split_words(joint) == split for joint in joints)
        kinds = {"torque": torque, "current": current, "rate": rate, "position": angle or own}
        kind = next((kind for kind, is_so in kinds.items() if is_so), None)
    elif kind == "torque" and {*written} & _UNITS["current"].keys():
        kind = "current"
    if kind in (None, "torque") and _AMPERES.search(column):
        kind = "current"
    channel.wanted = bool(COMMAND_WORDS & set(split))
    if kind is not None:
        channel.quantity = kind
        channel.reasons.append(f"its name says {kind}")
    if channel.still:
        channel.reasons.append("never changes")
        channel.quantity = kind or "constant"
    known_units = _UNITS.get(kind or "", {})
    if unit := next((known_units[word] for word in written if word in known_units), ""):
        channel.unit = unit
        channel.reasons.append(f"its name says {unit}")
    return channel


def _read_units(column: str) -> tuple[str, ...]:
    """Return what may be units in a name, in lower case: its words as they are written, then newtons with their metres.

    ``Iq_yaw_mA`` holds "ma", which is two words of a name in mixed case, and ``tau [N mm]`` "nmm". Those come last.
    """
    written = [word.lower() for word in re.findall(r"[^\W\d_]+", column)]
    return (
        *written,
        *(a + b for a, b in pairwise(written) if a in ("n", "mn")),
        *split_words(column),
    )


def _mark_sensor_axes(channels: Mapping[str, Channel], joints: Sequence[str]) -> None:
    """Set which columns are the three axes of a gyro or accelerometer, so that none is taken for a joint's rate."""
    triples: dict[str, dict[str, Channel]] = {}
    for channel in channels.values():
        if (found := _ANGLE_AXES.fullmatch(_TRAILING_UNIT.sub("", channel.column))) and not any(
            {*split_words(joint)} & {found[2].lower()} for joint in joints
        ):
            triples.setdefault(found[1].lower(), {})[found[2].lower()] = channel
    for stem, axes in triples.items():
        words = split_words(stem)
        last = words[-1] if words else ""
        kinds = {"g": "gyro", "w": "gyro", "a": "accel"}
        for channel in axes.values() if len(axes) == 3 else ():
            kind = (
                "gyro"
                if channel.quantity == "rate"
                else kinds.get(last, "") * (channel.quantity == "unknown")
            )
            if kind:
                channel.quantity = kind
                channel.reasons.append(f"one of the axes x, y and z of a sensor: {kind}")


class _Tie(NamedTuple):
    """One column is the integral of another: ``x = ratio * sum v dt`` with that correlation."""

    correlation: float
    ratio: float
    x: str
    v: str


def _find_ties(t: Array, channels: Sequence[Channel]) -> list[_Tie]:
    """Return every pair of which one is the other's rate, the highest correlation first."""
    if len(t) < 10:
        return []
    moved = {channel.column: take_increments(t, channel.values) for channel in channels}
    sums = {
        channel.column: take_increments(t, channel.values, integrated=True) for channel in channels
    }
    found = []
    for x, v in product(moved, sums):
        correlation, ratio = find_ratio(moved[x], sums[v])
        if x != v and ratio:
            found.append(_Tie(correlation, ratio, x, v))
    return sorted(found, reverse=True)


def take_increments(t: Array, values: Array, integrated: bool = False) -> Array:
    """Return the changes of values, or of their integrals, over 300 intervals: each holds an angle's noise twice only.

    Args:
        t: Time, s, (N,).
        values: Angles, or rates where they are integrated, (N, …).
        integrated: Whether it is the integrals that change.
    """
    ends = np.unique(np.linspace(0, len(t) - 1, 301).astype(int))
    return np.diff(
        (cumulative_trapezoid(values, t, axis=0, initial=0.0) if integrated else values)[ends],
        axis=0,
    )


def find_ratio(moved: Array, sums: Array) -> tuple[float, float]:
    """Return the correlation of an angle's increments with its rate's, (M,), and k of ``x = k ∫ v dt``; else zeros.

    They are an angle and its rate from a correlation of 0.9 on; in the measured logs of the tests it is over 0.97. One
    jump, as where a device begins anew, may make it alone: most increments have to agree in its sign.
    """
    size = float(moved @ moved) ** 0.5
    other = float(sums @ sums) ** 0.5
    both = float(moved @ sums)
    if size * other == 0.0:  # a channel at rest, or one so small that its squares are zero
        return 0.0, 0.0
    if not abs(both) > 0.9 * size * other or both * np.sum(np.sign(moved * sums)) <= 0:
        return 0.0, 0.0
    return abs(both) / (size * other), float(np.sign(both)) * size / other


def _pair_rates(ties: Sequence[_Tie], channels: Mapping[str, Channel]) -> None:
    """Set which columns that their names leave open are angles and rates, and of which angle each rate is.

    Columns that are named angle and rate are paired first where their names differ in nothing else.
    """
    for strict in (True, False):
        strip = _KINDS["position"] | _KINDS["rate"] | (frozenset() if strict else _RANK.keys())
        for tie in ties:
            x = channels[tie.x]
            v = channels[tie.v]
            taken = (
                x.rate_of
                or v.rate_of
                or x.column in {channel.rate_of for channel in channels.values()}
            )
            if (
                taken
                or x.quantity not in ("position", "unknown")
                or v.quantity not in ("rate", "unknown")
            ):
                continue
            if "unknown" in (x.quantity, v.quantity):
                fits = _find_unit_pair(tie.ratio) is not None
            else:
                fits = (
                    x.wanted == v.wanted
                    and {*split_words(x.column)} - strip == {*split_words(v.column)} - strip
                )
            if fits:
                x.quantity = "position"
                v.quantity = "rate"
                v.rate_of = x.column


def _find_unit_pair(ratio: float) -> tuple[str, str] | None:
    """Return the units of an angle and a rate of that ratio, the most usual; None where it is of none."""
    pairs = [("rad", "rad"), ("rad", "deg"), ("deg", "rad"), ("rad", "rpm"), ("deg", "rpm"), ("turns", "rpm"),
             ("turns", "rad"), ("rad", "turns")]  # fmt: skip
    return next(
        (p for p in pairs if abs(abs(ratio) * _VALUES[p[0]] / _VALUES[p[1]] - 1) < _NEAR), None
    )


def _set_units(
    ties: Sequence[_Tie], channels: Mapping[str, Channel], room: float, with_rig: bool
) -> None:
    """Set the units and factors of all columns; `room`: the widest range of a joint, rad."""
    for channel in channels.values():
        if channel.quantity in ("position", "attitude") and not _set_unit_by_rate(
            channel, ties, channels
        ):
            _set_angle_unit(channel, room, with_rig)
    beside = {
        kind: [c.values for c in channels.values() if c.quantity == kind]
        for kind in ("gyro", "accel")
    }
    for channel in channels.values():
        if channel.quantity == "rate" and channel.rate_of:
            x = channels[channel.rate_of]
            tie = next(tie for tie in ties if (tie.x, tie.v) == (channel.rate_of, channel.column))
            true = tie.ratio * x.scale  # rad/s in a unit of the column
            channel.unit = channel.unit or next(
                (u for u, v in _VALUES.items() if abs(abs(true) / v - 1) < _NEAR), ""
            )
            channel.reasons.append(_describe_tie(tie))
            channel.factor = ("-" if true < 0 else "") + _FACTORS.get(channel.unit, "")
            if _PLACEHOLDER.search(x.factor) and channel.unit not in _VALUES:
                channel.unit, channel.factor = "", "RAD_PER_SECOND_PER_UNIT"
            elif not channel.unit and not 1 / OTHER_UNIT < abs(true) < OTHER_UNIT:
                channel.factor = f"{true:.4g}"
        elif channel.quantity == "gyro":
            of = next(
                (t for t in ties if t.v == channel.column and channels[t.x].quantity == "attitude"),
                None,
            )
            most = max(float(np.sqrt(np.mean(values**2))) for values in beside["gyro"])
            if not channel.unit and of is not None and _find_unit_pair(of.ratio) == ("rad", "rad"):
                channel.unit = channels[of.x].unit
                channel.reasons.append(_describe_tie(of))
            elif not channel.unit:
                channel.unit = (
                    "deg" if most > 6.0 else "rad"
                )  # no platform turns so fast, rad/s rms
                fast = ", too fast for rad/s" if channel.unit == "deg" else ""
                channel.reasons.append(f"the gyro's largest axis has {digits(most, 3)} rms{fast}")
            channel.factor = _FACTORS[channel.unit]
        elif channel.quantity == "accel":
            size = float(np.median(np.sqrt(sum(values**2 for values in beside["accel"]))))
            channel.unit, channel.factor = ("g", "9.80665") if 0.5 < size < 2.0 else ("m/s²", "")
            channel.reasons.append(f"its axes' size is {digits(size, 3)} most of the time")
        elif usual := {"rate": "rad", "current": "A", "torque": "N m"}.get(channel.quantity):
            if (not channel.unit and channel.whole) or channel.unit == "counts":
                channel.factor = f"{_UNKNOWN[usual]}_PER_UNIT"
                channel.reasons.append("whole numbers: a register, the unit of which does not show")
                continue
            channel.unit = channel.unit or usual
            channel.factor = _FACTORS.get(channel.unit, "")
    for channel in channels.values():
        if channel.quantity in ("rate", "gyro") and channel.unit in (
            "rad",
            "deg",
            "turns",
            "mrad",
            "mdeg",
        ):
            channel.unit += "/s"


def _set_unit_by_rate(
    channel: Channel, ties: Sequence[_Tie], channels: Mapping[str, Channel]
) -> bool:
    """Set the unit of an angle without one from that of its rate, where the rate's name states it; False if not so."""
    for tie in ties:
        rate = channels[tie.v]
        if (
            tie.x == channel.column
            and rate.rate_of == channel.column
            and rate.unit in _VALUES
            and not channel.unit
        ):
            scale = _VALUES[rate.unit] / abs(tie.ratio)
            unit = next(
                (unit for unit, value in _VALUES.items() if abs(scale / value - 1) < _NEAR), ""
            )
            turn = next((2**k for k in _POWERS if abs(scale * 2**k / (2 * pi) - 1) < _NEAR), 0)
            if unit or (turn and channel.whole):
                channel.unit, channel.factor = (
                    (unit, _FACTORS[unit]) if unit else ("counts", f"2*pi/{turn}")
                )
                channel.scale = _VALUES[unit] if unit else 2 * pi / turn
                channel.reasons.append(
                    f"{_describe_tie(tie._replace(x=rate.column))}, which is in {rate.unit}/s"
                )
                return True
    return False


def _describe_tie(tie: _Tie) -> str:
    """Return a sentence on a column that is the rate of another."""
    return (
        f"adds up to '{tie.x}' (factor {digits(tie.ratio, 3)}, correlation {tie.correlation:.3f})"
    )


def _set_angle_unit(channel: Channel, room: float, with_rig: bool) -> None:
    """Set the unit of an angle: by its name, a quantum that divides a turn, its range, and the rig's `room`, rad."""
    x = channel.values
    say = channel.reasons.append
    travel = float(np.ptp(x))
    most = float(np.abs(x).max())
    step = channel.step
    if channel.unit == "counts" or (not channel.unit and channel.whole):
        channel.unit = "counts"
        # Of a turn both ends show; half of one may end anywhere.
        spans = [
            2**k
            for k in _POWERS
            if 0.98 * 2**k <= most <= 1.001 * 2**k and abs(x.min()) <= 0.02 * 2**k
        ]
        turn = spans[0] if spans else None
        channel.factor, channel.scale = (
            (f"2*pi/{turn}", 2 * pi / turn) if turn else ("2*pi/COUNTS_PER_TURN", 1.0)
        )
        say(
            f"goes from 0 to {digits(most, 4)}: {turn} counts a turn"
            if turn
            else "counts: how many a turn has does not show"
        )
        return
    if not channel.unit:
        parts = {unit: turn / step for unit, turn in (("rad", 2 * pi), ("deg", 360.0)) if step}
        # By chance a step is that near to one of the 19 powers of two in 1 of 3500 logs (2e-4 / log 2).
        exact = [
            unit for unit, n in parts.items() if any(abs(n / 2**k - 1) < 1e-4 for k in _POWERS)
        ]
        goes_on = abs(x[-1] - x[0]) > 0.5 * travel
        channel.unit = "deg"
        if exact:
            channel.unit = exact[0]
            say(f"its step of {digits(step, 3)} {exact[0]} parts a turn into {parts[exact[0]]:.0f}")
        elif channel.column.endswith(".pos") and 2 * pi < most <= 100.0:
            channel.unit, channel.factor = "", "RAD_PER_UNIT"
            say(
                "LeRobot writes -100 to 100 of a joint's calibrated range, or degrees: which does not show"
            )
            return
        elif travel > 1.5 * room:
            channel.guessed = True
            say(
                f"goes {digits(travel, 3)}, more than the {digits(room, 3)} rad that the rig leaves"
            )
        elif not with_rig and travel > 4 * pi and not goes_on and most < 400:
            say(f"goes to and fro over {digits(travel, 3)}, more than two turns in radians")
        elif channel.quantity == "attitude" and most > 2 * pi:
            say(f"an attitude reaches {digits(most, 3)}, which no radians do")
        else:
            channel.unit = "rad"
            say(
                f"goes {digits(travel, 3)}"
                + (" and on: it turns" if travel > 4 * pi else ", as radians do")
            )
    channel.factor = _FACTORS.get(channel.unit, "")
    channel.scale = _VALUES.get(channel.unit, 1.0)


def _find_quantum(x: Array) -> float:
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


def assign_columns(channels: Mapping[str, Channel], rig: Rig) -> dict[str, tuple[str, str, str]]:
    """Return target → (column, factor, remark) of a rig's log, in the order of files.

    Args:
        channels: Column → what it is; those of several streams together, too.
        rig: Whose joints.
    """
    q, v, torque, current, temperature = (
        _assign_by_joint(channels, rig, kind)
        for kind in ("position", "rate", "torque", "current", "temperature")
    )
    if not v:  # those that add up to the angles
        of_angle = {
            channel.rate_of: channel.column for channel in channels.values() if channel.rate_of
        }
        v = {joint: of_angle[column] for joint, column in q.items() if column in of_angle}
    reference = _assign_by_joint(channels, rig, "position", wanted=True)
    kinds = {"q": q, "dq": v, "tau": current | torque, "q_ref": reference}
    found: dict[str, tuple[str, str, str]] = {}
    for prefix in ("q", "q_ref"):
        rooms = {joint: float(high - low) for joint, low, high in zip(rig.joints, *rig.stops)}
        guessed = {
            joint: c for joint, column in kinds[prefix].items() if (c := channels[column]).guessed
        }
        if any(
            np.ptp(c.values) * c.scale > _ROOM_TOLERANCE * rooms[joint]
            for joint, c in guessed.items()
        ):
            for channel in guessed.values():
                channel.unit, channel.factor = "", "RAD_PER_UNIT"
                channel.reasons.append(
                    "farther than the rig leaves in radians and in degrees: the unit does not show"
                )
    for prefix, columns in {**kinds, "temp": temperature}.items():
        for joint, column in columns.items():
            channel = channels[column]
            factor = channel.factor
            remark = channel.reasons[-1] if channel.reasons else ""
            if prefix == "tau" and channel.quantity == "current":
                constant = rig.motors[rig.joint_index(joint)].torque_constant
                if constant is not None and _is_in_milliamperes(
                    channel, constant, rig.tau_max[rig.joint_index(joint)]
                ):
                    channel.unit = "mA"
                    factor = _FACTORS["mA"]
                    channel.reasons.append(
                        "as A it would exceed the motor's torque limit, as mA it does not"
                    )
                if constant is not None:
                    unit = f", {channel.unit}" if channel.unit else ""
                    remark = (
                        f"a current{unit}, times the rig's torque constant, {constant:g} N m per A"
                    )
                    factor = f"{constant:g}" + f"*{factor}" * bool(factor)
                else:
                    unit = "" if factor else ", A"
                    remark = f"a current{unit}: multiply it by the motor's torque constant, N m per A, too"
            channel.joint = joint
            found[f"{prefix}_{joint}"] = (column, factor, remark)
    links = urdf.list_element_names(urdf.parse_robot(rig.urdf, str(rig.path)), "link")
    for kind, prefix, axes in (
        ("gyro", "gyro", "xyz"),
        ("accel", "accel", "xyz"),
        ("quaternion", "quat", "wxyz"),
    ):
        sensors = [channel for channel in channels.values() if channel.quantity == kind]
        found |= _assign_imu_columns(
            sensors, rig.base, rig.payload_link or rig.camera_frame, links, prefix, axes
        )
    return found


def _is_in_milliamperes(channel: Channel, constant: float, limit: float) -> bool:
    """Return whether a current, the unit of which its name does not say, exceeds the motor's limit as A, not as mA.

    Args:
        channel: The current.
        constant: The motor's torque constant, N m per A.
        limit: Its torque limit, N m.
    """
    if channel.unit != "A" or _AMPERES.search(channel.column) or channel.column.endswith("_A"):
        return False
    torque = constant * float(np.quantile(np.abs(channel.values), 0.99))
    return torque > OTHER_UNIT * limit >= 1e-3 * torque


def _assign_by_joint(
    channels: Mapping[str, Channel], rig: Rig, kind: str, wanted: bool = False
) -> dict[str, str]:
    """Return joint → column of a kind: of the columns whose names differ by joint alone, the best set.

    That is the one of most joints, of these the one that was measured. Joints are told by their names, or all of them
    by numbers in a row, or by the columns' order.
    """
    several = [
        c for c in channels.values() if c.quantity == kind and c.wanted == wanted and not c.still
    ]
    sets: dict[tuple[str, ...], dict[str, str]] = {}
    for channel in several:
        split = split_words(_TRAILING_UNIT.sub("", channel.column))
        inside = [joint for joint in rig.joints if set(split_words(joint)) <= set(split)]
        joint = max(inside, key=lambda joint: len(split_words(joint)), default="")
        known = _KINDS[kind] | _UNITS.get(kind, {}).keys() | {*split_words(joint)}
        rest = tuple(word for word in split if not (word.isdigit() or word in known))
        key = joint or next((word for word in reversed(split) if word.isdigit()), "")
        sets.setdefault(rest, {}).setdefault(key, channel.column)
    best: tuple[tuple[float, float], dict[str, str]] = (0, 0), {}
    for rest, each in sets.items():
        ranks = [_RANK.get(word, 1) for word in rest]
        rank = 0 if 0 in ranks else max(ranks, default=1)
        found = {joint: each[joint] for joint in rig.joints if joint in each}
        numbered = sorted((int(key), column) for key, column in each.items() if key.isdigit())
        if len(numbered) == rig.n and all(b - a == 1 for (a, _), (b, _) in pairwise(numbered)):
            found = found or dict(zip(rig.joints, (column for _, column in numbered)))
        elif len(each) == rig.n == 1:
            found = dict(zip(rig.joints, each.values()))
        best = max(best, ((len(found), -rank), found), key=lambda one: one[0])
    return best[1] or (
        dict(zip(rig.joints, (c.column for c in several))) if len(several) == rig.n else {}
    )


def _assign_imu_columns(
    channels: Iterable[Channel],
    base: str,
    camera: str,
    links: Sequence[str],
    prefix: str,
    axes: str,
) -> dict[str, tuple[str, str, str]]:
    """Return target → column of the sensors that have all axes, each of the link that its name holds.

    Without one it is the camera's, where the name says so, or the base's.
    """
    found: dict[str, tuple[str, str, str]] = {}
    for channel in channels:
        split = split_words(_TRAILING_UNIT.sub("", channel.column))
        last = split[-1] if split else ""
        last = last[-1:] if last[:-1] in ("g", "w", "a") else last
        axis = axes[int(last)] if last in ("0", "1", "2") and len(axes) == 3 else last
        if axis in (*axes,):
            near = camera if _CAMERA_WORDS & {*split} else base
            link = max(
                (link for link in links if set(split_words(link)) <= set(split)),
                key=len,
                default=near,
            )
            found.setdefault(
                f"{prefix}_{link}_{axis}", (channel.column, channel.factor, channel.reasons[-1])
            )
    whole = {
        target[:-2] for target in found if all(f"{target[:-2]}_{axis}" in found for axis in axes)
    }
    return {target: found[target] for target in sorted(found) if target[:-2] in whole}
