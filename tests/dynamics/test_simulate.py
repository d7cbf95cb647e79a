"""Laws of the closed loop and of the causes that are planted in it.

Every cause shows, and of no size changes nothing; the drive passes on what its signal's array form does; a base that
sinks is a platform that turns; the log states what the sensors and limits did; a loop that cannot be is refused.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import ComputedTorque, Pid
from gimbal_pin.dynamics import Model, Plant, Sensors, State, nominal, plant_with, simulate
from gimbal_pin.dynamics.drive import compute_joint_load
from gimbal_pin.effects import (
    CAUSES,
    BaseTilt,
    Effect,
    JointLoad,
    Signal,
    Term,
    parse_effect,
)
from gimbal_pin.errors import RigError, UsageError
from gimbal_pin.log import Array, Log, Platform
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.rigs import bundled

DT = 0.001
SOME = {
    "stribeck": "tilt:speed=0.1,extra=0.05",
    "asymmetric-friction": "tilt:coulomb=0.004,viscous=0.004",
    "load-dependent-friction": "tilt:mu=0.1",
    "presliding": "tilt:stroke=0.01,level=0.05",
    "position-dependent-friction": "tilt:amplitude=0.005,harmonic=5",
    "friction-drift": "tilt:span=1,coulomb=0.05",
    "quadratic-drag": "tilt:drag=0.05",
    "cogging": "tilt:amplitude=0.05,harmonic=42",
    "torque-ripple": "tilt:amplitude=0.1,harmonic=14",
    "torque-gain": "tilt:gain=0.9",
    "torque-bias": "tilt:bias=0.05",
    "cable-spring": "tilt:stiffness=0.3,rest=0.2",
    "armature": "tilt:inertia=0.01",
    "actuator-lag": "tilt:time_constant=0.004",
    "delay": "tilt:time=0.0033",
    "saturation": "tilt:limit=0.25",
    "dead-zone": "tilt:width=0.02",
    "joint-flexibility": "tilt:frequency=60",
    "backlash": "tilt:gap=0.002,inertia=0.0005",
    "payload-shift": "x=0.004,z=-0.002",
    "payload-mass": "extra=0.2",
    "encoder-offset": "tilt:offset=0.02",
    "base-tilt": "pitch=0.05",
    "off-diagonal-inertia": "tilt:Ixz=0.0005",
}


RIG = bundled("turret")
NOMINAL = nominal(RIG)
NOTHING = np.zeros(2)
REFERENCE = fourier(RIG, 6, 1.0)
CONTROL = ComputedTorque(NOMINAL, (Pid.placed(6.0, 1.0, 0.2),) * 2, DT, lead=1.5 * DT)


def run(plant: Model, sensors: Sensors | None = None, seed: int = 0, **options: object) -> Log:
    """Return the log of a loop whose controller knows the nominal rig."""
    sense = sensors or Sensors.exact(2)
    return simulate(plant, CONTROL, REFERENCE, rng=seed, sensors=sense, **options)


@cache
def run_planted(text: str) -> Log:
    """Return the log of a plant with a cause; of none, for an empty text."""
    planted = plant_with(NOMINAL, [parse_effect(text, RIG)] if text else [])
    return run(planted.plant, drive=planted.drive)


def shrink(name: str) -> Term | object:
    """Return a cause of no size."""
    cause = parse_effect(f"{name}:{SOME[name]}", RIG)
    if isinstance(cause, Term):
        return Term(cause.effect, (0.0,) * len(cause.values))
    least = {"saturation": {"limit": 1e6}, "actuator-lag": {"time_constant": 1e-5}}
    least["joint-flexibility"] = {"frequency": 500.0, "damping": 0.5}
    zero = {shape.name: max(0.0, shape.lower) for shape in cause.shapes}
    return replace(cause, **least.get(name, zero))


def test_every_cause_is_tried() -> None:
    assert set(SOME) == set(CAUSES)


@pytest.mark.parametrize("name", sorted(SOME))
def test_every_cause_shows_in_the_log_and_of_no_size_changes_nothing(name: str) -> None:
    """The loop stays in hand; the drive's two lags are never wholly gone: 10 µs, and a resonance of 500 Hz."""
    clean = run_planted("")
    log = run_planted(f"{name}:{SOME[name]}")
    assert np.abs(log.tau - clean.tau).max() > 1e-3
    assert np.abs(log.q - REFERENCE.q).max() < 0.1
    planted = plant_with(NOMINAL, [shrink(name)])
    tolerance = {"actuator-lag": 1e-5, "joint-flexibility": 3e-4}.get(name, 1e-9)
    found = run(planted.plant, drive=planted.drive)
    np.testing.assert_allclose(found.q, clean.q, atol=tolerance)


