"""The compiled plant: MuJoCo's model, which degree of freedom is whose, and the laws of its effects."""

import mujoco
import numpy as np

from .mjcf import BASE_DOFS, Base, build
from .rigs import Inertia


class World:
    """A rig with its hidden effects, ready to be stepped.

    `dof[i]` is the degree of freedom on which joint i's motor, bearing and encoder sit; `link_dof[i]` moves the link
    (the same, unless something between them gives); `base_dofs` are x y z yaw pitch roll of a base that moves.
    `offset[i]` is added to the encoder's reading, and `eccentric` (amplitude, phase) once per turn."""

    def __init__(self, rig, effects, dt, seconds):
        self.dt = dt
        self.seconds = seconds
        self.nominal = rig
        self.effects = sorted(effects, key=lambda effect: effect.stage)
        for effect in self.effects:
            rig = effect.plant(rig)
        self.rig = rig
        hangers = [item for effect in self.effects for item in effect.appendages(rig)]
        base = next((e.base for e in self.effects if e.base is not Base.FIXED), Base.FIXED)
        self.model = build(rig, hangers, base, _base_inertia(rig))
        self.data = mujoco.MjData(self.model)
        self.joints = len(rig.links)
        self.dofs = int(self.model.nv)
        self.link_dof = [self.named(joint) for joint in rig.joints]
        self.dof = list(self.link_dof)
        self.offset = [0.0] * self.joints
        self.eccentric = [(0.0, 0.0)] * self.joints
        self.base_dofs = [] if base is Base.FIXED else [self.named(name) for name in BASE_DOFS]
        self.base_path = None
        self.needs_gravity = False
        for effect in self.effects:
            effect.prepare(self)

    def named(self, name):
        """The degree of freedom of this name."""
        return int(self.model.joint(name).dofadr[0])

    @property
    def reference(self):
        """The rigid rig that a perfect refit would find."""
        rig = self.nominal
        for effect in self.effects:
            rig = effect.frozen(rig)
        return rig

    def laws(self, kind):
        """The laws of one kind ("drive", "force", "grip"), in order."""
        found = (getattr(effect, kind)(self) for effect in self.effects)
        return [law for law in found if law is not None]

    def encoder(self, q):
        """What the encoders show of true angles q (..., n), rad."""
        amplitude, phase = np.array(self.eccentric).T
        return q + np.array(self.offset) + amplitude * np.sin(q + phase)


def _base_inertia(rig):
    """A head about as heavy as what it carries."""
    mass = sum(body.mass for body in rig.bodies)
    size = 0.15 * (mass / 4.0) ** (1.0 / 3.0)
    return Inertia(mass, np.zeros(3), mass * size**2 / 6.0 * np.eye(3))
