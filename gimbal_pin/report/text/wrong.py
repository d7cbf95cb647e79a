"""What the simulation gets wrong."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import TYPE_CHECKING, Any

from gimbal_pin.errors import digits
from gimbal_pin.report.text.cells import number, table

if TYPE_CHECKING:
    from gimbal_pin.diagnosis import Diagnosis
    from gimbal_pin.diagnosis.finding import Finding
    from gimbal_pin.effects.parameter import Parameter

DEVIATIONS = "(± is one standard deviation)"
ALONE = "(a finding's error before is without it and with all others; the table's is the refitted model's alone)"


def diagnosis(found: Diagnosis, files: Mapping[str, Any], command: str = "") -> str:
    """Verdict, findings, what is left at each joint, and where the files lie; `command`: the call that asked for it."""
    lines = [f"verdict: {found.verdict}{doubted(found)}"]
    lines += [""] if found.spoiling or found.findings else []
    for fault in found.spoiling:
        lines.append(f"{fault.sentence}; {fault.next_experiment}")
        lines += [f"  {sized(p)}" for p in fault.answer]
    lines += [line for finding in found.findings for line in told(finding)]
    lines += [DEVIATIONS] if any("±" in line for line in lines) else []
    lines += [] if found.planned is None else [f"next: {line}" for line in found.planned.lines]
    rows = [
        (
            joint,
            number(found.baseline["torque_rmse"][joint], 3),
            number(found.extended["torque_rmse"][joint], 3),
            number(found.detection_limit[joint], 2),
            left.sentence,
        )
        for joint, left in found.residual.items()
    ]
    if rows:
        lines.append("")
        lines += [table("joint", "before N m", "after N m", "would be found N m", "what is left is", rows=rows)]
        lines += [f"({found.hidden})"] if found.hidden else []
        lines += [ALONE] if len(found.findings) > 1 else []
    lines += tracking_gain(found)
    lines += [] if found.given is None else [f"given model{freely(found)}: {line}" for line in found.given.lines]
    lines += [f"note: {note}" for note in found.notes]
    lines += [
        f"too small to matter: {s.cause} at {s.joint or 'rig'} ({digits(100 * s.share, 2)} %)" for s in found.immaterial
    ]
    hidden = [f"{row.cause} at {row.joint or 'rig'}" for row in found.untestable]
    lines += [f"this log cannot show: {', '.join(hidden)}"] if hidden else []
    return "\n".join(lines + [f"{what}: {path}" for what, path in files.items()])


def doubted(found: Diagnosis) -> str:
    """Which findings a verdict of named does not speak of: those whose cause the logs leave open."""
    open_ = [f"{'/'.join(one.alike)} at {one.joint or 'rig'}" for one in found.findings if one.status == "ambiguous"]
    if found.findings and not found.lacking:
        return f", by the platform's motion alone, which its IMU tells the model; beside that: {found.beside}"
    return f", but for {', '.join(open_)}: which of these it is, is open" if found.verdict == "named" and open_ else ""


def freely(found: Diagnosis) -> str:
    """Why the payload's figures are others than those of a finding beside them, and what to hold of them."""
    own = any(one.cause.startswith("payload-") for one in found.findings)
    return (", its inertias left open, which those of the findings are not" if own else "") + unsure(found)


def unsure(found: Diagnosis) -> str:
    """What to hold of the payload's figures where something acts that the model does not know."""
    odd = [joint for joint, left in found.residual.items() if left.state == "structured"]
    return f" (rough: something unknown is left at {', '.join(odd)})" if odd else ""


def told(finding: Finding) -> list[str]:
    """A finding's sentence, what it could be instead, and its figures."""
    from gimbal_pin.diagnosis.finding import TOGETHER

    lines = [finding.sentence]
    lines += [f"  {finding.open}; try {finding.next_experiment}"] if finding.open else []
    figures = ", ".join(map(sized, finding.sized))
    loose = ", ".join(f"{p.name} {number(p.value)}{p.in_units}" for p in finding.unsized)
    unsized = f"{loose}: {TOGETHER}" if loose else ""
    return [*lines, *([f"  {figures or unsized}"] if figures or unsized else [])]


def sized(figure: Parameter) -> str:
    """A figure with its standard deviation."""
    return f"{figure.name} {number(figure.value)} ± {number(figure.std, 2)}{figure.in_units}"


def tracking_gain(found: Diagnosis) -> list[str]:
    """How closely a controller follows with the found causes compensated, and without, in degrees."""
    from gimbal_pin.diagnosis.followed import HOW, no_closer

    rows = found.tracking.items()
    cells = [(joint, *(number(degrees(row[key]), 2) for key in ("rms_before", "rms_after"))) for joint, row in rows]
    told = ", ".join(f"{joint} {before}° → {after}°" for joint, before, after in cells)
    worse = no_closer(found.tracking)
    if not cells:
        return []
    return [f"tracking error in simulation, rms, without and with compensation: {told} ({HOW})", *worse]
