"""The next experiment in sentences."""

from __future__ import annotations

from gimbal_pin.diagnosis import NextExperiment
from gimbal_pin.diagnosis.planning import Parting
from gimbal_pin.report.format import figures, listed


def describe_next_experiment(planned: NextExperiment) -> list[str]:
    """Return what the next experiment separates, by what, and how to run it."""
    lines = [_describe_parting(parting) for parting in planned.partings]
    instead = dict[str, dict[str, None]]()
    for parting in planned.partings:
        for way in () if parting.is_named else parting.instead:
            instead.setdefault(way, {})[parting.joint or "rig"] = None
    lines += [f"{listed(joints)}: try also {way}." for way, joints in instead.items()]
    if planned.motion is None:
        return lines
    length = figures(planned.seconds)
    lines.append(f"The motion lasts {length} s, from rest to rest within the rig's limits.")
    lines.append("Play it, and diagnose its log with the others, or alone.")
    if not planned.finished:
        lines.append("The search was interrupted; the motion is the best so far.")
    return lines


def _describe_parting(parting: Parting) -> str:
    """Return the sentence on a finding and a cause that is not told from it."""
    head = f"{parting.joint or 'rig'}: "
    pair = f"{parting.cause} from {parting.rival}"
    if not parting.is_tried:
        return f"{head}no motion was tried that would separate {pair}."
    if parting.nats_expected is None:
        return f"{head}no motion that was tried separates {pair}."
    how = "separates" if parting.is_named else "hardly separates"
    gain, now = (
        figures(max(round(nats, 1), 0.0)) for nats in (parting.nats_expected, parting.nats_now or 0)
    )
    so_far = "" if parting.nats_now is None else f"; so far it is {now} nats"
    return f"{head}the motion {how} {pair}: the expected gain is {gain} nats{so_far}."
