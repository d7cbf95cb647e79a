"""Logs in, what the simulation gets wrong out (DIAGNOSIS)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.audit import audit
from gimbal_pin.calibration import rectified
from gimbal_pin.diagnosis.agreement import agreement, alone, outright
from gimbal_pin.diagnosis.beyond import surprising
from gimbal_pin.diagnosis.confirmed import confirmed
from gimbal_pin.diagnosis.evidence import Evidence, gather, judged
from gimbal_pin.diagnosis.finding import Diagnosis
from gimbal_pin.diagnosis.off_centre import off_centre
from gimbal_pin.diagnosis.platform_motion import ridden
from gimbal_pin.diagnosis.reported import alignment, beside, reported, spoilt, with_motion
from gimbal_pin.diagnosis.searched import searched
from gimbal_pin.diagnosis.state import Problem, solved
from gimbal_pin.diagnosis.swung import swung
from gimbal_pin.diagnosis.timing import timing, wanders
from gimbal_pin.diagnosis.trusted import compared
from gimbal_pin.diagnosis.turns import opened, reopened
from gimbal_pin.effects import CAUSES, Cause
from gimbal_pin.errors import DataError
from gimbal_pin.identification import moved, split, within
from gimbal_pin.log import Log
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Filtering, chosen
from gimbal_pin.threads import one_thread
from gimbal_pin.wiring import check_columns

BAND = Filtering(cutoff=12.0, smoothing=2.5)
"""Wider than identification's filter: drives and teeth show above 5 Hz, and whitening makes up for the noise there."""
LIVELY = 1e-3
"""Least share of a joint's samples that must be away from standstill."""
MOVED = 0.02
"""Least travel of a joint that can be judged, rad."""


@one_thread()
def diagnose(
    rig: Rig,
    logs: Sequence[Log],
    causes: Mapping[str, type[Cause]] = CAUSES,
    *,
    rng: np.random.Generator,
    holdout: str | None = None,
    filtering: Filtering = BAND,
) -> Diagnosis:
    """Say what the refitted rigid model with Coulomb and viscous friction gets wrong, and why.

    Of a long log some stretches are looked at, see `rows.chosen`; a note says which.

    Args and errors: as `examined`.
    """
    shown = [chosen(log) for log in logs]
    found = examined(rig, [one.log for one in shown], causes, rng, holdout, filtering)
    return replace(found, notes=(*(one.note for one in shown if one.note), *found.notes))


def examined(
    rig: Rig,
    logs: Sequence[Log],
    causes: Mapping[str, type[Cause]],
    rng: np.random.Generator,
    holdout: str | None,
    filtering: Filtering,
) -> Diagnosis:
    """Diagnose logs of some minutes at most.

    Everything is chosen and fitted on the training part; the held-out part is touched once, for the gain.

    Args:
        rig: The rig.
        logs: Its logs.
        causes: The causes to look for.
        rng: For the signs of blocks and their bootstraps.
        holdout: As in `identify`.
        filtering: The band; its cutoff is the highest frequency looked at.

    Raises:
        DataError: The logs are too short, or a joint never moved.
    """
    for log in logs:
        within(log, filtering)
    calibrated = [rectified(rig, log) for log in logs]
    encoders = {one.log.name: one.encoders for one in calibrated}
    audits = [audit(rig, one.log) for one in calibrated]
    train, test, _ = split([found.log for found in audits], holdout, filtering)
    fitted = {log.name for log in train}
    audits = [found if found.log.name in fitted else found.spared for found in audits]
    if any(not found.reliable for found in audits):
        return spoilt(rig, logs, audits, filtering)
    origins = {log.name: float(log.t[0]) for log in logs}
    evidence = gather(rig, train, filtering, origins)
    check_moved(evidence, train[0].name)
    base = moved(rig, train)
    check_columns(rig, train, base, Filtering())
    held = judged(rig, test, filtering, origins, {one.log.name: one.log for one in audits}) if test else evidence
    if np.all(held.used() < LIVELY):
        raise DataError(
            test[0].name, "no joint moves where the gain is to be judged", "give another --holdout", rig.joints
        )
    each = alone(rig, [one.log for one in audits], filtering)
    apart = outright(rig, each)
    if apart is None:
        problem = Problem.of(evidence, reduce(rig, base=base))
        gliding = solved(problem, ())
        evidence, held = (opened(one, gliding, filtering) for one in (evidence, held))
        found = searched(reopened(problem, evidence), causes, rng)
        apart = agreement(rig, each, found.final.causes) or swung(rig, train, found, filtering.cutoff)
    if apart is not None:
        return spoilt(rig, logs, [replace(audits[0], faults=(apart, *audits[0].faults)), *audits[1:]], filtering)
    found = confirmed(found, held, rng)
    if test:
        found = found._replace(residual=surprising(found.residual, found.final, held))
    said = reported(found, held, audits, alignment(logs[0], filtering), rng)
    said = replace(said, notes=(*said.notes, *unjudged(held)))
    moving = ridden(found.final, held, train, test, filtering)
    said = said if moving is None else with_motion(said, moving)
    delays = [c for c in found.shelf.causes if wanders(c)]
    # What the audit says of the samples themselves, though it does no harm here, shows most in what is fast.
    sound = not any(one.faults or one.notes for one in audits)
    quiet = [joint for joint, one in said.residual.items() if one.state == "noise" and sound]
    said = replace(said, timing=timing(found.final, train, filtering, origins, delays, found.limit, quiet, rng))
    return compared(beside(said, off_centre(found.final, held, train, test, filtering, encoders)), found.final, causes)


def unjudged(held: Evidence) -> list[str]:
    """Say of which joints the held-out part shows nothing, so that no error there is one."""
    dumb = [joint for joint, used in zip(held.rig.joints, held.used()) if used < LIVELY]
    what = "in the held-out part hardly a sample tells its direction: its errors before and after say nothing"
    return [f"{', '.join(dumb)}: {what}, and nothing of it is confirmed; give another --holdout"] if dumb else []


def check_moved(evidence: Evidence, name: str) -> None:
    """Raise `DataError` if a joint never moved."""
    joints = evidence.rig.joints
    still = tuple(joint for joint, seen in zip(joints, evidence.seen) if seen.travel < MOVED)
    if still:
        raise DataError(name, "its motion shows nothing of", "move every joint: see 'gimbal-pin excite'", still)
    dumb = tuple(joint for joint, used in zip(joints, evidence.used()) if used < LIVELY)
    if dumb:
        what = "so slow, or turning round so often, that hardly a sample tells its direction"
        raise DataError(name, what, "move faster; of a loop that swings, lower its gains", dumb)
