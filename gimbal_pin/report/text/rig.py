"""What is bundled, what a rig is, what of it can be identified, and a motion that shows it."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from statistics import median
from typing import TYPE_CHECKING, Any

from gimbal_pin.report.text.cells import number, table

if TYPE_CHECKING:
    from gimbal_pin.dynamics.base_parameters import Base
    from gimbal_pin.dynamics.checking import Checked
    from gimbal_pin.excitation import Excitation


def rigs(listed: Mapping[str, Any]) -> str:
    """The bundled rigs and payloads."""
    bodies = [(name, rig["payload"] or "", rig["description"]) for name, rig in listed["rigs"].items()]
    loads = [(name, payload["description"]) for name, payload in listed["payloads"].items()]
    return table("rig", "payload", "", rows=bodies) + "\n\n" + table("payload", "", rows=loads)


def check(found: Checked) -> str:
    """A checked rig."""
    rows = [
        (
            name,
            joint.link,
            number(joint.mass),
            f"{number(degrees(joint.lower))} … {number(degrees(joint.upper))}",
            number(degrees(joint.velocity)),
            number(joint.tau_max),
            number(round(joint.gravity_torque, 9), 3),
        )
        for name, joint in found.joints.items()
    ]
    heads = ("joint", "moves", "kg", "range °", "°/s", "tau_max N m", "gravity N m")
    lines = [
        f"{found.rig}"
        + (f" with {found.payload}" if found.payload else "")
        + ": tree, axes, limits and inertias are sound",
        table(*heads, rows=rows),
        f"camera frame  {found.camera_frame} (+x is the line of sight; 'camera_frame:' and 'optical_axis:' in a YAML)",
        f"payload on    {found.mount or '-'} ('mount:'); IMUs on {', '.join(found.imus) or '-'} ('imus:', 'noise:')",
        f"identifiable  {found.identifiable} parameters, friction included (gimbal-pin base names them)",
        f"a log needs   {', '.join(found.columns)}",
        f"and may hold  {', '.join(found.optional)}",
        "to state more 'gimbal-pin new-rig' writes a YAML for a rig, with comments",
        *(f"note          {warning}" for warning in found.warnings),
    ]
    return "\n".join(lines)


def base(found: Base) -> str:
    """Base parameters."""
    grouped = found.parameters - len(found.terms) - len(found.unidentifiable)
    lines = [
        f"{found.parameters} parameters: {len(found.terms)} identifiable, {grouped} only in sums with these, "
        f"{len(found.unidentifiable)} without trace",
        "identifiable",
        *(f"  {name}" for name in found.names),
        "without any trace in the torques",
        *(f"  {name}" for name in found.unidentifiable),
    ]
    for motion, words in (("tilted", "leans or shifts"), ("rotating", "turns")):
        names = [entry["name"] for entry in found.to_dict()["moving_base"][motion]["adds"]]
        lines += [f"a base that {words} adds {len(names)}: {len(found.terms) + len(names)} in all"]
        lines += [f"  {name}" for name in names]
    return "\n".join(lines)


def excitation(found: Excitation) -> str:
    """An excitation and what it uses of the limits."""
    rows = [(joint, *(f"{100 * share:.0f}" for share in used.values())) for joint, used in found.limits_used.items()]
    head = f"condition number {found.condition_number:.1f} in {found.length}"
    if found.narrowed is not None:
        middle, best = median(found.narrowed.tolist()), min(found.narrowed.tolist())
        head += f"; with the earlier logs it brings standard deviations to {middle:.2g} times what they were"
        head += f" (median of the parameters; {best:.2g} for the one that gains most), by identify --refit"
    lines = [head, found.repeated, table("joint", "angle %", "rate %", "acceleration %", "torque %", rows=rows)]
    if found.clearance is not None:
        first, second = found.clearance.between
        lines.append(f"smallest clearance: {1000 * found.clearance.distance:.3g} mm, between {first} and {second}")
    if found.unchecked:
        lines.append(f"not kept from hitting anything, as its mesh is not there: {', '.join(found.unchecked)}")
    if not found.finished:
        lines.append("interrupted: this is the best it had found")
    return "\n".join(lines)
