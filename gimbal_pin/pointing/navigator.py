"""From the sensors to the camera's attitude, the platform's motion, and where the joints should be."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.control.laws.aim import Ahead, Aim, Carried
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.forecast import Forecast, Past
from gimbal_pin.pointing.fusion import Fused, Fusion
from gimbal_pin.pointing.seen import Seen
from gimbal_pin.pointing.sight import Sight, View

exp3, log3 = pin.exp3, pin.log3
ErrorFrom = Literal["camera", "platform"]
"""Whose gyro tells the attitude: the camera's own, or the platform's with the encoders between."""


class Known(NamedTuple):
    """What navigation remembers.

    Attributes:
        R: Attitude in the world of the camera, or of the platform where that is what is integrated, (3, 3).
        turning: The rate that was integrated last, rad/s, (3,).
        past: What the forecast remembers.
        t: Time of the sample, s.
        v: Joint rates, rad/s, (n,).
        fused: What fusion remembers; None without it.
    """

    R: Array
    turning: Array
    past: Past
    t: float
    v: Array
    fused: Fused | None = None

    @property
    def ended(self) -> bool:
        """Whether several gyros were fused and are not any more."""
        return self.fused is not None and self.fused.ended


class Fix(NamedTuple):
    """Angles, rates and aim at one sample.

    Attributes:
        q: Measured angles, rad, (n,).
        v: Joint rates from the gyros, rad/s, (n,).
        aim: Where the joints should be.
        steep: Whether the camera stands near a singular pose.
    """

    q: Array
    v: Array
    aim: Aim
    steep: bool


@dataclass(frozen=True, eq=False)
class Navigator:
    """Inverse kinematics of a fixed attitude from what the sensors say.

    ``q̇ = J⁻¹(ω_c - Rᵀ ω)``, ``e = -J⁻¹ log(R_dᵀ R)``, ``ė = -J⁻¹ ω_c``, ``q̇_d = q̇ + ė = -J⁻¹ Rᵀ ω``, and
    ``q̈_d = -J⁻¹ α(q, q̇_d, ω, ω̇)`` with α the camera's angular acceleration while the joints do not accelerate.

    Attributes:
        sight: Kinematics of the camera.
        wanted: R_d, the camera's attitude in the world, (3, 3).
        dt: Sampling interval, s.
        forecast: The platform's motion, ahead by as much as each distinct drive of the law is late; or now.
        source: Whose gyro tells the attitude.
        accelerates: False takes no wanted acceleration from inverse kinematics.
        oracle: The platform's true motion ahead is known, not predicted, for every lead.
        fusion: Brings the other gyros in; None: the camera's attitude comes from its own alone.
    """

    sight: Sight
    wanted: Array
    dt: float
    forecast: Forecast
    source: ErrorFrom = "camera"
    accelerates: bool = True
    oracle: bool = False
    fusion: Fusion | None = None

    @cached_property
    def towards(self) -> Array:
        """R_dᵀ, (3, 3)."""
        return np.ascontiguousarray(self.wanted.T)

    def start(self, seen: Seen, camera: Array, base: Array) -> Known:
        """Memory at the first sample, where the attitudes in the world of camera and base link are known, (3, 3)."""
        own, turning = (camera, seen.gyro) if self.source == "camera" else (base, seen.w)
        fused = None if self.fusion is None else begun(base, self.sight.between(seen.q), seen)
        return Known(own, turning, self.forecast.start(seen.w, seen.f), seen.t, np.zeros(len(seen.q)), fused)

    def fix(self, seen: Seen, known: Known, doubtful: frozenset[str] = frozenset()) -> tuple[Fix, Known]:
        """Return where the joints are and should be, and the next memory; `doubtful` sensors are not fused.

        The Jacobian is that of the first moment ahead, which errors do not mind: it is worked out but once.
        """
        elapsed, lead = seen.t - known.t, self.forecast.leads[0]
        turning = seen.gyro if self.source == "camera" else seen.w
        R = known.R.dot(exp3((known.turning + turning) * (elapsed / 2)))
        view = self.sight.view(seen.q + lead * known.v if lead else seen.q)
        against, carries = view.against, seen.w.dot(view.R)
        v = against.dot(carries - seen.gyro)
        R, actual, rate, fused = self.attitude(R, view, seen, known.fused, elapsed, doubtful)
        error = against.dot(log3(self.towards.dot(actual)))
        past = self.forecast.step(known.past, seen.t, seen.w, seen.f)
        ahead = self.ahead(seen, view, v, past)
        aim = Aim(seen.q + error, against.dot(carries + rate), ahead[0].a, ahead)
        return Fix(seen.q, v, aim, view.steep), Known(R, turning, past, seen.t, v, fused)

    def attitude(
        self, R: Array, view: View, seen: Seen, fused: Fused | None, elapsed: float, doubtful: frozenset[str]
    ) -> tuple[Array, Array, Array | float, Fused | None]:
        """Return what is integrated on, the camera's attitude, what to add to its rate, and fusion's memory."""
        if self.fusion is None or fused is None:
            return R, R if self.source == "camera" else R.dot(view.R), 0.0, None
        fused = fused.on(gyros(seen), elapsed)
        if doubtful:
            R, fused = self.unfused(R, seen, fused, doubtful)
            return R, R, 0.0, fused
        fused = self.fusion.compared(fused, R, self.sight.between(seen.q))
        return R, R.dot(exp3(fused.turn)), fused.rate, fused

    def unfused(self, R: Array, seen: Seen, fused: Fused, doubtful: frozenset[str]) -> tuple[Array, Fused]:
        """Return the camera's attitude and the fused memory while some sensor is in doubt: each by what is left.

        Without the camera's gyro its attitude is the platform's with the encoders between; without the platform's it
        is the other way round, and fusion begins anew.
        """
        base, between = fused.attitudes[0], self.sight.between(seen.q)
        if "gyro" in doubtful and not doubtful & {"w", "q"}:
            R = base @ between[0]
        elif "w" in doubtful and "q" not in doubtful:
            base = R @ between[0].T
        return R, begun(base, between, seen)._replace(ended=fused.ended)

    def ahead(self, seen: Seen, view: View, v: Array, past: Past) -> tuple[Ahead, ...]:
        """Return where the model is to be evaluated, for every lead; `view` is that of the first one."""
        out, true = [], seen.true if self.oracle else None
        bases = self.forecast.ahead(past) if true is None else true
        for k, (lead, base) in enumerate(zip(self.forecast.leads, bases)):
            q = seen.q + lead * v
            out.append(self.wished(q, self.sight.view(q) if k else view, base))
        return tuple(out)

    def stand_in(self, seen: Seen, rates: Array, alone: bool) -> Array:
        """Return what a lost camera gyro would say, rad/s, (3,), by the platform's gyro and the encoders' rates.

        Where the platform's gyro is lost, too (`alone`), the platform counts as standing.
        """
        return self.sight.rate(seen.q, rates, np.zeros(3) if alone else seen.w)

    def wished(self, q: Array, view: View, base: Carried) -> Ahead:
        """Return the joints' rates and accelerations that keep the camera's attitude on a platform that moves so."""
        v = view.against.dot(base.w.dot(view.R))
        if not self.accelerates:
            return Ahead(q, v, np.zeros_like(q), base)
        return Ahead(q, v, view.against.dot(self.sight.drift(q, v, base.w, base.dw)), base)


def begun(base: Array, between: tuple[Array, ...], seen: Seen) -> Fused:
    """Return the memory of a fusion that begins with the platform's attitude in the world."""
    camera = base @ between[0]
    return Fused.begun([base, *[camera @ to.T for to in between[1:]]], gyros(seen))


def gyros(seen: Seen) -> Array:
    """Rates of all gyros but the camera's, the platform's first, rad/s, (L, 3)."""
    return np.concatenate([seen.w, seen.links]).reshape(-1, 3)


def attitude(yaw: float, pitch: float, roll: float = 0.0) -> Array:
    """``Rz(yaw) Ry(pitch) Rx(roll)``, rad → (3, 3)."""
    return np.asarray(pin.rpy.rpyToMatrix(roll, pitch, yaw))


def carried(row: Array) -> Carried:
    """Return a platform's motion from its rate, specific force and angular acceleration in one row, (9,)."""
    return Carried(row[3:6], row[:3], row[6:9])
