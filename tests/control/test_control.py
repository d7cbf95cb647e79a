"""Laws of the controllers: linear error dynamics, limits, anti-windup, Lyapunov's decrease."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import inf
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import (
    ComputedTorque,
    JointPid,
    LawMemory,
    ModelErrorBounds,
    Outer,
    Pid,
    Robust,
    bounds,
    compute_inertia,
    compute_margins,
    lyapunov,
    sample_poses,
    sampled_loop,
)
from gimbal_pin.control.laws.computed_torque import stiffened
from gimbal_pin.control.laws.design import braking
from gimbal_pin.dynamics import (
    Controller,
    Estimated,
    Model,
    Reference,
    Sensors,
    State,
    nominal,
    reduce_parameters,
    simulate,
)
from gimbal_pin.effects import Coulomb, Term, Viscous
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array, Motion
from gimbal_pin.rig import Limits, Motor, Rig, bundled_rigs

GAINS = Pid.placed(8.0, 1.0, 0.2)
DT = 0.001


@cache
def loaded(name: str) -> Rig:
    """A bundled rig, read once for all examples."""
    return Rig.load(name)


def unlimited(name: str, payload: str | None = None) -> Rig:
    """A bundled rig without limits of torque or motion."""
    rig = Rig.load(name, payload)
    return replace(rig, motors=(Motor(),) * rig.n, limits=(Limits(),) * rig.n)


def frictionless(rig: Rig) -> Model:
    """The rig without any effect."""
    return Model(rig, ())


def weightless(rig: Rig) -> Rig:
    """The rig in free fall: nothing pulls before the first torque arrives."""
    model = rig.model.copy()
    model.gravity.linear = np.zeros(3)
    return replace(rig, model=model)


def linear(start: float, delay: float, samples: int) -> Array:
    """Error of the sampled, delayed double integrator under `GAINS`, from rest."""
    loop = sampled_loop(GAINS, DT, delay)
    state = np.zeros(loop.nstates)
    out = np.empty(samples)
    state[0] = start
    for k in range(samples):
        out[k] = state[0]
        state = (loop.A - loop.B @ loop.C) @ state
    return out


def hold(q: Array, seconds: float) -> Motion:
    steps = round(seconds / DT) + 1
    still = np.zeros((steps, len(q)))
    return Motion(DT * np.arange(steps), still + q, still, still)


def run(plant: Model, law: Controller, motion: Motion, start: State, delay: int = 1) -> Any:
    rng = np.random.default_rng(0)
    return simulate(
        plant, law, motion, rng=rng, sensors=Sensors.exact(plant.rig.n), delay=delay, start=start
    )


def random_state(rng: np.random.Generator, n: int) -> tuple[Array, Array, Reference, LawMemory]:
    q = rng.uniform(-0.7, 0.7, n)
    v = rng.uniform(-2, 2, n)
    reference = Reference(
        q + 0.05 * rng.standard_normal(n), v + rng.standard_normal(n), 5 * rng.standard_normal(n)
    )
    return q, v, reference, LawMemory(tuple((0.01 * rng.standard_normal(n)).tolist()))


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_exact_model_leaves_the_sampled_double_integrator(delay: int) -> None:
    """The tip axis alone, in free fall: its inertia is constant, the simulation is the linear loop's, to rounding."""
    rig = weightless(unlimited("turret", "none"))
    locked = pin.buildReducedModel(rig.model, [1], np.zeros(2))
    single = replace(
        rig,
        model=locked,
        joints=rig.joints[1:],
        links=rig.links[1:],
        motors=(Motor(),),
        limits=(Limits(),),
    )
    plant = frictionless(single)
    law = ComputedTorque(plant, (GAINS,), DT)
    log = run(plant, law, hold(np.zeros(1), 0.4), State(np.array([0.3]), np.zeros(1)), delay)
    np.testing.assert_allclose(log.q[:, 0], linear(0.3, delay * DT, len(log)), atol=1e-10)


