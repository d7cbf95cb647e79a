"""Findings side by side: those of one cause are one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gimbal_pin.diagnosis.finding import Finding


def combined(found: Sequence[Finding]) -> list[Finding]:
    """Merge findings of one cause of the whole rig, each about another of its figures: the stronger speaks for both."""
    out: list[Finding] = []
    for one in sorted(found, key=lambda f: -f.explained_share):
        twin = next((f for f in out if f.joint is None and (f.cause, f.joint) == (one.cause, one.joint)), None)
        if twin is None:
            out.append(one)
            continue
        known = {p.name: p for p in one.parameters if p.std == p.std}
        figures = tuple(known.get(p.name, p) for p in twin.parameters)
        out[out.index(twin)] = replace(twin, parameters=figures)
    return out


def once(found: Sequence[Finding]) -> tuple[list[Finding], list[tuple[Finding, Finding]]]:
    """Findings, and those of them taken out, each with a stronger one at its joint that cannot be told from its cause.

    What a form that the library lacks leaves over is taken up by its nearest look-alike: one cause, found twice. Which
    of the two the cause is may not be the one that took more of it: the finding that is told holds both.
    """
    kept: list[Finding] = []
    twice: list[tuple[Finding, Finding]] = []
    for one in sorted(found, key=lambda f: -f.explained_share):
        other = next((f for f in kept if f.joint is not None and f.joint == one.joint and alike(one, f)), None)
        if other is None:
            kept.append(one)
        else:
            kept[kept.index(other)] = replace(other, alike=tuple(dict.fromkeys((*other.alike, one.cause))))
            twice.append((one, other))
    return kept, twice


def alike(less: Finding, more: Finding) -> bool:
    """Whether a finding may be a stronger one's cause, or whatever that may be, if it has no one name, this one's."""
    return less.cause in more.alike or (len(more.alike) > 1 and set(more.alike) <= set(less.alike))


def doubled(less: Finding, more: Finding) -> str:
    """Say that a cause may be a part of what a stronger one stands for."""
    return f"{less.joint}: {less.cause} beside {more.cause} may be the same thing: these logs hardly part the two"
