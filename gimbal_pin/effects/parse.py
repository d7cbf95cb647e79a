"""Causes as one writes them on the command line: ``cogging:yaw:amplitude=0.03,harmonic=42``."""

from __future__ import annotations

from collections.abc import Mapping
from math import isinf, isnan

from gimbal_pin.effects import CAUSES, Cause, Effect, RigEffect, Signal, Term
from gimbal_pin.effects.cause import check_within, format_bounds
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import UsageError
from gimbal_pin.rig.rig import Rig


def parse_estimated_effect(text: str, rig: Rig) -> Effect:
    """Return the torque effect of ``CAUSE:JOINT[:NAME=VALUE,...]``, whose coefficients a fit estimates.

    Raises:
        UsageError: As `parse_effect`; a cause that is no torque with coefficients.
    """
    planted = parse_effect(text, rig, is_estimated=True)
    if not isinstance(planted, Term):
        what = "is no torque with coefficients that a linear fit estimates"
        raise UsageError(f"effect '{text}'", what, "leave it out: 'diagnose' estimates it")
    return planted.effect


def parse_effect(text: str, rig: Rig, is_estimated: bool = False) -> Term | Signal | RigEffect:
    """Return what ``CAUSE[:JOINT][:NAME=VALUE,...]`` plants on a rig, in SI units and radians.

    `is_estimated`: whether its coefficients need no values; they are then one.

    Raises:
        UsageError: An unknown cause, joint or parameter, a value out of bounds, a parameter missing; it names what
            there is.
    """
    name, _, rest = text.partition(":")
    if name not in CAUSES:
        causes = ", ".join(sorted(CAUSES))
        raise UsageError(
            f"effect '{text}'",
            f"there is no cause '{name}'",
            f"the causes are {causes}; 'help' lists their parameters",
        )
    kind = CAUSES[name]
    joint, _, pairs = rest.partition(":") if kind.of_joint else ("", "", rest.removeprefix(":"))
    if kind.of_joint and joint not in rig.joints:
        what = f"the rig {rig.name} has no joint '{joint}'"
        raise UsageError(
            f"effect '{text}'",
            what,
            f"write {_format_usage(kind)} with a joint out of {', '.join(rig.joints)}",
        )
    planted: Term | Signal | RigEffect = kind.planted(
        joint or None, _read_values(kind, pairs, text, is_estimated)
    )
    return planted


def format_causes() -> str:
    """All causes as one writes them, each over its parameters: meaning, bounds, units and defaults."""
    lines = list[str]()
    for name in sorted(CAUSES):
        kind = CAUSES[name]
        lines += [
            _format_usage(kind),
            *(f"  {_describe_parameter(p)}: {p.meaning}" for p in kind.stated()),
        ]
    return "\n".join(lines)


def _read_values(
    kind: type[Cause], pairs: str, text: str, is_estimated: bool
) -> Mapping[str, float]:
    """Return a value for each parameter of a cause: those given, and the others' defaults."""
    known = {parameter.name: parameter for parameter in kind.stated()}
    out = {name: parameter.value for name, parameter in known.items()}
    place = f"effect '{text}'"
    for pair in pairs.split(",") if pairs else ():
        name, _, number = pair.partition("=")
        if name not in known:
            raise UsageError(
                place,
                f"{kind.name} has no parameter '{name}'",
                f"write {_format_usage(kind)}: {_describe_parameters(kind)}",
            )
        out[name] = check_within(known[name], to_number(number, name, place), place)
    if is_estimated:
        shapes = {shape.name for shape in kind.shapes}
        out = {
            name: value if name in shapes or not isnan(value) else 1.0
            for name, value in out.items()
        }
    missing = [name for name, value in out.items() if isnan(value)]
    if missing or not any(out.values()):
        what = f"says nothing of {', '.join(missing or known)}"
        raise UsageError(place, what, f"write {_format_usage(kind)}: {_describe_parameters(kind)}")
    return out


def to_number(text: str, name: str, place: str) -> float:
    """Return a finite number; `UsageError` for anything else."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if isnan(value) or isinf(value):
        raise UsageError(place, f"{name} is '{text}'", "give a number")
    return value


def _format_usage(kind: type[Cause]) -> str:
    """``cogging:JOINT:amplitude=...,harmonic=...``, without what has a default, unless everything has one."""
    stated = [p for p in kind.stated() if isnan(p.value)] or list(kind.stated())
    values = ",".join(f"{parameter.name}=..." for parameter in stated)
    return f"{kind.name}:{'JOINT:' if kind.of_joint else ''}{values}"


def _describe_parameters(kind: type[Cause]) -> str:
    """Return every parameter with its bounds, unit and default."""
    return "; ".join(_describe_parameter(parameter) for parameter in kind.stated())


def _describe_parameter(parameter: Parameter) -> str:
    """``phase, -6.28 to 6.28 rad (0 if not given)``."""
    default = "" if isnan(parameter.value) else f" ({parameter.value:g} if not given)"
    return f"{parameter.name}, {format_bounds(parameter)}{default}"
