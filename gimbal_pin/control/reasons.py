"""Why the gains are what they are, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from gimbal_pin.control.design import Wish
from gimbal_pin.control.loop import Margins
from gimbal_pin.control.lyapunov import Robust
from gimbal_pin.control.uncertainty import Bounds
from gimbal_pin.effects import ALWAYS, Signal
from gimbal_pin.model import Model

UNSAFE_ALPHA = 0.5
"""Model errors from which on the inverted model does as much harm as good."""


def grouped(joints: Sequence[str], sentences: Sequence[str]) -> list[str]:
    """Put the joints before their sentences, those that share one together."""
    owners: dict[str, list[str]] = {}
    for joint, sentence in zip(joints, sentences):
        owners.setdefault(sentence, []).append(joint)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in owners.items()]


def about_bandwidth(wanted: float, granted: float, found: Margins, wish: Wish, drive: Sequence[Signal] = ()) -> str:
    """Say what was granted, and what it leaves; `drive`: what stands between command and torque."""
    margins = (
        f"phase margin {found.phase_margin_deg:.0f}°, gain margin {found.gain_margin_db:.1f} dB, "
        f"disk margin {found.disk_margin:.2f}, {1e3 * found.delay_margin:.1f} ms of further delay"
    )
    if granted == wanted:
        return f"{granted:.3g} Hz, damping {wish.damping:g}; {margins}"
    delay = 1e3 * (wish.delay + wish.dt / 2)
    others = "".join(f", and the drive's {signal.name}" for signal in drive if signal.linear)
    why = f"{wanted:.3g} Hz would leave a disk margin under {wish.disk:g} with {delay:.3g} ms of delay and hold{others}"
    return f"lowered to {granted:.3g} Hz, as {why}; {margins}"


def about_compensation(model: Model, kind: str) -> list[str]:
    """Say what of the model, beside its inertias and plain friction, the control law makes up for; one line at most."""
    always = {cause.name for cause in ALWAYS}
    terms = [f"{t.effect.name} at {t.effect.joint}" for t in model.terms if t.effect.name not in always]
    drive = [f"{signal.name} at {signal.joint}" for signal in model.drive]
    if kind == "pid":
        return [f"the margins include {', '.join(drive)}"] if drive else []
    found = [*terms, *drive, *(f"{change.name} at {change.place}" for change in model.changes)]
    return [f"compensated: {', '.join(found)}"] if found else []


def about_inertia(nominal: float, ratios: Sequence[float]) -> str:
    """Say how the inertia changes with the pose under a PID."""
    low, high = nominal / max(ratios), nominal / min(ratios)
    return f"the inertia goes from {low:.3g} to {high:.3g} kg m² with the pose; the margins are the worst of them"


def about_model(known: Bounds) -> str:
    """Say how far the model may be off, and when PID is safer."""
    off = f"the model may be off by α = {known.alpha:.2g} in inertia and {known.phi:.2g} N m otherwise ({known.source})"
    if known.alpha >= UNSAFE_ALPHA:
        return f"{off}: a PID is safer (tune --kind pid) until it is identified better"
    if known.cross_model > known.cross_pid:
        why = f"{known.cross_model:.2g} rad/s² per rad/s², {known.cross_pid:.2g} with PID"
        return f"{off}: one joint may move another more than without a model ({why}): a PID is safer (tune --kind pid)"
    return off


def about_layer(law: Robust | None) -> str:
    """Say what Lyapunov redesign adds, or why it cannot."""
    if law is None:
        return "no Lyapunov redesign: the outer loop leaves no margin for its boundary layer; ask for less bandwidth"
    at_rest = law.size([0.0], [0.0])
    return (
        f"Lyapunov redesign: up to {at_rest:.2g} rad/s² at rest, gain {law.gain:.2g} within a boundary layer of "
        f"{at_rest / law.gain:.2g} rad/s²; the margins include it"
    )