@pytest.mark.parametrize("name", bundled_rigs())
def test_small_errors_of_all_joints_follow_the_same_linear_loop(name: str) -> None:
    """Away from any special pose, the joints coupled: decoupled, linear, alike, up to the square of the error."""
    plant = frictionless(weightless(unlimited(name)))
    n = plant.rig.n
    law = ComputedTorque(plant, (GAINS,) * n, DT)
    goal = np.full(n, 0.4)
    offset = 1e-4 * np.array([1.0, -2.0, 1.5])[:n]
    log = run(plant, law, hold(goal, 0.3), State(goal + offset, np.zeros(n)), delay=1)
    np.testing.assert_allclose(
        log.q - goal, np.outer(linear(1.0, DT, len(log)), offset), atol=1e-3 * 1e-4
    )


def test_computed_torque_is_the_models_inverse_on_the_reference() -> None:
    """On the reference, at rest in memory, the torque is exactly the model's."""
    rng = np.random.default_rng(1)
    model = nominal(unlimited("handheld"))
    law = ComputedTorque(model, (GAINS,) * 3, DT)
    for _ in range(20):
        q = rng.uniform(-0.7, 0.7, 3)
        v = rng.uniform(-2, 2, 3)
        a = rng.uniform(-20, 20, 3)
        tau, _ = law.torque(0.0, q, v, Reference(q, v, a), law.start())
        np.testing.assert_allclose(
            tau, model.inverse(q[None], v[None], a[None])[0], rtol=1e-12, atol=1e-12
        )


def test_dry_friction_is_compensated_in_the_references_direction_only() -> None:
    rig = unlimited("turret")
    model = Model(rig, tuple(Term(Coulomb(joint), (0.5,)) for joint in rig.joints))
    law, bare = (ComputedTorque(each, (GAINS,) * 2, DT) for each in (model, frictionless(rig)))
    q = np.array([0.1, 0.2])
    v = np.array([-0.3, 1e-5])
    for rate, dry in (
        ([1.0, -1.0], [0.5, -0.5]),
        ([5e-4, -5e-4], [0.0, 0.0]),
        ([0.0, 0.1], [0.0, 0.5]),
    ):
        reference = Reference(q, np.array(rate), np.zeros(2))
        got, without = (each.torque(0.0, q, v, reference, each.start())[0] for each in (law, bare))
        np.testing.assert_allclose(got - without, dry, atol=1e-12)


def test_feed_forward_leads_a_ramp_of_acceleration_exactly() -> None:
    """Linear in time, the acceleration `lead` later follows from the last difference."""
    model = frictionless(unlimited("turret"))
    law = ComputedTorque(model, (GAINS,) * 2, DT, lead=0.0035)
    zero = np.zeros(2)
    memory = law.start()
    for k in range(3):
        tau, memory = law.torque(
            0.0, zero, zero, Reference(zero, zero, np.full(2, 7.0 * k * DT)), memory
        )
    expected = model.inverse(zero[None], zero[None], np.full((1, 2), 7.0 * (2 * DT + 0.0035)))[0]
    np.testing.assert_allclose(tau, expected, rtol=1e-12)


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 5.0))
def test_torque_never_exceeds_the_limit(seed: int, limit: float) -> None:
    rng = np.random.default_rng(seed)
    rig = loaded("thesis")
    tight = replace(rig, motors=tuple(replace(motor, tau_max=limit) for motor in rig.motors))
    model = nominal(tight)
    laws: tuple[Controller, ...] = (
        ComputedTorque(model, (GAINS,) * 3, DT, robust=Robust(lyapunov((GAINS,) * 3), BOUNDS, 5.0)),
        JointPid((GAINS,) * 3, (0.3, 0.1, 0.1), tuple(tight.tau_max.tolist()), DT),
    )
    q, v, reference, memory = random_state(rng, 3)
    for law in laws:
        tau, _ = law.torque(0.0, q, v, reference, memory)
        assert (np.abs(tau) <= tight.tau_max).all() and np.isfinite(tau).all()
        assert (
            law.torque(0.0, q, v, reference, memory)[0] == tau
        ).all()  # pure: the same memory, the same torque


