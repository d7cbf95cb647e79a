"""Laws of all causes, which hold for every new file by themselves, of torque effects, and of their text and files."""

from __future__ import annotations

import json
from functools import cache
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
SEEDS = st.integers(0, 2**32 - 1)


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


# torque effects

X = states(np.random.default_rng(5))._replace(weight=np.linspace(-2.0, 2.0, 40))
T, Q, V, A, SLIDE, TAU = (np.asarray(x) for x in X[:6])
HARMONIC = "amplitude=0.2,harmonic=42,phase=0.7"
WAVE = 0.2 * np.cos(42 * Q + 0.7)
DRIFT = 0.2 * SLIDE + 0.1 * V
STRETCH = Q - 0.2
WARMTH = (np.asarray(X.temperature) - 25) / 10
QUARTERS = np.pi / 2 * np.arange(5)
FORMULAS: list[tuple[str | Term, Array]] = [
    ("stribeck:yaw:extra=0.3,speed=0.4", 0.3 * np.exp(-((V / 0.4) ** 2)) * SLIDE),
    (Term(Stribeck("yaw", 0.4, 1), (0.3,)), 0.3 * np.exp(-abs(V) / 0.4) * SLIDE),
    ("asymmetric-friction:yaw:coulomb=0.2,viscous=0.1", 0.2 + 0.1 * abs(V)),
    (
        "asymmetric-friction:yaw:coulomb=0.2,viscous=0.1,speed=0.4",
        0.2 * abs(V) / (0.4 + abs(V)) + 0.1 * abs(V),
    ),
    ("load-dependent-friction:yaw:mu=0.1", 0.1 * abs(TAU) * SLIDE),
    (
        Term(LoadDependentFriction("yaw", weighs=True), (0.1,)),
        0.1 * abs(np.asarray(X.weight)) * SLIDE,
    ),
    (f"position-dependent-friction:yaw:{HARMONIC}", WAVE * SLIDE),
    (f"cogging:yaw:{HARMONIC}", WAVE),
    (f"torque-ripple:yaw:{HARMONIC}", WAVE * TAU),
    ("friction-drift:yaw:coulomb=0.2,viscous=0.1,span=3", (1 - np.exp(-T / 3)) * DRIFT),
    (Term(FrictionDrift("yaw", thermal=True), (0.2, 0.1)), WARMTH * DRIFT),
    ("quadratic-drag:yaw:drag=0.2,power=1.5", 0.2 * np.sign(V) * abs(V) ** 1.5),
    ("torque-gain:yaw:gain=0.9", 0.1 * TAU),
    (Term(TorqueGain("yaw", 1), (0.1,)), 0.1 * np.maximum(TAU, 0.0)),
    (Term(TorqueGain("yaw", -1), (0.1,)), 0.1 * np.minimum(TAU, 0.0)),
    ("torque-bias:yaw:bias=0.2", 0.2 + 0.0 * Q),
    ("armature:yaw:inertia=0.2", 0.2 * A),
    ("cable-spring:yaw:stiffness=0.3,rest=0.2,cubic=0.4", 0.3 * STRETCH + 0.4 * STRETCH**3),
    (
        Term(CableSpring("yaw", growth=0.4), (0.03, 0.02)),
        0.03 * np.exp(Q / 0.4) - 0.02 * np.exp(-Q / 0.4),
    ),
    (
        Term(CableSpring("yaw", taut=2, upper=0.1, lower=-0.1), (0.3, 0.2)),
        0.3 * np.maximum(Q - 0.1, 0) - 0.2 * np.maximum(-0.1 - Q, 0),
    ),
    (
        Term(TorqueTable("yaw", "load", (-1.0, 0.0, 1.0)), (2.0, 0.0, 4.0)),
        np.interp(TAU, [-2, -1, 0, 1, 2], [0, 2, 0, 4, 0]),
    ),
    (
        Term(TorqueTable("yaw", "angle", tuple(QUARTERS[:4]), True), (1, 2, 3, 5)),
        np.interp(Q % (2 * np.pi), QUARTERS, [1, 2, 3, 5, 1]),
    ),
]


@pytest.mark.parametrize(("stated", "torque"), FORMULAS)
def test_an_effect_is_its_formula(stated: str | Term, torque: Array) -> None:
    term = parse_effect(stated, rig()) if isinstance(stated, str) else stated
    assert isinstance(term, Term)
    np.testing.assert_allclose(term.torque(X), torque, atol=1e-12)


