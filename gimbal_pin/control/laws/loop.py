"""The sampled loop of an outer PID around a linearised joint, and its margins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import floor, pi
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import schur

from gimbal_pin.control.laws.base import Pid
from gimbal_pin.effects import Signal
from gimbal_pin.log.log import Array

if TYPE_CHECKING:
    import control

LOOP_FREQUENCIES = 300
"""Frequencies at which the loop is evaluated, three decades below its crossover to half the sampling rate."""


@dataclass(frozen=True)
class Margins:
    """How far one joint's loop, broken at the motor, is from instability.

    Attributes:
        phase_margin_deg: Phase margin, degrees.
        gain_margin_db: Smallest change of gain, up or down, that makes it unstable, dB.
        disk_margin: Balanced disk margin (0 … 2): gain and phase changed at once.
        delay_margin: Additional delay that makes it unstable, s.
        crossover_hz: Highest frequency at which the loop's gain is one, Hz.
    """

    phase_margin_deg: float
    gain_margin_db: float
    disk_margin: float
    delay_margin: float
    crossover_hz: float


def sampled_plant(dt: float, delay: float) -> tuple[Array, Array]:
    """Exact sampling of ``q̈(t) = u(t - delay)`` with u held between samples.

    Returns:
        A, (2 + m, 2 + m), and B, (2 + m, 1), of the state (q, q̇, u of the last m samples), m = ceil(delay/dt).
    """
    whole = floor(delay / dt + 1e-9)
    rest = max(0.0, delay - whole * dt)
    late = rest > 1e-9 * dt
    first = dt - rest
    taps = [np.zeros(2)] * whole + [np.array([first**2 / 2, first])]
    if late:  # the older input still acts during the first `rest` s of the interval
        taps.append(np.array([rest**2 / 2 + rest * first, rest]))
    m = len(taps) - 1
    A = np.zeros((2 + m, 2 + m))
    B = np.zeros((2 + m, 1))
    A[:2, :2] = [[1.0, dt], [0.0, 1.0]]
    B[:2, 0] = taps[0]
    for k, tap in enumerate(taps[1:]):
        A[:2, 2 + k] = tap
    if m:
        B[2, 0] = 1.0
        A[3:, 2:-1] = np.eye(m - 1)
    return A, B


def driven(plant: tuple[Array, Array], drive: Sequence[Signal], dt: float) -> tuple[Array, Array]:
    """Put the drive's linear signals before a sampled plant; its state comes first, then theirs."""
    A, B = plant
    for signal in reversed([s for s in drive if s.linear]):
        own, into, out, through = signal.matrices(dt)
        n = len(A)
        m = len(own)
        grown = np.zeros((n + m, n + m))
        grown[:n, :n], grown[n:, n:], grown[:n, n:] = A, own, B * out
        A = grown
        B = np.vstack([through * B, into[:, None]])
    return A, B


def sampled_loop(
    gains: Pid, dt: float, delay: float, gain: float = 1.0, drive: tuple[Signal, ...] = ()
) -> control.StateSpace:
    """Loop gain, broken at the plant's input, in discrete state space.

    Transfer functions of these double integrators lose their digits; state space does not.

    Args:
        gains: Outer loop; its integral counts the sample at hand.
        dt: Sampling interval, s.
        delay: Time from measurement to torque, s; the hold comes on top.
        gain: What the plant's gain is of what the law believes: nominal over true inertia.
        drive: What stands between the command and the torque that acts; what is not linear is passed over.
    """
    import control

    plant, B = driven(sampled_plant(dt, delay), drive, dt)
    size = len(plant) + 1
    A = np.zeros((size, size))
    A[:-1, :-1] = plant
    A[-1, 0], A[-1, -1] = dt, 1.0
    C = np.zeros((1, size))
    C[0, :2] = gains.kp + gains.ki * dt, gains.kd
    C[0, -1] = gains.ki
    if not gains.integrates:  # an integrator that nothing reads would count as an unstable mode
        A = A[:-1, :-1]
        C = C[:, :-1]
        return control.ss(A, B, gain * C, 0.0, dt)
    return control.ss(A, np.vstack([B, [[0.0]]]), gain * C, 0.0, dt)


def stable(loop: control.StateSpace) -> bool:
    """Return whether the loop is stable when closed."""
    return bool(np.max(np.abs(np.linalg.eigvals(loop.A - loop.B @ loop.C))) < 1.0)


def frequencies(gains: Pid, dt: float) -> Array:
    """Where to look at the loop, rad/s."""
    top = pi / dt * (1 - 1e-9)
    return np.geomspace(min(gains.kp**0.5 * 1e-2, top * 1e-2), top, LOOP_FREQUENCIES)