def test_pid_is_the_textbook_formula() -> None:
    law = JointPid((Pid(100.0, 50.0, 20.0), Pid(10.0, 0.0, 1.0)), (2.0, 3.0), (inf, inf), 0.01)
    reference = Reference(np.array([0.3, 0.0]), np.array([1.0, -1.0]), np.array([9.0, 9.0]))
    tau, memory = law.torque(
        0.0, np.array([0.1, 0.2]), np.zeros(2), reference, LawMemory((0.5, 0.0))
    )
    np.testing.assert_allclose(tau, [2 * (100 * 0.2 + 50 * 0.502 + 20), 3 * (-2.0 - 1.0)])
    np.testing.assert_allclose(memory.integral, [0.502, -0.002])


@dataclass(frozen=True)
class Winding:
    """A law whose integral goes on at the limit, for comparison."""

    law: JointPid | ComputedTorque

    @property
    def dt(self) -> float:
        return self.law.dt

    def start(self) -> LawMemory:
        return self.law.start()

    def torque(
        self, t: float, q: Array, v: Array, reference: Reference, memory: LawMemory
    ) -> tuple[Array, LawMemory]:
        tau, after = self.law.torque(t, q, v, reference, memory)
        wound = tuple(s + self.dt * e for s, e in zip(memory.integral, (reference.q - q).tolist()))
        return tau, after._replace(integral=wound)


def pan_step(kind: str, **changes: Any) -> tuple[JointPid | ComputedTorque, Model, Array]:
    """A law on the frictionless turret, and a raw 30° step of its pan axis."""
    plant = frictionless(Rig.load("turret"))
    moments = tuple(np.diagonal(compute_inertia(plant, np.zeros((1, 2)))[0]).tolist())
    pid = JointPid((GAINS,) * 2, moments, tuple(plant.rig.tau_max.tolist()), DT)
    law = pid if kind == "pid" else ComputedTorque(plant, (GAINS,) * 2, DT)
    return replace(law, **changes), plant, np.array([np.deg2rad(30), 0.0])


def overshoot(law: Controller, plant: Model, goal: Array) -> float:
    """Overshoot of a raw step that holds the motor at its limit, per cent."""
    log = run(plant, law, hold(goal, 0.8), State(0 * goal, 0 * goal))
    assert np.abs(log.tau[:, 0]).max() == plant.rig.tau_max[0]
    return float(100 * (log.q[:, 0].max() / goal[0] - 1))


@pytest.mark.parametrize("kind", ["computed-torque", "pid"])
def test_conditional_integration_limits_the_overshoot_of_a_raw_step(kind: str) -> None:
    """By the prototype's 37 : 13 at least; the rest is the linear loop's own at the limit, integral or not."""
    law, plant, goal = pan_step(kind)
    kept = overshoot(law, plant, goal)
    wound = overshoot(Winding(law), plant, goal)
    bare, _, _ = pan_step(kind, gains=(GAINS._replace(ki=0.0),) * 2)
    assert kept < wound * 13 / 37 and kept < overshoot(bare, plant, goal) + 15


@pytest.mark.parametrize("kind", ["computed-torque", "pid"])
def test_an_approach_that_the_motor_can_brake_does_not_overshoot(kind: str) -> None:
    law, plant, goal = pan_step(kind)
    assert (
        overshoot(replace(law, braking=braking(plant)), plant, goal)
        < 2
        < 10
        < overshoot(law, plant, goal)
    )


