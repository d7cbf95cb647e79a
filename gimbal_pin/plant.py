"""The plant that `simulate` integrates: forward dynamics with true stick, RK4, one step per control sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.effects import Sample
from gimbal_pin.log import Array
from gimbal_pin.model import Model


class State(NamedTuple):
    """Angles rad and rates rad/s, (n,); a rate of exactly zero is a candidate for sticking."""

    q: Array
    v: Array


class Contact(NamedTuple):
    """Dry friction's mode over one step.

    Attributes:
        slide: Direction of sliding per joint: -1, 0 (no dry friction, or stuck), 1.
        stuck: Joints that stick.
    """

    slide: tuple[float, ...]
    stuck: tuple[int, ...]


class Plant:
    """``a = D^-1 (tau - C v - G - F)`` (THESIS 3.71), with dry friction by the stick rule.

    A joint whose rate is zero sticks as long as the torque that holds it is within its total dry friction;
    otherwise it slides where that torque pushes it. A rate that changes sign within a step is brought to zero at
    the crossing, and the step goes on from there: no smooth sign, no chatter.
    """

    def __init__(self, model: Model) -> None:
        """Take the model's terms apart by joint."""
        self.model = model
        self.pin = model.rig.model
        self.data = model.rig.model.createData()
        self.terms = model.by_joint
        self.dry = tuple(tuple(term for term in terms if term.effect.dry and any(term.values)) for terms in self.terms)
        self.dry_joints = tuple(j for j, terms in enumerate(self.dry) if terms)

    def step(self, t: float, state: State, tau: Array, dt: float, held: tuple[int, ...] = ()) -> State:
        """Return the state after `dt` s under constant torque `tau`, N m; splits the step where a joint stops.

        A joint that comes loose only to turn back before the step ends is `held` for this step instead.
        """
        contact = self.contact(t, state, tau, held)
        after = self.rk4(t, state, tau, contact, dt)
        stopping = self.first_stop(state, after, contact)
        if stopping is None:
            return after
        joint, share = stopping
        if share == 0:
            return self.step(t, state, tau, dt, (*held, joint))
        at_stop = self.rk4(t, state, tau, contact, share * dt)
        v = at_stop.v.copy()
        v[joint] = 0.0
        rest = (1 - share) * dt
        return self.step(t + share * dt, State(at_stop.q, v), tau, rest) if rest > 1e-9 else State(at_stop.q, v)

    def first_stop(self, before: State, after: State, contact: Contact) -> tuple[int, float] | None:
        """Return the joint whose rate first reaches zero within the step and when, as a share of it; None if none."""
        first = None
        for j in self.dry_joints:
            if contact.slide[j] * after.v[j] < 0:
                start, end = float(before.v[j]), float(after.v[j])
                share = start / (start - end)
                if first is None or share < first[1]:
                    first = (j, share)
        return first

    def contact(self, t: float, state: State, tau: Array, held: tuple[int, ...] = ()) -> Contact:
        """Decide which joints slide where, and which stick, under `tau`; those in `held` stick.

        Among the joints at rest this is a linear complementarity problem: one that sticks needs no more than its dry
        friction, one that slides accelerates the way it slides. D is positive definite, so it has one solution, and
        always mending the first joint that is wrong leads there (Murty 1974).
        """
        slide = [float(np.sign(rate)) if dry else 0.0 for rate, dry in zip(state.v.tolist(), self.dry)]
        resting = {j: self.level(t, state, tau, j) for j in self.dry_joints if slide[j] == 0.0}
        stuck = set(resting)
        for _ in range(3 ** len(resting) if resting else 0):
            contact = Contact(tuple(slide), tuple(sorted(stuck)))
            acceleration, holding = self.constrained(t, state, tau, contact)
            wrong = [
                j
                for j in resting
                if j not in held and (abs(holding[j]) > resting[j] if j in stuck else slide[j] * acceleration[j] < 0)
            ]
            if not wrong:
                break
            stuck ^= {wrong[0]}
            slide[wrong[0]] = 0.0 if wrong[0] in stuck else float(np.sign(holding[wrong[0]]))
        return Contact(tuple(slide), tuple(sorted(stuck)))

    def level(self, t: float, state: State, tau: Array, j: int) -> float:
        """Dry friction that joint `j` can bear, N m."""
        at = Sample(t, float(state.q[j]), float(state.v[j]), 0.0, 1.0, float(tau[j]))
        return float(sum(term.torque(at) for term in self.dry[j]))

    def inertia(self, q: Array) -> Array:
        """``D(q)``, (n, n), both triangles."""
        upper = np.triu(pin.crba(self.pin, self.data, q))
        return upper + np.triu(upper, 1).T

    def constrained(self, t: float, state: State, tau: Array, contact: Contact) -> tuple[Array, Array]:
        """Accelerations with the stuck joints at rest, rad/s², and the torque that holds each joint so, N m, (n,).

        The second is what dry friction has to bear at the stuck joints, and zero to rounding at the others.
        """
        net = tau - self.passive(t, state, tau, contact) - pin.nonLinearEffects(self.pin, self.data, state.q, state.v)
        inertia = self.inertia(state.q)
        free = [j for j in range(len(net)) if j not in contact.stuck]
        acceleration = np.zeros_like(net)
        if free:
            acceleration[free] = np.linalg.solve(inertia[np.ix_(free, free)], net[free])
        return acceleration, net - inertia @ acceleration

    def passive(self, t: float, state: State, tau: Array, contact: Contact) -> Array:
        """Torque of all terms in the contact's mode, N m, (n,)."""
        return np.array(
            [
                sum(term.torque(Sample(t, q, v, 0.0, slide, torque)) for term in terms)
                for terms, q, v, slide, torque in zip(
                    self.terms, state.q.tolist(), state.v.tolist(), contact.slide, tau.tolist()
                )
            ]
        )

    def acceleration(self, t: float, state: State, tau: Array, contact: Contact) -> Array:
        """Accelerations, rad/s², (n,)."""
        if contact.stuck:
            return self.constrained(t, state, tau, contact)[0]
        return pin.aba(self.pin, self.data, state.q, state.v, tau - self.passive(t, state, tau, contact))

    def rk4(self, t: float, state: State, tau: Array, contact: Contact, dt: float) -> State:
        """One classical Runge-Kutta step of `dt` s in one mode of contact."""
        q, v = state
        half = dt / 2
        a1 = self.acceleration(t, state, tau, contact).copy()
        v2 = v + half * a1
        a2 = self.acceleration(t + half, State(q + half * v, v2), tau, contact).copy()
        v3 = v + half * a2
        a3 = self.acceleration(t + half, State(q + half * v2, v3), tau, contact).copy()
        v4 = v + dt * a3
        a4 = self.acceleration(t + dt, State(q + dt * v3, v4), tau, contact)
        return State(q + dt / 6 * (v + 2 * (v2 + v3) + v4), v + dt / 6 * (a1 + 2 * (a2 + a3) + a4))
