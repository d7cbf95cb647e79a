"""Laws of all causes, which hold for every new file by themselves, of torque effects, and of their text and files."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from math import isnan
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gimbal_pin.dynamics import Model, Plant, State, nominal, plant_with
from gimbal_pin.effects import (
    ALWAYS,
    CAUSES,
    CableSpring,
    Cause,
    Cogging,
    Coulomb,
    Effect,
    FrictionDrift,
    LoadDependentFriction,
    Losses,
    OperatingRange,
    Parameter,
    Presliding,
    Sample,
    Stribeck,
    Term,
    TorqueGain,
    TorqueTable,
    parse_effect,
    read_cause,
    read_term,
)
from gimbal_pin.errors import ModelError, UsageError
from gimbal_pin.identification import identify
from gimbal_pin.log import Array
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT
from tests.refitted import plant, record

KINDS: dict[str, type[Cause]] = {**CAUSES, **{kind.name: kind for kind in ALWAYS}}
TORQUES = sorted(name for name, kind in KINDS.items() if issubclass(kind, Effect))
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
SEEDS = st.integers(0, 2**32 - 1)
SEEN = OperatingRange(60.0, 0.005, 12.0, 2.0, 1.0, 1e-3, 1.0, 1.2)
TURN = SEEN._replace(travel=7.0)


@cache
def rig(name: str = "thesis") -> Rig:
    return Rig.load(name)


def drawn(parameter: Parameter, rng: np.random.Generator) -> float:
    """A value within the parameter's bounds, of a size that a rig may have."""
    if parameter.name == "harmonic":
        return float(rng.integers(1, 60))
    low = max(parameter.lower, -0.3)
    high = min(parameter.upper, 0.4 if low < 0.4 else 10 * low)
    return float(rng.uniform(low, high))


def planted(name: str, rng: np.random.Generator, joint: str = "tilt") -> Any:
    """One of the kind with drawn parameters."""
    kind = KINDS[name]
    values = {p.name: drawn(p, rng) for p in kind.stated()}
    return kind.planted(joint if kind.of_joint else None, values)


def states(rng: np.random.Generator, count: int = 40) -> Sample:
    """Consecutive samples of one joint, sliding the way it moves; its motor gave nothing before."""
    t = np.linspace(0.0, 5.0, count)
    v = rng.normal(size=count)
    return Sample(
        t,
        np.cumsum(v) * 0.1,
        v,
        rng.normal(size=count),
        np.sign(v),
        rng.normal(size=count),
        25 + rng.uniform(0, 20, count),
        losses=Losses(np.zeros(1), t),
    )


def alone(many: Sample, i: int, memory: float | None) -> Sample:
    """Sample `i` as floats."""
    return Sample(*(float(np.asarray(x)[i]) for x in many[:7]), memory=memory)


# all causes


def test_every_cause_of_the_contract_is_here() -> None:
    assert set(CAUSES) == set(CONTRACT)
    assert not set(CAUSES) & {kind.name for kind in ALWAYS}


@pytest.mark.parametrize("name", sorted(CAUSES))
def test_a_cause_states_bounded_parameters_and_its_size(name: str) -> None:
    thing = planted(name, np.random.default_rng(0))
    kind = CAUSES[name]
    stated = {p.name: p for p in kind.stated()}
    assert all(p.unit and p.lower < p.upper for p in stated.values())
    for p in thing.effect.shown(thing.values) if isinstance(thing, Term) else thing.shown():
        of = stated[p.name]
        assert of.lower <= p.lower and p.upper <= of.upper and p.unit == of.unit
    assert "nan" not in thing.sentence()


# torque effects