@given(st.floats(0.5, 40), st.floats(-2, 2))
def test_approach_meets_the_linear_loop_in_value_and_slope(
    deceleration: float, error: float
) -> None:
    """Beyond the knee the pull is that of the parabola v² = 2 a (e - e0/2); at the knee nothing jumps."""
    outer = Outer((GAINS,), (inf,), (deceleration,))
    knee = deceleration * (GAINS.kd / GAINS.kp) ** 2

    def pull(e: float) -> float:
        return outer.feedback([e], [0.0], [0.0])[0]

    assert pull(-error) == -pull(error)
    assert abs(pull(error)) <= GAINS.kp * abs(error) * (1 + 1e-12)
    if abs(error) > knee:
        speed = abs(pull(error)) / GAINS.kd
        assert speed**2 == pytest.approx(2 * deceleration * (abs(error) - knee / 2))
    step = 1e-6 * knee
    assert pull(knee + step) - pull(knee - step) == pytest.approx(2 * step * GAINS.kp, rel=1e-3)


@given(st.floats(-5, 5), st.floats(-1, 1))
def test_integral_stops_only_further_into_the_limit_or_far_away(
    torque: float, error: float
) -> None:
    outer = Outer((GAINS,), (2.0,), (500.0,))
    far = 500.0 * (GAINS.kd / GAINS.kp) ** 2
    (kept,) = outer.integrated([0.0], [0.001 * error], [error], [torque])
    stops = (abs(torque) > 2 and torque * error > 0) or abs(error) > far
    assert kept == (0.0 if stops else 0.001 * error)
    assert abs(outer.clipped([torque])[0]) <= 2


@pytest.mark.parametrize("name", bundled_rigs())
def test_braking_is_within_what_the_motor_has_at_every_pose(name: str) -> None:
    """With the stated deceleration, gravity and dry friction against it, no motor passes its limit."""
    model = nominal(Rig.load(name))
    q = sample_poses(model.rig)[0]
    for j, deceleration in enumerate(braking(model)):
        a = np.zeros_like(q)
        a[:, j] = deceleration
        for sign in (-1.0, 1.0):
            tau = model.inverse(q, 0 * q, sign * a, slide=sign * np.ones_like(q))
            assert (np.abs(tau[:, j]) < model.rig.tau_max[j]).all() and deceleration > 0


@given(st.floats(0.5, 30), st.floats(0.3, 2), st.floats(0, 0.5))
def test_gains_place_the_poles(hz: float, damping: float, integral: float) -> None:
    w = 2 * np.pi * hz
    wanted = np.polymul([1, 2 * damping * w, w**2], [1, integral * w])
    gains = Pid.placed(hz, damping, integral)
    np.testing.assert_allclose([1, gains.kd, gains.kp, gains.ki], wanted, rtol=1e-12, atol=1e-9)


# --- Lyapunov redesign -------------------------------------------------------------------------------------------

BOUNDS = ModelErrorBounds(alpha=0.3, phi=0.2, inverse=20.0, source="stated")


def perturbed(rig: Rig, rng: np.random.Generator) -> Rig:
    """The rig with every body's inertial parameters scaled by 0.9 to 1.1."""
    return rig.with_phi(rig.phi * np.repeat(rng.uniform(0.9, 1.1, rig.n), 10))


def decay(
    law: ComputedTorque, plant: Rig, state: tuple[Array, Array, Reference, LawMemory]
) -> tuple[float, float]:
    """Return V̇ along the true plant, and gain ‖z‖ - ρ: positive outside the boundary layer."""
    q, v, reference, memory = state
    assert law.robust is not None
    tau, _ = law.torque(0.0, q, v, reference, memory)
    acceleration = pin.aba(plant.model, plant.model.createData(), q, v, tau)
    integral = np.array(memory.integral) + law.dt * (reference.q - q)  # what the law counted
    xi = np.stack([integral, reference.q - q, reference.v - v], axis=1)
    slope = np.stack([reference.q - q, reference.v - v, reference.a - acceleration], axis=1)
    P = law.robust.P
    z = np.einsum("ij,ij->i", P[:, 2], xi)
    feedback = [g.ki * x[0] + g.kp * x[1] + g.kd * x[2] for g, x in zip(law.gains, xi)]
    rho = law.robust.size(reference.a.tolist(), feedback)
    return 2 * float(np.einsum("ij,ijk,ik->", xi, P, slope)), law.robust.gain * float(
        np.linalg.norm(z)
    ) - rho


