"""Causes that were planted in a plant, beside those that its controllers know."""

from __future__ import annotations

from collections.abc import Sequence

from gimbal_pin.diagnosis.finding import Finding
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import UsageError


def cause_of(text: str, model: Model) -> Cause:
    """Return the cause that is written as ``CAUSE:JOINT:NAME=VALUE,…``."""
    planted = parse_effect(text, model.rig)
    return planted.effect if isinstance(planted, Term) else planted


def there(known: Model) -> set[tuple[str, str]]:
    """Return name and place of every cause in a model."""
    every = (*known.drive, *known.changes, *(term.effect for term in known.terms))
    return {(cause.name, cause.place) for cause in every}


def planted_once(known: Model, causes: Sequence[str]) -> None:
    """Raise `UsageError` for a cause to be planted in a plant that has it, as the log that it is drawn from shows."""
    for text in causes:
        cause = cause_of(text, known)
        if (cause.name, cause.place) in there(known):
            what = "is in the plant already: it was found in the log that the plant is drawn from"
            raise UsageError(f"--effect {text}", what, "leave it out; plant only what that log does not show")


def missed(
    known: Model, causes: Sequence[str], sought: bool, findings: Sequence[Finding], recorded: bool = False
) -> tuple[str, ...]:
    """Return sentences about planted causes that a model does not have; what bodies take up, every fit finds.

    Args:
        known: The model that the controllers know.
        causes: What was planted, as text.
        sought: Whether `diagnose` looked for causes.
        findings: What it found.
        recorded: Whether that log was given, so that it need not be of the plant.
    """
    lost = [cause for cause in (cause_of(text, known) for text in causes) if not cause.of_given_model]
    return tuple(
        told(cause, sought, findings, recorded) for cause in lost if (cause.name, cause.place) not in there(known)
    )


def told(cause: Cause, sought: bool, findings: Sequence[Finding], recorded: bool) -> str:
    """Say that a planted cause is not known, and what stands in its stead."""
    if not sought:
        within = ", if the log was recorded with it" * recorded
        return f"{cause.place}: {cause.name} was planted, and nobody looked for it (--find does{within})"
    stead = [one.cause for one in findings if cause.name in one.alike and one.joint in (cause.place, None)]
    said = f"{cause.place}: {cause.name} was planted, and diagnose did not find it in the log"
    if stead:
        return f"{said}; it told {stead[0]}, which this log cannot tell from it"
    return said + ", which shows it only if it was recorded with it" * recorded
