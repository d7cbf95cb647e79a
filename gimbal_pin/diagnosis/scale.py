"""At its limit a drive's torque is ``±limit``, whatever was commanded: times what is all that moves there?

Limit, inertia, friction and what else acts at that joint, all of them times one factor, leave the motion as it is. Only
the rest of the time, in which a command passes as it is, tells that factor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import hypot
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.finding import Finding
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects.signal import Signal
from gimbal_pin.parameter import Parameter

MOSTLY = 0.5
"""Share of the time at a limit from which the rest is the smaller part of a log."""
IN_PROPORTION = ("N m", "kg m^2")
"""How units of what is in proportion to that factor begin."""


class Limited(NamedTuple):
    """A drive that is at its limit most of the time.

    Attributes:
        finding: The limit.
        share: Share of the time at it.
    """

    finding: Finding
    share: float

    @property
    def off(self) -> float:
        """Standard deviation of the factor: the limit's, as a share of it."""
        limit = self.finding.parameters[0]
        return limit.std / limit.value

    @property
    def note(self) -> str:
        """What that leaves open."""
        told = f"to ± {100 * self.off:.2g} %" if self.off == self.off else "not at all closely"
        return (
            f"{self.finding.joint}: for {100 * self.share:.0f} % of the time the drive is at its limit, where limit, "
            "inertia, friction and all other torques of the joint may be larger or smaller by one common factor: only "
            f"the rest of the time tells it, {told}"
        )


def limited(state: State, findings: Sequence[Finding]) -> Iterator[Limited]:
    """Yield the findings that are a limit at which a drive is most of the time that counts."""
    evidence = state.problem.evidence
    for cause in state.causes:
        own = [one for one in findings if (one.cause, one.joint) == (cause.name, cause.place)]
        if not own or not isinstance(cause, Signal) or not np.isfinite(cause.largest):
            continue
        j = evidence.rig.joint_index(cause.place)
        open_ = np.concatenate([part.gate[:, j] for part in evidence.parts])
        at = np.concatenate([cause.biting(part.channels.tau[:, j]) for part in evidence.parts])
        share = float(open_ @ at / max(float(open_.sum()), 1e-300))
        if share > MOSTLY:
            yield Limited(own[0], share)


def scaled(finding: Finding, limits: Sequence[Limited]) -> Finding:
    """``std² + (value off)²`` for what is in proportion to the factor that a limit at the same joint leaves open."""
    off = next((one.off for one in limits if one.finding.joint == finding.joint and one.finding is not finding), 0.0)
    return replace(finding, parameters=tuple(looser(p, off) for p in finding.parameters)) if off > 0 else finding


def looser(figure: Parameter, off: float) -> Parameter:
    """A figure with the deviation of a factor that it is in proportion to, as a share."""
    proportional = figure.unit.startswith(IN_PROPORTION)
    return replace(figure, std=hypot(figure.std, off * figure.value)) if proportional else figure
