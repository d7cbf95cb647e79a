"""Closed-loop output error: the model whose own motion is nearest to the recorded one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import bilinear, lfilter

from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import DataError
from gimbal_pin.estimation.estimators.base import Estimate, residuals
from gimbal_pin.estimation.estimators.physical import physical
from gimbal_pin.estimation.estimators.weighted import weighted
from gimbal_pin.estimation.replay import GAINS, LOOP, WATCHED, Run, bodies, inertia, runs, theta_of
from gimbal_pin.estimation.rows import Block, Channels, Rows, standing_for
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array

PASSES = 8
"""Most Gauss-Newton steps."""
SETTLED = 0.1
"""Change of every parameter, in its standard deviations, at which they stop."""
HALVINGS = 5
"""Most times that a step is halved."""
CHUNK = 4096
"""Samples of the simulation whose columns are held at once."""


def output_error(blocks: Sequence[Block]) -> Estimate:
    """``argmin Σ ‖(q - q_s(theta)) / σ_j‖²`` with q_s the motion of the model itself, in closed loop along the log.

    A Gauss-Newton step is least squares on the angles' error: by a change of theta the model moves by
    ``-1 / (s² + kd s + kp) D⁻¹ Y δtheta``, with the regressor Y along the simulated motion, which is not noisy
    (Gautier, Janot and Vandanjon 2013 take the same derivative for torques). The noise of the recorded angles is then
    noise of the output alone, and biases nothing.
    """
    rows = standing_for(blocks)
    first = physical(blocks)
    now = followed(rows, first.theta, first.covariance)
    if now is None:
        what, mend = "cannot be followed by the model that was estimated from it", "use another estimator"
        raise DataError(rows.logs[0].name, what, f"{mend}, such as weighted, and see 'gimbal-pin diagnose'")
    before, found = now.theta, weighted(now.blocks)
    for _ in range(PASSES):
        # What least squares says may lie beyond the bodies that can exist: it then says the same once more.
        if any(np.all(np.abs(found.theta - each) <= SETTLED * found.std) for each in (before, now.theta)):
            break
        after = shortened(rows, now, found)
        if after is None:
            break
        before, now, found = found.theta, after, weighted(after.blocks)
    left = np.concatenate([residuals(block, found.theta) for block in now.blocks])
    return replace(found, residual_std=np.sqrt(np.mean(left**2, axis=0)), method="output-error")


class Followed(NamedTuple):
    """A model's motion along the logs as rows, and the parameters that it was made with, (k,)."""

    theta: Array
    blocks: tuple[Block, ...]

    def cost(self, scale: Array) -> float:
        """``Σ ‖(q - q_s) / σ‖²`` with σ per joint, rad."""
        return float(sum(np.sum((residuals(block, self.theta) / scale) ** 2) for block in self.blocks))


def followed(rows: Rows, theta: Array, covariance: Array) -> Followed | None:
    """Run the bodies nearest to parameters along the logs; None where they run away."""
    model = bodies(rows, theta, covariance)
    try:
        return Followed(theta_of(rows, model), tuple(errors(rows, model)))
    except DataError:
        return None


def shortened(rows: Rows, now: Followed, found: Estimate) -> Followed | None:
    """Take a Gauss-Newton step, halved until the model follows the logs better than before; None if it never does."""
    scale, share = np.maximum(found.residual_std, 1e-12), 1.0
    cost = now.cost(scale)
    for _ in range(HALVINGS):
        after = followed(rows, now.theta + share * (found.theta - now.theta), found.covariance)
        if after is not None and after.cost(scale) <= cost:
            return after
        share /= 2
    return None


def errors(rows: Rows, model: Model) -> Iterator[Block]:
    """Yield the rows ``A theta = A theta_s + (q_s - q)``, rad, along what a model with theta_s does."""
    theta = theta_of(rows, model)
    for run in (run for log in rows.logs for run in runs(rows, model, log, calm=False)):
        dt = float(run.t[1] - run.t[0])
        pad, step = round(signals.settling(LOOP) / dt), max(1, int(1.0 / (2 * WATCHED * LOOP * dt)))
        for begin in range(pad, len(run.t) - pad, CHUNK):
            end = min(begin + CHUNK, len(run.t) - pad)
            part = run.part(slice(begin - pad, end + pad))
            yield block(rows, model, theta, part, slice(pad, pad + end - begin, step))


def block(rows: Rows, model: Model, theta: Array, run: Run, keep: slice) -> Block:
    """Return the rows of one part of a run, low-passed and thinned."""
    dt = float(run.t[1] - run.t[0])
    a, still = signals.differentiate(run.v, dt), np.zeros_like(run.q)
    channels = Channels(run.t, run.q, run.v, a, still, still[0], run.platform)
    columns = np.concatenate([rows.rigid_columns(channels), rows.effect_columns(channels)], axis=2)
    data = model.rig.model.createData()
    D = np.array([inertia(model, data, q) for q in run.q])
    top, bottom = bilinear([1.0], [1.0, GAINS[1], GAINS[0]], 1.0 / dt)
    moved = lfilter(top, bottom, np.linalg.solve(D, columns), axis=0)
    slow = signals.lowpass(WATCHED * LOOP, 1.0 / dt)
    A, error = (signals.zero_phase(x, slow)[keep].copy() for x in (moved, run.error))
    return Block(run.t[keep].copy(), A, A @ theta - error, run.q[keep].copy(), run.v[keep].copy(), np.ones_like(error))
