"""Laws of the closed loop and of what is planted in it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import ComputedTorque, JointPid, Pid
from gimbal_pin.dynamics import Drive, Model, Plant, Sensors, State, nominal, plant_with, simulate
from gimbal_pin.dynamics.drive import compute_joint_load
from gimbal_pin.effects import (
    CAUSES,
    BaseTilt,
    Delay,
    Effect,
    JointLoad,
    Resistance,
    Signal,
    Term,
    parse_effect,
)
from gimbal_pin.errors import RigError, UsageError
from gimbal_pin.identification import identify
from gimbal_pin.log import Array, Log, Motion, describe_passed_stops
from gimbal_pin.rig import Rig
from tests.command_line import Run

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
    "cable-spring": "tilt:stiffness=0.3,rest=0.2,cubic=0.5",
    "armature": "tilt:inertia=0.01",
    "actuator-lag": "tilt:time_constant=0.004",
    "delay": "tilt:time=0.0033",
    "saturation": "tilt:limit=0.3",
    "dead-zone": "tilt:width=0.02",
    "joint-flexibility": "tilt:frequency=60",
    "backlash": "tilt:gap=0.002,inertia=0.0005",
    "payload-shift": "x=0.004,z=-0.002",
    "payload-mass": "extra=0.2",
    "encoder-offset": "tilt:offset=0.02",
    "base-tilt": "pitch=0.05",
    "off-diagonal-inertia": "tilt:Ixz=0.0005",
}


@cache
def rig() -> Rig:
    return Rig.load("turret")


def reference(seconds: float = 1.0, dt: float = DT) -> Motion:
    """Both axes at once, through reversals."""
    t = dt * np.arange(round(seconds / dt))
    w = 2 * np.pi * np.array([0.8, 1.1])
    size = np.array([0.25, 0.2])
    angle = t[:, None] * w
    return Motion(t, size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle))


def law(model: Model, dt: float = DT) -> ComputedTorque:
    return ComputedTorque(model, (Pid.placed(6.0, 1.0, 0.2),) * model.rig.n, dt, lead=1.5 * dt)


def run(
    plant: Model, drive: tuple[Signal, ...] = (), sensors: Sensors | None = None, seed: int = 0
) -> Log:
    """A loop whose controller knows the nominal rig."""
    sense = sensors or Sensors.exact(plant.rig.n)
    model = nominal(rig())
    return simulate(
        plant, law(model), reference(), rng=np.random.default_rng(seed), sensors=sense, drive=drive
    )


@cache
def clean() -> Log:
    """The loop of the nominal rig."""
    return run(nominal(rig()))


def replayed(plant: Model, log: Log, acting: Array) -> Array:
    """Angles of the plant alone under given torques."""
    system = Plant(plant)
    out = np.empty_like(log.q)
    state = State(log.q[0].copy(), reference().v[0].copy())
    for k, t in enumerate(log.t.tolist()):
        out[k] = state.q
        state = system.step(t, state, acting[k], DT)
    return out


def test_every_cause_is_tried() -> None:
    assert set(SOME) == set(CAUSES)


@pytest.mark.parametrize("name", sorted(SOME))
def test_help_lists_every_parameter_of_every_cause(run: Run, name: str) -> None:
    """With its meaning, its unit, and its value if it is not given; nothing is simulated for it."""
    code, out, _ = run("simulate", "turret", "--effect", "help")
    lines = out.splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith(f"{name}:"))
    for parameter in CAUSES[name].stated():
        told = next(row for row in lines[at + 1 :] if row.startswith(f"  {parameter.name},"))
        assert told.endswith(f": {parameter.meaning}") and len(parameter.meaning.split()) > 2
        assert parameter.unit in ("", "1") or parameter.unit in told
        assert ("if not given" in told) == np.isfinite(parameter.value)
    assert code == 0


@pytest.mark.parametrize("name", sorted(SOME))
def test_every_cause_runs_and_shows_in_the_log(name: str) -> None:
    """Planted from its text it changes the torque that the same controller commands, and the loop stays in hand."""
    thing = parse_effect(f"{name}:{SOME[name]}", rig())
    plant, drive = plant_with(nominal(rig()), [thing])
    log = run(plant, drive)
    assert np.abs(log.tau - clean().tau).max() > 1e-3
    assert np.abs(log.q - reference().q).max() < 0.1


@pytest.mark.parametrize("name", sorted(SOME))
def test_a_cause_of_no_size_changes_nothing(name: str) -> None:
    thing = parse_effect(f"{name}:{SOME[name]}", rig())
    if isinstance(thing, Term):
        thing = Term(thing.effect, (0.0,) * len(thing.values))
    else:
        least = {"saturation": {"limit": 1e6}, "actuator-lag": {"time_constant": 1e-5}}
        least["joint-flexibility"] = {"frequency": 500.0, "damping": 0.5}
        thing = replace(
            thing, **least.get(name, {shape.name: max(0.0, shape.lower) for shape in thing.shapes})
        )
    plant, drive = plant_with(nominal(rig()), [thing])
    log = run(plant, drive)
    # The drive's two lags are never wholly gone: 10 µs, and a resonance of 500 Hz.
    tolerance = {"actuator-lag": 1e-5, "joint-flexibility": 3e-4}.get(name, 1e-9)
    np.testing.assert_allclose(log.q, clean().q, atol=tolerance)


SIGNALS = [f"{name}:{SOME[name]}" for name in sorted(SOME) if issubclass(CAUSES[name], Signal)]


@pytest.mark.parametrize(
    "text", [*SIGNALS, "backlash:tilt:gap=0.002,inertia=0.0005,rotor_share=0.2"]
)
def test_the_log_keeps_the_command_and_the_plant_gets_what_the_drive_makes_of_it(text: str) -> None:
    """Passing the logged command through the signal's array form drives the plant along the logged angles.

    A link that the encoder does not see pushes the other joints by its own acceleration.
    """
    signal = parse_effect(text, rig())
    assert isinstance(signal, Signal)
    log = run(nominal(rig()), (signal,))
    acting = np.array(log.tau)
    j = rig().joint_index("tilt")
    states = map(State, log.q, log.v)
    bears = [
        compute_joint_load(nominal(rig()), j, now, x)
        for now, x in zip(states, log.tau[:, j].tolist())
    ]
    brake, load = (
        np.array([0.0, *x]) for x in ([one.brake for one in bears], [one.load for one in bears])
    )
    # The drive has been at rest for ever, the array form would settle on its first sample.
    passed = signal.along(np.concatenate([[0.0], log.tau[:, j]]), DT, JointLoad(brake, load))[1:]
    across = np.array([one.across for one in bears])
    acting -= signal.spread(
        acting[:, j] - passed, j, acting.shape[1], JointLoad(0.0, 0.0, across=across)
    )
    assert np.any(across[:, 1 - j] != 0)
    np.testing.assert_allclose(replayed(nominal(rig()), log, acting), log.q, atol=1e-12)
    assert np.abs(replayed(nominal(rig()), log, np.array(log.tau)) - log.q).max() > 1e-5


def test_under_a_base_that_sinks_the_plant_leans_by_its_rates_time() -> None:
    """A rig held still: what the same controller gives at the end is what holds it on a base that leans so."""
    smooth = Model(rig(), ())
    sinking, still = (
        plant_with(smooth, [BaseTilt(**x)]).plant for x in ({"pitch_rate": 0.1}, {"pitch": 0.1})
    )
    t = DT * np.arange(round(1.0 / DT) + 1)
    q = np.tile([0.2, 0.1], (len(t), 1))
    stand = Motion(t, q, 0 * q, 0 * q)
    sense = Sensors.exact(2)
    known = law(smooth)
    ends = [
        simulate(one, known, stand, rng=np.random.default_rng(0), sensors=sense)
        for one in (sinking, still)
    ]
    assert not ends[0].imus
    np.testing.assert_allclose(
        ends[0].tau[-1], ends[1].tau[-1], atol=0.02 * np.abs(ends[1].tau[-1]).max()
    )
    assert np.abs(ends[0].tau[0] - ends[1].tau[-1]).max() > 0.1 * np.abs(ends[1].tau[-1]).max()


def test_several_causes_at_once_and_in_order() -> None:
    texts = [
        "cogging:pan:amplitude=0.03,harmonic=42",
        "delay:tilt:time=0.002",
        "payload-shift:x=0.003",
    ]
    texts += [
        "dead-zone:tilt:width=0.02",
        "stribeck:pan:speed=0.1,extra=0.05",
        "base-tilt:roll=0.02",
    ]
    things = [parse_effect(text, rig()) for text in texts]
    plant, drive = plant_with(nominal(rig()), things)
    assert [signal.name for signal in drive] == ["delay", "dead-zone"]
    assert [term.effect.name for term in plant.terms[-2:]] == ["cogging", "stribeck"]
    single = [plant_with(nominal(rig()), [things[i]]).plant.rig for i in (2, 5)]
    np.testing.assert_array_equal(plant.rig.phi, single[0].phi)
    np.testing.assert_array_equal(plant.rig.model.gravity.linear, single[1].model.gravity.linear)
    assert np.abs(run(plant, drive).q - reference().q).max() < 0.1
    motors = Drive(drive, rig(), DT)
    x = np.array([0.5, 0.015])
    out = [motors.acting(x) for _ in range(4)]
    np.testing.assert_allclose(np.array(out)[:, 0], 0.5)
    np.testing.assert_allclose(np.array(out)[:, 1], 0.0)
    with pytest.raises(RigError, match=r"no joint 'yaw'"):
        plant_with(nominal(rig()), [Delay("yaw", 0.001)])


@given(
    texts=st.lists(
        st.sampled_from([n for n in sorted(SOME) if issubclass(CAUSES[n], Effect)]),
        min_size=1,
        max_size=4,
        unique=True,
    )
)
def test_the_plant_converges_as_its_step_shrinks(texts: list[str]) -> None:
    """Under held torques a tenth of the step leads to the same place, memory and all, through stops and starts."""
    things = [parse_effect(f"{name}:{SOME[name]}", rig()) for name in texts]
    terms = tuple(thing for thing in things if isinstance(thing, Term))
    system = Plant(Model(rig(), (*nominal(rig()).terms, *terms)))
    coarse = fine = State(np.array([0.1, 0.2]), np.array([0.3, -0.4]))
    rng = np.random.default_rng(len(texts))
    t = 0.0
    for _ in range(12):
        tau = 0.5 * rng.normal(size=2)
        for _ in range(10):
            coarse = system.step(t, coarse, tau, DT)
            for i in range(10):
                fine = system.step(t + i * DT / 10, fine, tau, DT / 10)
            t += DT
    np.testing.assert_allclose(coarse.q, fine.q, atol=2e-6)
    np.testing.assert_allclose(coarse.memory, fine.memory, atol=5e-4)


def test_a_plant_at_rest_with_presliding_springs_back() -> None:
    """Bristles yield under a torque within their level and give it back: no stick where there is no dry friction."""
    level, stroke = 0.05, 0.01
    term = parse_effect(f"presliding:pan:stroke={stroke},level={level}", rig())
    assert isinstance(term, Term)
    system = Plant(Model(rig(), (term,)))
    tau = np.array([0.01, 0.0])
    assert system.contact(0.0, State(np.zeros(2), np.zeros(2)), tau).stuck == ()
    state = State(np.zeros(2), np.zeros(2))
    top = 0.0
    for k in range(600):
        state = system.step(k * DT, state, tau if k < 300 else 0 * tau, DT)
        top = max(top, abs(state.q[0]))
    assert 0 < top < stroke
    assert state.memory[0] == pytest.approx(Resistance(((term,), ())).start[0], abs=top / stroke)


def test_the_torque_arrives_after_the_delay_and_no_sooner() -> None:
    model = nominal(rig())
    pid = JointPid((Pid(30.0, 0.0, 5.0),) * 2, (0.1, 0.1), (9.0, 9.0), DT)
    still = Motion(DT * np.arange(20), np.ones((20, 2)), np.zeros((20, 2)), np.zeros((20, 2)))
    start = State(np.zeros(2), np.zeros(2))
    for delay in (0, 1, 4):
        rng = np.random.default_rng(0)
        log = simulate(
            model, pid, still, rng=rng, sensors=Sensors.exact(2), delay=delay, start=start
        )
        assert not np.any(log.tau[:delay]) and np.allclose(log.tau[delay], 3.0)


@pytest.mark.parametrize("limit", [0.3, 30.0])
def test_a_log_says_which_motors_were_too_weak_and_for_how_long(limit: float) -> None:
    """The share is that of the torque that was commanded, whatever the drive's report of it has of noise."""
    weak = replace(rig(), motors=tuple(replace(motor, tau_max=limit) for motor in rig().motors))
    noisy = replace(Sensors.exact(weak.n), torque_std=np.full(weak.n, 0.05))
    exact, log = (run(nominal(weak), sensors=sensors) for sensors in (None, noisy))
    share = dict(zip(weak.joints, np.mean(np.abs(exact.tau) >= limit, axis=0)))
    assert (max(share.values()) > 0.05) == (limit < 1.0) and log.events == exact.events
    assert [f"{joint} {100 * x:.0f} %" in "".join(log.events) for joint, x in share.items()] == [
        x >= 0.05 for x in share.values()
    ]


