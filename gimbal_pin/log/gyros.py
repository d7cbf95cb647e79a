"""What gyros on several links say beside the encoders between them, and how they would have to sit to agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import Rig

CUTOFF = 15.0
"""Low-pass on encoders' rates and gyros before they are compared, Hz."""
PRIOR = (0.1, 0.02)
"""Deviations of misalignment, rad, and bias, rad/s, before the log is seen: what it hardly shows stays near zero."""
FAINT = 3.0
"""A gyro tells how it is turned by rates above so many deviations of the differences."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Filtered gyros and encoders of a log, thinned out to rows that are nearly independent.

    Attributes:
        gyro: Rates of the links' gyros, the base's first, rad/s, (L, m, 3).
        turned: R_iᵀ of the links but the base, (L - 1, m, 3, 3).
        relative: J_i q̇, rad/s, (L - 1, m, 3).
    """

    gyro: Array
    turned: Array
    relative: Array

    def difference(self, gyro: Array) -> Array:
        """Gyros less what base and encoders say of them, rad/s, (L - 1, m, 3)."""
        return gyro[1:] - np.einsum("lmij,mj->lmi", self.turned, gyro[0]) - self.relative

    def step(self, gyro: Array, known: Array, noise: float) -> tuple[Array, Array]:
        """Small turns and biases that explain the differences best, and their deviations, (L, 6) each.

        Args:
            gyro: Rates with what is known so far taken out, rad/s, (L, m, 3).
            known: Turns and biases so far, rad and rad/s, which `PRIOR` pulls to zero, (L, 6).
            noise: Deviation of the differences, rad/s.
        """
        links, m = gyro.shape[:2]
        base = np.concatenate([self.turned @ skew(gyro[0]), self.turned], axis=3)
        deviations = np.tile(np.repeat(PRIOR, 3), links)
        information, right = np.diag(1 / deviations**2), -known.ravel() / deviations**2
        for i, (gap, turned) in enumerate(zip(self.difference(gyro), base), start=1):
            columns = np.zeros((m, 3, 6 * links))
            columns[:, :, :6] = -turned
            columns[:, :, 6 * i : 6 * i + 3] = skew(gyro[i])
            columns[:, :, 6 * i + 3 : 6 * i + 6] = np.eye(3)
            flat = columns.reshape(3 * m, -1) / noise
            information += flat.T @ flat
            right += flat.T @ (gap.ravel() / noise)
        # A gyro's own noise, turned, looks like information: a turn that nothing but noise tells of stays zero.
        told = np.diag(information) > np.tile(np.repeat([FAINT**2 * m, 0.0], 3), links)
        spread = np.linalg.inv(information[np.ix_(told, told)])
        step, std = np.zeros(6 * links), deviations.copy()
        step[told], std[told] = spread @ right[told], np.sqrt(np.diag(spread))
        return step.reshape(links, 6), std.reshape(links, 6)


def skew(w: Array) -> Array:
    """``[w]×``, (m, 3, 3), of vectors (m, 3)."""
    x, y, z = w.T
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def compared(rig: Rig, log: Log, links: Sequence[str]) -> Compared:
    """Filter gyros and encoders alike, and put the kinematics between them."""
    grid = np.linspace(log.t[0], log.t[-1], len(log))
    dt = float(grid[1] - grid[0])
    sections = signals.lowpass(CUTOFF, 1 / dt)
    edge, step = round(signals.settling(CUTOFF) / dt), max(1, round(1 / (2 * CUTOFF * dt)))
    keep = slice(min(edge, len(grid) // 4), len(grid) - min(edge, len(grid) // 4), step)
    still = np.zeros((len(grid), 3))
    raw = [still if log.imus.get(link) is None else log.imus[link].gyro for link in links]
    gyro = [signals.zero_phase(signals.resample(log.t, still if x is None else x, grid), sections)[keep] for x in raw]
    q = signals.zero_phase(signals.resample(log.t, log.q, grid), sections)
    v = signals.differentiate(q, dt)[keep]
    turned, jacobians = kinematics(rig, q[keep], links[1:])
    return Compared(np.stack(gyro), turned, np.einsum("lmij,mj->lmi", jacobians, v))


def kinematics(rig: Rig, q: Array, links: Sequence[str]) -> tuple[Array, Array]:
    """``R_iᵀ`` (L, m, 3, 3) and the Jacobians of the links' rates in their own axes, (L, m, 3, n)."""
    data, frames = rig.model.createData(), [rig.model.getFrameId(link, pin.FrameType.BODY) for link in links]
    turned, jacobians = np.empty((len(links), len(q), 3, 3)), np.empty((len(links), len(q), 3, rig.n))
    for k, angles in enumerate(q):
        pin.computeJointJacobians(rig.model, data, angles)
        pin.updateFramePlacements(rig.model, data)
        for i, frame in enumerate(frames):
            turned[i, k] = data.oMf[frame].rotation.T
            jacobians[i, k] = pin.getFrameJacobian(rig.model, data, frame, pin.LOCAL)[3:].reshape(3, -1)  # n = 1: (6,)
    return turned, jacobians