@pytest.mark.parametrize("name", TORQUES)
@given(seed=SEEDS)
def test_floats_and_arrays_agree(name: str, seed: int) -> None:
    """One sample at a time, with the memory carried along, gives what the whole array gives: linear in coefficients."""
    rng = np.random.default_rng(seed)
    effect: Effect = planted(name, rng).effect
    many = states(rng)
    whole = np.column_stack([np.broadcast_to(x, np.shape(many.t)) for x in effect.basis(many)])
    values = rng.normal(size=len(effect.coefficients))
    np.testing.assert_allclose(Term(effect, tuple(values)).torque(many), whole @ values, atol=1e-12)
    memory = effect.start()
    q = np.asarray(many.q)
    for i in range(len(q)):
        if memory is not None and i:
            memory = effect.evolve(memory, float(q[i] - q[i - 1]))
        single = effect.basis(alone(many, i, memory))
        assert all(isinstance(value, float) for value in single)
        np.testing.assert_allclose(single, whole[i], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", TORQUES)
@given(seed=SEEDS)
def test_what_an_effect_declares_is_true(name: str, seed: int) -> None:
    """`affine`, `loaded` and `dry`, on which the plant builds."""
    rng = np.random.default_rng(seed)
    effect: Effect = planted(name, rng).effect
    memory = None if effect.start() is None else float(rng.uniform(-1, 1))
    at = alone(states(rng), 7, memory)

    def basis(**changes: float) -> Array:
        return np.array(effect.basis(at._replace(**changes)))

    assert effect.loaded or np.array_equal(basis(), basis(tau=3.3))
    assert effect.dry or np.array_equal(basis(), basis(slide=0.3))
    if effect.affine:
        zero = np.array(effect.basis(Sample(*[0.0] * 6)))
        per_slide = basis(slide=1.0, v=0.0) - zero
        per_rate = basis(slide=0.0, v=1.0) - zero
        told = zero + at.slide * per_slide + at.v * per_rate
        np.testing.assert_allclose(basis(), told, atol=1e-12)


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
        full, half, none = (
            float(term.torque(at._replace(slide=part * way, v=0.0))) for part in (1.0, 0.5, 0.0)
        )
        assert way * full + 1.0 >= 0
        assert (half, none) == (pytest.approx(full / 2, abs=1e-12), 0.0)


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
    """Accelerate by `Plant`; `Model.inverse_dynamics` of that motion is the torque put in."""
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
    asked = model.inverse_dynamics(*row, t=np.array([t]), losses=cold)[0]
    np.testing.assert_allclose(asked, tau, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("effect", [Presliding("tilt", 0.05), FrictionDrift("tilt", 3.0, held=0.4)])
def test_the_plant_remembers_what_a_log_of_it_says(effect: Effect) -> None:
    system = Plant(plant(Term(effect, (0.02, 0.01)), rig=rig("turret")))
    t = 2e-3 * np.arange(1500)
    tau = np.stack([0.3 * np.sin(2 * t), 0.2 + 0.6 * np.cos(3 * t)], axis=1)
    path = [State(np.zeros(2), np.zeros(2))]
    for at, torque in zip(t[:-1], tau):
        path.append(system.step(at, path[-1], torque, 2e-3))
    q = np.array([state.q[1] for state in path])
    losses = Losses.along(t, tau[:, 1], t)
    told = np.asarray(effect.remembered(Sample(t, q, *[0 * t] * 4, losses=losses)))
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
    bristles = (Term(Presliding("pan", 0.02), (level,)) for level in (0.1, 0.0))
    dry, none = (plant_with(plain, [term]).plant for term in bristles)
    coulomb = {t.effect.joint: t.values[0] for t in dry.terms if isinstance(t.effect, Coulomb)}
    assert coulomb["pan"] == 0.0 < coulomb["tilt"]
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
    draws = rng.multivariate_normal(values, root @ root.T, 2000)
    sampled = np.std([[p.value for p in effect.shown(draw)] for draw in draws], axis=0)
    stated = np.array([p.std for p in effect.shown(values, root @ root.T)])
    known = ~np.isnan(stated)
    assert known.any()
    np.testing.assert_allclose(stated[known], sampled[known], rtol=0.1)


# text and files


@pytest.mark.parametrize("name", sorted(CAUSES))
@given(seed=SEEDS)
def test_what_is_written_is_what_is_planted(name: str, seed: int) -> None:
    """text → planted → shown gives the figures of the text back, bounded; so does planted → JSON → planted."""
    rng = np.random.default_rng(seed)
    kind = CAUSES[name]
    stated = {p.name: p for p in kind.stated()}
    values = {name: drawn(p, rng) for name, p in stated.items()}
    assume(any(values.values()))
    pairs = [f"{key}={value!r}" for key, value in values.items()]
    rng.shuffle(pairs)
    joint = "roll:" if kind.of_joint else ""
    thing = parse_effect(f"{name}:{joint}{','.join(pairs)}", rig())
    for p in thing.effect.shown(thing.values) if isinstance(thing, Term) else thing.shown():
        assert p.value == pytest.approx(values[p.name], rel=1e-9, abs=1e-9)
        of = stated[p.name]
        assert of.lower <= p.lower < p.upper <= of.upper
        assert p.unit == of.unit != ""
    assert "nan" not in thing.sentence()
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
