"""What the two controllers that hold a camera are made of: computed torque that foresees the platform, and a PID."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from gimbal_pin.control.controller_names import BASELINE, OURS
from gimbal_pin.control.laws import ComputedTorque, JointPid, Margins, Pid
from gimbal_pin.control.laws.base import Law
from gimbal_pin.control.laws.carried import CarriedTorque
from gimbal_pin.control.laws.design import small_error_gains
from gimbal_pin.control.laws.equal_margin import (
    OUTER_DAMPING,
    OUTER_INTEGRAL,
    EqualMarginLoop,
    bandwidth,
)
from gimbal_pin.control.laws.uncertainty import columns, compute_inertia, estimate
from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.forecast import Forecast, Spectrum
from gimbal_pin.pointing.guard import Guard
from gimbal_pin.pointing.navigator import Fusion, Navigator
from gimbal_pin.pointing.pointer import Pointer
from gimbal_pin.pointing.sight import Sight, holding
from gimbal_pin.pointing.turn import Pace
from gimbal_pin.rig.config import Noise

FALLEN = 0.5
"""Share of the bandwidth of the PID that is fallen back to."""
SAMPLES = 200
"""Moments at which a model is judged."""


@dataclass(frozen=True, eq=False)
class Recipe:
    """What the controllers that hold a camera share.

    Attributes:
        model: The model that they know.
        wanted: R_d, the camera's attitude in the world, (3, 3).
        spectrum: How the platform is known to move.
        noise: Noise densities of the IMUs.
        step: Angle of one encoder step, rad.
        trusted: Joints at which the model is worth more than its uncertainty; empty: all. The others get a PID.
        dt: Sampling interval, s.
        delay: Samples from measurement to torque, the drives' own not counted.
        law: Whose gains the controller of its kind has; None: both have loops of one disk margin.
        learns: Whether the forecast learns in flight.
    """

    model: Model
    wanted: Array
    spectrum: Spectrum
    noise: Noise
    step: float
    trusted: tuple[bool, ...] = ()
    dt: float = 0.001
    delay: int = 1
    law: JointPid | ComputedTorque | None = None
    learns: bool = True

    names: ClassVar[tuple[str, ...]] = (BASELINE, OURS)

    @cached_property
    def sight(self) -> Sight:
        """Kinematics of the camera."""
        return Sight(self.model.rig)

    @cached_property
    def equals(self) -> tuple[EqualMarginLoop, ...]:
        """Per joint its loops of one disk margin; joints whose drives are alike share them."""
        made = {
            drive: EqualMarginLoop(self.dt, self.delay * self.dt, drive)
            for drive in self.model.drives
        }
        return tuple(made[drive] for drive in self.model.drives)

    @property
    def kind(self) -> str:
        """Name of the controller that has the gains of `law`."""
        return BASELINE if isinstance(self.law, JointPid) else OURS

    def margins(self, name: str) -> tuple[Margins, ...]:
        """Return the margins of a controller's loops, joint by joint, with the drives that the model knows."""
        gains = tuple(own.pid for own in self.equals)
        if self.law is not None and name == self.kind:
            gains = small_error_gains(
                self.law.gains, self.law.robust if isinstance(self.law, ComputedTorque) else None
            )
        return tuple(equal.of(pid) for equal, pid in zip(self.equals, gains))

    def navigator(self, gains: tuple[Pid, ...], foresees: bool) -> Navigator:
        """Return navigation for outer loops; the slowest of those that share a drive weighs its forecast.

        `foresees`: whether the platform's motion is predicted to where each drive acts, and all gyros are fused.
        """
        late = self.model.late(self.dt)
        distinct = sorted(set(late))
        slowest = [
            min((pid for pid, x in zip(gains, late) if x == own), key=lambda pid: pid.kp)
            for own in distinct
        ]
        leads = tuple((self.delay + 0.5) * self.dt + own if foresees else 0.0 for own in distinct)
        fusion = Fusion(self.noise.gyro, self.step, self.dt) if foresees else None
        forecast = Forecast(self.spectrum, tuple(slowest), self.dt, leads, self.learns)
        own = (self.sight, self.wanted, self.dt, forecast, Pace.of(self.model))
        return Navigator(*own, accelerates=foresees, fusion=fusion)

    def pointer(self, name: str = OURS) -> Pointer:
        """Return a controller with its guard, and a PID of half the bandwidth to fall back to.

        Raises:
            UsageError: There is none of that name.
        """
        law = self.law if name == self.kind else None
        gains = tuple(own.pid for own in self.equals) if law is None else law.gains
        own: Law
        if name == BASELINE:
            own = self.pid(gains) if law is None else replace(law, dt=self.dt)
        elif name == OURS:
            doubted = () if all(self.trusted) else self.trusted
            robust = law.robust if isinstance(law, ComputedTorque) else None
            own = CarriedTorque(self.model, gains, self.dt, robust=robust, trusted=doubted)
        else:
            raise UsageError(
                "controller", f"'{name}' is unknown", f"there are {', '.join(self.names)}"
            )
        noisy = self.noise.gyro > 0 and self.noise.accelerometer > 0
        slower = tuple(
            Pid.placed(FALLEN * bandwidth(equal.pid), OUTER_DAMPING, OUTER_INTEGRAL)
            for equal in self.equals
        )
        return Pointer(
            self.navigator(gains, name == OURS), own, Guard(self.dt, noisy), self.pid(slower)
        )

    def pid(self, gains: tuple[Pid, ...]) -> JointPid:
        """Return a PID on the inertias that the joints have where the camera looks as wanted."""
        seen = np.diagonal(compute_inertia(self.model, self.looking[None])[0]).tolist()
        limits = tuple(self.model.tau_max.tolist())
        endless = self.model.rig.continuous
        return JointPid(gains, tuple(seen), limits, self.dt, continuous=endless)

    @cached_property
    def looking(self) -> Array:
        """Angles at which the camera looks as wanted from a level platform, rad, (n,)."""
        return self.sight.reached(np.eye(3), self.wanted, self.sight.home)


def find_trusted_joints(model: Model, wanted: Array, platform: Platform) -> tuple[bool, ...]:
    """Return, per joint, whether the estimated torque says more than its deviation: ``rms(Y P Yᵀ) < var(Y θ)``.

    Both along the motion that holds the camera on the given platform. What a PID's integral finds by itself, the mean
    of the torque, counts for nothing. A model that was never identified is believed.

    Args:
        model: The model, with its covariance.
        wanted: The camera's attitude in the world, (3, 3).
        platform: A motion of the platform with its attitude.
    """
    known = estimate(model)
    if known is None:
        return (True,) * model.rig.n
    part = platform.part(slice(None, None, max(1, len(platform) // SAMPLES)))
    held = holding(Sight(model.rig), wanted, part)
    Y = columns(model, known[1], held.q, held.v, held.a, part)
    variance = np.einsum("njk,kl,njl->nj", Y, known[0].covariance, Y)
    torque = model.inverse_dynamics(held.q, held.v, held.a, platform=part)
    return tuple((variance.mean(axis=0) < torque.var(axis=0)).tolist())