def responses(loop: control.StateSpace, omega: Array) -> Array:
    """Loop gain ``C (z I - A)⁻¹ B`` at ``z = exp(j ω dt)``, complex, as long as `omega`, rad/s; all at one go.

    By Schur's form ``A = U T Uᴴ``, once: what is left to solve at each frequency is triangular.
    """
    T, U = schur(loop.A, output="complex")
    z = np.exp(1j * omega * loop.dt)
    into = U.conj().T @ loop.B[:, 0]
    out = loop.C[0] @ U
    states = np.zeros((len(T), len(z)), dtype=complex)
    for k in reversed(range(len(T))):
        states[k] = (into[k] + T[k, k + 1 :] @ states[k + 1 :]) / (z - T[k, k])
    return np.asarray(out @ states)


def disk_margin(loop: control.StateSpace, response: Array, gain: float = 1.0) -> float:
    """``min 2 |1 + L|/|1 - L|``: balanced disk margin (Seiler, Packard and Gahinet 2020, 4); 0 of an unstable loop.

    Args:
        loop: The loop.
        response: Its gain at some frequencies. Those of the closed loop's poles are added: they have the peaks, which
            a grid may step over where a resonance is narrow.
        gain: How many times as strong the loop is.
    """
    poles = np.linalg.eigvals(loop.A - gain * loop.B @ loop.C)
    if np.abs(poles).max() >= 1.0:
        return 0.0
    peaks = np.abs(np.angle(poles)) / loop.dt
    L = gain * np.append(response, responses(loop, peaks[(peaks > 0) & (peaks < pi / loop.dt)]))
    return float((2 * np.abs(1 + L) / np.abs(1 - L)).min())


@lru_cache(maxsize=512)
def smallest_disk(
    gains: Pid, dt: float, delay: float, ratios: tuple[float, ...], drive: tuple[Signal, ...] = ()
) -> float:
    """Return the smallest disk margin over the plant's gains `ratios`, as `compute_margins` has it."""
    loop = sampled_loop(gains, dt, delay, drive=drive)
    response = responses(loop, frequencies(gains, dt))
    return min(disk_margin(loop, response, ratio) for ratio in ratios)


@lru_cache(maxsize=512)
def compute_margins(
    gains: Pid, dt: float, delay: float, gain: float = 1.0, drive: tuple[Signal, ...] = ()
) -> Margins:
    """Return the margins of `sampled_loop`; an unstable loop has none (all zero).

    Remembered, as joints share loops and searches come back to them: the result depends on the arguments alone.
    """
    return assessed(sampled_loop(gains, dt, delay, gain, drive), frequencies(gains, dt))


def assessed(loop: control.StateSpace, omega: Array) -> Margins:
    """Return the margins of a loop gain, looked at at some frequencies, rad/s; an unstable loop has none (all zero)."""
    if not stable(loop):
        return Margins(0.0, 0.0, 0.0, 0.0, 0.0)
    response = responses(loop, omega)
    crossover = find_crossings(loop, omega, response, lambda L: np.abs(L) - 1.0)
    phase = np.abs(np.angle(-responses(loop, crossover)))
    real = responses(loop, find_crossings(loop, omega, response, np.imag)).real
    gains_at_180 = np.append(-1 / real[real < 0], at_nyquist(loop))
    return Margins(
        phase_margin_deg=float(np.rad2deg(phase).min(initial=np.inf)),
        gain_margin_db=float(np.abs(20 * np.log10(gains_at_180)).min(initial=np.inf)),
        disk_margin=disk_margin(loop, response),
        delay_margin=float((phase / crossover).min(initial=np.inf)),
        crossover_hz=float(crossover.max(initial=0.0) / (2 * pi)),
    )


def find_crossings(
    loop: control.StateSpace, omega: Array, response: Array, measure: Callable[[Array], Array]
) -> Array:
    """Return where a measure of the loop gain is zero, rad/s: between neighbours of `omega` where its sign changes."""
    from scipy.optimize import brentq

    signs = np.sign(measure(response))
    at = np.flatnonzero(signs[1:] != signs[:-1])
    return np.array(
        [
            brentq(lambda w: measure(responses(loop, np.array([w])))[0], *omega[k : k + 2])
            for k in at
        ]
    )


def at_nyquist(loop: control.StateSpace) -> Array:
    """Gain margin at half the sampling rate, where a sampled loop ends on the real axis; empty if on its right."""
    edge = float(responses(loop, np.array([pi / loop.dt]))[0].real)
    return np.array([-1 / edge] if edge < 0 else [])


def find_worst_margins(several: list[Margins]) -> Margins:
    """Return the smallest of each margin; the crossover is the highest."""
    return Margins(
        phase_margin_deg=min(m.phase_margin_deg for m in several),
        gain_margin_db=min(m.gain_margin_db for m in several),
        disk_margin=min(m.disk_margin for m in several),
        delay_margin=min(m.delay_margin for m in several),
        crossover_hz=max(m.crossover_hz for m in several),
    )
