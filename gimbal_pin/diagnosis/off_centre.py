"""Encoders that sit off their joint's centre: what the rates say of them, against torques at the angles as read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.counterfactual import counterfactual
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.finding import Finding
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.estimation.rows import Filtering
from gimbal_pin.log.eccentricity import Eccentricity
from gimbal_pin.log.log import Log

NAME = "encoder-offset"
Encoders = Mapping[str, Mapping[str, Eccentricity]]
"""Log → joint → how far its encoder sits off the centre."""


def off_centre(
    found: State, held: Evidence, train: Sequence[Log], test: Sequence[Log], filtering: Filtering, encoders: Encoders
) -> list[Finding]:
    """Findings of the encoders whose angles were mended, each where the angles as read predict torques worse.

    Args:
        found: The fit to the mended angles, with all that was found.
        held: The reporting part at mended angles.
        train: The logs that were fitted, mended.
        test: The reporting ones; none where blocks of the fitted logs stand for them.
        filtering: The band.
        encoders: What was mended.
    """
    findings = []
    for joint in sorted({joint for one in encoders.values() for joint in one}):
        fitted, other = ([read(log, joint, encoders) for log in logs] for logs in (train, test))
        without = counterfactual(found, held, fitted, other, filtering, found.problem.reduction.base)
        if without is not None:
            off = max((one[joint] for one in encoders.values() if joint in one), key=lambda one: one.size)
            figures = (Parameter("eccentricity", off.size, "rad", std=off.std), Parameter("phase", off.phase, "rad"))
            said = f"{joint}: encoder-offset, the encoder sits off the joint's centre and reads up to "
            said += f"{np.degrees(off.size):.3g}° wrong once per turn, by the rates; mend its readings, or seat it anew"
            findings.append(without.finding(NAME, joint, without.before, figures, said))
    return findings


def read(log: Log, joint: str, encoders: Encoders) -> Log:
    """Return the log with a joint's angles as its encoder read them."""
    one = encoders.get(log.name, {}).get(joint)
    if one is None:
        return log
    q, j = np.array(log.q), log.joints.index(joint)
    q[:, j] += one.error(q[:, j])
    return replace(log, q=q)


def joined(findings: Sequence[Finding], more: Sequence[Finding]) -> list[Finding]:
    """Put eccentric encoders beside what was found: one whose zero is off, too, is one finding of both."""
    out = list(findings)
    for one in more:
        twin = next((f for f in out if (f.cause, f.joint) == (one.cause, one.joint)), None)
        if twin is None:
            out.append(one)
        else:
            figures, said = (*twin.parameters, *one.parameters), f"{twin.sentence}; {one.sentence}"
            out[out.index(twin)] = replace(twin, parameters=figures, sentence=said)
    return out