SAMPLES = states(np.random.default_rng(5))._replace(weight=np.linspace(-2.0, 2.0, 40))
HARMONIC = "amplitude=0.2,harmonic=42,phase=0.7"
FORMULAS: list[tuple[str | Term, Callable[[Sample], Any]]] = [
    ("stribeck:yaw:extra=0.3,speed=0.4", lambda x: 0.3 * np.exp(-((x.v / 0.4) ** 2)) * x.slide),
    (Term(Stribeck("yaw", 0.4, 1), (0.3,)), lambda x: 0.3 * np.exp(-abs(x.v) / 0.4) * x.slide),
    ("asymmetric-friction:yaw:coulomb=0.2,viscous=0.1", lambda x: 0.2 + 0.1 * abs(x.v)),
    (
        "asymmetric-friction:yaw:coulomb=0.2,viscous=0.1,speed=0.4",
        lambda x: 0.2 * abs(x.v) / (0.4 + abs(x.v)) + 0.1 * abs(x.v),
    ),
    ("load-dependent-friction:yaw:mu=0.1", lambda x: 0.1 * abs(x.tau) * x.slide),
    (
        Term(LoadDependentFriction("yaw", weighs=True), (0.1,)),
        lambda x: 0.1 * abs(x.weight) * x.slide,
    ),
    (f"position-dependent-friction:yaw:{HARMONIC}", lambda x: wave(x) * x.slide),
    (f"cogging:yaw:{HARMONIC}", lambda x: wave(x)),
    (f"torque-ripple:yaw:{HARMONIC}", lambda x: wave(x) * x.tau),
    (
        "friction-drift:yaw:coulomb=0.2,viscous=0.1,span=3",
        lambda x: (1 - np.exp(-x.t / 3)) * (0.2 * x.slide + 0.1 * x.v),
    ),
    (
        Term(FrictionDrift("yaw", thermal=True), (0.2, 0.1)),
        lambda x: (x.temperature - 25) / 10 * (0.2 * x.slide + 0.1 * x.v),
    ),
    ("quadratic-drag:yaw:drag=0.2,power=1.5", lambda x: 0.2 * np.sign(x.v) * abs(x.v) ** 1.5),
    ("torque-gain:yaw:gain=0.9", lambda x: 0.1 * x.tau),
    (Term(TorqueGain("yaw", 1), (0.1,)), lambda x: 0.1 * np.maximum(x.tau, 0.0)),
    (Term(TorqueGain("yaw", -1), (0.1,)), lambda x: 0.1 * np.minimum(x.tau, 0.0)),
    ("torque-bias:yaw:bias=0.2", lambda x: 0.2 + 0.0 * x.q),
    ("armature:yaw:inertia=0.2", lambda x: 0.2 * x.a),
    (
        "cable-spring:yaw:stiffness=0.3,rest=0.2,cubic=0.4",
        lambda x: 0.3 * (x.q - 0.2) + 0.4 * (x.q - 0.2) ** 3,
    ),
    (
        Term(CableSpring("yaw", growth=0.4), (0.03, 0.02)),
        lambda x: 0.03 * np.exp(x.q / 0.4) - 0.02 * np.exp(-x.q / 0.4),
    ),
    (
        Term(CableSpring("yaw", taut=2, upper=0.1, lower=-0.1), (0.3, 0.2)),
        lambda x: 0.3 * np.maximum(x.q - 0.1, 0) - 0.2 * np.maximum(-0.1 - x.q, 0),
    ),
    (
        Term(TorqueTable("yaw", "load", (-1.0, 0.0, 1.0)), (2.0, 0.0, 4.0)),
        lambda x: np.interp(x.tau, [-2, -1, 0, 1, 2], [0, 2, 0, 4, 0]),
    ),
    (
        Term(TorqueTable("yaw", "angle", tuple(np.pi / 2 * np.arange(4)), True), (1, 2, 3, 5)),
        lambda x: np.interp(x.q % (2 * np.pi), np.pi / 2 * np.arange(5), [1, 2, 3, 5, 1]),
    ),
]


def wave(x: Sample) -> Array:
    """The cosine that `HARMONIC` states."""
    return np.asarray(0.2 * np.cos(42 * np.asarray(x.q) + 0.7))


@pytest.mark.parametrize(("stated", "formula"), FORMULAS)
def test_an_effect_is_its_formula(stated: str | Term, formula: Callable[[Sample], Any]) -> None:
    term = parse_effect(stated, rig()) if isinstance(stated, str) else stated
    assert isinstance(term, Term)
    np.testing.assert_allclose(term.torque(SAMPLES), formula(SAMPLES), atol=1e-12)
    single = alone(SAMPLES, 7, None)._replace(weight=SAMPLES.weight[7])
    assert term.torque(single) == pytest.approx(formula(SAMPLES)[7], abs=1e-12)


