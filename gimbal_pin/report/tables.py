"""The tables of the results, each made once from a result: the terminal prints it, the page shows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite, isnan, nan
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from gimbal_pin.errors import NORMAL_95
from gimbal_pin.report.diagnosis_text import name_variables, state_share
from gimbal_pin.report.elements import Content, Table, bar, toned
from gimbal_pin.report.format import (
    DASH,
    angle,
    controller_name,
    figures,
    forces,
    interval,
    list_shown_joints,
    listed,
    nats,
    percent,
    torque_text,
    torque_unit,
    unit,
)

if TYPE_CHECKING:
    from gimbal_pin.control.judging import Judgement
    from gimbal_pin.control.laws import Margins
    from gimbal_pin.control.tuning import Tuning
    from gimbal_pin.diagnosis import Diagnosis, Finding
    from gimbal_pin.identification import Agreement, IdentificationResult
    from gimbal_pin.identification.bodies import Body, Figure
    from gimbal_pin.identification.payloads import CameraEstimate
    from gimbal_pin.log.io.inspection import Channel
    from gimbal_pin.pointing.result import Verified
    from gimbal_pin.report.evaluation import Evaluated, KnownParameter
    from gimbal_pin.report.format import ShownJoint

TOGETHER = "all-axes"
"""The experiment in which all axes move."""
AWAY = "σ: standard deviation; ± is 1.96 σ; off by: the value less the URDF's"
"""What the heads of a table of parameters mean."""
GOOD, FAIR = 95.0, 80.0
"""Fit, per cent, from which on a model is called good, or fair."""
PHASE_DEG, GAIN_DB = 45.0, 6.0
"""Margins from which on a loop is usually called safe."""
MOST = 6
"""Most rivals in a table."""
OPINION_TONES = {"structure left": "fair", "not explained": "poor"}
"""Tones of the states of a joint's torque: noise is no merit."""


def better(text: str, own: float, every: Sequence[float]) -> Content:
    """Return the text, marked if its value is the smallest and another larger by more than a twentieth."""
    known = [value for value in every if not isnan(value)]
    clear = len(known) > 1 and own == min(known) and max(known) > 1.05 * own
    return toned(text, "good" if clear else "")


# -- identification ----------------------------------------------------------------------------------------------------


def parameters(
    rows: Sequence[KnownParameter],
    bound: Sequence[float] | None = None,
    label: str = "Parameters",
    force: str = "N m",
) -> Table:
    """Value and 95 % interval of each parameter beside what the URDF states, and the torque that it moves if known.

    `bound`: least standard deviations that any unbiased estimate has, of each row; None: not known.
    `force`: unit of the torque, see `forces`.
    """
    reach = any(one.reach for one in rows)
    most = max((one.moved for one in rows), default=0.0)
    head = ["Parameter", "Unit", "Value", "± 95 %", "± % of it", "URDF", "Off by, σ"]
    head += ["± at best"] * (bound is not None) + [f"Moves, {force} rms"] * reach
    body: list[list[Content]] = []
    for k, one in enumerate(rows):
        value, half = interval(one.value, one.half)
        away = (
            "0"
            if abs(one.away) < 0.05
            else f"{one.away:+.1f}"
            if abs(one.away) < 1e4
            else f"{one.away:+.0e}"
        )
        row: list[Content] = [
            regrouping(one.name),
            unit(one.unit),
            value,
            half.removeprefix("± "),
            one.deviation,
        ]
        row += [figures(one.given, 4), DASH if isnan(one.away) else away.replace("-", "−")]
        row += [] if bound is None else [figures(NORMAL_95 * bound[k], 2)]
        row += [bar(one.moved / most if most else 0.0, figures(one.moved, 2))] if reach else []
        body.append(row)
    return Table(head, body, texts=2, label=label)


