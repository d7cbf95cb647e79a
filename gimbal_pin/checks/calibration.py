"""Gyros on several links against the encoders between them: misalignment and bias of each, and joint rates from them.

``w_i = R_iᵀ w_0 + J_i q̇`` (thesis 4.5.1): the gyro of link i against the base's gyro and the encoders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Imu, Log
from gimbal_pin.rig.rig import Rig

_CUTOFF = 15.0
"""Low-pass on encoders' rates and gyros before they are compared, Hz."""
_PRIOR = (0.1, 0.02)
"""Prior deviations of misalignment, rad, and bias, rad/s: what the log hardly shows stays near zero."""
_FAINT = 3.0
"""A misalignment is estimated from rates above so many deviations of the differences."""
_LINEAR_STEPS = 4
"""Linear steps to the misalignments: the third no longer changes them."""
_CONTRADICTION = (0.3, 0.02)
"""A gyro is left out whose difference is above this share of its rate, and above this, rad/s rms."""
_SIGNIFICANT = 4.0
"""Deviations from zero from which readings are corrected: of three IMUs' eighteen parameters one of those that are zero
is so far off in one log of 900."""
_FEWEST_COMPARED = 50
"""Fewest samples that are compared."""


@dataclass(frozen=True, eq=False)
class Mounting:
    """``gyro = Mᵀ w + b``: how an IMU sits on its link, and what its gyro adds.

    Attributes:
        turn: M, from the IMU's axes to the link's, (3, 3).
        bias: b, rad/s, (3,).
        std: Standard deviations of M's rotation vector, rad, and of b, rad/s, (6,).
        before: Gyro less the rate from base and encoders, rad/s rms per axis, uncorrected; nan for the base's own.
        after: The same with M and b.
        rate: The gyro's rate itself, rad/s rms per axis.
    """

    turn: Array
    bias: Array
    std: Array
    before: float
    after: float
    rate: float

    @property
    def contradicts(self) -> bool:
        """Whether it shows another motion than base and encoders do."""
        return self.after > max(_CONTRADICTION[0] * self.rate, _CONTRADICTION[1])

    @property
    def is_significant(self) -> bool:
        """Whether any of its six parameters is surely not zero."""
        return bool(np.any(np.abs([*self.misalignment, *self.bias]) > _SIGNIFICANT * self.std))

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, SI units."""
        return {
            "misalignment": {
                "value": self.misalignment.tolist(),
                "std": self.std[:3].tolist(),
                "unit": "rad",
            },
            "gyro_bias": {
                "value": self.bias.tolist(),
                "std": self.std[3:].tolist(),
                "unit": "rad/s",
            },
            "difference_rms": {"before": self.before, "after": self.after}
            if self.before == self.before
            else None,
        }

    @property
    def misalignment(self) -> Array:
        """Rotation vector of M, rad, (3,)."""
        return np.asarray(pin.log3(self.turn))

    def corrected(self, imu: Imu) -> Imu:
        """Return the readings in the link's axes, without the gyro's bias."""
        gyro = None if imu.gyro is None else (imu.gyro - self.bias) @ self.turn.T
        return Imu(gyro, None if imu.accel is None else imu.accel @ self.turn.T, imu.quat)


def estimate_mountings(rig: Rig, log: Log) -> dict[str, Mounting]:
    """Estimate every gyro's misalignment and bias from one log; empty where no link but the base carries one.

    The base's gyro counts as exact zero where there is none. All are found together, by least squares on their
    differences from the base's gyro and the encoders' rates, iterated, since turns do not add.
    """
    links = _gyro_links(rig, log)
    if len(links) < 2 or len(log) < _FEWEST_COMPARED:
        return {}
    gyro, turned, relative = _filter_and_thin(rig, log, links)

    def difference(now: Array) -> Array:
        """Gyros less the rates from base and encoders, rad/s, (L - 1, m, 3)."""
        return now[1:] - np.einsum("lmij,mj->lmi", turned, now[0]) - relative

    turns = [np.eye(3)] * len(links)
    biases = [np.zeros(3)] * len(links)
    first = last = difference(gyro)
    now = gyro
    for _ in range(_LINEAR_STEPS):
        known = np.array([[*pin.log3(M), *b] for M, b in zip(turns, biases)])
        noise = max(float(np.sqrt(np.mean(last**2))), 1e-9)
        step, std = _solve_corrections(now, last, turned, known, noise)
        biases = [b + M.T @ change[3:] for b, M, change in zip(biases, turns, step)]
        turns = [pin.exp3(change[:3]) @ M for M, change in zip(turns, step)]
        now = np.stack([(g - b) @ M.T for g, M, b in zip(gyro, turns, biases)])
        last = difference(now)
    before, after = ([np.nan, *np.sqrt(np.mean(x**2, axis=(1, 2)))] for x in (first, last))
    rate = np.sqrt(np.mean(gyro**2, axis=(1, 2)))
    rows = zip(links, turns, biases, std, before, after, rate)
    return {
        link: Mounting(M, b, s, float(x), float(y), float(z)) for link, M, b, s, x, y, z in rows
    }


def _gyro_links(rig: Rig, log: Log) -> tuple[str, ...]:
    """Links with a gyro, the base first: it is there whether it has one or not."""
    return (
        rig.base,
        *(link for link, imu in log.imus.items() if imu.gyro is not None and link != rig.base),
    )


def _read_gyro(log: Log, link: str) -> Array:
    """Return what the gyro of a link reports, rad/s, (N, 3); zero where it has none."""
    imu = log.imus.get(link)
    return np.zeros((len(log), 3)) if imu is None or imu.gyro is None else imu.gyro


def _filter_and_thin(rig: Rig, log: Log, links: Sequence[str]) -> tuple[Array, Array, Array]:
    """Filter gyros and encoders alike, and thin them out to m rows that are nearly independent.

    Returns:
        Rates of the links' gyros, the base's first, rad/s, (L, m, 3); of the others R_iᵀ, (L - 1, m, 3, 3), and J_i q̇,
        rad/s, (L - 1, m, 3).
    """
    grid = np.linspace(log.t[0], log.t[-1], len(log))
    dt = float(grid[1] - grid[0])
    sections = signals.lowpass(_CUTOFF, 1 / dt)
    edge = min(round(signals.compute_lowpass_settling(_CUTOFF) / dt), len(grid) // 4)
    keep = slice(edge, len(grid) - edge, max(1, round(1 / (2 * _CUTOFF * dt))))
    gyro = [
        signals.zero_phase(signals.resample(log.t, _read_gyro(log, x), grid), sections)[keep]
        for x in links
    ]
    q = signals.zero_phase(signals.resample(log.t, log.q, grid), sections)
    turned, jacobians = _compute_kinematics(rig, q[keep], links[1:])
    return (
        np.stack(gyro),
        turned,
        np.einsum("lmij,mj->lmi", jacobians, signals.differentiate(q, dt)[keep]),
    )


def _solve_corrections(
    gyro: Array, difference: Array, turned: Array, known: Array, noise: float
) -> tuple[Array, Array]:
    """Small turns, rad, and biases, rad/s, that explain the differences best, and their deviations, (L, 6) each.

    Args:
        gyro: Rates with what is known so far taken out, rad/s, (L, m, 3).
        difference: Their differences from base and encoders, rad/s, (L - 1, m, 3).
        turned: R_iᵀ of the links but the base, (L - 1, m, 3, 3).
        known: Turns and biases so far, which `_PRIOR` pulls to zero, (L, 6).
        noise: Deviation of the differences, rad/s.
    """
    links, m = gyro.shape[:2]
    base = np.concatenate([turned @ _skew(gyro[0]), turned], axis=3)
    deviations = np.tile(np.repeat(_PRIOR, 3), links)
    information = np.diag(1 / deviations**2)
    right = -known.ravel() / deviations**2
    for i in range(1, links):
        columns = np.zeros((m, 3, 6 * links))
        columns[:, :, :6] = -base[i - 1]
        columns[:, :, 6 * i : 6 * i + 3] = _skew(gyro[i])
        columns[:, :, 6 * i + 3 : 6 * i + 6] = np.eye(3)
        flat = columns.reshape(3 * m, -1) / noise
        information += flat.T @ flat
        right += flat.T @ (difference[i - 1].ravel() / noise)
    # A gyro's own noise, turned, looks like information: a turn that only noise supports stays zero.
    shown = np.diag(information) > np.tile(np.repeat([_FAINT**2 * m, 0.0], 3), links)
    covariance = np.linalg.inv(information[np.ix_(shown, shown)])
    step = np.zeros(6 * links)
    std = deviations.copy()
    step[shown], std[shown] = covariance @ right[shown], np.sqrt(np.diag(covariance))
    return step.reshape(links, 6), std.reshape(links, 6)


def _skew(w: Array) -> Array:
    """``[w]×``, (m, 3, 3), of vectors (m, 3)."""
    return np.cross(w[:, None], np.eye(3)).swapaxes(1, 2)


def _compute_kinematics(rig: Rig, q: Array, links: Sequence[str]) -> tuple[Array, Array]:
    """``R_iᵀ`` (L, m, 3, 3) and the Jacobians of the links' rates in their own axes, (L, m, 3, n)."""
    data = rig.model.createData()
    frames = [rig.model.getFrameId(link, pin.FrameType.BODY) for link in links]
    turned = np.empty((len(links), len(q), 3, 3))
    jacobians = np.empty((len(links), len(q), 3, rig.n))
    for k, angles in enumerate(q):
        pin.computeJointJacobians(rig.model, data, angles)
        pin.updateFramePlacements(rig.model, data)
        for i, frame in enumerate(frames):
            turned[i, k] = data.oMf[frame].rotation.T
            jacobians[i, k] = pin.getFrameJacobian(rig.model, data, frame, pin.LOCAL)[3:].reshape(
                3, -1
            )  # n = 1: (6,)
    return turned, jacobians


