"""Results as a person reads them in a terminal: tables with units, angles in degrees where that is said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, floor, inf, isnan, log10
from statistics import median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gimbal_pin.base import Base
    from gimbal_pin.bodies import Figure
    from gimbal_pin.calibration import Mounting
    from gimbal_pin.checking import Checked
    from gimbal_pin.diagnosis import Diagnosis
    from gimbal_pin.diagnosis.finding import Finding
    from gimbal_pin.excitation import Excitation
    from gimbal_pin.identification import Accuracy, Identified
    from gimbal_pin.online import Progress
    from gimbal_pin.payloads import Several
    from gimbal_pin.pointing.contest import Row
    from gimbal_pin.pointing.verify import Verified
    from gimbal_pin.tracking import Tracking
    from gimbal_pin.tuning import Tuning
    from gimbal_pin.walk import Auto


def table(*heads: str, rows: Sequence[Sequence[str]]) -> str:
    """Return rows under heads in aligned columns; numbers to the right, words to the left."""
    everything = [heads, *rows]
    widths = [max(len(row[k]) for row in everything) for k in range(len(heads))]
    right = [all(is_number(row[k]) for row in rows) and bool(rows) for k in range(len(heads))]
    lines = [
        "  ".join(
            cell.rjust(width) if to_right else cell.ljust(width) for cell, width, to_right in zip(row, widths, right)
        )
        for row in everything
    ]
    return "\n".join(line.rstrip() for line in lines)


def is_number(cell: str) -> bool:
    """Whether a cell starts like a number, or stands for one that is missing."""
    return cell[:1] in "-+.0123456789∞–" or cell == ""


def number(value: float | None, digits: int = 4) -> str:
    """Return a value with so many significant digits; – for none, ∞ for no limit."""
    if value is None or value != value:
        return "–"
    return ("∞" if value > 0 else "-∞") if abs(value) == inf else f"{value:.{digits}g}"


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
        f"camera frame  {found.camera_frame} (+x is the line of sight)",
        f"identifiable  {found.identifiable} parameters, friction included (gimbal-pin base names them)",
        f"a log needs   {', '.join(found.columns)}",
        f"and may hold  {', '.join(found.optional)}",
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
    head = f"condition number {found.condition_number:.1f} in {found.seconds:g} s"
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


def identified(found: Identified) -> str:
    """Parameters with uncertainty, accuracy, and how to balance the payload."""
    from gimbal_pin.balance import balance

    parts = [estimated(found), table(*HEADS, rows=[parameter(found, k) for k in range(len(found.names))])]
    parts += ["±: –: not estimated here, but taken as it was known"] if not found.estimate.std.all() else []
    parts.append("")
    parts += [accuracy(part) for part in (found.train, found.held_out) if part is not None]
    parts += [f"note: {said}" for said in found.notes]
    parts += [mounting(log, link, how) for log, links in found.mountings.items() for link, how in links.items()]
    change = max(found.torque_change.values())
    parts.append(f"nearest physical parameters: {number(change, 2)} N m rms away in predicted torque, at most")
    parts += physique(found)
    if found.torn:  # advice from the parameters of neither rig would lead astray
        return "\n".join(parts)
    if found.bias is not None:
        parts.append(found.bias.sentence)
    balanced = balance(found)
    parts += [] if balanced is None else balanced.sentences
    return "\n".join(parts)


LIMIT = "(what would be found goes with the motion all log long; noise averages out over it, and may be larger)"
HEADS = ("parameter", "value", "± 95 %", "± % of it", "unit", "URDF", "off by, std")


def estimated(found: Identified) -> str:
    """By what the parameters were estimated, and what their deviations stand on."""
    method = found.estimate.method
    held = f", the URDF's masses trusted to {100 * found.trust:.3g} % (--trust)" if method == "ridge" else ""
    return f"{len(found.names)} parameters by {method}{held}; deviations by {found.estimate.uncertainty}"


def parameter(found: Identified, k: int) -> tuple[str, ...]:
    """A parameter's row: its interval, and how far it is from what the URDF states."""
    value, std = float(found.estimate.theta[k]), float(found.estimate.std[k])
    share = number(100 * abs(1.96 * std / value), 2) if value and std else ""
    interval = number(1.96 * std, 2) if std else "–"  # nothing was estimated: it was taken as it was known
    stated = (number(float(found.stated[k])), f"{found.moved[k]:+.1f}" if found.moved[k] == found.moved[k] else "–")
    return (found.names[k], number(value), interval, share, found.units[k], *stated)


