"""Gyros on several links against the encoders between them: misalignment and bias of each, and joint rates from them.

``w_i = R_iᵀ w_0 + J_i q̇`` (THESIS 4.5.1): what the base's gyro and the encoders say of link i, its own gyro repeats.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.log.eccentricity import Eccentricity, centred, eccentricities
from gimbal_pin.log.gyros import compared, kinematics
from gimbal_pin.log.log import Array, Imu, Log
from gimbal_pin.rig.rig import Rig

PASSES = 4
"""Linear steps to the misalignments: the third no longer changes them."""
CONTRADICTION = (0.3, 0.02)
"""A gyro is not believed whose difference is above this share of its rate, and above this, rad/s rms."""
SHORTEST = 50
"""Fewest samples that are compared."""


@dataclass(frozen=True, eq=False)
class Mounting:
    """``gyro = Mᵀ w + b``: how an IMU sits on its link, and what its gyro adds.

    Attributes:
        turn: M, from the IMU's axes to the link's, (3, 3).
        bias: b, rad/s, (3,).
        std: Standard deviations of M's rotation vector, rad, and of b, rad/s, (6,).
        before: Gyro less what base and encoders say of it, rad/s rms per axis, taken as it is; nan for the base's own.
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
        """Whether it tells of another motion than base and encoders do."""
        return self.after > max(CONTRADICTION[0] * self.rate, CONTRADICTION[1])

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, SI units."""
        return {
            "misalignment": {"value": self.misalignment.tolist(), "std": self.std[:3].tolist(), "unit": "rad"},
            "gyro_bias": {"value": self.bias.tolist(), "std": self.std[3:].tolist(), "unit": "rad/s"},
            "difference_rms": {"before": self.before, "after": self.after} if self.before == self.before else None,
        }

    @property
    def misalignment(self) -> Array:
        """Rotation vector of M, rad, (3,)."""
        return np.asarray(pin.log3(self.turn))

    def corrected(self, imu: Imu) -> Imu:
        """Return the readings in the link's axes, without the gyro's bias."""
        gyro = None if imu.gyro is None else (imu.gyro - self.bias) @ self.turn.T
        return Imu(gyro, None if imu.accel is None else imu.accel @ self.turn.T, imu.quat)


def mountings(rig: Rig, log: Log) -> dict[str, Mounting]:
    """Estimate every gyro's misalignment and bias from one log; empty where no link but the base carries one.

    The base's gyro counts as exact zero where there is none. All are found together, by least squares on their
    differences from the base's gyro and the encoders' rates, iterated, since turns do not add.
    """
    links = gyros(rig, log)
    if len(links) < 2 or len(log) < SHORTEST:
        return {}
    seen = compared(rig, log, links)
    turns, biases = [np.eye(3)] * len(links), [np.zeros(3)] * len(links)
    first = seen.difference(seen.gyro)
    noise = float(np.sqrt(np.mean(first**2)))
    now = seen.gyro
    for _ in range(PASSES):
        known = np.array([[*pin.log3(M), *b] for M, b in zip(turns, biases)])
        step, std = seen.step(now, known, max(noise, 1e-9))
        biases = [b + M.T @ change[3:] for b, M, change in zip(biases, turns, step)]
        turns = [pin.exp3(change[:3]) @ M for M, change in zip(turns, step)]
        now = np.stack([(g - b) @ M.T for g, M, b in zip(seen.gyro, turns, biases)])
        last = seen.difference(now)
        noise = float(np.sqrt(np.mean(last**2)))
    before, after = ([np.nan, *np.sqrt(np.mean(x**2, axis=(1, 2)))] for x in (first, last))
    rate = np.sqrt(np.mean(seen.gyro**2, axis=(1, 2)))
    rows = zip(links, turns, biases, std, before, after, rate)
    return {link: Mounting(M, b, s, float(x), float(y), float(z)) for link, M, b, s, x, y, z in rows}


def gyros(rig: Rig, log: Log) -> tuple[str, ...]:
    """Links with a gyro, the base first: it is there whether it has one or not."""
    return (rig.base, *(link for link, imu in log.imus.items() if imu.gyro is not None and link != rig.base))


def gyro_rates(rig: Rig, log: Log) -> Array | None:
    """Joint rates that fit all gyros best, rad/s, (N, n): encoders need not be differentiated; None if one is hidden.

    ``q̇ = argmin Σ_i ‖gyro_i - R_iᵀ w_0 - J_i q̇‖²`` at every sample.
    """
    links = gyros(rig, log)
    if len(links) < 2:
        return None
    turned, jacobians = kinematics(rig, log.q, links[1:])
    base = log.imus.get(rig.base)
    carried = np.zeros((len(log), 3)) if base is None or base.gyro is None else base.gyro
    own = np.stack([np.asarray(log.imus[link].gyro) for link in links[1:]])
    relative = own - np.einsum("lmij,mj->lmi", turned, carried)
    normal = np.einsum("lmia,lmib->mab", jacobians, jacobians)
    if np.linalg.cond(normal).max() > 1e6:
        return None
    right = np.einsum("lmia,lmi->ma", jacobians, relative)
    return np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0])


class Rectified(NamedTuple):
    """A log whose IMUs, encoders and rates agree, and what it took.

    Attributes:
        log: The log; what contradicted the encoders is left out, and an event of it says so.
        mountings: Link → its IMU's misalignment and gyro bias.
        encoders: Joint → how far its encoder sits off the joint's centre, where the rates show it.
    """

    log: Log
    mountings: Mapping[str, Mounting]
    encoders: Mapping[str, Eccentricity]


def rectified(rig: Rig, log: Log) -> Rectified:
    """Turn a log's IMUs into their links' axes and take their gyros' biases off.

    A gyro that contradicts the encoders, however it is turned, is left out. Where the log holds no joint rates, they
    come from the gyros, if these show them all. Angles of encoders that sit off their centre are mended by the rates.
    """
    found = mountings(rig, log)
    wrong = [link for link, mounting in found.items() if mounting.contradicts]
    if wrong:
        worst = max(wrong, key=lambda link: found[link].after / found[link].rate)
        said = f"the gyro of {worst} is off by {found[worst].after:.2g} rad/s rms, however it is turned: it is not used"
        kept = {link: imu for link, imu in log.imus.items() if link != worst}
        return rectified(rig, replace(log, imus=kept, events=(*log.events, f"{log.name}: {said}")))
    imus = {link: found[link].corrected(imu) if link in found else imu for link, imu in log.imus.items()}
    out = replace(log, imus=imus)
    out = out if out.v is not None else replace(out, v=gyro_rates(rig, out))
    encoders = eccentricities(out)
    return Rectified(centred(out, encoders), found, encoders)
