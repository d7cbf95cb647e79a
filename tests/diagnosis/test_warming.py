"""Laws of friction that changes as a motor warms by its own losses."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gimbal_pin.diagnosis import Evidence, Problem, State, gather, solve_causes, torque_rmse
from gimbal_pin.diagnosis.evidence import gather_for_judgement
from gimbal_pin.diagnosis.extended import build_extended_model
from gimbal_pin.diagnosis.library import list_candidates
from gimbal_pin.dynamics import Model, Plant, nominal, reduce_parameters
from gimbal_pin.dynamics import State as At
from gimbal_pin.effects import FrictionDrift, Losses, Sample, Term
from gimbal_pin.identification import split_logs
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.candidates import refined, worth
from tests.diagnosis.test_forms import ALIGNED

RIG = Rig.load("turret")
DT = 2e-3


def uneven(seed: int, seconds: float) -> Motion:
    """A motion that swells and ebbs: the torque's square is not the same all the time."""
    f = fourier(RIG, seed, seconds, DT)
    w = 2 * np.pi / seconds * np.array([1.0, 1.5])
    mid = np.mean(f.q, axis=0)
    t = f.t[:, None]
    g = 0.6 - 0.4 * np.cos(w * t)
    dg = 0.4 * w * np.sin(w * t)
    ddg = 0.4 * w**2 * np.cos(w * t)
    q = f.q - mid
    return Motion(f.t, mid + g * q, g * f.v + dg * q, g * f.a + 2 * dg * f.v + ddg * q)


def warming(seed: int, *terms: Term, seconds: float = 24.0) -> Log:
    """The log of such a motion under terms that read the losses of the very torque that they are a part of."""
    motion = uneven(seed, seconds)
    model = Model(RIG, (*nominal(RIG).terms, *terms))
    t = motion.t - motion.t[0]
    losses = None
    for _ in range(8):
        tau = model.inverse(motion.q, motion.v, motion.a, t=t, losses=losses)
        losses = [Losses.along(t, x, t) for x in tau.T]
    noise = 1e-3 * np.random.default_rng(seed + 1).standard_normal(tau.shape)
    return Log("warming", RIG.joints, motion.t, motion.q, motion.v, tau + noise)


def opened(log: Log) -> tuple[State, Evidence]:
    """The refitted model without any cause, and the held-out part."""
    train, test, _ = split_logs([log], None, ALIGNED)
    problem = Problem.of(gather(RIG, train, ALIGNED, {log.name: log}), reduce_parameters(RIG))
    fitted = solve_causes(problem, (), solve_causes(problem, ()))
    return fitted, gather_for_judgement(RIG, test, ALIGNED, {log.name: log})


def found(state: State) -> list[FrictionDrift]:
    """Drifts of the friction, refined, the best first."""
    tried = [
        refined(state, one)
        for one in list_candidates(state.problem.evidence, {"friction-drift": FrictionDrift})
    ]
    drifts = [one for one in tried if isinstance(one, FrictionDrift)]
    return sorted(drifts, key=partial(worth, state), reverse=True)


@pytest.mark.parametrize("span", [2.0, 15.0, 1e4])
def test_a_torque_that_is_held_warms_to_its_square(span: float) -> None:
    t = np.arange(0.0, 30.0, 7e-3)
    losses = Losses.along(t, np.full(len(t), 3.0), t)
    np.testing.assert_allclose(
        losses.warmth(span), 9.0 * -np.expm1(-t / span), atol=9.0 * 0.02 / span
    )


def test_what_a_motor_did_before_a_part_of_its_log_warmed_it() -> None:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(1e-3, 9e-3, 4000))
    tau = rng.standard_normal(4000)
    whole = Losses.along(t, tau, t)
    part = Losses.along(t, tau, t[2500:])
    np.testing.assert_array_equal(whole.warmth(5.0)[2500:], part.warmth(5.0))


def test_a_log_of_a_year_keeps_its_losses_in_a_few_megabytes() -> None:
    t = np.array([0.0, 0.01, 3e7, 3e7 + 0.01])
    losses = Losses.along(t, np.full(4, 3.0), t)
    assert losses.power.nbytes < 10e6
    np.testing.assert_allclose(losses.warmth(1e4)[-2:], 9.0, rtol=1e-6)


def test_the_plant_warms_as_the_log_says_it_does() -> None:
    """What the simulation keeps from step to step is what identification makes of the torques that were logged."""
    effect = FrictionDrift("tilt", span=3.0, held=0.4)
    plant = Plant(Model(RIG, (*nominal(RIG).terms, Term(effect, (0.02, 0.01)))))
    t = DT * np.arange(2500)
    tau = np.stack([0.3 * np.sin(2 * t), 0.2 + 0.4 * np.cos(3 * t)], axis=1)
    state = At(np.zeros(2), np.zeros(2))
    j = RIG.joint_index("tilt")
    for k in range(len(t) - 1):
        state = plant.step(t[k], state, tau[k], DT)
    still: Array = np.zeros(len(t))
    along = Sample(t, *([still] * 5), losses=Losses.along(t, tau[:, j], t))  # type: ignore[arg-type]
    assert state.memory[0] == pytest.approx(effect.remembered(along)[-1], rel=1e-2)
    assert plant.friction.level(t[-1], 0.0, 0.0, j, 1.0, state.memory) == pytest.approx(
        plant.friction.level(t[-1], 0.0, 0.0, j, 1.0, (0.0,)) + 0.02 * state.memory[0]
    )


def test_friction_that_a_motor_warms_by_its_own_torque_is_found() -> None:
    """By its losses it is told to the noise, with span and size; by time it is not. The held-out part began warm."""
    seed = 3
    joint = "tilt"
    span = 4.0
    change = -0.3
    dry = float(RIG.friction[RIG.joint_index(joint)][0])
    plain = warming(seed)
    held = float(np.sqrt(np.mean(plain.tau[:, RIG.joint_index(joint)] ** 2)))
    planted = Term(FrictionDrift(joint, span, held=held), (change * dry, 0.0))
    state, rest = opened(warming(seed, planted))
    best = found(state)[0]
    assert best.joint == joint and best.held > 0 and best.span == pytest.approx(span, rel=0.1)
    after = solve_causes(state.problem, (best,), state)
    assert after.fit.dispersion.max() < 1.5
    assert after.coefficients(best)[0] / best.held**2 == pytest.approx(
        change * dry / held**2, rel=0.1
    )
    timed = solve_causes(state.problem, (replace(best, held=0.0),), state)
    assert (
        timed.fit.cost > 1.5 * after.fit.cost
        or timed.fit.dispersion.max() > 1.5 * after.fit.dispersion.max()
    )
    left = [
        torque_rmse(rest, build_extended_model(x))[RIG.joint_index(joint)]
        for x in (after, timed, state)
    ]
    assert left[0] < 0.5 * min(left[1:])