def estimate_joint_rates(rig: Rig, log: Log) -> Array | None:
    """Joint rates that fit all gyros best, rad/s, (N, n): encoders need not be differentiated; None if one is hidden.

    ``q̇ = argmin Σ_i ‖gyro_i - R_iᵀ w_0 - J_i q̇‖²`` at every sample.
    """
    links = _gyro_links(rig, log)
    if len(links) < 2:
        return None
    turned, jacobians = _compute_kinematics(rig, log.q, links[1:])
    own = np.stack([_read_gyro(log, link) for link in links[1:]])
    relative = own - np.einsum("lmij,mj->lmi", turned, _read_gyro(log, rig.base))
    normal = np.einsum("lmia,lmib->mab", jacobians, jacobians)
    if np.linalg.cond(normal).max() > 1e6:
        return None
    right = np.einsum("lmia,lmi->ma", jacobians, relative)
    return np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0])


def correct_imus(rig: Rig, log: Log) -> tuple[list[tuple[str, Log]], dict[str, Mounting]]:
    """Leave out gyros that contradict the encoders, however they are turned; turn the others into their links' axes.

    An IMU stays as it is where what is estimated of it may as well be zero.

    Returns:
        The log after each step, with its cause; and how the IMUs that are left sit on their links.
    """
    found = estimate_mountings(rig, log)
    steps = list[tuple[str, Log]]()
    while wrong := [link for link, mounting in found.items() if mounting.contradicts]:
        worst = max(wrong, key=lambda link: found[link].after / found[link].rate)
        log = replace(log, imus={link: imu for link, imu in log.imus.items() if link != worst})
        steps.append(("contradicting-gyro", log))
        found = estimate_mountings(rig, log)
    if any(one.is_significant for one in found.values()):
        each = ((link, imu, found.get(link)) for link, imu in log.imus.items())
        imus = {
            link: one.corrected(imu) if one is not None and one.is_significant else imu
            for link, imu, one in each
        }
        steps.append(("imu-mounting", replace(log, imus=imus)))
    return steps, found
