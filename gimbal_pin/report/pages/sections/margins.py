"""Gains, margins, and why they are what they are."""

from __future__ import annotations

from math import isfinite

from markupsafe import Markup

from gimbal_pin.control.tuning import Tuning
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import Content, bullets, heading, join, paragraph, table, toned
from gimbal_pin.report.pages.joints import Joint, joints_of
from gimbal_pin.report.pages.numbers import figures
from gimbal_pin.report.view.names import controller_name

GAINS = (("P", "1/s²"), ("I", "1/s³"), ("D", "1/s"))
PHASE_DEG, GAIN_DB = 45.0, 6.0
"""Margins from which on a loop is usually called safe."""


def margins(*tunings: Tuning) -> Section:
    """Return the gains and margins of one or more tunings; the first one's loops are drawn."""
    first = tunings[0]
    alt = f"Bode and Nyquist diagrams and disturbance answers of {', '.join(first.model.rig.joints)}"
    caption = f"The loops of {controller_name(first.wish.kind)}, one per joint, sampled and delayed as they will run."
    loops = plots.picture(first.plot, alt, caption, [joint.colour for joint in joints_of(first.model.rig)])
    parts = [part for tuning in tunings for part in described(tuning, len(tunings) > 1)]
    lead = "How fast the loops are, and how far from instability: with the delay, at the worst pose."
    return Section("Controller", join([*parts, loops]), lead)


def described(tuning: Tuning, several: bool) -> list[Markup]:
    """Return one tuning's wish, tables and reasons."""
    wish, joints = tuning.wish, joints_of(tuning.model.rig)
    timing = f"Sampled every {1e3 * wish.dt:g} ms, {1e3 * wish.delay:g} ms from measurement to torque"
    asked = f"{timing}; damping {wish.damping:g}, disk margin of at least {wish.disk:g}."
    name = controller_name(wish.kind)
    head: list[Content] = ["Joint", "Bandwidth, Hz", "Crossover, Hz", "Phase margin", "Gain margin", "Disk margin"]
    head += ["Delay margin", *(Markup("K<sub>{}</sub>, {}").format(*pair) for pair in GAINS), "Inertia at home"]
    rows = [[*margin_row(tuning, j, joint), *gain_row(tuning, j, joint)] for j, joint in enumerate(joints)]
    return [
        *([heading(name)] if several else []),
        paragraph(asked),
        table(head, rows, label=f"Gains and margins, {name}"),
        bullets(tuning.reasons),
    ]


def margin_row(tuning: Tuning, j: int, joint: Joint) -> list[Content]:
    """Return a joint's margins."""
    found, wish = tuning.margins[j], tuning.wish
    wanted, granted = wish.per_joint(tuning.model.rig)[j], tuning.bandwidth_hz[j]
    lower = isfinite(wanted) and granted < wanted * (1 - 1e-9)
    hertz: Content = toned(f"{figures(granted)} of {figures(wanted)}", "fair") if lower else figures(granted)
    return [
        joint.label,
        hertz,
        figures(found.crossover_hz),
        toned(f"{figures(found.phase_margin_deg)}°", tone(found.phase_margin_deg, PHASE_DEG)),
        toned(f"{figures(found.gain_margin_db)} dB", tone(found.gain_margin_db, GAIN_DB)),
        toned(figures(found.disk_margin), tone(found.disk_margin, wish.disk)),
        f"{figures(1e3 * found.delay_margin)} ms",
    ]


def tone(value: float, enough: float) -> str:
    """Return the tone of a margin."""
    return "good" if value >= enough * (1 - 1e-6) else "fair" if value >= enough / 2 else "poor"


def gain_row(tuning: Tuning, j: int, joint: Joint) -> list[Content]:
    """Return a joint's gains, in acceleration, and the inertia that a torque is made with."""
    pid, unit = tuning.gains[j], "kg m²" if joint.unit == "°" else "kg"
    return [figures(pid.kp), figures(pid.ki), figures(pid.kd), f"{figures(tuning.inertia[j])} {unit}"]
