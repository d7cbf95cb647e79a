"""What a law is told that holds a camera still on a platform that moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from gimbal_pin.log.log import Array


class Carried(NamedTuple):
    """Motion of the base link at one moment, in its own frame, as its IMU tells it.

    Attributes:
        f: Specific force, m/s².
        w: Angular rate, rad/s.
        dw: Angular acceleration, rad/s².
    """

    f: Sequence[float] | Array
    w: Array
    dw: Sequence[float] | Array


class Ahead(NamedTuple):
    """Where the model is to be evaluated: at the middle of the hold of the torque, or now.

    Attributes:
        q: Angles, rad, (n,).
        v: Wanted rates, rad/s, (n,): those that keep the camera's attitude.
        a: Wanted accelerations, rad/s², (n,).
        base: Motion of the base.
    """

    q: Array
    v: Array
    a: Array
    base: Carried


class Aim(NamedTuple):
    """Where the joints should be so that the camera looks where it should; a `Reference` for any law.

    Attributes:
        q: Angles, rad, (n,).
        v: Rates, rad/s, (n,).
        a: Accelerations, rad/s², (n,).
        ahead: One per distinct lead of the law's drives, see `Navigator.leads`.
    """

    q: Array
    v: Array
    a: Array
    ahead: tuple[Ahead, ...]


class Law(Protocol):
    """A `simulation.Controller` whose reference may be an `Aim`: of this, any law reads the part that it knows."""

    @property
    def dt(self) -> float:
        """Sampling interval, s."""

    def start(self) -> Any:
        """Return the memory before the first sample."""

    def torque(self, t: float, q: Array, v: Array, reference: Any, memory: Any) -> tuple[Array, Any]:
        """Return the torque, N m, (n,), within the limits, and the next memory."""
