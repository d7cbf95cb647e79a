"""Long logs and long chains: what is left out of them does not show."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.identification import given_beta, identify
from gimbal_pin.log import PAUSE, Log
from gimbal_pin.regression import Filtering, subsample_log
from tests.bench_logs import prescribed
from tests.rigs import chain


def counted(samples: int, dt: float, start: float = 0.0) -> Log:
    """A log whose angles count its rows."""
    t = start + dt * np.arange(samples)
    return Log("counted", ("a",), t, np.arange(samples, dtype=float)[:, None])


@given(st.integers(2, 9), st.floats(2.0, 30.0), st.floats(2.1, 9.0), st.floats(-1e3, 1e3))
def test_stretches_stand_for_the_whole_log(
    count: int, used: float, times: float, shift: float
) -> None:
    """In order, apart, as long as asked, evenly over the log with both ends, wherever its clock starts."""
    dt = 0.005
    log, moved = (counted(round(times * used / dt) + count, dt, start) for start in (0.0, shift))
    rows = subsample_log(log, used, count).log.q[:, 0]
    assert np.array_equal(rows, subsample_log(moved, used, count).log.q[:, 0])
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > 1.0) + 1)
    assert len(parts) == count and {len(part) for part in parts} == {round(used / count / dt)}
    assert rows[0] == 0 and rows[-1] == len(log) - 1 and np.all(np.diff(rows) > 0)
    left_out = [after[0] - before[-1] for before, after in pairwise(parts)]
    assert max(left_out) - min(left_out) <= 1


@given(st.integers(0, 1000))
@example(1)
def test_a_short_log_is_looked_at_as_a_whole(samples: int) -> None:
    log = counted(samples, 0.01)
    assert subsample_log(log).log is log and not subsample_log(log).note


def test_what_is_left_out_of_a_long_log_is_a_pause() -> None:
    found = subsample_log(counted(130_000, 0.005))
    steps = np.diff(found.log.t)
    assert (
        np.all((steps < 0.006) | (steps > PAUSE))
        and "8 segments of 15 s out of 10.8 min" in found.note
    )


def test_a_chain_of_twenty_joints_gives_its_parameters_back() -> None:
    rig = chain(20)
    log = prescribed(nominal(rig), seconds=8.0, dt=0.004)
    found = identify(rig, [log], holdout="none", filtering=Filtering(alignment=0.0)).estimate
    planted = np.append(given_beta(rig, reduce_parameters(rig)), rig.friction.ravel())
    assert np.abs(found.theta - planted).max() < 1e-4 * np.abs(planted).max()
