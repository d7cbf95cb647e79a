"""The plant that `simulate` integrates: forward dynamics with true stick, RK4, one step per control sample."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import copysign
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.effects.resistance import Memory, Resistance
from gimbal_pin.log import Array
from gimbal_pin.model import Model

Floats = Sequence[float]


class State(NamedTuple):
    """State of the plant.

    Attributes:
        q: Angles, rad, (n,).
        v: Rates, rad/s, (n,); a rate of exactly zero is a candidate for sticking.
        memory: What the terms with a memory remember; empty: as at rest.
    """

    q: Array
    v: Array
    memory: Memory = ()


class Contact(NamedTuple):
    """Dry friction's mode over one step.

    Attributes:
        slide: Direction of sliding per joint: -1, 0 (no dry friction, or stuck), 1.
        stuck: Joints that stick.
    """

    slide: tuple[float, ...]
    stuck: tuple[int, ...]


class Step(NamedTuple):
    """What stays the same through the stages of a step, as floats.

    Attributes:
        q: Angles at its start, rad: where the memory holds.
        v: Rates at its start, rad/s.
        memory: See `State`.
        tau: Motor torque, N m.
        contact: Mode of dry friction.
        left: Torque less the affine terms' fixed part, N m.
    """

    q: Floats
    v: Floats
    memory: Memory
    tau: Floats
    contact: Contact
    left: Floats


class Plant:
    """``a = D^-1 (tau - C v - G - F)`` (THESIS 3.71), with dry friction by the stick rule.

    A joint whose rate is zero sticks as long as the torque that holds it is within its total dry friction;
    otherwise it slides where that torque pushes it. A rate that changes sign within a step is brought to zero at
    the crossing, and the step goes on from there: no smooth sign, no chatter.
    """

    def __init__(self, model: Model) -> None:
        """Take the model's terms apart by joint; what they take per acceleration becomes the rotors' inertia."""
        self.model = model
        self.pin = model.rig.model.copy()
        self.pin.armature = self.pin.armature + model.armature
        self.data = self.pin.createData()
        # Friction of size zero does nothing: left in, it would stop its joint at every reversal and cost two orders.
        self.friction = Resistance([[term for term in terms if any(term.values)] for terms in model.by_joint])
        # Rows of one array: Pinocchio takes them as they are, and filling them is cheaper than making new ones.
        self.q, self.v, self.tau = np.zeros((3, model.rig.n))

    def step(self, t: float, state: State, tau: Array, dt: float) -> State:
        """Return the state after `dt` s under constant torque `tau`, N m; splits the step where a joint stops.

        A joint that stops twice within one step sticks for the rest of it.
        """
        q, v, u, memory = state.q.tolist(), state.v.tolist(), tau.tolist(), state.memory or self.friction.start
        stops: list[int] = []
        while dt > 1e-9:
            now = self.begin(t, q, v, memory, u, [j for j in stops if stops.count(j) > 1])
            q, v = self.rk4(t, now, dt)
            stop = self.first_stop(now, v)
            share = 1.0
            if stop is not None:
                joint, share = stop
                stops.append(joint)
                q, v = self.rk4(t, now, share * dt) if share > 0 else (list(now.q), list(now.v))
                v[joint] = 0.0
            memory = self.friction.evolved(memory, now.q, q) if memory else memory
            t, dt = t + share * dt, (1 - share) * dt
        return State(np.array(q), np.array(v), memory)

    def contact(self, t: float, state: State, tau: Array) -> Contact:
        """Decide which joints slide where, and which stick, under `tau`."""
        memory = state.memory or self.friction.start
        return self.begin(t, state.q.tolist(), state.v.tolist(), memory, tau.tolist()).contact

    def acceleration(self, t: float, state: State, tau: Array, contact: Contact) -> Array:
        """Accelerations, rad/s², (n,)."""
        memory, u = state.memory or self.friction.start, tau.tolist()
        left = self.friction.left(u, contact.slide)
        now = Step(state.q.tolist(), state.v.tolist(), memory, u, contact, left)
        return np.array(self.rates(t, now.q, now.v, now))

    def begin(self, t: float, q: Floats, v: Floats, memory: Memory, tau: Floats, held: Collection[int] = ()) -> Step:
        """Decide the contact at the start of a step; joints in `held` stick whatever holds them."""
        friction = self.friction
        slide = [0.0] * len(q)
        for j in friction.dry_joints:
            slide[j] = 1.0 if v[j] > 0 else -1.0 if v[j] < 0 else 0.0
        resting = [j for j in friction.dry_joints if slide[j] == 0.0]
        for _ in range(3 ** len(resting)):
            contact = Contact(tuple(slide), tuple([j for j in resting if slide[j] == 0.0]))
            now = Step(q, v, memory, tau, contact, friction.left(tau, slide))
            wrong = self.wrong(t, now, resting, held) if resting else None
            if wrong is None:
                break
            joint, way = wrong
            slide[joint] = way
        return now

    def wrong(self, t: float, now: Step, resting: Sequence[int], held: Collection[int]) -> tuple[int, float] | None:
        """Return the first joint at rest in a mode that it cannot keep, and its other mode; None if none is.

        One that sticks must need no more than its dry friction, and one that slides must accelerate the way it
        slides: a linear complementarity problem. D is positive definite, so it has one solution, and mending always
        the first joint that is wrong leads there (Murty 1974).
        """
        moving, torques = self.constrained(t, now.q, now.v, now)
        holding = dict(zip(now.contact.stuck, torques))
        for j in resting:
            if j in held:
                continue
            way = copysign(1.0, holding.get(j, 0.0))
            if j in holding and abs(holding[j]) > self.friction.level(t, now.q[j], now.tau[j], j, way):
                return j, way
            if j not in holding and now.contact.slide[j] * moving[j] < 0:
                return j, 0.0
        return None

    def first_stop(self, now: Step, after: Floats) -> tuple[int, float] | None:
        """Return the joint whose rate first reaches zero within the step and when, as a share of it; None if none."""
        first = None
        slide, v = now.contact.slide, now.v
        for j in self.friction.dry_joints:
            if slide[j] * after[j] < 0:
                share = v[j] / (v[j] - after[j])
                if first is None or share < first[1]:
                    first = (j, share)
        return first

    def net(self, t: float, q: Floats, v: Floats, now: Step) -> list[float]:
        """Torque that the terms leave for the rigid body, N m."""
        return self.friction.net(t, q, v, now.left, now.contact.slide, now.tau, now.memory, now.q)

    def rates(self, t: float, q: Floats, v: Floats, now: Step) -> list[float]:
        """Accelerations at a stage, rad/s²."""
        if now.contact.stuck:
            return self.constrained(t, q, v, now)[0]
        self.q[:], self.v[:], self.tau[:] = q, v, self.net(t, q, v, now)
        out: list[float] = pin.aba(self.pin, self.data, self.q, self.v, self.tau).tolist()
        return out

    def constrained(self, t: float, q: Floats, v: Floats, now: Step) -> tuple[list[float], list[float]]:
        """Accelerations with the stuck joints at rest, and the torque that holds each of these, N m."""
        self.q[:], self.v[:] = q, v
        bias = pin.nonLinearEffects(self.pin, self.data, self.q, self.v).tolist()
        net = [torque - b for torque, b in zip(self.net(t, q, v, now), bias)]
        stuck, out = now.contact.stuck, [0.0] * len(net)
        free = [j for j in range(len(net)) if j not in stuck]
        if not free:
            return out, net
        upper = pin.crba(self.pin, self.data, self.q).tolist()
        inertia = [[upper[min(i, j)][max(i, j)] for j in free] for i in range(len(net))]
        moving = solved([inertia[i] for i in free], [net[i] for i in free])
        for j, a in zip(free, moving):
            out[j] = a
        return out, [net[i] - sum([m * a for m, a in zip(inertia[i], moving)]) for i in stuck]

    def rk4(self, t: float, now: Step, dt: float) -> tuple[list[float], list[float]]:
        """Angles and rates after one classical Runge-Kutta step of `dt` s in one mode of contact."""
        q, v, half, sixth = now.q, now.v, dt / 2, dt / 6
        if len(now.contact.stuck) == len(q):
            return list(q), list(v)
        a1 = self.rates(t, q, v, now)
        v2 = [w + half * a for w, a in zip(v, a1)]
        a2 = self.rates(t + half, [x + half * w for x, w in zip(q, v)], v2, now)
        v3 = [w + half * a for w, a in zip(v, a2)]
        a3 = self.rates(t + half, [x + half * w for x, w in zip(q, v2)], v3, now)
        v4 = [w + dt * a for w, a in zip(v, a3)]
        a4 = self.rates(t + dt, [x + dt * w for x, w in zip(q, v3)], v4, now)
        return (
            [x + sixth * (k1 + 2 * (k2 + k3) + k4) for x, k1, k2, k3, k4 in zip(q, v, v2, v3, v4)],
            [w + sixth * (k1 + 2 * (k2 + k3) + k4) for w, k1, k2, k3, k4 in zip(v, a1, a2, a3, a4)],
        )


def solved(matrix: list[list[float]], right: list[float]) -> list[float]:
    """Solve a small symmetric positive definite system by elimination; for two or three joints numpy is slower."""
    size = len(right)
    for i in range(size):
        for k in range(i + 1, size):
            factor = matrix[k][i] / matrix[i][i]
            matrix[k] = [b - factor * a for a, b in zip(matrix[i], matrix[k])]
            right[k] -= factor * right[i]
    out = [0.0] * size
    for i in reversed(range(size)):
        out[i] = (right[i] - sum([matrix[i][k] * out[k] for k in range(i + 1, size)])) / matrix[i][i]
    return out
