"""The camera's controller in one's own loop: a measurement in, a torque out, and its file."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
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
from gimbal_pin.log import Array, Platform
from gimbal_pin.pointing import (
    WANTED,
    Controller,
    Level,
    Measurement,
    Recipe,
    Sensed,
    Sight,
    Spectrum,
    Station,
    attitude,
    draw_profile,
    leveled,
    rehearse_platform,
    simulate_holding,
    simulate_shaken_log,
    unbalance_payload,
)
from gimbal_pin.pointing.sight import holding
from gimbal_pin.rig import Rig
from tests.failing_sensors import FailingSensors
from tests.rigs import bundled

DT = 1e-3
URDF = Path(__file__).parents[2] / "urdf"


@cache
def made() -> Controller:
    rig = bundled("thesis")
    station = Station.of(rig)
    spectrum = Spectrum.of(rehearse_platform(rig)[1], DT)
    return Controller(
        Recipe(
            nominal(unbalance_payload(rig)),
            WANTED,
            spectrum,
            station.noise,
            float(station.step.max()),
        )
    )


def measured(seconds: float) -> list[Measurement]:
    """What the sensors say of a camera that is held exactly on profile S."""
    rig = bundled("thesis")
    ground = draw_profile(rig, seconds, 0)
    held = holding(Sight(rig), WANTED, ground.part(slice(0, None, 2)))
    t = np.asarray(ground.t[::2])
    sensed = Sensed(nominal(rig), ground, Station.of(rig), t, np.random.default_rng(0))
    states = zip(held.q, held.v)
    return [sensed.see(k, q, v) for k, (q, v) in enumerate(states)]


def torques(controller: Controller, stream: list[Measurement]) -> Array:
    return np.array([controller.step(measurement) for measurement in stream])


def test_a_file_keeps_all_of_a_controller(tmp_path: Path) -> None:
    """The same torques before and after; and what a flight taught of the platform goes along."""
    rig = bundled("thesis")
    path = tmp_path / "camera.json"
    stream = measured(0.1)
    made().start(stream[0])
    made().save(path)
    loaded = Controller.load(path, rig)
    np.testing.assert_allclose(torques(made(), stream), torques(loaded, stream), rtol=0, atol=1e-9)
    assert made().events == loaded.events
    flown = loaded.memory.known.past._replace(power=(np.ones((2, 1025)), 1))  # type: ignore[union-attr]
    loaded.memory = loaded.memory._replace(known=loaded.memory.known._replace(past=flown))  # type: ignore[union-attr]
    loaded.save(path)
    after = Controller.load(path, rig).recipe.spectrum
    np.testing.assert_allclose(after.rate, loaded.pointer.navigator.forecast.known(flown).rate)


@pytest.mark.parametrize("robust", [False, True])
def test_a_file_keeps_gains_that_were_tuned(tmp_path: Path, robust: bool) -> None:
    """A controller of `tune` holds the camera with its own gains, before and after its file."""
    rig = bundled("thesis")
    stream = measured(0.1)
    recipe = made().recipe
    tuned = tune(recipe.model, bandwidth_hz=3.0, robust=robust).stored
    own = Controller(replace(recipe, law=tuned.law))
    own.start(stream[0])
    own.save(tmp_path / "camera.json")
    loaded = Controller.load(tmp_path / "camera.json", rig)
    assert loaded.recipe.law is not None and loaded.recipe.law.gains == tuned.law.gains
    before, after, others = (torques(one, stream) for one in (own, loaded, made()))
    np.testing.assert_allclose(before, after, rtol=0, atol=1e-9)
    assert np.max(np.abs(before - others)) > 1e-3


def test_gains_that_cannot_hold_a_camera_are_refused() -> None:
    recipe = made().recipe
    for wish in ({"kind": "pid"}, {"dt": 0.004}):
        with pytest.raises(UsageError, match="controller"):
            Controller(replace(recipe, law=tune(recipe.model, bandwidth_hz=3.0, **wish).stored.law))


def test_a_tuned_controller_learns_the_platform_from_a_log() -> None:
    rig = bundled("turret")
    tuned = tune(nominal(rig), bandwidth_hz=5.0).stored
    controller = Controller.learn(rig, simulate_shaken_log(nominal(rig), seconds=4.0), tuned=tuned)
    assert controller.recipe.law is tuned.law and controller.recipe.model is tuned.model
    assert controller.recipe.delay == tuned.wish.holding_samples


def test_the_loop_of_ones_own_is_the_simulations() -> None:
    """A simulated hardware that calls `step` moves as the benchmark's loop does."""
    controller = made()
    rig = bundled("thesis")

    class Stepped:
        dt = controller.dt
        navigator = controller.pointer.navigator

        def start(self, seen: Measurement, camera: Array, base: Array) -> Any:
            return controller.start(seen, base)

        def torque(self, seen: Measurement, memory: Any) -> tuple[Array, Any]:
            return controller.step(seen), controller.memory

    plant = nominal(unbalance_payload(rig))
    ground = draw_profile(rig, 0.3, 0)
    runs = [
        simulate_holding(
            plant,
            who,
            ground,
            rng=np.random.default_rng(1),
            seconds=0.3,
            station=Station.exact(rig),
        )
        for who in (Stepped(), controller.pointer)
    ]
    np.testing.assert_allclose(runs[0].error, runs[1].error, atol=1e-9)


