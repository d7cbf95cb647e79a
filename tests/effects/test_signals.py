"""Laws of what a drive does to a signal: it settles, keeps momentum, and is the formula or the two masses it names."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lsim

from gimbal_pin.effects import (
    ActuatorLag,
    Backlash,
    DeadZone,
    Delay,
    JointFlexibility,
    Saturation,
    Signal,
    parse_effect,
)
from gimbal_pin.log import Array
from tests.effects.test_effects import KINDS, SEEDS, planted, rig

SIGNALS = sorted(name for name, kind in KINDS.items() if issubclass(kind, Signal))


@pytest.mark.parametrize("name", SIGNALS)
@given(seed=SEEDS)
def test_signals_settle_and_arrays_run_the_same_line(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    signal: Signal = planted(name, rng)
    dt = float(rng.uniform(5e-4, 5e-3))
    x = rng.normal(size=30)
    memory = signal.start(float(x[0]))
    out = []
    for value in x.tolist():
        memory, y = signal.step(memory, value, dt)
        assert isinstance(y, float)
        out.append(y)
    np.testing.assert_allclose(signal.acting(x, dt), out, rtol=1e-9, atol=1e-9)
    passed = signal.passed(0.3) if isinstance(signal, Saturation | DeadZone) else 0.3
    np.testing.assert_allclose(signal.acting(np.full(50, 0.3), dt), passed, rtol=1e-9)


@given(SEEDS, st.integers(0, 12), st.floats(0, 1, exclude_max=True))
def test_a_delay_shifts_and_mixes_within_one_interval(seed: int, whole: int, part: float) -> None:
    x = np.random.default_rng(seed).normal(size=60)
    dt = 0.002
    y = Delay("tilt", (whole + part) * dt).acting(x, dt)
    k = np.arange(13, 60)
    np.testing.assert_allclose(y[k], (1 - part) * x[k - whole] + part * x[k - whole - 1], atol=1e-6)
    np.testing.assert_allclose(y[: whole + 1], x[0], atol=1e-9)


@given(T=st.floats(1e-3, 0.2), dt=st.floats(1e-4, 0.01))
def test_the_step_response_of_a_lag_is_exponential(T: float, dt: float) -> None:
    """Of each interval its mean acts."""
    t = dt * np.arange(40)
    y = ActuatorLag("tilt", T).acting(np.where(t > 0, 1.0, 0.0), dt)
    left = np.exp(-t[:-1] / T)
    np.testing.assert_allclose(y[1:], 1 - left * T / dt * -np.expm1(-dt / T), atol=1e-9)


@given(st.floats(5, 120), st.floats(0.001, 0.5), st.floats(0.05, 0.95), st.booleans())
def test_joint_flexibility_is_two_masses_on_a_spring(
    f: float, zeta: float, share: float, on_rotor: bool
) -> None:
    """Rotor, spring, link integrated exactly, against the rigid joint behind the signal: the same encoder rate."""
    dt = 1e-3
    inertias = 0.2 * np.array([share, 1 - share])
    pull = np.prod(inertias) / 0.2 * np.array([[1.0, -1.0], [-1.0, 1.0]]) / inertias[:, None]
    w = 2 * np.pi * f
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-(w**2) * pull, -2 * zeta * w * pull]])
    B = np.array([[0.0], [0.0], [1 / inertias[0]], [0.0]])
    C = np.eye(4)[[2 if on_rotor else 3]]
    x = np.random.default_rng(3).normal(size=200)
    _, rates, _ = lsim((A, B, C, [[0.0]]), x, dt * np.arange(200), interp=False)
    signal = JointFlexibility("tilt", f, zeta, share if on_rotor else 0.0)
    acting = signal.acting(np.append(0.0, x), dt)[1:-1]
    atol = 1e-9 * np.max(np.abs(rates))
    np.testing.assert_allclose(np.cumsum(acting) / 0.2 * dt, rates[1:], atol=atol)


@given(SEEDS, st.floats(1e-4, 0.1), st.floats(1e-4, 1e-2), st.sampled_from([0.0, 0.25, 0.5]))
def test_backlash_keeps_the_momentum_and_the_gap(
    seed: int, gap: float, inertia: float, share: float
) -> None:
    """In a gap nothing passes and the rotor's momentum grows, or less the link's that no encoder sees."""
    dt = 1e-3
    moved = inertia * (1 - 1 / share if share else 1.0)
    signal = Backlash("tilt", gap, inertia, share)
    x = np.random.default_rng(seed).normal(size=200) + 0.5 * np.sin(np.arange(200) / 10)
    memory = signal.start()
    passed = 0.0
    for k, torque in enumerate(x.tolist()):
        memory, y = signal.step(memory, torque, dt)
        passed += y * dt
        assert passed + moved * memory[1] == pytest.approx(x[: k + 1].sum() * dt, abs=1e-9)
        assert abs(memory[0]) <= gap / 2
        if abs(memory[0]) < gap / 2 and not share:
            assert y == pytest.approx(0, abs=1e-9)
    np.testing.assert_array_equal(signal.acting(x, dt), signal.stepped(x, dt))


X = np.linspace(-2.0, 2.0, 401)


def soft(knee: float) -> Array:
    """A limit of 0.5 that is reached gradually."""
    return np.asarray(X / (1 + np.abs(X / 0.5) ** knee) ** (1 / knee))


@pytest.mark.parametrize(
    ("stated", "torque"),
    [
        ("saturation:tilt:limit=0.5", X.clip(-0.5, 0.5)),
        ("saturation:tilt:limit=0.5,side=1", X.clip(None, 0.5)),
        ("saturation:tilt:limit=0.5,side=-1", X.clip(-0.5)),
        ("saturation:tilt:limit=0.5,knee=1.5", soft(1.5)),
        ("saturation:tilt:limit=0.5,knee=4,side=1", np.where(X > 0, soft(4), X)),
        ("dead-zone:tilt:width=0.3", X - X.clip(-0.3, 0.3)),
        ("dead-zone:tilt:width=0.3,sharpness=4", X * (1 - 2 ** -((X / 0.3) ** 4))),
        (DeadZone("tilt", 0.1, whole=True), X * (np.abs(X) > 0.1)),
    ],
)
def test_what_has_no_memory_is_its_formula(stated: str | DeadZone, torque: Array) -> None:
    """The command that compensates it gives the torque."""
    signal = parse_effect(stated, rig()) if isinstance(stated, str) else stated
    assert isinstance(signal, Saturation | DeadZone)
    np.testing.assert_allclose(signal.acting(X, 1e-3), torque, atol=1e-9)
    for wanted in (-0.45, 0.2, 0.45):
        assert signal.passed(signal.command(wanted)) == pytest.approx(wanted, rel=1e-6)
