"""An estimate while the rig moves: one line at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gimbal_pin.text.cells import number

if TYPE_CHECKING:
    from gimbal_pin.online import Progress


def following(found: Progress, told: int) -> str:
    """One line on an online estimate: time, torque error, the most telling parameters; then what happened anew.

    So many events were `told` before.
    """
    error = ", ".join(f"{joint} {number(value, 2)}" for joint, value in found.torque_error.items())
    parts = [f"{found.t:8.1f} s", *([f"off by {error} N m;"] if error else [])]
    if found.hidden:
        parts.append(f"{len(found.hidden)} of {len(found.names)} parameters do not show yet")
    else:
        rows = [(found.names[k], found.value[k], 1.96 * found.std[k], found.units[k]) for k in found.telling[:3]]
        parts.append(", ".join(f"{name} {number(x)} ± {number(half, 1)} {unit}" for name, x, half, unit in rows))
    events = [f"{event.t:8.1f} s  {event.sentence}" for event in found.events[told:]]
    return "\n".join([*events, "  ".join(parts)])