def test_a_controller_is_learned_from_a_shaken_log() -> None:
    rig = bundled("turret")
    log = simulate_shaken_log(nominal(rig), seconds=4.0)
    controller = Controller.learn(rig, log, attitude(0.1, 0.2))
    still = Measurement(
        0.0, np.array([0.1, 0.2]), np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 9.81])
    )
    torque = [controller.step(still._replace(t=k * DT)) for k in range(5)][-1]
    needed = nominal(rig).inverse(still.q[None], np.zeros((1, 2)), np.zeros((1, 2)))[0]
    np.testing.assert_allclose(torque, needed, atol=0.05 * float(rig.tau_max.max()))
    with pytest.raises(UsageError, match="cannot hold its camera"):
        Controller(replace(controller.recipe, wanted=attitude(0.0, 0.0, 1.5) @ attitude(3.0, 1.5)))


@given(st.floats(-1.2, 1.2), st.floats(-1.4, 1.4))
def test_gravity_says_where_up_is(roll: float, pitch: float) -> None:
    R = attitude(0.0, pitch, roll)
    np.testing.assert_allclose(leveled(R.T @ [0, 0, 9.81]), R, atol=1e-12)
    assert (leveled(np.full(3, np.nan)) == np.eye(3)).all() and (
        leveled(np.zeros(3)) == np.eye(3)
    ).all()


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.integers(0, 100), st.booleans())
def test_a_world_that_moves_is_leveled(roll: float, pitch: float, seed: int, sure: bool) -> None:
    """Sines of 1 m/s² at 0.2 to 2 Hz on top of gravity: one that is sure stays as it is, another becomes level."""
    level = Level(0.01)
    rng = np.random.default_rng(seed)
    dt = 0.01
    tilt = np.eye(3) if sure else attitude(0.0, pitch, roll)
    t = dt * np.arange(6000)
    f = np.geomspace(0.2, 2, 20)
    w = rng.standard_normal((20, 3))
    phase = rng.uniform(0, 2 * np.pi, 20)
    forces = tilt.T @ [0, 0, 9.81] + np.cos(2 * np.pi * t[:, None] * f + phase) @ w / np.sqrt(10)
    memory = level.start(sure)
    off = []
    for force in forces:
        memory = level.step(memory, force)
        off.append(np.degrees(np.arccos(np.clip((memory.turn @ tilt.T)[2, 2], -1, 1))))
    assert off[-1] < 0.1 and (not sure or max(off) < 0.02)


