"""Numbers, joints and controllers as a person reads them, in the terminal and on a page alike."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from math import degrees, floor, inf, isfinite, isnan, log10, pi
from typing import TYPE_CHECKING

from markupsafe import Markup

from gimbal_pin.errors import NORMAL_95

if TYPE_CHECKING:
    from gimbal_pin.checks import Alteration
    from gimbal_pin.rig.rig import Rig

DASH = "–"
"""Stands where there is no value."""
DEGREE = 180 / pi
"""Degrees per radian."""
LEAST_SHOWN = 1e-4
"""Smallest angle, °, or position, mm, of a joint that is told from zero: a third of an arc second."""
NOTHING = 1e-6
"""Angle of the line of sight, °, under which there is none: rounding errors of a simulation, and no camera's pixel."""

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def list_altered(found: Mapping[str, Sequence[Alteration]]) -> list[str]:
    """Say what was altered in which log before anything was made of it, and why."""
    return [f"altered: {log}: {one}" for log, each in found.items() for one in each]


def figures(value: float | None, digits: int = 3) -> str:
    """Return a number to so many significant digits: ``0.0123``, ``12.3``, ``1.23·10⁻⁷``; a dash for none."""
    if value is None or isnan(value):
        return DASH
    if not isfinite(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    if not -4 <= (power := int(exponent)) <= 6:
        return f"{mantissa.replace('-', '−')}·10{str(power).translate(SUPERSCRIPT)}"
    return signed(value, max(0, digits - 1 - power))


def angle(value: float) -> str:
    """Return an angle of the line of sight, rad, in degrees; "none" under `NOTHING`, "–" for NaN."""
    if isnan(value):
        return DASH
    return "none" if abs(degrees(value)) < NOTHING else f"{figures(degrees(value), 2)}°"


def signed(value: float, decimals: int) -> str:
    """Return a number with a true minus sign, and none on zero."""
    text = f"{value:.{decimals}f}"
    return text.replace("-", "−") if float(text) else text.lstrip("-")


def interval(value: float, half: float) -> tuple[str, str]:
    """Return a value and half its interval, both to the interval's second digit: ``("0.1234", "± 0.0012")``."""
    if not isfinite(half) or half <= 0:
        return figures(value, 4), "± ∞" if half == inf else DASH
    power = floor(log10(half))
    top = floor(log10(max(abs(value), half)))
    if top >= -4 and power >= -8:
        decimals = max(0, 1 - power)
        return signed(value, decimals), f"± {half:.{decimals}f}"
    unit = 10.0**top
    decimals = max(0, top - power + 1)
    tail = f"·10{str(top).translate(SUPERSCRIPT)}"
    return signed(value / unit, decimals) + tail, f"± {half / unit:.{decimals}f}{tail}"


def nats(gain: float, std: float) -> tuple[str, str]:
    """Return a gain and half its interval of 95 %, nats, to a tenth at most: less is rounding."""
    return interval(round(gain, 1), max(round(NORMAL_95 * std, 1), 0.1))


def format_range(values: Iterable[float], digits: int = 2) -> str:
    """Return the range of some values, ``1.2 to 3.4``, or the one value they share to these digits."""
    known = sorted(value for value in values if not isnan(value))
    if not known:
        return DASH
    low = figures(known[0], digits)
    high = figures(known[-1], digits)
    return low if low == high else f"{low} to {high}"


def torque_unit(largest: float, force: str = "N m") -> tuple[float, str]:
    """Return the unit in which a torque reads well, and what it is multiplied by: small ones are in mN m.

    `force`: "N" of joints that slide, see `forces`.
    """
    return (1e3, f"m{force}") if largest < 0.02 else (1.0, force)


def torque_text(value: float, largest: float = 0.0, force: str = "N m") -> str:
    """Return a torque as text with its unit, which is that of the largest beside which it stands."""
    scale, name = torque_unit(max(abs(value), largest), force)
    return f"{figures(scale * value, 2)} {name}"


def percent(value: float) -> str:
    """Return per cent to one decimal, with the sign; what is not quite 100 does not read 100."""
    if isnan(value):
        return DASH
    text = signed(value, 1)
    return f"{'> 99.9' if value < 100 and text == '100.0' else text} %"


def unit(text: str) -> str:
    """Return a unit with raised powers that no line breaks: ``kg m^2`` as ``kg m²``."""
    return text.replace("^2", "²").replace("^3", "³").replace(" ", "\u00a0")


def to_sentence(text: str) -> str:
    """Return a text with a capital first letter and a full stop."""
    return f"{text[:1].upper()}{text[1:]}."


def file_name(path: str) -> str:
    """Return the last part of a log's name, which may be a path."""
    return re.split(r"[/\\]", path.rstrip("/\\"))[-1] or path


def rows_named(how: str) -> str:
    """Return which rows an accuracy speaks of, within a sentence: ``the last third``, ``log 2 of 3``."""
    return how if how.startswith("log ") else f"the {how}"


def listed(names: Iterable[str]) -> str:
    """Return names as a person lists them: ``a``, ``a and b``, ``a, b and c``."""
    *rest, last = names
    return f"{', '.join(rest)} and {last}" if rest else last


# -- joints and controllers --------------------------------------------------------------------------------------------

PALETTE = ("#1a75f2", "#e23b2f", "#14a05a", "#d98200", "#8a4fd0", "#0b96a8", "#d23f8d", "#8b6b3f")
"""Colours of joints; blue, red and green are the accents of the bundled rigs' motors."""
AXIS_WORDS = (("yaw", "pan", "azimuth"), ("roll",), ("tilt", "pitch", "elevation"))
"""Words in a joint's name that claim the palette's first three colours."""


@dataclass(frozen=True)
class ShownJoint:
    """A joint as a person reads it.

    Attributes:
        name: Its name.
        colour: Its colour throughout a report.
        scale: What its angle in rad, or position in m, is multiplied by.
        unit: The unit then: ° or mm.
    """

    name: str
    colour: str
    scale: float
    unit: str

    @property
    def force(self) -> str:
        """Unit of what drives it: N m, or N of one that slides."""
        return self.in_units("N m")

    def in_units(self, unit: str) -> str:
        """Return the unit of a term at it, stated as of one that turns: ``N m s/rad``, ``N s/m`` of one that slides."""
        from gimbal_pin.rig.rig import to_sliding

        return to_sliding(unit) if self.unit == "mm" else unit

    @property
    def label(self) -> Markup:
        """Its name behind a dot of its colour."""
        return Markup('<span class="joint"><i style="background:{}"></i>{}</span>').format(
            self.colour, self.name
        )

    def text(self, value: float, per: str = "", digits: int = 3) -> str:
        """Return an angle or position, or a rate with `per` = "/s", with its unit; a dash if it is not finite."""
        if not isfinite(value):
            return DASH
        space = "" if self.unit == "°" else "\u00a0"
        shown = self.scale * value
        text = f"< {LEAST_SHOWN:.4f}" if 0 < abs(shown) < LEAST_SHOWN else figures(shown, digits)
        return f"{text}{space}{self.unit}{per}"


def list_shown_joints(rig: Rig) -> tuple[ShownJoint, ...]:
    """Return the rig's joints as they are shown."""
    colours = joint_colours(rig.joints)
    looks = ((1e3, "mm") if slides else (DEGREE, "°") for slides in rig.slides)
    return tuple(
        ShownJoint(name, colour, *look) for name, colour, look in zip(rig.joints, colours, looks)
    )


def units(joints: Sequence[ShownJoint]) -> str:
    """Return the unit that joints share, or all of theirs."""
    return " or ".join(dict.fromkeys(joint.unit for joint in joints))


def forces(joints: Sequence[ShownJoint]) -> str:
    """Return the unit that what drives joints shares, or all of theirs."""
    return " or ".join(dict.fromkeys(joint.force for joint in joints))


def joint_colours(joints: Sequence[str]) -> tuple[str, ...]:
    """Return a colour per joint: the one that its name claims, else the first that no joint has claimed."""
    claimed = [
        next(
            (
                colour
                for words, colour in zip(AXIS_WORDS, PALETTE)
                if any(word in joint.lower() for word in words)
            ),
            None,
        )
        for joint in joints
    ]
    free = cycle([colour for colour in PALETTE if colour not in claimed] or PALETTE)
    return tuple(colour or next(free) for colour in claimed)


CONTROLLERS = {
    "pid": "PID",
    "compensated-pid": "PID with feed-forward",
}
"""Controllers whose names say more than their keys."""


def controller_name(key: str) -> str:
    """Return a controller's name as a person reads it: ``pid`` as PID, ``computed-torque`` as computed torque."""
    return CONTROLLERS.get(key, key.replace("-", " "))