def test_a_log_says_which_joints_went_past_their_stops_and_for_how_long() -> None:
    """Of the true angle; a simulation has no stops, and a loop that keeps off them is told nothing of."""
    free = run(nominal(rig()))
    assert not any("past its stops" in event for event in free.events)
    low, high = (float(np.quantile(free.q[:, 1], share)) for share in (0.2, 0.9))
    narrow = replace(
        rig(), limits=(rig().limits[0], replace(rig().limits[1], lower=low, upper=high))
    )
    (said,) = run(nominal(narrow)).events
    assert (
        describe_passed_stops(("tilt",), free.q[:, 1:], np.array([low]), np.array([high]))
        == "tilt 30 %"
    )
    assert "past its stops" in said and "tilt 30 %" in said and "pan" not in said


def test_noise_is_drawn_from_the_generator_alone_and_encoders_round() -> None:
    sensors = Sensors(np.array([0.01, 0.0]), np.full(2, 1e-3), np.full(2, 1e-2))
    one, again, other = (run(nominal(rig()), sensors=sensors, seed=seed) for seed in (1, 1, 2))
    for name in ("q", "v", "tau"):
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))
    assert np.any(one.tau != other.tau)
    np.testing.assert_allclose(one.q[:, 0] / 0.01, np.round(one.q[:, 0] / 0.01), atol=1e-9)
    assert len(np.unique(one.q[:, 1])) > 900
    silent = Sensors(np.zeros(2), np.zeros(2), np.zeros(2))
    noise = (
        run(nominal(rig()), sensors=replace(silent, torque_std=np.full(2, 1e-2))).tau
        - run(nominal(rig())).tau
    )
    assert noise.std() == pytest.approx(1e-2, rel=0.1) and abs(noise.mean()) < 1e-3


