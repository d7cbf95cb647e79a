"""Laws of the causes; every test over CAUSES picks up a new file by itself."""

from __future__ import annotations

import json
from functools import cache
from math import isnan, nan
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from lxml import etree
from scipy.linalg import expm

from gimbal_pin.control import ComputedTorque, Pid
from gimbal_pin.dynamics import (
    Model,
    Plant,
    Sensors,
    State,
    compute_regressor,
    compute_rnea,
    nominal,
    plant_with,
    simulate,
)
from gimbal_pin.effects import (
    ALWAYS,
    CAUSES,
    ActuatorLag,
    Backlash,
    BaseTilt,
    CableSpring,
    Cause,
    Cogging,
    Coulomb,
    DeadZone,
    Delay,
    Effect,
    EncoderOffset,
    FrictionDrift,
    Harmonic,
    JointFlexibility,
    Losses,
    OffDiagonalInertia,
    OperatingRange,
    Parameter,
    PayloadMass,
    PayloadShift,
    PositionDependentFriction,
    Presliding,
    QuadraticDrag,
    RigEffect,
    Sample,
    Saturation,
    Signal,
    Term,
    TorqueRipple,
    TorqueTable,
    get_payload,
    parse_effect,
    read_cause,
    read_term,
)
from gimbal_pin.errors import GimbalPinError, ModelError, UsageError
from gimbal_pin.identification import identify
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.rig import PHI, Rig, build_rig

KINDS: dict[str, type[Cause]] = {**CAUSES, **{kind.name: kind for kind in ALWAYS}}
TORQUES = sorted(name for name, kind in KINDS.items() if issubclass(kind, Effect))
SIGNALS = sorted(name for name, kind in KINDS.items() if issubclass(kind, Signal))
RIGS = sorted(name for name, kind in KINDS.items() if issubclass(kind, RigEffect))

CONTRACT = [
    "stribeck",
    "asymmetric-friction",
    "load-dependent-friction",
    "presliding",
    "position-dependent-friction",
    "friction-drift",
    "quadratic-drag",
    "cogging",
    "torque-ripple",
    "torque-gain",
    "torque-bias",
    "actuator-lag",
    "delay",
    "saturation",
    "dead-zone",
    "cable-spring",
    "joint-flexibility",
    "backlash",
    "armature",
    "payload-shift",
    "payload-mass",
    "encoder-offset",
    "base-tilt",
    "off-diagonal-inertia",
]
BEYOND = ("platform-motion",)
"""Wished for, not yet here."""


@cache
def rig(name: str = "thesis") -> Rig:
    return Rig.load(name)


def drawn(parameter: Parameter, rng: np.random.Generator) -> float:
    """A value within the parameter's bounds, of a size that a rig may have."""
    if parameter.name in ("harmonic", "harmonic_2"):
        return float(rng.integers(1, 60))
    low = max(parameter.lower, -0.3)
    high = min(parameter.upper, 0.4)
    if low >= 0.4 or high <= low:
        low = parameter.lower
        high = min(parameter.upper, 10 * parameter.lower)
    return float(rng.uniform(low, high))


def planted(name: str, rng: np.random.Generator, joint: str = "tilt") -> Any:
    """One of the kind with drawn parameters."""
    kind = KINDS[name]
    return kind.planted(
        joint if kind.of_joint else None, {p.name: drawn(p, rng) for p in kind.stated()}
    )


def states(rng: np.random.Generator, count: int = 40) -> Sample:
    """Consecutive samples of one joint, sliding the way it moves; its motor gave nothing before."""
    t = np.linspace(0.0, 5.0, count)
    v = rng.normal(size=count)
    q = np.cumsum(v) * 0.1
    rest = (
        rng.normal(size=count),
        np.sign(v),
        rng.normal(size=count),
        25 + rng.uniform(0, 20, count),
    )
    return Sample(t, q, v, *rest, losses=Losses(np.zeros(1), t))


def alone(many: Sample, i: int, memory: float | None) -> Sample:
    """Sample `i` as floats."""
    return Sample(*(float(np.asarray(x)[i]) for x in many[:7]), memory=memory)


def test_every_cause_of_the_contract_is_here() -> None:
    assert set(CAUSES) == set(CONTRACT)
    assert not set(CAUSES) & {*BEYOND, *(kind.name for kind in ALWAYS)}


@pytest.mark.parametrize("name", sorted(CAUSES))
def test_a_cause_says_what_it_is(name: str) -> None:
    thing = planted(name, np.random.default_rng(0))
    sentence = thing.sentence()
    kind = CAUSES[name]
    assert sentence.startswith(
        f"{thing.effect.joint if isinstance(thing, Term) else thing.place}: {name}, "
    )
    assert any(letter.isdigit() for letter in sentence) and "nan" not in sentence
    assert len(kind.experiment) > 20 and len(kind.compensation) > 20
    for parameter in kind.stated():
        assert parameter.unit and parameter.lower < parameter.upper


# -- torque effects --


