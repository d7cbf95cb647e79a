"""Every controller that can hold a camera, by name, at equal margins: from the joint PID to the oracle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from gimbal_pin.control.controllers import COMPILED, HOLDING, ORACLE, OURS, TUNED
from gimbal_pin.control.laws import ComputedTorque, JointPid, Margins, Pid, Robust, bounds
from gimbal_pin.control.laws.base import Law
from gimbal_pin.control.laws.carried import CarriedTorque
from gimbal_pin.control.laws.design import inner
from gimbal_pin.control.laws.equal import DAMPING, INTEGRAL, Equal, bandwidth, redesigned
from gimbal_pin.control.laws.observer import observed_margins
from gimbal_pin.control.laws.uncertainty import inertia
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import name_columns
from gimbal_pin.errors import UsageError, digits
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.forecast import Forecast, Spectrum
from gimbal_pin.pointing.guard import Guard
from gimbal_pin.pointing.navigator import ErrorFrom, Fusion, Navigator
from gimbal_pin.pointing.pointer import Holder, Pointer
from gimbal_pin.pointing.result import SLOW
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.rig.config import Noise

FALLEN = 0.5
"""Share of the bandwidth of the PID that is fallen back to."""


@dataclass(frozen=True, eq=False)
class Loops:
    """One loop per joint for every law, all of one disk margin with the drives that the model knows.

    Attributes:
        model: What is known.
        dt: Sampling interval, s.
        delay: Samples from measurement to torque, the drives' own not counted.
    """

    model: Model
    dt: float
    delay: int

    @cached_property
    def equals(self) -> tuple[Equal, ...]:
        """The loops of each joint; those whose drives are alike share them."""
        made = {drive: Equal(self.dt, self.delay * self.dt, drive) for drive in self.model.drives}
        return tuple(made[drive] for drive in self.model.drives)

    @property
    def pid(self) -> tuple[Pid, ...]:
        """The nominal outer loop."""
        return tuple(equal.pid for equal in self.equals)

    @cached_property
    def robust(self) -> Robust:
        """Lyapunov redesign on top of the joints' slow loops."""
        return redesigned(self.equals, bounds(self.model, np.random.default_rng(0)))

    @cached_property
    def late(self) -> tuple[float, ...]:
        """Time by which each drive acts late, s, (n)."""
        return self.model.late(self.dt)

    @cached_property
    def leads(self) -> tuple[float, ...]:
        """Time from a sample to the middle of the hold of its torque, s, one per distinct drive."""
        return tuple((self.delay + 0.5) * self.dt + late for late in sorted(set(self.late)))

    def per_lead(self, gains: Sequence[Pid]) -> tuple[Pid, ...]:
        """Return the slowest of the joints' loops, per distinct drive: what its forecast is weighted by."""
        return tuple(
            min((pid for pid, own in zip(gains, self.late) if own == late), key=lambda pid: pid.kp)
            for late in sorted(set(self.late))
        )

    def of(self, name: str) -> tuple[tuple[Pid, ...], dict[str, Any]]:
        """Return the outer loops of a model-based controller, and what of `CarriedTorque` goes with them."""
        if name == "with-observer":
            own = {"observers": tuple(equal.observer for equal in self.equals)}
            return tuple(equal.observed for equal in self.equals), own
        if name == "lyapunov":
            return tuple(equal.slow for equal in self.equals), {"robust": self.robust}
        return self.pid, {}

    def margins(self, name: str, law: JointPid | ComputedTorque | None = None) -> tuple[Margins, ...]:
        """Return the margins of a controller's loops, joint by joint; those of `law`, where one is given."""
        if name == "with-observer":
            return tuple(observed_margins(e.observed, e.observer, e.delay, e.drive) for e in self.equals)
        gains, extra = (law.gains, vars(law)) if law is not None else self.of(name)
        return tuple(equal.of(pid) for equal, pid in zip(self.equals, inner(gains, extra.get("robust"))))


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
    law: Law | None = None
    machine: Machine | None = None
    learns: bool = True

    @cached_property
    def sight(self) -> Sight:
        """Kinematics of the camera."""
        return Sight(self.model.rig)

    @cached_property
    def loops(self) -> Loops:
        """The outer loops, joint by joint."""
        return Loops(self.model, self.dt, self.delay)

    @property
    def given(self) -> JointPid | ComputedTorque | None:
        """The law whose gains "tuned" has."""
        return self.law if isinstance(self.law, (JointPid, ComputedTorque)) else None

    def margins(self, name: str) -> tuple[Margins, ...]:
        """Return the margins of a controller's loops, joint by joint, with the drives that the model knows."""
        return self.loops.margins(name, self.given if name in (TUNED, COMPILED) else None)

    def navigator(self, gains: tuple[Pid, ...], predicts: bool = False, fuses: bool = False) -> Navigator:
        """Return navigation for the joints' outer loops."""
        leads = self.loops.leads if predicts else (0.0,) * len(self.loops.leads)
        fusion = Fusion(self.noise.gyro, self.step, self.dt) if fuses else None
        forecast = Forecast(self.spectrum, self.loops.per_lead(gains), self.dt, leads, self.learns)
        return Navigator(self.sight, self.wanted, self.dt, forecast, fusion=fusion)

    def holder(self, name: str) -> Holder:
        """Return one controller, or the compiled one; raise `UsageError` if there is none of that name."""
        if name == COMPILED and self.machine is not None and self.given is not None:
            return self.machine.holding(self.tuned(self.given))
        return self.pointer(name)

    def pointer(self, name: str) -> Pointer:
        """Return one controller.

        Raises:
            UsageError: There is none of that name.
        """
        if name == TUNED and self.given is not None:
            return self.tuned(self.given)
        if name not in NAMES:
            raise UsageError("controller", f"'{name}' is unknown", f"there are {', '.join(NAMES)}")
        gains, extra = self.loops.of(name)
        if name in NAMES[:3]:  # they know nothing of the platform's acceleration
            navigator = replace(self.navigator(gains), accelerates=False)
            if name == "computed-torque-fixed":
                return self.guarded(navigator, ComputedTorque(replace(self.model, terms=()), gains, self.dt))
            source: ErrorFrom = "platform" if name == "pid-joint" else "camera"
            return self.guarded(replace(navigator, source=source), self.pid(gains))
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
        slower = tuple(Pid.placed(FALLEN * bandwidth(pid), DAMPING, INTEGRAL) for pid in self.loops.pid)
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
