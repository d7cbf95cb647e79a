"""Late drives: each joint's loops by themselves, an oracle that is a bound, and loops that swing by themselves."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import Equal, Margins
from gimbal_pin.dynamics import Model, State, nominal
from gimbal_pin.effects import Delay
from gimbal_pin.log import Array
from gimbal_pin.pointing import (
    NAMES,
    WANTED,
    Budget,
    Contest,
    Course,
    Pointing,
    Roster,
    Row,
    Sensed,
    Shaken,
    Sight,
    Spectrum,
    Station,
    Verified,
    rehearsed,
    unbalanced,
)
from gimbal_pin.report import text
from gimbal_pin.rig import Rig

DT = 1e-3


@cache
def plant() -> Model:
    return nominal(unbalanced(Rig.load("thesis")))


def late(seconds: float) -> Model:
    """The plant with a drive of yaw that acts so much later."""
    return replace(plant(), drive=(Delay("yaw", seconds),))


def roster(model: Model) -> Roster:
    station = Station.of(model.rig)
    _, imu = rehearsed(model.rig)
    return Roster(model, WANTED, Spectrum.of(imu, DT), station.noise, 2 * pi / 2**16)


def course(model: Model, seconds: float) -> Course:
    return Course(model, Shaken(Sight(model.rig).centre, seconds), "S", seconds, Station.of(model.rig))


# --- Margins, joint by joint -------------------------------------------------------------------------------------


def test_a_late_drive_slows_its_own_joint_and_no_other() -> None:
    """Of every controller: yaw keeps the margin with its 5 ms, roll and tilt stay as they were without them."""
    slow, fast = roster(late(0.005)), roster(plant())
    for name in NAMES:
        own, without = slow.margins(name), fast.margins(name)
        assert [margins.disk_margin >= 1.07 for margins in own] == [True] * 3
        assert own[0].crossover_hz < 0.5 * without[0].crossover_hz
        if name != "lyapunov":  # one boundary layer for all joints: the tightest of them says how thin
            assert own[1:] == without[1:]
    pids = [roster.pointer("pid-world").law.gains for roster in (slow, fast)]
    assert pids[0][0].kp < pids[1][0].kp and pids[0][1:] == pids[1][1:]
    assert slow.pointer("with-observer").law.observers[0].delay == 6  # type: ignore[attr-defined]
    assert slow.pointer("with-observer").law.observers[1].delay == 1  # type: ignore[attr-defined]


def test_each_drives_forecast_is_weighted_by_its_own_loops() -> None:
    found = roster(late(0.005))
    forecast, alone = found.pointer("switch").navigator.forecast, Equal()
    assert forecast.leads == (pytest.approx(0.0015), pytest.approx(0.0065))
    assert forecast.gains == (alone.pid, found.equals[0].pid)


# --- The oracle --------------------------------------------------------------------------------------------------


def test_the_oracle_sees_the_platform_where_each_drive_acts() -> None:
    """Its mean over the hold there, between two samples in proportion, and no further than the motion goes."""
    model, t = plant(), DT * np.arange(101)
    ground = course(model, 0.1).ground(0)
    sensed = Sensed(model, ground, Station.of(model.rig), t, np.random.default_rng(0))
    seen = sensed.see(10, State(np.zeros(3), np.zeros(3)), (3.0, 13.5, 1e6))
    assert seen is not None and seen.true is not None
    np.testing.assert_allclose(seen.true[0].w, np.array([1, 4, 1]) / 6 @ ground.w[22:25], rtol=1e-12)
    np.testing.assert_allclose(seen.true[1].f, np.array([1, 5, 5, 1]) / 12 @ ground.f[32:36], rtol=1e-12)
    np.testing.assert_allclose(seen.true[2].dw, ground.dw[-1], rtol=1e-12)


def test_no_forecast_beats_the_oracle_of_a_late_drive() -> None:
    """The oracle knows, for every drive by itself, what ours foresees: so it is the bound that it is called."""
    model = late(0.005)
    still = {name: course(model, 1.2).run(roster(model), name, 1).jitter[0] for name in ("with-gyros", "oracle")}
    assert still["oracle"] < still["with-gyros"]


def made(torque: Array, t: Array) -> Pointing:
    """A run with some torque; what the camera did does not matter."""
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    zero = np.zeros((len(t), 3))
    return Pointing("made", "S", 0, plant().rig.joints, t, zero, zero, torque, level, plant().rig.tau_max)


@given(st.lists(st.tuples(st.floats(0, 99), st.sampled_from(["yaw at its limit for 0.05 s", "3 samples never came"]))))
def test_every_event_counts_once(events: list[tuple[float, str]]) -> None:
    run = made(np.zeros((9, 3)), DT * np.arange(9))
    told = Row("a", (replace(run, events=tuple(f"{t:.3f} s: {what}" for t, what in events)),)).happened
    assert len(told) == len({what for _, what in events})
    counts = [int(line.split("(")[1].split()[0]) if line.endswith("times)") else 1 for line in told]
    assert sum(counts) == len(events)
    for line in told:
        what = line.split(" s: ", 1)[1].split(" (")[0]
        assert float(line.split()[0]) == pytest.approx(min(t for t, one in events if one == what), abs=1e-3)


def test_the_budget_names_what_is_compensated_beside_friction() -> None:
    """Cogging is no friction: its share is said to be both's, and the parts still add up."""
    jitter = {"pid-world": 9.0, "computed-torque": 4.0, "with-friction": 1.0, "oracle": 0.5}
    alone, both = Budget.of(jitter), Budget.of(jitter, ("cogging",))
    assert alone is not None and both is not None
    assert "friction" in alone.parts and both.parts["friction and cogging"] == alone.parts["friction"]
    assert sum(both.parts.values()) == pytest.approx(1.0)


def test_the_text_says_why_an_observer_costs() -> None:
    t = DT * np.arange(4000)
    sizes = {"pid-world": 9.0, "with-gyros": 1.0, "with-observer": 2.0, "switch": 1.0, "oracle": 1.5}
    shake = 1e-5 * np.sin(60 * t)[:, None] * np.ones(3)
    events = ("0.100 s: yaw at its torque limit for 0.05 s", "0.300 s: yaw at its torque limit for 0.05 s")
    run = replace(made(np.zeros((4000, 3)), t), events=events)
    rows = [Row(name, (replace(run, controller=name, error=size * shake),)) for name, size in sizes.items()]
    fast, slow = Margins(58.0, 15.0, 1.07, 0.006, 25.0), Margins(56.0, 19.0, 1.07, 0.012, 12.0)
    loops = {name: (slow if name == "with-observer" else fast,) * 3 for name in sizes}
    contest = Contest("thesis", None, tuple(rows))
    told = text.verified(Verified(contest, fast, loops=loops))
    assert "all but with observer" in told and told.count("yaw, roll, tilt") == 2
    assert "with observer shakes 2 times as much as with gyros" in told and "crosses at 12 Hz, not at 25" in told
    assert "oracle: no bound here" in told
    assert "world-frame PID: 0.100 s: yaw at its torque limit for 0.05 s (2 times)" in told
