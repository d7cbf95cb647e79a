"""Every controller that can hold a camera, by name, at equal margins: from the joint PID to the oracle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from gimbal_pin.control.controllers import BASELINE, COMPILED, HOLDING, ORACLE, OURS, TUNED
from gimbal_pin.control.laws import ComputedTorque, JointPid, Margins, Pid, bounds
from gimbal_pin.control.laws.base import Law
from gimbal_pin.control.laws.carried import CarriedTorque
from gimbal_pin.control.laws.design import inner
from gimbal_pin.control.laws.equal import DAMPING, INTEGRAL, Equal, bandwidth, redesigned
from gimbal_pin.control.laws.observer import observed_margins
from gimbal_pin.control.laws.uncertainty import columns, estimate, inertia
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import name_columns
from gimbal_pin.errors import UsageError, digits
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.forecast import Forecast, Spectrum
from gimbal_pin.pointing.guard import Guard
from gimbal_pin.pointing.navigator import Fusion, Navigator
from gimbal_pin.pointing.pointer import Holder, Pointer
from gimbal_pin.pointing.result import SLOW
from gimbal_pin.pointing.sight import Sight, holding
from gimbal_pin.pointing.turn import Pace
from gimbal_pin.rig.config import Noise

FALLEN = 0.5
"""Share of the bandwidth of the PID that is fallen back to."""


def slack(loops: Mapping[str, tuple[Margins, ...]], joints: Sequence[str]) -> tuple[str, ...]:
    """Say whose loops (controller → margins by joint) are too slow to hold the camera: all above `SLOW` is jitter."""
    return tuple(
        f"{', '.join(names)} does not hold the camera: {', '.join(places)} crosses at {digits(own.crossover_hz)} Hz, "
        f"and all above {SLOW:g} Hz is jitter"
        for names, places, own in distinct(loops, joints)
        if own.crossover_hz < SLOW
    )


def distinct(
    loops: Mapping[str, tuple[Margins, ...]], joints: Sequence[str]
) -> list[tuple[list[str], list[str], Margins]]:
    """Return controllers and joints that have the same margins, with these; `loops`: controller → margins by joint."""
    same: dict[tuple[Margins, ...], list[str]] = {}
    for name, found in loops.items():
        same.setdefault(found, []).append(name)
    return [
        (names, [joint for joint, other in zip(joints, found) if other == own], own)
        for found, names in same.items()
        for own in dict.fromkeys(found)
    ]


NAMES = tuple(HOLDING)
"""All controllers."""


class Machine(Protocol):
    """A compiled controller."""

    def holding(self, beside: Pointer) -> Holder:
        """Return it as what holds the camera, beside the Python controller that it was exported from."""


@dataclass(frozen=True, eq=False)
class Roster:
    """What all controllers of one comparison share.

    Attributes:
        model: The model that they know.
        wanted: R_d, the camera's attitude in the world, (3, 3).
        spectrum: How the platform is known to move.
        noise: Noise densities of the IMUs.
        step: Angle of one encoder step, rad.
        trusted: Joints at which the model is worth more than its uncertainty.
        dt: Sampling interval, s.
        delay: Samples from measurement to torque, the drives' own not counted.
        law: Whose gains "tuned" has; None: there is no such controller.
        machine: What "compiled" runs; None: there is no such controller.
        learns: Whether forecasts learn in flight.
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
    machine: Machine | None = None
    learns: bool = True

    @cached_property
    def sight(self) -> Sight:
        """Kinematics of the camera."""
        return Sight(self.model.rig)

    @cached_property
    def equals(self) -> tuple[Equal, ...]:
        """Per joint one loop for every law, all of one disk margin; joints whose drives are alike share them."""
        made = {drive: Equal(self.dt, self.delay * self.dt, drive) for drive in self.model.drives}
        return tuple(made[drive] for drive in self.model.drives)

    @cached_property
    def lateness(self) -> tuple[float, ...]:
        """Distinct times by which drives act late, s."""
        return tuple(sorted(set(self.model.late(self.dt))))

    @property
    def leads(self) -> tuple[float, ...]:
        """Time from a sample to the middle of the hold of its torque, s, one per distinct drive."""
        return tuple((self.delay + 0.5) * self.dt + late for late in self.lateness)

    def choose_loops(self, name: str) -> tuple[tuple[Pid, ...], dict[str, Any]]:
        """Return a controller's outer loops, and what of `CarriedTorque` goes with them."""
        if name == "with-observer":
            return tuple(own.observed for own in self.equals), {"observers": tuple(own.observer for own in self.equals)}
        if name == "lyapunov":
            robust = redesigned(self.equals, bounds(self.model, np.random.default_rng(0)))
            return tuple(own.slow for own in self.equals), {"robust": robust}
        return tuple(own.pid for own in self.equals), {}

    def margins(self, name: str) -> tuple[Margins, ...]:
        """Return the margins of a controller's loops, joint by joint, with the drives that the model knows."""
        if name == "with-observer":
            return tuple(observed_margins(e.observed, e.observer, e.delay, e.drive) for e in self.equals)
        law = self.law if name in (TUNED, COMPILED) else None
        gains, extra = self.choose_loops(name) if law is None else (law.gains, vars(law))
        return tuple(equal.of(pid) for equal, pid in zip(self.equals, inner(gains, extra.get("robust"))))

    def navigator(self, gains: tuple[Pid, ...], predicts: bool = False, fuses: bool = False) -> Navigator:
        """Return navigation for outer loops; the slowest of those that share a drive weighs its forecast."""
        rows = list(zip(gains, self.model.late(self.dt)))
        slowest = [min((pid for pid, late in rows if late == own), key=lambda pid: pid.kp) for own in self.lateness]
        leads = self.leads if predicts else (0.0,) * len(slowest)
        fusion = Fusion(self.noise.gyro, self.step, self.dt) if fuses else None
        forecast = Forecast(self.spectrum, tuple(slowest), self.dt, leads, self.learns)
        return Navigator(self.sight, self.wanted, self.dt, forecast, self.pace, fusion=fusion)

    @cached_property
    def pace(self) -> Pace:
        """How fast the camera is turned to where it shall look."""
        return Pace.of(self.model)

    def holder(self, name: str) -> Holder:
        """Return one controller, or the compiled one; raise `UsageError` if there is none of that name."""
        if name == COMPILED and self.machine is not None and self.law is not None:
            return self.machine.holding(self.tuned(self.law))
        return self.pointer(name)

    def pointer(self, name: str) -> Pointer:
        """Return one controller.

        Raises:
            UsageError: There is none of that name.
        """
        if name == TUNED and self.law is not None:
            return self.tuned(self.law)
        if name not in NAMES:
            raise UsageError("controller", f"'{name}' is unknown", f"there are {', '.join(NAMES)}")
        gains, extra = self.choose_loops(name)
        if name in NAMES[:3]:  # they know nothing of the platform's acceleration
            navigator = replace(self.navigator(gains), accelerates=False)
            if name == "computed-torque-fixed":
                return self.guarded(navigator, ComputedTorque(replace(self.model, terms=()), gains, self.dt))
            by_platform = name == "pid-joint"
            return self.guarded(replace(navigator, by_platform=by_platform), self.pid(gains))
        rank = NAMES.index(name)
        predicts, fuses = rank >= NAMES.index("with-prediction"), rank >= NAMES.index("with-gyros")
        navigator = replace(self.navigator(gains, predicts, fuses), oracle=name == ORACLE)
        model = without_hidden(self.model) if name == "without-hidden" else self.model
        law = CarriedTorque(model, gains, self.dt, rank > NAMES.index("computed-torque"), **extra)
        return self.guarded(navigator, replace(law, trusted=self.doubted) if name == OURS else law)

    @property
    def doubted(self) -> tuple[bool, ...]:
        """`trusted`, where it leaves any joint to a PID; else nothing."""
        return () if all(self.trusted) else self.trusted

    def tuned(self, law: JointPid | ComputedTorque) -> Pointer:
        """Return ours with the gains and the redesign of a given law; with those of a PID, a world-frame PID."""
        if isinstance(law, JointPid):
            return self.guarded(replace(self.navigator(law.gains), accelerates=False), replace(law, dt=self.dt))
        carried = CarriedTorque(self.model, law.gains, self.dt, robust=law.robust, trusted=self.doubted)
        # The compiled controller beside it does not learn in flight.
        own = self if self.machine is None else replace(self, learns=False)
        return self.guarded(own.navigator(law.gains, predicts=True, fuses=True), carried)

    def guarded(self, navigator: Navigator, law: Law) -> Pointer:
        """Return a controller with its guard, and a PID of lower bandwidth to fall back to."""
        noisy = self.noise.gyro > 0 and self.noise.accelerometer > 0
        slower = tuple(Pid.placed(FALLEN * bandwidth(pid), DAMPING, INTEGRAL) for pid in self.choose_loops(BASELINE)[0])
        return Pointer(navigator, law, Guard(self.dt, noisy), self.pid(slower))

    def pid(self, gains: tuple[Pid, ...]) -> JointPid:
        """Return a PID on the inertias that the joints have where the camera looks as wanted."""
        seen = np.diagonal(inertia(self.model, self.looking[None])[0]).tolist()
        return JointPid(gains, tuple(seen), tuple(self.model.tau_max.tolist()), self.dt)

    @cached_property
    def looking(self) -> Array:
        """Angles at which the camera looks as wanted from a level platform, rad, (n,)."""
        return self.sight.reached(np.eye(3), self.wanted, self.sight.home)


