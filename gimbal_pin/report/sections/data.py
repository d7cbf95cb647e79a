"""What there is: the rig, its logs, and what a log's file holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from gimbal_pin.checks import Alteration
from gimbal_pin.dynamics.base_parameters import Base
from gimbal_pin.dynamics.checking import Checked
from gimbal_pin.identification.payloads import get_stated_payload
from gimbal_pin.log.io.inspection import Inspected, summarize_stream
from gimbal_pin.log.log import Log
from gimbal_pin.report import plots, tables
from gimbal_pin.report.charts import Chart, Charts, Trace
from gimbal_pin.report.elements import (
    Content,
    Element,
    Section,
    Table,
    bullets,
    folded,
    heading,
    paragraph,
)
from gimbal_pin.report.format import (
    DASH,
    PALETTE,
    ShownJoint,
    figures,
    file_name,
    forces,
    joint_colours,
    list_shown_joints,
    listed,
    units,
)
from gimbal_pin.rig.rig import Rig

DRAWN = 3
"""Most logs that are drawn."""
PANEL_HEIGHT = 1.6
"""Height of a panel of channels, in."""
MOST_CURVES = 8
"""Most curves in a panel: so many colours are told apart."""


def show_rig(rig: Rig, weighed: float | None = None) -> Section:
    """Return a rig's joints, motors, limits and moved masses as its URDF and YAML state them.

    `weighed`: mass of the payload, kg, where it was given beside the log.
    """
    limits = list[list[Content]]()
    motors = list[list[Content]]()
    for j, joint in enumerate(list_shown_joints(rig)):
        limit = rig.limits[j]
        motor = rig.motors[j]
        (dry, viscous) = rig.friction[j].tolist()
        bound = isfinite(limit.lower) or isfinite(limit.upper)
        travel = f"{joint.text(limit.lower)} … {joint.text(limit.upper)}" if bound else "unlimited"
        rates = joint.text(limit.velocity, "/s"), joint.text(limit.acceleration, "/s²")
        torque = figures(float(rig.tau_max[j])) if isfinite(rig.tau_max[j]) else DASH
        constant = DASH if motor.torque_constant is None else figures(motor.torque_constant)
        limits.append([joint.label, rig.links[j], travel, *rates, torque, constant])
        carried = sum(
            rig.model.inertias[k].mass
            for k in range(1, rig.n + 1)
            if j + 1 in list(rig.model.supports[k])
        )
        encoder = [DASH, DASH]
        if motor.encoder_bits:
            encoder = [f"{motor.encoder_bits:g} bit", joint.text(motor.encoder_step, digits=2)]
        iron = [str(count) if count else DASH for count in (motor.slots, motor.poles)]
        motors.append(
            [
                joint.label,
                *encoder,
                *iron,
                *(figures(x) for x in (dry, viscous, motor.armature, carried)),
            ]
        )
    looks = list_shown_joints(rig)
    force, viscous, inertia = (
        " or ".join(dict.fromkeys(one.in_units(unit) for one in looks))
        for unit in ("N m", "N m s/rad", "kg m²")
    )
    head = [
        "Joint",
        "Moves",
        "Travel",
        "Rate",
        "Acceleration",
        f"Torque limit, {force}",
        f"Torque constant, {force}/A",
    ]
    more = [
        "Joint",
        "Encoder",
        "Step",
        "Slots",
        "Poles",
        f"Coulomb, {force}",
        f"Viscous, {viscous}",
    ]
    more += [f"Rotor, {inertia}", "Carries, kg"]
    loads = "Motors, sensors and loads, as given"
    parts = [
        paragraph(describe_rig_and_payload(rig, weighed)),
        Table(head, limits, texts=2, caption="Joints and limits"),
        folded(loads, Table(more, motors, label=loads), is_detail=False),
    ]
    return Section("Rig", parts, is_detail=True)


def show_check(found: Checked) -> Section:
    """Return a checked rig: its joints, what its motors bear, and what a log of it must hold."""
    rig = found.rig
    looks = list_shown_joints(found.rig)
    loads = (
        f"{figures(round(found.joints[x.name].gravity_torque, 9))} {x.force} at {x.name}"
        for x in looks
    )
    lines = [
        f"gravity       takes up to {listed(loads)}",
        f"camera frame  {found.camera_frame} (+x is the line of sight; 'camera_frame:' and 'optical_axis:' in a YAML)",
        f"payload on    {found.mount or DASH} ('mount:'); IMUs on {', '.join(found.imus) or DASH} ('imus:', 'noise:')",
        f"identifiable  {found.identifiable} parameters, friction included (gimbal-pin base names them)",
        f"a log needs   {', '.join(found.columns)}",
        f"and may hold  {', '.join(found.optional)}",
        "to state more 'gimbal-pin new-rig' writes a YAML for a rig, with comments",
        *(f"note          {warning}" for warning in found.warnings),
    ]
    state = "valid, with the notes below" if found.warnings else "sound"
    sound = paragraph(f"{rig.title}: tree, axes, limits and inertias are {state}")
    needs = Element(bullets(" ".join(line.split()) for line in lines).html, "\n".join(["", *lines]))
    return Section("Rig", [sound, *show_rig(rig).parts, needs])


def show_base(found: Base) -> Section:
    """Return base parameters, and what a base that moves adds to them."""
    sums = found.parameters - len(found.terms) - len(found.unidentifiable)
    counts = (
        f"{found.parameters} parameters: {len(found.terms)} identifiable, {sums} only in sums with these, "
        f"{len(found.unidentifiable)} without trace"
    )
    lists = {"Identifiable": found.names, "Without any trace in the torques": found.unidentifiable}
    for motion, words in (("tilted", "leans or shifts"), ("rotating", "turns")):
        names = [entry["name"] for entry in found.to_dict()["moving_base"][motion]["adds"]]
        lists[f"A base that {words} adds {len(names)}: {len(found.terms) + len(names)} in all"] = (
            tuple(names)
        )
    parts = (part for title, names in lists.items() for part in (heading(title), bullets(names)))
    return Section("Base parameters", [paragraph(counts), *parts])


def show_bundled(bundled: Mapping[str, Any]) -> Section:
    """Return the bundled rigs and payloads."""
    bodies = [
        (name, rig["payload"] or "", rig["description"]) for name, rig in bundled["rigs"].items()
    ]
    loads = [(name, payload["description"]) for name, payload in bundled["payloads"].items()]
    return Section(
        "Bundled",
        [Table(["Rig", "Payload", ""], bodies, texts=3), Table(["Payload", ""], loads, texts=2)],
    )


def describe_rig_and_payload(rig: Rig, weighed: float | None) -> Markup:
    """Return what is mounted and what the frames are called."""
    stated = float(get_stated_payload(rig)[0])
    mass, extra = (
        (stated, "")
        if weighed is None
        else (weighed, f" as weighed; its URDF says {figures(stated)} kg")
    )
    moved = sum(body.mass for body in rig.model.inertias[1:]) + mass - stated
    parts = [Markup("Moved mass {} kg.").format(figures(moved))]
    if rig.payload:
        weight = f" ({figures(mass)} kg{extra})" if mass else ""
        parts.append(Markup("Payload <b>{}</b>{}.").format(rig.payload, weight))
    parts.append(Markup("Base link <code>{}</code>.").format(rig.base))
    parts += (
        [Markup("Line of sight along x of <code>{}</code>.").format(rig.camera_frame)]
        if rig.aims
        else []
    )
    parts += [Markup("IMUs on {}.").format(listed(rig.config.imus))] if rig.config.imus else []
    return Markup(" ").join(parts)


def show_logs(rig: Rig | None, logs: Sequence[Log]) -> Section:
    """Return the logs' size, the range of its limits that each joint covers, and angles and torques over time.

    `rig`: None: angles are in radians, and no limit is known.
    """
    names = logs[0].joints if rig is None else rig.joints
    radians = tuple(
        ShownJoint(name, colour, 1.0, "rad") for name, colour in zip(names, joint_colours(names))
    )
    joints = radians if rig is None else list_shown_joints(rig)
    payload = None if rig is None else rig.payload
    force = forces(joints)
    rows: list[list[Content]] = []
    for log in logs:
        length, rate = (figures(x, 4) for x in (float(log.t[-1] - log.t[0]), 1 / log.dt))
        measured = "measured" if log.v is not None else "from angles"
        samples = f"{len(log):,}".replace(",", " ")
        rows.append(
            [file_name(log.name), log.payload or payload or DASH, length, rate, samples, measured]
        )
    each: list[list[Content]] = []
    for j, joint in enumerate(joints):
        low = min(float(log.q[:, j].min()) for log in logs)
        high = max(float(log.q[:, j].max()) for log in logs)
        rates = (np.gradient(log.q[:, j], log.t) if log.v is None else log.v[:, j] for log in logs)
        tau = np.concatenate(
            [log.tau[:, j] for log in logs if log.tau is not None] or [np.zeros(1)]
        )
        top = float(np.abs(tau).max())
        limit = inf if rig is None else float(rig.tau_max[j])
        fastest = joint.text(max(float(np.abs(rate).max()) for rate in rates), "/s")
        torques = figures(float(np.sqrt(np.mean(tau**2)))), figures(top)
        share = f"{100 * top / limit:.0f} %" if isfinite(limit) else DASH
        each.append(
            [joint.label, f"{joint.text(low)} … {joint.text(high)}", fastest, *torques, share]
        )
    head = ["Log", "Payload", "Length, s", "Rate, Hz", "Samples", "Joint rates"]
    cover = [
        "Joint",
        "Travel",
        "Largest rate",
        f"Torque rms, {force}",
        f"Largest torque, {force}",
        "of the limit",
    ]
    parts: list[object] = [
        Table(head, rows, texts=2, caption="Logs"),
        Table(cover, each, caption="Covered"),
    ]
    for log in logs[:DRAWN]:
        caption = f"{file_name(log.name)}: what was recorded; all joints should move, far and at many rates."
        parts.append(folded(f"Over time: {file_name(log.name)}", picture_log(joints, log, caption)))
    events = [f"{file_name(log.name)}: {event}" for log in logs for event in log.events]
    return Section(
        "Data",
        [*parts, *([bullets(events)] if events else [])],
        "What the model was learnt from.",
        True,
    )


def picture_log(joints: Sequence[ShownJoint], log: Log, caption: str) -> plots.Drawing:
    """Return angles and torques over time."""
    alt = f"Angle and torque of {', '.join(log.joints)} over time in {file_name(log.name)}"

    def draw() -> plots.Figure:
        return Charts(log.name, [[chart] for chart in chart_log(joints, log).rows[0]]).draw()

    return plots.Drawing(draw, alt, caption, partial(chart_log, joints, log))


def chart_log(joints: Sequence[ShownJoint], log: Log) -> Charts:
    """Return angles, how far they are off a reference where there is one, and torques, all joints in one chart each."""
    scale = np.array([joint.scale for joint in joints])
    shown = {f"position, {units(joints)}": scale * log.q}
    if log.q_ref is not None:
        shown[f"error, {units(joints)}"] = scale * (log.q_ref - log.q)
    if log.tau is not None:
        shown[f"torque, {forces(joints)}"] = log.tau
    charts = [
        Chart(
            "",
            plots.INK,
            label,
            log.t,
            [Trace(one.name, y, one.colour) for one, y in zip(joints, values.T)],
            {},
        )
        for label, values in shown.items()
    ]
    return Charts(log.name, [charts])


def show_file(found: Inspected, altered: Sequence[Alteration] = ()) -> Section:
    """Return the picture of a file's channels, their tables, what the verbs would alter, and the proposed mapping."""
    picture = plots.Drawing(
        partial(draw_channels, found), f"Every channel of {found.name} over time", "As recorded."
    )
    parts: list[object] = [Element(Markup(), found.name), picture]
    for stream in found.streams:
        parts += [bullets(summarize_stream(stream)), tables.channels(stream.channels)]
    notes = [*found.notes, *(f"would be altered: {one}" for one in altered)]
    parts += [bullets(notes)] if notes else []
    if found.rig is not None:
        mapping = Markup("<h3>Mapping for {}</h3><pre>{}</pre>").format(found.rig, found.yaml)
        parts.append(Element(mapping, f"\n{found.yaml}".rstrip()))
    return Section(Path(found.name).name, parts)


def draw_channels(found: Inspected) -> plots.Figure:
    """Return a figure with one panel per stream and kind of channel, constants left out."""
    panels = [
        (stream, kind, [c for c in stream.channels if c.kind == kind][:MOST_CURVES])
        for stream in found.streams
        for kind in dict.fromkeys(
            c.kind for c in stream.channels if c.kind not in ("time", "constant", "copy")
        )
    ]
    figure, axes = plots.panels(
        max(len(panels), 1), 1, 0.9 + PANEL_HEIGHT * max(len(panels), 1), gaps=(0.75, 0.5)
    )
    for row, (stream, kind, several) in zip(axes[:, 0], panels):
        for channel, colour in zip(several, PALETTE):
            plots.curve(
                row, stream.t - stream.t[0], stream.data[channel.column], color=colour, lw=1.0
            )
        plots.put_legend(
            row, [(channel.column, colour) for channel, colour in zip(several, PALETTE)]
        )
        units = dict.fromkeys(channel.unit for channel in several)
        row.set_ylabel(f"{kind}, {'/'.join(units)}" if any(units) else kind)
    axes[-1, 0].set_xlabel("time, s")
    return figure
