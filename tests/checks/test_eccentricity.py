"""Encoders off their centre: found by rates of their own, and by nothing that only looks like that."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.checks import Eccentricity, fit_eccentricity
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.identification import identify
from gimbal_pin.log import Array, Log
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed

SECONDS, DT = 30.0, 0.002


def swinging(seed: int) -> tuple[Array, Array, Array]:
    """Time, angles of 0.8 rad rms and their rates, of a few sines."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, DT)
    w, phase, size = 2 * np.pi * rng.uniform(0.1, 1.2, 5), rng.uniform(-3, 3, 5), rng.uniform(0.1, 0.5, 5)
    size *= 0.8 / np.sqrt(np.sum(size**2) / 2)
    q = np.sin(np.outer(t, w) + phase) @ size
    v = np.cos(np.outer(t, w) + phase) @ (size * w)
    return t, q, v


def measured(seed: int, q: Array, v: Array) -> tuple[Array, Array]:
    """Both with noise of their own."""
    rng = np.random.default_rng([seed, 1])
    return q + 1e-4 * rng.standard_normal(len(q)), v + 3e-3 * rng.standard_normal(len(v))


def test_a_pause_of_a_year_costs_nothing() -> None:
    """Windows are counted where there are samples, not where the clock has run on."""
    t, q, v = swinging(5)
    size = Eccentricity(0.03, 0.04, 0.0)
    read, v = measured(5, q + size.error(q), v)
    found = fit_eccentricity(np.where(t < SECONDS / 2, t, t + 3e7), read, v)
    assert found is not None
    assert found.size == pytest.approx(0.05, abs=4 * found.std)


@given(seed=st.integers(0, 10**6), size=st.floats(0.02, 0.15), phase=st.floats(-3.1, 3.1), offset=st.floats(-0.5, 0.5))
def test_what_was_planted_is_found_and_mended(seed: int, size: float, phase: float, offset: float) -> None:
    t, q, v = swinging(seed)
    read, rate = measured(seed, q + offset + size * np.sin(q + phase), v)
    found = fit_eccentricity(t, read, rate)
    assert found is not None
    assert found.size == pytest.approx(size, abs=5 * found.std)
    error = found.mended(read) - q
    assert np.std(error) < 0.1 * np.std(read - q)


@given(seed=st.integers(0, 10**6), scale=st.floats(0.95, 1.05), bias=st.floats(-0.05, 0.05), late=st.integers(0, 3))
def test_a_rates_own_faults_are_no_eccentricity(seed: int, scale: float, bias: float, late: int) -> None:
    t, q, v = swinging(seed)
    read, rate = measured(seed, q, np.roll(v, late) * scale + bias)
    assert fit_eccentricity(t[late:], read[late:], rate[late:]) is None


@given(a=st.floats(-0.15, 0.15), b=st.floats(-0.15, 0.15))
def test_mended_undoes_error(a: float, b: float) -> None:
    q = np.linspace(-3.0, 3.0, 200)
    off = Eccentricity(a, b, 0.0)
    assert off.mended(q + off.error(q)) == pytest.approx(q, abs=1e-5)


def test_rates_made_from_the_angles_show_nothing() -> None:
    t, q, _ = swinging(3)
    read = q + 0.05 * np.sin(q)
    assert fit_eccentricity(t, read, np.gradient(read, DT)) is None


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("thesis")


@pytest.fixture(scope="module")
def off(rig: Rig) -> Log:
    """A log of the bundled rig whose last encoder sits off its centre."""
    log = prescribed(nominal(rig), seconds=16.0, torque_noise=2e-3, dt=2e-3)
    q = np.array(log.q)
    q[:, -1] += 0.05 * np.sin(q[:, -1] + 0.7)
    return replace(log, q=q)


def test_an_eccentric_encoder_is_one_finding_with_its_size(rig: Rig, off: Log) -> None:
    names = ("encoder-offset", "torque-ripple", "cogging", "asymmetric-friction", "cable-spring")
    said = diagnose(rig, [off], {name: CAUSES[name] for name in names}, rng=np.random.default_rng(0))
    assert [(one.cause, one.joint) for one in said.findings] == [("encoder-offset", rig.joints[-1])]
    figures = {p.name: p.value for p in said.findings[0].parameters}
    assert figures["eccentricity"] == pytest.approx(0.05, abs=0.003)
    assert figures["phase"] == pytest.approx(0.7, abs=0.1)


def test_identify_mends_it_and_says_so(rig: Rig, off: Log) -> None:
    found = identify(rig, [off])
    (one,) = found.altered[off.name]
    assert (one.cause, one.channel) == ("eccentric-encoder", f"q_{rig.joints[-1]}")
    assert one.size == pytest.approx(0.05, abs=0.003)
