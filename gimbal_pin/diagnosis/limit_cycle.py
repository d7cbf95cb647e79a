"""A loop that swings between its drive's limits, faster than anything that is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np
from scipy.signal import periodogram

from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis.engine import Explained
from gimbal_pin.effects import Signal
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log.limited import MOSTLY, compute_share_near_limit
from gimbal_pin.log.log import Log
from gimbal_pin.rig.rig import Rig

BEYOND = 0.5
"""Share of the torque's power beyond the band from which most of what a log holds is not looked at."""


def find_limit_cycle(rig: Rig, logs: Sequence[Log], found: Explained, cutoff: float) -> Fault | None:
    """A loop that swings so in one of the logs, and of whose joint something else is told than the limit itself.

    Of a joint at which a structure is left, and no more told, nothing is claimed that the swing could have made.
    """
    for fault in (detect_limit_cycle(rig, log, cutoff) for log in logs):
        if fault is not None:
            own = [cause for cause in found.final.causes if cause.of_joint and cause.place == fault.joint]
            limits = [cause for cause in own if isinstance(cause, Signal) and isfinite(cause.largest)]
            noise = not found.structured[rig.joints.index(str(fault.joint))]
            if not limits and (own or noise):
                return fault
    return None


def detect_limit_cycle(rig: Rig, log: Log, cutoff: float) -> Fault | None:
    """``|tau| = limit`` most of the time, and ``∫_{f > cutoff} |T(f)|² df`` most of its power: a relay that swings.

    The torque that the motion asks for is then what few moments between the limits differ by, and what such a swing
    leaves within the band looks like a spring, a delay or less inertia. At its limit by a slow motion, a drive that is
    too weak says what it is.
    """
    if log.tau is None:
        return None
    shares = compute_share_near_limit(log.tau, rig.tau_max)
    frequencies, powers = periodogram(log.tau, 1 / log.dt, "hann", axis=0)
    beyond = np.sum(powers[frequencies > cutoff], axis=0) / np.maximum(np.sum(powers, axis=0), 1e-300)
    swings = (shares > MOSTLY) & (beyond > BEYOND)
    if not swings.any():
        return None
    j = int(np.argmax(np.where(swings, shares, 0.0)))
    share, rate = float(shares[j]), float(frequencies[np.argmax(powers[:, j])])
    figures = (Parameter("share", share, "1"), Parameter("frequency", rate, "Hz"))
    sentence = (
        f"{rig.joints[j]}: the drive is at its limit of {rig.tau_max[j]:.3g} N m for {digits(100 * share, 2)} % of the "
        f"time, to and fro at {digits(rate, 2)} Hz, beyond the {digits(cutoff, 2)} Hz that are looked at: the loop "
        "swings, and such a log shows little but that limit"
    )
    mend = "record one that the loop holds, of lower gains or less delay"
    return Fault("stuck-channel", rig.joints[j], sentence, figures, share / MOSTLY, True, mend).in_units(rig)
