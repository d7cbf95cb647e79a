"""From the sensors to the camera's attitude, the platform's motion, and where the joints should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.control.laws.base import Ahead, Aim
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.forecast import Forecast, Past
from gimbal_pin.pointing.level import Level, Upright
from gimbal_pin.pointing.measurement import Measurement
from gimbal_pin.pointing.result import SLOW
from gimbal_pin.pointing.sight import Sight, View
from gimbal_pin.pointing.turn import Gaze, Pace, Turn
from gimbal_pin.rig.brief import brief

exp3 = pin.exp3
log3 = pin.log3
SPAN = 1 / (2 * pi * SLOW)
"""Time over which gaps are looked at, s: what changes them slower than `SLOW` is drift."""
GAP_DEVIATIONS = 5.0
"""Deviations of the sensors' noise beyond which a gap is none of it: by chance once in 43 h on nine channels, whose
values are independent after `SPAN`."""
FAINT = 1e-5
"""Least deviation, rad: `GAP_DEVIATIONS` times that is 0.003°, below which no gap harms."""


class Fused(NamedTuple):
    """What fusion remembers, one entry per other gyro.

    Attributes:
        attitudes: Attitudes in the world, each integrated from its own gyro, (3, 3).
        rates: Rates at the last sample, rad/s, (L, 3).
        gaps: What they make of the camera's attitude less what its own gyro makes of it, smoothed, rad, (L, 3).
        turn: What to turn the camera's attitude by, rad, (3,).
        rate: What to add to its rate, rad/s, (3,).
        slow: The gaps behind a low-pass of `SPAN`, rad, (L, 3).
        ended: Whether a gap was beyond the gyros' noise: then nothing is fused any more, and the turn stays.
    """

    attitudes: tuple[Array, ...]
    rates: Array
    gaps: Array
    turn: Array
    rate: Array
    slow: Array
    ended: bool = False

    @staticmethod
    def begun(attitudes: Sequence[Array], rates: Array) -> Fused:
        """Memory for attitudes that are known, where the gyros read `rates`, rad/s, (L, 3)."""
        still = np.zeros_like(rates)
        zero = np.zeros(3)
        return Fused(tuple(attitudes), rates, still, zero, zero, still)

    def on(self, rates: Array, elapsed: float) -> Fused:
        """Return the memory after a sample."""
        turns = (self.rates + rates) * (elapsed / 2)
        attitudes = tuple([R.dot(exp3(turn)) for R, turn in zip(self.attitudes, turns)])
        return Fused(attitudes, rates, *self[2:])


@dataclass(frozen=True)
class Fusion:
    """``R̂ = R exp(Σ ŷ_i / M)``, ``ŷ_i⁺ = ŷ_i + k (log(Rᵀ R_i R_ic(q)) - ŷ_i)``: the mean of M gyros' attitudes.

    The camera's own motion is in none of the gaps y: they hold the gyros' noise alone, which walks, and the encoders',
    which is white. So k, Kalman's gain for that, may be as slow as it likes: it is in no loop, and costs no margin.
    A gyro of a wrong scale, mounted askew or with a bias puts the motion into its gap: a gap that changes by more than
    the noise of gyros and encoders explains ends the fusion.

    Attributes:
        gyro: Density of the gyros' noise, rad/s/√Hz.
        step: Angle of one encoder step, rad.
        dt: Sampling interval, s.
    """

    gyro: float
    step: float
    dt: float

    @cached_property
    def gain(self) -> float:
        """k: of a walk whose steps are two gyros' noise over a sample, seen with an encoder's rounding."""
        walk = self.gyro**2 * self.dt
        white = max(self.step, 1e-9) ** 2 / 12
        ratio = walk / white
        return float((sqrt(ratio**2 + 4 * ratio) - ratio) / 2)

    @property
    def share(self) -> float:
        """Share of a gap in its slow part, per sample."""
        return min(1.0, self.dt / SPAN)

    @cached_property
    def bound(self) -> float:
        """Largest change of a gap over `SPAN` that is noise, rad.

        Two gyros' walks gain ``gyro²`` a second, of which a high-pass of that time leaves half; three encoders round.
        """
        return GAP_DEVIATIONS * max(sqrt(self.gyro**2 * SPAN / 2 + 3 * self.step**2 / 12), FAINT)

    def compared(self, memory: Fused, camera: Array, between: Sequence[Array]) -> Fused:
        """Return the memory after a comparison.

        Args:
            memory: The memory at this sample.
            camera: Attitude that the camera's own gyro gives, (3, 3).
            between: Attitude of the camera in each other gyro's link, (3, 3).
        """
        if memory.ended:
            return memory
        own = camera.T
        seen = np.array([log3(own.dot(R.dot(to))) for R, to in zip(memory.attitudes, between)])
        gaps = memory.gaps + self.gain * (seen - memory.gaps)
        slow = memory.slow + self.share * (gaps - memory.slow)
        if max(map(abs, (gaps - slow).ravel().tolist())) > self.bound:
            return memory._replace(rate=np.zeros(3), ended=True)
        turn = np.add.reduce(gaps) / (len(gaps) + 1)
        return Fused(
            memory.attitudes, memory.rates, gaps, turn, (turn - memory.turn) / self.dt, slow
        )


class Known(NamedTuple):
    """What navigation remembers.

    Attributes:
        R: The camera's attitude in the world, integrated from its gyro, (3, 3).
        turning: The rate that was integrated last, rad/s, (3,).
        past: What the forecast remembers.
        t: Time of the sample, s.
        v: Joint rates, rad/s, (n,).
        wanted: The attitude that is kept, or turned to, in the world, (3, 3).
        fused: What fusion remembers; None without it.
        turns: The ways to that attitude, one after the other; none: it is kept.
        upright: What levelling remembers; None without it.
    """

    R: Array
    turning: Array
    past: Past
    t: float
    v: Array
    wanted: Array
    fused: Fused | None = None
    turns: tuple[Turn, ...] = ()
    upright: Upright | None = None

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
    """Inverse kinematics of a wanted attitude from what the sensors say.

    ``q̇ = J⁻¹(ω_c - Rᵀ ω)``, ``e = -J⁻¹ log(R_dᵀ R)``, ``ė = J⁻¹(ω_d - ω_c)``, ``q̇_d = q̇ + ė = J⁻¹(ω_d - Rᵀ ω)``, and
    ``q̈_d = J⁻¹(ω̇_d - α(q, q̇_d, ω, ω̇))`` with α the camera's angular acceleration while the joints do not accelerate.
    ω_d is zero but for the turn from where the camera looks at the start to where it shall look.

    Attributes:
        sight: Kinematics of the camera.
        wanted: R_d, the camera's attitude in the world, (3, 3).
        dt: Sampling interval, s.
        forecast: The platform's motion, ahead by as much as each distinct drive of the law is late; or now.
        pace: How fast the camera is turned to where it shall look.
        accelerates: False takes no wanted acceleration from inverse kinematics.
        fusion: Brings the other gyros in; None: the camera's attitude comes from its own alone.
        level: Keeps the world of the gyros level by the accelerometer; None: nothing does.
    """

    sight: Sight
    wanted: Array
    dt: float
    forecast: Forecast
    pace: Pace
    accelerates: bool = True
    fusion: Fusion | None = None
    level: Level | None = None

    __repr__ = brief

    def start(self, seen: Measurement, camera: Array, base: Array) -> Known:
        """Memory at the first sample, where the attitudes in the world of camera and base link are known, (3, 3)."""
        fused = None if self.fusion is None else begun(base, self.sight.between(seen.q), seen)
        past = self.forecast.start(seen.w, seen.f)
        upright = None if self.level is None else self.level.start(sure=True)
        known = Known(
            camera, seen.gyro, past, seen.t, np.zeros(len(seen.q)), self.wanted, fused, (), upright
        )
        return self.hold(known, seen.q, base, self.wanted)

    def camera(self, known: Known, q: Array) -> Array:
        """Attitude of the camera in the world at the last sample, whose angles are q, (3, 3)."""
        own = known.R if known.fused is None else known.R.dot(exp3(known.fused.turn))
        return np.asarray(own if known.upright is None else known.upright.turn.dot(own))

    def hold(self, known: Known, q: Array, base: Array, wanted: Array) -> Known:
        """Memory in which a turn that is on comes to rest, and the camera then turns to a wanted attitude, (3, 3).

        q are the angles at the last sample, rad, (n,), and base the base link's attitude in the world, (3, 3).
        """
        turns = tuple(
            [turn.stopped(known.t) for turn in known.turns if turn.begun <= known.t < turn.end]
        )
        t = known.t
        for turn in turns:
            q = self.sight.reached(base, turn.base @ self.sight.attitude(turn.goal), q)
            t = turn.end
        way = self.pace.turn(self.sight, base, q, wanted, t)
        return known._replace(wanted=wanted, turns=turns if way is None else (*turns, way))

    def gaze(self, known: Known, t: float) -> Gaze | None:
        """Where the camera should look at a time while it turns; None while it is kept as wanted."""
        return next((turn.gaze(t, self.sight) for turn in known.turns if t < turn.end), None)

    def fix(
        self, seen: Measurement, known: Known, doubtful: frozenset[str] = frozenset()
    ) -> tuple[Fix, Known]:
        """Return where the joints are and should be, and the next memory; `doubtful` sensors are not fused.

        The Jacobian is that of the first moment ahead, which errors do not mind: it is worked out but once.
        """
        elapsed = seen.t - known.t
        lead = self.forecast.leads[0]
        R = known.R.dot(exp3((known.turning + seen.gyro) * (elapsed / 2)))
        view = self.sight.view(seen.q + lead * known.v if lead else seen.q)
        against = view.against
        carries = seen.w.dot(view.R)
        v = against.dot(carries - seen.gyro)
        R, actual, rate, fused = self.attitude(R, seen, known.fused, elapsed, doubtful)
        upright = known.upright
        if self.level is not None and upright is not None:
            upright = self.level.step(
                upright, actual.dot(self.sight.attitude(seen.q).T.dot(seen.f))
            )
            actual = upright.turn.dot(actual)
        gaze = self.gaze(known, seen.t)
        past = self.forecast.step(known.past, seen.t, seen.w, seen.f)
        after = Known(
            R, seen.gyro, past, seen.t, v, known.wanted, fused, known.turns if gaze else (), upright
        )
        error = against.dot(log3((known.wanted if gaze is None else gaze.R).T.dot(actual)))
        ahead = self.ahead(seen, view, after)
        wished = carries + rate if gaze is None else carries + rate - gaze.w
        aim = Aim(seen.q + error, against.dot(wished), ahead[0].a, ahead)
        return Fix(seen.q, v, aim, view.steep), after

    def attitude(
        self,
        R: Array,
        seen: Measurement,
        fused: Fused | None,
        elapsed: float,
        doubtful: frozenset[str],
    ) -> tuple[Array, Array, Array | float, Fused | None]:
        """Return what is integrated on, the camera's attitude, what to add to its rate, and fusion's memory.

        While a sensor is doubtful nothing is fused. Without the camera's gyro its attitude is the platform's with the
        encoders between; without the platform's it is the other way round; and fusion begins anew.
        """
        if self.fusion is None or fused is None:
            return R, R, 0.0, None
        fused = fused.on(gyros(seen), elapsed)
        between = self.sight.between(seen.q)
        if not doubtful:
            fused = self.fusion.compared(fused, R, between)
            return R, R.dot(exp3(fused.turn)), fused.rate, fused
        R = R.dot(exp3(fused.turn))
        base = fused.attitudes[0]
        if "gyro" in doubtful and not doubtful & {"w", "q"}:
            R = base @ between[0]
        elif "w" in doubtful and "q" not in doubtful:
            base = R @ between[0].T
        return R, R, 0.0, begun(base, between, seen)._replace(ended=fused.ended)

    def ahead(self, seen: Measurement, view: View, known: Known) -> tuple[Ahead, ...]:
        """Return rates and accelerations of the joints that are asked for at every lead; `view`: at the first."""
        bases = self.forecast.ahead(known.past)
        v = known.v
        out = []
        for k, (lead, base) in enumerate(zip(self.forecast.leads, bases)):
            q = seen.q + lead * v
            there = self.sight.view(q) if k else view
            gaze = self.gaze(known, seen.t + lead)
            carries = base.w.dot(there.R)
            rates = there.against.dot(carries if gaze is None else carries - gaze.w)
            drift = self.sight.drift(q, rates, base.w, base.dw) if self.accelerates else np.zeros(3)
            a = there.against.dot(drift if gaze is None else drift - gaze.dw)
            out.append(Ahead(q, rates, a, base))
        return tuple(out)


def begun(base: Array, between: tuple[Array, ...], seen: Measurement) -> Fused:
    """Return the memory of a fusion that begins with the platform's attitude in the world."""
    camera = base @ between[0]
    return Fused.begun([base, *[camera @ to.T for to in between[1:]]], gyros(seen))


def gyros(seen: Measurement) -> Array:
    """Rates of all gyros but the camera's, the platform's first, rad/s, (L, 3)."""
    return np.concatenate([seen.w, seen.links]).reshape(-1, 3)


def attitude(yaw: float, pitch: float, roll: float = 0.0) -> Array:
    """``Rz(yaw) Ry(pitch) Rx(roll)``, rad → (3, 3)."""
    return np.asarray(pin.rpy.rpyToMatrix(roll, pitch, yaw))
