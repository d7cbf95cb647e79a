"""Why the gains are what they are, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from math import isfinite

from gimbal_pin.control.laws.computed_torque import Robust
from gimbal_pin.control.laws.design import LAYERED, Wish
from gimbal_pin.control.laws.loop import Margins
from gimbal_pin.control.laws.uncertainty import DRAWN_MODELS, GAIN_CEILING, ModelErrorBounds, Ratios
from gimbal_pin.dynamics.model import Model, is_parameter
from gimbal_pin.effects import Signal
from gimbal_pin.errors import digits


class ReasonKind(Enum):
    """What a reason for gains says, as far as more than its sentence depends on it."""

    USUAL = "as it was asked for"
    ASSUMED = "nobody asked for it"
    LOWERED = "lower than it was asked for"
    UNCERTAIN = "the model is not known well enough"
    PID_SAFER = "without the model it is safer"


@dataclass(frozen=True)
class GainReason:
    """Why gains are what they are, in a sentence, and what kind of reason that is."""

    sentence: str
    kind: ReasonKind = ReasonKind.USUAL

    def __str__(self) -> str:
        """Return the sentence."""
        return self.sentence


UNSAFE_ALPHA = 0.5
"""Model errors from which on the inverted model does as much harm as good."""
UNSEEN = GainReason(
    "not to be run: beyond the data that were fitted its torque is unknown; identify it from more motion",
    ReasonKind.UNCERTAIN,
)
"""What is said of joints whose model does not hold for what was held out."""


def group_reasons(joints: Sequence[str], each: Sequence[GainReason]) -> list[GainReason]:
    """Put the joints before their reasons, those that share one together."""
    owners: dict[GainReason, list[str]] = {}
    for joint, reason in zip(joints, each):
        owners.setdefault(reason, []).append(joint)
    return [GainReason(f"{', '.join(names)}: {one}", one.kind) for one, names in owners.items()]


def about_loops(
    model: Model,
    wish: Wish,
    granted: Sequence[float],
    found: Sequence[Margins],
    least: Sequence[Margins] | None,
) -> list[GainReason]:
    """Say why the bandwidths and gains are what they are; `least`: the worst margins of all draws, if any."""
    joints = model.rig.joints
    rows = zip(wish.per_joint(model.rig), granted, found, model.drives)
    reasons = group_reasons(
        joints,
        [about_bandwidth(asked, hz, margins, wish, drive) for asked, hz, margins, drive in rows],
    )
    if least is not None:
        reasons += group_reasons(joints, [about_draws(margins, wish) for margins in least])
    return [*reasons, about_gains(wish), *about_compensation(model, wish.kind)]


def about_bandwidth(
    wanted: float, granted: float, found: Margins, wish: Wish, drive: Sequence[Signal] = ()
) -> GainReason:
    """Say what was granted, and what it leaves; `drive`: what stands between command and torque."""
    margins = (
        f"the believed model has phase margin {found.phase_margin_deg:.0f}°, gain margin "
        f"{found.gain_margin_db:.1f} dB, disk margin {found.disk_margin:.2f}, delay margin "
        f"{1e3 * found.delay_margin:.1f} ms"
    )
    if granted == wanted:
        return GainReason(f"bandwidth {digits(granted)} Hz, damping {wish.damping:g}; {margins}")
    late = f"with {digits(1e3 * (wish.delay + wish.dt / 2))} ms of delay and hold"
    late += "".join(
        f", and the drive's {name}" for name in dict.fromkeys(s.name for s in drive if s.linear)
    )
    if not isfinite(wanted):
        share = (
            f"{LAYERED:g} of the highest (the rest is for Lyapunov redesign)"
            if wish.robust
            else "the highest"
        )
        why = f"{share} that keeps a disk margin of {wish.disk:g} {late}"
        return GainReason(
            f"bandwidth {digits(granted)} Hz, damping {wish.damping:g}, {why}; {margins}"
        )
    why = f"{digits(wanted)} Hz would leave a disk margin under {wish.disk:g} {late}"
    return GainReason(
        f"bandwidth lowered to {digits(granted)} Hz, as {why}; {margins}", ReasonKind.LOWERED
    )


def doubts(joints: Sequence[str], over: Ratios, least: Sequence[Margins]) -> tuple[str, ...]:
    """Say which loops nobody should close: those whose inertia may as well be half of what is believed, or less.

    Args:
        joints: Joint names.
        over: Gains of the plant over what the law believes, of all draws.
        least: The worst margins of all draws.
    """
    most = [max(ratios) for ratios in over]
    rows = [(j, m, own) for j, m, own in zip(joints, most, least) if m >= 1 / (1 - UNSAFE_ALPHA)]
    said = [
        GainReason(
            f"not to be run: the logs leave its inertia open, its loop's gain may be {times(m)} what is believed and "
            f"cross at {digits(own.crossover_hz)} Hz; identify it better first (gimbal-pin excite designs a motion)",
            ReasonKind.UNCERTAIN,
        )
        for _, m, own in rows
    ]
    return tuple(map(str, group_reasons([joint for joint, _, _ in rows], said)))


def times(gain: float) -> str:
    """How many times a gain another one is; beyond those looked at it has no bound."""
    return (
        "any number of times" if gain >= GAIN_CEILING * (1 - 1e-9) else f"{digits(gain, 2)} times"
    )


def about_sampling(wish: Wish, logged: float | None) -> GainReason:
    """Say where a sampling interval comes from that nobody asked for."""
    known = "as the logs were" if logged else "as the rate of the logs is not known"
    text = f"sampled at {digits(1 / wish.dt)} Hz, {known}; where the controller runs at another rate, state it (dt)"
    return GainReason(text, ReasonKind.ASSUMED)


def about_delay(model: Model, wish: Wish) -> list[GainReason]:
    """Say which drive a delay is of that nobody stated; nothing where it is one sample."""
    known = model.estimated
    if known is None or wish.delay <= wish.dt:
        return []
    slowest = model.rig.joints[known.lags.index(max(known.lags))]
    late = f"{digits(1e3 * wish.delay, 2)} ms ({digits(wish.delay / wish.dt, 2)} samples)"
    text = f"delay of {late}, as late as the logs show {slowest}'s torque to act"
    return [GainReason(text, ReasonKind.ASSUMED)]


def warn_of_haste(model: Model, wish: Wish) -> list[str]:
    """Say that a delay was stated that is shorter, by more than half a sample, than the logs show; else nothing."""
    known = model.estimated
    late = max(known.lags, default=0.0) if known is not None else 0.0
    if known is None or wish.delay + wish.dt / 2 >= late:
        return []
    joint = model.rig.joints[known.lags.index(late)]
    stated = f"a delay of {digits(1e3 * wish.delay, 2)} ms was stated"
    shown = f"the logs show {joint}'s torque to act {digits(1e3 * late, 2)} ms late"
    return [
        f"{stated}, and {shown}: the loop may have less margin than stands here; leave --delay out, or measure it"
    ]


def about_gains(wish: Wish) -> GainReason:
    """Say what each gain is made of."""
    if wish.integral == 0:
        shape = f"ω = 2π · bandwidth, ζ = {wish.damping:g}"
        return GainReason(
            f"kp = ω², kd = 2 ζ ω with {shape}: the error's poles are s² + 2 ζ ω s + ω²"
        )
    poles = "(s² + 2 ζ ω s + ω²)(s + γ ω)"
    shape = f"ω = 2π · bandwidth, ζ = {wish.damping:g}, γ = {wish.integral:g}"
    return GainReason(
        f"kp = (1 + 2 ζ γ) ω², ki = γ ω³, kd = (2 ζ + γ) ω with {shape}: the error's poles are {poles}"
    )


def about_draws(found: Margins, wish: Wish) -> GainReason:
    """Say what the worst of the drawn models leaves."""
    if found.disk_margin == 0:
        text = (
            f"the worst of {DRAWN_MODELS} models drawn from the covariance makes the loop "
            "unstable: identify it better"
        )
        return GainReason(text, ReasonKind.UNCERTAIN)
    worst = (
        f"the worst of {DRAWN_MODELS} models drawn from the covariance has disk margin {found.disk_margin:.2f}, "
        f"phase margin {found.phase_margin_deg:.0f}°, crossover {digits(found.crossover_hz)} Hz"
    )
    if wish.kept(found.disk_margin):
        return GainReason(worst)
    return GainReason(
        f"{worst}, and no bandwidth would leave {wish.disk:g}: identify it better",
        ReasonKind.UNCERTAIN,
    )


def list_compensated(model: Model, kind: str) -> list[tuple[str, str | None]]:
    """Return cause and joint of what a control law makes up for, beside the inertias and plain friction."""
    if kind == "pid":
        return []
    found = [
        (term.effect.name, term.effect.joint)
        for term in model.terms
        if not is_parameter(model.rig, term.effect)
    ]
    found += [(signal.name, signal.joint) for signal in model.drive]
    return list(dict.fromkeys([*found, *((change.name, change.place) for change in model.changes)]))


def about_compensation(model: Model, kind: str) -> list[GainReason]:
    """Say what of the model, beside its inertias and plain friction, the control law makes up for; one line at most."""
    found = list_compensated(model, kind)
    what = "compensated:"
    if kind == "pid":
        found = list(dict.fromkeys((s.name, s.joint) for s in model.drive))
        what = "the margins include"
    named = ", ".join(f"{name} at {place}" for name, place in found)
    return [GainReason(f"{what} {named}")] if named else []


def about_inertia(nominal: float, ratios: Sequence[float], unit: str) -> GainReason:
    """Say how the inertia changes with the pose under a PID."""
    low = nominal / max(ratios)
    high = nominal / min(ratios)
    span = f"from {digits(low)} to {digits(high)} {unit}"
    return GainReason(f"the inertia goes {span} with the pose; the margins are the worst of them")


def about_model(known: ModelErrorBounds, force: str) -> GainReason:
    """Say how far the model may be off, and when PID is safer."""
    sizes = f"α = {digits(known.alpha, 2)} in inertia and {digits(known.phi, 2)} {force} otherwise"
    off = f"the model may be off by {sizes} ({known.source})"
    if known.alpha >= UNSAFE_ALPHA:
        return GainReason(
            f"{off}: a PID is safer (tune --kind pid) until it is identified better",
            ReasonKind.PID_SAFER,
        )
    return GainReason(off)


def about_layer(law: Robust | None) -> GainReason:
    """Say what Lyapunov redesign adds, or why it cannot."""
    if law is None:
        return GainReason(
            "no Lyapunov redesign: the outer loop leaves no margin for its boundary layer; ask for less bandwidth"
        )
    at_rest = law.size([0.0], [0.0])
    return GainReason(
        f"Lyapunov redesign: up to {digits(at_rest, 2)} rad/s² at rest, gain {digits(law.gain, 2)} within a boundary "
        f"layer of {digits(at_rest / law.gain, 2)} rad/s²; the margins include it"
    )
