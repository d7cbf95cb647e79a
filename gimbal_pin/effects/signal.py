"""Causes between the logged command and the torque that acts: what a drive does to a signal."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from math import inf
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import FloatOrArray
from gimbal_pin.log.log import Array

Flags = NDArray[np.bool_]
SignalMemory = tuple[float, ...]
GONE = 1e-12
"""Memory of a command of 1 N m that is no more felt."""


class JointLoad(NamedTuple):
    """What a joint bears besides the inertia that its own acceleration meets.

    Attributes:
        brake: Friction, which brakes the motor itself, N m, a float or (N,).
        load: What the link asks for while this joint does not accelerate: its weight, the other joints' motion, N m.
        inertial: What this joint's own acceleration asks for, N m.
        still: Whether the joint stands, so that nobody knows its friction.
        across: ``M_j / M_jj``: what 1 N m that speeds its link up asks of every joint, (n,) or (N, n); None: nobody
            knows.
    """

    brake: FloatOrArray
    load: FloatOrArray
    inertial: FloatOrArray = 0.0
    still: bool | Flags = False
    across: Array | None = None

    @classmethod
    def along(
        cls,
        brake: Array,
        load: Array,
        command: Array,
        still: Flags,
        inertial: FloatOrArray = 0.0,
        across: Array | None = None,
    ) -> JointLoad:
        """What a joint bears along a log, (N,): where it stands, its dry friction takes what it can of the torque."""
        most = np.abs(brake)
        return cls(
            np.where(still, np.clip(command - load, -most, most), brake),
            load,
            inertial,
            still,
            across,
        )


@dataclass(frozen=True)
class Signal(Cause):
    """``acting = step(command)``, sample by sample: command and acting torque are each constant over an interval.

    The acting torque is the mean over its interval, so that a delay by a part of it, or a lag shorter than it, gives
    the plant the right impulse. Identification applies it to the torque, never its inverse to the columns.

    Attributes:
        joint: The joint whose motor it belongs to.
    """

    joint: str

    linear: ClassVar[bool] = False
    """True if it is linear and passes a constant on: its impulse response then says all of it."""
    experiment: ClassVar[str] = "a chirp up to the highest frequency that the drive follows"

    @property
    def geared(self) -> bool:
        """True if it acts behind the motor's friction, on the command and what `beside` adds to it."""
        return False

    @property
    def abrupt(self) -> bool:
        """True if it jumps with the command: it acts on each sample of a log, not on a smoothed torque."""
        return False

    @property
    def springy(self) -> bool:
        """True if the link swings behind it, by what the link is asked for."""
        return False

    @property
    def unseen(self) -> float:
        """Share of the joint's inertia that swings behind it unseen by the encoder; zero for most."""
        return 0.0

    def felt(self, load: Array, inertial: Array, dt: float) -> Array:
        """What a motor at rest in its own friction feels of some loads and of its own acceleration, N m, (N, k)."""
        return load + inertial

    def swings(self, dt: float, count: int) -> Array:
        """What a motor feels of the ways in which the link may swing by itself from the start on, (count, m)."""
        return np.zeros((count, 0))

    @abstractmethod
    def start(self, level: float = 0.0) -> SignalMemory:
        """Return the memory of a drive that has been given `level` N m for ever."""

    @abstractmethod
    def step(self, memory: SignalMemory, x: float, dt: float) -> tuple[SignalMemory, float]:
        """Return the memory and the mean acting torque, N m, after `dt` s of the command `x`, N m."""

    def beside(self, borne: JointLoad) -> FloatOrArray:
        """Return what such a signal feels besides the command, N m."""
        return -borne.brake

    def leaning(self, memory: SignalMemory) -> float | None:
        """What leans on a motor that stands still, N m; None: what its link asks for."""
        return None

    def along(self, command: Array, dt: float, borne: JointLoad | None) -> Array:
        """Torque that acts, N m, (N,), as `acting`, at a joint that bears something; None: nobody knows what."""
        if borne is None or not self.geared:
            return self.acting(command, dt)
        beside = self.beside(borne)
        return np.asarray(self.acting(command + beside, dt) - beside)

    def spread(self, loss: FloatOrArray, joint: int, joints: int, borne: JointLoad | None) -> Array:
        """``M_ij / ((1 - r) M_jj) loss``: what a signal takes from every joint, N m, (..., n), where it takes one loss.

        The loss is what the link's unseen acceleration asks for, ``(1 - r) M_jj δ''``, and that asks it of the other
        joints too (Spong, J. Dyn. Sys. Meas. Control 109, 1987: joints that give, the rotors' spin left out).
        """
        taken = np.zeros((*np.shape(loss), joints))
        if self.unseen and borne is not None and borne.across is not None:
            taken += np.asarray(loss)[..., None] * borne.across / self.unseen
        taken[..., joint] = loss
        return taken

    @property
    def largest(self) -> float:
        """Largest torque that it passes on, N m."""
        return inf

    def late(self, dt: float) -> float:
        """``Σ k dt h_k``, s: the first moment of its impulse response, the delay that it is to slow commands.

        Zero where it is not linear.
        """
        if not self.linear:
            return 0.0
        A, B, C, _ = self.matrices(dt)
        settled = np.linalg.solve(np.eye(len(A)) - A, B)
        return float(dt * C @ np.linalg.solve(np.eye(len(A)) - A, settled))

    def matrices(self, dt: float) -> tuple[Array, Array, Array, float]:
        """``m' = A m + B x, y = C m + D x`` of a linear signal, (m, m), (m,), (m,): what `step` does every `dt` s."""
        memory = self.start()
        while len(longer := self.step(memory, 0.0, dt)[0]) > len(memory):
            memory = longer
        still = (0.0,) * len(memory)
        moved, D = self.step(still, 1.0, dt)
        rows = [self.step(tuple(row), 0.0, dt) for row in np.eye(len(memory)).tolist()]
        return (
            np.array([after for after, _ in rows]).T,
            np.array(moved),
            np.array([y for _, y in rows]),
            D,
        )

    def command(self, torque: float) -> float:
        """Return what to command so that this torque acts once it has settled, N m: what a controller compensates."""
        return torque

    def acting(self, command: Array, dt: float) -> Array:
        """Torque that acts, N m, (N,), for a command, N m, (N,), held `dt` s each; settled on the first before it."""
        if self.linear and len(command):
            return self.passed_on(command[:, None], dt)[:, 0]
        return self.stepped(command, dt)

    def stepped(self, command: Array, dt: float) -> Array:
        """The same sample by sample."""
        values = command.tolist()
        memory = self.start(values[0] if values else 0.0)
        out = []
        for x in values:
            memory, y = self.step(memory, x, dt)
            out.append(y)
        return np.array(out)

    def passed_on(self, commands: Array, dt: float) -> Array:
        """What acts for each of some commands, (N, k), if it is linear."""
        count = len(commands)
        first = commands[0]
        response = self.response(dt, count)
        size = fft.next_fast_len(count + len(response) - 1, real=True)
        # Each command side by side in memory.
        spectrum = fft.rfft(np.ascontiguousarray((commands - first).T), size) * fft.rfft(
            response, size
        )
        return np.asarray(first + fft.irfft(spectrum, size)[:, :count].T)

    def response(self, dt: float, longest: int) -> Array:
        """``h_0 = D, h_k = C A^(k-1) B``: what acts after 1 N m over one interval of `dt` s, until it has died away.

        ``C A^k`` is known for twice as many k with every product.
        """
        _, B, _, D = self.matrices(dt)
        return np.append(D, self.ringing(dt, longest) @ B)[:longest]

    def ringing(self, dt: float, longest: int) -> Array:
        """``C A^k``: what acts without a command, `dt` s later each, from each part of its memory, until it died away.

        (k, m), k at least `longest` unless it has died away before.
        """
        A, _, C, _ = self.matrices(dt)
        felt = C[None]
        power = A
        while len(felt) < longest and np.max(np.abs(power), initial=0.0) > GONE:
            felt = np.concatenate([felt, felt @ power])
            power = power @ power
        return felt


@dataclass(frozen=True)
class Static(Signal):
    """``acting = passed(command)``: what has no memory."""

    @abstractmethod
    def passed(self, x: FloatOrArray) -> FloatOrArray:
        """Return the torque that acts, N m, for a command, N m."""

    def start(self, level: float = 0.0) -> SignalMemory:
        """Nothing to remember."""
        return ()

    def step(self, memory: SignalMemory, x: float, dt: float) -> tuple[SignalMemory, float]:
        """Pass the command."""
        return memory, float(self.passed(x))

    def acting(self, command: Array, dt: float) -> Array:
        """Pass all of it at once."""
        return np.asarray(self.passed(command))