def test_a_camera_that_starts_on_one_sample_becomes_level() -> None:
    """The first sample has the base lean by 3°; it does not, and stands."""
    controller = exact("thesis")
    bench = Bench(controller, controller.recipe.looking, 3.0)
    sight = controller.pointer.navigator.sight
    lean = attitude(0.0, 0.0, np.radians(3.0)) @ [0, 0, 9.81]
    controller.start(Measurement(0.0, bench.state.q, np.zeros(3), np.zeros(3), lean, np.zeros(3)))
    bench.run(2.5)
    np.testing.assert_allclose(sight.attitude(bench.state.q)[2], WANTED[2], atol=np.radians(0.02))


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("joints", ["a", "b", "c"], "joints"),
        ("payload", None, "with no payload"),
        ("rig", "drone", "is of drone with"),
        ("schema", 99, "schema: is 99"),
        ("delay", -1, "delay: is -1"),
        ("delay", 1.5, "whole number"),
        ("wanted", [1.0] * 9, "rotation"),
        ("trusted", [True], "trusted"),
        ("spectrum", {"rate": [1.0], "force": [1.0, 2.0]}, "as many"),
        ("dt", -1, "dt"),
        ("model", {}, "phi"),
        ("noise", None, "noise"),
    ],
)
def test_a_file_that_is_no_controller_says_what_is_wrong(
    tmp_path: Path, key: str, value: object, said: str
) -> None:
    path = tmp_path / "camera.json"
    made().save(path)
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))
    with pytest.raises(ModelError, match=said) as refused:
        Controller.load(path, bundled("thesis"))
    assert str(path) in str(refused.value) and len(str(refused.value)) <= 300
    path.write_bytes(b"\x80\x04pickle")
    with pytest.raises(ModelError, match="no controller's file"):
        Controller.load(path, bundled("thesis"))


@pytest.mark.parametrize("delay", [-1, 1.5, 51, "one"])
def test_a_delay_is_a_number_of_samples(delay: Any) -> None:
    with pytest.raises(UsageError, match="delay: is"):
        Controller(replace(made().recipe, delay=delay))


@pytest.mark.parametrize("field", Measurement._fields)
@pytest.mark.parametrize(
    "value", [None, "0", [0.0] * 3, np.zeros(2), np.zeros((1, 3)), np.array(["a", "b", "c"])]
)
def test_a_measurement_of_another_kind_is_refused(field: str, value: Any) -> None:
    """By the sentence that names it; what was remembered stays, and numbers of any size go through."""
    controller = made()
    stream = measured(0.003)
    controller.start(stream[0])
    before = controller.memory
    with pytest.raises(UsageError, match="measurement"):
        controller.step(stream[1]._replace(**{field: value}))
    assert controller.memory is before
    controller.step(
        stream[1]._replace(t=1, q=stream[1].q.astype(np.float32), gyro=np.zeros(3, int))
    )


class Bench:
    """A rig on a base at rest in the loop of one's own: sensors without error, a sample of delay."""

    def __init__(self, controller: Controller, q: Array, seconds: float) -> None:
        """Take the angles at which the joints rest at the start."""
        self.controller = controller
        self.plant = controller.recipe.model
        t = DT * np.arange(round(seconds / DT) + 1)
        rig = self.plant.rig
        ground = Platform.still(DT / 2 * np.arange(2 * len(t) - 1))
        self.sensed = Sensed(self.plant, ground, Station.exact(rig), t, np.random.default_rng(0))
        self.system = Plant(self.plant, ground)
        self.state = State(q, 0 * q)
        self.command = 0 * q
        self.k = 0
        controller.memory = None

    def run(self, seconds: float) -> tuple[Array, Array, Array]:
        """Return angles, rates and torques, (N, n) each."""
        rows = []
        for _ in range(round(seconds / DT)):
            seen = self.sensed.see(self.k, self.state.q, self.state.v)
            acting, self.command = self.command, self.controller.step(seen)
            rows.append((self.state.q, self.state.v, acting))
            self.state = self.system.step(self.k * DT, self.state, acting, DT)
            self.k += 1
        return tuple(np.array(column) for column in zip(*rows))  # type: ignore[return-value]