@pytest.mark.parametrize("gain", [20.0, 40.0, 1e3, 1e9])
def test_a_loop_that_cannot_be_is_refused(gain: float) -> None:
    """However fast it diverges: before it is where no machine can be, which no log may hold."""
    model = nominal(rig())
    rng = np.random.default_rng(0)
    with pytest.raises(UsageError, match=r"reference: is not sampled every 0.001 s"):
        simulate(model, law(model), reference(dt=0.002), rng=rng)
    wild = ComputedTorque(nominal(rig()), (Pid(gain, 0.0, -gain),) * 2, DT)
    free = replace(rig(), motors=tuple(replace(motor, tau_max=np.inf) for motor in rig().motors))
    loose = Model(
        replace(free, limits=tuple(replace(x, effort=np.inf) for x in free.limits)), model.terms
    )
    with (
        np.errstate(all="ignore"),
        pytest.raises(UsageError, match=r"the closed loop diverged .* s after its start; lower"),
    ):
        simulate(loose, replace(wild, model=loose), reference(), rng=rng)


def test_causes_on_two_joints_are_told_apart() -> None:
    """Cogging on one axis and a delay-free Stribeck on the other: both come back, neither leaks into the other."""
    dt = 0.002
    texts = ["cogging:pan:amplitude=0.04,harmonic=14,phase=1", "stribeck:tilt:speed=0.1,extra=0.08"]
    terms = [
        thing for thing in (parse_effect(text, rig()) for text in texts) if isinstance(thing, Term)
    ]
    t = dt * np.arange(6000)
    w = 2 * np.pi * np.array([[0.13, 0.17], [0.41, 0.36]])
    size = np.array([[0.7, 0.5], [0.2, 0.2]])
    angle = t[:, None, None] * w
    motion = Motion(
        t,
        (size * np.sin(angle)).sum(1),
        (size * w * np.cos(angle)).sum(1),
        (-size * w**2 * np.sin(angle)).sum(1),
    )
    model = nominal(rig())
    plant, drive = plant_with(model, terms)
    sensors = Sensors(np.full(2, 1e-6), np.full(2, 1e-4), np.full(2, 2e-3))
    log = simulate(
        plant, law(model, dt), motion, rng=np.random.default_rng(3), sensors=sensors, drive=drive
    )
    effects = [term.effect for term in terms]
    swapped = [replace(effects[0], joint="tilt"), replace(effects[1], joint="pan")]
    found = identify(rig(), [log], [*effects, *swapped], holdout="none").estimate
    truth = np.array([*terms[0].values, *terms[1].values, 0.0, 0.0, 0.0])
    assert np.all(np.abs(found.theta[-6:] - truth) < 4 * found.std[-6:])
    assert np.all(found.std[-6:] < 0.01)


def test_the_plant_does_not_depend_on_how_often_the_controller_looks() -> None:
    plant, drive = plant_with(
        nominal(rig()), [parse_effect("cable-spring:tilt:stiffness=0.3,rest=0.2,cubic=0.5", rig())]
    )
    ends = []
    for dt in (0.001, 0.02, 0.1):
        t = dt * np.arange(round(0.8 / dt) + 1)
        idle = JointPid((Pid(1.0, 0.0, 1.0),) * 2, (1e-12,) * 2, (1.0, 1.0), dt)
        zero = np.zeros((len(t), 2))
        start = State(np.zeros(2), np.array([1.0, -2.0]))
        log = simulate(
            plant,
            idle,
            Motion(t, zero, zero, zero),
            rng=0,
            sensors=Sensors.exact(2),
            drive=drive,
            start=start,
        )
        ends.append(log.q[-1])
    np.testing.assert_allclose(ends[1:], ends[:1] * 2, atol=1e-6)