def physique(found: Identified) -> list[str]:
    """The nearest bodies with 95 % intervals, and what of them is the URDF's."""
    rows = []
    for body in found.bodies:
        com = ", ".join(within(figure, 1e3) for figure in body.com)
        diagonal = ", ".join(within(body.inertia[k]) for k in (0, 2, 5))
        products = ", ".join(within(body.inertia[k]) for k in (1, 3, 4))
        rows.append((body.link, within(body.mass), com, diagonal, products))
    heads = ("body", "mass, kg", "centre of mass, mm", "Ixx, Iyy, Izz, kg m^2", "Ixy, Ixz, Iyz")
    trust = f"± 95 %; *: not shown by the log, ± holds if the URDF is right to {100 * found.trust:.3g} % (--trust)"
    return ["", table(*heads, rows=rows), trust, ""]


def within(figure: Figure, factor: float = 1.0) -> str:
    """A figure and its 95 % interval, no finer than that tells."""
    half = 1.96 * figure.std * factor
    places = max(0, 1 - floor(log10(half))) if 0 < half < inf else 6
    value = f"{figure.value * factor:.{places}f} ± {number(half, 2)}"
    return value if figure.shown else f"{value}*"


def following(found: Progress, told: int) -> str:
    """One line on an online estimate: time, torque error, the most telling parameters; then what happened anew.

    Args:
        found: The state.
        told: How many events were told before.
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


def several(found: Several) -> str:
    """Every camera's own parameters, the accuracy with it and its balance; then the gimbal's parameters."""
    from gimbal_pin.balance import balance

    parts = []
    for name, one in found.identified.items():
        camera, balanced = found.cameras[name], balance(one)
        rows = [
            (symbol, number(value), number(1.96 * s, 2) if s else "–", unit, number(given))
            for symbol, value, s, unit, given in zip(
                camera.names, camera.value, camera.std, camera.units, camera.urdf.tolist()
            )
        ]
        parts += [name, table("parameter", "value", "± 95 %", "unit", "URDF", rows=rows)]
        parts += [] if camera.std.all() else ["±: –: taken as its URDF says"]
        parts += [accuracy(part) for part in (one.train, one.held_out) if part is not None]
        parts += ["" if balanced is None else "\n".join(balanced.sentences), ""]
    return "\n".join([*parts, found.sentence, f"with {found.first.model.rig.payload}", identified(found.first)])


def mounting(log: str, link: str, found: Mounting) -> str:
    """How an IMU sits on its link, in degrees."""
    turn, bias = (degrees(sum(x * x for x in vector.tolist()) ** 0.5) for vector in (found.misalignment, found.bias))
    gap = f", its gyro then differs from the encoders by {number(degrees(found.after), 2)}°/s rms"
    known = gap if found.after == found.after else ""
    return f"{log}: IMU of {link} is turned by {number(turn, 3)}°, its gyro's bias is {number(bias, 3)}°/s{known}"


def accuracy(part: Accuracy) -> str:
    """Torque error of one part of the data."""
    cells = [
        f"{joint} {number(error, 3)} N m ({part.fit_percent[joint]:.2f} %)" for joint, error in part.torque_rmse.items()
    ]
    used = min(part.used.values())
    judged = (
        ""
        if used > 0.9
        else f"; as little as {100 * used:.0f} % of a joint's samples tell, the rest is near standstill"
    )
    return f"{part.how}: torque error rms (fit)  " + ", ".join(cells) + judged


def diagnosis(found: Diagnosis, files: Mapping[str, Any]) -> str:
    """Verdict, findings, what is left at each joint, and where the files lie."""
    lines = [f"verdict: {found.verdict}"] + ([""] if found.spoiling or found.findings else [])
    for fault in found.spoiling:
        lines.append(f"{fault.sentence}; {fault.next_experiment}")
        lines += [f"  {p.name} {number(p.value)} ± {number(p.std, 2)} {p.unit}" for p in fault.answer]
    for finding in found.findings:
        lines.append(finding.sentence)
        if len(finding.alike) > 1:
            lines.append(
                f"  this log cannot tell it from {', '.join(finding.alike[1:])}; try {finding.next_experiment}"
            )
            lines += [f"  {line}" for line in worse(finding)]
        figures = [
            f"{p.name} {number(p.value)} ± {number(p.std, 2)} {p.unit}" for p in finding.parameters if p.std == p.std
        ]
        loose = ", ".join(f"{p.name} {number(p.value)} {p.unit}" for p in finding.parameters)
        unsized = f"{loose}: only together; other sizes fit this log as well" if loose else ""
        lines.append(f"  {', '.join(figures) or unsized}".rstrip())
    lines += [] if found.planned is None else [f"next: {line}" for line in found.planned.lines]
    rows = [
        (
            joint,
            number(found.baseline["torque_rmse"][joint], 3),
            number(found.extended["torque_rmse"][joint], 3),
            number(found.detection_limit[joint], 2),
            left.state + (f" {left.where}" if left.where else ""),
        )
        for joint, left in found.residual.items()
    ]
    if rows:
        lines.append("")
        lines += [table("joint", "before N m", "after N m", "would be found N m", "what is left is", rows=rows)]
        lines += [LIMIT] if any(left.state == "noise" for left in found.residual.values()) else []
    lines += tracking_gain(found)
    lines += [] if found.given is None else [f"given model: {line}" for line in found.given.lines]
    lines += [f"note: {note}" for note in found.notes]
    lines += [f"too small to matter: {s.cause} at {s.joint or 'rig'} ({100 * s.share:.2g} %)" for s in found.immaterial]
    hidden = [f"{row.cause} at {row.joint or 'rig'}" for row in found.untestable]
    lines += [f"this log cannot show: {', '.join(hidden)}"] if hidden else []
    return "\n".join(lines + [f"{what}: {path}" for what, path in files.items()])


def worse(finding: Finding) -> list[str]:
    """Why rivals that explain less on these logs are not ruled out."""
    from gimbal_pin.diagnosis.verdict import APART

    apart = (rival for rival in finding.rivals if rival.cause in finding.alike and rival.z > APART)
    rows = [f"{rival.cause} by {number(rival.z, 2)} deviations" for rival in apart]
    reason = "yet they add nearly the same torque here (correlation over 0.95), and a formula that is a little off"
    return (
        [f"worse on these logs: {', '.join(rows)}; {reason} can make as much: not enough to name one"] if rows else []
    )


def tracking_gain(found: Diagnosis) -> list[str]:
    """How closely a controller follows with the found causes compensated, and without, in degrees."""
    rows = found.tracking.items()
    cells = [(joint, *(number(degrees(row[key]), 2) for key in ("rms_before", "rms_after"))) for joint, row in rows]
    told = ", ".join(f"{joint} {before}° → {after}°" for joint, before, after in cells)
    return [f"tracking error in simulation, rms, without and with compensation: {told}"] if cells else []


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


def verified(found: Verified) -> str:
    """Every controller on all that was run, targets, and where the error goes, degrees."""
    judged = [(t.name, number(t.value, 3), number(t.must), number(t.aim), t.verdict) for t in found.targets]
    parts = [circumstances(found), controllers(found), ""]
    parts += [table("target", "value", "must", "aim", "reached", rows=judged)] if judged else []
    parts += [*asking(found), *swept(found), *budget(found)]
    parts += [f"compensated: {sentence}" for sentence in found.causes]
    parts += [
        f"{row.controller}: {event}" for contest in found.contests for row in contest.rows for event in row.events
    ]
    return "\n".join(parts)


def circumstances(found: Verified) -> str:
    """What was run, with which margins."""
    from gimbal_pin.pointing.roster import TUNED

    contest, margins = found.contest, found.margins
    ways = [(one.rows[0].runs[0], len(one.rows[0].runs)) for one in found.contests]
    motions = " and ".join(f"platform {run.platform}, {count} × {run.t[-1]:.3g} s" for run, count in ways)
    made = "; tuned has the gains of tune and margins of its own" if TUNED in contest.jitter else ""
    if found.steps is not None:
        sizes = ", ".join(f"{joint} {number(degrees(step), 3)}°" for joint, step in found.steps.steps.items())
        made += f"; steps of {sizes} by minimum jerk in 0.5 s, loops of 8 Hz, all at once and one at a time"
    return (
        f"{contest.rig}{f' with {contest.payload}' if contest.payload else ''} on {motions}; every loop's disk margin "
        f"with the drives that are known is at least {number(margins.disk_margin, 3)}, "
        f"the PID crosses at {number(margins.crossover_hz, 3)} Hz "
        f"(phase {number(margins.phase_margin_deg, 3)}°, delay {number(1e3 * margins.delay_margin, 2)} ms){made}"
    )


def controllers(found: Verified) -> str:
    """One row per controller: how still it held the camera on each motion, and how it followed the steps."""
    heads, columns = ["controller"], [[row.controller for row in found.contest.rows]]
    for contest in found.contests:
        first = contest.rows[0].runs[0]
        of = "recorded " if len(found.contests) > 1 and first.platform == "log" else ""
        heads += [f"{of}jitter ° rms", "° max", "drift °", *(f"{j} N m" for j in first.joints), "at limit %"]
        columns += [list(column) for column in zip(*map(held_still, contest.rows))]
    if found.steps is not None:
        heads += ["steps ° rms", "overshoot %", "cross-axis °"]
        columns += followed(found.steps, columns[0])
    return table(*heads, rows=list(zip(*columns)))


def held_still(row: Row) -> tuple[str, ...]:
    """One controller's figures on one motion."""
    sizes = (row.jitter_rms, row.jitter_max, row.drift)
    torques = (number(torque, 3) for torque in row.torque_rms.values())
    return (*(f"{degrees(x):.4f}" for x in sizes), *torques, number(100 * max(row.at_limit.values()), 2))


