"""Laws of delays that wander: they are told from those that stand still, from lags and from what no delay does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.diagnosis.library import Library, library
from gimbal_pin.diagnosis.searched import believed
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.diagnosis.wandering import STEP, hides, loosened, reconsidered, slowly, steady, wandering
from gimbal_pin.effects.actuator_lag import ActuatorLag
from gimbal_pin.effects.base import Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.delay import Delay
from gimbal_pin.effects.stribeck import Stribeck
from gimbal_pin.log import Array, Log
from gimbal_pin.model import Model, nominal
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig
from gimbal_pin.simulation import plant_with
from tests.test_forms import ALIGNED, gather, prescribed

RIG = Rig.load("turret")
RIGID, JOINT = nominal(RIG), RIG.joints[0]
MEAN, SWING, PERIOD = 0.012, 0.005, 6.0


def log_of(model: Model) -> Log:
    """A log without any drive."""
    return prescribed(model, 3, seconds=24.0, torque_noise=1e-3, dt=2e-3)


def late(log: Log, delay: Array | float) -> Log:
    """Commands whose torque acts `delay` s later, (N,), at the first joint: command(t) = torque(t + delay)."""
    tau = np.array(log.tau)
    tau[:, 0] = np.interp(log.t + delay, log.t, tau[:, 0])
    return replace(log, tau=tau)


def swinging(log: Log) -> Array:
    """A delay of some milliseconds that swings over some seconds, s, (N,)."""
    return MEAN + SWING * np.sin(2 * np.pi / PERIOD * log.t)


def fitted(log: Log, *causes: Cause) -> State:
    """Causes fitted to a log with the rigid model."""
    problem = Problem.of(gather(RIG, [log], ALIGNED, {log.name: 0.0}), reduce(RIG))
    return solved(problem, causes, solved(problem, ()))


def test_hats_over_time_add_up_to_what_they_stand_on() -> None:
    parts = fitted(log_of(RIGID)).problem.evidence.parts * 2
    values = [part.channels.v[:, 0] for part in parts]
    rows = slowly(parts, values)
    for row, x in zip(rows, values, strict=True):
        np.testing.assert_allclose(row.sum(axis=1), x, atol=1e-12)
    assert rows[0].shape[1] >= 2 * np.ptp(parts[0].time) / STEP
    assert not np.any(np.any(rows[0], axis=0) & np.any(rows[1], axis=0))


def test_a_delay_that_swings_is_told_with_how_far_it_swings() -> None:
    log = log_of(RIGID)
    state = fitted(late(log, swinging(log)), Delay(JOINT, MEAN))
    found = wandering(state, state.causes[0])
    assert found is not None and found.rms == pytest.approx(SWING / np.sqrt(2), rel=0.15)
    assert steady(state)[0] == found.left < 0.1 * state.fit.dispersion[0]
    np.testing.assert_array_equal(steady(state)[1:], state.fit.dispersion[1:])
    assert believed(fitted(late(log, swinging(log))), state).causes == state.causes


@pytest.mark.parametrize("off", [0.0, 0.002])
def test_a_delay_that_stands_still_does_not_wander(off: float) -> None:
    """Not even where its time is not quite right."""
    state = fitted(late(log_of(RIGID), MEAN), Delay(JOINT, MEAN + off))
    found = wandering(state, state.causes[0])
    assert found is None or found.rms == pytest.approx(off, rel=0.2)


def hum(log: Log) -> Array:
    """A tone that has nothing to do with the motion."""
    return np.asarray(0.1 * np.std(log.tau[:, 0]) * np.sin(2 * np.pi * 7.3 * log.t))  # type: ignore[index]


def knock(log: Log) -> Array:
    """A blow every 1.7 s that rings at 5 Hz and dies away."""
    since = log.t % 1.7
    return np.asarray(np.std(log.tau[:, 0]) * np.exp(-since / 0.1) * np.sin(2 * np.pi * 5 * since))  # type: ignore[index]


def beat(log: Log) -> Array:
    """A gain that swings as slowly as a delay might."""
    return np.asarray(0.3 * np.sin(2 * np.pi / PERIOD * log.t) * log.tau[:, 0])  # type: ignore[index]


@pytest.mark.parametrize("foreign", [hum, knock, beat])
def test_what_no_delay_does_is_no_wandering(foreign: Callable[[Log], Array]) -> None:
    log = log_of(RIGID)
    tau = np.array(log.tau)
    tau[:, 0] += foreign(log)
    spoilt = late(replace(log, tau=tau), MEAN)
    state = fitted(spoilt, Delay(JOINT, MEAN))
    assert state.fit.dispersion[0] > 4.0 and wandering(state, state.causes[0]) is None
    np.testing.assert_array_equal(steady(state), state.fit.dispersion)


def test_a_torque_that_would_come_before_its_command_does_not_wander() -> None:
    log = log_of(RIGID)
    state = fitted(late(log, swinging(log)), Delay(JOINT, MEAN))
    early = Delay(JOINT, 1e-4)
    assert loosened(state, state.causes[0]).rms > early.time
    assert wandering(replace(state, causes=(early,)), early) is None


def looked_at_again(state: State, *kinds: type[Cause]) -> State:
    """What is reconsidered with these causes in the library."""
    shelf = library(state.problem, {kind.name: kind for kind in kinds})
    return reconsidered(state, Library(state.problem, shelf))


def test_a_lag_that_stands_for_a_wandering_delay_gives_it_its_place() -> None:
    log = log_of(RIGID)
    before = fitted(late(log, swinging(log)), ActuatorLag(JOINT, MEAN))
    state = looked_at_again(before, Delay, ActuatorLag)
    assert looked_at_again(before, ActuatorLag).causes == before.causes
    assert isinstance(delay := state.causes[0], Delay) and delay.time == pytest.approx(MEAN, abs=SWING / 4)


def test_a_lag_remains_one() -> None:
    log, lag = log_of(RIGID), ActuatorLag(JOINT, MEAN)
    tau = np.array(log.tau)
    tau[:, 0] += lag.time_constant * np.gradient(tau[:, 0], log.dt)  # the command whose lagged torque acts
    state = fitted(replace(log, tau=tau), lag)
    assert looked_at_again(state, Delay, ActuatorLag).causes == state.causes


def test_a_cause_beside_a_wandering_delay_shows_where_it_does_without_the_wandering() -> None:
    stribeck = Stribeck(JOINT, 0.1)
    log = log_of(plant_with(RIGID, [Term(stribeck, (0.05,))]).plant)
    there = fitted(late(log, swinging(log)), Delay(JOINT, MEAN), stribeck)
    bare = log_of(RIGID)
    not_there = fitted(late(bare, swinging(bare)), Delay(JOINT, MEAN), stribeck)
    assert hides(there, there.causes[1]) and not hides(not_there, not_there.causes[1])