@pytest.mark.parametrize("name", ["drone", "turret"])
def test_v_decreases_outside_the_boundary_layer_of_a_wrong_model(name: str) -> None:
    """The bounds that hold at a state are enough for V to fall there, whatever the error within them."""
    rng = np.random.default_rng(3)
    rig = unlimited(name)
    model = frictionless(rig)
    outside = 0
    for _ in range(150):
        plant = perturbed(rig, rng)
        state = random_state(rng, rig.n)
        known = holding(model, frictionless(plant), state)
        law = ComputedTorque(
            model, (GAINS,) * rig.n, DT, robust=Robust(lyapunov((GAINS,) * rig.n), known, 50.0)
        )
        slope, distance = decay(law, plant, state)
        if distance > 0:
            outside += 1
            assert slope < 0
    assert outside > 100


def holding(
    model: Model, plant: Model, state: tuple[Array, Array, Reference, LawMemory]
) -> ModelErrorBounds:
    """Bounds that are just met at one state."""
    q = state[0][None]
    v = state[1][None]
    true = compute_inertia(plant, q)[0]
    believed = compute_inertia(model, q)[0]
    alpha = np.linalg.norm(np.eye(len(true)) - np.linalg.solve(true, believed), 2)
    rest = np.linalg.norm(model.inverse(q, v, 0 * q) - plant.inverse(q, v, 0 * q))
    largest = 1 / np.linalg.eigvalsh(true)[0]
    return ModelErrorBounds(
        float(alpha) * 1.001, float(rest) * 1.001, float(largest), "this state's own"
    )


def test_without_the_redesign_a_wrong_model_can_make_v_grow() -> None:
    """So the law above owes its decrease to w: near z's zero the error of gravity alone pushes V up."""
    rng = np.random.default_rng(4)
    rig = unlimited("handheld")
    plain = ComputedTorque(frictionless(rig), (GAINS,) * 3, DT)
    grew = 0
    for _ in range(200):
        q = rng.uniform(-0.7, 0.7, 3)
        state = (
            q,
            np.zeros(3),
            Reference(q + 1e-5 * rng.standard_normal(3), np.zeros(3), np.zeros(3)),
            plain.start(),
        )
        plant = perturbed(rig, rng)
        law = replace(
            plain,
            robust=Robust(
                lyapunov(plain.gains), holding(plain.model, frictionless(plant), state), 1e-9
            ),
        )
        grew += decay(law, plant, state)[0] > 0
    assert grew > 50


