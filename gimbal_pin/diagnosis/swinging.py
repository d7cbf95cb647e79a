"""What a joint bears whose link swings on a spring: its model fitted with the spring in it, not as if it were rigid.

A resonance takes the rigid model's parameters far from what they are, and a spring built from those explains little.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.effects.signal import Signal
from gimbal_pin.log.log import Array


def swinging(
    evidence: Evidence, spring: Signal, loads: Sequence[Array], own: Sequence[Array], beside: Array, torque: Array
) -> tuple[Array, Array]:
    """``argmin ‖torque - felt(load, inertial) β - beside φ - ringing c‖``: β, (b,), and φ, (f,).

    Args:
        evidence: The logs.
        spring: The spring.
        loads: Base columns of the joint's torque while it does not accelerate, (m, b) per part.
        own: Those of its own acceleration, (m, b) per part.
        beside: Whitened columns of what stands before the spring, (rows, f).
        torque: Whitened torque of the joint, (rows,).
    """
    j, b, f = evidence.rig.joint_index(spring.joint), loads[0].shape[1], beside.shape[1]
    felt = [spring.felt(load, inertial, part.dt) for part, load, inertial in zip(evidence.parts, loads, own)]
    swings = [spring.swings(part.dt, len(load)) for part, load in zip(evidence.parts, loads)]
    # Every part begins with a swing of its own.
    begun = [np.hstack([x if k == i else 0 * x for i in range(len(swings))]) for k, x in enumerate(swings)]
    columns = np.hstack([evidence.whiten(felt, j), beside, evidence.whiten(begun, j)])
    found = np.linalg.lstsq(columns, torque, rcond=1e-10)[0]
    return found[:b], found[b : b + f]
