"""Results as a person reads them in a terminal: tables with units, angles in degrees where that is said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, isinf, isnan
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from gimbal_pin.errors import NORMAL_95, digits
from gimbal_pin.report import tables
from gimbal_pin.report.format import figures, joint_shown
from gimbal_pin.report.table import Table

if TYPE_CHECKING:
    from gimbal_pin.checks import Alteration
    from gimbal_pin.diagnosis import Rehearsal, Rehearsed
    from gimbal_pin.dynamics.base_parameters import Base
    from gimbal_pin.dynamics.checking import Checked
    from gimbal_pin.excitation import AssumedLimit, Excitation, ExpectedEstimate
    from gimbal_pin.export import Exported
    from gimbal_pin.identification import Progress
    from gimbal_pin.log.io.inspection import Inspected


# -- rigs and motions --------------------------------------------------------------------------------------------------


def rigs(bundled: Mapping[str, Any]) -> str:
    """The bundled rigs and payloads."""
    bodies = [(name, rig["payload"] or "", rig["description"]) for name, rig in bundled["rigs"].items()]
    loads = [(name, payload["description"]) for name, payload in bundled["payloads"].items()]
    return f"{Table(['Rig', 'Payload', ''], bodies, texts=3)}\n\n{Table(['Payload', ''], loads, texts=2)}"


def check(found: Checked) -> str:
    """A checked rig."""
    rows = []
    for name, joint in found.joints.items():
        look = joint_shown(name, joint.slides)
        ends, rate, most, load = (
            (joint.lower, joint.upper),
            joint.velocity,
            joint.tau_max,
            round(joint.gravity_torque, 9),
        )
        scaled = (
            " … ".join(figures(look.scale * x) for x in ends),
            figures(look.scale * rate),
            figures(most),
            figures(load),
        )
        units = look.unit, f"{look.unit}/s", look.force, look.force
        rows.append((name, joint.link, figures(joint.mass), *(f"{x} {unit}" for x, unit in zip(scaled, units))))
    heads = ("Joint", "Moves", "kg", "Range", "Rate", "tau_max", "Gravity")
    name = found.rig + (f" with {found.payload}" if found.payload else "")
    lines = [
        f"{name}: tree, axes, limits and inertias are sound",
        str(Table(heads, rows, texts=2)),
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
    sums = found.parameters - len(found.terms) - len(found.unidentifiable)
    lines = [
        f"{found.parameters} parameters: {len(found.terms)} identifiable, {sums} only in sums with these, "
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
    used = {
        joint: [f"{100 * share:.0f}" if share else "-" for share in x.values()]
        for joint, x in found.limits_used.items()
    }
    rows = [(joint, *shares) for joint, shares in used.items()]
    head = f"condition number {found.condition_number:.1f} in {found.length}"
    if found.narrowed is not None:
        middle, best = median(found.narrowed.tolist()), min(found.narrowed.tolist())
        head += f"; with the earlier logs it brings standard deviations to {middle:.2g} times what they were"
        head += f" (median of the parameters; {best:.2g} for the one that gains most), by identify --refit"
    table = Table(("Joint", "Angle %", "Rate %", "Acceleration %", "Torque %"), rows)
    lines = [head, found.repeated, str(table)]
    if any("-" in shares for shares in used.values()):
        lines.append("-: no limit is stated; the motor's torque bounds it")
    if found.clearance is not None:
        first, second = found.clearance.between
        lines.append(f"smallest clearance: {1000 * found.clearance.distance:.3g} mm, between {first} and {second}")
    if found.unchecked:
        lines.append(f"not kept from hitting anything, as its mesh is not there: {', '.join(found.unchecked)}")
    start = ", ".join(f"{joint} {figures(q)}" for joint, q in zip(found.joints, found.motion.q[0].tolist()))
    lines.append(f"starts and ends at rest at {start} (rad, or m of a slide): bring it there slowly")
    for one in found.assumed:
        lines.append(f"assumed  {one.joint}.{one.quantity} = {figures(one.value)} {one.unit}: {_explain_assumed(one)}")
    if found.assumed:
        one = found.assumed[0]
        lines.append(
            f"state real limits in the rig's YAML under limits, or as --limit {one.joint}.{one.quantity}=NUMBER"
        )
    return "\n".join(lines if found.finished else [*lines, "interrupted: this is the best it had found"])


def _explain_assumed(one: AssumedLimit) -> str:
    """Say what is stated in place of an assumed limit, and what that is derived from."""
    why = {
        "velocity": "0.25 m/s at the farthest point with all joints turning, the reduced speed of ISO 10218-1",
        "acceleration": "half a hertz at its rate limit, as no torque limit bounds it",
    }
    stated = "nothing is stated" if isinf(one.stated) else f"{figures(one.stated)} is stated"
    return f"{stated}; {why.get(one.quantity, 'a small range, as its rate or torque is assumed')}"


def expectation(found: ExpectedEstimate) -> str:
    """What a log of a motion will tell of each parameter, and what to change before it is run."""
    rows = [
        (name, None if isnan(x) else figures(x), figures(NORMAL_95 * std) if isfinite(std) else None, unit, known)
        for name, x, std, unit, known in zip(
            found.names, found.values.tolist(), found.std.tolist(), found.units, found.known
        )
    ]
    table = Table(("Parameter", "Value", "Will be known to ± 95 %", "Unit", "Known"), rows)
    noise, form = (
        ", ".join(dict.fromkeys(f"{100 * x:.2g} %" for x in each)) for each in (found.torque_noise, found.form_error)
    )
    head = (
        f"of a log of {found.rate:g} samples per second, the rig's encoders and gyros (exact where it states none), "
        f"noise on the torque of {noise} of its rms, and {form} of it that neither rigid bodies nor friction explain"
    )
    lines = [head, str(table)]
    lag, name = found.longest_lag
    if isfinite(lag):
        lines.append(
            f"a lag of {figures(1000 * lag, 2)} ms between angles and torque moves {name} by half of its value"
        )
    return "\n".join([*lines, *(f"warning: {said}" for said in found.warnings)])


def inspected(found: Inspected, altered: Sequence[Alteration] = ()) -> str:
    """A file's streams and channels, what the verbs would alter in it, and the mapping that is proposed."""
    from gimbal_pin.log.io.inspection import summarize_stream

    lines = [found.name]
    for stream in found.streams:
        lines += [*summarize_stream(stream), str(tables.channels(stream.channels)), ""]
    lines += [f"note  {note}" for note in found.notes] + [f"would be altered  {one}" for one in altered]
    return "\n".join(lines + ([found.yaml] if found.rig is not None else [])).rstrip("\n")


