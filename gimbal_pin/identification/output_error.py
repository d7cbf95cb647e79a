"""Estimators that simulate the model in closed loop along the log: output error, and instruments for IDIM-IV."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import pi
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.signal import bilinear, lfilter

from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.effects import Term
from gimbal_pin.errors import DataError
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import Platform
from gimbal_pin.regression import (
    Block,
    Design,
    Estimate,
    Method,
    Samples,
    Segment,
    compute_residuals,
    find_moving_base,
    fit_instrumental,
    fit_physical,
    fit_weighted,
    get_design,
    resample_torque,
    smooth_samples,
    split_segments,
)
from gimbal_pin.regression.consistency import find_nearest_bodies

LOOP = 3.0
"""Bandwidth of the loop that holds the model to the log, Hz; its damping is one."""
WATCHED = 4.0
"""Low-pass on the motion that it is held to, in multiples of that."""
LOOP_GAINS = ((2 * pi * LOOP) ** 2, 4 * pi * LOOP)
"""kp, 1/s², and kd, 1/s, of that loop."""
SIMULATION_STEP = 0.004
"""Longest step of the simulation, s."""


RUNAWAY_RATE = 1e3
"""A joint that is simulated to move faster than this, rad/s, has run away."""
NEWTON_STEPS = 8
"""Most Gauss-Newton steps."""
CONVERGED_CHANGE = 0.1
"""Change of every parameter, in its standard deviations, at which they stop."""
STEP_HALVINGS = 5
"""Most times that a step is halved."""
CHUNK = 4096
"""Samples of the simulation whose columns are held at once."""
IDIM_PASSES = 2
"""Estimates in turn, each with the instruments that the one before simulates; a third would hardly move."""


class SimulatedStretch(NamedTuple):
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

    def part(self, rows: slice) -> SimulatedStretch:
        """Return the samples in `rows`."""
        platform = None if self.platform is None else self.platform.part(rows)
        return SimulatedStretch(
            self.t[rows], self.q[rows], self.v[rows], self.error[rows], platform
        )


def _find_nearest_model(rows: Design, theta: Array, covariance: Array) -> Model:
    """Return the model that can exist nearest to parameters: its plant can be simulated, whatever these are."""
    width = len(rows.reduction.independent)
    phi = find_nearest_bodies(
        rows.rig.phi, rows.mixing, theta[:width], covariance[:width, :width]
    ).phi
    terms = []
    for term in rows.to_terms(theta):
        limits = zip(term.values, term.effect.coefficients)
        terms.append(Term(term.effect, tuple(min(max(x, c.lower), c.upper) for x, c in limits)))
    return Model(rows.rig.with_phi(phi), tuple(terms))


def _gather_theta(rows: Design, model: Model) -> Array:
    """Return a model's base parameters and coefficients, (k,)."""
    values = [value for term in model.terms for value in term.values]
    return np.concatenate([rows.mixing @ model.rig.phi, values])


def run_log(rows: Design, model: Model, log: Log, calm: bool) -> list[SimulatedStretch]:
    """Run a model along every stretch of a log, on a base that moves as the log says; `calm` as for `_run_segment`."""
    carrier = find_moving_base(rows.rig, log)
    return [
        _run_segment(rows, model, stretch, carrier, calm)
        for stretch in split_segments(log, rows.filtering.cutoff)
    ]


def _run_segment(
    rows: Design, model: Model, stretch: Segment, carrier: str | None, calm: bool
) -> SimulatedStretch:
    """Run a model along one stretch.

    Args:
        rows: Rig, effects and filter.
        model: The model.
        stretch: The stretch.
        carrier: The link whose IMU says how the base moves; None where it stands.
        calm: Smooth the torque like the motion. The recording's own controller answered to its sensors' noise: what of
            the torque lies above the motion is that answer, and a motion made with it would know the noise.
    """
    whole = smooth_samples(stretch, rows.filtering, 0, stretch.length, carrier)
    slow = signals.lowpass(WATCHED * LOOP, 1.0 / stretch.dt)
    q, v = (signals.zero_phase(x, slow) for x in (whole.q, whole.v))
    step = max(1, int(SIMULATION_STEP / stretch.dt))
    knots = np.arange(0, stretch.length, step)
    # What acts over a step is the torque's mean over it.
    tau = resample_torque(stretch, rows.filtering, whole.t)
    tau = signals.zero_phase(tau, slow) if calm else tau
    impulse = np.zeros_like(tau)
    impulse[1:] = np.cumsum((tau[1:] + tau[:-1]) / 2, axis=0)
    mean = np.diff(impulse[knots], axis=0) / step
    plant = Plant(model, model.carried(whole.t, whole.platform))
    states = _follow(plant, whole.t[knots], q[knots], v[knots], mean, step * stretch.dt)
    measured = signals.resample(
        stretch.log.t[stretch.rows], stretch.log.q[stretch.rows], whole.t[knots]
    )
    platform = None if whole.platform is None else whole.platform.part(slice(None, None, step))
    return SimulatedStretch(whole.t[knots], states[0], states[1], measured - states[0], platform)