def replay(log: Log, acting: Array) -> Array:
    """Return the angles of the plant alone under given torques."""
    system = Plant(NOMINAL)
    out = np.empty_like(log.q)
    state = State(REFERENCE.q[0], REFERENCE.v[0])
    for k, t in enumerate(log.t.tolist()):
        out[k] = state.q
        state = system.step(t, state, acting[k], DT)
    return out


SIGNALS = [f"{name}:{SOME[name]}" for name in sorted(SOME) if issubclass(CAUSES[name], Signal)]


@pytest.mark.parametrize(
    "text", [*SIGNALS, "backlash:tilt:gap=0.002,inertia=0.0005,rotor_share=0.2"]
)
def test_the_log_keeps_the_command_and_the_plant_gets_what_the_drive_makes_of_it(text: str) -> None:
    """The logged command through the signal's array form drives the plant along the logged angles.

    A link that the encoder does not see pushes the other joints by its own acceleration.
    """
    signal = parse_effect(text, RIG)
    assert isinstance(signal, Signal)
    log = run_planted(text)
    bears = [
        compute_joint_load(NOMINAL, 1, State(q, v), x)
        for q, v, x in zip(log.q, log.v, log.tau[:, 1].tolist())
    ]
    # The drive has been at rest for ever, the array form would settle on its first sample.
    brake = np.array([0.0, *(one.brake for one in bears)])
    load = np.array([0.0, *(one.load for one in bears)])
    command = np.concatenate([[0.0], log.tau[:, 1]])
    lost = log.tau[:, 1] - signal.along(command, DT, JointLoad(brake, load))[1:]
    across = JointLoad(0.0, 0.0, across=np.array([one.across for one in bears]))
    acting = log.tau - signal.spread(lost, 1, 2, across)
    np.testing.assert_allclose(replay(log, acting), log.q, atol=1e-12)
    assert np.abs(replay(log, np.array(log.tau)) - log.q).max() > 1e-5


def test_several_causes_act_in_order_and_on_the_joints_that_they_name() -> None:
    texts = ["cogging:pan:amplitude=0.03,harmonic=42", "delay:tilt:time=0.002"]
    texts += ["payload-shift:x=0.003", "dead-zone:tilt:width=0.02"]
    causes = [parse_effect(text, RIG) for text in texts]
    plant, drive = plant_with(NOMINAL, causes)
    assert drive == (causes[1], causes[3])
    assert plant.terms == (*NOMINAL.terms, causes[0])
    assert plant_with(plant, causes[2:3]).plant.changes == (causes[2], causes[2])
    with pytest.raises(RigError, match="no joint 'yaw'"):
        plant_with(NOMINAL, [replace(causes[1], joint="yaw")])


def test_a_base_that_sinks_is_a_platform_that_turns() -> None:
    """The log of the platform holds the base's IMU besides, what sinks unseen does not."""
    t = DT / 2 * np.arange(2001)
    angles = np.outer(t, [0.0, 0.1, 0.0])
    zero = 0 * angles
    turning = Platform.turning(t, angles, np.gradient(angles, t, axis=0), zero, zero)
    sunk = run(plant_with(NOMINAL, [BaseTilt(pitch_rate=0.1)]).plant)
    carried = run(NOMINAL, platform=turning)
    np.testing.assert_allclose(sunk.q, carried.q, atol=1e-9)
    np.testing.assert_allclose(sunk.tau, carried.tau, atol=1e-6)
    assert not sunk.imus and list(carried.imus) == [RIG.base]
    assert np.abs(sunk.tau - run_planted("").tau).max() > 1e-3


EFFECTS = [name for name in sorted(SOME) if issubclass(CAUSES[name], Effect)]