# -- identification ----------------------------------------------------------------------------------------------------


def following(found: Progress, said: int) -> str:
    """One line on an online estimate: time, torque error, the most telling parameters; then events after `said`."""
    error = ", ".join(f"{joint} {digits(value, 2)}" for joint, value in found.torque_error.items())
    parts = [f"{found.t:8.1f} s", *([f"off by {error} N m;"] if error else [])]
    if found.hidden:
        parts.append(f"{len(found.hidden)} of {len(found.names)} parameters do not show yet")
    else:
        rows = [(found.names[k], found.value[k], NORMAL_95 * found.std[k], found.units[k]) for k in found.telling[:3]]
        parts.append(", ".join(f"{name} {digits(x, 4)} ± {digits(half, 1)} {unit}" for name, x, half, unit in rows))
    events = [f"{event.t:8.1f} s  {event.sentence}" for event in found.events[said:]]
    return "\n".join([*events, "  ".join(parts)])


# -- diagnosis


def rehearsal(found: Rehearsal) -> str:
    """What a log of a motion would show: the sizes from which each cause is found, and is told from all others."""
    heads = ("Joint", "Cause", "Size", "Found from", "Named from", "Of the torque", "Until then taken for")
    rows = [describe_rehearsed(row) for row in found.causes if row.seen_from is not None]
    lines = [f"what a log of these {found.seconds:.0f} s would show, in 19 of 20 cases"]
    lines += [str(Table(heads, rows, texts=7))]
    hidden: dict[str, list[str]] = {}
    for row in found.causes:
        hidden.setdefault(row.why or "", []).append(f"{row.cause} at {row.joint or 'rig'}")
    return "\n".join(lines + [f"not shown: {', '.join(names)}: {why}" for why, names in hidden.items() if why])


def describe_rehearsed(row: Rehearsed) -> tuple[str | None, ...]:
    """Return the cells of a cause that a log shows."""
    seen = row.seen_from
    assert seen is not None
    sizes = [
        None if size is None else f"{figures(size.value)}{'' if size.unit == '1' else f' {size.unit}'}"
        for size in (seen, row.named_from)
    ]
    others = [x.cause if x.joint in (None, row.joint) else f"{x.cause} at {x.joint}" for x in row.confused_with]
    share = f"{figures(100 * seen.share_of_torque, 2)} %"
    return (row.joint or "rig", row.cause, seen.parameter, *sizes, share, ", ".join(others) or None)


# -- controllers -------------------------------------------------------------------------------------------------------


def exported(found: Exported, folder: Path) -> str:
    """Cost of a step, how the equations agree with Pinocchio, and how to build it."""
    rows = [[name, str(count)] for name, count in found.operations.items()]
    lines = [
        f"begin with {folder / 'README.md'}",
        str(Table(("Of a step", "Operations"), rows)),
        f"memory: {found.memory} bytes",
        f"equations agree with Pinocchio to {found.difference:.1g} in double precision",
        f"build: cmake -S {folder} -B {folder / 'build'} && cmake --build {folder / 'build'}",
    ]
    return "\n".join(lines)
