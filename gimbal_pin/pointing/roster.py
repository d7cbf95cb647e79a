"""Every controller that can hold a camera, by name, at equal margins: from the joint PID to the oracle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from gimbal_pin.control.controllers import COMPILED, HOLDING, ORACLE, OURS, TUNED
from gimbal_pin.control.laws import ComputedTorque, JointPid, Margins, Pid
from gimbal_pin.control.laws.aim import Law
from gimbal_pin.control.laws.carried import CarriedTorque
from gimbal_pin.control.laws.uncertainty import inertia
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.reduction import reduce
from gimbal_pin.dynamics.regressor import columns
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.forecast import Forecast
from gimbal_pin.pointing.fusion import Fusion
from gimbal_pin.pointing.guard import Guard
from gimbal_pin.pointing.loops import Loops
from gimbal_pin.pointing.navigator import ErrorFrom, Navigator
from gimbal_pin.pointing.pointer import Holder, Pointer
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.pointing.spectrum import Spectrum
from gimbal_pin.rig.config import Noise

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

    def margins(self, name: str) -> tuple[Margins, ...]:
        """Return the margins of a controller's loops, joint by joint, with the drives that the model knows."""
        law = self.law if name in (TUNED, COMPILED) and isinstance(self.law, (JointPid, ComputedTorque)) else None
        return self.loops.margins(name, law)

    def navigator(self, gains: tuple[Pid, ...], predicts: bool = False, fuses: bool = False) -> Navigator:
        """Return navigation for the joints' outer loops."""
        leads = self.loops.leads if predicts else (0.0,) * len(self.loops.leads)
        fusion = Fusion(self.noise.gyro, self.step, self.dt) if fuses else None
        forecast = Forecast(self.spectrum, self.loops.per_lead(gains), self.dt, leads, self.learns)
        return Navigator(self.sight, self.wanted, self.dt, forecast, fusion=fusion)

    def holder(self, name: str) -> Holder:
        """Return one controller, or the compiled one; raise `UsageError` if there is none of that name."""
        if name == COMPILED and self.machine is not None and isinstance(self.law, (JointPid, ComputedTorque)):
            return self.machine.holding(self.tuned(self.law))
        return self.pointer(name)

    def pointer(self, name: str) -> Pointer:
        """Return one controller.

        Raises:
            UsageError: There is none of that name.
        """
        if name == TUNED and isinstance(self.law, (JointPid, ComputedTorque)):
            return self.tuned(self.law)
        if name not in NAMES:
            raise UsageError("controller", f"'{name}' is unknown", f"there are {', '.join(NAMES)}")
        if name in NAMES[:3]:
            return self.plain(name)
        gains, extra = self.loop(name)
        rank = NAMES.index(name)
        predicts, fuses = rank >= NAMES.index("with-prediction"), rank >= NAMES.index("with-gyros")
        navigator = self.navigator(gains, predicts, fuses)
        model = without_hidden(self.model) if name == "without-hidden" else self.model
        law = CarriedTorque(model, gains, self.dt, rank > NAMES.index("computed-torque"))
        return self.guarded(replace(navigator, oracle=name == ORACLE), replace(law, **extra))

    def loop(self, name: str) -> tuple[tuple[Pid, ...], dict[str, Any]]:
        """Return the outer loops of a model-based controller, and what of the law goes with them."""
        if name == "with-observer":
            return self.loops.observed, {"observers": self.loops.observers}
        if name == "lyapunov":
            return self.loops.slow, {"robust": self.loops.robust}
        return self.loops.pid, {"trusted": self.trusted} if name == OURS and not all(self.trusted) else {}

    def plain(self, name: str) -> Pointer:
        """Return one of the controllers that know nothing of the platform's acceleration."""
        gains = self.loops.pid
        navigator = self.navigator(gains)
        if name == "computed-torque-fixed":
            law = ComputedTorque(replace(self.model, terms=()), gains, self.dt)
            return self.guarded(replace(navigator, accelerates=False), law)
        source: ErrorFrom = "platform" if name == "pid-joint" else "camera"
        return self.guarded(replace(navigator, source=source, accelerates=False), self.pid(gains))

    def tuned(self, law: JointPid | ComputedTorque) -> Pointer:
        """Return ours with the gains and the redesign of a given law; with those of a PID, a world-frame PID."""
        if isinstance(law, JointPid):
            return self.guarded(replace(self.navigator(law.gains), accelerates=False), replace(law, dt=self.dt))
        carried = CarriedTorque(
            self.model, law.gains, self.dt, robust=law.robust, trusted=self.loop(OURS)[1].get("trusted", ())
        )
        # The compiled controller beside it does not learn in flight.
        own = self if self.machine is None else replace(self, learns=False)
        return self.guarded(own.navigator(law.gains, predicts=True, fuses=True), carried)

    def guarded(self, navigator: Navigator, law: Law) -> Pointer:
        """Return a controller with its guard, and a PID at half the bandwidth to fall back to."""
        noisy = self.noise.gyro > 0 and self.noise.accelerometer > 0
        return Pointer(navigator, law, Guard(self.dt, noisy), self.pid(self.loops.half))

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
    names, places = columns(rig)
    mixing, phi = reduce(rig, base="fixed").mixing, rig.phi
    free = np.array([not name.endswith(".m") for name in names])
    left = mixing @ phi[places] - mixing[:, ~free] @ phi[places[~free]]
    phi[places[free]] = np.linalg.pinv(mixing[:, free]) @ left
    return replace(model, rig=rig.with_phi(phi))
