"""The next experiment in sentences."""

from __future__ import annotations

from gimbal_pin.diagnosis import NextExperiment
from gimbal_pin.diagnosis.planning import Parting
from gimbal_pin.report.format import figures


def describe_next_experiment(planned: NextExperiment) -> list[str]:
    """Return what the next experiment separates, by what, and how to run it."""
    lines = [line for one in planned.partings for line in _describe_parting(one)]
    if planned.motion is None:
        return lines
    lines.append(
        f"The motion lasts {figures(planned.seconds)} s, from rest to rest within the rig's limits."
    )
    lines.append("Play it, and diagnose its log with the others, or alone.")
    if not planned.finished:
        lines.append("The search was interrupted; the motion is the best so far.")
    return lines


def _describe_parting(one: Parting) -> list[str]:
    """Return the sentences on a finding and a cause that is not told from it."""
    who = one.joint or "rig"
    pair = f"{one.cause} from {one.rival}"
    if one.nats_expected is None:
        return [f"{who}: no motion separates {pair}.", *_list_instead(one)]
    now = (
        ""
        if one.nats_now is None
        else f"; so far it is {figures(max(round(one.nats_now, 1), 0.0))} nats"
    )
    gain = f"the expected gain is {figures(max(round(one.nats_expected, 1), 0.0))} nats{now}"
    if one.is_named:
        return [f"{who}: the motion separates {pair}: {gain}."]
    return [f"{who}: the motion hardly separates {pair}: {gain}.", *_list_instead(one)]


def _list_instead(one: Parting) -> list[str]:
    """Return other experiments that may separate two causes."""
    who = one.joint or "rig"
    return [f"{who}: try also {way}." for way in dict.fromkeys(one.instead)]