def test_inside_the_layer_the_redesign_is_exactly_more_pid() -> None:
    law = Robust(lyapunov((GAINS,) * 2), BOUNDS, 0.7)
    s = [1e-6, -2e-6]
    e = [1e-5, 3e-5]
    r = [-1e-4, 2e-4]
    more = [stiffened(GAINS, row, 0.7) for row in law.rows]
    w = law.correction(s, e, r, [0.0, 0.0], [0.0, 0.0])
    extra = [
        (m.kp - GAINS.kp) * x + (m.ki - GAINS.ki) * i + (m.kd - GAINS.kd) * y
        for m, i, x, y in zip(more, s, e, r)
    ]
    np.testing.assert_allclose(w, extra, rtol=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_w_is_never_longer_than_rho_and_meets_it_outside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    law = Robust(lyapunov((GAINS,) * 3), BOUNDS, 2.0)
    s, e, r, a, f = (scale * rng.standard_normal(3) for scale in (1e-3, 1e-2, 1.0, 5.0, 20.0))
    w = law.correction(s.tolist(), e.tolist(), r.tolist(), a.tolist(), f.tolist())
    z = np.array([row[0] * x + row[1] * y + row[2] * u for row, x, y, u in zip(law.rows, s, e, r)])
    rho = (0.3 * np.linalg.norm(a) + 0.3 * np.linalg.norm(f) + 20 * 0.2) / 0.7
    np.testing.assert_allclose(np.linalg.norm(w), min(rho, 2.0 * np.linalg.norm(z)), rtol=1e-9)
    np.testing.assert_allclose(np.dot(w, z), np.linalg.norm(w) * np.linalg.norm(z), rtol=1e-9)


def test_a_model_that_is_all_wrong_is_refused() -> None:
    with pytest.raises(UsageError, match="alpha"):
        Robust(lyapunov((GAINS,)), replace(BOUNDS, alpha=1.0), 1.0)


# --- Bounds from the covariance ----------------------------------------------------------------------------------


def identified(rig: Rig, std: dict[str, float]) -> Model:
    """The nominal model with the given standard deviations of base parameters and friction coefficients."""
    reduction = reduce_parameters(rig)
    model = nominal(rig)
    names = reduction.base_names + tuple(
        f"{term.effect.joint}.{coefficient.name}"
        for term in model.terms
        for coefficient in term.effect.coefficients
    )
    assert set(std) <= set(names)
    spread = np.diag([std.get(name, 0.0) ** 2 for name in names])
    return replace(
        model, estimated=Estimated(names, ("",) * len(names), np.zeros(len(names)), spread)
    )


def test_certainty_leaves_no_bounds() -> None:
    found = bounds(identified(Rig.load("thesis"), {}), np.random.default_rng(0))
    assert found.alpha < 1e-9 and found.phi == 0.0


def test_friction_uncertainty_is_phi_and_not_alpha() -> None:
    rig = Rig.load("turret")
    found = bounds(identified(rig, {"pan.Fs": 0.01}), np.random.default_rng(0))
    assert found.alpha < 1e-9
    assert found.phi == pytest.approx(0.0196, rel=0.25)  # 95 % of |N(0, 0.01)|, of a hundred draws


def test_inertia_uncertainty_is_alpha_as_by_hand() -> None:
    """The pan inertia of a two-axis rig: D11 alone is uncertain, so D⁻¹ D̂ - I is known in closed form."""
    rig = Rig.load("turret", "none")
    reduction = reduce_parameters(rig)
    leading = reduction.base_names[0]
    base = Model(rig, ())
    q = sample_poses(rig)[0]
    D = compute_inertia(base, q)
    alone = np.zeros((2, 2))
    alone[0, 0] = 1.0
    delta = 0.02
    expected = max(
        np.linalg.norm(np.linalg.solve(each + 1.96 * delta * alone, each) - np.eye(2), 2)
        for each in D
    )
    other = max(
        np.linalg.norm(np.linalg.solve(each - 1.96 * delta * alone, each) - np.eye(2), 2)
        for each in D
    )
    found = bounds(identified(rig, {leading: delta}), np.random.default_rng(0))
    assert 0.75 * expected < found.alpha < 1.25 * other


def test_foreign_covariance_falls_back_to_the_stated_bounds() -> None:
    model = nominal(Rig.load("thesis"))
    strange = replace(model, estimated=Estimated(("x",), ("",), np.zeros(1), np.eye(1)))
    assert bounds(strange, np.random.default_rng(0)) == bounds(model, np.random.default_rng(0))
    assert "no covariance" in bounds(model, np.random.default_rng(0)).source


def test_inertia_counts_what_terms_add_per_acceleration() -> None:
    """Viscous friction adds nothing; the matrix is CRBA's, symmetric, positive."""
    rig = Rig.load("handheld")
    model = Model(rig, tuple(Term(Viscous(joint), (0.3,)) for joint in rig.joints))
    q = sample_poses(rig)[0][:5]
    for D, angles in zip(compute_inertia(model, q), q):
        data = rig.model.createData()
        zero = np.zeros(3)
        level = pin.rnea(rig.model, data, angles, zero, zero)
        columns = [pin.rnea(rig.model, data, angles, zero, row) - level for row in np.eye(3)]
        np.testing.assert_allclose(D, np.transpose(columns), atol=1e-12)


def test_margins_of_an_unstable_loop_are_zero() -> None:
    assert compute_margins(Pid.placed(200.0, 1.0, 0.2), DT, 0.005).disk_margin == 0.0
