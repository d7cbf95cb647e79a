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

RUNAWAY = 200.0
LOST_ANGLE = 3.0
"""Angle beyond a joint's limits, rad, at which the loop has lost the joint: no hard stop gives way so far."""
TOLERANCE = 1e-13
ROUNDS = 200


class PlantDivergedError(RuntimeError):
    """The closed loop ran away: the effect is too strong for this controller."""


@dataclass(frozen=True)
class Trace:
    """A run: per sample (N, n) the true q v at the encoder, what the controller measured, its held command; per step
    (N · substeps, n) the mid-step q, v, a on the encoder's side, v at the step's end, and dry friction with that
    of bristles."""

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


def dry_friction(free, inverse, dofs, plus, minus, dt, friction):
    """f in [-minus, plus] with f = plus where v⁺ > 0, f = -minus where v⁺ < 0, and v⁺ = 0 wherever f lies between.

    v⁺ = free - dt M⁻¹ f. Projected Gauss–Seidel over the joints (Moreau, time-stepping). `free`, `inverse` (M⁻¹) and
    `friction` (the last step's, which is changed and returned; zero where there is none) run over all degrees of
    freedom; the limits plus and minus (N m) over the joints, which sit on `dofs`."""
    for _ in range(ROUNDS):
        change = 0.0
        for i, dof in enumerate(dofs):
            weights = inverse[dof]
            held = friction[dof]
            wanted = held + (free[dof] / dt - sum(map(mul, weights, friction))) / weights[dof]
            if wanted > plus[i]:
                wanted = plus[i]
            elif wanted < -minus[i]:
                wanted = -minus[i]
            friction[dof] = wanted
            change += abs(wanted - held)
        if change < TOLERANCE:
            break
    return friction


class Stepper:
    """The state of every degree of freedom, which one step under a held command advances.

    Laws read the middle of the step: time `t`, `q`, `v`, where asked for the torque of `gravity`, and the `command`.
    They write the motors' torque `u`, the `force` on each degree of freedom, and the limits `plus` and `minus` of dry
    friction; what friction they put into `force` themselves they state in `bristle`. `end_q` and `end_v` are the step's
    end, `a` its acceleration, `dry` its friction. All are lists of floats, for speed."""

    def __init__(self, world, q, v):
        self.world = world
        self.dt = world.dt
        self.time = 0.0
        self.end_q, self.end_v, self.a, self.dry, self.gravity = (
            [0.0] * world.dofs for _ in range(5)
        )
        for dofs in (world.dof, world.link_dof):
            for dof, angle, speed in zip(dofs, q, v):
                self.end_q[dof] = angle
                self.end_v[dof] = speed
        self.bristle = [0.0] * world.joints
        self.coulomb = world.rig.coulomb.tolist()
        self.viscous = world.rig.viscous.tolist()
        self.drives, self.forces, self.grips = map(world.laws, ("drive", "force", "grip"))
        self._bias = np.zeros(world.dofs)
        self._inverse = np.zeros((world.dofs, world.dofs))
        self._eye = np.eye(world.dofs)

    def _bias_at(self, v):
        """Gravity, Coriolis and centrifugal forces at these speeds, from MuJoCo."""
        model = self.world.model
        data = self.world.data
        data.qvel[:] = v
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, self._bias)
        return self._bias.tolist()

    def _dynamics(self):
        """M⁻¹ and h at the middle of the step, from MuJoCo."""
        model = self.world.model
        data = self.world.data
        data.qpos[:] = self.q
        mujoco.mj_fwdPosition(model, data)
        if self.world.needs_gravity:
            self.gravity = self._bias_at(0.0)
        bias = self._bias_at(self.v)
        mujoco.mj_solveM(model, data, self._inverse, self._eye)
        return self._inverse.tolist(), bias

    def _apply(self, command):
        """Set motor, viscous and every other smooth force, and the limits of dry friction."""
        self.command = command
        self.u = list(command)
        for law in self.drives:
            law(self)
        self.force = [0.0] * self.world.dofs
        for dof, u, viscous in zip(self.world.dof, self.u, self.viscous):
            self.force[dof] += u - viscous * self.v[dof]
        for law in self.forces:
            law(self)
        self.plus = list(self.coulomb)
        self.minus = list(self.coulomb)
        for law in self.grips:
            law(self)

    def step(self, command):
        """Advance by dt."""
        if self.world.base_path is not None:
            self._follow_base()
        dofs = self.world.dof
        dt = self.dt
        half = 0.5 * dt
        v = self.end_v
        self.t = self.time + half
        middle = self.q = [x + half * y for x, y in zip(self.end_q, v)]
        self.v = [x + half * y for x, y in zip(v, self.a)]
        inverse, bias = self._dynamics()
        self._apply(command)
        net = [x - y for x, y in zip(self.force, bias)]
        free = [x + dt * sum(map(mul, row, net)) for x, row in zip(v, inverse)]
        dry = dry_friction(free, inverse, dofs, self.plus, self.minus, dt, self.dry)
        ends = [x - dt * sum(map(mul, row, dry)) for x, row in zip(free, inverse)]
        for dof, plus, minus in zip(dofs, self.plus, self.minus):
            if -minus < dry[dof] < plus:
                ends[dof] = 0.0
        self.a = [(x - y) / dt for x, y in zip(ends, v)]
        self.end_q = [x + half * y for x, y in zip(middle, ends)]
        self.end_v = ends
        self.time += dt

    def _follow_base(self):
        """Put a driven base exactly where its path says."""
        path = self.world.base_path(self.time)
        for mine, given in zip((self.end_q, self.end_v, self.a), path):
            for dof, value in zip(self.world.base_dofs, given):
                mine[dof] = value


def simulate(world, controller, start, samples, substeps):
    """Run `samples` samples of `substeps` steps each; the command of a sample is held until the next;
    `controller`: (sample, true q and v of the encoders' side) → (measured q and v, torque command).

    Raises: PlantDivergedError when a joint's speed runs away, or a joint lies far beyond its limits."""
    stepper = Stepper(world, *start)
    dofs = world.dof
    ranges = [
        (-np.inf, np.inf) if x.continuous else (x.lower - LOST_ANGLE, x.upper + LOST_ANGLE)
        for x in world.rig.links
    ]
    rows = array("d")  # which the garbage collector need not look at
    steps = array("d")
    for k in range(samples):
        q = [stepper.end_q[d] for d in dofs]
        v = [stepper.end_v[d] for d in dofs]
        measured_q, measured_v, command = controller(k, q, v)
        rows.extend([*q, *v, *measured_q, *measured_v, *command])
        for _ in range(substeps):
            stepper.step(command)
            for values in (stepper.q, stepper.v, stepper.a, stepper.end_v):
                steps.extend([values[d] for d in dofs])
            steps.extend([stepper.dry[d] + x for d, x in zip(dofs, stepper.bristle)])
        if not all(abs(x) < RUNAWAY for x in stepper.end_v):  # also where one is not a number
            raise PlantDivergedError(f"the loop ran away after {stepper.time:.3f} s")
        if not all(low < stepper.end_q[d] < high for d, (low, high) in zip(dofs, ranges)):
            raise PlantDivergedError(f"the loop lost a joint after {stepper.time:.3f} s")
    t = np.arange(samples) * world.dt * substeps
    return Trace(t, *_columns(rows, 5, world.joints), *_columns(steps, 5, world.joints))


def _columns(values, channels, width):
    """One array (N, width) for each channel of a flat tape."""
    return np.ascontiguousarray(np.array(values).reshape(-1, channels, width).transpose(1, 0, 2))