def _follow(
    plant: Plant, t: Array, q: Array, v: Array, tau: Array, dt: float
) -> tuple[Array, Array]:
    """Return angles and rates, (m, n), of a plant under torques tau, (m - 1, n), held to (q, v) by the loop."""
    model = plant.model
    data = plant.model.rig.model.createData()
    kp, kd = LOOP_GAINS
    state = State(q[0].copy(), v[0].copy())
    out_q = np.array(q)
    out_v = np.array(v)
    for k in range(len(tau)):
        wish = kp * (q[k] - state.q) + kd * (v[k] - state.v)
        state = plant.step(
            float(t[k]), state, tau[k] + _compute_mass_matrix(model, data, state.q) @ wish, dt
        )
        out_q[k + 1], out_v[k + 1] = state.q, state.v
        if not abs(state.v).max() < RUNAWAY_RATE:
            what = "cannot be followed by the model that was estimated from it"
            raise DataError(
                "the log",
                what,
                "use another estimator, such as weighted, and see 'gimbal-pin diagnose'",
            )
    return out_q, out_v


def _compute_mass_matrix(model: Model, data: pin.Data, q: Array) -> Array:
    """``D(q)``, rotors included, kg m², (n, n)."""
    upper = np.triu(pin.crba(model.rig.model, data, q))
    return np.asarray(upper + np.triu(upper, 1).T + np.diag(model.armature))


def _simulate_segment(rows: Design, model: Model, segment: Segment) -> Segment:
    """Return a segment with the model's motion in the place of the measured one: rates, and no noise."""
    log = segment.log
    t = segment.log.t
    q = np.array(log.q)
    v = np.gradient(q, t, axis=0)
    made = _run_segment(rows, model, segment, find_moving_base(rows.rig, log), calm=True)
    inside = (t >= made.t[0]) & (t <= made.t[-1])
    q[inside], v[inside] = (signals.resample(made.t, x, t[inside]) for x in (made.q, made.v))
    return segment._replace(log=replace(log, q=q, v=v))


def fit_output_error(blocks: Sequence[Block]) -> Estimate:
    """``argmin Σ ‖(q - q_s(theta)) / σ_j‖²`` with q_s the motion of the model itself, in closed loop along the log.

    A Gauss-Newton step is least squares on the angles' error: by a change of theta the model moves by
    ``-1 / (s² + kd s + kp) D⁻¹ Y δtheta``, with the regressor Y along the simulated motion, which is not noisy
    (Gautier, Janot and Vandanjon 2013 take the same derivative for torques). The noise of the recorded angles is then
    noise of the output alone, and biases nothing.
    """
    rows = get_design(blocks)
    first = fit_physical(blocks)
    now = _follow_logs(rows, first.theta, first.covariance)
    if now is None:
        what, mend = (
            "cannot be followed by the model that was estimated from it",
            "use another estimator",
        )
        raise DataError(
            rows.logs[0].name, what, f"{mend}, such as weighted, and see 'gimbal-pin diagnose'"
        )
    before = now.theta
    found = fit_weighted(now.blocks)
    for _ in range(NEWTON_STEPS):
        # What least squares says may lie beyond the bodies that can exist: it then says the same once more.
        if any(
            np.all(np.abs(found.theta - each) <= CONVERGED_CHANGE * found.std)
            for each in (before, now.theta)
        ):
            break
        after = _shorten_step(rows, now, found)
        if after is None:
            break
        before = found.theta
        now = after
        found = fit_weighted(after.blocks)
    left = np.concatenate([compute_residuals(block, found.theta) for block in now.blocks])
    return replace(
        found, residual_std=np.sqrt(np.mean(left**2, axis=0)), method=Method.OUTPUT_ERROR
    )


