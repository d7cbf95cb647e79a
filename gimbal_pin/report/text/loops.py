"""Gains and margins, and steps with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import TYPE_CHECKING

from gimbal_pin.report.text.cells import number, table

if TYPE_CHECKING:
    from gimbal_pin.control.laws import Margins
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.control.tuning import Tuning

MARGINS = ("crossover Hz", "phase margin °", "gain margin dB", "disk margin", "delay margin ms")
"""Of one loop, see `shown`."""


def tuning(found: Tuning) -> str:
    """Gains, margins, and the reasons for them."""
    rows = [
        (
            joint,
            *(number(pid, 3) for pid in gains),
            number(hz, 3),
            *shown(margins),
        )
        for joint, gains, hz, margins in zip(found.model.rig.joints, found.gains, found.bandwidth_hz, found.margins)
    ]
    heads = ("joint", "kp", "ki", "kd", "bandwidth Hz")
    return "\n".join([*found.doubts, table(*heads, *MARGINS, rows=rows), *drawn(found), *found.reasons])


def drawn(found: Tuning) -> list[str]:
    """Margins of the worst of the models drawn from the covariance, if there are any."""
    if not found.draws:
        return []
    rows = [
        (joint, *(number(x, 3) for x in (least.disk_margin, least.phase_margin_deg, least.crossover_hz)))
        for joint, least in zip(found.model.rig.joints, found.worst)
    ]
    heads = (f"worst of {found.draws} draws", "disk margin", "phase margin °", "crossover Hz")
    return [table(*heads, rows=rows)]


def tracking(found: Tracking, plant: str) -> str:
    """Steps: rms error, overshoot and peak of every controller, in degrees, on the plant that was simulated."""
    rows = [
        (
            experiment.name,
            experiment.controller,
            joint,
            number(degrees(metrics.rms_error), 3),
            number(metrics.overshoot_percent, 3),
            number(degrees(metrics.peak_error), 3),
        )
        for experiment in found.experiments
        for joint, metrics in experiment.joints.items()
    ]
    head = f"simulated steps; the plant is {plant}\n"
    heads = ("step", "controller", "joint", "rms error °", "overshoot %", "peak error °")
    return "\n".join([head + table(*heads, rows=rows), *weak(found)])


def weak(found: Tracking) -> list[str]:
    """Who is long at the torque limit of which joints in which step."""
    from gimbal_pin.log.limited import limited

    every = [(one, {joint: metrics.saturated for joint, metrics in one.joints.items()}) for one in found.experiments]
    rows = [(f"{one.name}, {one.controller}", limited(shares)) for one, shares in every]
    return [f"{who}: at the torque limit, of the time: {shares}" for who, shares in rows if shares]


def margins(loops: Mapping[str, tuple[Margins, ...]], joints: Sequence[str]) -> str:
    """Margins of every controller's loops; controllers and joints whose loops are the same share a row."""
    from gimbal_pin.pointing.loops import distinct

    rows = [(listed(names, loops), ", ".join(places), *shown(own)) for names, places, own in distinct(loops, joints)]
    return table("loops of", "joint", *MARGINS, rows=rows)


def shown(own: Margins) -> tuple[str, ...]:
    """Crossover and margins of one loop."""
    sizes = (own.crossover_hz, own.phase_margin_deg, own.gain_margin_db, own.disk_margin, 1e3 * own.delay_margin)
    return tuple(number(size, 3) for size in sizes)


def listed(names: Sequence[str], of: Mapping[str, tuple[Margins, ...]]) -> str:
    """Names of controllers; of all but a few, which they are not."""
    rest = [name for name in of if name not in names]
    return f"all but {', '.join(rest)}" if 0 < len(rest) < len(names) - 1 else ", ".join(names) if rest else "all"
