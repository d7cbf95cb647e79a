"""A motion before it is run: what it uses of the limits, and what its log will tell."""

from __future__ import annotations

from math import isfinite, isinf, isnan

from gimbal_pin.diagnosis import Rehearsal, Rehearsed
from gimbal_pin.errors import NORMAL_95
from gimbal_pin.excitation import Excitation, ExpectedEstimate
from gimbal_pin.report.elements import Section, Table, bullets, list_warnings, paragraph
from gimbal_pin.report.format import figures


def show_excitation(found: Excitation) -> Section:
    """Return an excitation and what it uses of the limits."""
    used = {
        joint: [f"{100 * share:.0f}" if share else "-" for share in x.values()]
        for joint, x in found.limits_used.items()
    }
    rows = [(joint, *shares) for joint, shares in used.items()]
    head = f"condition number {found.condition_number:.1f} in {found.length}"
    table = Table(("Joint", "Angle %", "Rate %", "Acceleration %", "Torque %"), rows)
    lines = list[str]()
    if any("-" in shares for shares in used.values()):
        lines.append("-: no limit is stated; the motor's torque bounds it")
    if found.clearance is not None:
        first, second = found.clearance.between
        lines.append(
            f"smallest clearance: {1000 * found.clearance.distance:.3g} mm, between {first} and {second}"
        )
    if found.unchecked:
        lines.append(
            f"not kept from hitting anything, as its mesh is not there: {', '.join(found.unchecked)}"
        )
    start = ", ".join(
        f"{joint} {figures(q)}" for joint, q in zip(found.joints, found.motion.q[0].tolist())
    )
    lines.append(
        f"starts and ends at rest at {start} (rad, or m of a slide): bring it there slowly"
    )
    derived = {
        "velocity": "0.25 m/s at the farthest point with all joints turning, the reduced speed of ISO 10218-1",
        "acceleration": "half a hertz at its rate limit, as no torque limit bounds it",
    }
    for one in found.assumed:
        stated = "nothing is stated" if isinf(one.stated) else f"{figures(one.stated)} is stated"
        why = derived.get(one.quantity, "a small range, as its rate or torque is assumed")
        lines.append(
            f"assumed {one.joint}.{one.quantity} = {figures(one.value)} {one.unit}: {stated}; {why}"
        )
    for one in found.assumed[:1]:
        option = f"--limit {one.joint}.{one.quantity}=NUMBER"
        lines.append(f"state real limits in the rig's YAML under limits, or as {option}")
    lines += [] if found.finished else ["interrupted: this is the best it had found"]
    return Section(
        "Excitation", [paragraph(head), paragraph(found.repeated), table, bullets(lines)]
    )


def show_expectation(found: ExpectedEstimate) -> Section:
    """Return what a log of a motion will tell of each parameter, and what to change before it is run."""
    rows = [
        (
            name,
            None if isnan(x) else figures(x),
            figures(NORMAL_95 * std) if isfinite(std) else None,
            unit,
            known,
        )
        for name, x, std, unit, known in zip(
            found.names, found.values.tolist(), found.std.tolist(), found.units, found.known
        )
    ]
    table = Table(("Parameter", "Value", "Will be known to ± 95 %", "Unit", "Known"), rows)
    noise, form = (
        ", ".join(dict.fromkeys(f"{100 * x:.2g} %" for x in each))
        for each in (found.torque_noise, found.form_error)
    )
    head = (
        f"of this log alone: {found.rate:g} samples per second, the rig's encoders and gyros (exact where it states "
        f"none), noise on the torque of {noise} of its rms, and {form} of it that neither rigid bodies nor friction "
        "explain"
    )
    late = [
        f"{joint} {figures(1e3 * NORMAL_95 * std, 2)} ms"
        for joint, std in found.lag_std.items()
        if isfinite(std)
    ]
    said = f"The delay between a torque's time stamp and its effect is fitted, too, to (± 95 %): {', '.join(late)}."
    parts = [
        *list_warnings(found.warnings),
        paragraph(head),
        table,
        *([paragraph(said)] if late else []),
    ]
    return Section("What its log will tell", parts)


def show_rehearsal(found: Rehearsal) -> Section:
    """Return the sizes from which a log of a motion would show each cause, and tell it from all others."""
    heads = (
        "Joint",
        "Cause",
        "Size",
        "Found from",
        "Named from",
        "Of the torque",
        "Until then taken for",
    )
    rows = [describe_rehearsed(row) for row in found.causes if row.seen_from is not None]
    hidden: dict[str, list[str]] = {}
    for row in found.causes:
        hidden.setdefault(row.why or "", []).append(f"{row.cause} at {row.joint or 'rig'}")
    lines = [f"not shown: {', '.join(names)}: {why}" for why, names in hidden.items() if why]
    head = paragraph(f"What a log of these {found.seconds:.0f} s would show, in 19 of 20 cases.")
    return Section(
        "Rehearsal", [head, Table(heads, rows, texts=7), *([bullets(lines)] if lines else [])]
    )


def describe_rehearsed(row: Rehearsed) -> tuple[str | None, ...]:
    """Return the cells of a cause that a log shows."""
    seen = row.seen_from
    assert seen is not None
    sizes = [
        None
        if size is None
        else f"{figures(size.value)}{'' if size.unit == '1' else f' {size.unit}'}"
        for size in (seen, row.named_from)
    ]
    others = [
        x.cause if x.joint in (None, row.joint) else f"{x.cause} at {x.joint}"
        for x in row.confused_with
    ]
    share = f"{figures(100 * seen.share_of_torque, 2)} %"
    return (row.joint or "rig", row.cause, seen.parameter, *sizes, share, ", ".join(others) or None)