class Followed(NamedTuple):
    """A model's motion along the logs as rows, and the parameters that it was made with, (k,)."""

    theta: Array
    blocks: tuple[Block, ...]

    def cost(self, scale: Array) -> float:
        """``Σ ‖(q - q_s) / σ‖²`` with σ per joint, rad."""
        return float(
            sum(
                np.sum((compute_residuals(block, self.theta) / scale) ** 2) for block in self.blocks
            )
        )


def _follow_logs(rows: Design, theta: Array, covariance: Array) -> Followed | None:
    """Run the bodies nearest to parameters along the logs; None where they run away."""
    model = _find_nearest_model(rows, theta, covariance)
    try:
        return Followed(_gather_theta(rows, model), tuple(_iterate_error_blocks(rows, model)))
    except DataError:
        return None


def _shorten_step(rows: Design, now: Followed, found: Estimate) -> Followed | None:
    """Take a Gauss-Newton step, halved until the model follows the logs better than before; None if it never does."""
    scale = np.maximum(found.residual_std, 1e-12)
    share = 1.0
    cost = now.cost(scale)
    for _ in range(STEP_HALVINGS):
        after = _follow_logs(rows, now.theta + share * (found.theta - now.theta), found.covariance)
        if after is not None and after.cost(scale) <= cost:
            return after
        share /= 2
    return None


def _iterate_error_blocks(rows: Design, model: Model) -> Iterator[Block]:
    """Yield the rows ``A theta = A theta_s + (q_s - q)``, rad, along what a model with theta_s does."""
    theta = _gather_theta(rows, model)
    for run in (run for log in rows.logs for run in run_log(rows, model, log, calm=False)):
        dt = float(run.t[1] - run.t[0])
        pad = round(signals.compute_lowpass_settling(LOOP) / dt)
        step = max(1, int(1.0 / (2 * WATCHED * LOOP * dt)))
        for begin in range(pad, len(run.t) - pad, CHUNK):
            end = min(begin + CHUNK, len(run.t) - pad)
            part = run.part(slice(begin - pad, end + pad))
            yield _build_error_block(rows, model, theta, part, slice(pad, pad + end - begin, step))


def _build_error_block(
    rows: Design, model: Model, theta: Array, run: SimulatedStretch, keep: slice
) -> Block:
    """Return the rows of one part of a run, low-passed and thinned."""
    dt = float(run.t[1] - run.t[0])
    a = signals.differentiate(run.v, dt)
    still = np.zeros_like(run.q)
    channels = Samples(run.t, run.q, run.v, a, still, run.v, still[0], run.platform)
    columns = np.concatenate(
        [rows.compute_rigid_columns(channels), rows.compute_effect_columns(channels)], axis=2
    )
    data = model.rig.model.createData()
    D = np.array([_compute_mass_matrix(model, data, q) for q in run.q])
    top, bottom = bilinear([1.0], [1.0, LOOP_GAINS[1], LOOP_GAINS[0]], 1.0 / dt)
    moved = lfilter(top, bottom, np.linalg.solve(D, columns), axis=0)
    slow = signals.lowpass(WATCHED * LOOP, 1.0 / dt)
    A, error = (signals.zero_phase(x, slow)[keep].copy() for x in (moved, run.error))
    return Block(
        run.t[keep].copy(),
        A,
        A @ theta - error,
        run.q[keep].copy(),
        run.v[keep].copy(),
        np.ones_like(error),
        np.zeros_like(error),
        np.zeros_like(error),
    )


def fit_idim(blocks: Sequence[Block]) -> Estimate:
    """``theta = (Σ ZᵀWA)⁻¹ Σ ZᵀWb`` with Z the regressor along the motion that the current model makes in closed loop.

    That motion follows the true one and knows next to nothing of the sensors' noise (Janot, Vandanjon and Gautier
    2014): where the regressor is noisy, and least squares shrinks what multiplies the acceleration, this does not.
    """
    found = fit_physical(blocks)
    for _ in range(IDIM_PASSES):
        found = fit_instrumental(blocks, build_instruments(blocks, found))
    return found


def build_instruments(blocks: Sequence[Block], found: Estimate) -> list[Array]:
    """Return per block Z, (m, n, k), along the motion of the bodies nearest to an estimate."""
    rows = get_design(blocks)
    model = _find_nearest_model(rows, found.theta, found.covariance)
    return [block.A for block in rows.iterate_blocks(partial(_simulate_segment, rows, model))]
