"""Gains and margins, and steps with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import TYPE_CHECKING

from gimbal_pin.text.cells import number, table

if TYPE_CHECKING:
    from gimbal_pin.control import Margins
    from gimbal_pin.tracking import Tracking
    from gimbal_pin.tuning import Tuning


def tuning(found: Tuning) -> str:
    """Gains, margins, and the reasons for them."""
    rows = [
        (
            joint,
            *(number(pid, 3) for pid in gains),
            number(hz, 3),
            number(margins.phase_margin_deg, 3),
            number(margins.gain_margin_db, 3),
            number(margins.disk_margin, 3),
        )
        for joint, gains, hz, margins in zip(found.model.rig.joints, found.gains, found.bandwidth_hz, found.margins)
    ]
    heads = ("joint", "kp", "ki", "kd", "Hz", "phase margin °", "gain margin dB", "disk margin")
    return "\n".join([table(*heads, rows=rows), *drawn(found), *found.reasons])


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
    return head + table("step", "controller", "joint", "rms error °", "overshoot %", "peak error °", rows=rows)


def margins(loops: Mapping[str, tuple[Margins, ...]], joints: Sequence[str]) -> str:
    """Margins of every controller's loops; controllers and joints whose loops are the same share a row."""
    from gimbal_pin.pointing.loops import distinct

    rows = [(listed(names, loops), ", ".join(places), *shown(own)) for names, places, own in distinct(loops, joints)]
    return table("loops of", "joint", "Hz", "phase margin °", "gain dB", "disk", "delay ms", rows=rows)


def shown(own: Margins) -> tuple[str, ...]:
    """Crossover and margins of one loop."""
    sizes = (own.crossover_hz, own.phase_margin_deg, own.gain_margin_db, own.disk_margin, 1e3 * own.delay_margin)
    return tuple(number(size, 3) for size in sizes)


def listed(names: Sequence[str], of: Mapping[str, tuple[Margins, ...]]) -> str:
    """Names of controllers; of all but a few, which they are not."""
    rest = [name for name in of if name not in names]
    return f"all but {', '.join(rest)}" if 0 < len(rest) < len(names) - 1 else ", ".join(names) if rest else "all"
