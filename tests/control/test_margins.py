"""Margins of the sampled, delayed loop: those of python-control.

A drive's linear signals stand in the loop as they act sample by sample; delays between whole samples are exact.
"""

from __future__ import annotations

from math import pi, sqrt

import control
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gimbal_pin.control import Pid, compute_margins, sampled_loop
from gimbal_pin.effects import ActuatorLag, Delay, JointFlexibility, Signal

DT = 0.001


def test_gains_place_the_poles() -> None:
    gains = Pid.placed(5.0, 0.7, 0.2)
    w = 2 * pi * 5.0
    wanted = np.polymul([1, 2 * 0.7 * w, w**2], [1, 0.2 * w])
    np.testing.assert_allclose([1, gains.kd, gains.kp, gains.ki], wanted)


@given(st.floats(2, 12), st.floats(0, 0.3), st.floats(0, 0.004), st.floats(1e-4, 0.004))
@settings(max_examples=8)
def test_margins_are_those_of_python_control(
    hz: float, integral: float, delay: float, lag: float
) -> None:
    """Which finds crossings on a spline through the loop's values; a sampled loop ends on the real axis."""
    gains = Pid.placed(hz, 1.0, integral)
    drive = (ActuatorLag("pan", lag),)
    found = compute_margins(gains, DT, delay, drive=drive)
    assume(found.disk_margin > 0.05)
    omega = np.geomspace(0.1 * sqrt(gains.kp), pi / DT * (1 - 1e-9), 2000)
    loop = sampled_loop(gains, DT, delay, drive=drive)(np.exp(1j * omega * DT))
    peer = control.frd(loop, omega, dt=DT)
    factors, phases, _, _, crossovers, _ = control.stability_margins(peer, returnall=True)
    ends = [-1 / loop[-1].real] if loop[-1].real < 0 else []
    decibels = 20 * np.log10([*factors, *ends])
    disk = (2 * np.abs(1 + loop) / np.abs(1 - loop)).min()
    assert found.phase_margin_deg == pytest.approx(np.abs(phases).min(), rel=1e-4)
    assert found.crossover_hz == pytest.approx(np.max(crossovers) / (2 * pi), rel=1e-4)
    late = np.radians(np.abs(phases) / crossovers).min()
    assert found.delay_margin == pytest.approx(late, rel=1e-4)
    assert found.gain_margin_db == pytest.approx(np.abs(decibels).min(), abs=0.05)
    assert found.disk_margin == pytest.approx(disk, rel=2e-3)


@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.002, 0.0037])
@pytest.mark.parametrize("late", [0.0, 0.003])
def test_a_delay_between_whole_samples_is_exact(delay: float, late: float) -> None:
    """From rest, under 1 rad/s² that acts after the delays of loop and drive, the angle is (t - delay)²/2."""
    drive = (Delay("pan", late),)
    loop = sampled_loop(Pid.placed(8.0, 1.0, 0.2), DT, delay, drive=drive)
    state = np.zeros(loop.nstates)
    for k in range(20):
        t = k * DT - delay - drive[0].late(DT)
        assert state[0] == pytest.approx(max(t, 0.0) ** 2 / 2, abs=1e-15)
        state = loop.A @ state + loop.B[:, 0]


def test_an_unstable_loop_has_no_margins() -> None:
    assert set(vars(compute_margins(Pid.placed(200.0, 1.0, 0.2), DT, 0.005)).values()) == {0.0}


@pytest.mark.parametrize(
    "signal",
    [Delay("pan", 0.0034), ActuatorLag("pan", 0.005), JointFlexibility("pan", 25.0, 0.1, 0.3)],
)
def test_a_signals_matrices_do_what_its_steps_do(signal: Signal) -> None:
    A, B, C, D = signal.matrices(DT)
    state = np.zeros(len(A))
    memory = signal.start()
    for x in np.random.default_rng(0).standard_normal(60).tolist():
        output = C @ state + D * x
        state = A @ state + B * x
        memory, acts = signal.step(memory, x, DT)
        assert output == pytest.approx(acts, abs=1e-12)
