"""How a joint is shown: one colour throughout a report, the same as on the bundled rigs; degrees or millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from markupsafe import Markup

from gimbal_pin.report.pages.html import dot
from gimbal_pin.report.pages.numbers import DASH, DEGREE, figures
from gimbal_pin.rig.rig import Rig

PALETTE = ("#1a75f2", "#e23b2f", "#14a05a", "#d98200", "#8a4fd0", "#0b96a8", "#d23f8d", "#8b6b3f")
"""Blue, red and green are the accents of the rigs' motors; the others follow for further joints."""

LEAST = 1e-4
"""Smallest angle, °, or position, mm, that is told from zero."""

AXES = (("yaw", "pan", "azimuth"), ("roll",), ("tilt", "pitch", "elevation"))
"""Words in a joint's name that claim the palette's first three colours."""


@dataclass(frozen=True)
class Joint:
    """A joint as a person reads it.

    Attributes:
        name: Its name.
        colour: Its colour.
        scale: What its angle in rad, or position in m, is multiplied by.
        unit: The unit then: ° or mm.
    """

    name: str
    colour: str
    scale: float
    unit: str

    @property
    def label(self) -> Markup:
        """Its name behind a dot of its colour."""
        return dot(self.colour, self.name)

    def text(self, value: float, per: str = "", digits: int = 3) -> str:
        """Return an angle, or a rate with `per` = "/s", as text with its unit; a dash if it is not finite."""
        if not isfinite(value):
            return DASH
        space = "" if self.unit == "°" else "\u00a0"
        if 0 < abs(self.scale * value) < LEAST:
            return f"< {LEAST:.4f}{space}{self.unit}{per}"
        return f"{figures(self.scale * value, digits)}{space}{self.unit}{per}"


def joints_of(rig: Rig) -> tuple[Joint, ...]:
    """Return the rig's joints as they are shown."""
    slides = [rig.model.joints[j + 1].shortname().startswith("JointModelP") for j in range(rig.n)]
    return tuple(
        Joint(name, colour, *((1e3, "mm") if sliding else (DEGREE, "°")))
        for name, colour, sliding in zip(rig.joints, joint_colours(rig.joints), slides)
    )


def units(joints: Sequence[Joint]) -> str:
    """Return the unit that joints share, or all of them."""
    return " or ".join(dict.fromkeys(joint.unit for joint in joints))


def joint_colours(joints: Sequence[str]) -> tuple[str, ...]:
    """Return a colour per joint: by its name, else the first that no joint has claimed."""
    claimed = [claim(joint) for joint in joints]
    free = [colour for colour in PALETTE if colour not in claimed] or list(PALETTE)
    out: list[str] = []
    unnamed = 0
    for colour in claimed:
        out.append(colour or free[unnamed % len(free)])
        unnamed += colour is None
    return tuple(out)


def claim(joint: str) -> str | None:
    """Return the colour that a joint's name asks for."""
    for words, colour in zip(AXES, PALETTE):
        if any(word in joint.lower() for word in words):
            return colour
    return None