def followed(steps: Tracking, names: Sequence[str]) -> list[list[str]]:
    """Columns of what the steps say of each controller, by what it is on a base that stands."""
    from gimbal_pin.pointing.steps import STANDING, Followed

    found = Followed.of(steps)
    rows = [found[STANDING[name]] if name in STANDING else None for name in names]
    return [
        ["" if row is None else f"{degrees(row.rms):.4f}" for row in rows],
        ["" if row is None else number(row.overshoot_percent, 2) for row in rows],
        ["" if row is None else f"{degrees(row.cross_axis_peak):.4f}" for row in rows],
    ]


def asking(found: Verified) -> list[str]:
    """What a recorded motion asks of motors too weak for it, and how still the camera is where they are not."""
    demand = found.demand
    if demand is None:
        return []
    limits = dict(zip(demand.joints, demand.tau_max.tolist()))
    weak = ", ".join(f"{j} for up to {number(demand.peak[j], 3)} N m of its {limits[j]:g}" for j in demand.weak)
    when = ", ".join(f"{first:.1f}" for first, _ in demand.moments)
    rest = ", ".join(f"{name} {degrees(size):.4f}°" for name, size in demand.apart(found.contests[-1]).items())
    told = ["", f"the recorded motion asks {weak}, at {when} s; jitter apart from these moments: {rest}"]
    if isnan(demand.least["unforeseen"]):
        return told
    blind, seeing = (f"{degrees(demand.least[name]):.4f}°" for name in ("unforeseen", "foreseen"))
    bound = f"the torque limits alone leave any controller {blind} rms, or {seeing} if it foresees the motion"
    return [*told, f"{bound}, unless it rolls the camera instead"]