@given(st.lists(st.sampled_from(EFFECTS), min_size=1, max_size=4, unique=True))
def test_the_plant_converges_as_its_step_shrinks(names: list[str]) -> None:
    """Under held torques a tenth of the step leads to the same place, memory and all, through stops and starts."""
    terms = [parse_effect(f"{name}:{SOME[name]}", RIG) for name in names]
    system = Plant(Model(RIG, (*NOMINAL.terms, *terms)))
    coarse = fine = State(np.array([0.1, 0.2]), np.array([0.3, -0.4]))
    for k, tau in enumerate(np.repeat(0.5 * np.random.default_rng(1).normal(size=(12, 2)), 10, 0)):
        coarse = system.step(k * DT, coarse, tau, DT)
        for i in range(10):
            fine = system.step((k + i / 10) * DT, fine, tau, DT / 10)
    np.testing.assert_allclose(coarse.q, fine.q, atol=2e-6)
    np.testing.assert_allclose(coarse.memory, fine.memory, atol=5e-4)


@pytest.mark.parametrize("delay", [0, 4])
def test_the_torque_arrives_after_the_delay_and_no_sooner(delay: int) -> None:
    log = run(NOMINAL, delay=delay)
    assert not np.any(log.tau[:delay]) and np.all(log.tau[delay])


def limit(rig: Rig, **changes: float) -> Rig:
    """Return the rig with a change to the tilt joint's limits."""
    return replace(rig, limits=(rig.limits[0], replace(rig.limits[1], **changes)))


def test_a_log_says_for_how_long_a_motor_was_too_weak_or_a_joint_past_its_stops() -> None:
    """Of what was commanded and of the true angle, whatever noise the sensors have."""
    clean = run_planted("")
    assert not clean.events
    low, high = np.quantile(clean.q[:, 1], [0.2, 0.9]).tolist()
    noisy = Sensors(NOTHING, NOTHING, np.full(2, 0.05))
    (passed,) = run(nominal(limit(RIG, lower=low, upper=high)), noisy).events
    assert "stops" in passed and "tilt 30 %" in passed and "pan" not in passed
    weak = nominal(limit(RIG, effort=0.15))
    share = np.mean(np.abs(run(weak).tau[:, 1]) >= 0.15)
    (said,) = run(weak, noisy).events
    assert f"tilt {100 * share:.0f} %" in said and "pan" not in said


def test_noise_is_drawn_from_the_generator_alone_and_encoders_round() -> None:
    sensors = Sensors(np.array([0.01, 0.0]), np.full(2, 1e-3), np.full(2, 1e-2))
    one, again, other = (run(NOMINAL, sensors, seed) for seed in (1, 1, 2))
    for name in ("q", "v", "tau"):
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))
    assert np.any(one.tau != other.tau)
    np.testing.assert_allclose(one.q[:, 0] / 0.01, np.round(one.q[:, 0] / 0.01), atol=1e-9)
    assert len(np.unique(one.q[:, 1])) > 900
    clean = run_planted("")
    for name, size, alone in (
        ("v", 1e-3, Sensors(NOTHING, sensors.rate_std, NOTHING)),
        ("tau", 1e-2, Sensors(NOTHING, NOTHING, sensors.torque_std)),
    ):
        noise = getattr(run(NOMINAL, alone), name) - getattr(clean, name)
        assert noise.std() == pytest.approx(size, rel=0.1)
    density = Sensors.of(RIG, DT).rate_std * np.sqrt(2 * DT)
    np.testing.assert_allclose(density, RIG.config.noise.gyro)


@pytest.mark.parametrize("gain", [20.0, 1e9])
def test_a_loop_that_diverges_is_refused(gain: float) -> None:
    """However fast: before it is where no machine can be, which no log may hold."""
    free = replace(RIG, motors=tuple(replace(motor, tau_max=np.inf) for motor in RIG.motors))
    free = replace(free, limits=tuple(replace(limit, effort=np.inf) for limit in free.limits))
    wild = ComputedTorque(nominal(free), (Pid(gain, 0.0, -gain),) * 2, DT)
    with np.errstate(all="ignore"), pytest.raises(UsageError, match=r"diverged .* s after"):
        simulate(nominal(free), wild, REFERENCE, rng=0)


def test_a_reference_or_platform_that_does_not_fit_the_loop_is_refused() -> None:
    with pytest.raises(UsageError, match=r"^reference: is not sampled every 0.001 s"):
        simulate(NOMINAL, CONTROL, fourier(RIG, 6, 1.0, 0.002), rng=0)
    with pytest.raises(UsageError, match=r"^platform: lasts"):
        run(NOMINAL, platform=Platform.still(DT * np.arange(500)))
