"""A model in closed loop along a log: driven by its torque, held to its motion by a slow loop.

``D(q) a + C v + G + F = τ + D(q) (kp (q̄ - q) + kd (v̄ - v))`` with the log's torque τ and its motion q̄ smoothed to a
few times the loop's bandwidth. The loop keeps a model that is wrong, or a rig that falls over, near the recorded
motion; what it lets through of the sensors' noise has the loop's bandwidth, and next to no acceleration. The
recording's own controller need not be known.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.effects import Effect, Term
from gimbal_pin.errors import DataError
from gimbal_pin.estimation.rows import Rows, Stretch, carrying, smoothed, stretches
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.missing_samples import filled
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.consistency import nearest

LOOP = 3.0
"""Bandwidth of the loop that holds the model to the log, Hz; its damping is one."""
WATCHED = 4.0
"""Low-pass on the motion that it is held to, in multiples of that."""
GAINS = ((2 * pi * LOOP) ** 2, 4 * pi * LOOP)
"""kp, 1/s², and kd, 1/s, of that loop."""
STEP = 0.004
"""Longest step of the simulation, s."""


FASTEST = 1e3
"""A joint that is simulated to move faster than this, rad/s, has run away."""


class Run(NamedTuple):
    """A model's motion along one stretch of a log.

    Attributes:
        t: Time, s, (m,).
        q: Simulated angles, rad, (m, n).
        v: Simulated rates, rad/s, (m, n).
        error: Measured less simulated angles, rad, (m, n).
        platform: Motion of the base as measured; None where it stands.
    """

    t: Array
    q: Array
    v: Array
    error: Array
    platform: Platform | None = None

    def part(self, rows: slice) -> Run:
        """Return the samples in `rows`."""
        platform = None if self.platform is None else self.platform.part(rows)
        return Run(self.t[rows], self.q[rows], self.v[rows], self.error[rows], platform)


def bodies(rows: Rows, theta: Array, covariance: Array) -> Model:
    """Return the model that can exist nearest to parameters: its plant can be simulated, whatever these are."""
    width = len(rows.reduction.independent)
    phi = nearest(rows.rig.phi, rows.mixing, theta[:width], covariance[:width, :width]).phi
    return possible(rows, phi, theta)


def possible(rows: Rows, phi: Array, theta: Array) -> Model:
    """Return the model with these bodies, and the effects' coefficients within their bounds."""
    terms = tuple(Term(term.effect, bounded(term.effect, term.values)) for term in rows.terms(theta))
    return Model(rows.rig.with_phi(phi), terms)


def bounded(effect: Effect, values: tuple[float, ...]) -> tuple[float, ...]:
    """Return an effect's coefficients within their bounds."""
    return tuple(min(max(x, c.lower), c.upper) for x, c in zip(values, effect.coefficients))


def theta_of(rows: Rows, model: Model) -> Array:
    """Return a model's base parameters and coefficients, (k,)."""
    values = [value for term in model.terms for value in term.values]
    return np.concatenate([rows.mixing @ model.rig.phi, values])


def runs(rows: Rows, model: Model, log: Log, calm: bool) -> list[Run]:
    """Run a model along every stretch of a log, on a base that moves as the log says; `calm` as for `run`."""
    carrier = carrying(rows.rig, log)
    return [run(rows, model, stretch, carrier, calm) for stretch in stretches(log, rows.filtering.cutoff)]


def run(rows: Rows, model: Model, stretch: Stretch, carrier: str | None, calm: bool) -> Run:
    """Run a model along one stretch.

    Args:
        rows: Rig, effects and filter.
        model: The model.
        stretch: The stretch.
        carrier: The link whose IMU says how the base moves; None where it stands.
        calm: Smooth the torque like the motion. The recording's own controller answered to its sensors' noise: what of
            the torque lies above the motion is that answer, and a motion made with it would know the noise.
    """
    whole = smoothed(stretch, rows.filtering, 0, stretch.length, carrier)
    slow = signals.lowpass(WATCHED * LOOP, 1.0 / stretch.dt)
    q, v = (signals.zero_phase(x, slow) for x in (whole.q, whole.v))
    step = max(1, int(STEP / stretch.dt))
    knots = np.arange(0, stretch.length, step)
    # What acts over a step is the torque's mean over it.
    tau = torque(rows, stretch, whole.t)
    tau = signals.zero_phase(tau, slow) if calm else tau
    impulse = np.zeros_like(tau)
    impulse[1:] = np.cumsum((tau[1:] + tau[:-1]) / 2, axis=0)
    mean = np.diff(impulse[knots], axis=0) / step
    plant = Plant(model, model.carried(whole.t, whole.platform))
    states = held(plant, whole.t[knots], q[knots], v[knots], mean, step * stretch.dt)
    measured = signals.resample(stretch.log.t[stretch.rows], stretch.log.q[stretch.rows], whole.t[knots])
    platform = None if whole.platform is None else whole.platform.part(slice(None, None, step))
    return Run(whole.t[knots], states[0], states[1], measured - states[0], platform)


def torque(rows: Rows, stretch: Stretch, grid: Array) -> Array:
    """Return the log's torque at the times at which it acts, N m, (m, n), not smoothed: friction jumps."""
    part, alignment = stretch.log.part(stretch.rows), rows.filtering.alignment
    shift = stretch.dt / 2 if alignment is None else alignment
    return signals.resample(part.t + shift, np.asarray(part.tau), grid)


def held(plant: Plant, t: Array, q: Array, v: Array, tau: Array, dt: float) -> tuple[Array, Array]:
    """Return angles and rates, (m, n), of a plant under torques tau, (m - 1, n), held to (q, v) by the loop."""
    model, data = plant.model, plant.model.rig.model.createData()
    kp, kd = GAINS
    state = State(q[0].copy(), v[0].copy())
    out_q, out_v = np.array(q), np.array(v)
    for k in range(len(tau)):
        wish = kp * (q[k] - state.q) + kd * (v[k] - state.v)
        state = plant.step(float(t[k]), state, tau[k] + inertia(model, data, state.q) @ wish, dt)
        out_q[k + 1], out_v[k + 1] = state.q, state.v
        if not abs(state.v).max() < FASTEST:
            what = "cannot be followed by the model that was estimated from it"
            raise DataError("the log", what, "use another estimator, such as weighted, and see 'gimbal-pin diagnose'")
    return out_q, out_v


def inertia(model: Model, data: pin.Data, q: Array) -> Array:
    """``D(q)``, rotors included, kg m², (n, n)."""
    upper = np.triu(pin.crba(model.rig.model, data, q))
    return np.asarray(upper + np.triu(upper, 1).T + np.diag(model.armature))


def simulated(rows: Rows, model: Model) -> tuple[Log, ...]:
    """Return the logs with the model's motion in the place of the measured one: rates, and no noise.

    Holes that the measured motion closes are filled in them, for they would be other ones in a motion without noise.
    """
    made = []
    for log in (filled(log, rows.filtering.cutoff).log for log in rows.logs):
        q = np.array(log.q)
        v = np.gradient(q, log.t, axis=0)
        for one in runs(rows, model, log, calm=True):
            inside = (log.t >= one.t[0]) & (log.t <= one.t[-1])
            q[inside], v[inside] = (signals.resample(one.t, x, log.t[inside]) for x in (one.q, one.v))
        made.append(replace(log, q=q, v=v))
    return tuple(made)
