"""What cameras saw of one platform's motion: one bolted to it, and one per controller that held it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from gimbal_pin.control.controllers import BASELINE, OURS
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.result import Pointing, Verified, split

SHOWN_SECONDS, RATE = 6.0, 60.0
"""Length of the stretch that is shown, s, and its frames per second: a few hundred of them."""


@dataclass(frozen=True, eq=False)
class Shot:
    """What one camera saw.

    Attributes:
        controller: Who held it; None: it was bolted to the platform.
        turned: ``log(R_dᵀ R)`` at each frame, in the camera's frame, rad, (F, 3).
        shaken: The line of sight's part above 0.2 Hz about the camera's y and z, which is what jitter counts, rad,
            (F, 2).
        jitter: Of the whole run, rad rms.
    """

    controller: str | None
    turned: Array
    shaken: Array
    jitter: float


@dataclass(frozen=True, eq=False)
class Outlook:
    """Several cameras on the same stretch of the same motion.

    Attributes:
        t: Time of each frame, s, (F,).
        bolted: The camera that the platform carries along.
        held: Those that a gimbal holds, the PID before computed torque.
    """

    t: Array
    bolted: Shot
    held: tuple[Shot, ...]


def outlook(found: Verified, wanted: Array, seconds: float = SHOWN_SECONDS, rate: float = RATE) -> Outlook:
    """Return what the cameras of the first seed saw, where the platform swings most.

    Args:
        found: The runs.
        wanted: R_d, the attitude that the cameras should keep, (3, 3).
        seconds: Length of the stretch, s; a run may be shorter.
        rate: Frames per second, at most those of the run.
    """
    runs = [row.runs[0] for row in found.rows if row.controller in (BASELINE, OURS)]
    swing = swung(runs[0], wanted)
    first, last = liveliest(swing, round(seconds / runs[0].dt))
    rows = runs[0].counted.start + np.arange(first, last, max(1, round(1 / rate / runs[0].dt)))
    return Outlook(
        runs[0].t[rows],
        shot(runs[0], None, swing, rows),
        tuple(shot(run, run.controller, run.error[run.counted], rows) for run in runs),
    )


def swung(run: Pointing, wanted: Array) -> Array:
    """``log(R_dᵀ R_p R_d)``, rad, (M, 3), over the samples that count: the camera looks as wanted from level ground."""
    turns = wanted.T @ Rotation.from_quat(run.base[run.counted], scalar_first=True).as_matrix() @ wanted
    return np.array([pin.log3(turn) for turn in turns])


def liveliest(swing: Array, length: int) -> tuple[int, int]:
    """Return first and end of the `length` samples, or of all, in which the swing is largest, rms."""
    power = np.concatenate([[0.0], np.cumsum(np.sum(swing**2, axis=1))])
    length = min(length, len(swing))
    first = int(np.argmax(power[length:] - power[: len(power) - length]))
    return first, first + length


def shot(run: Pointing, controller: str | None, turned: Array, rows: Array) -> Shot:
    """Return one camera's frames out of its whole run.

    Args:
        run: The run.
        controller: Who held the camera.
        turned: ``log(R_dᵀ R)`` over the samples that count, rad, (M, 3).
        rows: The frames, as samples of the whole run.
    """
    fast, _ = split(turned[:, 1:], run.dt)
    places = rows - run.counted.start
    rms = float(np.sqrt(np.mean(np.sum(fast**2, axis=1))))
    return Shot(controller, turned[places], fast[places], rms)
