"""What a joint carries: its torque, its weight, or both, and friction that grows with it."""

from functools import cache

import numpy as np
import pinocchio as pin

from gimbal_pin.control import ComputedTorque, Pid, bench_run
from gimbal_pin.diagnosis import (
    DIAGNOSIS_BAND,
    Diagnosis,
    Problem,
    diagnose,
    gather,
    refit_without,
    solve_causes,
)
from gimbal_pin.dynamics import (
    Model,
    Plant,
    State,
    compute_rnea,
    nominal,
    plant_with,
    reduce_parameters,
)
from gimbal_pin.effects import CAUSES, LoadDependentFriction, Term, parse_effect, read_cause
from gimbal_pin.log import Log, Platform
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier, prescribed

DT = 0.004
FRICTION = {
    name: CAUSES[name]
    for name in (*(n for n in CAUSES if "friction" in n), "stribeck", "torque-bias")
}
BEARING = LoadDependentFriction("tilt", weighs=True)


@cache
def rig(name: str = "thesis") -> Rig:
    return Rig.load(name)


def recorded(name: str, text: str, seed: int = 0) -> Log:
    where = rig(name)
    plant = plant_with(nominal(where), [parse_effect(text, where)]).plant
    mover = ComputedTorque(
        nominal(where), (Pid.placed(5.0, 1.0, 0.2),) * where.n, DT, lead=1.5 * DT
    )
    return bench_run(
        plant, mover, rng=np.random.default_rng(seed), reference=fourier(where, seed, 15.0, DT)
    )


def carrying(size: int, rng: np.random.Generator) -> Platform:
    f, w, dw = rng.normal(size=(3, size, 3))
    return Platform(0.01 * np.arange(size), f + np.array([0.0, 0.0, 9.81]), w, dw)


def test_weight_is_gravitys_generalised_torque() -> None:
    where = rig()
    rng = np.random.default_rng(0)
    model = Model(where, (Term(BEARING, (0.3,)),))
    q = rng.uniform(-1, 1, (20, where.n))
    data = where.model.createData()
    gravity = [pin.computeGeneralizedGravity(where.model, data, row) for row in q]
    np.testing.assert_allclose(model.weight(q), gravity, atol=1e-12)
    np.testing.assert_allclose(Plant(model).weight(0.0, q[0]), gravity[0], atol=1e-12)
    assert not nominal(where).weight(q).any()


def test_plant_and_inverse_agree_where_the_base_moves() -> None:
    where = rig()
    rng = np.random.default_rng(1)
    model = Model(where, (*nominal(where).terms, Term(BEARING, (0.3,))))
    base = carrying(5, np.random.default_rng(2))
    plant = Plant(model, base)
    tau = rng.normal(size=where.n)
    t = float(base.t[2])
    state = State(rng.uniform(-0.5, 0.5, where.n), rng.uniform(0.5, 1.0, where.n))
    a = plant.acceleration(t, state, tau)
    row = (x[None] for x in (state.q, state.v, a))
    np.testing.assert_allclose(
        model.inverse(*row, t=np.array([t]), platform=base.part(slice(2, 3)))[0], tau, atol=1e-8
    )


def test_the_forms_are_planted_and_read_back() -> None:
    term = parse_effect("load-dependent-friction:tilt:mu=0.3,weighs=1", rig())
    assert term == Term(BEARING, (0.3,)) and read_cause(BEARING.to_dict()) == BEARING
    assert parse_effect("load-dependent-friction:tilt:mu=0.3", rig()) == Term(
        LoadDependentFriction("tilt"), (0.3,)
    )


def test_a_fit_without_a_cause_bears_what_the_whole_one_does() -> None:
    """Inertias that stand in for a load's friction are no load: what it is built from stays.

    Not what other causes read: a gain would explain any cause by that cause's part of its column.
    """
    where = rig()
    cause = LoadDependentFriction("tilt", weighs=True)
    log = prescribed(Model(where, (*nominal(where).terms, Term(cause, (0.4,)))), 0, 10.0, 0.01, DT)
    problem = Problem.of(gather(where, [log], DIAGNOSIS_BAND), reduce_parameters(where))
    state = solve_causes(problem, (cause,), solve_causes(problem, ()))
    base = refit_without(state, cause)
    for part in range(len(problem.evidence.parts)):
        np.testing.assert_array_equal(base.load.borne[part], state.torque[part])
        np.testing.assert_array_equal(base.load.weight[part], state.load.weight[part])
        np.testing.assert_array_equal(base.load.torque[part], base.torque[part])
    assert not np.allclose(base.torque[0], state.torque[0])
    channels = problem.evidence.parts[0].channels
    rest = 0 * channels.q
    np.testing.assert_allclose(
        state.load.weight[0], compute_rnea(state.rig, channels.q, rest, rest)
    )


def test_what_a_joint_carries_is_found() -> None:
    name, joint = "handheld", "roll"
    log = recorded(name, f"load-dependent-friction:{joint}:mu=0.4,weighs=1", 1)
    found: Diagnosis = diagnose(rig(name), [log], FRICTION, rng=np.random.default_rng(1))
    assert found.verdict in ("named", "ambiguous")
    (one,) = found.findings
    assert one.joint == joint and one.cause == "load-dependent-friction"
    told = {parameter.name: parameter for parameter in one.parameters}
    mu = told["mu"]
    assert abs(mu.value - 0.4) < max(4 * mu.std, 0.04)