@cache
def exact(name: str, keeps: bool = False) -> Controller:
    rig = bundled(name)
    spectrum = Spectrum.of(rehearse_platform(rig)[1], DT)
    return Controller(Recipe(nominal(rig), WANTED, spectrum, Station.exact(rig).noise, 0.0), keeps)


@pytest.mark.parametrize("name", ["thesis", "thesis", "handheld", "turret"])
def test_from_anywhere_the_camera_turns_to_where_it_shall_look(name: str) -> None:
    """Within the rates, never long at a torque limit, without overshoot, and as soon as the slowest joint can."""
    rig = bundled(name)
    controller = exact(name)
    rng = np.random.default_rng(len(name))
    lower, upper, fastest = (
        np.array([getattr(x, of) for x in rig.limits]) for of in ("lower", "upper", "velocity")
    )
    q = lower + (upper - lower) * rng.random(rig.n)
    way = controller.recipe.looking - q
    angles, rates, torques = Bench(controller, q, 3.0).run(3.0)
    gone = (angles - q) / way
    assert gone.max() < 1.001 and gone.min() > -0.001
    assert (np.abs(rates) < fastest).all() and (np.abs(torques) > 0.999 * rig.tau_max).mean() < 0.01
    late = round((0.6 + np.max(np.abs(way) / fastest)) / DT)
    assert np.degrees(np.abs(angles[late:] - controller.recipe.looking)).max() < 0.02


def test_the_camera_is_held_where_it_looks() -> None:
    """At the start, at an attitude of one's own, and at once while it turns there; its attitude is known."""
    controller = exact("thesis", True)
    sight = Sight(bundled("thesis"))
    q = np.array([1.0, -0.3, 0.4])
    with pytest.raises(UsageError, match="no measurement"):
        Controller(controller.recipe).attitude()
    bench = Bench(controller, q, 6.0)
    angles, *_ = bench.run(0.3)
    assert np.degrees(np.abs(angles[-1] - q)).max() < 0.1
    np.testing.assert_allclose(controller.attitude(), sight.attitude(bench.state.q), atol=1e-4)
    controller.hold(WANTED)
    bench.run(0.4)
    controller.hold()
    stopped = controller.attitude()
    after = bench.run(1.5)[0][-1]
    assert np.degrees(np.abs(sight.error(sight.attitude(after), stopped))).max() < 0.02
    controller.hold(WANTED)
    bench.run(2.0)
    assert np.degrees(np.abs(sight.error(sight.attitude(bench.state.q), WANTED))).max() < 0.02
    with pytest.raises(UsageError, match="rotation"):
        controller.hold(np.ones((3, 3)))


@pytest.mark.parametrize("seconds", [0.05, 0.12, 0.3, 0.5])
@pytest.mark.parametrize("other", [None, attitude(-0.3, 0.1)])
def test_in_the_midst_of_a_fast_turn_the_camera_comes_to_rest(
    seconds: float, other: Array | None
) -> None:
    """Within rates and torques; then it turns to where it shall look, and is there for good."""
    controller = exact("thesis")
    rig = bundled("thesis")
    sight = Sight(bundled("thesis"))
    bench = Bench(controller, controller.recipe.looking + np.array([1.2, -0.4, 0.4]), 4.0)
    before = bench.run(seconds)[1][-1]
    goal = controller.attitude() if other is None else other
    controller.hold(other)
    _, rates, torques = bench.run(2.5)
    assert np.degrees(np.abs(sight.error(sight.attitude(bench.state.q), goal))).max() < 0.02
    assert (np.abs(torques) < rig.tau_max).all() and (
        np.abs(rates) < [x.velocity for x in rig.limits]
    ).all()
    along = rates @ before / (before @ before)
    at_rest = int(np.argmax(along < 0.02))
    assert 0 < at_rest * DT < 0.5 and along[:at_rest].max() < 1.2