@pytest.mark.parametrize("name", TORQUES)
@given(seed=SEEDS)
def test_floats_and_arrays_agree(name: str, seed: int) -> None:
    """One sample at a time, with the memory carried along, gives what the whole array gives."""
    rng = np.random.default_rng(seed)
    effect: Effect = planted(name, rng).effect
    many = states(rng)
    whole = np.column_stack([np.broadcast_to(x, np.shape(many.t)) for x in effect.basis(many)])
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
@given(seed=SEEDS)
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
    per_acceleration = basis(a=1.0) - basis(a=0.0)
    np.testing.assert_allclose(basis(a=2.0) - basis(a=0.0), 2 * per_acceleration, atol=1e-12)
    if effect.affine:
        zero = np.array(effect.basis(Sample(*[0.0] * 6)))
        per_slide = basis(slide=1.0, v=0.0) - zero
        per_rate = basis(slide=0.0, v=1.0) - zero
        told = zero + at.slide * per_slide + at.v * per_rate
        np.testing.assert_allclose(basis(), told, atol=1e-12)


@pytest.mark.parametrize("name", TORQUES)
@given(seed=SEEDS, factor=st.floats(-3, 3))
def test_torque_is_linear_in_the_coefficients(name: str, seed: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    effect = planted(name, rng).effect
    many = states(rng)
    x, y = rng.normal(size=(2, len(effect.coefficients)))
    one, other, both = (
        np.asarray(Term(effect, tuple(values)).torque(many)) for values in (x, y, x + factor * y)
    )
    np.testing.assert_allclose(both, one + factor * other, atol=1e-10)
    assert not np.any(Term(effect, (0.0,) * len(x)).torque(many))


@pytest.mark.parametrize("name", [name for name in TORQUES if KINDS[name].dry])  # type: ignore[attr-defined]
@given(seed=SEEDS)
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


@pytest.mark.parametrize(
    ("given_", "pushes"),
    [
        ("position-dependent-friction:tilt:amplitude=0.5,harmonic=3", True),
        ("asymmetric-friction:roll:coulomb=0.04", True),
        ("asymmetric-friction:yaw:coulomb=0.5,speed=0.3", True),
        ("asymmetric-friction:yaw:coulomb=0.0,viscous=0.5", True),
        ("asymmetric-friction:roll:coulomb=0.02", False),
        ("asymmetric-friction:roll:coulomb=0.02,speed=0.3,viscous=-0.002", False),
    ],
)
def test_friction_that_would_push_is_refused(given_: str, pushes: bool) -> None:
    term = parse_effect(given_, rig())
    if pushes:
        with pytest.raises(UsageError, match="it would push"):
            plant_with(nominal(rig()), [term])
    else:
        assert term in plant_with(nominal(rig()), [term]).plant.terms


@pytest.mark.parametrize("name", TORQUES)
@given(seed=SEEDS)
def test_the_plant_obeys_the_equation_that_is_fitted(name: str, seed: int) -> None:
    """Accelerate by `Plant`, then ask `Model.inverse` for the torque of that motion: it is the torque put in."""
    rng = np.random.default_rng(seed)
    model = plant(planted(name, rng), planted("cogging", rng), rig=rig())
    system = Plant(model)
    tau = rng.normal(size=3)
    state = State(rng.uniform(-0.6, 0.6, 3), rng.choice([-1, 1], 3) * rng.uniform(0.1, 2, 3))
    t = float(rng.uniform(0, 10))
    assert system.contact(t, state, tau).stuck == ()
    a = system.acceleration(t, state, tau)
    row = (x[None, :] for x in (state.q, state.v, a))
    cold = [Losses(np.zeros(1), np.array([t]))] * 3
    asked = model.inverse(*row, t=np.array([t]), losses=cold)[0]
    np.testing.assert_allclose(asked, tau, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("effect", [Presliding("tilt", 0.05), FrictionDrift("tilt", 3.0, held=0.4)])
def test_the_plant_remembers_what_a_log_of_it_says(effect: Effect) -> None:
    turret = rig("turret")
    system = Plant(plant(Term(effect, (0.02, 0.01)), rig=turret))
    dt = 2e-3
    t = dt * np.arange(1500)
    tau = np.stack([0.3 * np.sin(2 * t), 0.2 + 0.6 * np.cos(3 * t)], axis=1)
    path = [State(np.zeros(2), np.zeros(2))]
    for k in range(len(t) - 1):
        path.append(system.step(t[k], path[-1], tau[k], dt))
    q = np.array([state.q[1] for state in path])
    still: Array = np.zeros(len(t))
    along = Sample(t, q, still, still, still, still, losses=Losses.along(t, tau[:, 1], t))
    told = np.asarray(effect.remembered(along))
    kept = [state.memory[0] for state in path[1:]]
    np.testing.assert_allclose(kept, told[1:], atol=0.02 * np.max(np.abs(told)))


def test_presliding_slides_after_its_stroke_and_is_damped_until_then() -> None:
    effect = Presliding("tilt", stroke=0.01)
    assert effect.evolve(0.0, 0.01) == pytest.approx(1 - np.exp(-1))
    assert effect.evolve(0.3, -1.0) == pytest.approx(-1.0)
    bent = Sample(0.0, 0.0, -2.0, 0.0, -1.0, 0.0, memory=0.5)
    assert Presliding("tilt", 0.01, damped=True).basis(bent) == (0.5, -3.0)


def test_planted_bristles_are_the_joints_dry_friction() -> None:
    plain = nominal(rig("turret"))
    dry, none = (
        plant_with(plain, [Term(Presliding("pan", 0.02), (level,))]).plant for level in (0.1, 0.0)
    )
    coulomb, before = (
        {t.effect.joint: t.values[0] for t in model.terms if isinstance(t.effect, Coulomb)}
        for model in (dry, plain)
    )
    assert coulomb == {**before, "pan": 0.0} and before["pan"] > 0
    assert none.terms[:4] == plain.terms


# planted in a log, found by identification

PLANTED = {
    "stribeck": "pan:speed=0.1,extra=0.1",
    "asymmetric-friction": "tilt:coulomb=0.006,viscous=0.005",
    "position-dependent-friction": "pan:amplitude=0.03,harmonic=3,phase=1",
    "friction-drift": "pan:span=10,coulomb=0.1,viscous=0.05",
    "quadratic-drag": "pan:drag=0.05",
    "cogging": "pan:amplitude=0.05,harmonic=12,phase=0.5",
    "torque-bias": "pan:bias=0.05",
    "cable-spring": "pan:stiffness=0.3,rest=0.2,cubic=0.2",
    "presliding": "tilt:stroke=0.02,level=0.1",
    "armature": "tilt:inertia=0.02",
}


@pytest.mark.parametrize("name", sorted(PLANTED))
def test_identification_finds_what_was_planted(name: str) -> None:
    """Within four deviations, and known to a half; the axes that an armature needs coupled are those of three."""
    where = rig("thesis" if name == "armature" else "turret")
    term = parse_effect(f"{name}:{PLANTED[name]}", where)
    assert isinstance(term, Term)
    log = record(plant(term, rig=where), 1, 10.0, 2e-3, 4e-3)
    found = identify(where, [log], [term.effect], holdout="none", filtering=EXACT)
    k = len(term.values)
    theta = found.estimate.theta[-k:]
    std = np.sqrt(np.diag(found.estimate.covariance))[-k:]
    assert np.all(np.abs(theta - np.array(term.values)) < 4 * std)
    assert np.all(std < 0.5 * np.abs(term.values).max())


def test_every_torque_effect_that_a_linear_fit_estimates_is_planted() -> None:
    linear = {name for name in CAUSES if name in TORQUES and not CAUSES[name].loaded}
    assert set(PLANTED) == linear


# figures


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        (Cogging("yaw", (12.0, 24.0)), (0.05, 0.02, -0.01, 0.03)),
        (CableSpring("yaw"), (-0.1, 0.5)),
        (CableSpring("yaw", stiffening=True), (-0.1, 0.5, -0.3, 0.4)),
        (TorqueGain("yaw"), (0.1,)),
    ],
)
def test_uncertainty_is_carried_to_what_is_shown(effect: Effect, values: tuple[float, ...]) -> None:
    """The spread of the shown figures over drawn coefficients is the stated one."""
    rng = np.random.default_rng(0)
    root = 1e-3 * rng.normal(size=(len(values), len(values)))
    covariance = root @ root.T
    draws = rng.multivariate_normal(values, covariance, 4000)
    sampled = np.array([[p.value for p in effect.shown(draw)] for draw in draws])
    shown = effect.shown(values, covariance)
    known = [not isnan(p.std) for p in shown]
    assert any(known)
    spread = sampled.std(axis=0)[known]
    np.testing.assert_allclose([p.std for p in shown if not isnan(p.std)], spread, rtol=0.1)


