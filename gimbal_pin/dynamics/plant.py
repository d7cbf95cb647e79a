"""The plant that `simulate` integrates: forward dynamics with true stick, RK4, one step per control sample."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import copysign
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.moving_base import Carrier
from gimbal_pin.effects.resistance import Memory, Resistance
from gimbal_pin.log.log import REACH, Array
from gimbal_pin.log.platform import Platform

Floats = Sequence[float]
Body = tuple[list[float], list[list[float]]]
aba = pin.aba


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

    @property
    def lost(self) -> bool:
        """Whether no machine can be there, not even half way: see `log.REACH`; what is not a number is nowhere."""
        far, fast = REACH["q"].upper / 2, REACH["v"].upper / 2
        return not all(abs(x) <= far for x in self.q.tolist()) or not all(abs(x) <= fast for x in self.v.tolist())


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
        x: Angles, rad, then rates, rad/s, at its start: where the memory holds.
        memory: See `State`.
        tau: Motor torque, N m.
        contact: Mode of dry friction.
        left: Torque less the affine terms' fixed part, N m.
    """

    x: Floats
    memory: Memory
    tau: Floats
    contact: Contact
    left: Floats


class Plant:
    """``a = D^-1 (tau - C v - G - F)`` (THESIS 3.71), with dry friction by the stick rule.

    A joint whose rate is zero sticks as long as the torque that holds it is within its total dry friction;
    otherwise it slides where that torque pushes it. A rate that changes sign within a step is brought to zero at
    the crossing, and the step goes on from there: no smooth sign, no chatter.

    Inside, a state is one list of floats, angles then rates: for a few joints that is faster than arrays.
    """

    def __init__(self, model: Model, platform: Platform | None = None) -> None:
        """Take the model's terms apart by joint; what they take per acceleration becomes the rotors' inertia.

        `platform`: motion of its base on a uniform grid, best of half a step; None: it stands, which is faster.
        """
        self.model = model
        self.n = model.rig.n
        self.pin = model.rig.model.copy()
        self.pin.armature = self.pin.armature + model.armature
        self.carrier = None if platform is None else Carrier(model.rig, platform, self.pin.armature)
        self.data = self.pin.createData()
        # Friction of size zero does nothing: left in, it would stop its joint at every reversal and cost two orders.
        self.friction = Resistance([[term for term in terms if any(term.values)] for terms in model.by_joint])
        self.none = [0.0] * self.n
        # Pinocchio takes the thirds of one array as they are, and filling it is cheaper than making three new ones.
        self.scratch = np.zeros(3 * self.n)
        self.q, self.v, self.tau = np.split(self.scratch, 3)

    def step(self, t: float, state: State, tau: Array, dt: float) -> State:
        """Return the state after `dt` s under constant torque `tau`, N m; splits the step where a joint stops.

        A joint that stops twice within one step sticks for the rest of it.
        """
        x, u, memory = self.flat(state), tau.tolist(), state.memory or self.friction.start
        stops: list[int] = []
        while dt > 1e-9:
            now = self.begin(t, x, memory, u, [j for j in stops if stops.count(j) > 1] if stops else ())
            x, share = self.rk4(t, now, dt), 1.0
            stop = self.first_stop(now, x)
            if stop is not None:
                joint, share = stop
                stops.append(joint)
                x = self.rk4(t, now, share * dt) if share > 0 else list(now.x)
                x[self.n + joint] = 0.0
            if memory:
                memory = self.friction.warmed(self.friction.evolved(memory, now.x, x), u, share * dt)
            t, dt = t + share * dt, (1 - share) * dt
        after = np.array(x)
        return State(after[: self.n], after[self.n :], memory)

    def contact(self, t: float, state: State, tau: Array) -> Contact:
        """Decide which joints slide where, and which stick, under `tau`."""
        return self.begin(t, self.flat(state), state.memory or self.friction.start, tau.tolist()).contact

    def acceleration(self, t: float, state: State, tau: Array, contact: Contact) -> Array:
        """Accelerations, rad/s², (n,)."""
        x, u, memory = self.flat(state), tau.tolist(), state.memory or self.friction.start
        now = Step(x, memory, u, contact, self.friction.left(u, contact.slide))
        return np.array(self.slope(t, x, now)[self.n :])

    def flat(self, state: State) -> list[float]:
        """Angles, then rates."""
        x: list[float] = state.q.tolist() + state.v.tolist()
        return x

    def begin(self, t: float, x: Floats, memory: Memory, tau: Floats, held: Collection[int] = ()) -> Step:
        """Decide the contact at the start of a step; joints in `held` stick whatever holds them."""
        slide, resting, n = [0.0] * self.n, [], self.n
        for j in self.friction.dry_joints:
            rate = x[n + j]
            if rate:
                slide[j] = 1.0 if rate > 0 else -1.0
            else:
                resting.append(j)
        now = Step(x, memory, tau, Contact(tuple(slide), tuple(resting)), self.friction.left(tau, slide))
        return self.settled(t, now, [j for j in resting if j not in held]) if resting else now

    def settled(self, t: float, now: Step, resting: Sequence[int]) -> Step:
        """Let loose of the stuck joints in `resting` those that cannot hold."""
        body, slide = self.body(t, now.x), list(now.contact.slide)
        for _ in range(3 ** len(resting)):
            wrong = self.wrong(t, now, body, resting)
            if wrong is None:
                break
            joint, way = wrong
            slide[joint] = way
            stuck = [j for j in now.contact.stuck if j != joint] + [joint] * (way == 0.0)
            contact = Contact(tuple(slide), tuple(sorted(stuck)))
            now = now._replace(contact=contact, left=self.friction.left(now.tau, slide))
        return now

    def wrong(self, t: float, now: Step, body: Body, resting: Sequence[int]) -> tuple[int, float] | None:
        """Return the first joint at rest in a mode that it cannot keep, and its other mode; None if none is.

        One that sticks must need no more than its dry friction, and one that slides must accelerate the way it
        slides: a linear complementarity problem. D is positive definite, so it has one solution, and mending always
        the first joint that is wrong leads there (Murty 1974); a joint once let loose may have to stick again.
        """
        moving, torques = self.constrained(t, now.x, now, body)
        holding = dict(zip(now.contact.stuck, torques))
        weight = self.weight(t, now.x) if self.friction.weighed else self.none
        for j in resting:
            way = copysign(1.0, holding.get(j, 0.0))
            level = self.friction.level(t, now.x[j], now.tau[j], j, way, now.memory, weight[j])
            if j in holding and abs(holding[j]) > level:
                return j, way
            if j not in holding and now.contact.slide[j] * moving[j] < 0:
                return j, 0.0
        return None

    def first_stop(self, now: Step, after: Floats) -> tuple[int, float] | None:
        """Return the joint whose rate first reaches zero within the step and when, as a share of it; None if none."""
        first, n, slide = None, self.n, now.contact.slide
        for j in self.friction.dry_joints:
            if slide[j] * after[n + j] < 0:
                before = now.x[n + j]
                share = before / (before - after[n + j])
                if first is None or share < first[1]:
                    first = (j, share)
        return first

    def net(self, t: float, x: Floats, now: Step) -> list[float]:
        """Torque that the terms leave for the rigid body, N m."""
        friction = self.friction
        memory = friction.evolved(now.memory, now.x, x) if now.memory else now.memory
        weight = self.weight(t, x) if friction.weighed else self.none
        return friction.net(now.left, t, x, x[self.n :], now.contact.slide, now.tau, memory, weight)

    def weight(self, t: float, x: Floats) -> list[float]:
        """Torque that the rig asks for at rest, N m."""
        if self.carrier is not None:
            return self.carrier.bias(t, [*x[: self.n], *self.none])
        weight: list[float] = pin.computeGeneralizedGravity(self.pin, self.data, np.array(x[: self.n])).tolist()
        return weight

    def slope(self, t: float, x: Floats, now: Step) -> list[float]:
        """dx/dt: rates, rad/s, then accelerations, rad/s²."""
        if now.contact.stuck:
            return [*x[self.n :], *self.constrained(t, x, now, self.body(t, x))[0]]
        net = self.net(t, x, now)
        if self.carrier is not None:
            return [*x[self.n :], *self.carrier.accelerations(t, x, net)]
        self.scratch[:] = [*x, *net]
        return [*x[self.n :], *aba(self.pin, self.data, self.q, self.v, self.tau).tolist()]

    def body(self, t: float, x: Floats) -> Body:
        """Return ``C v + G``, N m, and ``D(q)``, kg m², of which the upper triangle is filled."""
        self.scratch[: 2 * self.n] = x
        if self.carrier is not None:
            return self.carrier.bias(t, x), pin.crba(self.pin, self.data, self.q).tolist()
        bias = pin.nonLinearEffects(self.pin, self.data, self.q, self.v).tolist()
        return bias, pin.crba(self.pin, self.data, self.q).tolist()

    def constrained(self, t: float, x: Floats, now: Step, body: Body) -> tuple[list[float], list[float]]:
        """Accelerations with the stuck joints at rest, and the torque that holds each of these, N m."""
        bias, upper = body
        net = [torque - b for torque, b in zip(self.net(t, x, now), bias)]
        stuck, out = now.contact.stuck, [0.0] * len(net)
        free = [j for j in range(len(net)) if j not in stuck]
        rows = [[upper[i][j] if i < j else upper[j][i] for j in free] for i in range(len(net))]
        moving = solved([rows[i] for i in free], [net[i] for i in free])
        for j, a in zip(free, moving):
            out[j] = a
        return out, [net[i] - sum([m * a for m, a in zip(rows[i], moving)]) for i in stuck]

    def rk4(self, t: float, now: Step, dt: float) -> list[float]:
        """Angles and rates after one classical Runge-Kutta step of `dt` s in one mode of contact."""
        x, half, sixth = now.x, dt / 2, dt / 6
        if len(now.contact.stuck) == self.n:
            return list(x)
        k1 = self.slope(t, x, now)
        k2 = self.slope(t + half, [a + half * k for a, k in zip(x, k1)], now)
        k3 = self.slope(t + half, [a + half * k for a, k in zip(x, k2)], now)
        k4 = self.slope(t + dt, [a + dt * k for a, k in zip(x, k3)], now)
        return [a + sixth * (b + 2 * (c + d) + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)]


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
