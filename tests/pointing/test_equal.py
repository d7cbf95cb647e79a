"""Late drives: each joint's loops by themselves; events of several runs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import EqualMarginLoop
from gimbal_pin.dynamics import Model, nominal
from gimbal_pin.effects import Delay
from gimbal_pin.pointing import (
    WANTED,
    Pointing,
    Recipe,
    Row,
    Spectrum,
    Station,
    rehearse_platform,
    unbalance_payload,
)
from gimbal_pin.rig import Rig

DT = 1e-3


@cache
def plant() -> Model:
    return nominal(unbalance_payload(Rig.load("thesis")))


def recipe(seconds: float) -> Recipe:
    """Of a plant whose drive of yaw acts so much later."""
    model = replace(plant(), drive=(Delay("yaw", seconds),) if seconds else ())
    spectrum = Spectrum.of(rehearse_platform(model.rig)[1], DT)
    return Recipe(model, WANTED, spectrum, Station.of(model.rig).noise, 2 * pi / 2**16)


def test_a_late_drive_slows_its_own_joint_and_no_other() -> None:
    """Of both controllers: yaw keeps the margin with its 5 ms, roll and tilt stay as they were without them."""
    slow = recipe(0.005)
    fast = recipe(0.0)
    for name in slow.names:
        own = slow.margins(name)
        without = fast.margins(name)
        assert [margins.disk_margin >= 1.07 for margins in own] == [True] * 3
        assert own[0].crossover_hz < 0.5 * without[0].crossover_hz and own[1:] == without[1:]
        gains = [own.pointer(name).law.gains for own in (slow, fast)]
        assert gains[0][0].kp < gains[1][0].kp and gains[0][1:] == gains[1][1:]


def test_each_drives_forecast_is_weighted_by_its_own_loops() -> None:
    found = recipe(0.005)
    forecast = found.pointer().navigator.forecast
    alone = EqualMarginLoop()
    assert forecast.leads == (pytest.approx(0.0015), pytest.approx(0.0065))
    assert forecast.gains == (alone.pid, found.equals[0].pid)


@given(
    st.lists(
        st.tuples(
            st.floats(0, 99),
            st.sampled_from(["yaw at its limit for 0.05 s", "3 samples never came"]),
        )
    )
)
def test_every_event_counts_once(events: list[tuple[float, str]]) -> None:
    t = DT * np.arange(9)
    zero = np.zeros((9, 3))
    level = np.tile([1.0, 0.0, 0.0, 0.0], (9, 1))
    run = Pointing(
        "made", "S", 0, plant().rig.joints, t, zero, zero, zero, level, plant().rig.tau_max
    )
    told = Row(
        "a", (replace(run, events=tuple(f"{t:.3f} s: {what}" for t, what in events)),)
    ).happened
    assert len(told) == len({what for _, what in events})
    counts = [int(line.split("(")[1].split()[0]) if line.endswith("times)") else 1 for line in told]
    assert sum(counts) == len(events)
    for line in told:
        what = line.split(" s: ", 1)[1].split(" (")[0]
        assert float(line.split()[0]) == pytest.approx(
            min(t for t, one in events if one == what), abs=1e-3
        )
