"""A designed motion."""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING

from gimbal_pin.text.cells import table

if TYPE_CHECKING:
    from gimbal_pin.excitation import Excitation


def excitation(found: Excitation) -> str:
    """An excitation and what it uses of the limits."""
    rows = [(joint, *(f"{100 * share:.0f}" for share in used.values())) for joint, used in found.limits_used.items()]
    head = f"condition number {found.condition_number:.1f} in {found.length}"
    if found.narrowed is not None:
        middle, best = median(found.narrowed.tolist()), min(found.narrowed.tolist())
        head += f"; with the earlier logs it brings standard deviations to {middle:.2g} times what they were"
        head += f" (median of the parameters; {best:.2g} for the one that gains most), by identify --refit"
    lines = [head, table("joint", "angle %", "rate %", "acceleration %", "torque %", rows=rows)]
    if found.clearance is not None:
        first, second = found.clearance.between
        lines.append(f"smallest clearance: {1000 * found.clearance.distance:.3g} mm, between {first} and {second}")
    if found.unchecked:
        lines.append(f"not kept from hitting anything, as its mesh is not there: {', '.join(found.unchecked)}")
    if not found.finished:
        lines.append("interrupted: this is the best it had found")
    return "\n".join(lines)