@pytest.mark.parametrize("name", TORQUES)
@given(seed=st.integers(0, 2**32 - 1))
def test_floats_and_arrays_agree(name: str, seed: int) -> None:
    """One sample at a time, with the memory carried along, gives what the whole array gives."""
    rng = np.random.default_rng(seed)
    effect: Effect = planted(name, rng).effect
    many = states(rng)
    whole = np.column_stack(
        [np.broadcast_to(column, np.shape(many.t)) for column in effect.basis(many)]
    )
    memory = effect.start()
    q = np.asarray(many.q)
    for i in range(len(q)):
        if memory is not None and i:
            memory = effect.evolve(memory, float(q[i] - q[i - 1]))
        single = effect.basis(alone(many, i, memory))
        assert all(isinstance(value, float) for value in single)
        assert len(single) == len(effect.coefficients) == whole.shape[1]
        np.testing.assert_allclose(single, whole[i], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", TORQUES)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_an_effect_declares_is_true(name: str, seed: int) -> None:
    """`affine`, `loaded`, `dry`, and linearity in the acceleration, on which the plant builds."""
    rng = np.random.default_rng(seed)
    effect: Effect = planted(name, rng).effect
    memory = None if effect.start() is None else float(rng.uniform(-1, 1))
    at = alone(states(rng), 7, memory)

    def basis(**changes: float) -> Array:
        return np.array(effect.basis(at._replace(**changes)))

    assert effect.loaded or np.array_equal(basis(), basis(tau=3.3))
    assert effect.dry or np.array_equal(basis(), basis(slide=0.3))
    np.testing.assert_allclose(
        basis(a=2.0) - basis(a=0.0), 2 * (basis(a=1.0) - basis(a=0.0)), atol=1e-12
    )
    if effect.affine:
        zero = np.array(effect.basis(Sample(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
        per_slide = basis(slide=1.0, v=0.0) - zero
        per_rate = basis(slide=0.0, v=1.0) - zero
        np.testing.assert_allclose(
            basis(), zero + at.slide * per_slide + at.v * per_rate, atol=1e-12
        )


@pytest.mark.parametrize("name", TORQUES)
@given(seed=st.integers(0, 2**32 - 1), factor=st.floats(-3, 3))
def test_torque_is_linear_in_the_coefficients(name: str, seed: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    effect = planted(name, rng).effect
    many = states(rng)
    x, y = rng.normal(size=(2, len(effect.coefficients)))
    sum_of_torques = Term(effect, tuple(x)).torque(many) + factor * np.asarray(
        Term(effect, tuple(y)).torque(many)
    )
    np.testing.assert_allclose(
        Term(effect, tuple(x + factor * y)).torque(many), sum_of_torques, atol=1e-10
    )
    assert not np.any(Term(effect, (0.0,) * len(x)).torque(many))


@pytest.mark.parametrize("name", [name for name in TORQUES if KINDS[name].dry])  # type: ignore[attr-defined]
@given(seed=st.integers(0, 2**32 - 1))
def test_dry_effects_oppose_motion(name: str, seed: int) -> None:
    """With the Coulomb friction that `plant_with` asks for, dry torque takes energy either way; at rest it holds."""
    rng = np.random.default_rng(seed)
    term: Term = planted(name, rng)
    enough = Term(Coulomb("tilt"), (1.0,))
    plant_with(Model(rig(), (enough,)), [term])
    at = alone(states(rng), 3, None)
    for way in (-1.0, 1.0):
        sliding = at._replace(slide=way, v=0.0)
        assert way * float(term.torque(sliding) + enough.torque(sliding)) >= 0
        half = float(term.torque(sliding._replace(slide=way / 2)))
        assert half == pytest.approx(float(term.torque(sliding)) / 2, abs=1e-12)
    assert term.torque(at._replace(slide=0.0, v=0.0)) == 0


def test_dry_friction_that_would_push_is_refused() -> None:
    with pytest.raises(UsageError, match=r"joint tilt.*it would push"):
        plant_with(
            nominal(rig()),
            [parse_effect("position-dependent-friction:tilt:amplitude=0.5,harmonic=3", rig())],
        )
    with pytest.raises(UsageError, match=r"joint roll.*it would push"):
        plant_with(nominal(rig()), [parse_effect("asymmetric-friction:roll:coulomb=0.04", rig())])


@pytest.mark.parametrize("name", TORQUES)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_plant_obeys_the_equation_that_is_fitted(name: str, seed: int) -> None:
    """Accelerate by `Plant`, then ask `Model.inverse` for the torque of that motion: it is the torque put in."""
    rng = np.random.default_rng(seed)
    model = Model(rig(), (*nominal(rig()).terms, planted(name, rng)))
    plant = Plant(model)
    tau = rng.normal(size=3)
    state = State(rng.uniform(-0.6, 0.6, 3), rng.choice([-1, 1], 3) * rng.uniform(0.1, 2, 3))
    t = float(rng.uniform(0, 10))
    contact = plant.contact(t, state, tau)
    assert contact.stuck == ()
    a = plant.acceleration(t, state, tau)
    row = (x[None, :] for x in (state.q, state.v, a))
    cold = [Losses(np.zeros(1), np.array([t]))] * 3
    np.testing.assert_allclose(
        model.inverse(*row, t=np.array([t]), losses=cold)[0], tau, rtol=1e-8, atol=1e-8
    )


def test_presliding_slides_after_its_stroke_and_forgets_no_small_reversal() -> None:
    effect = Presliding("tilt", stroke=0.01)
    assert effect.evolve(0.0, 0.01) == pytest.approx(1 - np.exp(-1))
    assert effect.evolve(0.3, 1.0) == pytest.approx(1.0)
    q = np.linspace(0, 0.02, 300)
    np.testing.assert_allclose(effect.scan(q)[-1], effect.evolve(0.0, 0.02))
    loop = effect.scan(np.concatenate([q, q[::-1], q]))
    assert loop[-1] < loop[299] and loop.min() < 0 < loop[-1]


@given(stroke=st.floats(1e-4, 0.5))
def test_every_stroke_is_within_reach_of_one_that_is_tried(stroke: float) -> None:
    seen = OperatingRange(60.0, 0.005, 12.0, 1.6, 1.0, 1e-3, 1.0, 1.2)
    reach = 2.0 ** sum(0.5**k for k in range(8)) * 1.01
    away = [
        abs(np.log(stroke / one.stroke))
        for one in Presliding.tried("tilt", seen)
        if isinstance(one, Presliding)
    ]
    assert min(away) <= np.log(reach)


def test_drift_by_temperature_reads_the_temperature() -> None:
    effect = FrictionDrift("tilt", thermal=True)
    at = Sample(100.0, 0.0, 2.0, 0.0, 1.0, 0.0, temperature=35.0)
    assert effect.basis(at) == (1.0, 2.0)
    assert effect.basis(at._replace(temperature=25.0)) == (0.0, 0.0)
    q = np.zeros((4, 3))
    warm = Model(rig(), (Term(effect, (0.5, 0.0)),)).inverse(
        q, q, q, slide=q + 1.0, temperature=q + 45.0
    )
    np.testing.assert_allclose((warm - compute_rnea(rig(), q, q, q))[:, 2], 1.0)


# -- planted in a simulation, found by identification --

PLANTED = {
    "stribeck": "pan:speed=0.1,extra=0.1",
    "asymmetric-friction": "tilt:coulomb=0.006,viscous=0.005",
    "load-dependent-friction": "tilt:mu=0.05",
    "position-dependent-friction": "pan:amplitude=0.03,harmonic=3,phase=1",
    "friction-drift": "pan:span=10,coulomb=0.1,viscous=0.05",
    "quadratic-drag": "pan:drag=0.05",
    "cogging": "pan:amplitude=0.05,harmonic=12,phase=0.5",
    "torque-ripple": "tilt:amplitude=0.1,harmonic=6",
    "torque-bias": "pan:bias=0.05",
    "cable-spring": "pan:stiffness=0.3,rest=0.2,cubic=0.2",
    "presliding": "tilt:stroke=0.02,level=0.1",
    "armature": "tilt:inertia=0.02",
    "torque-gain": "tilt:gain=0.9",
}
COUPLED = ("armature", "torque-gain")
"""What only shows where an axis is coupled to another that tilts it: the three-axis rig."""
DT = 0.004


def excitation(joints: int) -> Motion:
    """Sums of three sines per joint, 10 s."""
    t = DT * np.arange(2500)
    frequencies = (
        2 * np.pi * np.array([[0.11, 0.13, 0.16], [0.37, 0.43, 0.31], [0.9, 0.7, 0.8]])[:, :joints]
    )
    sizes = np.array([[0.6, 0.5, 0.4], [0.25, 0.2, 0.2], [0.06, 0.05, 0.07]])[:, :joints]
    phases = np.array([[0.0, 1.0, 2.0], [2.0, 0.5, 1.0], [1.0, 3.0, 0.0]])[:, :joints]
    angle = t[:, None, None] * frequencies + phases
    q, v, a = (
        (sizes * f).sum(axis=1)
        for f in (np.sin(angle), frequencies * np.cos(angle), -(frequencies**2) * np.sin(angle))
    )
    return Motion(t, q, v, a)


def recorded(term: Term, where: Rig) -> Log:
    """A closed-loop log of a rig with a term on top, with sensor noise."""
    model = nominal(where)
    n = where.n
    law = ComputedTorque(model, (Pid.placed(5.0, 1.0, 0.2),) * n, DT, lead=1.5 * DT)
    sensors = Sensors(np.full(n, 2 * np.pi / 2**20), np.full(n, 1e-4), np.full(n, 2e-3))
    plant, drive = plant_with(model, [term])
    return simulate(
        plant, law, excitation(n), rng=np.random.default_rng(1), sensors=sensors, drive=drive
    )


@pytest.mark.parametrize(
    "name", sorted(PLANTED.keys() - {"torque-gain", "torque-ripple", "load-dependent-friction"})
)
def test_identification_finds_what_was_planted(name: str) -> None:
    where = rig("thesis" if name in COUPLED else "turret")
    term = parse_effect(f"{name}:{PLANTED[name]}", where)
    assert isinstance(term, Term)
    found = identify(where, [recorded(term, where)], [term.effect], holdout="none")
    k = len(term.values)
    theta = found.estimate.theta[-k:]
    covariance = found.estimate.covariance[-k:, -k:]
    away = theta - np.array(term.values)
    std = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(away) < 4 * std)
    scale = np.abs(term.values).max()
    assert np.all(std < 0.5 * scale)
    shown = {p.name: p for p in term.effect.shown(theta, covariance)}
    for truth in term.effect.shown(term.values):
        got = shown[truth.name]
        assert isnan(got.std) or abs(got.value - truth.value) < 5 * got.std


def test_every_torque_effect_is_planted_and_sought() -> None:
    assert set(PLANTED) == set(TORQUES) & set(CAUSES)


def test_a_torque_gain_shows_through_the_coupling_of_axes() -> None:
    """Against a column of the model's own total torque, least squares finds the missing share beside the inertias."""
    where = rig()
    term = parse_effect("torque-gain:tilt:gain=0.9", where)
    assert isinstance(term, Term)
    model = Model(where, (term,))
    motion = excitation(3)
    rows = slice(None, None, 20)
    q = motion.q[rows]
    v = motion.v[rows]
    a = motion.a[rows]
    total = model.inverse(q, v, a)
    column = np.zeros((*q.shape, 1))
    column[:, 2, 0] = term.effect.basis(Sample(*([0.0] * 5), tau=total[:, 2]))[0]
    A = np.concatenate([compute_regressor(where, q, v, a), column], axis=2).reshape(-1, 31)
    theta = np.linalg.lstsq(A, total.ravel(), rcond=1e-10)[0]
    assert theta[-1] == pytest.approx(0.1, abs=1e-6)


# -- what the numbers look like --


def test_amplitude_and_phase_are_those_of_the_cosine() -> None:
    term = parse_effect("cogging:yaw:amplitude=0.03,harmonic=42,phase=0.7", rig())
    assert isinstance(term, Term)
    q = np.linspace(-1, 1, 50)
    zero = np.zeros(50)
    at = Sample(zero, q, zero, zero, zero, zero)
    np.testing.assert_allclose(term.torque(at), 0.03 * np.cos(42 * q + 0.7), atol=1e-15)
    assert term.sentence() == "yaw: cogging, 0.03 N m at 42 per turn"


TURN = OperatingRange(60.0, 0.005, 12.0, 7.0, 1.0, 1e-3, 1.0, 1.2)


def share_no_motor_makes(sizes: dict[int, float]) -> float:
    lines = tuple(float(k) for k in sorted(sizes))
    return Cogging("yaw", lines).compute_stray_share(
        np.array([sizes[int(k)] ** 2 for k in lines]), TURN
    )


@given(st.integers(4, 42), st.integers(3, 48), st.integers(0, 10**6))
def test_lines_of_poles_and_slots_and_of_the_turn_are_a_motors(
    poles: int, slots: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    own = [k for k in range(1, 145) if not (k % poles and k % slots)] + [1]
    sizes = {k: float(rng.uniform(0.1, 1.0)) for k in own}
    assert share_no_motor_makes(sizes) < 1e-9
    weak = dict.fromkeys((poles + 1, slots - 1), 0.01)
    assert share_no_motor_makes(weak | sizes) < 0.1
    assert share_no_motor_makes({k: 7.0 * size for k, size in sizes.items()}) < 1e-9


def test_lines_of_a_notch_are_no_motors() -> None:
    q = np.radians(np.arange(0.0, 360.0, 0.25))
    notch = np.where((q > np.radians(10)) & (q < np.radians(20)), 0.05, 0.0)
    spectrum = np.abs(np.fft.rfft(notch))
    assert (
        share_no_motor_makes({k: float(spectrum[k]) for k in (46, 34, 25, 14, *range(2, 16))}) > 0.2
    )


@pytest.mark.parametrize("kind", [Cogging, TorqueRipple, PositionDependentFriction])
def test_what_is_read_of_a_harmonic_has_the_bounds_of_what_is_stated(kind: type[Harmonic]) -> None:
    stated = {p.name: p for p in kind.stated()}
    for p in kind("yaw", (12.0, 24.0)).shown((0.1, 0.2, 0.3, 0.4)):
        of = stated[p.name.removesuffix("_2")]
        assert of.lower <= p.lower and p.upper <= of.upper and p.unit == of.unit


def test_uncertainty_is_carried_to_what_is_shown() -> None:
    """The spread of the shown figures over drawn coefficients is the stated one."""
    rng = np.random.default_rng(0)
    cases: list[tuple[Effect, Array]] = [
        (Cogging("yaw", (12.0, 24.0)), np.array([0.05, 0.02, -0.01, 0.03])),
        (CableSpring("yaw"), np.array([-0.1, 0.5])),
        (CableSpring("yaw", stiffening=True), np.array([-0.1, 0.5, -0.3, 0.4])),
    ]
    for effect, values in cases:
        root = 1e-3 * rng.normal(size=(len(values), len(values)))
        covariance = root @ root.T
        draws = rng.multivariate_normal(values, covariance, 4000)
        sampled = np.array([[p.value for p in effect.shown(draw)] for draw in draws])
        for p, spread in zip(effect.shown(values, covariance), sampled.std(axis=0)):
            assert isnan(p.std) or spread == pytest.approx(p.std, rel=0.1)
    names = [p.name for p in cases[0][0].shown(cases[0][1])]
    assert names == ["amplitude", "harmonic", "phase", "amplitude_2", "harmonic_2", "phase_2"]


# -- drive signals --


@pytest.mark.parametrize("name", SIGNALS)
@given(seed=st.integers(0, 2**32 - 1))
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
    level = 0.3
    settled = signal.acting(np.full(50, level), dt)
    np.testing.assert_allclose(settled, settled[0], rtol=1e-9)
    if not isinstance(signal, Saturation | DeadZone):
        assert settled[0] == pytest.approx(level)


@given(
    seed=st.integers(0, 2**32 - 1),
    whole=st.integers(0, 12),
    part=st.floats(0, 1, exclude_max=True),
)
def test_a_delay_shifts_and_mixes_within_one_interval(seed: int, whole: int, part: float) -> None:
    x = np.random.default_rng(seed).normal(size=60)
    dt = 0.002
    y = Delay("tilt", (whole + part) * dt).acting(x, dt)
    k = np.arange(13, 60)
    np.testing.assert_allclose(y[k], (1 - part) * x[k - whole] + part * x[k - whole - 1], atol=1e-6)
    np.testing.assert_allclose(y[: whole + 1], x[0], atol=1e-9)


@given(T=st.floats(1e-3, 0.2), dt=st.floats(1e-4, 0.01))
def test_the_step_response_of_a_lag_is_exponential(T: float, dt: float) -> None:
    lag = ActuatorLag("tilt", T)
    memory = (0.0,)
    for k in range(1, 40):
        memory, mean = lag.step(memory, 1.0, dt)
        assert memory[0] == pytest.approx(1 - np.exp(-k * dt / T), rel=1e-9)
        over = np.linspace((k - 1) * dt, k * dt, 2001)
        assert mean == pytest.approx(np.trapezoid(1 - np.exp(-over / T), over) / dt, rel=1e-5)


@given(
    f=st.floats(5, 120),
    zeta=st.floats(0.001, 0.5),
    share=st.floats(0.05, 0.95),
    on_rotor=st.booleans(),
)
def test_joint_flexibility_is_two_masses_on_a_spring(
    f: float, zeta: float, share: float, on_rotor: bool
) -> None:
    """Rotor, spring, link integrated exactly, against the rigid joint behind the signal: the same encoder angle."""
    dt, total = 1e-3, 0.2
    J = share * total
    K = (1 - share) * total
    w = 2 * np.pi * f
    reduced = J * K / total
    k = w**2 * reduced
    c = 2 * zeta * w * reduced
    A = np.zeros((5, 5))
    A[0, 1] = A[2, 3] = 1.0
    A[1] = [-k / J, -c / J, k / J, c / J, 1 / J]
    A[3] = [k / K, c / K, -k / K, -c / K, 0.0]
    flow = expm(A * dt)
    x = np.random.default_rng(3).normal(size=200)
    read = []
    state = np.zeros(5)
    for torque in x:
        state[4] = torque
        state = flow @ state
        read.append(state[1 if on_rotor else 3])
    signal = JointFlexibility("tilt", f, zeta, share if on_rotor else 0.0)
    memory = signal.start()
    rate = 0.0
    rigid = []
    for torque in x.tolist():
        memory, y = signal.step(memory, torque, dt)
        rate += y / total * dt
        rigid.append(rate)
    np.testing.assert_allclose(rigid, read, atol=1e-9 * max(np.abs(read)) + 1e-12)


@given(
    st.integers(0, 2**32 - 1),
    st.floats(1e-4, 0.1),
    st.floats(1e-4, 1e-2),
    st.sampled_from([0.0, 0.25, 0.5]),
)
def test_backlash_keeps_the_momentum_and_the_gap(
    seed: int, gap: float, inertia: float, share: float
) -> None:
    rng = np.random.default_rng(seed)
    dt = 1e-3
    moved = inertia * (
        1 - 1 / share if share else 1.0
    )  # the rotor's, or less the link's that no encoder sees
    signal = Backlash("tilt", gap, inertia, share)
    x = rng.normal(size=200) + 0.5 * np.sin(np.arange(200) / 10)
    memory = signal.start()
    passed = 0.0
    for k, torque in enumerate(x.tolist()):
        before = memory
        memory, y = signal.step(memory, torque, dt)
        passed += y * dt
        assert passed + moved * memory[1] == pytest.approx(x[: k + 1].sum() * dt, abs=1e-9)
        assert abs(memory[0]) <= gap / 2
        pushes = abs(before[0]) == gap / 2 and before[1] == 0 and torque * before[0] > 0
        if pushes:
            assert y == pytest.approx(torque)
        if abs(memory[0]) < gap / 2 and not share:
            assert y == pytest.approx(0, abs=1e-9)
    stepped = Signal.acting(signal, x, dt)
    np.testing.assert_array_equal(signal.acting(x, dt), stepped)


def test_static_signals() -> None:
    x = np.linspace(-2, 2, 101)
    np.testing.assert_array_equal(Saturation("tilt", 0.7).acting(x, 1e-3), np.clip(x, -0.7, 0.7))
    np.testing.assert_array_equal(Saturation("tilt", 0.7, 1).acting(x, 1e-3), np.minimum(x, 0.7))
    np.testing.assert_array_equal(Saturation("tilt", 0.7, -1).acting(x, 1e-3), np.maximum(x, -0.7))
    y = DeadZone("tilt", 0.3).acting(x, 1e-3)
    np.testing.assert_allclose(y, np.sign(x) * np.maximum(np.abs(x) - 0.3, 0), atol=1e-15)


@given(sharpness=st.floats(1.0, 200.0), width=st.floats(1e-3, 2.0))
def test_a_sharp_dead_zone_halves_a_command_of_its_width_and_passes_large_ones(
    sharpness: float, width: float
) -> None:
    """Odd, growing with the command, never more than it; half at the width; the sharper, the more like a threshold."""
    zone = DeadZone("tilt", width, sharpness)
    x = np.linspace(-5.0, 5.0, 201) * width
    y = zone.acting(x, 1e-3)
    np.testing.assert_allclose(y, -y[::-1], atol=1e-15)
    assert np.all(np.diff(y) >= 0) and np.all(np.abs(y) <= np.abs(x))
    assert zone.passed(width) == pytest.approx(width / 2)
    np.testing.assert_allclose(zone.passed(1e6 * width), 1e6 * width, rtol=1e-5)
    assert zone.passed(2.0 ** (1 / sharpness) * width) == pytest.approx(
        0.75 * 2.0 ** (1 / sharpness) * width
    )
    assert (
        abs(float(zone.passed(0.9 * width)))
        <= 0.9 * width * np.log(2) * 0.9**sharpness + 1e-15 * width
    )


@pytest.mark.parametrize("power", [1.5, 2.0, 3.0])
def test_drag_grows_by_its_power(power: float) -> None:
    at = [Sample(0.0, 0.0, v, 0.0, 1.0, 0.0) for v in (-2.0, -1.0, 0.0, 1.0, 2.0)]
    values = [QuadraticDrag("tilt", power).basis(each)[0] for each in at]
    np.testing.assert_allclose(values, [-(2.0**power), -1.0, 0.0, 1.0, 2.0**power])


# -- the rig --


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_effect_of_nothing_changes_nothing_and_none_touches_its_rig(name: str) -> None:
    rng = np.random.default_rng(0)
    where = rig()
    q, v, a = rng.uniform(-0.6, 0.6, (3, 5, 3))
    before = compute_rnea(where, q, v, a)
    kind = KINDS[name]
    nothing: RigEffect = kind.planted("tilt", {p.name: 0.0 for p in kind.stated()})
    np.testing.assert_allclose(compute_rnea(nothing.apply(where), q, v, a), before, atol=1e-12)
    small = {p.name: min(0.004, p.upper) for p in kind.stated()}
    changed: RigEffect = kind.planted("tilt", small)
    assert np.abs(compute_rnea(changed.apply(where), q, v, a) - before).max() > 1e-6
    np.testing.assert_array_equal(compute_rnea(where, q, v, a), before)


@pytest.mark.parametrize("name", ["thesis", "turret", "handheld"])
def test_a_shifted_payload_takes_the_centre_of_mass_with_it(name: str) -> None:
    where = rig(name)
    shift = np.array([0.004, -0.002, 0.003])
    moved = PayloadShift(*shift).apply(where)
    before = where.model
    after = moved.model
    q = np.zeros(where.n)
    change = pin.centerOfMass(after, after.createData(), q) - pin.centerOfMass(
        before, before.createData(), q
    )
    frame = where.model.getFrameId(str(where.payload_link))
    data = before.createData()
    pin.framesForwardKinematics(before, data, q)
    mass = payload_mass(where)
    moving = sum(inertia.mass for inertia in before.inertias[1:])
    np.testing.assert_allclose(change * moving, mass * data.oMf[frame].rotation @ shift, atol=1e-9)
    body = before.frames[frame].parentJoint
    np.testing.assert_allclose(after.inertias[body].mass, before.inertias[body].mass)


def payload_mass(where: Rig) -> float:
    """Mass of the bundled payload, from its own URDF text."""
    link = etree.fromstring(where.urdf.encode()).find(f"link[@name='{where.payload_link}']")
    return float(link.find("inertial/mass").get("value"))


def test_a_payload_shifted_there_and_back_is_where_it_was() -> None:
    where = rig()
    there = PayloadShift(0.05, -0.02, 0.03).apply(where)
    _, before, _ = get_payload(where)
    body = where.model.frames[where.model.getFrameId(str(where.payload_link))].parentJoint
    inertia = pin.Inertia(there.model.inertias[body])
    assert inertia.mass == pytest.approx(where.model.inertias[body].mass)
    # Steiner: about the common centre of mass the moment of inertia changes, about the payload's own it does not.
    own = pin.Inertia(before)
    rest = where.model.inertias[body].toDynamicParameters() - own.toDynamicParameters()
    moved = pin.Inertia.FromDynamicParameters(inertia.toDynamicParameters() - rest)
    np.testing.assert_allclose(moved.inertia, own.inertia, atol=1e-10)
    turned = where.model.frames[where.model.getFrameId(str(where.payload_link))].placement.rotation
    np.testing.assert_allclose(moved.lever - own.lever, turned @ [0.05, -0.02, 0.03], atol=1e-12)


def test_payload_mass_scales_the_payload() -> None:
    where = rig()
    extra = 0.5
    _, own, _ = get_payload(where)
    assert own.mass == pytest.approx(payload_mass(where))
    heavier = PayloadMass(extra).apply(where)
    change = heavier.phi - where.phi
    np.testing.assert_allclose(
        change[20:], own.toDynamicParameters() * extra / own.mass, atol=1e-12
    )
    assert not change[:20].any()
    with pytest.raises(UsageError, match=r"payload-mass.*no body can have"):
        PayloadMass(-20.0).apply(where)


def test_no_payload_no_shift() -> None:
    with pytest.raises(UsageError, match=r"carries no payload"):
        PayloadShift(0.01).apply(Rig.load("thesis", "none"))


@given(
    offset=st.floats(-3, 3),
    joint=st.sampled_from(["yaw", "roll", "tilt"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_an_offset_encoder_reads_another_angle_of_the_same_rig(
    offset: float, joint: str, seed: int
) -> None:
    where = rig()
    rng = np.random.default_rng(seed)
    q, v, a = rng.uniform(-1, 1, (3, 4, 3))
    read = q.copy()
    read[:, where.joint_index(joint)] += offset
    turned = EncoderOffset(joint, offset).apply(where)
    np.testing.assert_allclose(
        compute_rnea(turned, read, v, a), compute_rnea(where, q, v, a), atol=1e-9
    )


def test_a_base_on_its_head_turns_gravity_round() -> None:
    where = rig()
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (4, 3))
    zero = np.zeros((4, 3))
    fallen = compute_rnea(BaseTilt(roll=np.pi).apply(where), q, zero, zero)
    np.testing.assert_allclose(fallen, -compute_rnea(where, q, zero, zero), atol=1e-12)
    tilt = BaseTilt(roll=0.3, pitch=-0.2).apply(where).model.gravity.linear
    R = pin.rpy.rpyToMatrix(0.3, -0.2, 0.0)
    np.testing.assert_allclose(R @ tilt, [0, 0, -9.81], atol=1e-12)


def test_products_of_inertia_are_those_of_the_regressor() -> None:
    where = rig()
    rng = np.random.default_rng(0)
    q, v, a = rng.uniform(-1, 1, (3, 4, 3))
    changed = OffDiagonalInertia("roll", Ixy=1e-3, Iyz=-2e-3).apply(where)
    Y = compute_regressor(where, q, v, a)
    column = 1e-3 * Y[..., 10 + PHI.index("Ixy")] - 2e-3 * Y[..., 10 + PHI.index("Iyz")]
    np.testing.assert_allclose(
        compute_rnea(changed, q, v, a) - compute_rnea(where, q, v, a), column, atol=1e-12
    )
    with pytest.raises(UsageError, match=r"off-diagonal-inertia.*fork"):
        OffDiagonalInertia("roll", Ixy=5.0).apply(where)


def mounted(turn: Array) -> Rig:
    """The rig with its payload turned by so much roll, pitch and yaw, rad, (3,)."""
    where = rig()
    tree = etree.fromstring(where.urdf.encode())
    below = next(
        joint
        for joint in tree.iter("joint")
        if joint.find("child").get("link") == where.payload_link
    )
    place = (
        below.find("origin")
        if below.find("origin") is not None
        else etree.SubElement(below, "origin")
    )
    place.set("rpy", " ".join(map(str, turn)))
    return build_rig(
        where.path,
        etree.tostring(tree).decode(),
        where.config,
        where.payload,
        where.payload_link,
        "test",
    )


def test_products_of_a_payload_stand_in_the_frame_it_is_mounted_in() -> None:
    """``I' - I = R P Rᵀ``, and P alone where it is mounted straight; a joint that carries no payload has none of it."""
    for turn in (np.zeros(3), np.array([0.1, -0.2, 0.3])):
        where = mounted(turn)
        R = pin.rpy.rpyToMatrix(*turn)
        carrier = where.joints[get_payload(where)[0]]
        before, after = (
            one.model.inertias[where.joint_index(carrier) + 1].inertia
            for one in (
                where,
                OffDiagonalInertia(carrier, payload_Ixy=1e-4, payload_Iyz=-2e-4).apply(where),
            )
        )
        P = np.array([[0.0, 1e-4, 0.0], [1e-4, 0.0, -2e-4], [0.0, -2e-4, 0.0]])
        np.testing.assert_allclose(after - before, R @ P @ R.T, atol=1e-12)
        with pytest.raises(UsageError, match=carrier):
            OffDiagonalInertia(
                next(j for j in where.joints if j != carrier), payload_Ixy=1e-4
            ).apply(where)


# -- words and files --


@pytest.mark.parametrize("name", sorted(CAUSES))
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_written_is_what_is_planted(name: str, seed: int) -> None:
    """text → planted → shown gives the figures of the text back; so does planted → JSON → planted."""
    rng = np.random.default_rng(seed)
    kind = CAUSES[name]
    values = {p.name: drawn(p, rng) for p in kind.stated()}
    assume(any(values.values()))
    joint = "roll:" if kind.of_joint else ""
    pairs = list(values.items())
    rng.shuffle(pairs)
    thing = parse_effect(
        f"{name}:{joint}{','.join(f'{key}={value!r}' for key, value in pairs)}", rig()
    )
    shown = thing.effect.shown(thing.values) if isinstance(thing, Term) else thing.shown()
    for p in shown:
        assert p.value == pytest.approx(values[p.name], rel=1e-9, abs=1e-9)
    data = json.loads(json.dumps(thing.to_dict()))
    assert (read_term(data) if isinstance(thing, Term) else read_cause(data)) == thing


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("coging:yaw", "no cause 'coging'; the causes are actuator-lag, armature"),
        ("coulomb:yaw:Fs=1", "no cause 'coulomb'"),
        ("cogging:pan:amplitude=1,harmonic=2", "no joint 'pan'; .*yaw, roll, tilt"),
        (
            "cogging",
            "no joint ''; write cogging:JOINT:amplitude=...,harmonic=... with a joint out of yaw, roll, tilt",
        ),
        ("cogging:yaw", "says nothing of amplitude, harmonic"),
        ("cogging:yaw:amplitude=0.1", "says nothing of harmonic; .*harmonic, 1 to 1000 per turn"),
        ("cogging:yaw:size=0.1", "no parameter 'size'; .*amplitude, 0 to inf N m"),
        ("cogging:yaw:amplitude=-1,harmonic=2", "amplitude is -1 N m; give 0 to inf N m"),
        ("cogging:yaw:amplitude=big,harmonic=2", "amplitude is 'big'; give a number"),
        ("cogging:yaw:amplitude=nan,harmonic=2", "amplitude is 'nan'; give a number"),
        ("cogging:yaw:amplitude,harmonic=2", "amplitude is ''; give a number"),
        ("delay:tilt:time=1", "time is 1 s; give 0 to 0.2 s"),
        (
            "payload-shift",
            r"says nothing of x, y, z; write payload-shift:x=...,y=...,z=...: x, -0.5 to 0.5 m",
        ),
        ("torque-bias:yaw:bias=0", "says nothing of bias"),
    ],
)
def test_errors_name_what_there_is(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words) as caught:
        parse_effect(text, rig())
    assert "\n" not in str(caught.value) and text in str(caught.value)


def test_shapes_out_of_bounds_and_foreign_files_are_refused() -> None:
    with pytest.raises(GimbalPinError, match=r"delay: time is -1 s; give 0 to 0.2 s"):
        Delay("yaw", -1.0)
    with pytest.raises(GimbalPinError, match=r"cogging: harmonic is nan"):
        Cogging("yaw", (12.0, nan))
    for data in (
        {"effect": "phlogiston"},
        {},
        {"effect": "delay", "joint": "yaw", "tim": 1.0},
        {"effect": "delay"},
    ):
        with pytest.raises(ModelError):
            read_cause(data)
    for data in (
        {"effect": "delay", "joint": "yaw", "time": 0.1},
        {"effect": "coulomb", "joint": "yaw", "values": []},
    ):
        with pytest.raises(ModelError, match=r"no term"):
            read_term(data)


def test_a_link_that_swings_slower_than_any_resonance_swings_at_the_slowest() -> None:
    """A rotor of next to nothing of a slow joint: the search may try it, and no bound of the link's stops it."""
    assert (
        JointFlexibility("tilt", 0.6, 0.01, 0.01).held.frequency == JointFlexibility.shapes[0].lower
    )


def test_planted_bristles_are_the_joints_dry_friction() -> None:
    rig = Rig.load("turret")
    joint = "pan"
    plain = nominal(rig)
    plant = plant_with(plain, [Term(Presliding(joint, 0.02), (0.1,))]).plant
    coulomb, before = (
        {t.effect.joint: t.values[0] for t in model.terms if isinstance(t.effect, Coulomb)}
        for model in (plant, plain)
    )
    assert coulomb == {**before, joint: 0.0} and before[joint] > 0
    none = plant_with(plain, [Term(Presliding(joint, 0.02), (0.0,))]).plant
    assert none.terms[: 2 * rig.n] == plain.terms


@pytest.mark.parametrize("x", [0.3, -0.9, 4.0, float("inf"), float("-inf"), float("nan")])
def test_a_table_is_the_same_function_of_one_state_and_of_many(x: float) -> None:
    """Where a simulation has diverged, too: beyond its knots nothing, and of no number no number."""
    table = TorqueTable("pan", "angle", (-1.0, 0.0, 1.0))
    one, many = (table.basis(Sample(*[at] * 6)) for at in (x, np.array([x])))
    np.testing.assert_allclose(np.array(one), np.concatenate(many))


@pytest.mark.parametrize("travel", [0.0, 1e-3, 0.3, 0.9, 2.0, 7.0])
def test_harmonics_that_a_travel_does_not_part_are_few_and_within_its_resolution(
    travel: float,
) -> None:
    """Each at most half a period of the travel away, at most eight of them, and none over a turn."""
    seen = OperatingRange(30.0, 0.002, 12.0, travel, 1.0, 1e-3, 1.0, 1.2)
    found = PositionDependentFriction("pan", (3.0, 40.0)).akin(seen)
    assert len(found) <= 16 and (travel < 3.2 or not found)
    for one in found:
        moved, *others = set(one.pieces) - {3.0, 40.0}
        (left,) = {3.0, 40.0} - set(one.pieces)
        assert not others and 1.0 <= moved == round(moved) and abs(moved - left) * travel <= np.pi
