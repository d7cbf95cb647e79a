"""Control laws: linear error dynamics, the model's own torque, limits, anti-windup, Lyapunov redesign.

Bounds of the model's error, which the redesign answers, are those of parameters drawn from its covariance.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest

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
    lyapunov,
    sample_poses,
    sampled_loop,
    tune,
)
from gimbal_pin.dynamics import Reference, Sensors, State, nominal, plant_with, simulate
from gimbal_pin.effects import Term, Viscous, parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Motion
from tests.control.models import estimated, free, name_parameters
from tests.rigs import bundled

GAINS = Pid.placed(8.0, 1.0, 0.2)
DT = 0.001


@pytest.mark.parametrize("delay", [0, 3])
def test_an_exact_model_leaves_the_sampled_double_integrator(delay: int) -> None:
    """Coupled joints away from any special pose err as the linear loop does, up to the square of the error."""
    plant = free("handheld")
    law = ComputedTorque(plant, (GAINS,) * 3, DT)
    goal = np.full(3, 0.4)
    offset = 1e-4 * np.array([1.0, -2.0, 1.5])
    zero = np.zeros((300, 3))
    motion = Motion(DT * np.arange(300), zero + goal, zero, zero)
    start = State(goal + offset, np.zeros(3))
    log = simulate(plant, law, motion, rng=0, sensors=Sensors.exact(3), delay=delay, start=start)
    loop = sampled_loop(GAINS, DT, delay * DT)
    state = np.eye(loop.nstates)[0]
    for q in log.q:
        np.testing.assert_allclose(q - goal, state[0] * offset, atol=1e-7)
        state = (loop.A - loop.B @ loop.C) @ state


@pytest.mark.parametrize(
    "texts",
    [
        ("cogging:pan:amplitude=0.05,harmonic=12,phase=0.4", "cable-spring:tilt:stiffness=0.3"),
        ("torque-gain:tilt:gain=0.8", "quadratic-drag:pan:drag=0.1"),
        ("dead-zone:pan:width=0.02",),
    ],
)
def test_on_the_reference_the_torque_is_the_models(texts: tuple[str, ...]) -> None:
    """With all that was found in it; what the drive loses is made up for."""
    rig = bundled("turret")
    plant, drive = plant_with(nominal(rig), [parse_effect(text, rig) for text in texts])
    model = replace(plant, drive=drive)
    law = ComputedTorque(model, (GAINS,) * 2, DT)
    for seed in range(4):
        q, v, a = np.random.default_rng(seed).uniform(0.02, 0.1, (3, 2))
        v[0] *= (-1) ** seed
        torque, _ = law.torque(0.0, q, v, Reference(q, v, a), law.start())
        for signal in drive:
            torque[0] = signal.step((), torque[0], DT)[1]
        np.testing.assert_allclose(torque, model.inverse_dynamics(q, v, a), rtol=1e-9)


def test_feed_forward_leads_a_ramp_of_acceleration_exactly() -> None:
    """Linear in time, the acceleration `lead` later follows from the last difference, angle and rate from it."""
    bare = free("turret")
    model = replace(bare, terms=(Term(Viscous("pan"), (0.3,)),))
    law = ComputedTorque(model, (GAINS,) * 2, DT, lead=0.0035)
    q = np.zeros(2)
    v = np.array([0.0, 2.0])
    memory = law.start()
    for k in range(3):
        reference = Reference(q, v, np.full(2, 7.0 * k * DT))
        torque, memory = law.torque(0.0, q, v, reference, memory)
    ahead = np.full(2, 7.0 * (2 * DT + 0.0035))
    expected = bare.inverse_dynamics(q + 0.0035 * v, v, ahead)
    expected[0] += 0.3 * 0.0035 * 7.0 * 2 * DT
    np.testing.assert_allclose(torque, expected, rtol=1e-12)


def test_the_pid_is_the_textbook_formula_modulo_turns_of_a_joint_without_stops() -> None:
    gains = (Pid(100.0, 50.0, 20.0), Pid(10.0, 0.0, 1.0))
    law = JointPid(gains, (2.0, 3.0), (inf, inf), 0.01, continuous=(True, False))
    reference = Reference(np.array([0.3, 0.0]), np.array([1.0, -1.0]), np.array([9.0, 9.0]))
    q = np.array([0.1 + 6 * pi, 0.2])
    torque, after = law.torque(0.0, q, np.zeros(2), reference, LawMemory((0.5, 0.0)))
    np.testing.assert_allclose(torque, [2 * (100 * 0.2 + 50 * 0.502 + 20), 3 * (-2.0 - 1.0)])
    np.testing.assert_allclose(after.integral, [0.502, -0.002])


@pytest.mark.parametrize("kind", ["computed-torque", "pid"])
def test_a_torque_is_within_its_limit(kind: str) -> None:
    law = tune(nominal(bundled("thesis")), kind=kind).controller
    reference = Reference(np.full(3, 9.0), np.zeros(3), np.zeros(3))
    torque, _ = law.torque(0.0, np.zeros(3), np.zeros(3), reference, law.start())
    np.testing.assert_allclose(torque, bundled("thesis").tau_max)


@pytest.mark.parametrize("times", [1.01, 30.0])
def test_beyond_the_knee_the_pull_is_that_of_the_parabola(times: float) -> None:
    """The rate at which it arrives is v² = 2 a (e - e0/2); up to the knee e0 the loop is linear."""
    outer = Outer((GAINS,), (inf,), (5.0,))
    knee = 5.0 * (GAINS.kd / GAINS.kp) ** 2
    (pull,) = outer.feedback([-times * knee], [0.0], [0.0])
    assert -pull / GAINS.kd == pytest.approx(np.sqrt(2 * 5.0 * (times - 0.5) * knee))
    assert outer.feedback([0.999 * knee], [0.0], [0.0]) == [0.999 * knee * GAINS.kp]


@pytest.mark.parametrize(
    ("torque", "error", "kept"),
    [(1.0, 0.1, 0.2), (3.0, 0.1, 0.1), (3.0, -0.1, 0.2), (-3.0, -0.1, 0.1), (1.0, 5.0, 0.1)],
)
def test_the_integral_stops_only_further_into_the_limit_or_far_away(
    torque: float, error: float, kept: float
) -> None:
    outer = Outer((GAINS,), (2.0,), (500.0,))
    assert outer.integrated([0.1], [0.2], [error], [torque]) == (kept,)


def test_an_approach_counts_on_seven_tenths_of_what_the_motor_has_at_the_worst_pose() -> None:
    """With all of it, gravity and dry friction against it, no motor passes its limit, and each reaches it."""
    model = nominal(bundled("handheld"))
    q = sample_poses(model.rig)[0]
    for j, deceleration in enumerate(tune(model).controller.braking):
        a = 0 * q + deceleration / 0.7 * np.eye(3)[j]
        tau = [
            model.inverse_dynamics(q, 0 * q, x * a, slide=np.full_like(q, x))[:, j]
            for x in (-1.0, 1.0)
        ]
        assert np.abs(tau).max() == pytest.approx(model.rig.tau_max[j])


# --- Lyapunov redesign -------------------------------------------------------------------------------------------


def test_v_decreases_along_the_closed_error_system() -> None:
    """``Aᵀ P + P A = -diag(ω⁶, ω⁴, ω²)``."""
    gains = Pid.placed(0.3, 0.8, 0.2)
    A = np.array([[0, 1, 0], [0, 0, 1], [-gains.ki, -gains.kp, -gains.kd]])
    (P,) = lyapunov((gains,))
    np.testing.assert_allclose(A.T @ P + P @ A, -np.diag(gains.kp ** np.r_[3, 2, 1]), atol=1e-9)
    assert (np.linalg.eigvalsh(P) > 0).all()


@pytest.mark.parametrize("size", [1e-5, 1.0])
def test_redesign_adds_rho_along_z_and_within_its_layer_in_proportion(size: float) -> None:
    """``w = min(ρ, gain ‖z‖) z/‖z‖`` with ``ρ = (α ‖a‖ + α ‖K ξ‖ + B_M Φ)/(1 - α)`` and z = Bᵀ P ξ."""
    gains = (GAINS,) * 3
    robust = Robust(lyapunov(gains), ModelErrorBounds(0.3, 0.2, 20.0, "stated"), 2.0)
    a, e, r = np.random.default_rng(0).standard_normal((3, 3))
    xi = size * np.array([DT * e, e, r])
    zero = np.zeros(3)
    reference = Reference(xi[1], xi[2], a)
    plain = ComputedTorque(free("handheld"), gains, DT)
    torque, pushed = (
        law.torque(0.0, zero, zero, reference, plain.start())[0]
        for law in (plain, replace(plain, robust=robust))
    )
    z = robust.P[0, 2] @ xi
    feedback = np.array([GAINS.ki, GAINS.kp, GAINS.kd]) @ xi
    rho = (0.3 * np.linalg.norm(a) + 0.3 * np.linalg.norm(feedback) + 20 * 0.2) / 0.7
    w = z * min(rho / np.linalg.norm(z), 2.0)
    expected = compute_inertia(plain.model, zero[None])[0] @ w
    np.testing.assert_allclose(pushed - torque, expected, rtol=1e-6)


def test_a_model_that_is_all_wrong_is_refused() -> None:
    with pytest.raises(UsageError, match="alpha"):
        Robust(lyapunov((GAINS,)), ModelErrorBounds(1.0, 0.2, 20.0, "stated"), 1.0)


# --- Bounds from the covariance ----------------------------------------------------------------------------------


def test_uncertain_friction_is_phi_and_uncertain_inertia_is_alpha() -> None:
    """By hand: 95 % of |N(0, σ)|, of a hundred draws, and so much of pan's inertia D11 in ``I - D⁻¹ D̂``."""
    model = nominal(bundled("turret", "none"))
    names = name_parameters(model)
    friction, inertia = (
        bounds(estimated(model, np.diag(variances)), np.random.default_rng(0))
        for variances in 1e-4 * np.eye(len(names))[[names.index("tilt.Fs"), 0]]
    )
    assert friction.alpha < 1e-9
    assert friction.phi == pytest.approx(0.0196, rel=0.25)
    D = compute_inertia(model, sample_poses(model.rig)[0])
    share = np.linalg.norm(np.linalg.inv(D)[:, :, 0], axis=1).max()
    assert inertia.alpha == pytest.approx(0.0196 * share, rel=0.3)
    assert bounds(model, np.random.default_rng(0)).alpha == 0.1


def test_inertia_is_the_torque_per_acceleration_rotors_included() -> None:
    rig = bundled("handheld")
    model = plant_with(nominal(rig), [parse_effect("armature:roll:inertia=0.02", rig)]).plant
    q = sample_poses(rig)[0][:5]
    level = model.inverse_dynamics(q, 0 * q, 0 * q)
    columns = [model.inverse_dynamics(q, 0 * q, 0 * q + row) - level for row in np.eye(3)]
    np.testing.assert_allclose(compute_inertia(model, q), np.stack(columns, axis=2), atol=1e-12)
