"""Where nobody knows whether a threshold let a command pass: within the torque sensor's noise of its edge.

A loop whose command comes to the edge lingers there, one sample passed and the next not: the measured torque says of
these what chance does, and each of them is wrong by the whole width. How much of the rest a threshold explains tells
whether it is one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin import signals
from gimbal_pin.diagnosis.evidence import TAPER, Evidence, Part
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects.signal import Signal
from gimbal_pin.log import Array
from gimbal_pin.rows import mask

SURE = 3.0
"""Standard deviations of the torque's noise up to which a command may lie on either side of an edge."""
LINGERS = 0.25
"""Share of the smoother's memory spent there from which what has passed is unknown: who only crosses an edge is not."""
ENOUGH = 0.2
"""Share of the time that must be left to judge by."""


def decided(first: State, state: State, signal: Signal) -> tuple[float, float] | None:
    """Dispersions at a signal's joint before and after all that was found, where it is known what the signal passed.

    None where it has no edge, or where too little of the time is left.
    """
    evidence = state.problem.evidence
    clear, j = cleared(evidence, signal), evidence.rig.joint_index(signal.place)
    return None if clear is None else (dispersion(first, clear, j), dispersion(state, clear, j))


def cleared(evidence: Evidence, signal: Signal) -> Evidence | None:
    """The logs where it is known what a signal passed; None where it has no edge, or where too little is left."""
    if not signal.abrupt or any(part.logged is None for part in evidence.parts):
        return None
    j = evidence.rig.joint_index(signal.place)
    clear = replace(evidence, parts=tuple(away(part, signal, j, evidence.band) for part in evidence.parts))
    return None if clear.used()[j] < ENOUGH * evidence.used()[j] else clear


def dispersion(state: State, evidence: Evidence, joint: int) -> float:
    """Residual power over predicted noise power at one joint, behind other gates than those that it was fitted with."""
    left = evidence.whiten([x[:, joint] for x in state.unexplained], joint)
    return float(left @ left) / max(evidence.rows * float(evidence.used()[joint]), 1.0)


def away(part: Part, signal: Signal, joint: int, band: float) -> Part:
    """A part with a joint's gate shut where commands linger at a signal's edge."""
    assert part.logged is not None
    command = part.logged.tau[:, joint]
    noise = SURE * float(signals.noise_std(command[:, None])[0])
    lingers = part.logged.smoothed(signal.uncertain(command, noise).astype(float)) > LINGERS
    open_ = mask(lingers[:, None], round(TAPER / band / part.dt))[:, 0]
    gate: Array = part.gate.copy()
    gate[:, joint] *= open_
    return part._replace(gate=np.asfortranarray(gate))
