"""Feed-forward of cogging and friction as tables, for drives that run a loop of their own: SimpleFOC and ODrive."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Sample, Term
from gimbal_pin.errors import UsageError
from gimbal_pin.export.sources import rendered
from gimbal_pin.log.log import Array

SIMPLEFOC = ("gimbal_feed_forward.h", "gimbal_feed_forward.ino", "gimbal_feed_forward.json")
"""Files for SimpleFOC."""
TABLE_TOLERANCE = 0.01
"""Error of straight lines between a table's points, in its largest torque: identified amplitudes are no surer."""
FEWEST_POINTS, MOST_POINTS = 64, 4096
"""Points of a table: 4096 floats are 16 kB of flash, and hold harmonics of up to 180 per turn that closely."""
COGGING_BINS = 3600
"""Entries of ``cogging_map``, ODrive firmware 0.5.x: one per 0.1° of the motor."""
FRICTION_RATES = np.linspace(0.0, 5.0, 51)
"""Rates of a table of friction, rad/s: a gimbal's; beyond the last the slope goes on."""


@dataclass(frozen=True, eq=False)
class Feed:
    """What one joint's motor is to give beside what its loop asks for, N m, in the joint's direction.

    Attributes:
        angle: By the angle, at ``2 pi k / len`` rad.
        forward: By the rate, at `FRICTION_RATES`, on top: friction, moving forwards.
        backward: The same moving backwards, at ``-RATES``; both are zero at a standstill.
    """

    angle: Array
    forward: Array
    backward: Array

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return {
            "angle_torque": self.angle.tolist(),
            "rates": FRICTION_RATES.tolist(),
            "forward_torque": self.forward.tolist(),
            "backward_torque": self.backward.tolist(),
        }


def feed(terms: tuple[Term, ...], count: int | None = None) -> Feed:
    """Return a joint's tables; of what varies with angle and rate the mean over a turn, nothing of what feels a load.

    Args:
        terms: Of the joint.
        count: Points by angle; None: so many that straight lines between them are `TABLE_TOLERANCE`.
    """
    size = FEWEST_POINTS if count is None else count
    angle = by_angle(terms, size)
    while count is None and size < MOST_POINTS:
        finer = by_angle(terms, 2 * size)
        if (
            np.abs(finer[1::2] - (angle + np.roll(angle, -1)) / 2).max()
            <= TABLE_TOLERANCE * np.abs(finer).max()
        ):
            break
        size = 2 * size
        angle = finer
    return Feed(angle, by_rate(terms, 1.0), by_rate(terms, -1.0))


def by_angle(terms: tuple[Term, ...], count: int) -> Array:
    """Torque at a standstill over one turn, (count,)."""
    return added(terms, 2 * pi * np.arange(count) / count, 0.0, 0.0)


def by_rate(terms: tuple[Term, ...], sign: float) -> Array:
    """Mean over a turn of what motion adds, at `FRICTION_RATES` in one direction; the first counts as just moving."""
    q = 2 * pi * np.arange(COGGING_BINS) / COGGING_BINS
    still = added(terms, q, 0.0, 0.0)
    return np.array(
        [np.mean(added(terms, q, sign * rate, sign) - still) for rate in FRICTION_RATES.tolist()]
    )


def added(terms: tuple[Term, ...], q: Array, v: float, slide: float) -> Array:
    """Torque of some terms at angles q, (N,), without load or acceleration, N m; within half a turn to each side."""
    zero = np.zeros(len(q))
    at = Sample(zero, np.mod(q + pi, 2 * pi) - pi, zero + v, zero, zero + slide, zero)
    return zero + sum(np.asarray(term.torque(at)) for term in terms)


def simplefoc(model: Model) -> dict[str, str]:
    """Return a header with a function of angle and rate, a sketch that calls it, and the same numbers as JSON."""
    rig = model.rig
    feeds = [feed(terms) for terms in model.by_joint]
    starts = np.cumsum([0, *(len(own.angle) for own in feeds)])[:-1].tolist()
    context = {
        "rig": rig.name,
        "joints": rig.joints,
        "counts": [len(own.angle) for own in feeds],
        "starts": starts,
        "angle": [x for own in feeds for x in own.angle.tolist()],
        "rates": len(FRICTION_RATES),
        "step": float(FRICTION_RATES[1]),
        "forward": [own.forward.tolist() for own in feeds],
        "backward": [own.backward.tolist() for own in feeds],
        "constants": [motor.torque_constant or 1.0 for motor in rig.motors],
    }
    made = rendered(context, SIMPLEFOC[:2])
    units = {"angle_torque": "N m at 2 pi k / len rad", "rates": "rad/s", "forward_torque": "N m"}
    data = {
        "schema": 1,
        "rig": rig.name,
        "units": {**units, "backward_torque": "N m, at minus the rates"},
    }
    joints = {joint: own.to_dict() for joint, own in zip(rig.joints, feeds)}
    return {**made, SIMPLEFOC[2]: json.dumps({**data, "joints": joints}, indent=1) + "\n"}


def odrive(model: Model) -> dict[str, Any]:
    """Return ODrives' tables: ``cogging_map`` as firmware 0.5.x indexes it, and friction by turns per second.

    The firmware adds ``cogging_map[mod(int(3600 turns), 3600)]``, N m. Its public interface reads an entry
    (`get_anticogging_value`) and writes none: the map goes into a firmware of one's own, or into `input_torque` by a
    host, as friction does.

    Raises:
        UsageError: A joint is geared: its torque does not repeat with its motor's turn.
    """
    rig = model.rig
    axes: dict[str, Any] = {}
    for joint, motor, terms in zip(rig.joints, rig.motors, model.by_joint):
        if abs(motor.gear_ratio) != 1:
            what = f"takes one turn of the motor, and {joint} is geared by {motor.gear_ratio:g}"
            raise UsageError(
                "--odrive", what, "use --simplefoc, whose tables go by the joint's angle"
            )
        own = feed(terms, COGGING_BINS)
        middles = (
            own.angle + np.roll(own.angle, -1)
        ) / 2  # an entry is in force from its angle to the next one's
        axes[joint] = {
            "cogging_map": middles.tolist(),
            "friction": {
                "turns_per_s": (FRICTION_RATES / (2 * pi)).tolist(),
                "forward_torque": own.forward.tolist(),
                "backward_torque": own.backward.tolist(),
            },
            "torque_constant": motor.torque_constant or 1.0,
        }
    units = {
        "cogging_map": "N m, added at floor(3600 turns) modulo 3600; turns = encoder turns from the joint's zero",
        "turns_per_s": "turns/s",
        "forward_torque": "N m for input_torque, on top",
        "backward_torque": "N m for input_torque, on top, at minus the rates",
        "torque_constant": "N m/A",
    }
    return {"schema": 1, "rig": rig.name, "firmware": "0.5.x", "units": units, "axes": axes}
