"""What is made of gyros and accelerometers: the platform's motion ahead, one attitude of several gyros, up."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import Pid
from gimbal_pin.log import Array, profile_s
from gimbal_pin.pointing import Forecast, Fusion, Level, attitude, leveled
from gimbal_pin.pointing.forecast import Past
from gimbal_pin.pointing.navigator import Fused
from tests.pointing.recipes import DT, NOISE, spectrum

PID = Pid.placed(12.1, 0.9, 0.2)
AHEAD = Forecast(spectrum(), (PID,), DT, (0.0015,))


def fly(forecast: Forecast, w: Array, f: Array) -> list[Past]:
    """Return what a forecast remembers after every sample of a flight."""
    memory = [forecast.start(w[0], f[0])]
    for k in range(1, len(w)):
        memory.append(forecast.step(memory[-1], k * DT, w[k], f[k]))
    return memory


def test_the_forecast_sees_a_smooth_motion_ahead() -> None:
    """Force, rate and angular acceleration of another draw of the profile, 1.5 ms ahead; gravity passes as it is."""
    ground = profile_s(DT / 2 * np.arange(4000), np.random.default_rng(4))
    memory = fly(AHEAD, ground.w[::2], ground.f[::2])
    rows = np.arange(1200, 1900)
    assert min(memory[k].trust for k in rows) == 1.0
    seen = np.array([np.concatenate(AHEAD.ahead(memory[k])[0]) for k in rows])
    true = np.hstack([ground.f, ground.w, ground.dw])
    off = np.std(seen - true[2 * rows + 3], axis=0)
    none = np.std(true[2 * rows] - true[2 * rows + 3], axis=0)
    assert (off < none * np.repeat([0.5, 0.3, 0.3], 3)).all()
    assert AHEAD.weights[0][2].sum() == pytest.approx(1.0, abs=1e-3)


def test_a_forecast_is_used_while_it_errs_less_than_none() -> None:
    """Of a propeller that it was not shown never, until the flight has shown it; of one that changed no more."""
    rng = np.random.default_rng(5)
    t = DT * np.arange(4601)
    ground = profile_s(t, rng)
    wave = np.where(t < 4.4, np.sin(2 * pi * 110.0 * t), np.sin(2 * pi * 170.0 * t))[:, None]
    w = ground.w + 0.05 * wave + 2e-3 * rng.standard_normal((4601, 3))
    f = ground.f + 2.0 * wave + 0.02 * rng.standard_normal((4601, 3))
    memory = fly(AHEAD, w, f)
    assert max(past.trust for past in memory[:2048]) == 0.0
    assert memory[4400].trust == 1.0
    assert memory[-1].trust == 0.0
    assert len(memory[-1].events) == 3
    assert fly(replace(AHEAD, learns=False), w[:4400], f[:4400])[-1].trust == 0.0


def test_the_spectrum_parts_noise_from_motion() -> None:
    found = spectrum()
    assert np.sqrt(found.rate_noise) == pytest.approx(NOISE.gyro, rel=0.1)
    assert np.sqrt(found.force_noise) == pytest.approx(NOISE.accelerometer, rel=0.1)
    moved = profile_s(DT * np.arange(8000), np.random.default_rng(9), 0.5)
    power = np.sum(found.rate) * found.f[1]
    assert power == pytest.approx(1.01 * np.mean(moved.w**2), rel=0.15)


@pytest.mark.parametrize("scale", [0.0, 0.01])
def test_fusion_halves_the_gyros_walk_and_ends_where_one_has_a_wrong_scale(scale: float) -> None:
    """On a platform that swings by 5° at half a hertz."""
    rng = np.random.default_rng(1)
    fusion = Fusion(NOISE.gyro, 2 * pi / 2**16, DT)
    memory = Fused.begun([np.eye(3)], np.zeros((1, 3)))
    camera = np.eye(3)
    last = np.zeros(3)
    walks = []
    for k in range(6000):
        noise = NOISE.gyro / np.sqrt(2 * DT) * rng.standard_normal((2, 3))
        rate = radians(5) * pi * np.cos(pi * k * DT)
        q = np.rint(radians(5) * np.sin(pi * k * DT) / fusion.step) * fusion.step
        camera = camera @ pin.exp3((last + noise[0]) * DT / 2)
        last = noise[0]
        memory = memory.on(noise[1:] + np.array([0, (1 + scale) * rate, 0]), DT)
        memory = fusion.compared(memory, camera, [pin.exp3(np.array([0, -q, 0]))])
        if k % 200 == 0:
            walks.append([pin.log3(camera), pin.log3(camera @ pin.exp3(memory.turn))])
    assert memory.ended == (scale > 0)
    own, fused = np.mean(np.diff(walks, axis=0) ** 2, axis=(0, 2))
    assert memory.ended or fused < 0.7 * own


@given(st.floats(-1.2, 1.2), st.floats(-1.4, 1.4))
def test_gravity_says_where_up_is(roll: float, pitch: float) -> None:
    R = attitude(0.0, pitch, roll)
    np.testing.assert_allclose(leveled(R.T @ [0, 0, 9.81]), R, atol=1e-12)
    np.testing.assert_array_equal(leveled(np.full(3, np.nan)), np.eye(3))


@pytest.mark.parametrize("sure", [True, False])
def test_a_world_that_moves_is_leveled(sure: bool) -> None:
    """Sines of 1 m/s² at 0.2 to 2 Hz on top of gravity: one that is sure stays as it is, another becomes level."""
    level = Level(0.01)
    rng = np.random.default_rng(0)
    tilt = np.eye(3) if sure else attitude(0.0, 0.4, -0.3)
    phases = 2 * pi * np.outer(0.01 * np.arange(6000), np.geomspace(0.2, 2, 20))
    pushes = np.cos(phases + 2 * pi * rng.random(20)) @ rng.standard_normal((20, 3)) / np.sqrt(10)
    memory = level.start(sure)
    cosines = []
    for force in pushes + tilt[2] * 9.81:
        memory = level.step(memory, force)
        cosines.append((memory.turn @ tilt.T)[2, 2])
    assert cosines[-1] > np.cos(radians(0.1))
    assert not sure or min(cosines) > np.cos(radians(0.02))
