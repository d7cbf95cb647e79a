"""The plant that `simulate` integrates: forward dynamics with true stick, RK4, one step per control sample."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial
from math import copysign, nan
from struct import Struct
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.moving_base import MovingBase
from gimbal_pin.effects.resistance import EffectMemories, Resistance
from gimbal_pin.log.log import PLAUSIBLE_RANGES, Array
from gimbal_pin.log.platform import Platform

Floats = Sequence[float]
BodyLists = tuple[list[float], list[list[float]]]
evaluate_aba = pin.aba
RUNAWAY_ANGLE = PLAUSIBLE_RANGES["q"].upper / 2
RUNAWAY_SPEED = PLAUSIBLE_RANGES["v"].upper / 2
"""Half of the largest angle, rad, and rate, rad/s, that a log may hold: no machine gets there."""


class State(NamedTuple):
    """State of the plant.

    Attributes:
        q: Angles, rad, (n,).
        v: Rates, rad/s, (n,); a rate of exactly zero is a candidate for sticking.
        memory: Memories of the terms that have one; empty: as at rest.
    """

    q: Array
    v: Array
    memory: EffectMemories = ()

    @property
    def lost(self) -> bool:
        """Whether an angle or rate is beyond `RUNAWAY_ANGLE` or `RUNAWAY_SPEED`, or not a number."""
        for angle, rate in zip(self.q.tolist(), self.v.tolist()):
            if not (
                -RUNAWAY_ANGLE <= angle <= RUNAWAY_ANGLE and -RUNAWAY_SPEED <= rate <= RUNAWAY_SPEED
            ):
                return True
        return False


class Step(NamedTuple):
    """What stays the same through the stages of a step, as floats.

    Attributes:
        q: Angles at its start, rad.
        v: Rates at its start, rad/s.
        memory: See `State`.
        tau: Motor torque, N m.
        slide: Direction of sliding per joint: -1, 0 (no dry friction, or stuck), 1.
        stuck: Joints that stick.
        left: Torque less the affine terms' fixed part, N m.
    """

    q: Floats
    v: Floats
    memory: EffectMemories
    tau: Floats
    slide: tuple[float, ...]
    stuck: tuple[int, ...]
    left: Floats


class Plant:
    """``a = D^-1 (tau - C v - G - F)`` (thesis 3.71), with dry friction by the stick rule.

    A joint whose rate is zero sticks as long as the torque that holds it is within its total dry friction;
    otherwise it slides where that torque pushes it. A rate that changes sign within a step is brought to zero at
    the crossing, and the step goes on from there: no smooth sign, no chatter.

    Inside, angles and rates are lists of floats: for a few joints that is faster than arrays.
    """

    def __init__(self, model: Model, platform: Platform | None = None) -> None:
        """Take the model's terms apart by joint; what they take per acceleration becomes the rotors' inertia.

        `platform`: motion of its base on a uniform grid, best of half a step; None: it stands, which is faster.
        """
        model.check_uncoupled("the simulation")
        self.model = model
        self.n = model.rig.n
        self.pin = model.rig.model.copy()
        self.pin.armature = self.pin.armature + model.armature
        self.carrier = (
            None if platform is None else MovingBase(model.rig, platform, self.pin.armature)
        )
        self.data = self.pin.createData()
        # Friction of size zero does nothing: left in, it would stop its joint at every reversal and cost two orders.
        self.friction = Resistance(
            [[term for term in terms if any(term.values)] for terms in model.by_joint]
        )
        self.per_rate = self.friction.per_rate
        self.none = [0.0] * self.n
        # Pinocchio takes the thirds of one array as they are; packing floats into it takes half the time of `[:] =`.
        scratch = np.zeros(3 * self.n)
        self.q, self.v, self.tau = np.split(scratch, 3)
        self.fill = partial(Struct(f"{3 * self.n}d").pack_into, scratch.data, 0)

    def step(self, t: float, state: State, tau: Array, dt: float) -> State:
        """Return the state after `dt` s under constant torque `tau`, N m; splits the step where a joint stops.

        A joint that stops twice within one step sticks for the rest of it. A state beyond all numbers is no number.
        """
        try:
            return self._advance(t, state, tau, dt)
        except OverflowError:  # of floats: a power, an exponential
            return State(np.full(self.n, nan), np.full(self.n, nan), state.memory)

    def _advance(self, t: float, state: State, tau: Array, dt: float) -> State:
        q = state.q.tolist()
        v = state.v.tolist()
        u = tau.tolist()
        memory = state.memory or self.friction.start
        stops: list[int] = []
        while dt > 1e-9:
            now = self.begin(
                t, q, v, memory, u, [j for j in stops if stops.count(j) > 1] if stops else ()
            )
            (q, v) = self.rk4(t, now, dt)
            share = 1.0
            stop = self.first_stop(now, v)
            if stop is not None:
                joint, share = stop
                stops.append(joint)
                q, v = self.rk4(t, now, share * dt)
                v[joint] = 0.0
            if memory:
                memory = self.friction.warmed(
                    self.friction.evolved(memory, now.q, q), u, share * dt
                )
            t = t + share * dt
            dt = (1 - share) * dt
        return State(np.array(q), np.array(v), memory)

    def contact(self, t: float, state: State, tau: Array) -> Step:
        """Decide which joints slide where, and which stick, under `tau`."""
        memory = state.memory or self.friction.start
        return self.begin(t, state.q.tolist(), state.v.tolist(), memory, tau.tolist())

    def acceleration(self, t: float, state: State, tau: Array) -> Array:
        """Accelerations, rad/s², (n,)."""
        now = self.contact(t, state, tau)
        return np.array(self.accelerations(t, now.q, now.v, now))

    def begin(
        self,
        t: float,
        q: Floats,
        v: Floats,
        memory: EffectMemories,
        tau: Floats,
        held: Collection[int] = (),
    ) -> Step:
        """Decide the contact at the start of a step; joints in `held` stick whatever holds them."""
        slide = [0.0] * self.n
        resting = []
        for j in self.friction.dry_joints:
            if v[j]:
                slide[j] = 1.0 if v[j] > 0 else -1.0
            else:
                resting.append(j)
        now = Step(q, v, memory, tau, tuple(slide), tuple(resting), self.friction.left(tau, slide))
        return self.settled(t, now, [j for j in resting if j not in held]) if resting else now

    def settled(self, t: float, now: Step, resting: Sequence[int]) -> Step:
        """Release those of the stuck joints in `resting` that their dry friction cannot hold.

        One that sticks must need no more than its dry friction, and one that slides must accelerate the way it
        slides: a linear complementarity problem. D is positive definite, so it has one solution, and mending always
        the first joint that is wrong leads there (Murty 1974); a released joint may have to stick again.
        """
        body = self.body(t, now.q, now.v)
        slide = list(now.slide)
        for _ in range(3 ** len(resting)):
            wrong = self.wrong(t, now, body, resting)
            if wrong is None:
                break
            joint, way = wrong
            slide[joint] = way
            stuck = [j for j in now.stuck if j != joint] + [joint] * (way == 0.0)
            left = self.friction.left(now.tau, slide)
            now = now._replace(slide=tuple(slide), stuck=tuple(sorted(stuck)), left=left)
        return now

    def wrong(
        self, t: float, now: Step, body: BodyLists, resting: Sequence[int]
    ) -> tuple[int, float] | None:
        """Return the first joint at rest in a mode that it cannot keep, and its other mode; None if none is."""
        moving, torques = self.constrained(t, now.q, now.v, now, body)
        holding = dict(zip(now.stuck, torques))
        weight = self.weight(t, now.q) if self.friction.weighed else self.none
        for j in resting:
            way = copysign(1.0, holding.get(j, 0.0))
            level = self.friction.level(t, now.q[j], now.tau[j], j, way, now.memory, weight[j])
            if j in holding and abs(holding[j]) > level:
                return j, way
            if j not in holding and now.slide[j] * moving[j] < 0:
                return j, 0.0
        return None

    def first_stop(self, now: Step, after: Floats) -> tuple[int, float] | None:
        """Return the joint whose rate first reaches zero within the step and when, as a share of it; None if none."""
        first = None
        for j in self.friction.dry_joints:
            if now.slide[j] * after[j] < 0:
                share = now.v[j] / (now.v[j] - after[j])
                if first is None or share < first[1]:
                    first = (j, share)
        return first

    def take(self, net: list[float], t: float, q: Floats, v: Floats, now: Step) -> None:
        """Take the torque of the terms that are not affine, N m, off `net`."""
        friction = self.friction
        memory = friction.evolved(now.memory, now.q, q) if now.memory else now.memory
        weight = self.weight(t, q) if friction.weighed else self.none
        friction.take(net, t, q, v, now.slide, now.tau, memory, weight)

    def weight(self, t: float, q: Floats) -> list[float]:
        """Torque that the rig asks for at rest, N m."""
        if self.carrier is not None:
            return self.carrier.bias(t, q, self.none)
        weight: list[float] = pin.computeGeneralizedGravity(
            self.pin, self.data, np.array(q)
        ).tolist()
        return weight

    def accelerations(self, t: float, q: Floats, v: Floats, now: Step) -> list[float]:
        """Accelerations at one stage, rad/s²."""
        if now.stuck:
            return self.constrained(t, q, v, now, self.body(t, q, v))[0]
        net = [left - c * rate for left, c, rate in zip(now.left, self.per_rate, v)]
        if self.friction.rest:
            self.take(net, t, q, v, now)
        if self.carrier is not None:
            return self.carrier.accelerations(t, q, v, net)
        self.fill(*q, *v, *net)
        found: list[float] = evaluate_aba(self.pin, self.data, self.q, self.v, self.tau).tolist()
        return found

    def body(self, t: float, q: Floats, v: Floats) -> BodyLists:
        """Return ``C v + G``, N m, and ``D(q)``, kg m², of which the upper triangle is filled."""
        self.fill(*q, *v, *self.none)
        if self.carrier is not None:
            return self.carrier.bias(t, q, v), pin.crba(self.pin, self.data, self.q).tolist()
        bias = pin.nonLinearEffects(self.pin, self.data, self.q, self.v).tolist()
        return bias, pin.crba(self.pin, self.data, self.q).tolist()

    def constrained(
        self, t: float, q: Floats, v: Floats, now: Step, body: BodyLists
    ) -> tuple[list[float], list[float]]:
        """Accelerations with the stuck joints at rest, and the torque that holds each of these, N m."""
        bias, upper = body
        net = [left - c * rate - b for left, c, rate, b in zip(now.left, self.per_rate, v, bias)]
        if self.friction.rest:
            self.take(net, t, q, v, now)
        stuck = now.stuck
        out = [0.0] * len(net)
        free = [j for j in range(len(net)) if j not in stuck]
        rows = [[upper[i][j] if i < j else upper[j][i] for j in free] for i in range(len(net))]
        moving = _solve_small_system([rows[i] for i in free], [net[i] for i in free])
        for j, a in zip(free, moving):
            out[j] = a
        return out, [net[i] - sum([m * a for m, a in zip(rows[i], moving)]) for i in stuck]

    def rk4(self, t: float, now: Step, dt: float) -> tuple[list[float], list[float]]:
        """Angles and rates after one classical Runge-Kutta step of `dt` s in one mode of contact."""
        q = now.q
        v = now.v
        half = dt / 2
        sixth = dt / 6
        if len(now.stuck) == self.n or not dt:
            return list(q), list(v)
        a = self.accelerations(t, q, v, now)
        v2 = [x + half * k for x, k in zip(v, a)]
        b = self.accelerations(t + half, [x + half * k for x, k in zip(q, v)], v2, now)
        v3 = [x + half * k for x, k in zip(v, b)]
        c = self.accelerations(t + half, [x + half * k for x, k in zip(q, v2)], v3, now)
        v4 = [x + dt * k for x, k in zip(v, c)]
        d = self.accelerations(t + dt, [x + dt * k for x, k in zip(q, v3)], v4, now)
        return (
            [x + sixth * (k1 + 2 * (k2 + k3) + k4) for x, k1, k2, k3, k4 in zip(q, v, v2, v3, v4)],
            [x + sixth * (k1 + 2 * (k2 + k3) + k4) for x, k1, k2, k3, k4 in zip(v, a, b, c, d)],
        )


def _solve_small_system(matrix: list[list[float]], right: list[float]) -> list[float]:
    """Solve a small symmetric positive definite system by elimination; for two or three joints numpy is slower."""
    size = len(right)
    for i in range(size):
        for k in range(i + 1, size):
            factor = matrix[k][i] / matrix[i][i]
            matrix[k] = [b - factor * a for a, b in zip(matrix[i], matrix[k])]
            right[k] -= factor * right[i]
    out = [0.0] * size
    for i in reversed(range(size)):
        out[i] = (right[i] - sum([matrix[i][k] * out[k] for k in range(i + 1, size)])) / matrix[i][
            i
        ]
    return out