def test_an_attitude_out_of_reach_is_refused_and_at_the_start_said() -> None:
    """On a base that leans so far that the wanted attitude is beyond a limit; what is held stays as it is."""
    controller = made()
    rig = bundled("thesis")
    far = max(x.upper for x in rig.limits[-1:]) + 0.2
    still = measured(0.001)[0]
    controller.start(still)
    before = controller.memory
    with pytest.raises(UsageError, match="wanted"):
        controller.hold(attitude(0.0, far))
    assert controller.memory is before
    controller.start(still, WANTED @ attitude(0.0, -far))
    assert "held where it looks" in controller.events[0]
    np.testing.assert_allclose(controller.attitude(), controller.memory.known.wanted)  # type: ignore[union-attr]


def test_a_camera_may_look_along_any_axis(tmp_path: Path) -> None:
    """The same rig whose camera looks backwards is held with the same torques."""
    torques = []
    for axis in ("x", "-x", "y"):
        text = (
            URDF / "thesis.yaml"
        ).read_text() + f"optical_axis: {axis}\nurdf: {URDF / 'thesis.urdf'}\n"
        (tmp_path / "own.yaml").write_text(text)
        rig = Rig.load(tmp_path / "own.yaml")
        controller = Controller.learn(rig, simulate_shaken_log(nominal(rig), seconds=4.0))
        torques.append(Bench(controller, np.array([0.5, -0.3, 0.4]), 0.2).run(0.2)[2])
    np.testing.assert_allclose(torques[1:], [torques[0]] * 2, atol=1e-3)


@dataclass(frozen=True)
class Spike:
    """One reading that is wrong by so much, 0.8 s after the start."""

    name: str
    size: float

    def apply(self, seen: Measurement, before: Measurement | None) -> Measurement | None:
        if abs(seen.t - 0.8) > DT / 2:
            return seen
        return seen._replace(**{self.name: getattr(seen, self.name) + np.array([self.size, 0, 0])})


@pytest.mark.parametrize("name", ["q", "gyro", "w", "f", "links"])
def test_a_single_wrong_reading_moves_no_camera(name: str) -> None:
    """These sizes do not double the largest error on profile S; .06 rad/s of the platform's gyro do, 2.4 times."""
    pointer = made().pointer
    ground = draw_profile(bundled("thesis"), 1.0, 3)
    peaks = list[float]()
    for size in (0.0, 0.1, 10.0, 1e6, 1e155):
        holder = FailingSensors(pointer, (Spike(name, size),))
        run = simulate_holding(
            made().recipe.model, holder, ground, rng=np.random.default_rng(1), seconds=1.0
        )
        peaks.append(np.hypot(*run.error[500:, 1:].T).max())
        assert not any("given up" in event or "differ" in event for event in run.events)
    assert max(peaks) < 2 * peaks[0]


READING = st.sampled_from([0.0, 1.0, np.nan, np.inf, -1e9])


@given(
    st.lists(
        st.tuples(st.sampled_from([DT, -1.0, np.nan, 5.0]), *[READING] * 4), min_size=1, max_size=15
    )
)
def test_whatever_is_measured_the_torque_is_finite_and_within_limits(
    stream: list[tuple[float, ...]],
) -> None:
    controller = made()
    limit = bundled("thesis").tau_max
    t = 0.0
    controller.memory = None
    for step, *values in stream:
        t = t + step if np.isfinite(t) else step
        torque = controller.step(
            Measurement(t, *(np.full(3, x) for x in values), np.full(3, values[0]))
        )
        assert np.isfinite(torque).all() and (np.abs(torque) <= limit * (1 + 1e-12)).all()
