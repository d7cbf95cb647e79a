"""Does a drive's time walk with the band? Then noise in the motion that its torque is compared with moves it.

A controller hands the noise of its rates on to the torque: what is measured of the motion and what is commanded then
err together, and the time that is fitted is off by more than chance. ``∫ω² df`` of that noise counts: a quarter of the
band holds a sixty-fourth of it, and says how far off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import hypot

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.shapes import shape_names
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.diagnosis.uncertainty import slopes
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter

SLOW = 0.25
"""Share of the band that is compared with the whole of it."""
SURE = 2.58
"""Standard deviations from which it is no chance, one in a hundred: as in Hausman's test of an estimator."""


def walked(state: State, cause: Cause, shown: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """``std² + walk²`` for the one time of a drive that passes all on later; other figures as they are."""
    if not (isinstance(cause, Signal) and cause.linear and not cause.springy and len(shape_names(cause)) == 1):
        return tuple(shown)
    joint, (name,) = state.problem.evidence.rig.joint_index(cause.place), shape_names(cause)
    far = walk(state, joint, slopes(state, without(state, cause), cause)[:, joint, 0])
    return tuple(replace(p, std=hypot(p.std, far)) if p.name == name else p for p in shown)


def walk(state: State, joint: int, slope: Array) -> float:
    """How far a drive's time lies from that of the slow part of the band, s; 0: by chance.

    Args:
        state: What was found.
        joint: Where the drive sits.
        slope: Whitened slope of the torque that it takes there by its time, (rows,).
    """
    evidence, fit, n = state.problem.evidence, state.fit, len(state.fit.scale)
    columns = np.column_stack([slope * fit.scale[joint], fit.stack[joint::n], fit.residual[joint::n]])
    there, whole = (influence(rows[:, :-1], rows[:, -1]) for rows in (slow(evidence, columns), columns))
    apart = np.add.reduceat(there - whole, fit.starts // n)
    far = abs(float(np.sum(apart)))
    return far if far > SURE * float(np.linalg.norm(apart)) else 0.0


def influence(A: Array, b: Array) -> Array:
    """What every row adds to the first coefficient of ``argmin ‖b - A x‖``, (rows,)."""
    rest = A[:, 0] - A[:, 1:] @ np.linalg.lstsq(A[:, 1:], A[:, 0], rcond=1e-8)[0]
    return np.asarray(rest * b / float(rest @ rest))


def slow(evidence: Evidence, rows: Array) -> Array:
    """Rows of one joint, (rows, k), without what is in the upper part of the band."""
    ends = np.cumsum([part.rows for part in evidence.parts])[:-1]
    return np.concatenate([low(part) for part in np.split(rows, ends)])


def low(rows: Array) -> Array:
    """Rows of one part without the upper part of their spectrum."""
    spectrum = fft.rfft(rows, axis=0)
    spectrum[round(SLOW * len(spectrum)) :] = 0.0
    return np.asarray(fft.irfft(spectrum, len(rows), axis=0))