def share_no_motor_makes(sizes: dict[int, float]) -> float:
    lines = tuple(float(k) for k in sorted(sizes))
    power = np.array([sizes[int(k)] ** 2 for k in lines])
    return Cogging("yaw", lines).compute_stray_share(power, TURN)


@given(st.integers(4, 42), st.integers(3, 48), SEEDS)
def test_lines_of_poles_and_slots_and_of_the_turn_are_a_motors(
    poles: int, slots: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    own = [k for k in range(1, 145) if not (k % poles and k % slots)] + [1]
    sizes = {k: float(rng.uniform(0.1, 1.0)) for k in own}
    assert share_no_motor_makes(sizes) < 1e-9


def test_lines_of_a_notch_are_no_motors() -> None:
    notch = np.zeros(1440)
    notch[41:80] = 0.05
    spectrum = np.abs(np.fft.rfft(notch))
    lines = {k: float(spectrum[k]) for k in (46, 34, 25, 14, *range(2, 16))}
    assert share_no_motor_makes(lines) > 0.2


# text and files


@pytest.mark.parametrize("name", sorted(CAUSES))
@given(seed=SEEDS)
def test_what_is_written_is_what_is_planted(name: str, seed: int) -> None:
    """text → planted → shown gives the figures of the text back; so does planted → JSON → planted."""
    rng = np.random.default_rng(seed)
    kind = CAUSES[name]
    values = {p.name: drawn(p, rng) for p in kind.stated()}
    assume(any(values.values()))
    pairs = [f"{key}={value!r}" for key, value in values.items()]
    rng.shuffle(pairs)
    joint = "roll:" if kind.of_joint else ""
    thing = parse_effect(f"{name}:{joint}{','.join(pairs)}", rig())
    for p in thing.effect.shown(thing.values) if isinstance(thing, Term) else thing.shown():
        assert p.value == pytest.approx(values[p.name], rel=1e-9, abs=1e-9)
    data = json.loads(json.dumps(thing.to_dict()))
    assert (read_term(data) if isinstance(thing, Term) else read_cause(data)) == thing


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("coging:yaw", "actuator-lag"),
        ("coulomb:yaw:Fs=1", "coulomb"),
        ("cogging:pan:amplitude=1,harmonic=2", "yaw, roll, tilt"),
        ("cogging:yaw:amplitude=0.1", "harmonic"),
        ("cogging:yaw:size=0.1", "amplitude"),
        ("cogging:yaw:amplitude=-1,harmonic=2", "0 to inf N m"),
        ("cogging:yaw:amplitude=big,harmonic=2", "number"),
        ("cogging:yaw:amplitude=nan,harmonic=2", "number"),
        ("cogging:yaw:amplitude,harmonic=2", "number"),
        ("delay:tilt:time=1", "0 to 0.2 s"),
        ("payload-shift", "-0.5 to 0.5 m"),
        ("torque-bias:yaw:bias=0", "bias"),
    ],
)
def test_errors_name_what_there_is(text: str, names: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_effect(text, rig())
    assert names in str(caught.value) and text in str(caught.value)


@pytest.mark.parametrize(
    "data",
    [
        {"effect": "phlogiston"},
        {},
        {"effect": "delay", "joint": "yaw", "time": -1.0},
        {"effect": "delay"},
        {"effect": "delay", "joint": "yaw", "tim": 1.0},
        {"effect": "delay", "joint": "yaw", "time": 0.1},
        {"effect": "coulomb", "joint": "yaw", "values": []},
    ],
)
def test_foreign_files_are_refused(data: dict[str, Any]) -> None:
    with pytest.raises(ModelError):
        read_term(data)


def test_a_table_is_the_same_function_of_one_state_and_of_many() -> None:
    """Where a simulation has diverged, too: beyond its knots nothing, and of no number no number."""
    table = TorqueTable("pan", "angle", (-1.0, 0.0, 1.0))
    x = np.array([0.3, -0.9, 4.0, np.inf, -np.inf, np.nan])
    one = [table.basis(Sample(*[at] * 6)) for at in x.tolist()]
    np.testing.assert_allclose(one, np.stack(table.basis(Sample(*[x] * 6)), axis=1))
