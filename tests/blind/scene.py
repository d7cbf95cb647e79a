"""One rig, one motion, one controller, one set of sensors: the stage on which effects are hidden and tried out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .control import Gains, closed_loop, draw_gains, feed_forward, joint_inertia
from .drive_sensors import DriveSensors
from .effects import Context
from .excitation import Reference, draw_reference
from .plant import simulate
from .rig_draw import nominal
from .rigs import Array, Rig
from .rnea import inverse_dynamics
from .sensors import Sensors
from .world import World

FINE_STEP, TRIAL_STEP, STIFF_TRIAL_STEP = 0.25e-3, 1e-3, 0.5e-3


@dataclass(frozen=True)
class Scene:
    """Everything but the effect. `rate`: the controller's samples a second; `noise_seed`: the sensors' noise, the same
    in every run; `still`: joints that are held; `step`: longest step of the final run, s."""

    rig: Rig
    reference: Reference
    gains: Gains
    forward: Array
    sensors: Sensors | DriveSensors
    rate: float
    noise_seed: int
    still: tuple[int, ...] = ()
    step: float = FINE_STEP

    @property
    def seconds(self):
        """Length of the run, s."""
        return len(self.reference.t) / self.rate

    def substeps(self, longest):
        """Steps in a sample, none longer than `longest` (s)."""
        return int(np.ceil(1.0 / (self.rate * longest) - 1e-9))

    def run(self, effects, substeps):
        """Simulate the closed loop with these effects."""
        world = World(self.rig, effects, 1.0 / (self.rate * substeps), self.seconds)
        samples = len(self.reference.t)
        seen = self.sensors.reader(world, samples, np.random.default_rng(self.noise_seed))
        controller = closed_loop(world, self.reference, self.gains, self.forward, seen)
        begin = self.reference.q[0].tolist(), self.reference.dq[0].tolist()
        return world, simulate(world, controller, begin, samples, substeps)

    def first(self, seconds):
        """The same scene, not longer than this (s): effects are made as strong as wanted on it."""
        return replace(self, reference=self.reference.first(round(seconds * self.rate)))

    def context(self, joint, share):
        """What an effect's first guess is made from, by the reference alone."""
        few = slice(None, None, 5)
        q = self.reference.q[few]
        dq = self.reference.dq[few]
        ddq = self.reference.ddq[few]
        tau = (
            inverse_dynamics(self.rig, q, dq, ddq)
            + self.rig.coulomb * np.tanh(dq / 0.01)
            + self.rig.viscous * dq
        )
        return Context(
            rig=self.rig,
            joint=joint,
            share=share,
            torque=float(np.sqrt(np.mean(tau[:, joint] ** 2))),
            inertia=float(joint_inertia(self.rig, q.mean(axis=0))[joint]),
            speed=float(np.sqrt(np.mean(dq[:, joint] ** 2))),
            lean=1.0 if tau[:, joint].mean() > 0.0 else -1.0,
            span=(float(q[:, joint].min()), float(q[:, joint].max())),
            seconds=self.seconds,
        )

    def gravity(self):
        """Gravity torque rms along the reference, N m, (n,)."""
        q = self.reference.q[::20]
        return np.sqrt(np.mean(inverse_dynamics(self.rig, q, 0.0 * q, 0.0 * q) ** 2, axis=0))


def draw_scene(streams, rig, sensors, plan):
    """A plan's scene by its random streams."""
    reference = draw_reference(streams["motion"], rig, plan.excitation, plan.seconds, plan.rate)
    gains = draw_gains(streams["control"], rig, reference)
    forward = feed_forward(nominal(streams["control"], rig, 0.15), reference, gains)
    seed = int(streams["noise"].integers(2**31))
    return Scene(rig, reference, gains, forward, sensors, plan.rate, seed)
