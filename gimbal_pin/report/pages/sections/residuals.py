"""The residual over angle, rate, time and frequency, before and after."""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.heldout import filtered_error
from gimbal_pin.log.log import Array
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.joints import Joint
from gimbal_pin.report.pages.numbers import torque_unit

CLOUD = 700
"""Most dots in a cloud."""
LINE = 700
"""Most points of a curve over time in one stretch."""
MOST = 4
"""Most joints that are drawn, those with findings first."""
SEGMENT = 8.0
"""Length of the stretches that a spectrum is averaged over, s."""
OPEN = 0.5
"""Weight of a sample from which on it is drawn."""


def residuals(found: Diagnosis, joints: tuple[Joint, ...], held: Evidence) -> Markup:
    """Return the residual's four faces, one column per joint."""
    order = ranked(found, joints)[:MOST]
    shown = [joints[j] for j in order]
    alt = f"Held-out residual torque of {', '.join(joint.name for joint in shown)} over angle, rate, time and frequency"
    caption = (
        "Held-out residual torque: refitted model (grey), extended model (colour), over the joint's angle, rate and "
        "time, and its amplitude over frequency. What is flat and small in colour has been explained."
    )
    return plots.picture(partial(faces, found, joints, order, held), alt, caption)


def ranked(found: Diagnosis, joints: tuple[Joint, ...]) -> list[int]:
    """Joints with findings first, the strongest finding's first; then those with something left; then the others."""
    place = {joint.name: j for j, joint in enumerate(joints)}
    named = [place[each.joint] for each in found.findings if each.joint in place]
    open_ = [place[name] for name, left in found.residual.items() if left.state == "structured"]
    return list(dict.fromkeys([*named, *open_, *place.values()]))


def faces(found: Diagnosis, joints: tuple[Joint, ...], order: list[int], held: Evidence) -> plots.Figure:
    """Draw the residuals."""
    figure, panels = plots.panels(4, len(order), 10.4, gaps=(0.95, 0.68))
    errors = [filtered_error(held, model) for model in (found.before, found.after)]
    open_ = np.concatenate([part.gate for part in held.parts]) > OPEN
    for column, j in zip(panels.T, order):
        joint = joints[j]
        scale, unit = torque_unit(float(np.abs(errors[0][:, j]).max()))
        column[0].set_title(joint.name, color=joint.colour)
        rows = np.flatnonzero(open_[:, j])
        rows = rows[:: max(1, len(rows) // CLOUD)]
        for axes, name, per in ((column[0], "q", ""), (column[1], "v", "/s")):
            x = joint.scale * channel(held, name, j)[rows]
            for error, colour in zip(errors, (plots.PLAIN, joint.colour)):
                plots.dots(axes, x, scale * error[rows, j], colour)
            plots.zero_line(axes)
            axes.set_xlabel(f"{'rate' if per else 'angle'}, {joint.unit}{per}")
        for error, colour in zip(errors, (plots.PLAIN, joint.colour)):
            broken = np.where(open_[:, j], scale * error[:, j], np.nan)
            over_time(column[2], held, broken, colour)
            over_frequency(column[3], held, scale * error[:, j], colour)
        plots.zero_line(column[2])
        column[2].set_xlabel("time, s")
        column[3].set(xlabel="frequency, Hz", yscale="log", xlim=(0, held.band))
        for axes, name in zip(column, ("residual", "residual", "residual", "amplitude")):
            axes.set_ylabel(f"{name}, {unit}{'/√Hz' if name == 'amplitude' else ''}")
    return figure


def over_time(axes: plots.Axes, held: Evidence, error: Array, colour: str) -> None:
    """Draw an error over time, broken where it is not judged and between stretches."""
    at = 0
    for part in held.parts:
        length = len(part.gate)
        axes.plot(*plots.thinned(part.channels.t, error[at : at + length], LINE), color=colour, lw=0.9)
        at += length


def over_frequency(axes: plots.Axes, held: Evidence, error: Array, colour: str) -> None:
    """Draw the amplitude density of an error over the longest stretch."""
    from scipy.signal import welch

    lengths = [len(part.gate) for part in held.parts]
    k = int(np.argmax(lengths))
    first, part = sum(lengths[:k]), held.parts[k]
    segment = min(lengths[k], max(8, round(SEGMENT / part.dt)))
    frequency, power = welch(error[first : first + lengths[k]], 1 / part.dt, nperseg=segment)
    kept = (frequency > 0) & (frequency <= held.band)
    axes.plot(frequency[kept], np.sqrt(np.maximum(power[kept], 1e-300)), color=colour, lw=1.3)


def channel(held: Evidence, name: str, joint: int) -> Array:
    """One channel of one joint over all parts."""
    return np.concatenate([getattr(part.channels, name)[:, joint] for part in held.parts])