def without_hidden(model: Model) -> Model:
    """Return the model with what only a moving base shows dropped: the least moments that give the same on a fixed one.

    ``min ‖φ'‖`` over first and second moments with ``M φ' = M φ``, M the mixing of a fixed base; masses stay.
    """
    rig = model.rig
    names, places = name_columns(rig)
    mixing, phi = reduce_parameters(rig, base="fixed").mixing, rig.phi
    free = np.array([not name.endswith(".m") for name in names])
    left = mixing @ phi[places] - mixing[:, ~free] @ phi[places[~free]]
    phi[places[free]] = np.linalg.pinv(mixing[:, free]) @ left
    return replace(model, rig=rig.with_phi(phi))


SAMPLES = 200
"""Moments at which the model is judged."""


def trusted(model: Model, wanted: Array, platform: Platform) -> tuple[bool, ...]:
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
    part, held, Y = along(model, known[1], wanted, platform)
    variance = np.einsum("njk,kl,njl->nj", Y, known[0].covariance, Y)
    torque = model.inverse(held.q, held.v, held.a, platform=part)
    return tuple((variance.mean(axis=0) < torque.var(axis=0)).tolist())


def along(model: Model, places: Array, wanted: Array, platform: Platform) -> tuple[Platform, Motion, Array]:
    """Return moments of a platform's motion, what holds the camera there, and torque per unit parameter, (N, n, k)."""
    part = platform.part(slice(None, None, max(1, len(platform) // SAMPLES)))
    held = holding(Sight(model.rig), wanted, part)
    return part, held, columns(model, places, held.q, held.v, held.a, part)
