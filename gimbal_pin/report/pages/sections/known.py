"""What is known of each identified parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gimbal_pin.dynamics.model import nominal
from gimbal_pin.estimation.identification import Identified, given_beta
from gimbal_pin.report.pages.evaluation import Evaluated
from gimbal_pin.report.pages.html import Content, toned
from gimbal_pin.report.pages.joints import joints_of
from gimbal_pin.report.pages.numbers import SURE, figures
from gimbal_pin.rig.rig import Rig

HARMLESS, BAD = 0.01, 0.05
"""Shares of a joint's torque: an interval that moves less does no harm, one that moves more is bad."""


@dataclass(frozen=True)
class Known:
    """One parameter.

    Attributes:
        name: Its name; a base parameter's is its regrouping.
        value: Estimate, SI.
        std: Its standard deviation.
        unit: SI unit.
        given: What the URDF says, or None.
        reach: Torque it moves per unit, N m rms, or None.
        share: The same as a share of the torque of the joint where that is largest, or None.
        colour: Of the joint it belongs to.
    """

    name: str
    value: float
    std: float
    unit: str
    given: float | None
    reach: float | None
    share: float | None
    colour: str

    @property
    def half(self) -> float:
        """Half the 95 % interval."""
        return SURE * self.std

    @property
    def seen(self) -> bool:
        """Whether the log tells it from zero, 95 %."""
        return abs(self.value) > self.half

    @property
    def moved(self) -> float:
        """Torque it moves, N m rms; 0 where that is not known."""
        return abs(self.value) * (self.reach or 0.0)

    @property
    def tone(self) -> str:
        """What its uncertainty does: to the torque where that is known, else to its value."""
        doubt = self.half / max(abs(self.value), 1e-300) / 4 if self.share is None else self.half * self.share
        return "poor" if doubt > BAD else "fair" if doubt > HARMLESS else ""

    @property
    def deviation(self) -> Content:
        """Standard deviation as a share of the value; what is not told from zero says so."""
        text = f"{figures(100 * self.std / abs(self.value), 2)} %" if self.seen else "like zero"
        return toned(text, self.tone) if self.tone else text


def known(found: Identified, evaluated: Evaluated | None, given: Rig | None) -> list[Known]:
    """Return every parameter, base parameters first."""
    none: Sequence[float | None] = [None] * len(found.names)
    before = none if given is None else stated(found, given)
    reach = none if evaluated is None else evaluated.reach.tolist()
    share = none if evaluated is None else evaluated.share.tolist()
    theta, std = found.estimate.theta.tolist(), found.estimate.std.tolist()
    rows = zip(found.names, theta, std, found.units, before, reach, share, owners(found))
    return [Known(*row) for row in rows]


def stated(found: Identified, given: Rig) -> list[float | None]:
    """Return what the URDF says of each parameter; None for effects that it does not know."""
    has = {term.effect: term.values for term in nominal(given).terms}
    effects = [x for term in found.model.terms for x in has.get(term.effect, (None,) * len(term.values))]
    return [*given_beta(given, found.reduction).tolist(), *effects]


def owners(found: Identified) -> list[str]:
    """Return the colour of the joint that each parameter belongs to: it moves the link, or bears the effect."""
    joints = joints_of(found.model.rig)
    by_link = {link: joint.colour for link, joint in zip(found.model.rig.links, joints)}
    by_joint = {joint.name: joint.colour for joint in joints}
    rigid = [by_link[found.reduction.names[j].rsplit(".", 1)[0]] for j in found.reduction.independent]
    return rigid + [by_joint[term.effect.joint] for term in found.model.terms for _ in term.values]
