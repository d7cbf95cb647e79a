"""The simulation loop: Moreau's midpoint rule on MuJoCo's M(q) and h(q, v), second order, with true stick.

q_m = q + dt/2 v,   M(q_m) (v⁺ - v)/dt + h(q_m, v_m) + f_dry = u + forces,   q⁺ = q_m + dt/2 v⁺
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from operator import mul

import mujoco
import numpy as np

from .rigs import Array
from .stick import dry_friction
from .world import State

RUNAWAY = 200.0


class PlantDivergedError(RuntimeError):
    """The closed loop ran away: the effect is too strong for this controller."""


@dataclass(frozen=True)
class Trace:
    """A run: per sample (N, n) the true q v at the encoder, what the controller measured, its held command; per step
    (N · substeps, n) the mid-step q, v, a on the encoder's side, v at the step's end, dry friction and that of
    bristles."""

    t: Array
    q: Array
    v: Array
    measured_q: Array
    measured_v: Array
    command: Array
    step_q: Array
    step_v: Array
    step_a: Array
    step_end_v: Array
    step_dry: Array
    step_bristle: Array


class Stepper:
    """Owns the state of every degree of freedom and advances it by one step under a held command."""

    def __init__(self, world, q, v):
        self.world, self.model, self.data = world, world.model, world.data
        self.state = State(world.dt, world.joints, world.dofs)
        self.time = 0.0
        self.q = [0.0] * world.dofs
        self.v = [0.0] * world.dofs
        self.a = [0.0] * world.dofs
        for i in range(world.joints):
            for dof in (world.dof[i], world.link_dof[i]):
                self.q[dof], self.v[dof] = q[i], v[i]
        self.dry = [0.0] * world.dofs
        self.each = tuple(range(world.dofs))
        self.coulomb = [float(x) for x in world.rig.coulomb]
        self.viscous = [float(x) for x in world.rig.viscous]
        self.drives, self.forces, self.grips = (
            world.laws(kind) for kind in ("drive", "force", "grip")
        )
        self._qpos = world.data.qpos
        self._qvel = world.data.qvel
        self._bias = np.zeros(world.dofs)
        self._held = np.zeros(world.dofs)
        self._inverse = np.zeros((world.dofs, world.dofs))
        self._eye = np.eye(world.dofs)

    def _dynamics(self):
        """M⁻¹ and h at the middle of the step, from MuJoCo."""
        state = self.state
        model = self.model
        data = self.data
        self._qpos[:] = state.q
        mujoco.mj_fwdPosition(model, data)
        if self.world.needs_gravity:
            self._qvel[:] = 0.0
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 0, self._held)
            state.gravity = self._held.tolist()
        self._qvel[:] = state.v
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, self._bias)
        mujoco.mj_solveM(model, data, self._inverse, self._eye)
        return self._inverse.tolist(), self._bias.tolist()

    def _applied(self, command):
        """Motor, viscous and every other smooth force, on each degree of freedom."""
        state = self.state
        dofs = self.world.dof
        state.command = command
        state.u = list(command)
        for law in self.drives:
            law(state)
        state.force = [0.0] * self.world.dofs
        for i, dof in enumerate(dofs):
            state.force[dof] += state.u[i] - self.viscous[i] * state.v[dof]
        for law in self.forces:
            law(state)
        state.plus = list(self.coulomb)
        state.minus = list(self.coulomb)
        for law in self.grips:
            law(state)
        return state.force

    def step(self, command):
        """Advance by dt; afterwards `state` holds the middle of the step, `q`, `v` its end, `a` its acceleration."""
        state = self.state
        dt = self.world.dt
        each = self.each
        q = self.q
        v = self.v
        a = self.a
        half = 0.5 * dt
        state.t = self.time + half
        middle = state.q = [q[i] + half * v[i] for i in each]
        state.v = [v[i] + half * a[i] for i in each]
        inverse, bias = self._dynamics()
        applied = self._applied(command)
        net = [applied[i] - bias[i] for i in each]
        free = [v[i] + dt * sum(map(mul, inverse[i], net)) for i in each]
        dry = dry_friction(free, inverse, self.world.dof, (state.plus, state.minus), dt, self.dry)
        ends = [free[i] - dt * sum(map(mul, inverse[i], dry)) for i in each]
        for j, dof in enumerate(self.world.dof):
            if -state.minus[j] < dry[dof] < state.plus[j]:
                ends[dof] = 0.0
        self.a = [(ends[i] - v[i]) / dt for i in each]
        self.q = [middle[i] + half * ends[i] for i in each]
        self.v = ends
        self.time += dt


def simulate(
    world,
    controller,
    start,
    samples,
    substeps,
):
    """Run `samples` samples of `substeps` steps each; the command of a sample is held until the next;
    `controller`: (sample, true q and v of the encoders' side) → (measured q and v, torque command).

    Raises: PlantDivergedError when a joint's speed runs away."""
    stepper = Stepper(world, *start)
    dofs = world.dof
    rows = array("d")  # which the garbage collector need not look at
    steps = array("d")
    for k in range(samples):
        q = [stepper.q[d] for d in dofs]
        v = [stepper.v[d] for d in dofs]
        measured_q, measured_v, command = controller(k, q, v)
        rows.extend([*q, *v, *measured_q, *measured_v, *command])
        for _ in range(substeps):
            if world.base_path is not None:
                _follow_base(world, stepper)
            stepper.step(command)
            channels = (stepper.state.q, stepper.state.v, stepper.a, stepper.v, stepper.dry)
            steps.extend(
                [*(values[d] for values in channels for d in dofs), *stepper.state.bristle]
            )
        if not all(abs(x) < RUNAWAY for x in stepper.v):  # also where a speed is not a number
            raise PlantDivergedError(
                f"speed {max(map(abs, stepper.v)):.3g} rad/s after {stepper.time:.3f} s"
            )
    t = np.arange(samples) * world.dt * substeps
    return Trace(t, *_columns(rows, 5, world.joints), *_columns(steps, 6, world.joints))


def _columns(values, channels, width):
    """One array (N, width) for each channel of a flat tape."""
    table = np.array(values).reshape(-1, channels, width)
    return [np.ascontiguousarray(table[:, i]) for i in range(channels)]


def _follow_base(world, stepper):
    """Put a driven base exactly where its path says."""
    for dof, q, v, a in zip(world.base_dofs, *world.base_path(stepper.time), strict=True):
        stepper.q[dof] = q
        stepper.v[dof] = v
        stepper.a[dof] = a
