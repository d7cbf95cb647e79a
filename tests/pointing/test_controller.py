"""The camera's controller in one's own loop: a measurement in, a torque out, turns to where it shall look, its file."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import tune
from gimbal_pin.dynamics import Plant, State, nominal
from gimbal_pin.errors import ModelError, UsageError
from gimbal_pin.log import Array
from gimbal_pin.pointing import (
    WANTED,
    Controller,
    Measurement,
    attitude,
    simulate_shaken_log,
)
from gimbal_pin.rig import Noise
from tests.pointing.recipes import DT, recipe
from tests.rigs import bundled

UP = np.array([0.0, 0.0, 9.81])


@cache
def make(name: str = "thesis", keeps: bool = False) -> Controller:
    """Return a controller that knows its rig, and that its sensors have no noise."""
    own = replace(recipe(nominal(bundled(name))), noise=Noise(), step=0.0)
    return Controller(own, keeps)


def rest(controller: Controller, steps: int = 50) -> list[Measurement]:
    """Return what the sensors say of a camera that looks where it shall, on a base at rest."""
    q = controller.recipe.looking
    noise = 1e-4 * np.random.default_rng(0).standard_normal((steps, 5, 3))
    return [Measurement(k * DT, q + x[0], x[1], x[2], UP + x[3], x[4]) for k, x in enumerate(noise)]


# --- Making and keeping --------------------------------------------------------------------------------------------


def test_a_file_keeps_all_of_a_controller(tmp_path: Path) -> None:
    """Torques before and after are equal, with gains of its own; the forecast learned in flight is kept."""
    own = make().recipe
    law = tune(own.model, bandwidth_hz=3.0, robust=True).controller
    controller = Controller(replace(own, law=law))
    stream = rest(controller, 2200)
    controller.save(tmp_path / "new.json")
    loaded = Controller.load(tmp_path / "new.json", bundled("thesis"))
    torques = [[one.step(seen) for seen in stream] for one in (controller, loaded)]
    np.testing.assert_allclose(torques[0], torques[1], rtol=0, atol=1e-9)
    controller.save(tmp_path / "flown.json")
    after = Controller.load(tmp_path / "flown.json", bundled("thesis")).recipe.spectrum
    known = controller.pointer.navigator.forecast.known(controller.memory.known.past)
    np.testing.assert_allclose(after.rate, known.rate)


def test_a_controller_is_learned_from_a_shaken_log() -> None:
    """Its torque at rest is that of the plant; a tuned one has its own model and gains."""
    rig = bundled("turret")
    log = simulate_shaken_log(nominal(rig), seconds=4.0)
    learned = Controller.learn(rig, log, attitude(0.1, 0.2))
    q = np.array([0.1, 0.2])
    zero = np.zeros(3)
    torque = [learned.step(Measurement(k * DT, q, zero, zero, UP)) for k in range(5)][-1]
    needed = nominal(rig).inverse_dynamics(q, *np.zeros((2, 2)))
    np.testing.assert_allclose(torque, needed, atol=0.05 * float(rig.tau_max.max()))
    tuned = tune(nominal(rig), delay=0.003).stored
    recipe = Controller.learn(rig, log, tuned=tuned).recipe
    assert (recipe.law, recipe.model, recipe.delay) == (tuned.law, tuned.model, 3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"delay": -1}, "delay: is"),
        ({"wanted": np.ones((3, 3))}, "rotation"),
        ({"wanted": attitude(0.0, 0.0, 1.5)}, "cannot hold its camera"),
        ({"law": tune(nominal(bundled("thesis")), kind="pid").controller}, "is a PID"),
        ({"law": tune(nominal(bundled("thesis")), dt=0.004).controller}, "steps every"),
    ],
)
def test_a_recipe_that_cannot_hold_a_camera_is_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        Controller(replace(make().recipe, **change))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("joints", ["a", "b", "c"]),
        ("schema", 99),
        ("delay", -1),
        ("wanted", [1.0] * 9),
        ("trusted", [True]),
        ("spectrum", {"rate": [1.0], "force": [1.0, 2.0]}),
        ("dt", -1),
        ("model", {}),
    ],
)
def test_a_file_that_is_no_controller_is_refused(tmp_path: Path, key: str, value: object) -> None:
    path = tmp_path / "camera.json"
    make().save(path)
    Controller.load(path, bundled("thesis"))
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))
    with pytest.raises(ModelError):
        Controller.load(path, bundled("thesis"))


# --- Measurements --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("field", Measurement._fields)
@pytest.mark.parametrize("value", [None, np.zeros(2), np.array(["a", "b", "c"])])
def test_a_measurement_of_another_kind_is_refused(field: str, value: Any) -> None:
    """What was remembered stays."""
    controller = make()
    first, second = rest(controller, 2)
    before = controller.start(first)
    with pytest.raises(UsageError, match="measurement"):
        controller.step(second._replace(**{field: value}))
    assert controller.memory is before


READING = st.sampled_from([0.0, 1.0, -3.0, np.nan, np.inf, -1e9, 1e155])
STEP = st.sampled_from([DT, -1.0, np.nan, 5.0])


@given(st.lists(st.tuples(STEP, *[READING] * 5), min_size=1, max_size=15))
def test_whatever_is_measured_the_torque_is_finite_and_within_limits(
    stream: list[tuple[float, ...]],
) -> None:
    controller = make()
    controller.memory = None
    t = 0.0
    for step, *values in stream:
        t = t + step if np.isfinite(t) else step
        torque = controller.step(Measurement(t, *(np.full(3, x) for x in values)))
        assert (np.abs(torque) <= bundled("thesis").tau_max * (1 + 1e-12)).all()


# --- Turns ---------------------------------------------------------------------------------------------------------


class Bench:
    """A rig on a base at rest in the loop of one's own: sensors without error, a sample of delay."""

    def __init__(self, controller: Controller, q: Array) -> None:
        """Take the angles at which the joints rest at the start."""
        self.controller = controller
        self.sight = controller.pointer.navigator.sight
        self.system = Plant(controller.recipe.model)
        self.state = State(q, 0 * q)
        self.command = 0 * q
        self.t = 0.0
        controller.memory = None

    def run(self, seconds: float) -> Array:
        """Return angles, rates and torques, (3, N, n)."""
        rows = []
        for _ in range(round(seconds / DT)):
            q = self.state.q
            v = self.state.v
            gyros = self.sight.rates(q, v, np.zeros(3))
            seen = Measurement(self.t, q, gyros[:3], np.zeros(3), UP, gyros[3:])
            rows.append((q, v, self.command))
            acting = self.command
            self.command = self.controller.step(seen)
            self.state = self.system.step(self.t, self.state, acting, DT)
            self.t += DT
        return np.array(rows).swapaxes(0, 1)

    def miss(self, wanted: Array) -> float:
        """Return by how much the camera does not look as wanted, degrees."""
        error = self.sight.error(self.sight.attitude(self.state.q), wanted)
        return float(np.degrees(np.abs(error).max()))


