"""Identified parameters with their uncertainty, of one camera or of several, at the end or while the rig moves."""

from __future__ import annotations

from math import degrees, floor, inf, log10
from textwrap import wrap
from typing import TYPE_CHECKING

from gimbal_pin.report.text.cells import number, table

if TYPE_CHECKING:
    from gimbal_pin.estimation.bodies import Figure
    from gimbal_pin.estimation.identification import Accuracy, Identified
    from gimbal_pin.estimation.payloads import Several
    from gimbal_pin.log.calibration import Mounting
    from gimbal_pin.online import Progress


def identified(found: Identified) -> str:
    """Parameters with uncertainty, accuracy, and how to balance the payload."""
    from gimbal_pin.estimation.balance import balance

    # Advice from the parameters of neither rig would lead astray.
    balanced = None if found.torn else balance(found)
    return "\n".join([*described(found), *(() if balanced is None else balanced.sentences)])


def described(found: Identified) -> list[str]:
    """Parameters with uncertainty, and accuracy."""
    heads = HEADS if found.bound is None else (*HEADS, "± at best")
    rows = [line for k in range(len(found.names)) for line in folded(parameter(found, k))]
    parts = [f"warning: {said}" for said in found.warnings]
    parts += [estimated(found), table(*heads, rows=rows), *at_best(found)]
    parts += ["±: –: not estimated here, but taken as it was known"] if not found.estimate.std.all() else []
    parts.append("")
    parts += [accuracy(part) for part in (found.train, found.held_out) if part is not None]
    parts += [f"note: {said}" for said in found.notes]
    parts += [mounting(log, link, how) for log, links in found.mountings.items() for link, how in links.items()]
    change = max(found.torque_change.values())
    parts.append(f"nearest physical parameters: {number(change, 2)} N m rms away in predicted torque, at most")
    parts += physique(found)
    return parts if found.torn or found.bias is None else [*parts, found.bias.sentence]


NAME = 48
"""Widest name of a parameter in a table."""
CLOSE = 0.1
"""Standard deviation, in shares of a parameter, beyond which the log is said to leave it open."""
HEADS = ("parameter", "value", "± 95 %", "± % of it", "unit", "URDF", "off by, std")


def estimated(found: Identified) -> str:
    """By what the parameters were estimated, and what their deviations stand on."""
    method = found.estimate.method
    held = f", the URDF's masses trusted to {100 * found.trust:.3g} % (--trust)" if method == "ridge" else ""
    return f"{len(found.names)} parameters by {method}{held}; deviations by {found.estimate.uncertainty}"


def folded(row: tuple[str, ...]) -> list[tuple[str, ...]]:
    """A row whose name is a long sum, as several: the figures stand beside its first terms."""
    first, *more = wrap(row[0], NAME, break_long_words=False, break_on_hyphens=False)
    return [(first, *row[1:]), *((f"  {part}", *[""] * (len(row) - 1)) for part in more)]


def parameter(found: Identified, k: int) -> tuple[str, ...]:
    """A parameter's row: its interval, and how far it is from what the URDF states."""
    value, std = float(found.estimate.theta[k]), float(found.estimate.std[k])
    share = number(100 * abs(1.96 * std / value), 2) if value and std else ""
    interval = number(1.96 * std, 2) if std else "–"  # nothing was estimated: it was taken as it was known
    stated = (number(float(found.stated[k])), off_by(float(found.moved[k])))
    best = () if found.bound is None else (number(1.96 * float(found.bound[k]), 2),)
    return (found.names[k], number(value), interval, share, found.units[k], *stated, *best)


def off_by(deviations: float) -> str:
    """Return a difference in standard deviations, with its sign."""
    if deviations != deviations:
        return "–"
    return f"{deviations:+.1f}" if abs(deviations) < 1e5 else f"{deviations:+.1g}"


def at_best(found: Identified) -> list[str]:
    """What the log itself leaves open, whoever estimates: Cramér and Rao's bound beside each interval."""
    if found.bound is None:
        return []
    told = "± at best: of any unbiased estimate from these rows (Cramér and Rao, by the residual's colour up to 16 Hz)"
    theta = found.estimate.theta.tolist()
    rows = zip(found.names, theta, found.bound.tolist())
    loose = [name for name, value, std in rows if std > CLOSE * abs(value)]
    if not loose:
        return [told]
    limit = f"the log tells these no closer than to a standard deviation of {100 * CLOSE:.0f} % of their value"
    return [told, f"{limit}, for they are small: {', '.join(loose)}"]


PARTS = (slice(1, 3), slice(3, 4), slice(4, 5))
"""Columns of what is told of bodies that stand together."""


def physique(found: Identified) -> list[str]:
    """The nearest bodies with 95 % intervals, and what of them is the URDF's."""
    rows = []
    for body in found.bodies:
        com = ", ".join(within(figure, 1e3) for figure in body.com)
        diagonal = ", ".join(within(body.inertia[k]) for k in (0, 2, 5))
        products = ", ".join(within(body.inertia[k]) for k in (1, 3, 4))
        rows.append((body.link, within(body.mass), com, diagonal, products))
    # Three tables: one of all columns would be wider than a terminal.
    heads = ("body", "mass, kg", "centre of mass, mm", "Ixx, Iyy, Izz, kg m^2", "Ixy, Ixz, Iyz, kg m^2")
    told = [table(heads[0], *heads[part], rows=[(row[0], *row[part]) for row in rows]) for part in PARTS]
    trust = f"± 95 %, the URDF's bodies trusted to {100 * found.trust:.3g} % (--trust)"
    trust += "; *: the log hardly shows it, it stays near the URDF's"
    return ["", *told, trust, ""]


def within(figure: Figure, factor: float = 1.0) -> str:
    """A figure and its 95 % interval, no finer than that tells; one that the log does not show, as the URDF's."""
    half = 1.96 * figure.std * factor
    places = max(0, 1 - floor(log10(half))) if 0 < half < inf else 6
    value = f"{figure.value * factor:.{places}f} ± {number(half, 2)}"
    return value if figure.shown else f"{value.split(' ')[0]}*"


def several(found: Several) -> str:
    """Every camera's own parameters, the accuracy with it and its balance; then the gimbal's parameters."""
    from gimbal_pin.estimation.balance import balance

    parts = []
    for name, one in found.identified.items():
        camera = found.cameras[name]
        balanced = balance(one, camera.mass)
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
    return "\n".join([*parts, found.sentence, f"with {found.first.model.rig.payload}", *described(found.first)])


def mounting(log: str, link: str, found: Mounting) -> str:
    """How an IMU sits on its link, in degrees."""
    turn, bias = (degrees(sum(x * x for x in vector.tolist()) ** 0.5) for vector in (found.misalignment, found.bias))
    gap = f", its gyro then differs from the encoders by {number(degrees(found.after), 2)}°/s rms"
    known = gap if found.after == found.after else ""
    return f"{log}: IMU of {link} is turned by {number(turn, 3)}°, its gyro's bias is {number(bias, 3)}°/s{known}"


def accuracy(part: Accuracy) -> str:
    """Torque error of one part of the data."""
    used = min(part.used.values())
    judged = (
        ""
        if used > 0.9
        else f"\n  as little as {100 * used:.0f} % of a joint's samples tell, the rest is near standstill"
    )
    return f"{part}{judged}"


def following(found: Progress, told: int) -> str:
    """One line on an online estimate: time, torque error, the most telling parameters; then what happened anew.

    So many events were `told` before.
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
