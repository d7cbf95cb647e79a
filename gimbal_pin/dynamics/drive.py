"""The drives of a rig: commands in, acting torques out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.dynamics.model import Model, is_motor_friction
from gimbal_pin.dynamics.plant import State
from gimbal_pin.dynamics.regressor import compute_coupling, compute_inertia_column
from gimbal_pin.effects import Sample, Signal
from gimbal_pin.effects.signal import JointLoad
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig


class Drive:
    """The drives of all joints: commands in, acting torques out, with the memory of the signals in between."""

    def __init__(
        self, signals: Sequence[Signal], rig: Rig, dt: float, plant: Model | None = None
    ) -> None:
        """Start every signal at rest; `plant`: whose friction stands before a gap, None: nobody's."""
        self.dt, self.plant = dt, plant
        self.chain = [(rig.joint_index(signal.joint), signal) for signal in signals]
        self.memory = [signal.start() for signal in signals]

    def acting(self, command: Array, state: State | None = None) -> Array:
        """Return the mean torque that acts over the next interval, N m, (n,), from a state of the plant."""
        if not self.chain:
            return command
        out = np.array(command, dtype=float)
        for i, (j, signal) in enumerate(self.chain):
            given = float(out[j])
            load = None
            if signal.geared and self.plant is not None and state is not None:
                load = compute_joint_load(
                    self.plant, j, state, given, signal.leaning(self.memory[i])
                )
            beside = 0.0 if load is None else float(signal.beside(load))
            self.memory[i], passed = signal.step(self.memory[i], given + beside, self.dt)
            out -= signal.spread(given + beside - passed, j, len(out), load)
        return out


def compute_joint_load(
    plant: Model, joint: int, state: State, torque: float, leaning: float | None = None
) -> JointLoad:
    """What a joint bears in a state of the plant; at rest its dry friction takes what it can of the torque.

    `leaning`: what the torque holds at rest, N m; None: what the link asks for.
    """
    q = float(state.q[joint])
    rate = float(state.v[joint])
    push = compute_coupling(
        compute_inertia_column(plant.rig, state.q[None], joint)[0], joint, plant.armature[joint]
    )
    terms = [term for term in plant.by_joint[joint] if is_motor_friction(term.effect)]
    asked = float(plant.inverse_dynamics(state.q, state.v, 0.0 * state.v)[joint])
    slides = [
        float(sum(t.torque(Sample(0.0, q, rate, 0.0, way, 0.0)) for t in terms))
        for way in (-1.0, 1.0)
    ]
    if rate:
        brake = slides[rate > 0]
        return JointLoad(brake, asked - brake, across=push)
    held = asked if leaning is None else leaning
    return JointLoad(min(max(torque - held, slides[0]), slides[1]), asked, across=push)