def test_from_anywhere_the_camera_turns_to_where_it_shall_look() -> None:
    """Within the rates, never long at a torque limit, without overshoot, and as soon as the slowest joint can."""
    rig = bundled("thesis")
    controller = make()
    lower, upper, fastest, *_ = np.array([tuple(vars(x).values()) for x in rig.limits]).T
    q = lower + (upper - lower) * np.random.default_rng(6).random(rig.n)
    way = controller.recipe.looking - q
    angles, rates, torques = Bench(controller, q).run(3.0)
    gone = (angles - q) / way
    assert -0.001 < gone.min() <= gone.max() < 1.001
    assert (np.abs(rates) < fastest).all()
    assert (np.abs(torques) > 0.999 * rig.tau_max).mean() < 0.01
    late = round((0.6 + np.max(np.abs(way) / fastest)) / DT)
    assert np.abs(angles[late:] - controller.recipe.looking).max() < 3e-4


def test_in_the_midst_of_a_fast_turn_the_camera_turns_elsewhere() -> None:
    """Within rates and torques; then it is there for good."""
    controller = make()
    rig = bundled("thesis")
    bench = Bench(controller, controller.recipe.looking + np.array([1.2, -0.4, 0.4]))
    bench.run(0.12)
    assert bench.miss(controller.attitude()) < 1
    goal = attitude(-0.3, 0.1)
    controller.hold(goal)
    _, rates, torques = bench.run(2.5)
    assert bench.miss(goal) < 0.02
    assert (np.abs(torques) < rig.tau_max).all()
    assert (np.abs(rates) < [x.velocity for x in rig.limits]).all()


def test_a_camera_without_a_goal_is_held_where_it_looks_and_out_of_reach_refused() -> None:
    """What is held stays as it is; a start whose goal is out of reach says so."""
    controller = make(keeps=True)
    bench = Bench(controller, np.array([1.0, -0.3, 0.4]))
    looked = bench.sight.attitude(bench.state.q)
    bench.run(0.3)
    assert bench.miss(looked) < 0.1
    before = controller.memory
    for wanted, said in ((attitude(0.0, 2.5), "wanted"), (np.ones((3, 3)), "rotation")):
        with pytest.raises(UsageError, match=said):
            controller.hold(wanted)
    assert controller.memory is before
    (still,) = rest(make(), 1)
    make().start(still, WANTED @ attitude(0.0, -2.5))
    assert "held where it looks" in make().events[0]
    with pytest.raises(UsageError, match="no measurement"):
        Controller(controller.recipe).attitude()