def tabulate_camera(found: CameraEstimate) -> Table:
    """A camera's own parameters with 95 % intervals, beside what its URDF states."""
    every = zip(
        found.names, found.units, found.value.tolist(), found.std.tolist(), found.urdf.tolist()
    )
    rows = [
        [regrouping(name), unit(unit_of), *interval(x, NORMAL_95 * std), figures(given, 4)]
        for name, unit_of, x, std, given in every
    ]
    return Table(
        ["Parameter", "Unit", "Value", "± 95 %", "URDF"],
        rows,
        texts=2,
        label="The camera's parameters",
    )


def tabulate_bodies(several: Sequence[Body]) -> Table:
    """Mass, centre of mass and inertia of the nearest bodies with 95 % intervals; marked what the log does not show."""

    def state(one: Figure, factor: float = 1.0) -> str:
        value = factor * one.value
        half = factor * NORMAL_95 * one.std
        return " ".join(interval(value, half)) if one.shown else f"{figures(value)} *"

    axes = [f"Centre of mass, {axis}, mm" for axis in "xyz"]
    names = [
        "Mass, kg",
        *axes,
        *(f"{name}, kg m²" for name in ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")),
    ]
    each = [
        (state(b.mass), *(state(x, 1e3) for x in b.com), *map(state, b.inertia)) for b in several
    ]
    return Table(
        ["Of the body", *(b.link for b in several)],
        list(zip(names, *each)),
        label="The nearest bodies",
    )


def list_tables(found: IdentificationResult) -> list[str]:
    """Say of each table of torque among the parameters how large it is, and where."""
    from gimbal_pin.report.evaluation import find_tables

    joints = {joint.name: joint for joint in list_shown_joints(found.model.rig)}
    lines = []
    for effect, place in find_tables(found).items():
        joint = joints[effect.joint]
        values = found.estimate.theta[list(place)]
        k = int(np.argmax(np.abs(values)))
        most = " ".join(interval(values[k], NORMAL_95 * found.estimate.std[place[k]]))
        lines.append(
            f"{joint.name}: {effect.name} over its {effect.over}, {len(place)} values from {figures(values.min())} to "
            f"{figures(values.max())} {joint.force}, {most} where it is largest, at "
            f"{state_place(joint, effect.over, effect.knots[k])}"
        )
    return lines


def state_place(joint: ShownJoint, over: str, x: float) -> str:
    """A knot of a table at a joint, over its angle, rate or load."""
    return (
        f"{figures(x)} {joint.force}" if over == "load" else joint.text(x, "/s" * (over == "rate"))
    )


def drifting_parameters(found: Agreement) -> Table:
    """The parameters that drift: each log's own value and deviation, and the chance of as much in logs that agree."""
    rows: list[list[Content]] = []
    for one in found.drifting:
        pairs = zip(one.values.tolist(), one.std.tolist())
        each = (
            " ".join(interval(x, NORMAL_95 * std)) if isfinite(std) else DASH for x, std in pairs
        )
        chance = figures(one.p_value, 2) if one.p_value >= 1e-3 else "< 0.001"
        rows.append([regrouping(one.name), unit(one.unit), *each, figures(one.shared, 3), chance])
    return Table(
        ["Drifts", "Unit", *found.logs, "Shared", "p"], rows, texts=2, label="Parameters that drift"
    )


def regrouping(name: str) -> Markup:
    """Return a sum of parameters that breaks between its terms alone: ``a − b + 0.12·c``."""
    terms = name.replace("*", "·").replace(" - ", " −\u00a0").replace(" + ", " +\u00a0").split(" ")
    return Markup("<code>{}</code>").format(
        Markup(" ").join(Markup("<span>{}</span>").format(x) for x in terms)
    )


def torque_errors(found: IdentificationResult, evaluated: Evaluated | None = None) -> Table:
    """How well the model predicts each joint's torque; with `evaluated`, the rows themselves, beside what it was."""
    held = found.held_out or found.train
    train = found.train
    joints = list_shown_joints(found.model.rig)
    force = forces(joints)
    opinions = found.opinions
    scale, name = torque_unit(max(held.torque_rmse.values()), force)
    head = [
        "Joint",
        f"Error, {name} rms",
        "Fit",
        *["What is left"] * bool(opinions),
        "Samples judged",
    ]
    head += [f"Training error, {name} rms", "Training fit"] * (held is not train)
    head += [f"Torque, {force} rms", "Error of it", f"Largest error, {name}", "URDF's fit"] * (
        evaluated is not None
    )
    rows: list[list[Content]] = []
    for j, joint in enumerate(joints):
        rmse = held.torque_rmse[joint.name]
        fit = held.fit_percent[joint.name]
        opinion = opinions.get(joint.name)
        row: list[Content] = [joint.label, figures(scale * rmse), toned(percent(fit), grade(fit))]
        row += (
            [] if opinion is None else [toned(opinion.value, OPINION_TONES.get(opinion.value, ""))]
        )
        row.append(f"{100 * held.used[joint.name]:.0f} %")
        if held is not train:
            row += [
                figures(scale * train.torque_rmse[joint.name]),
                percent(train.fit_percent[joint.name]),
            ]
        if evaluated is not None:
            torque = float(evaluated.torque_rms[j])
            largest = float(np.abs(evaluated.stacked("error")[:, j]).max())
            share = (
                f"{figures(100 * rmse / torque, 2)} %" if torque else DASH
            )  # nothing drove this joint
            stated = nan if not found.simpler else found.simpler[0].fit_percent[joint.name]
            row += [figures(torque), share, figures(scale * largest), percent(stated)]
        rows.append(row)
    return Table(head, rows, label="Torque error")


def grade(fit: float) -> str:
    """Return the tone of a fit, per cent; none where there is none."""
    return "" if isnan(fit) else "good" if fit >= GOOD else "fair" if fit >= FAIR else "poor"


# -- diagnosis ---------------------------------------------------------------------------------------------------------


def held_out_errors(found: Diagnosis) -> Table:
    """Held-out torque error of each model by joint, what is left, and what a cause must make to be found.

    What can be found is less than the noise that is left: over a whole log noise averages out, and a cause's form does
    not.
    """
    held = found.held_out
    assert held is not None
    joints = list_shown_joints(found.after.rig)
    most = max(max(errors.torque_rmse.values()) for errors in held.stages.values())
    rows: list[list[Content | None]] = []
    for joint in joints:
        name = joint.name
        rest = found.residual[name]
        opinion = found.opinions[name].value
        said = f"{opinion} ({name_variables(rest.over)})" if rest.over else opinion
        row: list[Content | None] = [joint.label, toned(said, OPINION_TONES.get(opinion, ""))]
        for errors in held.stages.values():
            error = torque_text(errors.torque_rmse[name], most, joint.force)
            row.append(f"{error} ({state_share(100 - errors.fit_percent[name])})")
        limit = found.detection_limit.get(name)
        rows.append([*row, torque_text(limit, most, joint.force) if limit else None])
    label = f"Torque error held out, {held.how}, up to {held.cutoff_hz:g} Hz"
    head = ["Joint", "What is left", "URDF", "Refitted", "Extended", "Detectable from"]
    return Table(head, rows, texts=2, label=label)


def tabulate_sizes(finding: Finding) -> Table:
    """A finding's figures with their intervals."""
    rows = [
        [p.name, *interval(p.value, NORMAL_95 * p.std), p.in_units.strip()]
        if p.is_known
        else [p.name, DASH, p.describe().removeprefix(f"{p.name} "), ""]
        for p in finding.parameters
    ]
    return Table(["Figure", "Value", "95 %", "Unit"], rows, label="Figures of the finding")


def rivals(finding: Finding) -> Table:
    """The causes that were fitted in a finding's place."""
    rows: list[list[Content]] = []
    for rival in finding.rivals[:MOST]:
        chance = figures(100 * rival.probability, 2)
        probable = bar(
            rival.probability, f"{chance} %" if rival.probability >= 1e-3 else "under 0.1 %"
        )
        out = toned("no", "fair") if rival.cause in finding.alike else toned("yes", "good")
        worse = nats(rival.nats, rival.std)
        rows.append([rival.cause, *worse, probable, out])
    head = ["Instead of it", "Worse by, nats", "± 95 %", "Probability", "Ruled out by this log"]
    label = f"Causes that were fitted in the place of {finding.cause}"
    return Table(head, rows, label=label, is_detail=True)


# -- controllers -------------------------------------------------------------------------------------------------------

MARGINS = ("Crossover", "Phase margin", "Gain margin", "Disk margin", "Delay margin")


def margins(own: Margins, disk: float | None = None) -> list[Content]:
    """Return the cells under `MARGINS` of one loop; `disk`: the disk margin that was asked for."""
    return [
        f"{figures(own.crossover_hz)} Hz",
        toned(f"{figures(own.phase_margin_deg)}°", safe(own.phase_margin_deg, PHASE_DEG)),
        toned(f"{figures(own.gain_margin_db)} dB", safe(own.gain_margin_db, GAIN_DB)),
        toned(figures(own.disk_margin), "" if disk is None else safe(own.disk_margin, disk)),
        f"{figures(1e3 * own.delay_margin)} ms",
    ]


def safe(value: float, enough: float) -> str:
    """Return the tone of a margin."""
    return "good" if value >= enough * (1 - 1e-6) else "fair" if value >= enough / 2 else "poor"


def bandwidths(found: Tuning) -> list[Content]:
    """Return each joint's bandwidth, and of which it was lowered."""
    rows = zip(found.bandwidth_hz, found.wish.per_joint(found.model.rig))
    return [
        toned(f"{figures(hertz)} of {figures(wanted)} Hz", "fair")
        if isfinite(wanted) and hertz < wanted * (1 - 1e-9)
        else f"{figures(hertz)} Hz"
        for hertz, wanted in rows
    ]


def loops(found: Tuning) -> Table:
    """Bandwidth, margins and gains of each joint; where models were drawn from the covariance, their worst margin."""
    wish = found.wish
    drawn = f"Disk margin, worst of {found.draws} draws"
    head: list[Content] = ["Joint", "Bandwidth", *MARGINS, *([drawn] if found.draws else [])]
    head += [
        Markup("K<sub>{}</sub>, {}").format(*pair)
        for pair in (("P", "1/s²"), ("I", "1/s³"), ("D", "1/s"))
    ]
    rows: list[list[Content]] = []
    for j, (joint, shown, pid) in enumerate(
        zip(list_shown_joints(found.model.rig), bandwidths(found), found.gains)
    ):
        worst = [found.worst[j].disk_margin] if found.draws else []
        rows.append([joint.label, shown, *margins(found.margins[j], wish.disk)])
        rows[-1] += [
            *(toned(figures(x), safe(x, wish.disk)) for x in worst),
            *map(figures, (pid.kp, pid.ki, pid.kd)),
        ]
    return Table(head, rows, label=f"Gains and margins, {controller_name(wish.kind)}")


def drive_gains(found: Tuning) -> Table:
    """Gains in the units that drives take, a line per gain that the constants of any joint's motor allow."""
    joints = list_shown_joints(found.model.rig)
    rows = list[list[Content]]()
    for system, force, turn in (
        ("torque", "N m", "rad"),
        ("current", "A", "rad"),
        ("count", "A", "count"),
    ):
        every = [getattr(own, system) for own in found.drive_gains]
        for k, form in enumerate((f"{force}/{turn}", f"{force}/({turn} s)", f"{force} s/{turn}")):
            forms = dict.fromkeys(
                joint.in_units(form) for joint, own in zip(joints, every) if own is not None
            )
            name = Markup("K<sub>{}</sub>, {}").format("PID"[k], " or ".join(forms))
            rows.append([name, *(DASH if own is None else figures(own[k]) for own in every)])
    cascades = [own.odrive for own in found.drive_gains]
    named = (
        "pos_gain, 1/s",
        "vel_gain, N m/(turn/s)",
        "vel_integrator_gain, N m/turn",
        "torque_constant, N m/A",
    )
    for k, gain in enumerate(named):
        rows.append(
            [f"ODrive {gain}", *(DASH if own is None else figures(own[k]) for own in cascades)]
        )
    shown = [row for row in rows if set(row[1:]) != {DASH}]
    return Table(
        ["For a drive, at home", *(joint.label for joint in joints)],
        shown,
        label="Gains for drives",
    )


def judgement(found: Judgement, joints: Sequence[ShownJoint]) -> Table:
    """Errors on the perturbed plants, median (worst), and how many times the PID's are larger, by joint and of all."""
    data = found.to_dict()
    names = list(found.errors)
    rows = list[list[Content]]()

    def cell(
        one: Mapping[str, Mapping[str, float | None]], place: str, text: Callable[[float], str]
    ) -> str:
        median, worst = ("lost" if (x := own[place]) is None else text(x) for own in one.values())
        return f"{median} ({worst})"

    for place, joint in (*((joint.name, joint) for joint in joints), ("all", None)):
        errors = [
            DASH if joint is None else cell(data["errors"][name], place, joint.text)
            for name in names
        ]
        ratios = [cell(own, place, lambda x: figures(x, 2)) for own in data["ratios"].values()]
        rows.append([place if joint is None else joint.label, *errors, *ratios])
    *others, rival = (controller_name(name) for name in names[1:])
    head = [
        "Joint",
        *(f"{who} error" for who in ("Tuned", *others, rival)),
        "Ratio",
        *(f"Ratio, {x}" for x in others),
    ]
    return Table(head, rows, label=f"Errors on {found.plants} perturbed plants")


# -- the camera --------------------------------------------------------------------------------------------------------


def state_torque_rms(torque_rms: Mapping[str, float]) -> str:
    """Torque of each joint, N m rms: jitter is bought with it."""
    each = ", ".join(f"{joint} {figures(size, 2)}" for joint, size in torque_rms.items())
    return f"torque {each} N m rms"


def state_jitter(found: Verified, controller: str) -> str:
    """A controller's jitter, and the torque that it costs."""
    (row,) = (row for row in found.rows if row.controller == controller)
    return f"leaves {angle(row.jitter_rms)} rms of jitter with {state_torque_rms(row.torque_rms)}"


def contest(found: Verified) -> Table:
    """How still each controller held the camera, and with what torque."""
    from gimbal_pin.log.limited import describe_limits

    rows: list[list[Content]] = []
    every = [(row.jitter_rms, row.jitter_max) for row in found.rows]
    for row, own in zip(found.rows, every):
        cells = [better(angle(one), one, several) for one, several in zip(own, zip(*every))]
        cells += [angle(row.drift), *(figures(torque) for torque in row.torque_rms.values())]
        limited = (
            describe_limits(row.at_limit) or f"{figures(100 * max(row.at_limit.values()), 2)} %"
        )
        rows.append([controller_name(row.controller), *cells, limited])
    head = [
        "Controller",
        "Jitter, rms",
        "Largest",
        "Drift",
        *(f"{joint}, N m rms" for joint in found.joints),
    ]
    return Table([*head, "At torque limit, of the time"], rows, label="Controllers on the platform")


def held_margins(found: Verified) -> Table:
    """Margins of the loops that held a camera; controllers with the same loops share rows, as joints do."""
    same: dict[tuple[Margins, ...], list[str]] = {}
    for name, loops in found.loops.items():
        same.setdefault(loops, []).append(controller_name(name))
    rows: list[list[Content]] = [
        [
            listed(names),
            ", ".join(j for j, one in zip(found.joints, loops) if one == own),
            *margins(own),
        ]
        for loops, names in same.items()
        for own in dict.fromkeys(loops)
    ]
    return Table(["Loops of", "Joints", *MARGINS], rows, texts=2, label="Margins of the loops")


# -- logs --------------------------------------------------------------------------------------------------------------


def channels(several: Sequence[Channel]) -> Table:
    """What each column of a file is, and why."""
    rows = []
    for c in several:
        ends = figures(c.low, 4), figures(c.high, 4), figures(c.step) if c.step else ""
        rows.append([c.column, c.kind, c.joint or "", c.unit, "; ".join(c.reasons), *ends])
    return Table(
        ["Column", "Is", "Of", "In", "Because", "From", "To", "Step"],
        rows,
        texts=5,
        label="Channels",
    )
