"""The camera held on a platform that moves: who held it how still, and where the error goes."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, inf, isnan
from typing import TYPE_CHECKING

from gimbal_pin.report.text.cells import number, percent, table
from gimbal_pin.report.text.loops import margins

if TYPE_CHECKING:
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.pointing.contest import Row
    from gimbal_pin.pointing.verify import Verified


def verified(found: Verified) -> str:
    """Every controller on all that was run, targets, and where the error goes, degrees."""
    judged = [(t.name, number(t.value, 3), number(t.must), number(t.aim), t.verdict) for t in found.targets]
    parts = [circumstances(found), controllers(found), *weak(found), ""]
    parts += [margins(found.loops, found.joints), ""] if found.loops else []
    parts += [*unstable(found), *found.slack]
    parts += [table("target", "value", "must", "aim", "reached", rows=judged)] if judged else []
    parts += [f"{t.name}: {t.note}" for t in found.targets if t.note and t.value is not None]
    parts += [*asking(found), *swept(found), *budget(found)]
    parts += [f"compensated: {sentence}" for sentence in found.causes]
    parts += [f"NOT compensated: {sentence}" for sentence in found.missed]
    parts += remarks(found)
    parts += [f"{row.controller}: {event}" for _, row in every(found) for event in row.happened]
    return "\n".join(parts)


def every(found: Verified) -> list[tuple[str, Row]]:
    """Every row of every motion, with what to call that motion: nothing where there is but one."""
    several = len(found.contests) > 1
    rows = [(contest.rows[0].runs[0].platform, row) for contest in found.contests for row in contest.rows]
    return [(f" (platform {platform})" if several else "", row) for platform, row in rows]


def remarks(found: Verified) -> list[str]:
    """What `switch` is, and why an observer may cost more than it gains."""
    from gimbal_pin.control.controllers import HOLDING, ORACLE, OURS

    still, told = found.contest.jitter, list[str]()
    if OURS in still:
        told.append(f"{OURS}: {HOLDING[OURS]}")
    plain, observed = still.get("with-gyros"), still.get("with-observer")
    if plain is not None and observed is not None and observed > 1.02 * plain and found.loops:
        fast, slow = (max(own.crossover_hz for own in found.loops[name]) for name in ("with-gyros", "with-observer"))
        told.append(
            f"with-observer shakes {number(observed / plain, 3)} times as much as with-gyros: at equal margins its "
            f"loop crosses at {number(slow, 3)} Hz, not at {number(fast, 3)}, and what an observer makes up for "
            "this model knows already"
        )
    least = min((jitter for name, jitter in found.contest.stable.items() if name != ORACLE), default=inf)
    if least < 0.97 * still.get(ORACLE, 0.0):
        told.append(f"{ORACLE}: no bound here, as another shakes less: foreknowledge is not what its error is made of")
    return told


def weak(found: Verified) -> list[str]:
    """Which joints are long at their torque limits, under whom: jitter and ratios then tell of motors."""
    from gimbal_pin.log.limited import PUSHED, limited

    rows = [(row.controller + where, limited(row.at_limit)) for where, row in every(found)]
    lines = [f"{who} is at the torque limit, of the time: {shares}" for who, shares in rows if shares]
    return [*lines, PUSHED] if lines else []


def unstable(found: Verified) -> list[str]:
    """Who swings by itself: such a controller's figures say nothing."""
    lines = []
    for where, row in every(found):
        sizes = [f"{s.joint} at {number(s.hz, 2)} Hz with {number(100 * s.share, 2)} %" for s in row.swings]
        if sizes:
            said = f"{row.controller}{where} is unstable, it swings by itself"
            lines.append(f"{said}: {', '.join(sizes)} of the torque limit")
    return [*lines, ""] if lines else []


def circumstances(found: Verified) -> str:
    """What was run, with which margins."""
    from gimbal_pin.control.controllers import TUNED

    contest, least = found.contest, found.margins
    ways = [(one.rows[0].runs[0], len(one.rows[0].runs)) for one in found.contests]
    motions = " and ".join(f"platform {run.platform}, {count} × {run.t[-1]:.3g} s" for run, count in ways)
    made = "; tuned has the gains of tune and margins of its own" if TUNED in contest.jitter else ""
    if found.steps is not None:
        sizes = ", ".join(f"{joint} {number(degrees(step), 3)}°" for joint, step in found.steps.steps.items())
        made += f"; steps of {sizes} by minimum jerk in 0.5 s, loops of 8 Hz, all at once and one at a time"
    return (
        f"{contest.rig}{f' with {contest.payload}' if contest.payload else ''} on {motions}; every loop's disk margin "
        f"with the drives that are known is at least {number(least.disk_margin, 3)}{made}"
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
    return (*(f"{degrees(x):.4f}" for x in sizes), *torques, percent(max(row.at_limit.values())))


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
    when = ", ".join(f"{first:.1f}" + f" to {last:.1f}" * (last - first > 0.1) for first, last in demand.moments)
    apart = demand.apart(found.contests[-1])
    rest = ", ".join(f"{name} {degrees(size):.4f}°" for name, size in apart.items())
    still = "none is left, they fill the run" if any(map(isnan, apart.values())) else rest
    told = ["", f"the recorded motion asks {weak}, at {when} s; jitter apart from these moments: {still}"]
    if isnan(demand.least["unforeseen"]):
        return told
    blind, seeing = (f"{degrees(demand.least[name]):.4f}°" for name in ("unforeseen", "foreseen"))
    bound = f"the torque limits alone leave any controller {blind} rms, or {seeing} if it foresees the motion"
    return [*told, f"{bound}, unless it rolls the camera instead"]


def swept(found: Verified) -> list[str]:
    """How wrong the model may be."""
    return [] if found.sweep is None or found.contest.gain is None else ["", found.sweep.sentence]


def budget(found: Verified) -> list[str]:
    """One bar: what each thing that the controllers know takes off the world-frame PID's mean square error."""
    from gimbal_pin.control.controllers import BASELINE
    from gimbal_pin.pointing.budget import STEPS

    parted = found.contest.budget
    if parted is None or not parted.telling:
        names = ", ".join(name for _, name in STEPS)
        return ["", f"no error budget: it takes {BASELINE} and two more, of {names}, all of them stable"]
    rows = [
        (what, f"{100 * share:.1f}", f"{degrees(parted.size(what)):.4f}", "█" * round(40 * min(max(share, 0.0), 1.0)))
        for what, share in parted.parts.items()
    ]
    note = [parted.note] if parted.note else []
    return ["", table("error budget", f"% of {BASELINE}'s mean square", "°", "", rows=rows), *note]