def swept(found: Verified) -> list[str]:
    """How wrong the model may be."""
    return [] if found.sweep is None else ["", found.sweep.sentence]


def budget(found: Verified) -> list[str]:
    """One bar: what each thing that the controllers know takes off the world-frame PID's mean square error."""
    from gimbal_pin.pointing.budget import BASELINE, STEPS

    parted = found.contest.budget
    if parted is None or not parted.telling:
        names = ", ".join(name for _, name in STEPS)
        return ["", f"no error budget: it takes {BASELINE} and two more, of {names}"]
    rows = [
        (what, f"{100 * share:.1f}", f"{degrees(parted.size(what)):.4f}", "█" * round(40 * min(max(share, 0.0), 1.0)))
        for what, share in parted.parts.items()
    ]
    return ["", table("error budget", "% of b²", "°", "", rows=rows)]


def auto(found: Auto) -> str:
    """Everything that `auto` found, and where its files lie."""
    files = table("file", "", rows=[(what, str(path)) for what, path in found.files.items()])
    parts = [
        identified(found.identified),
        *([] if found.diagnosis is None else [diagnosis(found.diagnosis, {})]),
        tuning(found.tuning),
        tracking(found.tracking, found.plant),
        f"no camera held on a platform: {found.why}" if found.held is None else verified(found.held),
        files,
        f"open {found.files['report']}",
    ]
    return "\n\n".join(parts)
